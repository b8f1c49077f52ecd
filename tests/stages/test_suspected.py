"""A gauge that is suspected of being turned reads what one that is meant to be so reads, on average over its installation."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import yaml

from strainsight import api
from strainsight.cases.structure.nuisances import on_average, tolerated
from strainsight.cases.structure.problem import filter_model, problem_of
from strainsight.cases.structure.suspected import suspect_of, turning_of

from ..edges.beam import PLACEMENT_CONFIG, bricks

TURN = 30.0


def test_a_gauge_taken_as_turned_has_the_mean_of_one_that_is(tmp_path):
    (tmp_path / "beam.bdf").write_text(bricks((10, 2, 2), "hex20"), encoding="ascii")
    (tmp_path / "edge.yaml").write_text(yaml.safe_dump(PLACEMENT_CONFIG | {"screen": {"keep": "all"}}), encoding="utf-8")
    case = api.load(
        tmp_path / "edge.yaml", [f"gauges.direction.angles=[0, {TURN}]", "tolerances={angle: 6.0}", "gauges.clearance=none"]
    )
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    problem = problem_of(case.config, {}, reduced, training, api.screen(case, mesh, reduced, training))
    pool = training.candidates
    one = int(np.flatnonzero((pool.angle == 0) & (pool.normal[:, 2] > 0.99) & (np.abs(pool.position[:, 0] - 0.25) < 0.05))[0])
    (twin,) = np.flatnonzero((pool.angle == TURN) & (pool.element == pool.element[one]) & (pool.facet == pool.facet[one]))

    def averaged(channel):
        channels = np.array([channel])
        own = tolerated(case.config, mesh, reduced, training, channels)
        plain = filter_model(problem, channels, 0.001)
        return own, plain, on_average(own, plain, channels)

    own, _, model = averaged(one)
    test = SimpleNamespace(channels=np.array([one]), known=None, values=None)
    start = np.zeros((model.size, model.size))
    given = SimpleNamespace(
        model=model, test=test, problem=problem, covariance=start, tolerances=own, biased=None, settled=None
    )
    turning = turning_of(mesh, reduced, training, test.channels)
    found, _ = suspect_of(case.config, mesh, reduced, training, given, turning).turned(0, TURN)
    assert not start.any()  # the start at rest of the filter is left as it is
    _, plain, wanted = averaged(int(twin))
    size = np.abs(wanted.H).max()
    np.testing.assert_allclose(found.H, wanted.H, atol=1e-9 * size)
    assert np.abs(wanted.H - plain.H).max() > 5e-3 * size  # what would be missing

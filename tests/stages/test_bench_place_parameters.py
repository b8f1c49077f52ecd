"""Gauges placed for loads and a modulus: slopes by differences of equilibria, σ that the bench's own filter comes to claim."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from strainsight.errors import StrainsightError
from strainsight.stages.bench.pipeline import bench_stages

from .conftest import finished, job_of
from .test_bench_place import written

FREE = {
    "ratio: 0.01}}": "ratio: 0.01}, moduli: {E: {region: 1, value: 2.1e+11}}}",
    "    side: {std: 1.0e+3, increment: 20.0}\n": "",
    "    down: {std: 1.0e+3, increment: 10.0}\n": "    down: {std: 1.0e+3, increment: 10.0}\n"
    "  parameters: {E: {std: 1.0e+10}}\n",
    "duration: 0.05": "duration: 1.0",
}
"""The side load is known, and tells the modulus from the other one."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """stage → Artefact of the beam with changes to its text and its keys; mesh and modes are computed once."""
    folder = tmp_path_factory.mktemp("parameters")

    def run(*changes, last="place", **text):
        job = job_of(written(folder, **FREE, **text), folder / "r", f"name=b{abs(hash(changes))}", "field=null", *changes)
        every = ("import", "reduce", "place", "simulate", "estimate")
        wanted = every[: every.index(last) + 1]
        stages = [stage for stage in bench_stages(job.config) if stage.name in wanted]
        return {name: artefact for name, (_, _, artefact) in finished(job, stages).items()}

    return run


@pytest.mark.parametrize(("sensor", "layout"), [("gauges", "place"), ("others", "random-1")])
def test_a_filter_comes_to_claim_of_load_and_modulus_what_was_expected(bench, sensor, layout):
    """Of a modulus that does not change, σ at the end of the run, which no steady state has."""
    done = bench(f"estimate.sensors={{{sensor}: {{noise: 1.0e-7}}}}", last="estimate")
    estimate, place = done["estimate"], done["place"]
    assert place["/inputs"].tolist() == ["down", "E"]
    expected = place[f"/layouts/{layout}/std"]
    assert estimate["/inputs/down/std"][-1] == pytest.approx(expected[0], rel=0.02)
    assert estimate["/parameters/E/std"][-1] == pytest.approx(expected[1], rel=0.05)
    assert expected[1] < 0.5e10


def test_beside_a_modulus_the_advice_says_that_sigma_is_of_exact_gauges(bench):
    exact, loose = bench()["place"], bench("estimate.tolerances={}")["place"]
    assert loose["/advice"][0].startswith("Beside parameters σ here is that of exact gauges")
    assert not any("exact gauges" in own for own in exact["/advice"])


def test_the_response_to_a_modulus_is_that_of_two_equilibria(bench):
    place = bench()["place"]
    step, own = 2.1e8, place["/layouts/place/candidate"]
    less, more = (
        bench(f"bodies.beam.moduli.E.value={value}", "estimate.parameters.E.guess=2.1e+11", last="simulate")["simulate"]
        for value in (2.1e11 - step, 2.1e11 + step)
    )
    # gauges where that bench has placed them: the same ones, for its filter takes E for the same
    slope = (more["/sensors/gauges"][0] - less["/sensors/gauges"][0]) / (2 * step)
    np.testing.assert_allclose(place["/candidates/response"][own, 1], slope, rtol=1e-3)


def test_a_layout_for_load_and_modulus_is_the_best_of_its_pool(bench):
    """Over all subsets by scipy; the whole pool counts 1 an unknown."""
    place = bench()["place"]
    F, H, Q, R, W = (place[f"/augmented/{name}"][0] for name in ("F", "H", "Q", "R", "weight"))
    rows = H / np.sqrt(R)[:, None]
    costs = {
        gauges: W @ np.diag(solve_continuous_are(F.T, rows[list(gauges)].T, Q, np.eye(3)))
        for gauges in combinations(range(len(rows)), 3)
    }
    assert place.summary["trace_final"] == pytest.approx(min(costs.values()), rel=1e-6)
    assert place.summary["trace_initial"] == pytest.approx(2.0, rel=1e-9)
    assert place.summary["lower_bound"] <= min(costs.values()) * (1 + 1e-9)


def test_a_run_in_two_poses_that_are_one_is_a_run_in_one(bench):
    """Loads are constant: the covariance is handed from pose to pose as if there were none between."""
    one, two = bench()["place"], bench("place.poses=[0.0, 0.6]")["place"]
    np.testing.assert_allclose(two["/layouts/random-1/std"][1], one["/layouts/random-1/std"][1], rtol=1e-6)


def test_gauges_that_tell_nothing_of_a_parameter_are_reported(bench):
    place = bench("estimate.parameters.E.std=1.0e+7")["place"]
    assert place["/layouts/place/std"][1] == pytest.approx(1e7, rel=0.01)
    assert "Of E the gauges tell next to nothing" in place["/advice"].tolist()[0]
    assert "next to nothing" not in " ".join(bench()["place"]["/advice"].tolist())


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ({"layout: place}": "layout: place, zeroed: true}"}, "E strains no candidate"),
        ({"direction: [0, 1, 0], signal": "direction: [0, 0, 1], signal"}, "together"),
    ],
)
def test_a_modulus_that_no_gauge_can_tell_is_refused(bench, text, says):
    """Gauges zeroed under the load that stays; a known load beside the unknown one, on its line of action."""
    with pytest.raises(StrainsightError, match=says):
        bench(f"seed={len(says)}", **text)

"""Displacement sensors and accelerometers of a bench beside gauges in a placement: all subsets, and what its filter has then."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import yaml
from scipy.linalg import solve_continuous_are
from typer.testing import CliRunner

from strainsight.stages.bench.pipeline import bench_stages, demanded
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..robustness.small import BENCH, write_project

SENSORS = """sensors:
  end: {type: motion, frame: tip}
  felt: {type: acceleration, frame: tip, axes: global, gravity: false}
"""
GIVEN = """sensors:
    gauges: {noise: 1.0e-5}
    felt: {noise: 1.0e-3, layout: place}
    end: {noise: [1.0, 2.0e-6, 1.0], layout: place}"""
CONFIG = (
    BENCH[: BENCH.index("place:\n")].replace("sensors:\n", SENSORS, 1).replace("duration: 0.2", "duration: 0.6").replace(
        "sensors: {gauges: {noise: 1.0e-7}}", GIVEN
    )
    + """place:
  body: beam
  sensors: {felt: {noise: 1.0e-3}, end: {noise: [1.0, 2.0e-6, 1.0]}}
  keep: 4
  noise: 1.0e-5
  search: pool
  pool: 6
  minimum_spacing: 0.02
  random: 1
"""
)  # fmt: skip


def run(folder, *words):
    done = CliRunner().invoke(app, [words[0], str(folder / "bench.yaml"), "--results", str(folder / "results"), *words[1:]])
    return done.exit_code, " ".join((done.output + (done.stderr or "")).split())


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("motion")
    write_project(folder)
    (folder / "bench.yaml").write_text(CONFIG)
    code, said = run(folder, "estimate")
    assert code == 0, said
    return folder


@pytest.fixture(scope="module")
def place(bench):
    return Artefact(bench / "results" / "bench" / "place.h5")


def test_the_layout_of_gauges_and_sensors_is_the_best_of_all_subsets(place):
    """Scipy's Riccati solver over every subset of the pool, in which every component is."""
    F, H, Q, r, w = (place[f"/augmented/{name}"][0] for name in ("F", "H", "Q", "R", "weight"))
    pool, layout = list(place["/pool/candidate"]), place["/layouts/place/candidate"]
    assert len(H) == len(pool) == 6 + 6
    cost = {}
    for chosen in combinations(range(len(H)), len(layout)):
        own = list(chosen)
        try:
            P = solve_continuous_are(F.T, H[own].T, Q, np.diag(r[own]))
        except (np.linalg.LinAlgError, ValueError):
            continue  # a load is lost
        if np.all(np.diag(P) >= 0):
            cost[chosen] = float(w @ np.diag(P))
    assert cost[tuple(sorted(pool.index(one) for one in layout))] == pytest.approx(min(cost.values()), rel=1e-6)
    assert list(place["/layouts/place/sensor"].astype(str)) == ["end.y", "felt.y", "", ""]


def test_an_accelerometer_among_the_candidates_reads_what_newton_says(place):
    """By the load at once: at a body that rests, H of the load is the acceleration per newton; at rest under it none is left."""
    names = place["/layouts/place/sensor"].astype(str)
    row = int(np.flatnonzero([name.startswith("felt.") for name in names])[0])
    pool = list(place["/pool/candidate"]).index(place["/layouts/place/candidate"][row])
    F, H = place["/augmented/F"][0], place["/augmented/H"][0, pool]
    modes = (len(F) - 2) // 2
    eta = -np.linalg.solve(F[modes : 2 * modes, :modes], F[modes : 2 * modes, -2:])
    at_rest = np.vstack([eta, np.zeros((modes, 2)), np.eye(2)])
    assert np.abs(H @ at_rest).max() < 1e-9 * np.abs(H[-2:]).max()
    assert np.abs(H[-2:]).max() > 0


def test_the_filter_is_given_the_components_of_the_layout(bench, place):
    found = Artefact(bench / "results" / "bench" / "estimate.h5")
    names = place["/layouts/place/sensor"].astype(str)
    given = np.isfinite(found["/sensors/felt/measured"]).any(axis=0)
    np.testing.assert_array_equal(given, [f"felt.{axis}" in names for axis in "xyz"])
    assert found.summary["channels"] == len(names)
    for i, name in enumerate(("side", "down")):
        assert found[f"/inputs/{name}/std"][-1] == pytest.approx(place["/layouts/place/std"][i], rel=0.01)


def test_what_cannot_be_a_candidate_is_refused(bench):
    code, said = run(bench, "place", "--set=place.sensors={gauges: {noise: 1.0}}")
    assert code == 2
    assert "it is no displacement sensor and no accelerometer" in said
    code, said = run(bench, "estimate", "--set=place.sensors={}")
    assert code == 2
    assert "it is not among the candidates of place" in said
    code, said = run(bench, "place", "--set=estimate.disturbance=0.1")
    assert code == 2
    assert "set it to 0, or take felt out of place.sensors" in said


def test_a_simulation_does_not_wait_for_components_that_a_filter_alone_is_given():
    """It has all components of such a sensor; gauges that a sensor takes from the placement it has to know."""
    config = yaml.safe_load(CONFIG)
    config["bearings"] = {}
    config["estimate"] |= {"truth": {"model": "fine"}, "measured": None}
    for layout, waits in ((None, False), ("place", True)):
        config["sensors"]["gauges"]["layout"] = layout
        stages = {stage.name: stage.upstream for stage in bench_stages(config)}
        assert ("place" in stages["simulate"]) == waits
        assert "place" in stages["estimate"]
        assert any(stage.name == "place" for stage in demanded("statics", config)) == waits

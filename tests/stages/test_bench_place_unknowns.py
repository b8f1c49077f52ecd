"""Gauges of a bench placed beside displacement sensors and accelerometers, and for a modulus."""

from __future__ import annotations

import json
from itertools import combinations

import numpy as np
import pytest
import yaml
from scipy.linalg import solve_continuous_are

from strainsight.errors import StrainsightError
from strainsight.stages.bench.pipeline import bench_stages, demanded

from ..models import ended
from ..robustness.small import BENCH
from .test_bench_place import ESTIMATED, PLACED, run

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


@pytest.fixture(scope="module")
def bench():
    return ended("estimate", CONFIG)


@pytest.fixture(scope="module")
def place(bench):
    return bench.artefact("place")


def test_the_layout_of_gauges_and_sensors_is_the_best_of_all_subsets(place):
    F, H, Q, r, w = (place[f"/augmented/{name}"][0] for name in ("F", "H", "Q", "R", "weight"))
    pool, layout = list(place["/pool/candidate"]), place["/layouts/place/candidate"]
    assert len(H) == len(pool) == 6 + 6
    # in units of the noise: with others SciPy is off by 5e-5 on some processors
    cost, rows = {}, H / np.sqrt(r)[:, None]
    for chosen in combinations(range(len(H)), len(layout)):
        try:
            P = solve_continuous_are(F.T, rows[list(chosen)].T, Q, np.eye(len(chosen)))
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
    found = bench.artefact("estimate")
    names = place["/layouts/place/sensor"].astype(str)
    given = np.isfinite(found["/sensors/felt/measured"]).any(axis=0)
    np.testing.assert_array_equal(given, [f"felt.{axis}" in names for axis in "xyz"])
    assert found.summary["channels"] == len(names)
    for i, name in enumerate(("side", "down")):
        assert found[f"/inputs/{name}/std"][-1] == pytest.approx(place["/layouts/place/std"][i], rel=0.01)


@pytest.mark.parametrize(
    ("stage", "change", "says"),
    [
        ("place", "place.sensors={gauges: {noise: 1.0}}", "only displacement sensors and accelerometers can be candidates"),
        ("estimate", "place.sensors={}", "sensor is not one of the candidates in place.sensors"),
        ("place", "estimate.disturbance=0.1", ": 0, or remove 'felt' from place.sensors"),
    ],
)
def test_what_cannot_be_a_candidate_is_refused(stage, change, says):
    end = ended(stage, CONFIG, change)
    assert end.code == 2
    assert says in end.text


def test_a_simulation_does_not_wait_for_components_that_a_filter_alone_is_given():
    config = yaml.safe_load(CONFIG)
    config["bearings"] = {}
    config["estimate"] |= {"truth": {"model": "fine"}, "measured": None}
    for layout, waits in ((None, False), ("place", True)):
        config["sensors"]["gauges"]["layout"] = layout
        stages = {stage.name: stage.upstream for stage in bench_stages(config)}
        assert ("place" in stages["simulate"]) == waits
        assert "place" in stages["estimate"]
        assert any(stage.name == "place" for stage in demanded("statics", config)) == waits


FREE = {
    "ratio: 0.01}}": "ratio: 0.01}, moduli: {E: {region: 1, value: 2.1e+11}}}",
    "    side: {std: 1.0e+3, increment: 20.0}\n": "",
    "    down: {std: 1.0e+3, increment: 10.0}\n": "    down: {std: 1.0e+3, increment: 10.0}\n"
    "  parameters: {E: {std: 1.0e+10}}\n",
    "duration: 0.05": "duration: 1.0",
}
"""The side load is known, and tells the modulus from the other one."""


def free(*changes, last="place", **text):
    """stage → Artefact of the beam whose modulus is free, with changes to its text and its keys."""
    return run("field=null", *changes, only=ESTIMATED if last == "estimate" else (*PLACED, last), **FREE, **text)


def test_filter_reaches_the_expected_sigma_of_load_and_modulus():
    """Of a modulus that does not change, σ at the end of the run, which no steady state has."""
    done = free(last="estimate")
    estimate, place = done["estimate"], done["place"]
    assert place["/inputs"].tolist() == ["down", "E"]
    expected = place["/layouts/place/std"]
    assert estimate["/inputs/down/std"][-1] == pytest.approx(expected[0], rel=0.02)
    assert estimate["/parameters/E/std"][-1] == pytest.approx(expected[1], rel=0.05)
    assert expected[1] < 0.5e10


def test_the_response_to_a_modulus_is_that_of_two_equilibria():
    place = free()["place"]
    step, layout = 2.1e8, place["/layouts/place/candidate"]
    gauges = [
        {"position": place["/candidates/position"][at].tolist(), "direction": place["/candidates/direction"][at].tolist()}
        for at in layout
    ]
    less, more = (
        run(
            "field=null", "place=null", "estimate=null", f"sensors={json.dumps({'gauges': PLAIN | {'gauges': gauges}})}",
            f"bodies.beam.moduli.E.value={value}", "simulate.duration=0.01", only=("import", "reduce", "simulate"), **FREE,
        )["simulate"]["/sensors/gauges"][0]
        for value in (2.1e11 - step, 2.1e11 + step)
    )  # fmt: skip
    np.testing.assert_allclose(place["/candidates/response"][layout, 1], (more - less) / (2 * step), rtol=1e-3)


PLAIN = {"type": "strain", "body": "beam"}


def test_a_layout_for_load_and_modulus_is_the_best_of_its_pool():
    place = free()["place"]
    F, H, Q, R, W = (place[f"/augmented/{name}"][0] for name in ("F", "H", "Q", "R", "weight"))
    rows = H / np.sqrt(R)[:, None]
    costs = {
        gauges: W @ np.diag(solve_continuous_are(F.T, rows[list(gauges)].T, Q, np.eye(3)))
        for gauges in combinations(range(len(rows)), 3)
    }
    assert place.summary["trace_final"] == pytest.approx(min(costs.values()), rel=1e-6)
    assert place.summary["trace_initial"] == pytest.approx(2.0, rel=1e-9)
    assert place.summary["lower_bound"] <= min(costs.values()) * (1 + 1e-9)
    assert place.summary["gap"] == pytest.approx(1 - place.summary["lower_bound"] / min(costs.values()), abs=1e-6)


def test_a_run_in_two_poses_that_are_one_is_a_run_in_one():
    """Loads are constant: the covariance is handed from pose to pose as if there were none between."""
    one, two = free()["place"], free("place.poses=[0.0, 0.6]")["place"]
    np.testing.assert_allclose(two["/layouts/random-1/std"][1], one["/layouts/random-1/std"][1], rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ({"layout: place}": "layout: place, zeroed: true}"}, "E causes no strain at any candidate"),
        ({"direction: [0, 1, 0], signal": "direction: [0, 0, 1], signal"}, "together"),
    ],
)
def test_a_modulus_that_no_gauge_can_tell_is_refused(text, says):
    """Gauges zeroed under the load that stays; a known load beside the unknown one, on its line of action."""
    with pytest.raises(StrainsightError, match=says):
        free(**text)

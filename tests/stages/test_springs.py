"""A free beam on soft springs that the config states, and a structure that follows its loads without inertia."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from strainsight.cases.structure.mesh import checked, mesh_of
from strainsight.config.load import load_config
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, DeckError, StrainsightError, UserError
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Modes, Reduced

from ..edges.beam import BENCH_CONFIG, PLACEMENT_CONFIG, RHO, SIZE, TIP, bricks, config_of, finished
from ..shared import strains

MESH = re.sub(r"^SPC[^\n]*\n(,[^\n]*\n)*", "", bricks((8, 1, 1), "hex20"), flags=re.MULTILINE)
K = 2.0e4
ENDS = {"left": {"near": [0, 0.05, 0.04]}, "right": {"near": [1, 0.05, 0.04]}}
CHANGES = {
    "mesh.faces": ENDS,
    "mesh.supports": [{"set": "left", "stiffness": K}, {"node": TIP, "stiffness": [K, 2 * K, K]}],
    "rom.modes": 8,
    "train": {"duration": 0.2, "time_step": 0.001, "settle": "auto"},
    "gauges.exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}],
    "tolerances": "none",
}


def test_the_lowest_modes_are_those_of_a_rigid_bar_on_its_springs_and_gauges_find_a_modulus(tmp_path):
    """√(2k/m) along x is one of the six; the elastic ones lie far above them."""
    run = finished(tmp_path, "place", MESH, CHANGES)
    found = read(Modes, run["modes"]).frequency
    m = RHO * np.prod(SIZE)
    along = np.sqrt(2 * K / m) / (2 * np.pi)
    assert np.min(np.abs(found[:6] / along - 1)) < 1e-4
    assert found[6] / found[5] > 10
    mesh = mesh_from(run["import"])
    assert [own.name for own in mesh.springs] == ["mesh.supports.0", "mesh.supports.1"]
    assert mesh.springs[0].stiffness.sum() == pytest.approx(3 * K)
    assert mesh.springs[1].stiffness.tolist() == [K, 2 * K, K]
    assert len(mesh.fixed) == 0
    assert 0 < run["place"].summary["std.E"] < 0.1


def config(tmp_path: Path, changes) -> PlacementConfig:
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(config_of(config_of(PLACEMENT_CONFIG, CHANGES), changes)))
    model = load_config(path).model
    assert isinstance(model, PlacementConfig)
    return model


@pytest.mark.parametrize(
    ("support", "key"),
    [
        ({"set": "left", "stiffness": 0.0}, "stiffness"),
        ({"set": "left", "stiffness": [1.0, -1.0, 0.0]}, "stiffness"),
        ({"node": TIP, "stiffness": [1.0, 1.0, 1.0], "components": [4]}, "components"),
        ({"node": TIP, "stiffness": 1.0, "components": [1, 4]}, "components"),
        ({"set": "left", "stiffness": 1.0, "components": [4]}, "components"),
    ],
)
def test_supports_that_contradict_themselves_are_named(tmp_path, support, key):
    with pytest.raises(ConfigError) as caught:
        config(tmp_path, {"mesh.supports": [support]})
    assert caught.value.key == f"mesh.supports[0].{key}"


def test_nodes_of_a_set_share_and_rotations_are_those_of_a_node_that_has_some(tmp_path):
    (tmp_path / "beam.bdf").write_text(MESH.replace("ENDDATA", "SET1,9,1,2,3,4\nENDDATA"))

    def mesh(*supports):
        own = config(tmp_path, {"mesh.supports": list(supports)}).mesh
        found = mesh_of(own, tmp_path / "beam.bdf")
        checked(found, own)
        return found

    shared = mesh({"set": "SET1-9", "stiffness": 8.0, "components": [2]}).springs[0]
    assert shared.stiffness.tolist() == [2.0] * 4
    assert set(shared.component.tolist()) == {1}
    turned = mesh({"node": TIP, "stiffness": 8.0, "components": [5]}).springs[0]
    assert turned.torsion.tolist() == [True]
    with pytest.raises(DeckError, match=r"mesh.supports.0 acts on rotations of node 3, which has none"):
        mesh({"node": 3, "stiffness": 8.0, "components": [5]})


def test_a_body_of_a_bench_has_no_springs(tmp_path):
    with pytest.raises(ConfigError, match=r"mesh.supports.0: springs of a body are not supported") as caught:
        finished(tmp_path, "import", MESH, {"bodies.beam.mesh.supports": [{"node": TIP, "stiffness": K}]}, BENCH_CONFIG)
    assert caught.value.key == "bodies.beam.mesh"


FOUNDATION = {
    "mesh.faces": {"root": ENDS["left"]},
    "mesh.supports": [{"set": "root", "stiffness": 5.0e9}],
    "parameters": {
        "s": {"property": "stiffness_factor", "springs": ["mesh.supports.0"], "guess": 1.0, "range": [0.7, 1.5]}
    },
    "loads.tip.signal.frequency": 35.0,
    "rom": {"modes": 6, "parameter_samples": 4},
    "gauges.exclude": CHANGES["gauges.exclude"],
    "place.estimate": ["s"],
    "tolerances": "none",
    "validate.truth": {"model": "modes", "parameters": {"s": 1.2}, "modes": 8},
    "validate.initial_std": {"s": 0.1},
}


def test_a_test_finds_the_stiffness_of_a_foundation(tmp_path):
    """A cantilever whose root turns on springs: the truth has 1.2 of their stiffness, the guess is 1."""
    run = finished(tmp_path, "validate", MESH, FOUNDATION)
    found = run["validate"].summary
    assert 0 < found["std.s"] < 0.05
    assert abs(found["estimate.s"] - 1.2) < 2 * found["std.s"]


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"parameters.s.springs": ["mesh.support.0"]}, "parameters.s.springs", "no spring 'mesh.support.0'"),
        ({"parameters.s.region": 1}, "parameters.s.springs", "region is given too"),
        ({"parameters.s.springs": None}, "parameters.s.region", "missing"),
        ({"parameters.s.property": "density"}, "parameters.s.property", "springs have no density"),
        ({"parameters.s.guess": 30.0, "parameters.s.range": [0.7, 40.0]}, "parameters.s.guess", "has 1 in mesh.supports.0"),
        ({"parameters.t": FOUNDATION["parameters"]["s"]}, "parameters", "s and t are both the stiffness of the spring"),
    ],
)  # fmt: skip
def test_springs_of_a_parameter_are_looked_for_at_import(tmp_path, changes, key, what):
    with pytest.raises(UserError, match=what) as caught:
        finished(tmp_path, "import", MESH, FOUNDATION | changes)
    assert caught.value.key == key
    assert caught.value.remedy


COUNTS = (6, 2, 2)
SLOW, STEP, DURATION, AMPLITUDE, NOISE = 0.2, 0.05, 5.0, 1000.0, 1e-6
STATIC = {
    "filter.compare": False,
    "train": {"model": "static", "duration": DURATION, "time_step": STEP},
    "validate.time_step": STEP,
    "validate.duration": DURATION,
    "loads.tip.signal.frequency": SLOW,
    "gauges.noise_std": {"value": NOISE},
    "tolerances": "none",
}
LOAD = {
    "parameters": {},
    "loads.tip.known": False,
    "place.estimate": ["tip"],
    "validate.truth.parameters": {},
    "validate.initial_std": {"tip": 1.0},
}


def run(folder, until, *changes):
    every = dict(STATIC)
    for own in changes:
        every |= own
    return finished(folder, until, bricks(COUNTS), every)


def per_newton(found) -> np.ndarray:
    """Static strain of every candidate under a newton (m,): the rows on K⁻¹ S."""
    model = read(Reduced, found["rom"]).model
    return (found["train"]["/gauges/row"] @ np.linalg.solve(model.stiffness.at(model.reference), model.input_shape))[:, 0]


def test_readings_follow_the_load_and_lag_by_what_is_stated(tmp_path):
    """1.4 ω/ω_s of the amplitude, ω_s a hundred times the first mode; statics are those of the model with inertia."""
    found = run(tmp_path / "static", "train")
    d, train = per_newton(found), found["train"]
    off = strains(train) - np.outer(train["/input"][:, 0], d)
    lag = 1.4 * SLOW / (100 * found["rom"]["/frequency"][0])
    largest = np.abs(off).max(axis=0) / (AMPLITUDE * np.abs(d))
    np.testing.assert_allclose(largest, lag, rtol=0.01)
    dynamic = run(tmp_path / "dynamic", "train", {"train": {"duration": DURATION, "time_step": STEP}})
    np.testing.assert_allclose(d, per_newton(dynamic), rtol=1e-9, atol=1e-12 * np.abs(d).max())
    assert train["/rms"].max() == pytest.approx(AMPLITUDE * np.abs(d).max() / np.sqrt(2), rel=0.01)


def test_an_unknown_load_has_the_variance_of_a_random_walk_that_is_read(tmp_path):
    """P = 1/(1/(P + qh) + Σ d²/σ²), whose root is closed, q = f a² of a walk with the frequency f and the amplitude a of the
    load; in continuous time √(q σ²h / Σ d²). Beside it is what the load walks while the coordinates lag behind, q times 1.4/ω_s,
    at samples less. The metric counts in that of the pool."""
    found = run(tmp_path, "validate", LOAD)
    d, place = per_newton(found), found["place"]
    sensed = np.sum(d[place["/selected/final/channel"][:, 0]] ** 2)
    q, lag = SLOW * AMPLITUDE**2, 1.4 / (100 * 2 * np.pi * found["rom"]["/frequency"][0])
    of_pool, of_set = (np.sqrt(q * NOISE**2 * STEP / own) for own in (np.sum(d[place["/pool/channel"].ravel()] ** 2), sensed))
    assert place.summary["trace_final"] == pytest.approx((of_set + q * lag) / (of_pool + q * lag), rel=1e-4)
    P = (-q * STEP + np.sqrt((q * STEP) ** 2 + 4 * q * STEP * NOISE**2 / sensed)) / 2
    assert P < found["validate"]["/std/tip"][-1] ** 2 < P + q * lag


def test_it_is_the_limit_of_a_structure_with_inertia_for_slow_loads(tmp_path):
    """Without noise on the model. A walk that is slow against the first mode is known alike, by the same gauges."""
    slow = LOAD | {"loads.tip.process_noise": {"frequency": 1e-5}, "process_noise.model_error": 0.0}
    static = run(tmp_path / "static", "place", slow)["place"]
    short = {"train": {"duration": DURATION, "time_step": 1e-3}}
    dynamic = run(tmp_path / "dynamic", "place", slow, short)["place"]
    np.testing.assert_array_equal(static["/selected/final/channel"], dynamic["/selected/final/channel"])
    assert static.summary["trace_final"] == pytest.approx(dynamic.summary["trace_final"], rel=1e-3)


def test_a_modulus_under_a_known_load_has_the_variance_of_a_regression(tmp_path):
    """ε = d F/E: σ(ln E) = σ/√Σ ε² over all samples, beside a prior of a tenth."""
    found = run(tmp_path, "validate")
    train, channels = found["train"], found["place"]["/selected/final/channel"][:, 0]
    squares = np.sum((strains(train)[1:, channels] * 0.9) ** 2)
    expected = 1 / np.sqrt(squares / NOISE**2 + 1 / 0.1**2)
    own = found["validate"]["/std/E"][-1] / found["validate"]["/estimate/E"][-1]
    assert own == pytest.approx(expected, rel=0.02)


def test_errors_against_a_truth_with_inertia_are_what_is_claimed(tmp_path):
    """Gauges, loads and damping drawn from their tolerances, forty times."""
    changes = LOAD | {"tolerances": {}, "validate.repeats": 40, "place.installation": "ignore"}
    found = run(tmp_path, "validate", changes)["validate"]
    error, std = found["/repeats/error/tip"], found["/repeats/std/tip"]
    ratio = np.sqrt(np.mean((error / std) ** 2))
    assert 0.75 < ratio < 1.25


def test_inertia_that_is_left_out_is_named_and_refused_where_it_is_much(tmp_path):
    for frequency, said in ((1.0, ""), (10.0, "adds up to 2."), (40.0, None)):
        quick = {"loads.tip.signal.frequency": frequency, "train": {"model": "static", "duration": 1.0, "time_step": 1e-3}}
        quick["validate.time_step"] = 1e-3
        folder = tmp_path / str(frequency)
        if said is None:
            with pytest.raises(StrainsightError, match=r"inertia, which train\.model: static leaves out") as caught:
                run(folder, "train", quick)
            assert caught.value.key == "train.model"
        elif said:
            with pytest.warns(UserWarning, match=said):
                run(folder, "train", quick)
        else:
            run(folder, "train", quick)


def test_steps_that_do_not_show_the_swinging_are_named(tmp_path):
    with pytest.warns(UserWarning, match=r"do not show how the structure swings.*train\.model: static"):
        run(tmp_path, "train", {"train": {"duration": DURATION, "time_step": STEP}})


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"motion_sensors": {"a": {"quantity": "acceleration", "noise_std": {"value": 0.01}}}}, "motion_sensors.a.quantity"),
        (
            {
                "parameters": {"E": {"property": "density", "region": 1, "guess": 7e3, "range": [6e3, 9e3]}},
                "validate.truth.parameters": {"E": 7850.0},
            },
            "parameters.E.property",
        ),
    ],
)
def test_what_needs_inertia_is_refused(tmp_path, changes, key):
    with pytest.raises(StrainsightError, match=r"train\.model: static") as caught:
        run(tmp_path, "import", changes)
    assert key in str(caught.value) or caught.value.key == key

"""A free beam on soft springs that the config states, and a structure that follows its loads without inertia."""

from __future__ import annotations

import re

import numpy as np
import pytest

from strainsight.config.mesh import MeshFile
from strainsight.errors import ConfigError, DeckError, StrainsightError
from strainsight.experiment.structure.mesh import checked, mesh_of

from ..edges.beam import BENCH_CONFIG, TIP, bricks, finished, placed, prepared, validated

pytestmark = pytest.mark.usefixtures("no_hot_spots")

MESH = re.sub(r"^SPC[^\n]*\n(,[^\n]*\n)*", "", bricks((4, 1, 1), "hex20"), flags=re.MULTILINE)
K = 2.0e4
ROOT = {"root": {"near": (0, 0.05, 0.04)}}


def test_a_face_or_a_set_shares_the_stiffness_and_rotations_are_those_of_a_node_that_has_some(tmp_path):
    path = tmp_path / "beam.bdf"
    path.write_text(MESH.replace("ENDDATA", "SET1,9,1,2,3,4\nENDDATA"))

    def springs(**support):
        own = MeshFile.model_validate({"file": "beam.bdf", "faces": ROOT, "supports": ({"stiffness": 8.0, **support},)})
        found = mesh_of(own, path)
        checked(found, own)
        return found.springs[0]

    shared = springs(set="SET1-9", components=(2,))
    assert shared.stiffness.tolist() == [2.0] * 4
    assert set(shared.component.tolist()) == {1}
    assert springs(set="root", stiffness=K).stiffness.sum() == pytest.approx(3 * K)
    assert springs(node=TIP, stiffness=(K, 2 * K, K)).stiffness.tolist() == [K, 2 * K, K]
    assert springs(node=TIP, components=(5,)).torsion.tolist() == [True]
    with pytest.raises(DeckError, match=r"mesh.supports.0 acts on rotations of node 3, which has no rotations"):
        springs(node=3, components=(5,))


def test_a_body_of_a_bench_has_no_springs(tmp_path):
    with pytest.raises(ConfigError, match=r"mesh.supports.0: a flexible body cannot have springs"):
        finished(tmp_path, "import", MESH, {"bodies.beam.mesh.supports": [{"node": TIP, "stiffness": K}]}, BENCH_CONFIG)


FOUNDATION = {
    "filter.compare": False,
    "mesh.faces": ROOT,
    "mesh.supports": [{"set": "root", "stiffness": 5.0e9}],
    "parameters": {
        "s": {"property": "stiffness_factor", "springs": ["mesh.supports.0"], "guess": 1.0, "range": [0.7, 1.5]}
    },
    "loads.tip.signal.frequency": 35.0,
    "rom": {"modes": 6, "parameter_samples": 4},
    "gauges.exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}],
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


COUNTS = (4, 1, 1)
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


def trained(folder, changes):
    """The beam in its training simulation, and the static strain of every candidate under a newton (m,): the rows on K⁻¹ S."""
    folder.mkdir(exist_ok=True)
    own = prepared(folder, bricks(COUNTS), STATIC | changes)
    model = own.reduced.model
    response = np.linalg.solve(model.stiffness.at(model.reference), model.input_shape)
    return own, (own.training.rows @ response)[:, 0]


def fast(own):
    """ω_s: a hundred times the first mode, at most 300 over the time step."""
    return min(100 * 2 * np.pi * own.reduced.frequency[0], 300 / STEP)


def channels_of(found):
    return found.problem.channels.of(found.gauges)[:, 0]


def test_readings_follow_the_load_and_lag_by_what_is_stated(tmp_path):
    """1.4 ω/ω_s of the amplitude; statics are those of the model with inertia."""
    own, d = trained(tmp_path / "static", {})
    off = own.training.reading() - np.outer(own.training.load[:, 0], d)
    lag = 1.4 * 2 * np.pi * SLOW / fast(own)
    np.testing.assert_allclose(np.abs(off).max(axis=0) / (AMPLITUDE * np.abs(d)), lag, rtol=0.01)
    _, dynamic = trained(tmp_path / "dynamic", {"train": {"duration": DURATION, "time_step": STEP}})
    np.testing.assert_allclose(d, dynamic, rtol=1e-9, atol=1e-12 * np.abs(d).max())
    assert own.training.rms.max() == pytest.approx(AMPLITUDE * np.abs(d).max() / np.sqrt(2), rel=0.01)


def test_an_unknown_load_has_the_variance_of_a_random_walk_that_is_read(tmp_path):
    """P = 1/(1/(P + qh) + Σ d²/σ²), whose root is closed, q = f a² of a walk with the frequency f and the amplitude a of the
    load; in continuous time √(q σ²h / Σ d²). Beside it is what the load walks while the coordinates lag behind, q times 1.4/ω_s,
    at samples less. The metric counts in that of the pool."""
    own, d = trained(tmp_path, LOAD)
    found = placed(own)
    sensed = np.sum(d[channels_of(found)] ** 2)
    q, lag = SLOW * AMPLITUDE**2, 1.4 / fast(own)
    pool = d[found.task.pool.channels.ravel()]
    of_pool, of_set = (np.sqrt(q * NOISE**2 * STEP / one) for one in (np.sum(pool**2), sensed))
    assert found.layout.cost == pytest.approx((of_set + q * lag) / (of_pool + q * lag), rel=1e-4)
    P = (-q * STEP + np.sqrt((q * STEP) ** 2 + 4 * q * STEP * NOISE**2 / sensed)) / 2
    assert P < validated(own, found.gauges).validated.std["tip"][-1] ** 2 < P + q * lag


def test_a_modulus_under_a_known_load_has_the_variance_of_a_regression(tmp_path):
    """ε = d F/E: σ(ln E) = σ/√Σ ε² over all samples, beside a prior of a tenth."""
    own, _ = trained(tmp_path, {})
    placement = placed(own)
    squares = np.sum((own.training.reading(channels_of(placement))[1:] * 0.9) ** 2)
    expected = 1 / np.sqrt(squares / NOISE**2 + 1 / 0.1**2)
    found = validated(own, placement.gauges).validated
    assert found.std["E"][-1] / found.estimate["E"][-1] == pytest.approx(expected, rel=0.02)


@pytest.mark.slow
def test_errors_against_a_truth_with_inertia_are_what_is_claimed(tmp_path):
    """Gauges, loads and damping drawn from their tolerances, forty times."""
    own, _ = trained(tmp_path, LOAD | {"tolerances": {}, "validate.repeats": 40, "place.installation": "ignore"})
    found = validated(own, placed(own).gauges).validated.repeats
    ratio = np.sqrt(np.mean((found.error["tip"] / found.std["tip"]) ** 2))
    assert 0.75 < ratio < 1.25


def test_inertia_that_is_left_out_is_named_and_refused_where_it_is_much(tmp_path):
    def quick(frequency):
        training = {"model": "static", "duration": 1.0, "time_step": 1e-3}
        return {"loads.tip.signal.frequency": frequency, "train": training, "validate.time_step": 1e-3}

    with pytest.warns(UserWarning, match="changes the strain by up to 2."):
        finished(tmp_path / "10", "train", bricks(COUNTS), STATIC | quick(10.0))
    with pytest.raises(StrainsightError, match=r"inertia, neglected by train\.model: static") as caught:
        finished(tmp_path / "40", "train", bricks(COUNTS), STATIC | quick(40.0))
    assert caught.value.key == "train.model"


def test_steps_that_do_not_show_the_swinging_are_named(tmp_path):
    with pytest.warns(UserWarning, match=r"does not resolve the vibration.*train\.model: static"):
        finished(tmp_path, "train", bricks(COUNTS), STATIC | {"train": {"duration": DURATION, "time_step": STEP}})


SENSOR = {"quantity": "acceleration", "noise_std": {"value": 0.01}}
DENSITY = {"property": "density", "region": 1, "guess": 7e3, "range": [6e3, 9e3]}
MIXED = {"node": TIP, "stiffness": 1.0, "components": [1, 4]}
INERTIA = r"train\.model: static"


@pytest.mark.parametrize(
    ("changes", "key", "what"),
    [
        ({"mesh.supports": [MIXED]}, "mesh.supports[0].components", "one stiffness cannot apply to translations"),
        ({"parameters.s.springs": ["mesh.support.0"]}, "parameters.s.springs", "no spring 'mesh.support.0'"),
        ({"parameters.s.region": 1}, "parameters.s.springs", "`springs` and `region` are both set"),
        (
            {"parameters.s.guess": 30.0, "parameters.s.range": [0.7, 40.0]},
            "parameters.s.guess",
            "is 30, but .* 1 in mesh.supports.0",
        ),
        ({"parameters.t": FOUNDATION["parameters"]["s"]}, "parameters", "s and t both define the stiffness of spring"),
        (STATIC | {"motion_sensors": {"a": SENSOR}}, "motion_sensors.a.quantity", INERTIA),
        (STATIC | {"parameters.s": DENSITY, "validate.truth.parameters.s": 7850.0}, "parameters.s.property", INERTIA),
    ],
)
def test_what_springs_and_static_models_cannot_be_is_refused_at_import(tmp_path, changes, key, what):
    with pytest.raises(StrainsightError, match=what) as caught:
        finished(tmp_path, "import", MESH, FOUNDATION | changes)
    assert caught.value.key == key
    assert caught.value.remedy

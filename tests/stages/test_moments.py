"""An unknown moment in a placement, and a free structure through the whole pipeline."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml

from strainsight import api
from strainsight.config.load import load_config
from strainsight.errors import ConfigError, UserError
from strainsight.runner.artefact import Artefact

from ..edges.beam import (
    BENCH_CONFIG,
    PLACEMENT_CONFIG,
    SIZE,
    TIP,
    E,
    bricks,
    config_of,
    finished,
    placed,
    prepared,
    validated,
)
from .tested_beam import estimated

pytestmark = pytest.mark.usefixtures("no_hot_spots")

MOMENT, FORCE = 500.0, 200.0


def sine(amplitude, frequency):
    return {"type": "sine", "frequency": frequency, "amplitude": amplitude}


def load(**keys):
    return {"node": TIP, "known": False, "process_noise": {"model": "integrated_random_walk"}} | keys


LOADS = {
    "bend": load(moment=[0, 3, 0], signal=sine(MOMENT, 1.0)),
    "push": load(direction=[0, 1, 0], signal=sine(FORCE, 2.0)),
}
CHANGES = {
    "filter.compare": False,
    "loads": LOADS,
    "parameters": {},
    "train": {"duration": 1.0, "time_step": 0.01},
    "gauges.direction.angles": [0.0],
    "gauges.clearance": "none",
    "gauges.exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}],
    "gauges.noise_std": {"value": 1e-7},
    "tolerances": "none",
    "screen": {"keep": "all"},
    "place": {"estimate": ["bend", "push"], "keep": 3},
    "validate.truth": {"model": "rom", "parameters": {}, "modes": 12},
    "validate.time_step": 0.01,
    "validate.duration": 1.0,
    "validate.initial_std": {"bend": 1.0, "push": 1.0},
}
SMALL = bricks((4, 1, 1))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("moment"), "validate", SMALL, CHANGES)


def test_a_tip_moment_strains_a_cantilever_by_mc_over_ei(tmp_path):
    """ε = M z/(EI) of a moment about y; at 1 Hz of 65 the inertia adds 2e-4, half way from clamp and end these do nothing."""
    training = prepared(tmp_path, bricks((8, 2, 2), "hex20"), CHANGES).training
    x, _, z = (training.candidates.position - [0, SIZE[1] / 2, SIZE[2] / 2]).T
    inertia = SIZE[1] * SIZE[2] ** 3 / 12
    at = training.load[:, np.argmax(training.load.max(axis=0))]
    middle = (np.abs(x - 0.5) < 0.1) & (np.abs(z) > 0.49 * SIZE[2])
    assert middle.sum() >= 4
    # the force along y strains in proportion to y, its part at 2 Hz is orthogonal to the moment's at 1 Hz
    found = training.reading(np.flatnonzero(middle))[:-1].T @ at[:-1] / (at[:-1] @ at[:-1])
    np.testing.assert_allclose(found, z[middle] / (E * inertia), rtol=1e-3)
    assert set(np.sign(z[middle])) == {-1.0, 1.0}


def test_the_moment_is_found_again_in_newton_metres_and_sigma_is_what_placement_expected(run):
    summary = run["validate"].summary
    assert summary["estimate.bend"] == pytest.approx(MOMENT / np.sqrt(2), rel=0.01)
    assert summary["error.bend"] < 0.01
    assert summary["smoothed.bend"] < 0.005
    claimed = summary["std.bend"] * summary["scale.bend"]
    assert run["place"]["/expected_std/bend"][()] == pytest.approx(claimed, rel=0.1)
    # relative to the RMS of the moment in training, √½ of its amplitude
    assert run["place"].attributes("/expected_std/bend")["scale"] == pytest.approx(MOMENT / np.sqrt(2), rel=0.1)
    assert run["train"].attributes("/input")["units"] == "N or N m"
    for key in ("truth", "estimate", "std", "smoothed"):
        assert run["validate"].attributes(f"/{key}/bend")["units"] == "N m"
        assert run["validate"].attributes(f"/{key}/push")["units"] == "N"


@pytest.mark.slow
def test_a_known_moment_is_read_in_newton_metres(tmp_path):
    known = CHANGES | {"loads.bend.known": True, "place.estimate": ["push"], "validate.initial_std": {"push": 1.0}}
    record = finished(tmp_path, "validate", SMALL, known)["validate"].path.parent / "measured.csv"
    assert record.read_text(encoding="utf-8").splitlines()[0].endswith("bend [N m]")
    known["estimate"] = {
        "as_placed": True,
        "time": {"channel": "time"},
        "channels": [{"channel": name, "gauge": name, "unit": "m/m"} for name in ("G1", "G2", "G3")],
        "inputs": {"bend": {"channel": "bend", "unit": "N m"}},
    }
    (tmp_path / "edge.yaml").write_text(yaml.safe_dump(config_of(PLACEMENT_CONFIG, known)), encoding="utf-8")
    code, said = estimated(tmp_path, record, config="edge.yaml")
    assert code == 0, said
    found = Artefact(tmp_path / "results" / "edge" / "estimate.h5")
    assert found.attributes("/known/bend")["units"] == "N m"
    assert found.attributes("/std/push")["units"] == "N"
    assert np.abs(found["/known/bend"]).max() == pytest.approx(MOMENT, rel=1e-3)


DECK = re.sub(r"^SPC[^\n]*\n(,[^\n]*\n)*", "", bricks((6, 1, 1), "hex20"), flags=re.MULTILINE)
FREE = {
    "filter.compare": False,
    "mesh.free": True,
    "rom.modes": 6,
    "loads.tip.known": False,
    "loads.tip.process_noise": {"frequency": 30.0},
    "loads.push": {"node": TIP, "direction": [1.0, 0.0, 0.0], "known": True, "signal": sine(2000.0, 25.0)},
    "train": {"duration": 0.2, "time_step": 0.001, "settle": "auto"},
    "place.estimate": ["E", "tip"],
    "place.keep": 3,
    "validate.duration": 0.2,
    "validate.initial_std": {"E": 0.1, "tip": 1.0},
    "gauges.exclude": [
        {"normal_cone": {"axis": [1, 0, 0], "angle": 10}},
        {"box": [[-0.1, -0.1, -0.1], [0.13, 0.2, 0.2]]},  # no gauge there beside springs
    ],
    "gauges.noise_std": {"value": 2e-7},
    "gauges.fixed": [
        {"position": [x, 0.05, z], "direction": [1, 0, 0]} for x, z in ((0.81, 0), (0.81, 0.08), (0.69, 0.08))
    ],
    "process_noise": {"model_error": 0.0},
    "tolerances": "none",
}
SOFT = {
    "mesh.free": False,
    "mesh.faces": {"end": {"near": [0.0, 0.05, 0.04]}},
    "mesh.supports": [{"set": "end", "stiffness": 50.0}],
    "rom.modes": 12,
    "validate.truth.modes": 12,
}


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    return prepared(tmp_path_factory.mktemp("free"), DECK, FREE)


@pytest.fixture(scope="module")
def layout(free):
    return placed(free)


def test_readings_are_those_on_springs_that_nothing_notices(free, tmp_path):
    """Springs of 0.14 Hz under loads of 20 and 25 Hz carry (0.14/20)² = 5e-5 of them; softer ones lose more digits than that."""
    soft = prepared(tmp_path, DECK, {**FREE, **SOFT})
    frequency, held = (api.modes(own.case, own.mesh).frequency for own in (free, soft))
    assert np.all(held[:6] < 0.5)
    assert np.allclose(frequency, held[6:], rtol=1e-5)
    one, other = free.training.reading(), soft.training.reading()
    assert np.abs(one - other).max() < 2e-4 * np.abs(other).max()


def test_modulus_and_unknown_load_of_a_free_structure_are_found(free, layout):
    found = validated(free, layout.gauges).accuracy["E"]
    assert found.error < 0.02
    assert found.error < 3 * found.std


READY = {"numbering": "n.csv", "stiffness": [{"file": "k.mtx", "parameter": "E"}], "mass": [{"file": "k.mtx"}]}
SENSORS = {"mid": {"quantity": "acceleration", "noise_std": {"value": 1e-3}}}
BEND = {**FREE, "loads.bend": LOADS["bend"]}


@pytest.mark.parametrize(
    ("changes", "key", "says"),
    [
        ({"loads.bend.direction": [0, 0, 1]}, "loads.bend.direction", "remove `direction`, or remove `moment`"),
        ({"loads.bend.deck_load": "FORCE-1", "loads.bend.node": None}, "loads.bend.moment", "remove `moment` or `deck_load`"),
        ({"motion_sensors": SENSORS}, "motion_sensors.mid", "measure the rigid-body motion, but the model of a free structure"),
        ({"mesh.matrices": READY, "parameters.E.region": None}, "mesh.free", "a free structure needs matrices assembled"),
    ],
)
def test_what_disagrees_with_a_moment_or_a_free_structure_is_refused(tmp_path, changes, key, says):
    path = tmp_path / "edge.yaml"
    path.write_text(yaml.safe_dump(config_of(config_of(PLACEMENT_CONFIG, BEND), changes)), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert [str(error) for error in (caught.value, *caught.value.others) if error.key == key and says in str(error)]


def test_the_body_of_a_bench_is_free_in_any_case(tmp_path):
    with pytest.raises(ConfigError, match="a body without supports is always free"):
        finished(tmp_path, "import", DECK, {"bodies.beam.mesh.free": True}, BENCH_CONFIG)


WEIGHT = {"gravity": [0, 0, -9.81], "known": True, "signal": sine(1.0, 20.0)}
DENSITY = {"property": "density", "region": 1, "guess": 7850.0, "range": [7000.0, 8500.0]}


@pytest.mark.parametrize(
    ("deck", "key", "value", "says"),
    [
        (DECK, "loads.weight", WEIGHT, r"only rigid-body acceleration of the free structure .* and no strain"),
        (
            DECK.replace("ENDDATA", f"CONM2,77,{TIP},,5.0\nENDDATA"),
            "parameters.rho",
            DENSITY,
            "the density of only a part of a free structure is estimated",
        ),
    ],
)
def test_a_weight_strains_nothing_and_a_density_of_a_part_is_refused(tmp_path, deck, key, value, says):
    with pytest.raises(UserError, match=says) as caught:
        finished(tmp_path, "rom", deck, {**FREE, key: value})
    assert caught.value.key == key


@pytest.mark.slow
def test_the_truth_in_time_of_the_whole_model_agrees(free, layout, tmp_path):
    """All degrees of freedom integrated, which shares no mode with the truth by modes."""
    whole = prepared(tmp_path, DECK, {**FREE, "validate.truth": {"model": "full", "parameters": {"E": E}, "modes": 6}})
    one, other = (validated(own, layout.gauges).validated.gauge.true for own in (free, whole))
    assert np.abs(one - other).max() < 2e-4 * np.abs(other).max()

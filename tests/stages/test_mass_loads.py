"""Weight and a rotation as loads of a placement, and loads of a deck as they are: their shapes, units and limits."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from strainsight.config.load import load_config
from strainsight.errors import ConfigError, UserError
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training

from ..edges.beam import PLACEMENT_CONFIG, RHO, SIZE, E, bricks, config_of, finished

SLOW = {"type": "sine", "frequency": 1.0}
LOADS = {
    "shake": {"gravity": [0, 0, -2], "known": False, "signal": SLOW | {"amplitude": 9.81}},
    "spin": {"rotation": {"axis": [0, 0, 1]}, "known": True, "signal": SLOW | {"amplitude": 4.0e4}},
    "deck": {"deck_load": "LOAD-9", "factor": True, "known": True, "signal": SLOW | {"amplitude": 1.0}},
}
CHANGES = {
    "loads": LOADS,
    "parameters": {},
    "train": {"duration": 1.0, "time_step": 0.01},
    "gauges.direction.angles": [0.0],
    "gauges.clearance": "none",
    "gauges.exclude": [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}],
    "gauges.noise_std": {"value": 1e-8},
    "tolerances": {"load_angle": 1.0},
    "screen": {"keep": 8, "minimum_spacing": 0.02},
    "place": {"estimate": ["shake"], "keep": 2, "instants": 2},
    "validate.truth": {"model": "rich", "parameters": {}},
    "validate.initial_std": {"shake": 1.0},
}
CARDS = "GRAV,5,,9.81,0.,0.,-1.\nRFORCE,6,,,10.,0.,0.,1.\nLOAD,9,1.,1.,5,1.,6\nENDDATA"
MESH = bricks((8, 1, 1), "hex20", tip=False).replace("ENDDATA", CARDS)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("mass"), "place", MESH, CHANGES)


def by_load(model):
    """Input shapes of shake, spin and deck."""
    return model.input_shape[:, [model.inputs.index(name) for name in LOADS]]


def test_the_load_of_the_deck_is_the_sum_of_its_weight_and_its_rotation(run):
    shape = by_load(read(Reduced, run["rom"]).model)
    np.testing.assert_allclose(shape[:, 2], 9.81 * shape[:, 0] + (20 * np.pi) ** 2 * shape[:, 1], atol=1e-9 * np.abs(shape).max())


def test_strain_under_weight_is_that_of_a_beam(run):
    """ε = M z/(EI), M = ρgA (L − x)²/2, on top, away from the root, as of a beam; ε = ρΩ²(L² − x²)/(2E)."""
    training, reduced = read(Training, run["train"]), read(Reduced, run["rom"])
    grids = training.candidates.grids
    strain = training.rows @ np.linalg.solve(reduced.model.stiffness.at({}), by_load(reduced.model))
    x, _, z = grids.position.T
    L, b, h = SIZE
    own = np.isclose(z, h) & (x > 0.3 * L) & (x < 0.9 * L) & (np.abs(grids.direction[:, 0]) > 0.99)
    assert own.sum() > 3
    bending = RHO * b * h * (L - x) ** 2 / 2 * (h / 2) / (E * b * h**3 / 12)
    centrifugal = RHO * (L**2 - x**2) / (2 * E)
    np.testing.assert_allclose(strain[own, 0], bending[own], atol=0.005 * bending[own].max())
    np.testing.assert_allclose(strain[own, 1], centrifugal[own], rtol=0.01)


def test_its_estimate_is_an_acceleration(run):
    assert run["place"].attributes("/expected_std/shake")["scale"] == pytest.approx(9.81)
    assert run["train"].attributes("/input")["units"] == "1 or m/s² or rad²/s²"


def test_a_load_of_mass_beside_a_density_that_is_a_parameter_is_refused(tmp_path):
    rho = {"rho": {"property": "density", "region": 1, "guess": RHO, "range": [7000.0, 9000.0]}}
    for loads in ({"shake": LOADS["shake"] | {"known": True}}, {"deck": LOADS["deck"]}):
        with pytest.raises(UserError, match="would change with the density rho") as caught:
            finished(tmp_path, "import", MESH, CHANGES | {"loads": loads, "parameters": rho, "place.estimate": ["rho"],
                     "validate.truth": {"model": "rich", "parameters": {"rho": RHO}}, "validate.initial_std": {"rho": 0.1}})
        assert caught.value.key == f"loads.{next(iter(loads))}"


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"loads.shake.node": 3}, "loads.shake.node"),
        ({"loads.shake.direction": [0, 0, 1]}, "loads.shake.direction"),
        ({"loads.shake.rotation": {"axis": [1, 0, 0]}}, "loads.shake.rotation"),
        ({"loads.shake.gravity": [0, 0, 0]}, "loads.shake.gravity"),
        ({"loads.spin.rotation": {"axis": [0, 0, 0]}}, "loads.spin.rotation.axis"),
        ({"loads.deck.deck_load": None, "loads.deck.node": 3, "loads.deck.direction": [1, 0, 0]}, "loads.deck.factor"),
    ],
)
def test_keys_that_contradict_each_other_are_named(tmp_path, change, key):
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(config_of(config_of(PLACEMENT_CONFIG, CHANGES), change)))
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert caught.value.key == key

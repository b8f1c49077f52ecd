"""Faces of the config hold, load and carry gauges; weight and rotation as loads of a placement."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.sparse.linalg import spsolve

from strainsight.config.load import load_config
from strainsight.config.loads import LoadSection
from strainsight.errors import ConfigError, UserError
from strainsight.experiment.structure.references import load_shapes, load_slopes, point_loads
from strainsight.fem.affine import Parameter
from strainsight.fem.loads import input_shape
from strainsight.fem.model import build_model
from strainsight.mesh.joins import PointMass
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.rom.model import Damping
from strainsight.rom.reduction import reduce_model

from ..edges.beam import PLACEMENT_CONFIG, RHO, bricks, config_of, finished
from ..rom.test_reduction import beam
from ..shared import strains

pytestmark = pytest.mark.usefixtures("no_hot_spots")

FACES = {"root": {"near": [0, 0.05, 0.04]}, "end": {"normal": [1, 0, 0]}, "top": {"near": [0.5, 0.05, 0.08]}}
LOAD = {"known": True, "direction": [0, 0, 1], "signal": {"type": "sine", "frequency": 20.0, "amplitude": 1000.0}}


def unheld() -> str:
    """The beam without its SPC1 card."""
    text = bricks((8, 2, 2), "hex20", tip=False).replace("SPC = 1\n", "")
    return re.sub(r"^SPC1.*\n(,.*\n)*", "", text, flags=re.MULTILINE)


def changes(faces: bool) -> dict:
    own = {"loads": {"tip": {**LOAD, "set": "end"}}, "mesh.faces": FACES if faces else {"end": FACES["end"]}}
    own |= {"screen.keep": "all", "screen.minimum_spacing": 0.0, "gauges.clearance": "none"}
    own["gauges.exclude"] = [{"normal_cone": {"axis": [1, 0, 0], "angle": 10}}]
    return own | ({"mesh.supports": [{"set": "root"}], "gauges.surface": "top"} if faces else {})


def test_a_face_holds_loads_and_carries_gauges(tmp_path):
    of_deck = finished(tmp_path / "deck", "train", bricks((8, 2, 2), "hex20", tip=False), changes(False))
    of_faces = finished(tmp_path / "faces", "train", unheld(), changes(True))
    np.testing.assert_array_equal(of_faces["import"]["/constraints/fixed"], of_deck["import"]["/constraints/fixed"])
    np.testing.assert_array_equal(of_faces["modes"]["/frequency"], of_deck["modes"]["/frequency"])
    on_top = of_deck["train"]["/gauges/position"][:, 2] > 0.08 - 1e-9
    np.testing.assert_array_equal(strains(of_faces["train"]), strains(of_deck["train"])[:, on_top])


@pytest.mark.slow
def test_an_unknown_pressure_is_placed_for_in_pascal_and_a_known_pin_with_it(tmp_path):
    own = changes(True) | {
        "mesh.faces": FACES | {"below": {"near": [0.5, 0.05, 0.0]}},
        "loads": {
            "press": {"known": False, "set": "below", "pressure": True, "signal": LOAD["signal"] | {"amplitude": 2e5}},
            "pin": {"known": True, "set": "end", "bearing": [-1, 0, 0], "signal": LOAD["signal"]},
        },
        "parameters": {},
        "place": {"estimate": ["press"], "keep": 2, "instants": 1, "certificate": False},
        "rom.modes": 3,
        "tolerances": "none",
        "validate": {"truth": {"model": "modes"}, "time_step": 0.001, "duration": 0.1, "repeats": 1, "random_sets": 0},
    }
    own["validate"] |= {"noise_factors": [], "initial_std": {"press": 1.0}}
    found = finished(tmp_path, "validate", unheld(), own)
    own = found["validate"]
    assert own.attributes("/estimate/press")["units"] == "Pa"
    truth, mean, std = (own[f"/{name}/press"].ravel() for name in ("truth", "smoothed", "smoothed_std"))
    assert np.abs(truth).max() == pytest.approx(2e5, rel=0.05)
    assert np.all(np.abs(mean - truth)[10:] < 4 * std[10:])


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
    "place": {"estimate": ["shake"], "keep": 2, "instants": 1, "certificate": False},
    "validate.truth": {"model": "perturbed", "parameters": {}},
    "validate.initial_std": {"shake": 1.0},
}
CARDS = "GRAV,5,,9.81,0.,0.,-1.\nRFORCE,6,,,10.,0.,0.,1.\nLOAD,9,1.,1.,5,1.,6\nENDDATA"
MESH = bricks((8, 1, 1), "hex20", tip=False).replace("ENDDATA", CARDS)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("mass"), "train", MESH, CHANGES)


def by_load(model):
    """Input shapes of shake, spin and deck."""
    return model.input_shape[:, [model.inputs.index(name) for name in LOADS]]


def test_the_load_of_the_deck_is_the_sum_of_its_weight_and_its_rotation(run):
    shape = by_load(read(Reduced, run["rom"]).model)
    np.testing.assert_allclose(shape[:, 2], 9.81 * shape[:, 0] + (20 * np.pi) ** 2 * shape[:, 1], atol=1e-9 * np.abs(shape).max())


def test_the_weight_of_two_densities_is_reduced_as_the_whole_model_has_it_at_any_of_them():
    """Displacement under weight and rotation against a model assembled anew; its slopes against differences of that."""
    densities = (Parameter("heavy", "density", (1,), 7850.0), Parameter("light", "density", (2,), 2700.0))
    loads = {
        "weight": LoadSection(gravity=(0, 0.5, -1), known=True, signal=SLOW | {"amplitude": 9.81}),
        "spin": LoadSection(
            rotation={"axis": (0, 0, 1), "point": (-0.1, 0, 0)}, known=True, signal=SLOW | {"amplitude": 100.0}
        ),
    }
    tip = int(np.argmax(beam().position[:, 0]))

    def whole(theta):
        materials = (2.1e11, 0.3, theta["heavy"]), (7.0e10, 0.33, theta["light"])
        mesh = replace(beam(materials=materials), point_masses=(PointMass(1, tip, 3.0),))
        model = build_model(mesh)
        return spsolve(model.stiffness.constant.tocsc(), input_shape(model, tuple(point_loads(loads).values())))

    reference = {own.name: own.reference for own in densities}
    mesh = replace(beam(), point_masses=(PointMass(1, tip, 3.0),))
    full = build_model(mesh, densities)
    ranges = {"heavy": (6000.0, 9000.0), "light": (2000.0, 4000.0)}
    slopes = load_slopes(full, loads, densities)
    found = reduce_model(full, load_shapes(full, loads), tuple(loads), reference, ranges, 3, 3, 1e-9, Damping(), slopes=slopes)
    K, at = found.model.stiffness.at(reference), {"heavy": 6700.0, "light": 3500.0}
    np.testing.assert_allclose(
        found.basis @ np.linalg.solve(K, found.model.input_shape_at(at)), whole(at), atol=1e-9 * np.abs(whole(at)).max()
    )
    for name in at:
        near = [whole(at | {name: at[name] + d}) for d in (50.0, -50.0)]
        slope = (near[0] - near[1]) / 100.0
        own = found.basis @ np.linalg.solve(K, found.model.input_slope[name])
        np.testing.assert_allclose(own, slope, atol=1e-7 * np.abs(slope).max())


UNKNOWN = {"rho": {"property": "density", "region": 1, "guess": RHO, "range": [6000.0, 10000.0]}}
WEIGHT = {"weight": {"gravity": [0, 0, -1], "known": True, "signal": SLOW | {"amplitude": 9.81}}}
TRUE = 1.06 * RHO


def of_density(loads):
    """Changes of a run that looks for the density of the whole beam."""
    return CHANGES | {
        "loads": loads,
        "parameters": UNKNOWN,
        "place.estimate": ["rho"],
        "tolerances": "none",
        "train": {"duration": 1.0, "time_step": 0.01, "settle": "auto"},
        "validate.truth": {"model": "modes", "modes": 8, "parameters": {"rho": TRUE}},
        "validate.initial_std": {"rho": 0.1},
        "validate.time_step": 0.01,
        "validate.duration": 1.0,
        "validate.random_sets": 0,
        "validate.noise_factors": [],
        "validate.repeats": 8,
    }


def test_a_load_of_the_deck_on_mass_with_a_density_that_is_a_parameter_is_refused(tmp_path):
    with pytest.raises(UserError, match=r"would change with the parameter rho \(density\)") as caught:
        finished(tmp_path, "import", MESH, of_density({"deck": LOADS["deck"]}))
    assert caught.value.key == "loads.deck"


@pytest.fixture(scope="module")
def weighed(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("weighed"), "validate", MESH, of_density(WEIGHT))


@pytest.mark.slow
def test_a_density_is_found_by_the_strain_under_its_own_weight(weighed):
    """At 1 Hz the strain is ρ times what it is for ρ = 1, whatever the mass does otherwise: with noise r of each of the samples
    1/σ² = 1/σ₀² + Σ ε²/r², relative to ρ. The motion adds (f/f₁)² of it, f₁ 66 Hz."""
    own = weighed["validate"]
    strain, std = own["/gauge/true"][1:], 1e-8
    prior, repeats = 0.1, own["/repeats/std/rho"]
    expected = 1 / np.sqrt(1 / prior**2 + np.sum(strain**2) / std**2)
    assert np.abs(strain).max() > 1e-6
    np.testing.assert_allclose(repeats, expected, rtol=0.002)
    off = own["/repeats/error/rho"] / repeats
    assert len(off) == 8
    assert np.abs(off).max() < 3
    assert 0.3 < np.sqrt(np.mean(off**2)) < 1.7


def on_end(**load):
    """The load of the deck on a face; without its direction, or with another one."""
    return {"loads.tip": {"known": True, "signal": SLOW | {"amplitude": 1.0}} | load, "mesh.faces": FACES}


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (on_end(node=1, pressure=True), "loads.tip.pressure"),
        (on_end(set="end", pressure=True, bearing=[0, 0, 1]), "loads.tip.pressure"),
        (on_end(set="end", pressure=True, direction=[0, 0, 1]), "loads.tip.direction"),
        ({"loads.shake.node": 3}, "loads.shake.node"),
        ({"loads.shake.gravity": [0, 0, 0]}, "loads.shake.gravity"),
        ({"loads.spin.rotation": {"axis": [0, 0, 0]}}, "loads.spin.rotation.axis"),
        ({"loads.deck.deck_load": None, "loads.deck.node": 3, "loads.deck.direction": [1, 0, 0]}, "loads.deck.factor"),
    ],
)
def test_keys_of_a_load_that_disagree_with_each_other_are_named(tmp_path, change, key):
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(config_of(config_of(PLACEMENT_CONFIG, CHANGES), change)))
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert caught.value.key == key

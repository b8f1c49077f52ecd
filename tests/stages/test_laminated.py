"""Plies, orthotropic materials and sections of the config: against beam theory, isotropic constants and the deck."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.config.load import load_config
from strainsight.config.mesh import MeshFile
from strainsight.decks.reader import read_mesh
from strainsight.errors import StrainsightError
from strainsight.experiment.structure.mesh import mesh_of, with_additions
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes

from ..anisotropy import CONSTANTS, TURN, flexibility, strains, turned, work
from ..edges.beam import finished
from ..shared import ROOT
from ..strips import RHO, E, L, T, gmsh, grid

pytestmark = pytest.mark.usefixtures("no_hot_spots")

def push(frequency, amplitude, **where):
    signal = {"type": "sine", "frequency": frequency, "amplitude": amplitude}
    return where | {"direction": [0, 0, 1], "known": True, "signal": signal}


POINTS, QUADS, _ = grid(10, 2)
DECK = "\n".join(
    [
        "BEGIN BULK",
        *(f"GRID,{i},,{x:.6f},{y:.6f},0." for i, (x, y, _) in enumerate((0.3 * POINTS).tolist(), 1)),
        *(f"CQUAD4,{e},1,{','.join(map(str, nodes + 1))}" for e, nodes in enumerate(QUADS, 100)),
        "PCOMP,1,,,,,,,SYM",
        ",8,.0005,0.,,8,.0005,90.,",
        ",8,.0005,30.",
        "MAT8,8,1.4+11,1.+10,.3,5.+9,4.+9,3.+9,1600.",
        "SPC1,1,123456,1,2,3",
        "ENDDATA\n",
    ]
)
E1 = {"property": "e1", "region": 1, "material": 8, "guess": 1.4e11, "range": [1.1e11, 1.8e11]}
STRIP = {
    "parameters": {"e1": E1},
    "loads.tip": push(15.0, 5.0, node=32),
    "rom": {"modes": 3, "parameter_samples": 2},
    "gauges.direction": {"type": "axis", "axis": [1, 0, 0]},
    "gauges.clearance": "none",
    "gauges.grid_length": 0.003,
    "tolerances": {"load_angle": 0, "load_position": 0, "frequency": 0, "damping": 1},
    "screen": {"keep": 6},
    "place": {"estimate": ["e1"], "keep": 2, "instants": 1, "minimum_spacing": 0.02, "certificate": False},
    "validate.truth": {"model": "modes", "parameters": {"e1": 1.54e11}, "modes": 8},
    "validate.initial_std": {"e1": 0.1},
}


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_modulus_along_the_fibres_is_found(tmp_path, seed):
    """10 % off the guess and within 3 σ, which is less than half of what was known before."""
    summary = finished(tmp_path, "validate", DECK, STRIP | {"seed": seed})["validate"].summary
    assert summary["std.e1"] < 0.05
    assert abs(summary["error.e1"]) < 3 * summary["std.e1"]


OTHER = {"regions": "all", "youngs_modulus": 1e9, "poisson_ratio": 0.3, "density": 1.0}


@pytest.mark.parametrize(
    ("changes", "what", "key"),
    [
        ({"parameters.e1.material": "carbon"}, "no orthotropic material 'carbon'", "parameters.e1.material"),
        (
            {"parameters.e1.guess": 1.4e5, "parameters.e1.range": [1e5, 2e5]},
            r"is 1\.4e\+05, but .* deck is 1\.4e\+11 in region 1",
            "parameters.e1.guess",
        ),
        (
            {"parameters.e1": E1 | {"property": "density", "guess": 1600.0, "range": [1500.0, 1700.0]}},
            "ply material",
            "parameters.e1.material",
        ),
        (
            {"parameters.e1": E1 | {"property": "youngs_modulus", "material": None}},
            "isotropic plies: youngs_modulus is undefined",
            "parameters.e1.property",
        ),
        ({"mesh.materials": {"m": OTHER}}, "the plies have separate materials", "mesh.materials.m.regions"),
    ],
)
def test_what_has_no_laminate_is_refused(tmp_path, changes, what, key):
    with pytest.raises(StrainsightError, match=what) as caught:
        finished(tmp_path, "import", DECK, STRIP | changes | {"validate.truth.parameters": {}})
    assert caught.value.key == key
    assert caught.value.remedy


ORTHOTROPIC_CONFIG = (ROOT / "configs" / "cantilever-youngs-modulus.yaml").read_text(encoding="utf-8")
COARSE = ROOT / "meshes" / "cantilever-coarse.bdf"
FACTOR = "property: stiffness_factor, region: 1, guess: 0.9, range: [0.8, 1.2]"
ALIKE = (
    "youngs_modulus: [2.1e+11, 2.1e+11, 2.1e+11], poisson_ratio: [0.3, 0.3, 0.3], "
    f"shear_modulus: [{', '.join([str(2.1e11 / 2.6)] * 3)}], "
    "axes: {x: [1, 2, 0], y: [0, 1, 3], origin: [0, -5, 2], system: cylindrical}"
)


def mesh_config(folder, constants):
    materials = f"{{own: {{regions: all, {constants}, density: 7850.0}}}}"
    text = ORTHOTROPIC_CONFIG.replace("file: ../meshes/cantilever.bdf,", f"file: {COARSE}, materials: {materials},")
    text = text.replace("property: youngs_modulus, region: 1, guess: 1.89e+11, range: [1.6e+11, 2.4e+11]", FACTOR)
    path = folder / "own.yaml"
    path.write_text(text.replace("{E: 2.1e+11}", "{E: 1.0}"), encoding="utf-8")
    return load_config(path).model.mesh


def test_axes_of_a_config_are_those_of_the_tensor(tmp_path):
    """Work of every strain by S of its stress, per volume, at a rotated rectangular system."""
    (e, nu, g), (x, y) = CONSTANTS, (TURN[:, 0], TURN[:, 1] + 0.4 * TURN[:, 0])
    axes = f"axes: {{x: {x.tolist()}, y: {y.tolist()}}}"
    constants = f"youngs_modulus: {list(e)}, poisson_ratio: {list(nu)}, shear_modulus: {list(g)}, {axes}"
    mesh = with_additions(read_mesh(COARSE), mesh_config(tmp_path, constants))
    K, S = assemble_stiffness(mesh), turned(flexibility(*CONSTANTS), TURN)
    for stress in 1e9 * np.array(strains()):
        z = (mesh.position @ np.einsum("ijkl,kl->ij", S, stress)).ravel()
        assert 0.5 * z @ (K @ z) == pytest.approx(2 * 0.25 * 0.19 * work(S, stress), rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("[0.3, 0.3, 0.3]", "0.3", "three orthotropic values in youngs_modulus and shear_modulus, but not in poisson_ratio"),
        ("[0.3, 0.3, 0.3]", "[0.3, 0.3, 1.2]", r"-0\.335.* NU12 0\.3, NU13 0\.3, NU23 1\.2"),
        ("x: [1, 2, 0]", "x: [0, 2, 6]", "is parallel to the x axis"),
        ("[2.1e+11, 2.1e+11, 2.1e+11], poisson_ratio: [0.3, 0.3, 0.3], shear", "2.1e+11, poisson_ratio: 0.3, x", "x_modulus"),
    ],
)
def test_a_inconsistency_is_named(tmp_path, old, new, what):
    assert old in ALIKE
    with pytest.raises(StrainsightError, match=what):
        with_additions(read_mesh(COARSE), mesh_config(tmp_path, ALIKE.replace(old, new)))


BEAM = {"regions": ["spar"], "area": 1e-4, "torsion": 1e-9, "direction": [0.0, 0.0, 1.0]}
MATERIAL = {"regions": "all", "youngs_modulus": E, "poisson_ratio": 0.0, "density": RHO}


def test_the_first_second_moment_resists_bending_towards_the_direction(tmp_path):
    """f_z of ∫y² dA and f_y of ∫z² dA, y of the beam along z, with cos βL cosh βL = −1; and a tip force bends it by F L³/3 E I in
    each."""
    (tmp_path / "strip.msh").write_text(gmsh())
    stated = {
        "file": "strip.msh",
        "sections": {"spar": {**BEAM, "second_moments": [8e-10, 6e-10]}},
        "materials": {"steel": MATERIAL},
        "supports": [{"node": 1, "components": [1, 2, 3, 4, 5, 6]}],
    }
    model = build_model(mesh_of(MeshFile.model_validate_json(json.dumps(stated)), tmp_path / "strip.msh"))
    beta = np.array([[1.8751040687], [4.6940911330]])
    expected = beta**2 / (2 * np.pi * L**2) * np.sqrt(E * np.array([6e-10, 8e-10]) / (RHO * 1e-4))
    found, _ = modes(model.stiffness.constant, model.mass.constant, 4)
    np.testing.assert_allclose(found, expected.ravel(), rtol=1e-4)
    tip = model.mesh.node_index(25)
    for axis, moment in ((2, 8e-10), (1, 6e-10)):
        f = input_shape(model, [PointLoad("tip", tuple(np.eye(3)[axis]), 25)])
        w = nodal(model, spsolve(model.stiffness.constant.tocsc(), f)[:, None]).reshape(-1, 3)[tip, axis]
        assert w == pytest.approx(L**3 / (3 * E * moment), rel=1e-9)


STAGES = {
    "mesh.sections": {"skin": {"regions": "all", "thickness": T}},
    "mesh.supports": [{"set": "root", "components": [1, 2, 3, 4, 5, 6]}],
    "mesh.materials": {"steel": MATERIAL},
    "loads.tip": push(4.0, 10.0, set="1d-5"),
    "gauges.clearance": "none",
    "screen": {"keep": "all", "minimum_spacing": 0.0},
    "place.certificate": False,
}


def test_a_layout_sits_on_the_faces_of_shells_of_gmsh(tmp_path):
    """Along the strip, which a tip force bends as a beam, and not at 45° to it, where it strains half as much."""
    (tmp_path / "strip.msh").write_text(gmsh())
    own = {"mesh.file": "strip.msh", "parameters.E.region": "skin"}
    found = finished(tmp_path, "place", "", STAGES | own)
    position = found["train"]["/gauges/position"]
    np.testing.assert_allclose(np.abs(position[:, 2]), T / 2, rtol=1e-12)
    assert {-1.0, 1.0} == set(np.sign(position[:, 2]))
    along = found["place"]["/selected/final/direction"]
    assert len(along) == 2
    np.testing.assert_allclose(np.abs(along[:, 0]), 1.0, rtol=1e-12)


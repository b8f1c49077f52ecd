"""Sections of the config make shells and beams of a file without any: against beam theory, and from import to a layout."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.cases.structure.mesh import checked, mesh_of
from strainsight.config.mesh import MeshFile
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes

from ..edges.beam import finished
from ..strips import RHO, B, E, L, T, gmsh, vtu

SECOND, THIRD = 1.8751040687, 4.6940911330
"""βL of a cantilever: cos βL cosh βL = −1."""
PLATE = {"skin": {"regions": ["skin"], "thickness": T}}
BEAM = {"regions": ["spar"], "area": 1e-4, "torsion": 1e-9, "direction": [0.0, 0.0, 1.0]}
MATERIAL = {"regions": "all", "youngs_modulus": E, "poisson_ratio": 0.0, "density": RHO}


@pytest.fixture
def built(tmp_path):
    """Mesh and model of the gmsh strip, clamped at its root, with these sections."""

    def of(sections, unit=1.0, root="root", components=(1, 2, 3, 4, 5, 6), **size):
        path = tmp_path / "strip.msh"
        path.write_text(gmsh(unit, **size))
        support = {"set": root} if isinstance(root, str) else {"node": root}
        own = {"materials": {"steel": MATERIAL}, "supports": [{**support, "components": list(components)}]}
        stated = {"file": "strip.msh", "length_unit": {1.0: "m", 1e-3: "mm"}[unit], "sections": sections, **own}
        config = MeshFile.model_validate_json(json.dumps(stated))
        mesh = mesh_of(config, path)
        weight, _ = checked(mesh, config)
        return weight, build_model(mesh)

    return of


def frequencies(model, count):
    return modes(model.stiffness.constant, model.mass.constant, count)[0]


def cantilever(beta, EI, mass):
    """[Hz], of a length L with mass [kg/m]."""
    return beta**2 / (2 * np.pi * L**2) * np.sqrt(EI / mass)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_a_strip_of_gmsh_quadrangles_vibrates_as_a_beam(built, unit):
    (mass, centre), model = built(PLATE, unit, along=20)
    assert mass == pytest.approx(RHO * L * B * T, rel=1e-9)
    np.testing.assert_allclose(centre, [L / 2, B / 2, 0], atol=1e-12)
    expected = cantilever(SECOND, E * B * T**3 / 12, RHO * B * T)
    assert frequencies(model, 1)[0] == pytest.approx(expected, rel=5e-4)


def test_the_first_second_moment_resists_bending_towards_the_direction(built):
    """f_z of ∫y² dA and f_y of ∫z² dA, y of the beam along z; and a tip force bends it by F L³/3 E I in each."""
    _, model = built({"spar": {**BEAM, "second_moments": [8e-10, 6e-10]}}, root=1)
    expected = [cantilever(beta, E * I, RHO * 1e-4) for beta in (SECOND, THIRD) for I in (6e-10, 8e-10)]
    np.testing.assert_allclose(frequencies(model, 4), expected, rtol=1e-4)
    tip = model.mesh.node_index(25)
    for axis, moment in ((2, 8e-10), (1, 6e-10)):
        f = input_shape(model, [PointLoad("tip", tuple(np.eye(3)[axis]), 25)])
        w = nodal(model, spsolve(model.stiffness.constant.tocsc(), f)[:, None]).reshape(-1, 3)[tip, axis]
        assert w == pytest.approx(L**3 / (3 * E * moment), rel=1e-9)


def test_rods_and_a_skin_are_as_heavy_as_their_sections_say(built):
    rods = {"regions": ["spar"], "area": 2e-4}
    (mass, _), model = built({**PLATE, "stringer": rods})
    assert [block.kind for block in model.mesh.thin] == ["quad4", "rod"]
    assert mass == pytest.approx(RHO * (L * B * T + L * 2e-4), rel=1e-9)


STAGES = {
    "mesh.sections": {"skin": {"regions": "all", "thickness": T}},
    "mesh.supports": [{"set": "root", "components": [1, 2, 3, 4, 5, 6]}],
    "mesh.materials": {"steel": MATERIAL},
    "loads.tip": {
        "direction": [0, 0, 1],
        "known": True,
        "signal": {"type": "sine", "frequency": 4.0, "amplitude": 10.0},
    },
    "gauges.clearance": "none",
    "screen": {"keep": "all", "minimum_spacing": 0.0},
}


def test_a_layout_sits_on_the_faces_of_shells_of_gmsh(tmp_path):
    """Along the strip, which a tip force bends as a beam, and not at 45° to it, where it strains half as much."""
    (tmp_path / "strip.msh").write_text(gmsh())
    own = {"mesh.file": "strip.msh", "parameters.E.region": "skin", "loads.tip.set": "1d-5"}
    found = finished(tmp_path, "place", "", STAGES | own)
    position = found["train"]["/gauges/position"]
    np.testing.assert_allclose(np.abs(position[:, 2]), T / 2, rtol=1e-12)
    assert {-1.0, 1.0} == set(np.sign(position[:, 2]))
    chosen = found["place"]["/selected/final/position"]
    assert len(chosen) == 2
    np.testing.assert_allclose(np.abs(chosen[:, 2]), T / 2, rtol=1e-12)
    along = found["place"]["/selected/final/direction"]
    np.testing.assert_allclose(np.abs(along[:, 0]), 1.0, rtol=1e-12)


def test_an_import_holds_the_shells_of_a_grid(tmp_path):
    vtu(tmp_path / "strip.vtu")
    own = {"mesh.file": "strip.vtu", "parameters.E.region": 7, "loads.tip.set": "tip"}
    found = finished(tmp_path, "import", "", STAGES | own)["import"]
    assert (len(found["/shells/quad4/id"]), len(found["/shells/tri3/id"])) == (8, 16)
    np.testing.assert_array_equal(found["/sections/shells/thickness"], [T])
    # what a file for ParaView shows is the deck
    assert len(found["/VTKHDF/Points"]) == len(found["/nodes/id"]) - len(found["/arms"])

"""Sanity checks speak of the mesh and of the config's keys, whatever format the file is of."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError, UserError
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model
from strainsight.mesh.additions import node_index, with_material, with_node, with_rigid_element
from strainsight.mesh.joins import AveragingElement, PointMass, Relation, RigidElement
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.sanity import empty_regions, sanity_warnings, unused_nodes
from strainsight.mesh.units import to_si

GMSH = """\
$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
1
3 9 "casting"
$EndPhysicalNames
$Nodes
4
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
$EndNodes
$Elements
1
10 4 2 9 1 1 2 3 4
$EndElements
"""
CARDS = re.compile(r"RBE|SPC|MAT1|RHO|CONM|PSOLID|GRID|CORD|\bUM\b|\bCD\b|\*[A-Z]{3}|Nastran|Abaqus")


def tetrahedron(length: float = 1.0, E: float = 2.1e11, rho: float = 7850.0) -> Mesh:
    """Held by three of its nodes, in the numbers of a file."""
    return Mesh(
        node_ids=np.arange(1, 5),
        position=length * np.vstack([np.zeros(3), np.eye(3)]),
        blocks=(CellBlock("tet4", np.array([10]), np.arange(4)[None], np.array([1])),),
        regions={1: Region(1, "solid", 1)},
        materials={1: Material(1, E, 0.3, rho)},
        fixed=np.array([(node, c) for node in range(3) for c in range(3)]),
    )


def test_a_structure_of_steel_has_no_warnings():
    assert sanity_warnings(tetrahedron()) == ()


@pytest.mark.parametrize(
    ("length", "E", "rho", "units", "says"),
    [
        (
            1000.0,
            2.1e5,
            7.85e-9,
            ("m", "kg"),
            "length_unit mm and mesh.mass_unit t it is 2.1e+11 Pa and 7850 kg/m³",
        ),
        (1.0, 2.1e5, 7850.0, ("m", "kg"), "Young's modulus is 2.1e+05 Pa"),
        (1.0, 2.1e5, 7850.0, ("m", "kg"), "2.1e+05 looks like MPa"),
        (1000.0, 2.1e8, 7.85e-6, ("m", "kg"), "length_unit mm and mesh.mass_unit kg it is 2.1e+11 Pa"),
        (1.0, 2.1e11, 7850.0, ("mm", "t"), "length_unit m and mesh.mass_unit kg it is 2.1e+11 Pa"),
        (1000.0, 2.1e5, 7.85e-9, ("mm", "kg"), "density is 7.85 kg/m³, outside 10 to 100000"),
        (1.0, 3.0e7, 15.0, ("m", "kg"), None),
        (1.0, 2.1e9, 78500.0, ("m", "kg"), None),
        (1.0, 1e7, 99000.0, ("m", "kg"), None),
        (1.0, 3.0e7, 0.283, ("m", "kg"), "3e+07 looks like psi and 0.283 like lb/in³ (steel)"),
        (1.0, 2e6, 90000.0, ("m", "kg"), "speed of sound √(E/ρ) is 4.71 m/s"),
        (1000.0, 2.1e11, 7850.0, ("m", "kg"), "extent is 1e+03 m"),
        (1.0, 2.1e11, 0.0, ("m", "kg"), "material 1 has no density"),
    ],
)
def test_values_that_speak_of_a_wrong_unit_are_a_warning(length, E, rho, units, says):
    found = " / ".join(sanity_warnings(to_si(tetrahedron(length, E, rho), *units), *units))
    assert (says in found) if says else not found


def test_what_is_not_used_and_what_may_be_missing_are_warnings():
    mesh = tetrahedron()
    mesh = replace(
        mesh,
        node_ids=np.append(mesh.node_ids, 9),
        position=np.vstack([mesh.position, np.zeros(3)]),
        regions=mesh.regions | {2: Region(2, "lid", 1)},
        ignored={"shells": 3, "output": 1, "colours": 1},
        effect={"shells": "structure", "output": "none"},
    )
    assert list(mesh.node_ids[unused_nodes(mesh)]) == [9]
    assert empty_regions(mesh) == (2,)
    assert sanity_warnings(mesh) == (
        "3 × shells ignored: the stiffness, mass or tie it may add is missing",
        "1 node belongs to nothing and is left out of the model: 9",
        "region 2 (lid) has no elements",
    )


@pytest.mark.parametrize(("nu", "says"), [(0.4999999, "0.4999999: elements of displ"), (-0.5, "-0.5: it widens")])
def test_a_ratio_that_locks_and_one_of_a_wrong_shear_modulus_are_named(nu, says):
    (said,) = sanity_warnings(with_material(tetrahedron(), None, 2.1e11, nu, 7850.0, "steel"))
    assert said.startswith(f"steel: Poisson's ratio is {says}")
    for sound in (0.0, 0.33, 0.49):
        assert sanity_warnings(with_material(tetrahedron(), None, 2.1e11, sound, 7850.0, "steel")) == ()


def test_a_structure_without_supports_is_a_warning():
    said = "nothing is fixed: hold it, let it be free (mesh.free), or hang it on soft springs (mesh.supports, stiffness)"
    for fixed in (np.zeros((0, 2), dtype=np.int64), np.array([[0, 3], [1, 5]])):
        assert sanity_warnings(replace(tetrahedron(), fixed=fixed)) == (said,)
        assert sanity_warnings(replace(tetrahedron(), fixed=fixed), free=True) == ()
    one, two = (Relation(1, np.arange(n), np.zeros(n, int), np.ones(n)) for n in (1, 2))
    assert sanity_warnings(replace(tetrahedron(), fixed=fixed, relations=(one,))) == ()
    assert sanity_warnings(replace(tetrahedron(), fixed=fixed, relations=(two,))) == (said,)


def test_a_material_of_the_config_is_named_by_its_key():
    (found,) = sanity_warnings(with_material(tetrahedron(), None, 2.1e5, 0.3, 7850.0, "mesh.materials.steel"))
    assert found.startswith("mesh.materials.steel: Young's modulus is 2.1e+05 Pa")
    assert "values of the config are in Pa" in found


def test_a_reference_node_given_in_millimetres_is_a_warning():
    near, far = (with_node(tetrahedron(), 900, (x, 0, 0)) for x in (1.5, 50.0))
    near, far = (
        with_rigid_element(mesh, node_index(mesh, 900), np.array([1]), (0, 1, 2), "mesh.ties.0") for mesh in (near, far)
    )
    assert sanity_warnings(near, "mm", "t") == ()
    assert any("node 900 of mesh.ties.0 lies 49 m from its nodes" in text for text in sanity_warnings(far, "mm", "t"))


@pytest.fixture
def casting(tmp_path):
    """One tetrahedron of a gmsh file, which has no cards."""
    path = tmp_path / "part.msh"
    path.write_text(GMSH)
    return read_mesh(path)


def checked(mesh: Mesh) -> None:
    mass_properties(mesh)
    build_model(mesh)


def held(mesh: Mesh) -> Mesh:
    return replace(mesh, fixed=np.array([(node, c) for node in range(3) for c in range(3)]))


def far_mass(mesh: Mesh) -> Mesh:
    return replace(with_node(held(mesh), 90, (2, 0, 0)), point_masses=(PointMass(1, 4, 1.0),))


def tied_twice(mesh: Mesh) -> Mesh:
    mesh = with_node(with_node(mesh, 90, (2, 0, 0)), 91, (0, 2, 0))
    return replace(mesh, rigid=tuple(RigidElement(i, 3 + i, np.array([3]), (0,)) for i in (1, 2)))


def on_one_node(mesh: Mesh) -> Mesh:
    mesh = with_node(mesh, 90, (2, 0, 0))
    return replace(mesh, averaging=(AveragingElement(7, 4, np.array([1]), np.ones(1), (3,)),))


@pytest.mark.parametrize(
    ("density", "altered", "what", "remedy"),
    [
        (0.0, lambda mesh: mesh, "total mass is 0 kg: the density of region 9 (casting) is zero", "mesh.materials"),
        (None, lambda mesh: mesh, "region 9 (casting) has no material", "mesh.materials"),
        (1.0, lambda mesh: mesh, "the structure can move freely", "mesh.supports"),
        (1.0, far_mass, "point mass 1 sits on node 90, which no element holds", "mesh.ties"),
        (1.0, tied_twice, "node 4 is dependent in rigid element 1 and in rigid element 2", "one of them"),
        (1.0, on_one_node, "averaging element 7", ""),
    ],
)
def test_errors_of_a_mesh_without_cards_name_its_entities_and_the_keys_of_the_config(
    casting, density, altered, what, remedy
):
    mesh = altered(casting if density is None else with_material(casting, None, 2.1e11, 0.3, density))
    with pytest.raises((DeckError, UserError)) as caught:
        checked(mesh)
    assert what in caught.value.what
    assert remedy in (caught.value.remedy or "")
    assert not CARDS.search(f"{caught.value.what} {caught.value.remedy}")

"""Sanity checks of a mesh, of its units and of what the config adds; a mesh of another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.decks.nastran.deck import read_nastran
from strainsight.mesh.additions import (
    node_indices,
    region_ids,
    with_averaging_element,
    with_material,
    with_node,
    with_rigid_element,
    with_support,
)
from strainsight.mesh.joins import PointMass, Relation
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.sanity import empty_regions, sanity_warnings, unused_nodes
from strainsight.mesh.units import LENGTH, USUAL_UNITS, mixed_units, scaled, to_si


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
            "length_unit mm and mesh.mass_unit t the material would have 2.1e+11 Pa and 7850 kg/m³",
        ),
        (1.0, 2.1e5, 7850.0, ("m", "kg"), "Young's modulus is 2.1e+05 Pa"),
        (1.0, 2.1e5, 7850.0, ("m", "kg"), "2.1e+05 appears to be in MPa"),
        (1.0, 2.1e11, 7850.0, ("mm", "t"), "length_unit m and mesh.mass_unit kg the material would have 2.1e+11 Pa"),
        (1000.0, 2.1e5, 7.85e-9, ("mm", "kg"), "density is 7.85 kg/m³, outside the usual range 10 to 100000"),
        (1.0, 3.0e7, 15.0, ("m", "kg"), None),
        (1.0, 2.1e9, 78500.0, ("m", "kg"), None),
        (1.0, 3.0e7, 0.283, ("m", "kg"), "3e+07 appears to be in psi and the density 0.283 in lb/in³ (steel)"),
        (1.0, 2e6, 90000.0, ("m", "kg"), "speed of sound √(E/ρ) is 4.71 m/s"),
        (1000.0, 2.1e11, 7850.0, ("m", "kg"), "dimension of the structure is 1e+03 m"),
        (1.0, 2.1e11, 0.0, ("m", "kg"), "material 1 has no density"),
    ],
)
def test_values_in_wrong_unit_give_a_warning(length, E, rho, units, says):
    found = " / ".join(sanity_warnings(to_si(tetrahedron(length, E, rho), *units), *units))
    assert (says in found) if says else not found


def test_unused_nodes_and_ignored_cards_give_warnings():
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
        "3 × shells ignored: the model lacks the stiffness, mass or tie defined by the ignored card",
        "1 node has no connection, and is omitted from the model: 9",
        "region 2 (lid) has no elements",
    )


@pytest.mark.parametrize(("nu", "says"), [(0.4999999, "0.4999999. Elements lock"), (-0.5, "-0.5: the material expands")])
def test_locking_or_negative_poisson_ratio_gives_a_warning(nu, says):
    (said,) = sanity_warnings(with_material(tetrahedron(), None, 2.1e11, nu, 7850.0, "steel"))
    assert said.startswith(f"steel: Poisson's ratio is {says}")
    for sound in (0.0, 0.33, 0.49):
        assert sanity_warnings(with_material(tetrahedron(), None, 2.1e11, sound, 7850.0, "steel")) == ()


def test_a_structure_without_supports_is_a_warning():
    said = "the structure has no supports. Add supports, set mesh.free: true, or use soft springs (mesh.supports, stiffness)."
    for fixed in (np.zeros((0, 2), dtype=np.int64), np.array([[0, 3], [1, 5]])):
        assert sanity_warnings(replace(tetrahedron(), fixed=fixed)) == (said,)
        assert sanity_warnings(replace(tetrahedron(), fixed=fixed), free=True) == ()
    one, two = (Relation(1, np.arange(n), np.zeros(n, int), np.ones(n)) for n in (1, 2))
    assert sanity_warnings(replace(tetrahedron(), fixed=fixed, relations=(one,))) == ()
    assert sanity_warnings(replace(tetrahedron(), fixed=fixed, relations=(two,))) == (said,)


def test_a_reference_node_given_in_millimetres_is_a_warning():
    near, far = (with_node(tetrahedron(), 900, (x, 0, 0)) for x in (1.5, 50.0))
    near, far = (
        with_rigid_element(mesh, mesh.node_index(900), np.array([1]), (0, 1, 2), "mesh.ties.0") for mesh in (near, far)
    )
    assert sanity_warnings(near, "mm", "t") == ()
    said = "node 900 of mesh.ties.0 is 49 m away from the other nodes of this tie"
    assert any(said in text for text in sanity_warnings(far, "mm", "t"))


# Moduli and densities in units that do not belong together are warned of, with the unit; real materials never are.
MM_KG, MM_T, IN_LB, CM_KG = ("mm", "kg"), ("mm", "t"), ("in", "lb"), ("cm", "kg")
MIXED = {  # name: (E and ρ as the deck has them, its units, what the warning names)
    "steel in kg, mm and N": (2.1e5, 7.85e-6, MM_KG, "be in MPa (steel, 2.1e+11 Pa). In mm, kg and s the value is 2.1e+08"),
    "kg, mm, ms and kN": (210.0, 7.85e-6, MM_KG, "210 appears to be in GPa with time in ms (steel"),
    "g, mm, ms and N": (2.1e5, 7.85e-3, ("mm", "g"), "2.1e+05 appears to be in MPa with time in ms"),
    "g in place of t": (2.1e5, 7.85e-3, MM_T, "0.00785 appears to be in g/mm³ (steel). In mm, t and s the value is 7.85e-09"),
    "t, mm and kN": (210.0, 7.85e-9, MM_T, "210 appears to be in GPa"),
    "pounds without 386": (3e7, 0.283, IN_LB, "Or set mesh.mass_unit to lbf*s2/in, and the density in the deck to 0.000733"),
    "weight in lbf": (3e7, 0.283, ("in", "lbf*s2/in"), "be in lb/in³ (steel). In in, lbf*s2/in and s the value is 0.000733"),
    "ksi": (3e4, 7.33e-4, ("in", "lbf*s2/in"), "In in, lbf*s2/in and s the value is 3e+07"),
    "kg, cm and N": (2.1e7, 7.85e-3, CM_KG, "in N/cm² (steel, 2.1e+11 Pa). In cm, kg and s the value is 2.1e+09"),
    "MPa in metres": (2.1e5, 7850.0, ("m", "kg"), "2.1e+05 appears to be in MPa"),
    "psi and slugs": (3e7, 15.2, ("ft", "slug"), "In ft, slug and s the value is 4.32e+09"),
    "kgf": (2.1e4, 7.85e-6, MM_KG, "2.1e+04 appears to be in kgf/mm²"),
    "pounds a cubic foot": (2.07e11, 490.0, ("m", "kg"), "490 appears to be in lb/ft³ (steel). In m, kg and s the value is 7849"),
}
REAL = {  # Pa, kg/m³
    "natural rubber": (2e6, 930), "filled rubber": (1e7, 1300), "soft foam": (2e5, 30), "rigid foam": (5e7, 60),
    "cork": (2e7, 160), "wood": (1.1e10, 450), "wood across": (5e8, 450), "balsa": (3e9, 150), "honeycomb": (1e9, 50),
    "soil": (5e7, 1900),
    "gravel": (1e8, 2250), "resin filled with sand": (1e10, 2100), "concrete": (3e10, 2400), "light concrete": (1.5e10, 1800),
    "warm asphalt": (3e8, 2400), "granite": (5e10, 2700), "glass": (7e10, 2500), "ice": (9e9, 917), "bone": (1.5e10, 1900),
    "PTFE": (5e8, 2200), "ABS": (2.3e9, 1050), "CFRP": (7e10, 1600), "ply": (1.4e11, 1580), "GFRP": (2e10, 1900),
    "nylon filled with tungsten": (5e9, 11000), "rubber filled with lead": (1e7, 4000), "lead": (1.6e10, 11340),
    "solder": (3e10, 8400), "tin": (5e10, 7290), "zinc": (8.5e10, 7100), "magnesium": (4.5e10, 1780), "beryllium": (3e11, 1850),
    "steel": (2.1e11, 7850), "cast iron": (1.1e11, 7200), "aluminium": (7e10, 2700), "titanium": (1.1e11, 4430),
    "copper": (1.2e11, 8940), "gold": (7.9e10, 19300), "uranium": (2e11, 19000), "tungsten": (4.1e11, 19300),
    "zirconia": (2e11, 6000), "alumina": (3.7e11, 3900), "diamond": (1.1e12, 3500), "aluminium foam": (5e9, 500),
    "steel with smeared masses": (2.1e11, 12000), "steel that weighs little": (2.1e11, 1000),
}  # fmt: skip


@pytest.mark.parametrize(("E", "rho", "units", "words"), MIXED.values(), ids=MIXED)
def test_inconsistent_units_are_reported_with_consistent_value(E, rho, units, words):
    found = " / ".join(sanity_warnings(to_si(tetrahedron(1.0, E, rho), *units), *units))
    assert words in found


def test_suggested_value_gives_no_warning():
    for E, rho, units in ((2.1e8, 7.85e-6, MM_KG), (2.1e5, 7.85e-9, MM_T), (1.158e10, 0.283, IN_LB), (2.1e9, 7.85e-3, CM_KG)):
        size = 0.3 / LENGTH[units[0]]
        assert sanity_warnings(to_si(tetrahedron(size, E, rho), *units), *units) == ()


def test_real_materials_give_no_warning_in_consistent_units():
    for units in (*USUAL_UNITS, ("mm", "g"), ("cm", "g"), ("in", "lb"), ("ft", "lb")):
        for name, (E, rho) in REAL.items():
            assert mixed_units(E, rho, *units) == "", (name, units)
            assert sanity_warnings(tetrahedron(1.0, E, rho)) == (), name


def test_plies_in_kg_mm_n_give_a_warning():
    E, rho = 1.35e8, 1600.0
    assert "1.35e+05 appears to be in MPa (a ply of carbon fibre" in mixed_units(E, rho, *MM_KG, ply=True)
    assert mixed_units(E, rho, *MM_KG) == ""


def test_masses_grow_with_the_cube_and_inertias_with_the_fifth_power_of_the_size():
    own = PointMass(1, 3, 2.0, np.array([0.1, -0.3, 0.2]), np.diag([0.1, 0.2, 0.25]))
    mesh = replace(tetrahedron(), point_masses=(own,))
    half = scaled(mesh, 0.5)
    np.testing.assert_allclose(half.position, mesh.position / 2)
    np.testing.assert_allclose(half.point_masses[0].offset, own.offset / 2)
    assert half.point_masses[0].mass == own.mass / 8
    np.testing.assert_allclose(half.point_masses[0].inertia, own.inertia / 32)
    assert half.materials == mesh.materials
    assert scaled(mesh, 1.0) is mesh


# What the config adds to a mesh is added, and nothing else changes.
DECK = """\
GRID,11,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,33,,0.,1.,0.
GRID,4,,0.,0.,1.
GRID,5,,1.,1.,1.
CTETRA,10,1,11,2,33,4
CTETRA,20,7,2,33,4,5
PSOLID,1,1
PSOLID,7,1
MAT1,1,2.1+11,,.3,7850.
SPC1,1,123,11
SET1,3,33,4
"""


@pytest.fixture
def mesh(tmp_path):
    (tmp_path / "a.bdf").write_text(DECK)
    return read_nastran(tmp_path / "a.bdf")


def test_a_material_goes_to_the_regions_named_by_id_or_name(mesh):
    changed = with_material(mesh, [7], 7e10, 0.33, 2700.0)
    assert changed.materials[changed.regions[7].material].youngs_modulus == 7e10
    assert changed.regions[1] == mesh.regions[1]
    assert region_ids(changed, ["PSOLID 7", 1]) == (7, 1)


def test_material_for_all_regions_replaces_those_of_the_file(mesh):
    changed = with_material(mesh, None, 7e10, 0.33, 2700.0)
    assert [m.density for m in changed.materials.values()] == [2700.0]
    assert {r.material for r in changed.regions.values()} == set(changed.materials)


def test_supports_add_to_those_of_the_file_each_once(mesh):
    changed = with_support(mesh, node_indices(mesh, "SET1-3"), (0, 2))
    again = with_support(changed, node_indices(mesh, "SET1-3"), (2,))
    expected = {(0, 0), (0, 1), (0, 2), (2, 0), (2, 2), (3, 0), (3, 2)}
    assert {tuple(pair) for pair in changed.fixed.tolist()} == expected
    np.testing.assert_array_equal(changed.fixed, again.fixed)


def test_tie_excludes_its_reference_from_the_set(mesh):
    changed = with_node(mesh, 900, (0.5, 0.5, 2.0))
    reference = changed.node_index(900)
    assert changed.position[reference].tolist() == [0.5, 0.5, 2.0]
    tied = with_rigid_element(changed, reference, node_indices(changed, "SET1-3"), (0, 1, 2))
    tied = with_averaging_element(tied, tied.node_index(4), np.array([2, 3, 4]), range(6))
    assert tied.node_ids[tied.rigid[0].nodes].tolist() == [33, 4]
    assert tied.node_ids[tied.averaging[0].nodes].tolist() == [33, 5]
    assert (tied.rigid[0].id, tied.averaging[0].id) == (1, 2)

"""Decks in any units are the same structure in SI."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from strainsight.decks.reader import format_of, read_mesh
from strainsight.errors import DeckError, UserError
from strainsight.mesh.additions import node_index, with_material, with_node, with_rigid_element
from strainsight.mesh.suspicions import empty_regions, only_control, suspicions, unused_nodes
from strainsight.mesh.units import LENGTH, MASS, length_factor, mass_factor


def deck(path, length, E, rho, mass):
    path.write_text(
        f"GRID,1\nGRID,2,,{length}\nGRID,3,,,{length}\nGRID,4,,,,{length}\nCTETRA,10,1,1,2,3,4\nPSOLID,1,1\n"
        f"MAT1,1,{E},,.3,{rho}\nSPC1,1,123,1,2,3\nCONM2,90,4,,{mass}\n"
    )
    return path


@pytest.mark.parametrize(
    ("length_unit", "mass_unit", "length", "E", "rho", "mass"),
    [
        ("m", "kg", "1.", "2.1e11", "7850.", "3."),
        ("mm", "t", "1000.", "2.1e5", "7.85e-9", "3.e-3"),
        ("mm", "kg", "1000.", "2.1e8", "7.85e-6", "3."),
        ("cm", "g", "100.", "2.1e12", "7.85", "3000."),
        ("in", "lbf*s2/in", "39.37007874015748", "30457924.9", "7.345374e-4", "0.01713044"),
        ("ft", "slug", "3.280839895013123", "4385941183.", "15.2315", "0.2055653"),
    ],
)
def test_one_structure_in_six_systems_of_units(tmp_path, length_unit, mass_unit, length, E, rho, mass):
    mesh = read_mesh(deck(tmp_path / "a.bdf", length, E, rho, mass), length_unit, mass_unit)
    material = mesh.materials[1]
    np.testing.assert_allclose(mesh.position[1:], np.eye(3), rtol=1e-14)
    assert material.youngs_modulus == pytest.approx(2.1e11, rel=1e-6)
    assert material.density == pytest.approx(7850, rel=1e-5)
    assert material.poisson_ratio == 0.3
    assert mesh.point_masses[0].mass == pytest.approx(3.0, rel=1e-6)
    assert suspicions(mesh) == ()


def test_pound_units_follow_from_the_international_pound_and_standard_gravity():
    pound_force = 0.45359237 * 9.80665
    assert MASS["slug"] == pytest.approx(pound_force / 0.3048, rel=1e-15)
    assert MASS["lbf*s2/in"] == pytest.approx(pound_force / 0.0254, rel=1e-15)
    assert LENGTH["ft"] == pytest.approx(12 * LENGTH["in"])


@pytest.mark.parametrize(
    ("function", "unit", "key", "hint"),
    [
        (length_factor, "mmm", "mesh.length_unit", "did you mean 'mm'"),
        (length_factor, "MM", "mesh.length_unit", "did you mean 'mm'"),
        (length_factor, "parsec", "mesh.length_unit", "known units: m, "),
        (mass_factor, "kgs", "mesh.mass_unit", "did you mean 'kg'"),
        (mass_factor, "tons", "mesh.mass_unit", "did you mean 'tonne'"),
    ],
)
def test_an_unknown_unit_is_answered_with_the_known_ones(function, unit, key, hint):
    with pytest.raises(UserError, match="unknown unit") as caught:
        function(unit)
    assert caught.value.key == key
    assert hint in caught.value.remedy


def test_a_wrong_unit_is_found_before_the_file_is_read(tmp_path):
    with pytest.raises(UserError, match="unknown unit 'furlong'"):
        read_mesh(tmp_path / "none.bdf", "furlong", "kg")


@pytest.mark.parametrize(
    ("name", "text", "format"),
    [
        ("a.bdf", "GRID,1\n", "nastran"),
        ("a.BDF.gz", "", "nastran"),
        ("a.inp", "*NODE\n", "abaqus"),
        ("a.msh", "$MeshFormat\n2.2 0 8\n", "gmsh"),
        ("a.msh", '(0 "Fluent")\n', "meshio"),
        ("a.vtu", "<VTKFile>", "meshio"),
        ("hub.v2.dat", "GRID,1\n", "nastran"),
        ("nothing", "", "meshio"),
    ],
)
def test_the_ending_chooses_the_reader(tmp_path, name, text, format):
    (tmp_path / name).write_text(text)
    assert format_of(tmp_path / name) == format


def test_a_stated_format_counts_more_than_the_ending(tmp_path):
    path = deck(tmp_path / "a.txt", "1.", "2.1e11", "7850.", "0.")
    assert len(read_mesh(path, format="nastran").node_ids) == 4


SHELLS = {
    "a.bdf": "GRID,1\nGRID,2,,1.\nGRID,3,,1.,1.\nGRID,4,,,1.\nCQUAD4,7,1,1,2,3,4\n",
    "a.inp": "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n*ELEMENT,TYPE=S4\n7,1,2,3,4\n",
    "a.msh": "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
    "$Elements\n1\n7 3 2 1 1 1 2 3 4\n$EndElements\n",
    "a.vtk": "# vtk DataFile Version 3.0\nshell\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n"
    "0 0 0\n1 0 0\n1 1 0\n0 1 0\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n9\n",
}


@pytest.mark.parametrize("name", SHELLS)
def test_a_deck_of_shells_is_read_where_no_solids_are_asked_for(tmp_path, name):
    (tmp_path / name).write_text(SHELLS[name])
    with pytest.raises(DeckError, match="no solid element"):
        read_mesh(tmp_path / name)
    mesh = read_mesh(tmp_path / name, solids=False)
    assert mesh.node_ids.tolist() == [1, 2, 3, 4]
    assert mesh.blocks == ()


def test_what_is_no_file_is_refused(tmp_path):
    with pytest.raises(DeckError, match="no such file"):
        read_mesh(tmp_path / "none.bdf")
    with pytest.raises(DeckError, match="not a file"):
        read_mesh(tmp_path)


def test_elements_that_do_not_fit_together_show_on_reading(tmp_path):
    path = deck(tmp_path / "a.bdf", "1.", "2.1e11", "7850.", "0.")
    more = "GRID,5,,1.,1.,1.\nGRID,6,,2.,2.,2.\nCTETRA,11,1,2,3,4,5\nCTETRA,12,1,2,3,4,6\n"
    path.write_text(path.read_text() + more)
    with pytest.raises(DeckError, match="elements 10, 11, 12 share one facet") as caught:
        read_mesh(path)
    assert caught.value.where == f"{path}:13"


@pytest.mark.parametrize(
    ("length", "E", "rho", "units", "says"),
    [
        (
            "1000.",
            "2.1e5",
            "7.85e-9",
            ("m", "kg"),
            "length_unit mm and mesh.mass_unit t it is 2.1e+11 Pa and 7850 kg/m³",
        ),
        ("1.", "2.1e5", "7850.", ("m", "kg"), "Young's modulus is 2.1e+05 Pa"),
        ("1.", "2.1e5", "7850.", ("m", "kg"), "2.1e+05 looks like MPa"),
        ("1000.", "2.1e8", "7.85e-6", ("m", "kg"), "length_unit mm and mesh.mass_unit kg it is 2.1e+11 Pa"),
        ("1.", "2.1e11", "7850.", ("mm", "t"), "length_unit m and mesh.mass_unit kg it is 2.1e+11 Pa"),
        ("1000.", "2.1e5", "7.85e-9", ("mm", "kg"), "density is 7.85 kg/m³, outside 10 to 100000"),
        ("1.", "3.0e7", "15.", ("m", "kg"), None),
        ("1.", "2.1e9", "78500.", ("m", "kg"), None),
        ("1.", "1.e7", "99000.", ("m", "kg"), None),
        ("1.", "2.e6", "90000.", ("m", "kg"), "speed of sound √(E/ρ) is 4.71 m/s"),
        ("1000.", "2.1e11", "7850.", ("m", "kg"), "extent is 1e+03 m"),
        ("1.", "2.1e11", "0.", ("m", "kg"), "material 1 has no density"),
    ],
)
def test_values_that_speak_of_a_wrong_unit_are_suspicious(tmp_path, length, E, rho, units, says):
    said = " / ".join(suspicions(read_mesh(deck(tmp_path / "a.bdf", length, E, rho, "1."), *units), *units))
    assert (says in said) if says else not said


def test_what_is_not_used_or_not_taken_is_said(tmp_path):
    path = deck(tmp_path / "a.bdf", "1.", "2.1e11", "7850.", "0.")
    path.write_text(path.read_text() + "GRID,9\nPSOLID,2,1\nCQUAD4,70,3,1,2,3,4\nMPC,1\nMOMENT,1\nPARAM,POST,-1\n")
    mesh = read_mesh(path)
    assert list(mesh.node_ids[unused_nodes(mesh)]) == [9]
    assert empty_regions(mesh) == (2,)
    assert suspicions(mesh) == (
        "1 node belongs to nothing and is left out of the model: 9",
        "region 2 (PSOLID 2) has no elements",
        "1 × CQUAD4 not taken over: the stiffness, mass or tie it may add is missing",
        "1 × MPC not taken over: the stiffness, mass or tie it may add is missing",
    )


def test_a_structure_without_supports_is_suspicious(tmp_path):
    path = deck(tmp_path / "a.bdf", "1.", "2.1e11", "7850.", "0.")
    path.write_text(path.read_text().replace("SPC1,1,123,1,2,3\n", ""))
    assert "nothing is fixed" in suspicions(read_mesh(path))


@pytest.mark.parametrize("card", ["PARAM", "EIGRL", "TABDMP1", "MOMENT", "*CLOAD moment", "*DLOAD"])
def test_cards_that_steer_or_load_are_no_warning(card):
    assert only_control(card)


@pytest.mark.parametrize("card", ["CQUAD4", "RBAR", "MPC", "*TIE", "*ELEMENT, TYPE=S4R", "CELAS2", "DMIG"])
def test_cards_that_change_the_structure_are(card):
    assert not only_control(card)


GMSH = SHELLS["a.msh"].replace("7 3 2 1 1 1 2 3 4", "7 4 2 1 1 1 2 4 3").replace("3 1 1 0", "3 0 0 1")


@pytest.mark.parametrize("name", ["part.msh.gz", "PART.MSH.GZ"])
def test_a_packed_gmsh_mesh_is_read(tmp_path, name):
    (tmp_path / name).write_bytes(gzip.compress(GMSH.encode()))
    mesh = read_mesh(tmp_path / name)
    assert mesh.blocks[0].kind == "tet4"
    assert mesh.where("node", 4) == f"{tmp_path / name}:9"
    (tmp_path / name).write_bytes(gzip.compress(GMSH.encode())[:-20])
    with pytest.raises(DeckError, match="cannot be unpacked"):
        read_mesh(tmp_path / name, format="gmsh")


@pytest.mark.parametrize("name", ["part.vtu.gz", "part.med.gz"])
def test_other_packed_meshes_are_refused_clearly(tmp_path, name):
    (tmp_path / name).write_bytes(gzip.compress(b"<VTKFile>"))
    with pytest.raises(DeckError, match="packed") as caught:
        read_mesh(tmp_path / name)
    assert "unpack it" in caught.value.remedy


def test_a_material_of_the_config_is_named_by_its_key(tmp_path):
    mesh = with_material(
        read_mesh(deck(tmp_path / "a.bdf", "1.", "2.1e11", "7850.", "0.")),
        None,
        2.1e5,
        0.3,
        7850.0,
        "mesh.materials.steel",
    )
    (said,) = suspicions(mesh)
    assert said.startswith("mesh.materials.steel: Young's modulus is 2.1e+05 Pa")
    assert "values of the config are in Pa" in said


def test_a_reference_node_given_in_millimetres_is_suspicious(tmp_path):
    mesh = read_mesh(deck(tmp_path / "a.bdf", "1000.", "2.1e5", "7.85e-9", "0."), "mm", "t")
    near = with_node(mesh, 900, (1.5, 0, 0))
    near = with_rigid_element(near, node_index(near, 900), np.array([1]), (0, 1, 2), "mesh.ties.0")
    assert suspicions(near, "mm", "t") == ()
    far = with_node(mesh, 900, (50.0, 0, 0))
    far = with_rigid_element(far, node_index(far, 900), np.array([1]), (0, 1, 2), "mesh.ties.0")
    assert any("node 900 of mesh.ties.0 lies 49 m from its nodes" in text for text in suspicions(far, "mm", "t"))


@pytest.mark.parametrize("name", ["part.bdf.gz", "part.inp.gz"])
def test_a_file_that_unpacks_to_a_thousand_times_its_size_is_refused(tmp_path, name):
    """80 kB of zeros, or of one comment again and again, took 80 MB, and 4 MB took the memory of the machine."""
    for line in (b"\0" * 1024, b"$ a comment\n" * 85):
        with gzip.open(tmp_path / name, "wb") as file:
            for _ in range(90):
                file.write(line * 1024)
        with pytest.raises(DeckError, match="more than 100 times its size") as caught:
            read_mesh(tmp_path / name)
        assert caught.value.where.startswith(str(tmp_path / name))

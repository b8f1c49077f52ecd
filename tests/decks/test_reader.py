"""Decks in any units are the same structure in SI."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from strainsight.decks.reader import format_of, read_mesh
from strainsight.errors import DeckError, UserError
from strainsight.mesh.sanity import sanity_warnings
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
    assert sanity_warnings(mesh) == ()


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
        ("a.fem", "", "nastran"),
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
    "a.bdf": "GRID,1\nGRID,2,,1.\nGRID,3,,1.,1.\nGRID,4,,,1.\nCQUAD,7,1,1,2,3,4\n",
    "a.inp": "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n*ELEMENT,TYPE=S9R5\n7,1,2,3,4\n",
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


@pytest.mark.parametrize("name", ["part.bdf.gz", "part.inp.gz"])
def test_a_file_that_unpacks_to_a_thousand_times_its_size_is_refused(tmp_path, name):
    """80 kB of zeros, or of one comment again and again, took 80 MB, and 4 MB took the memory of the machine."""
    for line in (b"\0" * 1024, b"$ a comment\n" * 85):
        with gzip.open(tmp_path / name, "wb") as file:
            for _ in range(20):
                file.write(line * 1024)
        with pytest.raises(DeckError, match="more than 100 times its size") as caught:
            read_mesh(tmp_path / name)
        assert caught.value.where.startswith(str(tmp_path / name))

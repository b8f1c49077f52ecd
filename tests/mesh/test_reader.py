"""Decks in any units are the same structure in SI."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError, UserError
from strainsight.mesh.check import empty_regions, suspicions, unused_nodes
from strainsight.mesh.reader import read_mesh
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


def test_other_formats_and_missing_files_are_refused(tmp_path):
    (tmp_path / "a.msh").write_text("$MeshFormat\n")
    with pytest.raises(DeckError, match=r"a \.msh file") as caught:
        read_mesh(tmp_path / "a.msh")
    assert "Nastran" in caught.value.remedy
    with pytest.raises(DeckError, match="no such file"):
        read_mesh(tmp_path / "none.bdf")
    with pytest.raises(DeckError, match="not a file"):
        read_mesh(tmp_path)


def test_elements_that_do_not_fit_together_show_on_reading(tmp_path):
    path = deck(tmp_path / "a.bdf", "1.", "2.1e11", "7850.", "0.")
    more = "GRID,5,,1.,1.,1.\nGRID,6,,2.,2.,2.\nCTETRA,11,1,2,3,4,5\nCTETRA,12,1,2,3,4,6\n"
    path.write_text(path.read_text() + more)
    with pytest.raises(DeckError, match="elements 10, 11, 12 share one facet"):
        read_mesh(path)


def test_values_that_speak_of_a_wrong_unit_are_suspicious(tmp_path):
    mesh = read_mesh(deck(tmp_path / "a.bdf", "1000.", "2.1e5", "7.85e-9", "0."), "m", "kg")
    said = " / ".join(suspicions(mesh))
    assert "material 1: Young's modulus is 2.1e+05 Pa" in said
    assert "material 1: density is 7.85e-09 kg/m³" in said


def test_what_is_not_used_or_not_taken_is_said(tmp_path):
    path = deck(tmp_path / "a.bdf", "1.", "2.1e11", "7850.", "0.")
    path.write_text(
        path.read_text() + "GRID,9\nPSOLID,2,1\nCQUAD4,70,3,1,2,3,4\nMPC,1\nFORCE,1\nPARAM,POST,-1\nCORD1R,1,1,2,3\n"
    )
    mesh = read_mesh(path)
    assert list(mesh.node_ids[unused_nodes(mesh)]) == [9]
    assert empty_regions(mesh) == (2,)
    assert suspicions(mesh) == (
        "1 nodes belong to nothing and are left out of the model: 9",
        "region 2 (PSOLID 2) has no elements",
        "1 × CQUAD4 not taken over: the stiffness, mass or tie it adds is missing",
        "1 × MPC not taken over: the stiffness, mass or tie it adds is missing",
    )


def test_offsets_and_inertias_of_masses_are_suspicious(tmp_path):
    path = deck(tmp_path / "a.bdf", "1.", "2.1e11", "7850.", "0.,1.")
    assert any("CONM2 offset" in text for text in suspicions(read_mesh(path)))
    path.write_text(path.read_text().replace("SPC1,1,123,1,2,3\n", ""))
    assert "nothing is fixed" in suspicions(read_mesh(path))

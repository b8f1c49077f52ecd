"""Shells and beams in other units and of another size; what a mesh of them has to have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.fem.checks import check_geometry, check_materials
from strainsight.mesh.sanity import empty_regions, sanity_warnings, unused_nodes
from strainsight.mesh.scaling import scaled

IN_METRES = """\
GRID,1,,0.,0.,0.
GRID,2,,2.,0.,0.
GRID,3,,2.,1.,0.
GRID,4,,0.,1.,0.
GRID,5,,0.,0.,1.
CQUAD4,10,1,1,2,3,4,,.05
CBEAM,11,2,1,5,1.,0.,0.
,45,,.01,.02,.03
CONROD,12,2,5,3,1.-4,2.-9,,.3
PSHELL,1,3,.02,3,1.5,3,,8.
PBEAM,2,3,1.-3,2.-7,3.-7,1.-7,4.-7,5.
,.01,.02
,NO,1.,2.-3,4.-7,,,,6.
MAT1,3,2.1+11,,.3,7850.
SPC1,1,123456,1
MPC,1,2,3,2.,4,6,.5
,,5,5,.25
RBAR,20,2,3,1236,35
"""
IN_MILLIMETRES = """\
GRID,1,,0.,0.,0.
GRID,2,,2000.,0.,0.
GRID,3,,2000.,1000.,0.
GRID,4,,0.,1000.,0.
GRID,5,,0.,0.,1000.
CQUAD4,10,1,1,2,3,4,,50.
CBEAM,11,2,1,5,1.,0.,0.
,45,,10.,20.,30.
CONROD,12,2,5,3,100.,2000.,,3.-7
PSHELL,1,3,20.,3,1.5,3,,8.-9
PBEAM,2,3,1000.,2.+5,3.+5,1.+5,4.+5,5.-6
,10.,20.
,NO,1.,2000.,4.+5,,,,6.-6
MAT1,3,2.1+5,,.3,7.85-9
SPC1,1,123456,1
MPC,1,2,3,2.,4,6,500.
,,5,5,250.
RBAR,20,2,3,1236,35
"""


@pytest.fixture
def metres(tmp_path):
    (tmp_path / "m.bdf").write_text(IN_METRES)
    return read_mesh(tmp_path / "m.bdf")


def numbers(mesh):
    """All sizes of shells, beams and sections."""
    found = [block.offset.ravel() for block in (*mesh.shells, *mesh.beams)]
    for own in mesh.sections.values():
        for end in filter(None, (own, getattr(own, "at_b", None))):
            found += [np.ravel(value) for name, value in vars(end).items() if name not in ("at_b", "sides")]
    return np.concatenate(found)


def test_a_deck_in_millimetres_and_tonnes_is_the_one_in_metres_and_kilograms(metres, tmp_path):
    (tmp_path / "mm.bdf").write_text(IN_MILLIMETRES)
    other = read_mesh(tmp_path / "mm.bdf", "mm", "t")
    assert len(numbers(metres)) == 60
    np.testing.assert_allclose(numbers(other), numbers(metres), rtol=1e-12, atol=0)
    np.testing.assert_allclose(other.position, metres.position)
    np.testing.assert_allclose(other.beams[0].axes, metres.beams[0].axes)


def coefficients(mesh):
    """Of relations, each over that of its first term."""
    return np.concatenate([own.value / own.value[0] for own in mesh.relations])


def test_what_multiplies_a_rotation_in_a_relation_is_a_length(metres, tmp_path):
    """Of an MPC, whose coefficients a deck states, and of an RBAR, whose coefficients are those of its arm."""
    (tmp_path / "mm.bdf").write_text(IN_MILLIMETRES)
    other = read_mesh(tmp_path / "mm.bdf", "mm", "t")
    assert metres.relations[-1].value.tolist() == [2.0, 0.5, 0.25]
    assert len(metres.relations) == 7
    np.testing.assert_allclose(coefficients(other), coefficients(metres), rtol=1e-12, atol=0)
    half = scaled(metres, 0.5)
    assert half.relations[-1].value.tolist() == [2.0, 0.25, 0.125]


def masses(mesh):
    """Of shells and beams by their areas and lengths [kg]."""
    rho = mesh.materials[3].density
    x = mesh.position
    plate = mesh.sections[1]
    side = np.linalg.norm(np.diff(x[mesh.shells[0].nodes[0]], axis=0), axis=1)
    found = [side[0] * side[1] * (rho * plate.thickness + plate.nonstructural)]
    for block in mesh.beams:
        own = mesh.sections[int(block.region[0])]
        ends = x[block.nodes[0]] + block.offset[0]
        other = own.at_b or own
        per_length = rho * (own.area + other.area) / 2 + (own.nonstructural + other.nonstructural) / 2
        found.append(np.linalg.norm(ends[1] - ends[0]) * per_length)
    return np.array(found)


def test_mass_grows_with_the_cube_of_the_size_and_stiffness_of_sections_with_the_fourth_power(metres):
    half = scaled(metres, 0.5)
    np.testing.assert_allclose(masses(half), masses(metres) / 8, rtol=1e-14)
    for region in (2, 13):
        np.testing.assert_allclose(half.sections[region].second, metres.sections[region].second / 16)
        np.testing.assert_allclose(half.sections[region].torsion, metres.sections[region].torsion / 16)
    assert half.sections[1].thickness == metres.sections[1].thickness / 2
    assert half.sections[1].bending == metres.sections[1].bending
    np.testing.assert_allclose(half.sections[2].at_b.second, metres.sections[2].at_b.second / 16)


def test_nodes_and_regions_of_shells_and_beams_are_in_use(metres):
    assert unused_nodes(metres).size == 0
    assert empty_regions(metres) == ()
    assert sanity_warnings(metres) == ()
    assert unused_nodes(replace(metres, shells=(), relations=())).tolist() == [2, 3]
    assert unused_nodes(replace(metres, beams=())).size == 0  # node 5 is in a relation
    assert unused_nodes(replace(metres, beams=(), relations=())).tolist() == [4]
    assert empty_regions(replace(metres, shells=())) == (1,)


def test_regions_of_shells_and_beams_need_materials_and_sections_of_their_kind(metres):
    check_geometry(metres)
    check_materials(metres)
    with pytest.raises(DeckError, match=r"region 1 \(PSHELL 1\) refers to material 3, which is not there"):
        check_materials(replace(metres, materials={}))
    sections = dict(metres.sections)
    with pytest.raises(DeckError, match=r"region 1 \(PSHELL 1\) of quad4 element 10 has a section of another kind") as caught:
        check_geometry(replace(metres, sections={**sections, 1: sections[2]}))
    assert caught.value.entity == ("element", 10)
    with pytest.raises(DeckError, match=r"of beam element 11 has no section"):
        check_geometry(replace(metres, sections={1: sections[1]}))
    with pytest.raises(DeckError, match="element 11 refers to region 2, which is not there"):
        check_geometry(replace(metres, regions={1: metres.regions[1]}))

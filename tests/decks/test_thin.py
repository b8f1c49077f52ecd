"""Triangles, quadrangles and lines of files without sections: which become shells and beams, and what is refused."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError, UserError
from strainsight.mesh.assigned_sections import GivenSection
from strainsight.mesh.thin import BeamSection, ShellSection

from ..refusals import expect_refusal
from ..strips import T, gmsh, grid, triangles, vtu
from .conftest import TETRAHEDRON

SHELL = GivenSection(("skin",), ShellSection(T))
BEAM = GivenSection(("spar",), BeamSection(1e-4, np.diag([8e-10, 6e-10]), 1e-9), direction=(0.0, 0.0, 2.0))
ROD = GivenSection(("spar",), BeamSection(1e-4))


@pytest.fixture
def strip(tmp_path):
    def of(*changes, text=None, unit="m", **sections):
        text = text or gmsh(**({"unit": 1e-3} if unit == "mm" else {}))
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "strip.msh").write_text(text)
        given = {f"mesh.sections.{name}": own for name, own in sections.items()}
        return read_mesh(tmp_path / "strip.msh", unit, "kg", sections=given)

    return of


def test_regions_with_section_become_shells_and_beams(strip):
    mesh = strip(skin=SHELL, spar=BEAM)
    points, quads, lines = grid()
    (shells,), (beams,) = mesh.shells, mesh.beams
    assert (shells.kind, beams.kind, mesh.blocks) == ("quad4", "beam", ())
    np.testing.assert_array_equal(mesh.position[shells.nodes], points[quads])
    np.testing.assert_array_equal(mesh.position[beams.nodes], points[lines["spar"]])
    np.testing.assert_array_equal(shells.ids, 13 + np.arange(16))
    np.testing.assert_array_equal(beams.axes, np.tile([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]], (8, 1, 1)))
    # the surface keeps its number, the line of the same number has a free one
    assert {i: own.name for i, own in mesh.regions.items()} == {3: "skin", 6: "spar"}
    assert set(shells.region) == {3}
    assert set(beams.region) == {6}
    assert mesh.sections[3] == SHELL.section
    assert {name: len(ids) for name, ids in mesh.element_sets.items()} == {"skin": 16, "spar": 8}
    assert {name: len(ids) for name, ids in mesh.node_sets.items()} == {"skin": 27, "spar": 9, "root": 3, "1d-5": 3}
    assert mesh.where("element", 13).endswith(f":{gmsh().splitlines().index('13 3 2 3 3 1 4 5 2') + 1}")
    assert any("region 3 of lines is imported as region 6 (spar)" in note for note in mesh.notes)


def test_sections_are_in_metres_whatever_the_unit_of_the_file(strip):
    mesh, other = strip(unit="mm", skin=SHELL, spar=BEAM), strip(skin=SHELL, spar=BEAM)
    np.testing.assert_allclose(mesh.position, other.position, rtol=1e-14)
    assert mesh.sections[3].thickness == pytest.approx(T, rel=1e-14)
    np.testing.assert_allclose(mesh.sections[6].second, BEAM.section.second, rtol=1e-14)
    moved = strip(unit="mm", skin=GivenSection(None, ShellSection(T), offset=0.02))
    np.testing.assert_allclose(moved.shells[0].offset, 0.02, rtol=1e-14)


def test_lines_without_moments_are_rods(strip):
    (rods,) = strip(spar=ROD).beams
    assert rods.kind == "rod"
    np.testing.assert_allclose(rods.axes[:, :, 0], np.tile([1.0, 0, 0], (8, 1)))
    np.testing.assert_allclose(rods.axes.swapaxes(1, 2) @ rods.axes, np.tile(np.eye(3), (8, 1, 1)), atol=1e-15)


def test_single_region_grid_becomes_shells_and_beams(tmp_path):
    given = {
        "mesh.sections.a": GivenSection((7,), ShellSection(T)),
        "mesh.sections.b": GivenSection((7,), BEAM.section, 0.0, (0, 0, 1)),
    }
    mesh = read_mesh(vtu(tmp_path / "strip.vtu"), sections=given)
    points, quads, lines = grid()
    kinds = {block.kind: mesh.position[block.nodes] for block in mesh.thin}
    np.testing.assert_allclose(kinds["quad4"], points[quads[:8]])
    np.testing.assert_allclose(kinds["tri3"], points[triangles(quads[8:])])
    np.testing.assert_allclose(kinds["beam"], points[lines["spar"]])
    assert np.concatenate([block.ids for block in mesh.thin]).tolist() == list(range(1, 33))
    assert {i: own.name for i, own in mesh.regions.items()} == {7: "region 7", 8: "region 7 (1d)"}
    assert {name: len(ids) for name, ids in mesh.node_sets.items()} == {"root": 3, "spar": 9, "tip": 3}


def test_grid_without_regions_becomes_shells(tmp_path):
    points, quads, lines = grid()
    path = tmp_path / "strip.vtk"
    meshio.Mesh(points, [("quad", quads), ("line", lines["root"])]).write(path)
    mesh = read_mesh(path, sections={"mesh.sections.a": GivenSection(None, ShellSection(T))})
    assert ({i: own.name for i, own in mesh.regions.items()}, len(mesh.shells[0].ids)) == ({1: "shells"}, 16)
    assert mesh.ignored == {"line cells": 2}


def test_skin_is_added_to_solid(tmp_path):
    x = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
    cells = [("tetra", [[0, 1, 2, 3]]), ("triangle", [[0, 1, 2], [0, 1, 3]])]
    path = tmp_path / "part.vtu"
    meshio.Mesh(x, cells, cell_data={"region": [[1], [1, 2]], "on": [[1], [0, 1]]}).write(path)
    plain, mesh = read_mesh(path), read_mesh(path, sections={"a": GivenSection((2,), ShellSection(T))})
    assert (plain.thin, plain.ignored) == ((), {"triangle cells": 2})
    assert (mesh.blocks[0].ids.tolist(), mesh.shells[0].ids.tolist()) == ([1], [3])
    assert {i: own.name for i, own in mesh.regions.items()} == {1: "region 1", 2: "region 2"}
    assert mesh.element_sets["on"].tolist() == [1, 3]
    assert mesh.ignored == {"triangle cells": 1}


def test_element_in_two_groups_has_one_section(strip):
    last = gmsh().splitlines()[-2].split()
    again = f"29 3 2 4 4 {' '.join(last[5:])}\n$EndElements"
    text = gmsh().replace("$Elements\n28", "$Elements\n29").replace("$EndElements", again)
    both = strip(text=text, a=GivenSection((3, 4), ShellSection(T)))
    assert len(both.shells[0].ids) == 16
    assert set(both.shells[0].region) == {3}
    assert any("in several physical groups with a section" in note for note in both.notes)
    assert both.element_sets["2d-4"].tolist() == both.shells[0].ids[-1:].tolist()
    with pytest.raises(DeckError, match=r"is in region 3 \(.*\) and in region 4 \(.*\), which have different sections"):
        strip(text=text, a=GivenSection((3,), ShellSection(T)), b=GivenSection((4,), ShellSection(2 * T)))


@pytest.mark.parametrize(
    ("sections", "changes", "key", "what", "remedy"),
    [
        ({"a": GivenSection(("skim",), ShellSection(T))}, (), "a.regions", "no region 'skim' of triangles", "mean skin?"),
        ({"a": SHELL, "b": GivenSection(None, ShellSection(T))}, (), "b.regions", "skin already has the section a", "one"),
        (
            {"a": GivenSection(("spar",), BEAM.section, direction=(1.0, 0.0, 0.0))},
            (),
            None,
            r"element 3 is parallel to the section direction \[1.0, 0.0, 0.0\]",
            "another `direction` in mesh.sections",
        ),
        (
            {"a": SHELL},
            (("13 3 2 3 3 1 4 5 2", "13 10 2 3 3 1 4 5 2 7 8 3 6 9"),),
            None,
            "13 is a 9-node quadrangle",
            "SecondOrderIncomplete = 1",
        ),
        ({}, (), None, r"no solid elements \(12 2-node lines, 16 4-node quadrangles\)", "in mesh.sections"),
    ],
)
def test_unsupported_thin_elements_are_refused(strip, sections, changes, key, what, remedy):
    with expect_refusal(UserError, what, remedy=remedy, key=(key and f"mesh.sections.{key}")) as error:
        strip(*changes, **sections)
    if key is None and sections:
        assert error.value.where.rpartition(":")[2].isdigit()


def test_sections_of_solids_and_decks_are_refused(tmp_path):
    (tmp_path / "deck.bdf").write_text(TETRAHEDRON)
    with expect_refusal(UserError, r"mesh\.sections\.a: deck\.bdf is a Nastran or Abaqus deck", key="mesh.sections.a"):
        read_mesh(tmp_path / "deck.bdf", sections={"mesh.sections.a": SHELL})
    meshio.Mesh(np.vstack([np.zeros(3), np.eye(3)]), [("tetra", [range(4)])]).write(tmp_path / "part.vtu")
    for regions, what in (((1,), "no region 1 of triangles"), (None, "the file has no triangles")):
        with pytest.raises(UserError, match=what):
            read_mesh(tmp_path / "part.vtu", sections={"mesh.sections.a": GivenSection(regions, ShellSection(T))})

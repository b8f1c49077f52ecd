"""Meshes through meshio keep numbers, regions and sets where the format has them, and never lose a cell in silence."""

from __future__ import annotations

import h5py
import meshio
import numpy as np
import pytest
import pyvista

from strainsight.decks.other.mesh import read_meshio
from strainsight.errors import DeckError
from strainsight.mesh.kinds import kind_of

from ...refusals import expect_refusal
from ...solids import SOLIDS, facets_point_outward

TETRAHEDRON = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
CELLS = [("tetra", [[0, 1, 2, 3], [1, 2, 3, 4]]), ("triangle", [[0, 1, 2]])]
LINEAR = [kind for kind, solid in SOLIDS.items() if not solid.edges]
WRITTEN = [kind for kind in SOLIDS if kind != "wedge15"]  # meshio writes no quadratic wedges


def nodes_of(kind: str, mirrored: bool = False) -> np.ndarray:
    """Nodes of one element; mirrored: numbered the other way round, so that its volume is negative."""
    x = SOLIDS[kind].points()
    return x[:, [1, 0, 2]] if mirrored else x


def grid(kind: str, x: np.ndarray) -> pyvista.UnstructuredGrid:
    return pyvista.UnstructuredGrid(np.r_[len(x), np.arange(len(x))], [SOLIDS[kind].vtk], x)


def check_element(mesh, kind):
    (block,) = mesh.blocks
    x = mesh.position[block.nodes[0]]
    corners, edges = len(SOLIDS[kind].corners), SOLIDS[kind].edges
    assert (block.kind, len(x)) == (kind, corners + len(edges))
    for middle, (a, b) in zip(x[corners:], edges, strict=True):
        np.testing.assert_allclose(middle, (x[a] + x[b]) / 2, atol=1e-6)
    assert facets_point_outward(x, kind_of(kind).facets)


@pytest.fixture
def write(tmp_path):
    """Write the two tetrahedra and their triangle with meshio, other arguments as to meshio.Mesh; returns the path."""

    def to(name: str, cells=CELLS, points=TETRAHEDRON, **data):
        path = tmp_path / name
        meshio.Mesh(points, cells, **data).write(path)
        return path

    return to


@pytest.mark.parametrize("name", ["part.vtu", "part.vtk"])
@pytest.mark.parametrize("kind", SOLIDS)
def test_vtk_wedge_orientation(tmp_path, name, kind):
    grid(kind, nodes_of(kind, mirrored=kind.startswith("wedge"))).save(tmp_path / name)
    mesh = read_meshio(tmp_path / name)
    check_element(mesh, kind)
    assert not any("left-handed" in note for note in mesh.notes)


@pytest.mark.parametrize("kind", ["wedge6", "wedge15"])
def test_mirrored_wedges_are_corrected(tmp_path, kind):
    grid(kind, nodes_of(kind)).save(tmp_path / "part.vtu")
    mesh = read_meshio(tmp_path / "part.vtu")
    check_element(mesh, kind)
    assert f"{kind} elements had a left-handed node order in the file (format vtu); the node order is corrected" in mesh.notes


@pytest.mark.parametrize("mirrored", [True, False], ids=["as Salome writes", "as meshio writes"])
@pytest.mark.parametrize("kind", WRITTEN)
def test_med_solids_are_mirrored(write, kind, mirrored):
    x = nodes_of(kind, mirrored)
    mesh = read_meshio(write("part.med", [(SOLIDS[kind].meshio, [np.arange(len(x))])], x))
    check_element(mesh, kind)
    assert any("had a left-handed node order in the file (format med)" in note for note in mesh.notes) is not mirrored


FORMATS = {
    **dict.fromkeys(["part.vtu", "part.vtk", "part.xdmf", "part.vol"], WRITTEN),
    **dict.fromkeys(["part.mesh", "part.meshb", "part.avs", "part.su2", "part.f3grid", "part.dato"], LINEAR),
}


@pytest.mark.parametrize(("name", "kind"), [(name, kind) for name, kinds in FORMATS.items() for kind in kinds])
def test_meshio_roundtrip(write, name, kind):
    x = nodes_of(kind)
    check_element(read_meshio(write(name, [(SOLIDS[kind].meshio, [np.arange(len(x))])], x)), kind)


@pytest.mark.parametrize("dtype", [np.int64, np.int32, np.float64, np.int16])
@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("name", ["part.vtu", "part.vtk"])
def test_numbers_regions_and_sets_are_data_of_the_grid(tmp_path, name, binary, dtype):
    part = pyvista.UnstructuredGrid(np.array([4, 0, 1, 2, 3, 4, 1, 2, 3, 4]), [10, 10], TETRAHEDRON)
    part.point_data["node_id"] = np.array([70, 3, 9, 12, 5], dtype=dtype)
    part.point_data["foot"] = np.array([1, 1, 0, 0, 0], dtype=dtype)
    part.point_data["temperature"] = np.linspace(0.0, 1.0, 5)
    part.cell_data["GlobalElementId"] = np.array([40, 8], dtype=dtype)
    part.cell_data["MaterialIds"] = np.array([2, 5], dtype=dtype)
    part.cell_data["tip"] = np.array([0, 1], dtype=dtype)
    part.save(tmp_path / name, binary=binary)
    mesh = read_meshio(tmp_path / name)
    assert mesh.node_ids.tolist() == [70, 3, 9, 12, 5]
    assert (mesh.blocks[0].ids.tolist(), mesh.blocks[0].region.tolist()) == ([40, 8], [2, 5])
    assert {i: (r.name, r.material) for i, r in mesh.regions.items()} == {2: ("region 2", 0), 5: ("region 5", 0)}
    assert {k: v.tolist() for k, v in mesh.node_sets.items()} == {"foot": [3, 70]}
    assert {k: v.tolist() for k, v in mesh.element_sets.items()} == {"tip": [8]}
    assert mesh.ignored == {"point data temperature": 1}
    assert mesh.notes == ("regions are defined by the cell data MaterialIds",)


def test_mesh_without_data_has_default_ids_and_region(write):
    mesh = read_meshio(write("part.vtu"))
    assert (mesh.node_ids.tolist(), mesh.blocks[0].ids.tolist()) == ([1, 2, 3, 4, 5], [1, 2])
    assert {i: r.name for i, r in mesh.regions.items()} == {1: "solids"}
    assert len(mesh.notes) == 3
    assert mesh.ignored == {"triangle cells": 1}
    assert mesh.origin == {}


def test_region_data_can_be_selected(write):
    path = write("part.vtu", cell_data={"region": [[1, 2], [0]], "layer": [[7, 8], [0]], "x": [[0.5, 1.5], [0.0]]})
    assert read_meshio(path).blocks[0].region.tolist() == [1, 2]
    assert read_meshio(path, "layer").blocks[0].region.tolist() == [7, 8]
    with expect_refusal(DeckError, "cell data 'colour' not found", remedy="region, layer"):
        read_meshio(path, "colour")
    with pytest.raises(DeckError, match="'x' are not integers"):
        read_meshio(path, "x")


def test_families_of_med_are_regions_and_sets_by_name(tmp_path):
    part = meshio.Mesh(TETRAHEDRON, CELLS, {"point_tags": np.array([2, 2, 0, 0, 0])}, {"cell_tags": [[-6, -7], [-8]]})
    part.cell_tags = {-6: ["steel", "all"], -7: ["pin", "all"], -8: ["foot"]}
    part.point_tags = {2: ["edge"]}
    part.write(tmp_path / "part.med")
    mesh = read_meshio(tmp_path / "part.med")
    assert {i: r.name for i, r in mesh.regions.items()} == {-7: "pin, all", -6: "steel, all"}
    assert {k: v.tolist() for k, v in mesh.element_sets.items()} == {"steel": [1], "pin": [2], "all": [1, 2]}
    assert mesh.node_sets["foot"].tolist() == [1, 2, 3]
    assert mesh.node_sets["edge"].tolist() == [1, 2]
    assert mesh.node_sets["all"].tolist() == [1, 2, 3, 4, 5]
    assert mesh.ignored == {}


def test_xdmf_data_files_must_be_in_folder(write, tmp_path):
    path = write("part.xdmf")
    assert read_meshio(path).included == (str(tmp_path / "part.h5"),)
    (tmp_path / "deep").mkdir()
    inner = tmp_path / "deep" / "part.xdmf"
    inner.write_text(path.read_text().replace("part.h5:", "../part.h5:"))
    with pytest.raises(DeckError, match=r"the data file '\.\./part\.h5:/data0' is outside the folder of the mesh"):
        read_meshio(inner)


def test_links_out_of_an_hdf5_file_are_refused(write, tmp_path):
    path = write("part.med")
    with h5py.File(path, "a") as file:
        file["away"] = h5py.ExternalLink("/tmp/other.h5", "/x")
    with pytest.raises(DeckError, match="away is a link to another file"):
        read_meshio(path)


PYRAMID13 = np.random.default_rng(0).random((13, 3))


@pytest.mark.parametrize(
    ("name", "cells", "points", "message"),
    [
        ("part.vtu", [("pyramid13", [range(13)])], PYRAMID13, "1"),
        ("part.vtu", [("triangle", [[0, 1, 2]])], TETRAHEDRON, r"the mesh contains no solid elements \(1 triangle cell\)"),
        ("part.vtu", [("tetra", [[0, 1, 2, 9]])], TETRAHEDRON, r"a tetra cell refers to point 9 \(counted from 0\)"),
        ("part.vtu", CELLS, TETRAHEDRON * [1, 1, np.nan], "node 1 has a coordinate that is not a finite"),
        ("part.xdmf", [("tetra", [[0, 1, 2, 3]])], TETRAHEDRON[:, :2], "the points have 2 coordinates"),
    ],
)
def test_what_cannot_be_imported_is_refused(write, name, cells, points, message):
    path = write(name, cells, points)
    with expect_refusal(DeckError, message, remedy="") as error:
        read_meshio(path)
    assert error.value.where == str(path)


@pytest.mark.parametrize("name", ["Polyhedron", "QuadraticPyramid", "HexagonalPrism"])
@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_unsupported_meshio_cells_are_refused(tmp_path, name, suffix):
    getattr(pyvista.examples.cells, name)().save(tmp_path / f"part{suffix}")
    with pytest.raises(DeckError):
        read_meshio(tmp_path / f"part{suffix}")


def test_vtu_with_pieces_is_refused(write):
    path = write("part.vtu")
    text = path.read_text()
    piece = text[text.index("<Piece") : text.index("</Piece>") + len("</Piece>")]
    path.write_text(text.replace(piece, piece + piece))
    with pytest.raises(DeckError, match="the file has 2 <Piece> elements, but only one"):
        read_meshio(path)


VTK = "# vtk DataFile Version 4.2\nx\nASCII\nDATASET"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("part.vtu", "no mesh", "cannot be read as vtu"),
        ("part.vtk", f"{VTK} STRUCTURED_POINTS\n", "the VTK data set STRUCTURED_POINTS is not supported"),
        ("part.vtk", f"{VTK} UNSTRUCTURED_GRID\nPOINTS 90000000000 double\n", "the line declares 90000000000 entries"),
        ("part.med", "no mesh", "cannot be read as HDF5"),
        ("part.step", "ISO-10303-21;", "the file name extension .step is not supported"),
    ],
)
def test_invalid_files_produce_no_meshio_output(tmp_path, capfd, name, content, message):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(DeckError, match=message):
        read_meshio(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["grid.vtu", "grid.vtk"])
def test_voxels_are_hexahedra(tmp_path, name):
    grid = pyvista.ImageData(dimensions=(2, 3, 4), spacing=(0.1, 0.2, 0.3)).cast_to_unstructured_grid()
    grid.save(tmp_path / name)
    (block,) = read_meshio(tmp_path / name).blocks
    assert (block.kind, len(block.ids)) == ("hex8", 6)
    corners = grid.points[block.nodes]
    edges = np.stack([corners[:, i] - corners[:, 0] for i in (1, 3, 4)], axis=1)
    np.testing.assert_allclose(np.linalg.det(edges), 0.1 * 0.2 * 0.3, rtol=1e-6)
    np.testing.assert_allclose(corners[:, 6] - corners[:, 0], [[0.1, 0.2, 0.3]] * 6, atol=1e-6)


def test_tetgen_files_must_be_in_folder(write, tmp_path):
    path = write("part.node", CELLS[:1])
    assert read_meshio(path).included == (str(tmp_path / "part.ele"),)
    (tmp_path / "mesh").mkdir()
    path.rename(tmp_path / "mesh" / "part.node")
    (tmp_path / "mesh" / "part.ele").symlink_to(tmp_path / "part.ele")
    with pytest.raises(DeckError, match=r"the data file 'part\.ele' is outside the folder of the mesh"):
        read_meshio(tmp_path / "mesh" / "part.node")

"""What is written as VTKHDF comes back from VTK's own reader, also beside other groups in an .h5 file."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
import pyvista
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOHDF import vtkHDFReader

from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import CellBlock, Mesh
from strainsight.mesh.vtkhdf import VTK_TYPE, facet_cells, unstructured_grid

from ..solids import SOLIDS

COUNT = {"vertex": 1, "line": 2, "tri3": 3, "tri6": 6, "quad4": 4, "quad8": 8} | {
    kind: len(solid.points()) for kind, solid in SOLIDS.items()
}


def write(path, grid):
    with h5py.File(path, "w") as file:
        file.create_dataset("/summary/other", data=np.arange(5.0))
        for name, array in grid.datasets.items():
            file.create_dataset(f"/VTKHDF/{name}", data=array)
        for name, values in grid.attributes.items():
            for key, value in values.items():
                file[f"/VTKHDF/{name}".rstrip("/")].attrs[key] = value


def hdf_reader(path):
    return pyvista.HDFReader(str(path))


def time_reader(path):
    reader = vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    return reader, reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())


def blocks():
    offset, found = 0, []
    for i, (kind, count) in enumerate(COUNT.items(), start=1):
        nodes = offset + np.arange(2 * count).reshape(2, count)
        found.append(CellBlock(kind, np.array([2 * i, 2 * i + 1]), nodes, np.array([1, 1])))
        offset += 2 * count
    return found, offset


def test_cell_types_are_those_of_vtk():
    kinds = pyvista.CellType
    assert {
        "vertex": kinds.VERTEX,
        "line": kinds.LINE,
        "beam": kinds.LINE,
        "rod": kinds.LINE,
        "tri3": kinds.TRIANGLE,
        "tri6": kinds.QUADRATIC_TRIANGLE,
        "quad4": kinds.QUAD,
        "quad8": kinds.QUADRATIC_QUAD,
        "shell6": kinds.QUADRATIC_TRIANGLE,
        "shell8": kinds.QUADRATIC_QUAD,
        "beam3": kinds.QUADRATIC_EDGE,
    } | {kind: solid.vtk for kind, solid in SOLIDS.items()} == VTK_TYPE


@pytest.mark.parametrize("suffix", [".vtkhdf", ".h5"])
def test_all_kinds_come_back_with_their_data(tmp_path, suffix):
    cells, n = blocks()
    position = np.random.default_rng(0).random((n, 3))
    ids = np.concatenate([block.ids for block in cells])
    data = {"node_id": np.arange(n) + 100, "vector": 2 * position}
    write(tmp_path / f"a{suffix}", unstructured_grid(position, cells, data, {"element_id": ids}))
    mesh = pyvista.read(tmp_path / "a.vtkhdf") if suffix == ".vtkhdf" else hdf_reader(tmp_path / "a.h5").read()
    np.testing.assert_array_equal(mesh.points, position)
    np.testing.assert_array_equal(mesh.celltypes, [VTK_TYPE[block.kind] for block in cells for _ in range(2)])
    for cell, expected in zip(range(mesh.n_cells), (row for block in cells for row in block.nodes), strict=True):
        np.testing.assert_array_equal(mesh.get_cell(cell).point_ids, expected)
    np.testing.assert_array_equal(mesh.point_data["node_id"], data["node_id"])
    np.testing.assert_array_equal(mesh.point_data["vector"], data["vector"])
    np.testing.assert_array_equal(mesh.cell_data["element_id"], ids)


def test_steps_change_what_changes_and_keep_the_rest(tmp_path):
    cells, n = blocks()
    m = sum(len(block.ids) for block in cells)
    rng = np.random.default_rng(1)
    mode, strain, fixed = rng.random((3, n, 3)), rng.random((3, m)), rng.random(n)
    frequency = np.array([40.0, 52.5, 240.0])
    write(
        tmp_path / "modes.h5",
        unstructured_grid(
            rng.random((n, 3)), cells, {"mode": mode, "fixed": fixed}, {"strain": strain}, steps=frequency
        ),
    )
    reader, times = time_reader(tmp_path / "modes.h5")
    np.testing.assert_array_equal(times, frequency)
    for i in (2, 0, 1):
        reader.UpdateTimeStep(frequency[i])
        mesh = pyvista.wrap(reader.GetOutputDataObject(0))
        np.testing.assert_array_equal(mesh.point_data["mode"], mode[i])
        np.testing.assert_array_equal(mesh.cell_data["strain"], strain[i])
        np.testing.assert_array_equal(mesh.point_data["fixed"], fixed)
        assert mesh.n_cells == m


def test_equal_steps_stay_apart_on_the_time_axis():
    grid = unstructured_grid(np.zeros((1, 3)), [], steps=[5.0, 5.0, 5.0])
    assert np.all(np.diff(grid.datasets["Steps/Values"]) > 0)
    np.testing.assert_allclose(grid.datasets["Steps/Values"], 5.0, rtol=1e-14)


def test_points_alone_are_a_grid(tmp_path):
    write(tmp_path / "points.vtkhdf", unstructured_grid(np.eye(3), [], {"a": np.arange(3)}))
    assert pyvista.read(tmp_path / "points.vtkhdf").n_points == 3


@pytest.mark.parametrize("data", [np.zeros(4), np.zeros((2, 4)), np.float64(1.0)])
def test_data_of_another_length_is_refused(data):
    with pytest.raises(ValueError, match="PointData a"):
        unstructured_grid(np.eye(3), [], {"a": data}, steps=[0.0, 1.0])


@pytest.mark.parametrize("suffix", [".vtkhdf", ".h5"])
def test_a_surface_with_many_arrays_plays_in_time(tmp_path, suffix):
    """A hexahedron beside a wedge: scalars, vectors and tensors, single and double, on facets and on points."""
    position = np.array(
        [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)] + [[2, 0, 0], [2, 0, 1]], dtype=float
    )
    hexahedron = CellBlock("hex8", np.array([7]), np.array([[0, 1, 3, 2, 4, 5, 7, 6]]), np.array([1]))
    wedge = CellBlock("wedge6", np.array([3]), np.array([[1, 8, 3, 5, 9, 7]]), np.array([2]))
    inside = np.array([[9.0, 9.0, 9.0]])
    mesh = Mesh(
        np.arange(1, 12),
        np.vstack([inside, position]),
        tuple(CellBlock(b.kind, b.ids, b.nodes + 1, b.region) for b in (hexahedron, wedge)),
        {},
        {},
        np.zeros((0, 2), dtype=np.int64),
    )
    facets = exterior_facets(mesh)
    used, cells, order = facet_cells(facets)
    np.testing.assert_array_equal(used, np.arange(1, 11))
    assert [block.kind for block in cells] == ["tri3", "quad4"]
    rng, T, f = np.random.default_rng(2), 5, len(facets.kind)
    time = np.linspace(0, 1e-3, T)
    tensor, mises = rng.random((T, f, 6)), rng.random((T, f)).astype(np.float32)
    moved, nodal = rng.random((T, 10, 3)), rng.random((T, 10))
    path = tmp_path / f"surface{suffix}"
    write(
        path,
        unstructured_grid(
            mesh.position[used],
            cells,
            {"displacement": moved, "von_mises": nodal},
            {"stress": tensor[:, order], "von_mises": mises[:, order], "element": facets.element_id[order]},
            steps=time,
        ),
    )
    reader, times = time_reader(path)
    np.testing.assert_array_equal(times, time)
    for i in (3, 0, 4, 4, 1, 2):
        reader.UpdateTimeStep(time[i])
        grid = pyvista.wrap(reader.GetOutputDataObject(0))
        np.testing.assert_array_equal(grid.point_data["displacement"], moved[i])
        np.testing.assert_array_equal(grid.point_data["von_mises"], nodal[i])
        assert grid.cell_data["von_mises"].dtype == np.float32
        for cell, facet in enumerate(order):
            nodes = facets.nodes[facet][facets.nodes[facet] >= 0]
            np.testing.assert_array_equal(grid.get_cell(cell).points, mesh.position[nodes])
            np.testing.assert_array_equal(grid.cell_data["stress"][cell], tensor[i, facet])
            assert grid.cell_data["von_mises"][cell] == mises[i, facet]
            assert grid.cell_data["element"][cell] == facets.element_id[facet]


def test_points_of_a_surface_may_have_numbers_of_their_own():
    """Two triangles that meet in an edge but have points of their own there, as where two materials meet."""
    nodes = np.full((2, 8), -1)
    nodes[:, :3] = [[0, 1, 2], [1, 3, 2]]
    corner = np.full((2, 8), -1)
    corner[:, :3] = [[10, 11, 12], [20, 22, 21]]
    one = np.array([1, 2])
    facets = Facets(element_id=one, facet=one, kind=np.zeros(2, dtype=np.int64), nodes=nodes, region=one)
    used, (block,), order = facet_cells(facets, corner)
    np.testing.assert_array_equal(used, [10, 11, 12, 20, 21, 22])
    np.testing.assert_array_equal(block.nodes, [[0, 1, 2], [3, 5, 4]])
    np.testing.assert_array_equal(order, [0, 1])

"""Subdivided elements, ties of surfaces, and VTKHDF files."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest
import pyvista
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline
from vtkmodules.vtkIOHDF import vtkHDFReader

from strainsight.errors import UserError
from strainsight.fem.assembly import assemble
from strainsight.fem.mass import mass_properties
from strainsight.mesh.connectivity import connectivity_warnings
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.kinds.kind import with_midsides
from strainsight.mesh.model import CellBlock
from strainsight.mesh.projection import nearest
from strainsight.mesh.subdivision import refined
from strainsight.mesh.surface_ties import with_surface_tie
from strainsight.mesh.vtkhdf import VTK_TYPE, facet_cells, unstructured_grid

from ..bodies import RHO, body
from ..solids import SOLIDS
from .boxes import FACE, TWO, both, box

# A mesh cut at the middle of its edges is the same body, conforming, and holds what the coarse one holds.
PARTS = {"tet4": 8, "tet10": 8, "hex8": 8, "hex20": 8, "wedge6": 8, "wedge15": 8, "pyra5": 10}


def block(kind, chart=lambda u, v, w: (u, v, w)):
    return body(kind, (2, 1, 1), chart)


@pytest.mark.parametrize("kind", SOLIDS)
def test_the_parts_fill_the_body_and_share_their_nodes(kind):
    mesh = block(kind)
    fine = refined(mesh).mesh
    assert sum(len(own.ids) for own in fine.blocks) == PARTS[kind] * len(mesh.blocks[0].ids)
    np.testing.assert_allclose(mass_properties(fine)[1], mass_properties(mesh)[1], atol=1e-12)
    assert mass_properties(fine)[0] == pytest.approx(2 * RHO)
    coarse, facets = exterior_facets(mesh), exterior_facets(fine)
    assert len(facets.kind) == 4 * len(coarse.kind)


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_field_of_the_coarse_mesh_has_its_energy_on_the_fine_one(kind):
    """Straight elements: the spaces are nested, so P'KP = K. Hexahedra of 8 nodes have incompatible modes beside, and pyramids
    functions that are no polynomials: of them only linear fields."""
    mesh = block(kind)
    own = refined(mesh)
    z = np.random.default_rng(2).standard_normal(3 * len(mesh.position))
    fine = (own.interpolation @ z.reshape(-1, 3)).ravel()
    before, after = z @ (assemble(mesh)[0].constant @ z), fine @ (assemble(own.mesh)[0].constant @ fine)
    if kind in ("hex8", "pyra5"):
        z = (mesh.position @ np.random.default_rng(3).standard_normal((3, 3))).ravel()
        fine = (own.interpolation @ z.reshape(-1, 3)).ravel()
        before, after = z @ (assemble(mesh)[0].constant @ z), fine @ (assemble(own.mesh)[0].constant @ fine)
    assert after == pytest.approx(before, rel=1e-10)


@pytest.mark.parametrize("kind", ["tet10", "hex20", "wedge15"])
def test_a_curved_surface_keeps_its_shape(kind):
    def bend(u, v, w):
        angle, radius = 0.5 * u, 1 + v
        return radius * np.sin(angle), radius * np.cos(angle), w

    mesh = block(kind, bend)
    fine = refined(mesh).mesh
    facets = exterior_facets(fine)
    nodes = np.unique(facets.nodes[facets.nodes >= 0])
    radius = np.hypot(fine.position[nodes, 0], fine.position[nodes, 1])
    outer = np.abs(radius - 2) < 0.02
    assert outer.sum() > 20
    assert np.abs(radius[outer] - 2).max() < 0.1 * 2 * (1 - np.cos(0.125))


@pytest.mark.parametrize("kind", SOLIDS)
def test_nodes_of_parts_of_facets_are_found(kind):
    mesh = block(kind)
    own = refined(mesh)
    facets = exterior_facets(mesh)
    for code in np.unique(facets.kind):
        face = FACETS[code]
        nodes = facets.nodes[facets.kind == code][:, : len(face.nodes)]
        for name, corners in face.split:
            xi = with_midsides(corners, next(kind for kind in FACETS if kind.name == name).edges)
            at = own.mesh.position[own.nodes_at(face, nodes, xi)]
            np.testing.assert_allclose(at, np.einsum("qk,ekc->eqc", face.shape(xi), mesh.position[nodes]), atol=1e-12)


def test_subdivision_keeps_touching_bodies_separate():
    mesh = block("hex8")
    assert len(refined(both(mesh, mesh)).mesh.position) == 2 * len(refined(mesh).mesh.position)


# Nodes that follow the faces of another mesh, near or over a gap; the nearest point of a facet.
def tied_bar(coarse, fine):
    """A cube of one cell and one of eight, tied, and which nodes are where they are tied."""
    mesh = both(box(coarse, (1, 1, 1)), box(fine, (2, 2, 2), at=(1, 0, 0)))
    steel = {i: replace(own, poisson_ratio=0.0) for i, own in mesh.materials.items()}
    at, own = mesh.position[:, 0] == 1, np.arange(len(mesh.position)) < len(box(coarse, (1, 1, 1)).position)
    mesh = replace(mesh, materials=steel)
    return with_surface_tie(mesh, np.flatnonzero(at & ~own), np.flatnonzero(at & own), 1e-6, "mesh.ties.0")


@pytest.mark.parametrize("coarse", ["tet4", "tet10", "hex8", "hex20", "wedge15"])
@pytest.mark.parametrize("fine", ["tet4", "hex20"])
def test_surface_tie_reproduces_linear_fields(coarse, fine):
    mesh = tied_bar(coarse, fine)
    assert connectivity_warnings(mesh) == ()
    assert all(own.value[0] == 1 for own in mesh.relations)
    for field in (np.ones(len(mesh.position)), *mesh.position.T):
        np.testing.assert_allclose([own.value @ field[own.node] for own in mesh.relations], 0, atol=1e-13)


def tied_over(gap, kind="hex8", chart=lambda x, y, z: (x, y, z)):
    """A block of eight cells and one of 27, a gap [m] above it, tied."""
    mesh = both(box(kind), box(kind, (3, 3, 3), at=(0, 0, 1 + gap)))
    z, first = mesh.position[:, 2], np.arange(len(mesh.position)) < len(box(kind).position)
    fine, coarse = np.flatnonzero(~first & (z == z[~first].min())), np.flatnonzero(first & (z == 1))
    return with_surface_tie(replace(mesh, position=np.array(chart(*mesh.position.T)).T), fine, coarse, 0.1, "t")


@pytest.mark.parametrize("gap", [0.0, 1e-8, 1e-4])
@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10"])
def test_a_tie_over_a_gap_follows_every_rigid_motion(gap, kind):
    def dome(x, y, z):
        return x + 0.1 * y * z, y, z - 0.2 * x**2 + 0.1 * x * y

    mesh = tied_over(gap, kind, dome)
    x = mesh.position
    for axis in np.eye(3):
        for u in (np.broadcast_to(axis, x.shape), np.cross(axis, x)):
            np.testing.assert_allclose(
                [own.value @ u[own.node, own.component] for own in mesh.relations], 0, atol=1e-12
            )


@pytest.mark.parametrize("code", range(len(FACETS)))
def test_the_nearest_point_of_a_curved_facet_is_the_foot_of_its_normal(code):
    kind = FACETS[code]
    nodes = np.column_stack([kind.nodes, 0.2 * kind.nodes[:, 0] ** 2 + 0.1 * kind.nodes[:, 0] * kind.nodes[:, 1]])[None]
    xi = np.array([[0.3, 0.1], [0.2, 0.6], [1.0, 0.0]])
    N, dN = kind.functions(xi)
    on, slopes = N @ nodes[0], np.einsum("mad,ac->mdc", dN, nodes[0])
    n = np.cross(slopes[:, 0], slopes[:, 1])
    n /= np.linalg.norm(n, axis=1)[:, None]
    feet = nearest(code, np.repeat(nodes, 3, axis=0), on + [[0.0], [1e-3], [-1e-2]] * n)
    np.testing.assert_allclose(feet.x, on, atol=1e-12)
    np.testing.assert_allclose(feet.distance, [0.0, 1e-3, 1e-2], atol=1e-12)


def test_surface_tie_refuses_distant_node():
    with pytest.raises(UserError, match=r"node \d+ is farther than 0\.1 m from the surface"):
        with_surface_tie(TWO, np.flatnonzero(TWO.position[:, 0] == 2), FACE[0], 0.1, "mesh.ties.0")


# What is written as VTKHDF comes back from VTK's own reader, also beside other groups in an .h5 file.
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
    mesh = pyvista.read(tmp_path / "a.vtkhdf") if suffix == ".vtkhdf" else pyvista.HDFReader(str(tmp_path / "a.h5")).read()
    np.testing.assert_array_equal(mesh.points, position)
    np.testing.assert_array_equal(mesh.celltypes, [VTK_TYPE[block.kind] for block in cells for _ in range(2)])
    for cell, expected in zip(range(mesh.n_cells), (row for block in cells for row in block.nodes), strict=True):
        np.testing.assert_array_equal(mesh.get_cell(cell).point_ids, expected)
    np.testing.assert_array_equal(mesh.point_data["node_id"], data["node_id"])
    np.testing.assert_array_equal(mesh.point_data["vector"], data["vector"])
    np.testing.assert_array_equal(mesh.cell_data["element_id"], ids)


def test_vtkhdf_steps_update_only_time_dependent_data(tmp_path):
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
    reader = vtkHDFReader()
    reader.SetFileName(str(tmp_path / "modes.h5"))
    reader.UpdateInformation()
    times = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.TIME_STEPS())
    np.testing.assert_array_equal(times, frequency)
    for i in (2, 0, 1):
        reader.UpdateTimeStep(frequency[i])
        mesh = pyvista.wrap(reader.GetOutputDataObject(0))
        np.testing.assert_array_equal(mesh.point_data["mode"], mode[i])
        np.testing.assert_array_equal(mesh.cell_data["strain"], strain[i])
        np.testing.assert_array_equal(mesh.point_data["fixed"], fixed)
        assert mesh.n_cells == m


def test_a_surface_of_two_kinds_is_two_blocks_on_the_nodes_it_has():
    """A quadrangle on nodes 5, 2, 9, 7, and a triangle beside it."""
    nodes = np.full((2, 8), -1)
    nodes[0, :4], nodes[1, :3] = [5, 2, 9, 7], [2, 8, 9]
    codes = [[kind.name for kind in FACETS].index(name) for name in ("quad4", "tri3")]
    facets = Facets(element_id=np.array([4, 3]), facet=np.ones(2, int), kind=np.array(codes), nodes=nodes, region=np.ones(2, int))
    used, cells, order = facet_cells(facets)
    np.testing.assert_array_equal(used, [2, 5, 7, 8, 9])
    assert [(block.kind, block.nodes.tolist()) for block in cells] == [("tri3", [[0, 3, 4]]), ("quad4", [[1, 0, 4, 2]])]
    np.testing.assert_array_equal(order, [1, 0])

"""Shape functions and quadrature rules are what their definitions say."""

from __future__ import annotations

import subprocess
import sys
from math import factorial

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.mesh.kinds import ELEMENTS, FACETS, kind_of
from strainsight.mesh.kinds.hexahedra import HEX8, HEX20
from strainsight.mesh.kinds.quadrangles import QUAD4, QUAD8
from strainsight.mesh.kinds.tetrahedra import TET4, TET10
from strainsight.mesh.kinds.triangles import TRI3, TRI6
from strainsight.mesh.kinds.wedges import WEDGE6, WEDGE15

from ..solids import SOLIDS

every_kind = pytest.mark.parametrize("kind", ELEMENTS + FACETS, ids=lambda kind: kind.name)


def test_every_element_is_described_to_the_tests():
    assert [kind.name for kind in ELEMENTS] == list(SOLIDS)


@every_kind
def test_shape_function_is_one_at_its_node_and_zero_at_the_others(kind):
    assert np.allclose(kind.shape(kind.nodes), np.eye(len(kind.nodes)), atol=1e-15)


@every_kind
def test_polynomials_of_the_elements_degree_are_reproduced(kind):
    nodes, xi = kind.nodes, np.random.default_rng(0).uniform(0, 0.3, (7, kind.nodes.shape[1]))
    degree = 2 if kind.edges else 1
    powers = [p for p in np.ndindex(*[degree + 1] * nodes.shape[1]) if sum(p) <= degree]
    for power in powers:
        assert np.allclose(kind.shape(xi) @ np.prod(nodes**power, axis=1), np.prod(xi**power, axis=1), atol=1e-14)


@every_kind
def test_gradient_is_the_complex_step_derivative_of_the_shape(kind):
    d = kind.nodes.shape[1]
    xi = np.random.default_rng(1).uniform(0, 0.3, (5, d))
    for i in range(d):
        step = np.where(np.arange(d) == i, 1e-30j, 0)
        assert np.allclose(kind.gradient(xi)[:, :, i], kind.shape(xi + step).imag / 1e-30, atol=1e-14)


@every_kind
def test_gradients_of_one_point_are_those_of_many(kind):
    np.testing.assert_array_equal(kind.gradient(kind.centre), kind.gradient(np.tile(kind.centre, (3, 1)))[:1])


@pytest.mark.parametrize("kind", ELEMENTS, ids=lambda kind: kind.name)
def test_mid_side_nodes_lie_between_the_corners_that_vtk_says(kind):
    x, solid = kind.nodes, SOLIDS[kind.name]
    assert kind.corners == len(solid.corners)
    for node, (a, b) in zip(x[kind.corners :], solid.edges, strict=True):
        np.testing.assert_array_equal(node, 0.5 * (x[a] + x[b]))


@pytest.mark.parametrize("kind", ELEMENTS, ids=lambda kind: kind.name)
def test_the_mirrored_element_is_the_mirror_image_and_mirrored_twice_the_same(kind):
    """Some reflection of the reference element takes every node to that of the mirrored order."""
    order = np.array(kind.mirrored)
    np.testing.assert_array_equal(order[order], np.arange(len(kind.nodes)))
    linear = np.linalg.lstsq(np.column_stack([kind.nodes, np.ones(len(order))]), kind.nodes[order], rcond=None)[0]
    np.testing.assert_allclose(np.column_stack([kind.nodes, np.ones(len(order))]) @ linear, kind.nodes[order], atol=1e-14)
    assert np.linalg.det(linear[:3]) == pytest.approx(-1.0)


def test_edges_follow_vtk():
    """Mid-side nodes as VTK documents them for its quadratic cells, read from VTK itself."""
    import pyvista
    from vtkmodules.vtkCommonDataModel import vtkQuadraticHexahedron, vtkQuadraticTetra, vtkQuadraticWedge

    del pyvista
    for kind, cell in ((TET10, vtkQuadraticTetra()), (HEX20, vtkQuadraticHexahedron()), (WEDGE15, vtkQuadraticWedge())):
        parametric = np.reshape([cell.GetParametricCoords()[i] for i in range(3 * cell.GetNumberOfPoints())], (-1, 3))
        if kind is HEX20:
            parametric = 2 * parametric - 1
        if kind is WEDGE15:
            parametric = parametric * [1, 1, 2] - [0, 0, 1]
        assert np.allclose(parametric, kind.nodes)


def simplex_moment(power):
    """∫ Π ξᵢ^pᵢ over the unit simplex = Π pᵢ! / (Σ pᵢ + d)!"""
    return np.prod([factorial(p) for p in power]) / factorial(sum(power) + len(power))


def line_moment(power):
    return (1 + (-1) ** power) / (power + 1)


@pytest.mark.parametrize(
    ("rule", "degree"),
    [(TET4.stiffness, 0), (TET4.mass, 2), (TET10.stiffness, 2), (TET10.mass, 4), (TRI3.mass, 2), (TRI6.mass, 4)],
)
def test_simplex_rules_reach_the_degree_that_exactness_needs(rule, degree):
    xi, w = rule
    assert np.all(w > 0)
    for power in np.ndindex(*[degree + 1] * xi.shape[1]):
        if sum(power) <= degree:
            assert w @ np.prod(xi**power, axis=1) == pytest.approx(simplex_moment(power), abs=1e-15)


@pytest.mark.parametrize(("kind", "degree"), [(HEX8, 2), (HEX20, 4), (QUAD4, 2), (QUAD8, 4)])
def test_product_rules_reach_the_degree_that_exactness_needs(kind, degree):
    xi, w = kind.stiffness
    assert np.all(w > 0)
    for power in np.ndindex(*[degree + 1] * xi.shape[1]):
        assert w @ np.prod(xi**power, axis=1) == pytest.approx(np.prod([line_moment(p) for p in power]), abs=1e-14)


@pytest.mark.parametrize(("kind", "degree"), [(WEDGE6, 2), (WEDGE15, 4)])
def test_wedge_rules_reach_the_degree_that_exactness_needs(kind, degree):
    xi, w = kind.stiffness
    assert np.all(w > 0)
    for a, b, c in np.ndindex(degree + 1, degree + 1, degree + 1):
        if a + b <= degree:
            exact = simplex_moment((a, b)) * line_moment(c)
            assert w @ (xi[:, 0] ** a * xi[:, 1] ** b * xi[:, 2] ** c) == pytest.approx(exact, abs=1e-15)


@every_kind
def test_centre_is_the_centroid_of_the_reference_domain(kind):
    xi, w = kind.mass
    assert np.allclose(kind.centre, w @ xi / w.sum(), atol=1e-15)


def test_bubbles_have_zero_mean_gradient():
    xi, w = HEX8.stiffness
    assert np.allclose(np.einsum("q,qid->id", w, HEX8.bubble_gradient(xi)), 0, atol=1e-15)


def test_unknown_kind_is_the_users_error():
    with pytest.raises(DeckError, match="'hex27' is not supported") as caught:
        kind_of("hex27")
    assert "hex20" in caught.value.remedy


def test_an_element_that_no_program_has_takes_nothing_from_the_readers():
    """In a process of its own: readers make their tables when they are imported."""
    asked = """
from dataclasses import replace
from strainsight.mesh import kinds
own = replace(kinds.PYRA5, name="own", nastran="", gmsh=0, abaqus={}, meshio={})
kinds.ELEMENTS = (*kinds.ELEMENTS, own)
from strainsight.decks.abaqus import cells
from strainsight.decks.gmsh import elements
from strainsight.decks.nastran import solids
from strainsight.decks.other import mesh
tables = cells.SOLIDS, elements.KINDS, solids.SOLIDS, mesh.KINDS
print(*map(len, tables), *("" in table or 0 in table for table in tables), cells.USUAL.count("C3D"))
"""
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    names = zip(*((solid.abaqus, solid.gmsh, solid.nastran) for solid in SOLIDS.values()), strict=True)
    types, numbers, cards = (len(set(own) - {"", 0}) for own in names)
    found = done.stdout.split()
    assert int(found[0]) >= types
    assert found[1:3] == [str(numbers), str(cards)]
    assert found[4:] == ["False"] * 4 + [str(types)]

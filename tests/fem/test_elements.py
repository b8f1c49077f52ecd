"""Shape functions and quadrature rules are what their definitions say."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.elements import (
    FACET_KINDS,
    REFERENCE_NODES,
    SOLID_KINDS,
    bubble_gradient,
    centre,
    shape,
    shape_gradient,
)
from strainsight.fem.quadrature import quadrature

KINDS = SOLID_KINDS + FACET_KINDS
# what degree of polynomial a kind must reproduce in each coordinate system
QUADRATIC = ("tet10", "hex20", "wedge15", "tri6", "quad8")


@pytest.mark.parametrize("kind", KINDS)
def test_shape_function_is_one_at_its_node_and_zero_at_the_others(kind):
    nodes = REFERENCE_NODES[kind]
    assert np.allclose(shape(kind, nodes), np.eye(len(nodes)), atol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_polynomials_of_the_elements_degree_are_reproduced(kind):
    nodes, xi = REFERENCE_NODES[kind], np.random.default_rng(0).uniform(0, 0.3, (7, REFERENCE_NODES[kind].shape[1]))
    degree = 2 if kind in QUADRATIC else 1
    powers = [p for p in np.ndindex(*[degree + 1] * nodes.shape[1]) if sum(p) <= degree]
    for power in powers:
        assert np.allclose(shape(kind, xi) @ np.prod(nodes**power, axis=1), np.prod(xi**power, axis=1), atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_gradient_is_the_complex_step_derivative_of_the_shape(kind):
    d = REFERENCE_NODES[kind].shape[1]
    xi = np.random.default_rng(1).uniform(0, 0.3, (5, d))
    for i in range(d):
        step = np.where(np.arange(d) == i, 1e-30j, 0)
        assert np.allclose(shape_gradient(kind, xi)[:, :, i], shape(kind, xi + step).imag / 1e-30, atol=1e-14)


def test_edges_follow_vtk():
    """Mid-side nodes as VTK documents them for its quadratic cells, read from VTK itself."""
    import pyvista
    from vtkmodules.vtkCommonDataModel import vtkQuadraticHexahedron, vtkQuadraticTetra, vtkQuadraticWedge

    del pyvista
    for kind, cell in (
        ("tet10", vtkQuadraticTetra()),
        ("hex20", vtkQuadraticHexahedron()),
        ("wedge15", vtkQuadraticWedge()),
    ):
        parametric = np.reshape([cell.GetParametricCoords()[i] for i in range(3 * cell.GetNumberOfPoints())], (-1, 3))
        if kind == "hex20":
            parametric = 2 * parametric - 1
        if kind == "wedge15":
            parametric = parametric * [1, 1, 2] - [0, 0, 1]
        assert np.allclose(parametric, REFERENCE_NODES[kind])


def simplex_moment(power):
    """∫ Π ξᵢ^pᵢ over the unit simplex = Π pᵢ! / (Σ pᵢ + d)!"""
    return np.prod([factorial(p) for p in power]) / factorial(sum(power) + len(power))


def line_moment(power):
    return (1 + (-1) ** power) / (power + 1)


@pytest.mark.parametrize(
    ("kind", "purpose", "degree"),
    [
        ("tet4", "stiffness", 0),
        ("tet4", "mass", 2),
        ("tet10", "stiffness", 2),
        ("tet10", "mass", 4),
        ("tri3", "mass", 2),
        ("tri6", "mass", 4),
    ],
)
def test_simplex_rules_reach_the_degree_that_exactness_needs(kind, purpose, degree):
    xi, w = quadrature(kind, purpose)
    assert np.all(w > 0)
    for power in np.ndindex(*[degree + 1] * xi.shape[1]):
        if sum(power) <= degree:
            assert w @ np.prod(xi**power, axis=1) == pytest.approx(simplex_moment(power), abs=1e-15)


@pytest.mark.parametrize(("kind", "degree"), [("hex8", 2), ("hex20", 4), ("quad4", 2), ("quad8", 4)])
def test_product_rules_reach_the_degree_that_exactness_needs(kind, degree):
    xi, w = quadrature(kind)
    assert np.all(w > 0)
    for power in np.ndindex(*[degree + 1] * xi.shape[1]):
        assert w @ np.prod(xi**power, axis=1) == pytest.approx(np.prod([line_moment(p) for p in power]), abs=1e-14)


@pytest.mark.parametrize(("kind", "degree"), [("wedge6", 2), ("wedge15", 4)])
def test_wedge_rules_reach_the_degree_that_exactness_needs(kind, degree):
    xi, w = quadrature(kind)
    assert np.all(w > 0)
    for a, b, c in np.ndindex(degree + 1, degree + 1, degree + 1):
        if a + b <= degree:
            exact = simplex_moment((a, b)) * line_moment(c)
            assert w @ (xi[:, 0] ** a * xi[:, 1] ** b * xi[:, 2] ** c) == pytest.approx(exact, abs=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_centre_is_the_centroid_of_the_reference_domain(kind):
    xi, w = quadrature(kind, "mass")
    assert np.allclose(centre(kind), w @ xi / w.sum(), atol=1e-15)


def test_bubbles_have_zero_mean_gradient():
    xi, w = quadrature("hex8")
    assert np.allclose(np.einsum("q,qid->id", w, bubble_gradient(xi)), 0, atol=1e-15)


def test_unknown_kind_is_the_users_error():
    with pytest.raises(DeckError, match="pyramid5"):
        shape("pyramid5", np.zeros((1, 3)))

"""Shape functions, quadrature rules and facets of every element."""

from __future__ import annotations

from itertools import combinations
from math import factorial

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.kinds import ELEMENTS, FACETS
from strainsight.mesh.kinds.kind import QUAD4, QUAD8, TRI3, TRI6
from strainsight.mesh.kinds.solids import HEX8, HEX20, TET4, TET10, WEDGE6, WEDGE15
from strainsight.mesh.model import CellBlock, Mesh

from ..refusals import expect_refusal
from ..solids import HEX, SOLIDS

# Shape functions and quadrature rules are what their definitions say.
every_kind = pytest.mark.parametrize("kind", ELEMENTS + FACETS, ids=lambda kind: kind.name)


def test_every_element_kind_is_tested():
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


@pytest.mark.parametrize("kind", ELEMENTS, ids=lambda kind: kind.name)
def test_mid_side_nodes_follow_vtk_edges(kind):
    x, solid = kind.nodes, SOLIDS[kind.name]
    assert kind.corners == len(solid.corners)
    for node, (a, b) in zip(x[kind.corners :], solid.edges, strict=True):
        np.testing.assert_array_equal(node, 0.5 * (x[a] + x[b]))


@pytest.mark.parametrize("kind", ELEMENTS, ids=lambda kind: kind.name)
def test_the_mirrored_element_is_the_mirror_image_and_mirrored_twice_the_same(kind):
    order = np.array(kind.mirrored)
    np.testing.assert_array_equal(order[order], np.arange(len(kind.nodes)))
    linear = np.linalg.lstsq(np.column_stack([kind.nodes, np.ones(len(order))]), kind.nodes[order], rcond=None)[0]
    np.testing.assert_allclose(np.column_stack([kind.nodes, np.ones(len(order))]) @ linear, kind.nodes[order], atol=1e-14)
    assert np.linalg.det(linear[:3]) == pytest.approx(-1.0)


def simplex_moment(power):
    """∫ Π ξᵢ^pᵢ over the unit simplex = Π pᵢ! / (Σ pᵢ + d)!"""
    return np.prod([factorial(p) for p in power]) / factorial(sum(power) + len(power))


def line_moment(power):
    return (1 + (-1) ** power) / (power + 1)


SIMPLEX = {TET4: 3, TET10: 3, TRI3: 2, TRI6: 2, WEDGE6: 2, WEDGE15: 2}
"""Of how many coordinates the reference domain is a simplex; of the others it is a line each."""
STIFFNESS = [(TET4, 0), (TET10, 2), (HEX8, 2), (HEX20, 4), (QUAD4, 2), (QUAD8, 4), (WEDGE6, 2), (WEDGE15, 4)]
MASS = [(TET4, 2), (TET10, 4), (TRI3, 2), (TRI6, 4)]


@pytest.mark.parametrize(
    ("kind", "rule", "degree"),
    [*((kind, kind.stiffness, degree) for kind, degree in STIFFNESS), *((kind, kind.mass, degree) for kind, degree in MASS)],
)
def test_rules_reach_the_degree_that_exactness_needs(kind, rule, degree):
    (xi, w), n = rule, SIMPLEX.get(kind, 0)
    assert np.all(w > 0)
    for power in np.ndindex(*[degree + 1] * xi.shape[1]):
        if sum(power[:n]) <= degree:
            exact = simplex_moment(power[:n]) * np.prod([line_moment(p) for p in power[n:]])
            assert w @ np.prod(xi**power, axis=1) == pytest.approx(exact, abs=1e-15 if n else 1e-14)


@every_kind
def test_centre_is_the_centroid_of_the_reference_domain(kind):
    xi, w = kind.mass
    assert np.allclose(kind.centre, w @ xi / w.sum(), atol=1e-15)


def test_bubbles_have_zero_mean_gradient():
    xi, w = HEX8.stiffness
    assert np.allclose(np.einsum("q,qid->id", w, HEX8.bubble_gradient(xi)), 0, atol=1e-15)


# Facets close the volume: ∮ x·n dA = 3 V on the isoparametric surface with normals outward, however distorted.
def rule(kind):
    """Gauss points of high degree on the reference domain of a facet or solid, collapsed on simplices; of pyramids none."""
    x, w = np.polynomial.legendre.leggauss(7)
    u, v, d = (x + 1) / 2, w / 2, kind.nodes.shape[1]
    if kind.name.startswith(("quad", "hex")):
        grid, weight = np.meshgrid(*[x] * d, indexing="ij"), np.meshgrid(*[w] * d, indexing="ij")
        return np.stack([g.ravel() for g in grid], 1), np.prod([g.ravel() for g in weight], axis=0)
    a, b = (g.ravel() for g in np.meshgrid(u, u, indexing="ij"))
    triangle, weight = np.column_stack([a, b * (1 - a)]), np.outer(v, v).ravel() * (1 - a)
    if kind.name.startswith("tri"):
        return triangle, weight
    if kind.name.startswith("wedge"):
        points = np.column_stack([np.repeat(triangle, len(x), axis=0), np.tile(x, len(triangle))])
        return points, np.outer(weight, w).ravel()
    assert kind.name.startswith("tet"), f"no rule here for {kind.name}"
    c = np.repeat(u, len(triangle))
    points = np.column_stack([np.tile(triangle, (len(u), 1)) * (1 - c)[:, None], c])
    return points, np.outer(v, weight).ravel() * (1 - c) ** 2


def volume(kind, x):
    if kind.name == "pyra5":  # the hexahedron whose upper facet has shrunk to a point
        return volume(HEX8, x[[0, 1, 2, 3, 4, 4, 4, 4]])
    xi, w = rule(kind)
    return np.sum(w * np.linalg.det(np.einsum("qkd,ki->qid", kind.gradient(xi), x)))


def surface(kind, x):
    """∮ x·n dA and the area vector of a facet."""
    xi, w = rule(kind)
    tangents = np.einsum("qkd,ki->qid", kind.gradient(xi), x)
    normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    return np.sum(w * np.sum((kind.shape(xi) @ x) * normal, axis=1)), w @ normal


def one_element(kind, x):
    k = len(x)
    block = CellBlock(kind, np.array([7]), np.arange(k)[None], np.array([3]))
    return Mesh(np.arange(1, k + 1), x, (block,))


@pytest.mark.parametrize("kind", ELEMENTS, ids=lambda kind: kind.name)
def test_facets_of_a_distorted_element_enclose_its_volume(kind):
    rng = np.random.default_rng(0)
    stretch = np.eye(3) + 0.2 * rng.standard_normal((3, 3))
    x = (kind.nodes + 0.04 * rng.standard_normal(kind.nodes.shape)) @ stretch + [5.0, -3.0, 2.0]
    assert np.linalg.det(stretch) > 0
    facets = exterior_facets(one_element(kind.name, x))
    assert len(facets.facet) == len(kind.facets)
    flux, closed = 0.0, np.zeros(3)
    for code, nodes in zip(facets.kind, facets.nodes, strict=True):
        part, vector = surface(FACETS[code], x[nodes[nodes >= 0]])
        flux, closed = flux + part, closed + vector
    assert flux / 3 == pytest.approx(volume(kind, x), rel=1e-11)
    np.testing.assert_allclose(closed, 0, atol=1e-12)


def test_a_wedge_meets_tetrahedron_and_hexahedron_on_common_corners():
    x = np.array([*HEX, (3, 0, 0), (3, 1, 0), (0, -3, 0)], dtype=float)
    blocks = (
        CellBlock("hex8", np.array([1]), np.arange(8)[None], np.array([1])),
        CellBlock("wedge6", np.array([2]), np.array([[1, 8, 5, 2, 9, 6]]), np.array([1])),
        CellBlock("tet4", np.array([3]), np.array([[1, 5, 8, 10]]), np.array([1])),
    )
    facets = exterior_facets(Mesh(np.arange(11), x, blocks))
    expected = {(1, n) for n in (1, 2, 3, 5, 6)} | {(2, n) for n in (2, 3, 4)} | {(3, n) for n in (2, 3, 4)}
    assert set(zip(facets.element_id.tolist(), facets.facet.tolist(), strict=True)) == expected


def tetrahedra(*connectivity, kind="tet4", points=6):
    block = CellBlock(
        kind, np.arange(1, len(connectivity) + 1), np.array(connectivity), np.ones(len(connectivity), int)
    )
    return Mesh(np.arange(points), np.zeros((points, 3)), (block,))


def test_three_elements_on_one_facet_are_refused():
    with pytest.raises(DeckError, match="elements 1, 2, 3 share the same facet"):
        exterior_facets(tetrahedra((0, 1, 2, 3), (0, 1, 2, 4), (0, 1, 2, 5)))


def test_mid_side_nodes_that_are_not_merged_are_refused():
    with pytest.raises(DeckError, match="not its mid-side nodes"):
        exterior_facets(tetrahedra(range(10), (0, 2, 1, 10, 11, 12, 13, 14, 15, 16), kind="tet10", points=17))


def test_linear_next_to_quadratic_elements_is_refused():
    mesh = tetrahedra(range(10), kind="tet10", points=11)
    linear = CellBlock("tet4", np.array([2]), np.array([[0, 2, 1, 10]]), np.array([1]))
    mixed = Mesh(mesh.node_ids, mesh.position, (*mesh.blocks, linear), mesh.fixed)
    with expect_refusal(DeckError, "elements 1 and 2", remedy="same order"):
        exterior_facets(mixed)


def test_the_surface_of_random_tetrahedra_is_found_as_by_counting():
    rng = np.random.default_rng(4)
    from scipy.spatial import Delaunay

    cells = Delaunay(rng.random((60, 3))).simplices
    facets = exterior_facets(tetrahedra(*cells, points=60))
    count = {}
    for cell in cells:
        for three in combinations(sorted(int(i) for i in cell), 3):
            count[three] = count.get(three, 0) + 1
    found = {tuple(sorted(nodes[:3].tolist())) for nodes in facets.nodes}
    assert found == {three for three, times in count.items() if times == 1}

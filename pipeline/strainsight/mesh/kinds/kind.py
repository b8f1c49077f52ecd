"""Definition of a kind of facet or element in one record; and the facets: triangles and quadrangles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from itertools import permutations
from typing import Any

import numpy as np

from strainsight.mesh.model import FloatArray, IntArray

Edges = tuple[tuple[int, int], ...]
Order = tuple[int, ...]
"""Node a of ours is node order[a] of another numbering; () if the two agree."""
Rule = tuple[FloatArray, FloatArray]
"""∫ f dξ ≈ Σ w_q f(ξ_q): points (q, d) [-] and positive weights (q,) [-] whose sum is the measure of the domain."""
Split = tuple[tuple[str, FloatArray], ...]
"""Name of the kind and corners (c, d) [-] of each part."""
Values = tuple[FloatArray, FloatArray]
"""Shape functions: N_a (q, k) [-] and ∂N_a/∂ξ_d (q, k, d) [-]."""

HYBRID = "the pressure degree of freedom of the hybrid element is omitted"


@dataclass(frozen=True, eq=False, kw_only=True)
class Kind:
    """A facet, and the common part of elements; nodes in VTK order.

    nodes (k, d) [-] of the reference domain, corners first; edges: the corners between which each mid-side node lies; centre
    (d,) [-], the centroid; functions: ξ (q, d) [-] → N_a (q, k) and ∂N_a/∂ξ_d (q, k, d), with N_a(ξ_b) = δ_ab; stiffness,
    mass: rules that integrate ∇N ∇Nᵀ and N Nᵀ exactly for a constant Jacobian; vtk: number of the VTK cell; split: the parts
    of a subdivision at the middle of its edges, in the reference domain; read_at: points (r, 2) whose strain is interpolated
    over the facet, bilinearly from four; empty if the strain is evaluated at every point itself. read_along: for triangles the
    side of the strain at each of nine points, 0 and 1 from the first corner to the second and third, 2 between these; it is
    interpolated linearly from the three points of a side.
    Reference domains: simplices 0 ≤ ξᵢ, Σξᵢ ≤ 1; squares and cubes [−1, 1]ᵈ; wedges triangle × [−1, 1]; pyramids
    |ξ|, |η| ≤ 1 − ζ, 0 ≤ ζ."""

    name: str
    nodes: FloatArray
    edges: Edges = ()
    centre: FloatArray
    functions: Callable[[FloatArray], Values]
    stiffness: Rule
    mass: Rule
    vtk: int
    split: Split
    read_at: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    read_along: Order = ()

    @property
    def corners(self) -> int:
        """Number of corner nodes."""
        return len(self.nodes) - len(self.edges)

    def shape(self, xi: FloatArray) -> FloatArray:
        """Shape functions N_a(ξ): xi (q, d) [-] → (q, k) [-]."""
        return self.functions(np.atleast_2d(xi))[0]

    def reading(self, xi: FloatArray) -> FloatArray:
        """Weights (q, r) of the strains at `read_at` for the strain at xi (q, 2)."""
        size = 3 if self.read_along else 4
        groups = self.read_at.reshape(-1, size, 2)
        return np.hstack([_bilinear(xi, size) @ np.linalg.inv(_bilinear(points, size)) for points in groups])

    def gradient(self, xi: FloatArray) -> FloatArray:
        """∂N_a/∂ξ_d: xi (q, d) [-] → (q, k, d) [-]."""
        return self.functions(np.atleast_2d(xi))[1]


@dataclass(frozen=True, eq=False, kw_only=True)
class ElementKind(Kind):
    """A solid.

    family: name in messages, "tetrahedra"; facets: kind and local nodes of each, normal outward, in the order of S1, S2, … of
    Abaqus; sides: a corner and its three neighbours, right-handed; regular: |J| there over the product of the three sides, in
    the regular element; mirrored: node order of the same element in the opposite direction about its axis; either_way: files
    of every program use both directions; bubble_gradient: ξ (q, 3) → ∂P_i/∂ξ_d (q, p, 3) of incompatible modes, condensed in
    each element. nastran: the card; gmsh: the number of the type; abaqus: types in VTK order → how each is reinterpreted;
    meshio: names of the cell → order of its nodes; orders: formats whose order meshio does not convert. A program without such
    an element is left out."""

    family: str
    facets: tuple[tuple[Kind, Order], ...]
    sides: tuple[tuple[int, int, int, int], ...]
    regular: float
    mirrored: Order
    either_way: bool = False
    bubble_gradient: Callable[[FloatArray], FloatArray] | None = None
    nastran: str = ""
    nastran_order: Order = ()
    gmsh: int = 0
    gmsh_order: Order = ()
    abaqus: Mapping[str, str] = field(default_factory=dict)
    meshio: Mapping[str, Order] = field(default_factory=dict)
    orders: Mapping[str, Order] = field(default_factory=dict)


def _bilinear(xi: FloatArray, terms: int) -> FloatArray:
    """(q, terms): 1, ξ, η and, for four, ξη."""
    return np.column_stack([np.ones(len(xi)), xi, xi[:, 0] * xi[:, 1]])[:, :terms]


def halves(corners: FloatArray) -> tuple[FloatArray, ...]:
    """The domain at half its size, moved to each of its corners (c, d)."""
    return tuple(0.5 * (corner + corners) for corner in corners)


def of_same_kind(name: str, parts: Iterable[FloatArray]) -> Split:
    """Parts that all have the same kind."""
    return tuple((name, part) for part in parts)


def with_midsides(corners: FloatArray, edges: Edges) -> FloatArray:
    """The corners (c, d), and a node in the middle of each edge."""
    return np.vstack([corners, *(0.5 * (corners[[a]] + corners[[b]]) for a, b in edges)])


def with_edge_nodes(corners: Order, edges: Edges, along: Edges) -> Order:
    """Corners of an element, and the mid-side nodes of its edges between these corners."""
    place = {frozenset(edge): 1 + max(map(max, edges)) + i for i, edge in enumerate(edges)}
    return (*corners, *(place[frozenset((corners[a], corners[b]))] for a, b in along))


def in_order(nodes: IntArray, order: Order) -> IntArray:
    """Nodes (n, k) of elements, with columns in the given order."""
    return nodes[:, list(order)] if order else nodes


def barycentric(xi: FloatArray) -> Values:
    """L₀ = 1 − Σξᵢ, Lᵢ = ξᵢ."""
    q, d = xi.shape
    L = np.column_stack([1.0 - xi.sum(axis=1), xi])
    return L, np.broadcast_to(np.vstack([-np.ones(d), np.eye(d)]), (q, d + 1, d)).copy()


def quadratic_simplex(xi: FloatArray, edges: Edges) -> Values:
    """Corners L(2L − 1), mid-sides 4 L_a L_b."""
    L, dL = barycentric(xi)
    a, b = np.transpose(edges)
    N = np.concatenate([L * (2 * L - 1), 4 * L[:, a] * L[:, b]], axis=1)
    dN = np.concatenate(
        [(4 * L - 1)[..., None] * dL, 4 * (L[:, a, None] * dL[:, b] + L[:, b, None] * dL[:, a])], axis=1
    )
    return N, dN


def multilinear(xi: FloatArray, nodes: FloatArray) -> Values:
    """Π ½(1 + ξ_d ξ_ad)."""
    return _product(*_linear_factors(xi, nodes))


def serendipity(xi: FloatArray, nodes: FloatArray) -> Values:
    """Corners Π ½(1 + ξ_d ξ_ad) (Σ ξ_d ξ_ad − (d − 1)); mid-sides (1 − ξ_m²) Π_{d≠m} ½(1 + ξ_d ξ_ad)."""
    d = nodes.shape[1]
    factor, slope = _linear_factors(xi, nodes)
    along = nodes == 0.0
    bubble = np.broadcast_to(1 - xi[:, None, :] ** 2, factor.shape)
    bubble_slope = np.broadcast_to(-2 * xi[:, None, :], factor.shape)
    N, dN = _product(np.where(along, bubble, factor), np.where(along, bubble_slope, slope))
    corner = ~along.any(axis=1)
    tail = (xi @ nodes[corner].T) - (d - 1)
    dN[:, corner] = dN[:, corner] * tail[..., None] + N[:, corner, None] * nodes[corner]
    N[:, corner] *= tail
    return N, dN


def _linear_factors(xi: FloatArray, nodes: FloatArray) -> Values:
    """½(1 + ξ_d ξ_ad) and its slope, (q, k, d) each."""
    return 0.5 * (1 + xi[:, None, :] * nodes), np.broadcast_to(0.5 * nodes, (len(xi), *nodes.shape))


def _product(factor: FloatArray, slope: FloatArray) -> Values:
    """Π_d f_d and its gradient, f and f′ (q, k, d)."""
    f, df = np.moveaxis(factor, 2, 0), np.moveaxis(slope, 2, 0)
    gradient = [reduce(np.multiply, [df[j] if j == i else f[j] for j in range(len(f))]) for i in range(len(f))]
    return reduce(np.multiply, f), np.stack(gradient, axis=2)


def gauss(points: int, d: int) -> Rule:
    """Gauss-Legendre product rule on [−1, 1]ᵈ, exact for degree 2·points − 1 in each direction."""
    x, w = np.polynomial.legendre.leggauss(points)
    grid = np.stack(np.meshgrid(*[x] * d, indexing="ij"), axis=-1).reshape(-1, d)
    return grid, np.prod(np.stack(np.meshgrid(*[w] * d, indexing="ij"), axis=-1), axis=-1).ravel()


def orbits(size: int, orbits: list[tuple[tuple[float, ...], float]]) -> Rule:
    """All distinct permutations of barycentric points (one coordinate dropped) with their weights."""
    points, weights = [], []
    for point, weight in orbits:
        for permuted in sorted(set(permutations(point))):
            points.append(permuted[1:])
            weights.append(weight)
    return np.array(points).reshape(-1, size), np.array(weights)


def triangle(degree: int) -> Rule:
    """Symmetric rules of Dunavant (1985) of degree 2 and 4 on the unit triangle, in closed form."""
    if degree == 2:
        return orbits(2, [((1 / 6, 1 / 6, 2 / 3), 1 / 6)])
    root = np.sqrt(38 - 44 * np.sqrt(2 / 5))
    spread = np.sqrt(213125 - 53320 * np.sqrt(10))
    a, wa = (8 - np.sqrt(10) + root) / 18, (620 + spread) / 3720
    b, wb = (8 - np.sqrt(10) - root) / 18, (620 - spread) / 3720
    return orbits(2, [((a, a, 1 - 2 * a), wa / 2), ((b, b, 1 - 2 * b), wb / 2)])


TRIANGLE_CORNERS = np.vstack([np.zeros(2), np.eye(2)])
TRIANGLE_EDGES = ((0, 1), (1, 2), (2, 0))
TRIANGLE_CENTRE = np.full(2, 1 / 3)
TRIANGLE_PARTS = (*halves(TRIANGLE_CORNERS), np.array([[0.5, 0.5], [0.0, 0.5], [0.5, 0.0]]))

TRI3 = Kind(
    name="tri3",
    nodes=TRIANGLE_CORNERS,
    centre=TRIANGLE_CENTRE,
    functions=barycentric,
    stiffness=triangle(2),
    mass=triangle(2),
    vtk=5,
    split=of_same_kind("tri3", TRIANGLE_PARTS),
)
TRI6 = Kind(
    name="tri6",
    nodes=with_midsides(TRIANGLE_CORNERS, TRIANGLE_EDGES),
    edges=TRIANGLE_EDGES,
    centre=TRIANGLE_CENTRE,
    functions=partial(quadratic_simplex, edges=TRIANGLE_EDGES),
    stiffness=triangle(4),
    mass=triangle(4),
    vtk=22,
    split=of_same_kind("tri6", TRIANGLE_PARTS),
)
FIRST, SECOND = 0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)
"""Gauss points on 0 … 1."""
INSIDE = 1 / np.sqrt(3)
ALONG_SIDES = np.array(
    [
        *([FIRST, 0], [SECOND, 0], [FIRST, INSIDE]),
        *([0, FIRST], [0, SECOND], [INSIDE, FIRST]),
        *([SECOND, FIRST], [FIRST, SECOND], [FIRST, FIRST]),
    ]
)
"""Points where strain along the sides from the first corner to the second and third, and between these, is that of a curved
surface in bending (Lee & Bathe, Comput. Struct. 82 (2004) 945-962)."""
SHELL6 = replace(TRI6, name="shell6", read_at=ALONG_SIDES, read_along=(0, 0, 0, 1, 1, 1, 2, 2, 2))
"""Face of a second-order shell, see `SHELL8`."""


QUADRANGLE_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
QUADRANGLE_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0))
QUADRANGLE_NODES = with_midsides(QUADRANGLE_CORNERS, QUADRANGLE_EDGES)
QUADRANGLE_CENTRE = np.zeros(2)

QUAD4 = Kind(
    name="quad4",
    nodes=QUADRANGLE_CORNERS,
    centre=QUADRANGLE_CENTRE,
    functions=partial(multilinear, nodes=QUADRANGLE_CORNERS),
    stiffness=gauss(2, 2),
    mass=gauss(2, 2),
    vtk=9,
    split=of_same_kind("quad4", halves(QUADRANGLE_CORNERS)),
)
QUAD8 = Kind(
    name="quad8",
    nodes=QUADRANGLE_NODES,
    edges=QUADRANGLE_EDGES,
    centre=QUADRANGLE_CENTRE,
    functions=partial(serendipity, nodes=QUADRANGLE_NODES),
    stiffness=gauss(3, 2),
    mass=gauss(3, 2),
    vtk=23,
    split=of_same_kind("quad8", halves(QUADRANGLE_CORNERS)),
)
SHELL8 = replace(QUAD8, name="shell8", read_at=gauss(2, 2)[0])
"""Face of a second-order shell. A curved element bends without stretch only on average. Between nodes the strain of its
functions is off by up to h²/(12 R t) of the strain on its faces, and correct at the Gauss points (Barlow, Int. J. Numer.
Meth. Engng 10 (1976) 243-251)."""


SECOND_ORDER = {"tri3": TRI6, "quad4": QUAD8}
"""Facet of a first-order element → that of the second-order one."""


def second_order(
    linear: ElementKind, name: str, edges: Edges, functions: Callable[[FloatArray], Values], **entries: Any
) -> ElementKind:
    """The same element with a node in the middle of each edge; entries: rules, numbers and orders in other programs."""
    facets = [(SECOND_ORDER[facet.name], corners) for facet, corners in linear.facets]
    return replace(
        linear,
        name=name,
        nodes=with_midsides(linear.nodes, edges),
        edges=edges,
        functions=functions,
        facets=tuple((facet, with_edge_nodes(corners, edges, facet.edges)) for facet, corners in facets),
        mirrored=with_edge_nodes(linear.mirrored, edges, edges),
        split=of_same_kind(name, (part for _, part in linear.split)),
        **{"nastran_order": (), "gmsh_order": (), "orders": {}, "bubble_gradient": None} | entries,
    )

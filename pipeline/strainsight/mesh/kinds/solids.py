"""Solid elements: tetrahedra, hexahedra (linear ones with incompatible modes), wedges, and pyramids between them.

Nodes 0, 1, 2 of a wedge lie at ζ = −1, as in Nastran, gmsh and vtkWedge's own interpolation."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.special import roots_jacobi

from strainsight.mesh.kinds.kind import (
    HYBRID,
    QUAD4,
    QUADRANGLE_CORNERS,
    QUADRANGLE_EDGES,
    TRI3,
    TRIANGLE_CORNERS,
    TRIANGLE_EDGES,
    TRIANGLE_PARTS,
    ElementKind,
    Rule,
    Split,
    Values,
    barycentric,
    gauss,
    halves,
    multilinear,
    of_same_kind,
    orbits,
    quadratic_simplex,
    second_order,
    serendipity,
    triangle,
    with_edge_nodes,
    with_midsides,
)
from strainsight.mesh.model import FloatArray

TET_CORNERS = np.vstack([np.zeros(3), np.eye(3)])
TET_EDGES = (*TRIANGLE_EDGES, (0, 3), (1, 3), (2, 3))
TET_SIDES = ((0, 1, 2, 3), (1, 2, 0, 3), (2, 0, 1, 3), (3, 1, 0, 2))
TET_MIRRORED = (0, 2, 1, 3)


def _tetrahedron_parts() -> tuple[FloatArray, ...]:
    """Four at the corners, and the octahedron between them, cut along the middles of edges 02 and 13."""
    middle = {(a, b): 0.5 * (TET_CORNERS[a] + TET_CORNERS[b]) for a in range(4) for b in range(a + 1, 4)}
    ring = [middle[edge] for edge in ((0, 1), (1, 2), (2, 3), (0, 3))]
    between = [np.array([middle[0, 2], middle[1, 3], ring[i], ring[(i + 1) % 4]]) for i in range(4)]
    assert all(np.linalg.det(part[1:] - part[0]) > 0 for part in between)
    return (*halves(TET_CORNERS), *between)


TET_PARTS = _tetrahedron_parts()


def _tetrahedron_rule(degree: int) -> Rule:
    """Centroid rule, the four-point rule of degree 2, Walkington's (2000) fourteen points of degree 5."""
    if degree == 1:
        return np.full((1, 3), 0.25), np.array([1 / 6])
    if degree == 2:
        a = (5 - np.sqrt(5)) / 20
        return orbits(3, [((a, a, a, 1 - 3 * a), 1 / 24)])
    a, b, c = 0.31088591926330060980, 0.092735250310891226402, 0.045503704125649649492
    return orbits(
        3,
        [
            ((a, a, a, 1 - 3 * a), 0.11268792571801585080 / 6),
            ((b, b, b, 1 - 3 * b), 0.073493043116361949544 / 6),
            ((c, c, 0.5 - c, 0.5 - c), 0.042546020777081466438 / 6),
        ],
    )


TET4 = ElementKind(
    name="tet4",
    family="tetrahedra",
    nodes=TET_CORNERS,
    centre=np.full(3, 0.25),
    functions=barycentric,
    stiffness=_tetrahedron_rule(1),
    mass=_tetrahedron_rule(2),
    facets=((TRI3, (0, 2, 1)), (TRI3, (0, 1, 3)), (TRI3, (1, 2, 3)), (TRI3, (0, 3, 2))),
    sides=TET_SIDES,
    regular=0.5**0.5,
    mirrored=TET_MIRRORED,
    vtk=10,
    split=of_same_kind("tet4", TET_PARTS),
    nastran="CTETRA",
    gmsh=4,
    abaqus={"C3D4": "", "C3D4H": HYBRID},
    meshio={"tetra": ()},
)
TET10 = second_order(
    TET4,
    "tet10",
    TET_EDGES,
    partial(quadratic_simplex, edges=TET_EDGES),
    stiffness=_tetrahedron_rule(2),
    mass=_tetrahedron_rule(5),
    vtk=24,
    gmsh=11,
    gmsh_order=(0, 1, 2, 3, 4, 5, 6, 7, 9, 8),
    abaqus={
        "C3D10": "",
        "C3D10I": "same element as C3D10",
        "C3D10S": "same element as C3D10",
        "C3D10T": "same element as C3D10",
        "C3D10H": HYBRID,
        "C3D10HS": HYBRID,
        "C3D10M": "same element as C3D10; the modified formulation is omitted",
        "C3D10MH": f"same element as C3D10; the modified formulation is omitted; {HYBRID}",
    },
    meshio={"tetra10": ()},
)


HEX_CORNERS = np.vstack([np.column_stack([QUADRANGLE_CORNERS, np.full(4, level)]) for level in (-1.0, 1.0)])
HEX_EDGES = (*QUADRANGLE_EDGES, (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
HEX_NODES = with_midsides(HEX_CORNERS, HEX_EDGES)
HEX_SIDES = (
    *((0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7)),
    *((4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3)),
)
HEX_MIRRORED = (0, 3, 2, 1, 4, 7, 6, 5)
UPRIGHTS_SECOND = (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)
"""Mid-sides bottom, uprights, top (Nastran, Exodus); ours are bottom, top, uprights."""
_MODES = "the element has incompatible modes"
_REDUCED = "the element has incompatible modes and full integration, without hourglass control"


def bubble_gradient(xi: FloatArray) -> FloatArray:
    """∂P_i/∂ξ_d of the incompatible modes P_i = 1 − ξᵢ² (Wilson et al. 1973): xi (q, 3) → (q, 3, 3)."""
    return -2.0 * np.asarray(xi)[:, :, None] * np.eye(3)


HEX8 = ElementKind(
    name="hex8",
    family="hexahedra",
    nodes=HEX_CORNERS,
    centre=np.zeros(3),
    functions=partial(multilinear, nodes=HEX_CORNERS),
    stiffness=gauss(2, 3),
    mass=gauss(2, 3),
    bubble_gradient=bubble_gradient,
    facets=(
        (QUAD4, (0, 3, 2, 1)),
        (QUAD4, (4, 5, 6, 7)),
        (QUAD4, (0, 1, 5, 4)),
        (QUAD4, (1, 2, 6, 5)),
        (QUAD4, (2, 3, 7, 6)),
        (QUAD4, (3, 0, 4, 7)),
    ),
    sides=HEX_SIDES,
    regular=1.0,
    mirrored=HEX_MIRRORED,
    vtk=12,
    split=of_same_kind("hex8", halves(HEX_CORNERS)),
    nastran="CHEXA",
    gmsh=5,
    abaqus={
        # largest difference on an example deck, as for C3D20R
        "C3D8": f"{_MODES}, as C3D8I; frequencies of coarse meshes differ from those of CalculiX by up to 18 %",
        "C3D8I": "",
        "C3D8S": f"{_MODES}, as C3D8I",
        "C3D8R": _REDUCED,
        "C3D8H": f"{_MODES}; {HYBRID}",
        "C3D8HS": f"{_MODES}; {HYBRID}",
        "C3D8IH": HYBRID,
        "C3D8RH": f"{_REDUCED}; {HYBRID}",
    },
    # a voxel is counted row by row
    meshio={"hexahedron": (), "voxel": (0, 1, 3, 2, 4, 5, 7, 6)},
)
HEX20 = second_order(
    HEX8,
    "hex20",
    HEX_EDGES,
    partial(serendipity, nodes=HEX_NODES),
    stiffness=gauss(3, 3),
    mass=gauss(3, 3),
    vtk=25,
    nastran_order=UPRIGHTS_SECOND,
    gmsh=17,
    # mid-sides by ascending ends of the edges
    gmsh_order=(*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
    abaqus={
        "C3D20": "",
        "C3D20R": "the element has full integration; frequencies of coarse meshes differ from those of CalculiX by up to 17 %",
        "C3D20H": HYBRID,
        "C3D20RH": f"the element has full integration; {HYBRID}",
    },
    meshio={"hexahedron20": ()},
    orders={"exodus": UPRIGHTS_SECOND},
)


WEDGE_CORNERS = np.vstack([np.column_stack([TRIANGLE_CORNERS, np.full(3, level)]) for level in (-1.0, 1.0)])
WEDGE_EDGES = (*TRIANGLE_EDGES, (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
WEDGE_CENTRE = np.array([1 / 3, 1 / 3, 0.0])
WEDGE_SIDES = ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5), (3, 5, 4, 0), (4, 3, 5, 1), (5, 4, 3, 2))
WEDGE_MIRRORED = (0, 2, 1, 3, 5, 4)
WEDGE_PARTS = tuple(
    np.vstack([np.column_stack([part, np.full(3, level)]) for level in (low, low + 1)])
    for low in (-1.0, 0.0)
    for part in TRIANGLE_PARTS
)


def wedge_linear(xi: FloatArray) -> Values:
    """L_a ½(1 ± ζ)."""
    L, dL = barycentric(xi[:, :2])
    z = xi[:, 2, None]
    N = np.concatenate([L * (1 - z) / 2, L * (1 + z) / 2], axis=1)
    plane = np.concatenate([dL * (1 - z)[..., None] / 2, dL * (1 + z)[..., None] / 2], axis=1)
    return N, np.concatenate([plane, np.concatenate([-L / 2, L / 2], axis=1)[..., None]], axis=2)


def wedge_quadratic(xi: FloatArray) -> Values:
    """Corners ½L[(2L − 1)(1 ± ζ) − (1 − ζ²)], triangle mid-sides 2 L_a L_b (1 ± ζ), uprights L(1 − ζ²)."""
    L, dL = barycentric(xi[:, :2])
    z = xi[:, 2, None]
    a, b = np.transpose(TRIANGLE_EDGES)
    pair, dpair = L[:, a] * L[:, b], L[:, a, None] * dL[:, b] + L[:, b, None] * dL[:, a]
    N, plane, upright = [], [], []
    for sign in (-1.0, 1.0):
        end = 1 + sign * z
        N.append(0.5 * L * ((2 * L - 1) * end - (1 - z**2)))
        plane.append((0.5 * ((4 * L - 1) * end - (1 - z**2)))[..., None] * dL)
        upright.append(0.5 * L * ((2 * L - 1) * sign + 2 * z))
    for sign in (-1.0, 1.0):
        N.append(2 * pair * (1 + sign * z))
        plane.append(2 * dpair * (1 + sign * z)[..., None])
        upright.append(2 * pair * sign)
    N.append(L * (1 - z**2))
    plane.append(dL * (1 - z**2)[..., None])
    upright.append(-2 * z * L)
    gradient = np.concatenate([np.concatenate(plane, axis=1), np.concatenate(upright, axis=1)[..., None]], axis=2)
    return np.concatenate(N, axis=1), gradient


def _wedge_rule(degree: int, points: int) -> Rule:
    plane, weight = triangle(degree)
    z, wz = gauss(points, 1)
    return (
        np.column_stack([np.tile(plane, (len(z), 1)), np.repeat(z[:, 0], len(plane))]),
        np.outer(wz, weight).ravel(),
    )


WEDGE6 = ElementKind(
    name="wedge6",
    family="wedges",
    nodes=WEDGE_CORNERS,
    centre=WEDGE_CENTRE,
    functions=wedge_linear,
    stiffness=_wedge_rule(2, 2),
    mass=_wedge_rule(2, 2),
    facets=((TRI3, (0, 2, 1)), (TRI3, (3, 4, 5)), (QUAD4, (0, 1, 4, 3)), (QUAD4, (1, 2, 5, 4)), (QUAD4, (2, 0, 3, 5))),
    sides=WEDGE_SIDES,
    regular=0.75**0.5,
    mirrored=WEDGE_MIRRORED,
    either_way=True,
    vtk=13,
    split=of_same_kind("wedge6", WEDGE_PARTS),
    nastran="CPENTA",
    gmsh=6,
    abaqus={"C3D6": "", "C3D6H": HYBRID},
    meshio={"wedge": ()},
)
WEDGE15 = second_order(
    WEDGE6,
    "wedge15",
    WEDGE_EDGES,
    wedge_quadratic,
    stiffness=_wedge_rule(4, 3),
    mass=_wedge_rule(4, 3),
    vtk=26,
    # mid-sides bottom, uprights, top; ours are bottom, top, uprights
    nastran_order=(*range(9), 12, 13, 14, 9, 10, 11),
    gmsh=18,
    gmsh_order=(*range(6), 6, 9, 7, 12, 14, 13, 8, 10, 11),
    abaqus={"C3D15": "", "C3D15H": HYBRID},
    meshio={"wedge15": ()},
    # in VTK the normal of nodes 0-1-2 points away from 3-4-5 (vtkWedge, vtkQuadraticWedge); meshio converts only the linear one
    orders=dict.fromkeys(("vtu", "vtk"), with_edge_nodes(WEDGE_MIRRORED, WEDGE_EDGES, WEDGE_EDGES)),
)


BASE, APEX = QUADRANGLE_CORNERS, np.array([0.0, 0.0, 1.0])


def pyramid_linear(xi: FloatArray) -> Values:
    """Base ¼(1 − ζ)(1 + ξ_a u)(1 + η_a v) with u = ξ/(1 − ζ), v = η/(1 − ζ); apex ζ (Bedrosian 1992).

    At the apex, where the gradient depends on the direction, it is the limit along the axis, u = v = 0."""
    t = 1 - xi[:, 2:]
    u, v = np.divide(xi[:, :2], t, out=np.zeros_like(xi[:, :2]), where=t != 0).T[:, :, None]
    a, b = BASE.T
    N = np.hstack([0.25 * t * (1 + a * u) * (1 + b * v), xi[:, 2:]])
    dN = np.stack([0.25 * a * (1 + b * v), 0.25 * b * (1 + a * u), -0.25 * (1 - a * b * u * v)], axis=2)
    return N, np.concatenate([dN, np.broadcast_to(APEX, (len(xi), 1, 3))], axis=1)


def _pyramid_rule(points: int) -> Rule:
    """Gauss-Legendre in u and v, Gauss-Jacobi in ζ with the weight (1 − ζ)²: exact for degree 3 in u and v.
    ∂N/∂ξ and the Jacobian do not depend on ζ at u, v: one point in ζ is exact for the stiffness of any shape."""
    plane, weight = gauss(2, 2)
    x, w = roots_jacobi(points, 2.0, 0.0)
    t = 0.5 * (1 - np.repeat(x, len(plane)))
    return np.column_stack([np.tile(plane, (points, 1)) * t[:, None], 1 - t]), np.outer(w / 8, weight).ravel()


PYRAMID_NODES = np.vstack([np.column_stack([BASE, np.zeros(4)]), APEX])


def _pyramid_parts() -> Split:
    """Pyramids at the five corners and an inverted one below the apex, four tetrahedra between."""
    foot, upright, side = (
        np.zeros(3),
        0.5 * (PYRAMID_NODES[:4] + APEX),
        0.5 * (PYRAMID_NODES[:4] + np.roll(PYRAMID_NODES[:4], -1, axis=0)),
    )
    pyramids = (*halves(PYRAMID_NODES), np.vstack([upright[::-1], foot]))
    between = [np.array([foot, side[a], upright[(a + 1) % 4], upright[a]]) for a in range(4)]
    return (*of_same_kind("pyra5", pyramids), *of_same_kind("tet4", between))


PYRA5 = ElementKind(
    name="pyra5",
    family="pyramids",
    nodes=PYRAMID_NODES,
    centre=0.25 * APEX,
    functions=pyramid_linear,
    stiffness=_pyramid_rule(1),
    mass=_pyramid_rule(2),
    facets=((QUAD4, (0, 3, 2, 1)), (TRI3, (0, 1, 4)), (TRI3, (1, 2, 4)), (TRI3, (2, 3, 4)), (TRI3, (3, 0, 4))),
    sides=(
        *((0, 1, 3, 4), (1, 2, 0, 4), (2, 3, 1, 4), (3, 0, 2, 4)),
        *((4, 1, 0, 2), (4, 2, 1, 3), (4, 3, 2, 0), (4, 0, 3, 1)),
    ),
    regular=0.5**0.5,
    mirrored=(0, 3, 2, 1, 4),
    vtk=14,
    split=_pyramid_parts(),
    nastran="CPYRAM",
    gmsh=7,
    abaqus={"C3D5": "", "C3D5H": HYBRID},
    meshio={"pyramid": ()},
)

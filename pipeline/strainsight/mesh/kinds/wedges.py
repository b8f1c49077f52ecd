"""Wedges of 6 and 15 nodes; nodes 0, 1, 2 lie at ζ = −1 (as in Nastran, gmsh and vtkWedge's own interpolation)."""

from __future__ import annotations

import numpy as np

from strainsight.mesh.kinds import triangles
from strainsight.mesh.kinds.kind import (
    HYBRID,
    ElementKind,
    Rule,
    Values,
    alike,
    barycentric,
    gauss,
    mirrored,
    triangle,
    with_midsides,
)
from strainsight.mesh.kinds.quadrangles import QUAD4, QUAD8
from strainsight.mesh.kinds.triangles import TRI3, TRI6
from strainsight.mesh.model import FloatArray

CORNERS = np.vstack([np.column_stack([triangles.CORNERS, np.full(3, level)]) for level in (-1.0, 1.0)])
EDGES = (*triangles.EDGES, (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5))
CENTRE = np.array([1 / 3, 1 / 3, 0.0])
SIDES = ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5), (3, 5, 4, 0), (4, 3, 5, 1), (5, 4, 3, 2))
MIRRORED = (0, 2, 1, 3, 5, 4)
PARTS = tuple(
    np.vstack([np.column_stack([part, np.full(3, level)]) for level in (low, low + 1)])
    for low in (-1.0, 0.0)
    for part in triangles.PARTS
)


def linear(xi: FloatArray) -> Values:
    """L_a ½(1 ± ζ)."""
    L, dL = barycentric(xi[:, :2])
    z = xi[:, 2, None]
    N = np.concatenate([L * (1 - z) / 2, L * (1 + z) / 2], axis=1)
    plane = np.concatenate([dL * (1 - z)[..., None] / 2, dL * (1 + z)[..., None] / 2], axis=1)
    return N, np.concatenate([plane, np.concatenate([-L / 2, L / 2], axis=1)[..., None]], axis=2)


def quadratic(xi: FloatArray) -> Values:
    """Corners ½L[(2L − 1)(1 ± ζ) − (1 − ζ²)], triangle mid-sides 2 L_a L_b (1 ± ζ), uprights L(1 − ζ²)."""
    L, dL = barycentric(xi[:, :2])
    z = xi[:, 2, None]
    a, b = np.transpose(triangles.EDGES)
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


def _rule(degree: int, points: int) -> Rule:
    plane, weight = triangle(degree)
    z, wz = gauss(points, 1)
    return (
        np.column_stack([np.tile(plane, (len(z), 1)), np.repeat(z[:, 0], len(plane))]),
        np.outer(wz, weight).ravel(),
    )


WEDGE6 = ElementKind(
    name="wedge6",
    family="wedges",
    nodes=CORNERS,
    centre=CENTRE,
    functions=linear,
    stiffness=_rule(2, 2),
    mass=_rule(2, 2),
    facets=(
        (TRI3, (0, 2, 1)),
        (TRI3, (3, 4, 5)),
        (QUAD4, (0, 1, 4, 3)),
        (QUAD4, (1, 2, 5, 4)),
        (QUAD4, (2, 0, 3, 5)),
    ),
    sides=SIDES,
    regular=0.75**0.5,
    mirrored=MIRRORED,
    either_way=True,
    vtk=13,
    split=alike("wedge6", PARTS),
    nastran="CPENTA",
    gmsh=6,
    abaqus={"C3D6": "", "C3D6H": HYBRID},
    meshio={"wedge": ()},
)
WEDGE15 = ElementKind(
    name="wedge15",
    family="wedges",
    nodes=with_midsides(CORNERS, EDGES),
    edges=EDGES,
    centre=CENTRE,
    functions=quadratic,
    stiffness=_rule(4, 3),
    mass=_rule(4, 3),
    facets=(
        (TRI6, (0, 2, 1, 8, 7, 6)),
        (TRI6, (3, 4, 5, 9, 10, 11)),
        (QUAD8, (0, 1, 4, 3, 6, 13, 9, 12)),
        (QUAD8, (1, 2, 5, 4, 7, 14, 10, 13)),
        (QUAD8, (2, 0, 3, 5, 8, 12, 11, 14)),
    ),
    sides=SIDES,
    regular=0.75**0.5,
    mirrored=mirrored(MIRRORED, EDGES),
    either_way=True,
    vtk=26,
    split=alike("wedge15", PARTS),
    nastran="CPENTA",
    # mid-sides bottom, uprights, top; ours are bottom, top, uprights
    nastran_order=(*range(9), 12, 13, 14, 9, 10, 11),
    gmsh=18,
    gmsh_order=(*range(6), 6, 9, 7, 12, 14, 13, 8, 10, 11),
    abaqus={"C3D15": "", "C3D15H": HYBRID},
    meshio={"wedge15": ()},
    # in VTK the normal of nodes 0-1-2 points away from 3-4-5 (vtkWedge, vtkQuadraticWedge); meshio turns only the linear one
    orders=dict.fromkeys(("vtu", "vtk"), mirrored(MIRRORED, EDGES)),
)

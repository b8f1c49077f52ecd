"""Tetrahedra of 4 and 10 nodes."""

from __future__ import annotations

from functools import partial

import numpy as np

from strainsight.mesh.kinds import triangles
from strainsight.mesh.kinds.kind import (
    HYBRID,
    ElementKind,
    Rule,
    alike,
    barycentric,
    halves,
    mirrored,
    orbits,
    quadratic_simplex,
    with_midsides,
)
from strainsight.mesh.kinds.triangles import TRI3, TRI6
from strainsight.mesh.model import FloatArray

CORNERS = np.vstack([np.zeros(3), np.eye(3)])
EDGES = (*triangles.EDGES, (0, 3), (1, 3), (2, 3))
SIDES = ((0, 1, 2, 3), (1, 2, 0, 3), (2, 0, 1, 3), (3, 1, 0, 2))
MIRRORED = (0, 2, 1, 3)


def _parts() -> tuple[FloatArray, ...]:
    """Four at the corners, and the octahedron between them cut along the middles of edges 02 and 13."""
    middle = {(a, b): 0.5 * (CORNERS[a] + CORNERS[b]) for a in range(4) for b in range(a + 1, 4)}
    ring = [middle[edge] for edge in ((0, 1), (1, 2), (2, 3), (0, 3))]
    between = [np.array([middle[0, 2], middle[1, 3], ring[i], ring[(i + 1) % 4]]) for i in range(4)]
    assert all(np.linalg.det(part[1:] - part[0]) > 0 for part in between)
    return (*halves(CORNERS), *between)


PARTS = _parts()


def _rule(degree: int) -> Rule:
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
    nodes=CORNERS,
    centre=np.full(3, 0.25),
    functions=barycentric,
    stiffness=_rule(1),
    mass=_rule(2),
    facets=((TRI3, (0, 2, 1)), (TRI3, (0, 1, 3)), (TRI3, (1, 2, 3)), (TRI3, (0, 3, 2))),
    sides=SIDES,
    regular=0.5**0.5,
    mirrored=MIRRORED,
    vtk=10,
    split=alike("tet4", PARTS),
    nastran="CTETRA",
    gmsh=4,
    abaqus={"C3D4": "", "C3D4H": HYBRID},
    meshio={"tetra": ()},
)
TET10 = ElementKind(
    name="tet10",
    family="tetrahedra",
    nodes=with_midsides(CORNERS, EDGES),
    edges=EDGES,
    centre=np.full(3, 0.25),
    functions=partial(quadratic_simplex, edges=EDGES),
    stiffness=_rule(2),
    mass=_rule(5),
    facets=(
        (TRI6, (0, 2, 1, 6, 5, 4)),
        (TRI6, (0, 1, 3, 4, 8, 7)),
        (TRI6, (1, 2, 3, 5, 9, 8)),
        (TRI6, (0, 3, 2, 7, 9, 6)),
    ),
    sides=SIDES,
    regular=0.5**0.5,
    mirrored=mirrored(MIRRORED, EDGES),
    vtk=24,
    split=alike("tet10", PARTS),
    nastran="CTETRA",
    gmsh=11,
    gmsh_order=(0, 1, 2, 3, 4, 5, 6, 7, 9, 8),
    abaqus={
        "C3D10": "",
        "C3D10I": "as C3D10",
        "C3D10S": "as C3D10",
        "C3D10T": "as C3D10",
        "C3D10H": HYBRID,
        "C3D10HS": HYBRID,
        "C3D10M": "as C3D10, without its modified formulation",
        "C3D10MH": f"as C3D10, without its modified formulation, {HYBRID}",
    },
    meshio={"tetra10": ()},
)

"""Facets of solids, which are shells too: triangles and quadrangles."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from strainsight.mesh.kinds.kind import (
    Kind,
    alike,
    barycentric,
    gauss,
    halves,
    multilinear,
    quadratic_simplex,
    serendipity,
    triangle,
    with_midsides,
)

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
    split=alike("tri3", TRIANGLE_PARTS),
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
    split=alike("tri6", TRIANGLE_PARTS),
)
FIRST, SECOND = 0.5 - np.sqrt(1 / 12), 0.5 + np.sqrt(1 / 12)
"""Points of Gauss of 0 … 1."""
INSIDE = 1 / np.sqrt(3)
ALONG_SIDES = np.array(
    [
        *([FIRST, 0], [SECOND, 0], [FIRST, INSIDE]),
        *([0, FIRST], [0, SECOND], [INSIDE, FIRST]),
        *([SECOND, FIRST], [FIRST, SECOND], [FIRST, FIRST]),
    ]
)
"""Where strain along the sides from the first corner to the second and third, and between these, is that of a curved surface
that bends (Lee & Bathe, Comput. Struct. 82 (2004) 945-962)."""
SHELL6 = replace(TRI6, name="shell6", read_at=ALONG_SIDES, read_along=(0, 0, 0, 1, 1, 1, 2, 2, 2))
"""On a shell of the second order, see `SHELL8`."""


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
    split=alike("quad4", halves(QUADRANGLE_CORNERS)),
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
    split=alike("quad8", halves(QUADRANGLE_CORNERS)),
)
SHELL8 = replace(QUAD8, name="shell8", read_at=gauss(2, 2)[0])
"""On a shell of the second order. Curved, it bends without stretch in the mean only: between nodes the strain of its functions
is off by up to h²/(12 R t) of that on its faces, and right at the points of Gauss (Barlow, Int. J. Numer. Meth. Engng 10 (1976)
243-251)."""

"""Triangles: facets of tetrahedra, wedges and pyramids."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from strainsight.mesh.kinds.kind import Kind, alike, barycentric, halves, quadratic_simplex, triangle, with_midsides

CORNERS = np.vstack([np.zeros(2), np.eye(2)])
EDGES = ((0, 1), (1, 2), (2, 0))
CENTRE = np.full(2, 1 / 3)
PARTS = (*halves(CORNERS), np.array([[0.5, 0.5], [0.0, 0.5], [0.5, 0.0]]))

TRI3 = Kind(
    name="tri3",
    nodes=CORNERS,
    centre=CENTRE,
    functions=barycentric,
    stiffness=triangle(2),
    mass=triangle(2),
    vtk=5,
    split=alike("tri3", PARTS),
)
TRI6 = Kind(
    name="tri6",
    nodes=with_midsides(CORNERS, EDGES),
    edges=EDGES,
    centre=CENTRE,
    functions=partial(quadratic_simplex, edges=EDGES),
    stiffness=triangle(4),
    mass=triangle(4),
    vtk=22,
    split=alike("tri6", PARTS),
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

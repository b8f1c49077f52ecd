"""Quadrangles: facets of hexahedra, wedges and pyramids."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from strainsight.mesh.kinds.kind import Kind, alike, gauss, halves, multilinear, serendipity, with_midsides

CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
EDGES = ((0, 1), (1, 2), (2, 3), (3, 0))
NODES = with_midsides(CORNERS, EDGES)
CENTRE = np.zeros(2)

QUAD4 = Kind(
    name="quad4",
    nodes=CORNERS,
    centre=CENTRE,
    functions=partial(multilinear, nodes=CORNERS),
    stiffness=gauss(2, 2),
    mass=gauss(2, 2),
    vtk=9,
    split=alike("quad4", halves(CORNERS)),
)
QUAD8 = Kind(
    name="quad8",
    nodes=NODES,
    edges=EDGES,
    centre=CENTRE,
    functions=partial(serendipity, nodes=NODES),
    stiffness=gauss(3, 2),
    mass=gauss(3, 2),
    vtk=23,
    split=alike("quad8", halves(CORNERS)),
)
SHELL8 = replace(QUAD8, name="shell8", read_at=gauss(2, 2)[0])
"""On a shell of the second order. Curved, it bends without stretch in the mean only: between nodes the strain of its functions
is off by up to h²/(12 R t) of that on its faces, and right at the points of Gauss (Barlow, Int. J. Numer. Meth. Engng 10 (1976)
243-251)."""

"""Hexahedra of 8 nodes, with incompatible modes, and of 20."""

from __future__ import annotations

from functools import partial

import numpy as np

from strainsight.mesh.kinds import quadrangles
from strainsight.mesh.kinds.kind import (
    HYBRID,
    ElementKind,
    alike,
    gauss,
    halves,
    mirrored,
    multilinear,
    serendipity,
    with_midsides,
)
from strainsight.mesh.kinds.quadrangles import QUAD4, QUAD8
from strainsight.mesh.model import FloatArray

CORNERS = np.vstack([np.column_stack([quadrangles.CORNERS, np.full(4, level)]) for level in (-1.0, 1.0)])
EDGES = (*quadrangles.EDGES, (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
NODES = with_midsides(CORNERS, EDGES)
SIDES = (
    *((0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7)),
    *((4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3)),
)
MIRRORED = (0, 3, 2, 1, 4, 7, 6, 5)
UPRIGHTS_SECOND = (*range(12), 16, 17, 18, 19, 12, 13, 14, 15)
"""Mid-sides bottom, uprights, top (Nastran, Exodus); ours are bottom, top, uprights."""
_MODES = "with incompatible modes"
_APART = "; frequencies of coarse meshes differ for it, from those of CalculiX by up to {} %"
"""How far, on the two decks of its users where most."""
_REDUCED = f"{_MODES}: full integration, no hourglass control"


def bubble_gradient(xi: FloatArray) -> FloatArray:
    """∂P_i/∂ξ_d of the incompatible modes P_i = 1 − ξᵢ² (Wilson et al. 1973): xi (q, 3) → (q, 3, 3)."""
    return -2.0 * np.asarray(xi)[:, :, None] * np.eye(3)


HEX8 = ElementKind(
    name="hex8",
    family="hexahedra",
    nodes=CORNERS,
    centre=np.zeros(3),
    functions=partial(multilinear, nodes=CORNERS),
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
    sides=SIDES,
    regular=1.0,
    mirrored=MIRRORED,
    vtk=12,
    split=alike("hex8", halves(CORNERS)),
    nastran="CHEXA",
    gmsh=5,
    abaqus={
        "C3D8": f"{_MODES}, as C3D8I{_APART.format(18)}",
        "C3D8I": "",
        "C3D8S": f"{_MODES}, as C3D8I",
        "C3D8R": _REDUCED,
        "C3D8H": f"{_MODES}, {HYBRID}",
        "C3D8HS": f"{_MODES}, {HYBRID}",
        "C3D8IH": HYBRID,
        "C3D8RH": f"{_REDUCED}, {HYBRID}",
    },
    # a voxel is counted row by row
    meshio={"hexahedron": (), "voxel": (0, 1, 3, 2, 4, 5, 7, 6)},
)
HEX20 = ElementKind(
    name="hex20",
    family="hexahedra",
    nodes=NODES,
    edges=EDGES,
    centre=np.zeros(3),
    functions=partial(serendipity, nodes=NODES),
    stiffness=gauss(3, 3),
    mass=gauss(3, 3),
    facets=(
        (QUAD8, (0, 3, 2, 1, 11, 10, 9, 8)),
        (QUAD8, (4, 5, 6, 7, 12, 13, 14, 15)),
        (QUAD8, (0, 1, 5, 4, 8, 17, 12, 16)),
        (QUAD8, (1, 2, 6, 5, 9, 18, 13, 17)),
        (QUAD8, (2, 3, 7, 6, 10, 19, 14, 18)),
        (QUAD8, (3, 0, 4, 7, 11, 16, 15, 19)),
    ),
    sides=SIDES,
    regular=1.0,
    mirrored=mirrored(MIRRORED, EDGES),
    vtk=25,
    split=alike("hex20", halves(CORNERS)),
    nastran="CHEXA",
    nastran_order=UPRIGHTS_SECOND,
    gmsh=17,
    # mid-sides by ascending ends of the edges
    gmsh_order=(*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
    abaqus={
        "C3D20": "",
        "C3D20R": f"integrated fully{_APART.format(17)}",
        "C3D20H": HYBRID,
        "C3D20RH": f"integrated fully, {HYBRID}",
    },
    meshio={"hexahedron20": ()},
    orders={"exodus": UPRIGHTS_SECOND},
)

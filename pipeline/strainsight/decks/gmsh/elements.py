"""Element types of gmsh: what they are called, how many nodes they have, and in which order.

Source: gmsh reference manual, "MSH file format" and "Node ordering".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from strainsight.mesh.kinds import ELEMENTS


class ElementType(NamedTuple):
    """A type of element: name, dimension of its geometry, number of nodes."""

    name: str
    dimension: int
    nodes: int


TYPES: Mapping[int, ElementType] = {
    1: ElementType("2-node line", 1, 2),
    2: ElementType("3-node triangle", 2, 3),
    3: ElementType("4-node quadrangle", 2, 4),
    4: ElementType("4-node tetrahedron", 3, 4),
    5: ElementType("8-node hexahedron", 3, 8),
    6: ElementType("6-node prism", 3, 6),
    7: ElementType("5-node pyramid", 3, 5),
    8: ElementType("3-node line", 1, 3),
    9: ElementType("6-node triangle", 2, 6),
    10: ElementType("9-node quadrangle", 2, 9),
    11: ElementType("10-node tetrahedron", 3, 10),
    12: ElementType("27-node hexahedron", 3, 27),
    13: ElementType("18-node prism", 3, 18),
    14: ElementType("14-node pyramid", 3, 14),
    15: ElementType("point", 0, 1),
    16: ElementType("8-node quadrangle", 2, 8),
    17: ElementType("20-node hexahedron", 3, 20),
    18: ElementType("15-node prism", 3, 15),
    19: ElementType("13-node pyramid", 3, 13),
    20: ElementType("9-node triangle", 2, 9),
    21: ElementType("10-node triangle", 2, 10),
    22: ElementType("12-node triangle", 2, 12),
    23: ElementType("15-node triangle", 2, 15),
    24: ElementType("15-node incomplete triangle", 2, 15),
    25: ElementType("21-node triangle", 2, 21),
    26: ElementType("4-node line", 1, 4),
    27: ElementType("5-node line", 1, 5),
    28: ElementType("6-node line", 1, 6),
    29: ElementType("20-node tetrahedron", 3, 20),
    30: ElementType("35-node tetrahedron", 3, 35),
    31: ElementType("56-node tetrahedron", 3, 56),
    32: ElementType("22-node tetrahedron", 3, 22),
    33: ElementType("28-node tetrahedron", 3, 28),
    36: ElementType("16-node quadrangle", 2, 16),
    37: ElementType("25-node quadrangle", 2, 25),
    38: ElementType("36-node quadrangle", 2, 36),
    39: ElementType("12-node quadrangle", 2, 12),
    40: ElementType("16-node incomplete quadrangle", 2, 16),
    41: ElementType("20-node quadrangle", 2, 20),
    90: ElementType("40-node prism", 3, 40),
    91: ElementType("75-node prism", 3, 75),
    92: ElementType("64-node hexahedron", 3, 64),
    93: ElementType("125-node hexahedron", 3, 125),
    99: ElementType("32-node hexahedron", 3, 32),
    100: ElementType("44-node hexahedron", 3, 44),
    118: ElementType("30-node pyramid", 3, 30),
    119: ElementType("55-node pyramid", 3, 55),
    125: ElementType("21-node pyramid", 3, 21),
}
"""Number → type, up to the fifth order of lines and surfaces."""

KINDS = {kind.gmsh: kind for kind in ELEMENTS if kind.gmsh}
"""The solids that are supported."""


def remedy(number: int) -> str:
    """What to do about a solid that is not supported."""
    kind = TYPES[number]
    if "pyramid" in kind.name:
        return (
            "set Mesh.ElementOrder = 1 (pyramids are supported in first order only), or mesh without pyramids: tetrahedra "
            "throughout (Mesh.RecombineAll = 0), or hexahedra by transfinite volumes"
        )
    if number in (12, 13):
        return "set Mesh.SecondOrderIncomplete = 1 before meshing: 20-node hexahedra and 15-node prisms are supported"
    return "set Mesh.ElementOrder = 2 (or 1) before meshing"

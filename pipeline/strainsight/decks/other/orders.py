"""Node orders of the formats that meshio reads, against our own."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.decks.faults import plural
from strainsight.mesh.model import FloatArray, IntArray

MIRRORED: Mapping[str, np.ndarray] = {
    "tet4": np.array([0, 2, 1, 3]),
    "tet10": np.array([0, 2, 1, 3, 6, 5, 4, 7, 9, 8]),
    "hex8": np.array([0, 3, 2, 1, 4, 7, 6, 5]),
    "hex20": np.array([0, 3, 2, 1, 4, 7, 6, 5, 11, 10, 9, 8, 15, 14, 13, 12, 16, 19, 18, 17]),
    "wedge6": np.array([0, 2, 1, 3, 5, 4]),
    "wedge15": np.array([0, 2, 1, 3, 5, 4, 8, 7, 6, 11, 10, 9, 12, 14, 13]),
}
"""The same element counted the other way round about its axis: node a is node MIRRORED[kind][a] of the other."""

EXODUS_HEX20 = np.array([*range(12), 16, 17, 18, 19, 12, 13, 14, 15])
"""Exodus counts mid-sides bottom, uprights, top."""

# In VTK the normal of nodes 0-1-2 points away from 3-4-5 (vtkWedge, vtkQuadraticWedge); meshio turns only the linear one.
# MED counts every solid the other way round ("Connectivity conventions of nodes of elements", Salome SMESH).
TURNED = {("vtu", "wedge15"), ("vtk", "wedge15"), *(("med", kind) for kind in MIRRORED)}

_CORNERS: Mapping[str, tuple[tuple[int, int, int, int], ...]] = {
    "tet": ((0, 1, 2, 3),),
    "hex": (
        *((0, 1, 3, 4), (1, 2, 0, 5), (2, 3, 1, 6), (3, 0, 2, 7)),
        *((4, 7, 5, 0), (5, 4, 6, 1), (6, 5, 7, 2), (7, 6, 4, 3)),
    ),
    "wedge": ((0, 1, 2, 3), (1, 2, 0, 4), (2, 0, 1, 5), (3, 5, 4, 0), (4, 3, 5, 1), (5, 4, 3, 2)),
}
"""Corner, and its three neighbours right-handed."""


def in_our_order(kind: str, nodes: IntArray, form: str, position: FloatArray, notes: list[str]) -> IntArray:
    """Cells (n, k) as meshio gives them for a format → our order.

    Where every corner of every cell is then turned inside out, and cells of this kind are known to be written either
    way (wedges; anything in MED), they are turned back, with a note.
    """
    if (form, kind) == ("exodus", "hex20"):
        nodes = nodes[:, EXODUS_HEX20]
    turned = (form, kind) in TURNED
    if turned:
        nodes = nodes[:, MIRRORED[kind]]
    if (turned or kind.startswith("wedge")) and _inside_out(kind, nodes, position):
        nodes = nodes[:, MIRRORED[kind]]
        notes.append(f"{plural(len(nodes), kind + ' element')} numbered against the convention of {form}: turned round")
    return nodes


def _inside_out(kind: str, nodes: IntArray, position: FloatArray) -> bool:
    """Whether the edges at every corner of every cell are left-handed."""
    corners = next(corners for shape, corners in _CORNERS.items() if kind.startswith(shape))
    for a, *others in corners:
        edges = np.stack([position[nodes[:, b]] - position[nodes[:, a]] for b in others], axis=1)
        with np.errstate(all="ignore"):
            volume = np.einsum("ei,ei->e", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2])
        if not np.all(volume < 0):
            return False
    return True

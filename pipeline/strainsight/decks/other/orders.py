"""Node orders of the formats that meshio reads, against our own."""

from __future__ import annotations

import numpy as np

from strainsight.decks.faults import plural
from strainsight.mesh.kinds.kind import ElementKind, in_order
from strainsight.mesh.model import FloatArray, IntArray

TURNED = "med"
"""MED counts every solid the other way round ("Connectivity conventions of nodes of elements", Salome SMESH)."""


def in_our_order(kind: ElementKind, nodes: IntArray, form: str, position: FloatArray, notes: list[str]) -> IntArray:
    """Cells (n, k) as meshio gives them for a format → our order.

    Where every corner of every cell is then inverted, and cells of this kind are known to be written either
    way (wedges; anything in MED), they are turned back, with a note.
    """
    nodes = in_order(nodes, kind.orders.get(form, kind.mirrored if form == TURNED else ()))
    if (form == TURNED or kind.either_way) and _inverted(kind, nodes, position):
        nodes = in_order(nodes, kind.mirrored)
        notes.append(
            f"{plural(len(nodes), kind.name + ' element')} numbered against the convention of {form}: turned round"
        )
    return nodes


def _inverted(kind: ElementKind, nodes: IntArray, position: FloatArray) -> bool:
    """Whether the edges at every corner of every cell are left-handed."""
    for a, *others in kind.sides:
        edges = np.stack([position[nodes[:, b]] - position[nodes[:, a]] for b in others], axis=1)
        with np.errstate(all="ignore"):
            volume = np.einsum("ei,ei->e", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2])
        if not np.all(volume < 0):
            return False
    return True

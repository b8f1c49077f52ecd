"""Node orders of the formats that meshio reads, against our own."""

from __future__ import annotations

from strainsight.decks.faults import plural
from strainsight.mesh.kinds.kind import ElementKind, in_order
from strainsight.mesh.left_handed import left_handed
from strainsight.mesh.model import FloatArray, IntArray

TURNED = "med"
"""MED counts every solid the other way round ("Connectivity conventions of nodes of elements", Salome SMESH)."""


def in_our_order(kind: ElementKind, nodes: IntArray, form: str, position: FloatArray, notes: list[str]) -> IntArray:
    """Cells (n, k) as meshio gives them for a format → our order.

    Where every corner of every cell is then inverted, and cells of this kind are known to be written either
    way (wedges; anything in MED), they are turned back, with a note.
    """
    nodes = in_order(nodes, kind.orders.get(form, kind.mirrored if form == TURNED else ()))
    if (form == TURNED or kind.either_way) and left_handed(kind, nodes, position).all():
        nodes = in_order(nodes, kind.mirrored)
        notes.append(
            f"{plural(len(nodes), kind.name + ' element')} numbered against the convention of {form}: turned round"
        )
    return nodes

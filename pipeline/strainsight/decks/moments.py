"""Nodes that have rotations, and what a moment is on the others."""

from __future__ import annotations

from collections.abc import Sequence

from strainsight.mesh.joins import AveragingElement, Relation, RigidElement


def turning_nodes(
    rigid: Sequence[RigidElement], averaging: Sequence[AveragingElement], relations: Sequence[Relation] = ()
) -> set[int]:
    """Rows of the nodes whose rotations count: reference nodes, what follows one of an RBE2 in rotations, and what a relation
    or a mean turns."""
    followers = {int(row) for e in rigid if max(e.components) > 2 for row in e.nodes}
    followers |= {int(row) for e in averaging for row in e.turned} | {int(row) for e in relations for row in e.turned}
    return followers | {e.reference for e in rigid} | {e.reference for e in averaging}


def moment_note(card: str, ids: Sequence[int]) -> str:
    """What becomes of moments on nodes (ids, ascending, at least one) that have no rotations."""
    more = f" and {len(ids) - 1} more" if len(ids) > 1 else ""
    return f"{card} on node {ids[0]}{more} without rotations: a couple of forces on the nodes of the elements there"

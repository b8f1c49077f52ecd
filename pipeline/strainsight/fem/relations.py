"""Relations (MPC, *EQUATION) as equations of the motions that follow."""

from __future__ import annotations

import numpy as np

from strainsight.errors import DeckError
from strainsight.fem.equations import ROUNDING, Equations, Rows, entity_of
from strainsight.mesh.model import Mesh


def relation_terms(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of all terms (t,) of the relations: number of the relation, node, component and value."""
    relation = np.repeat(np.arange(len(mesh.relations)), [len(own.node) for own in mesh.relations])
    whole = [np.zeros(0, dtype=np.int64)]
    node, component = (
        np.concatenate([*whole, *parts])
        for parts in ([own.node for own in mesh.relations], [own.component for own in mesh.relations])
    )
    return relation, node, component, np.concatenate([np.zeros(0), *(own.value for own in mesh.relations)])


def add_relations(mesh: Mesh, rows: Rows, found: Equations) -> None:
    """Add  z'_1 = −Σ_{k>1} c_k z'_k / c_1  of all relations to the equations.

    Raises DeckError for a first term that is zero, and for a motion that follows already.
    """
    relation, node, component, value = relation_terms(mesh)
    at, kept = rows.of(node, component), value != 0
    # a motion that stands twice in a relation has the sum of its coefficients
    term, place = np.unique((relation * rows.size + at)[kept], return_inverse=True)
    c, size = (np.bincount(place, own[kept], len(term)) for own in (value, np.abs(value)))
    c = np.where(np.abs(c) > ROUNDING * size, c, 0.0)
    of, column = np.divmod(term, rows.size)
    follower = at[np.searchsorted(relation, np.arange(len(mesh.relations)))]
    leading = column == follower[of]
    first = np.zeros(len(mesh.relations))
    first[of[leading]] = c[leading]
    for e, row, own in zip(mesh.relations, follower.tolist(), first.tolist(), strict=True):
        node_of_it, component_of_it = e.follower
        if own == 0:
            raise DeckError(
                f"{e} has the coefficient 0 at node {mesh.node_ids[node_of_it]} component {component_of_it + 1}, its first term, "
                "which is to follow the others",
                remedy="give a motion with a coefficient first",
                entity=entity_of(e),
            )
        found.claim(mesh, e, node_of_it, row)
    others = ~leading & (c != 0)
    found.state(follower[of[others]], column[others], -c[others] / first[of[others]])

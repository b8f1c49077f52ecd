"""Springs on the motions of their nodes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError
from strainsight.mesh.model import Mesh


def spring_rows(mesh: Mesh, rotation_rows: Mapping[int, int]) -> tuple[sparse.csr_array, np.ndarray]:
    """R (s, 3n + 3r) of the elongations s = R z, and the stiffness k (s,) of all springs; rotations of node i from row
    rotation_rows[i].

    Raises DeckError where a spring acts on the rotation of a node that has none.
    """
    size = 3 * len(mesh.position) + 3 * len(rotation_rows)
    rows, columns, values, stiffness = [], [], [], [np.zeros(0)]
    count = 0
    for own in mesh.springs:
        at = 3 * own.node + own.component
        for i in np.flatnonzero((own.component > 2) & (own.value != 0)):
            node = int(own.node[i])
            if node not in rotation_rows:
                raise DeckError(
                    f"{own} acts on rotations of node {mesh.node_ids[node]}, which has none",
                    remedy="make it the reference node of a tie (RBE2, mesh.ties), or let the ends of the spring coincide",
                    entity=("node", int(mesh.node_ids[node])),
                )
            at[i] = rotation_rows[node] + own.component[i] - 3
        kept = own.value != 0
        rows.append(own.spring[kept] + count)
        columns.append(at[kept])
        values.append(own.value[kept])
        stiffness.append(own.stiffness)
        count += len(own.stiffness)
    if not rows:
        return sparse.csr_array((0, size)), np.zeros(0)
    places = np.concatenate(rows), np.concatenate(columns)
    R = sparse.csr_array((np.concatenate(values), places), shape=(count, size))
    return R, np.concatenate(stiffness)


def spring_matrix(mesh: Mesh, rotation_rows: Mapping[int, int]) -> sparse.csr_array:
    """K = Rᵀ diag(k) R on z (3n + 3r)² [N/m, N, N m]. Raises the error of `spring_rows`."""
    R, k = spring_rows(mesh, rotation_rows)
    return sparse.csr_array(R.T @ (sparse.diags_array(k) @ R))


def sprung_translations(mesh: Mesh) -> np.ndarray:
    """Rows 3·node + component, component 0-2, that a spring acts on."""
    found = [3 * own.node + own.component for own in mesh.springs]
    acts = [(own.component < 3) & (own.value != 0) & (own.stiffness[own.spring] > 0) for own in mesh.springs]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *(rows[on] for rows, on in zip(found, acts, strict=True))]))

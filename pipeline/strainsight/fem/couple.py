"""Forces and moments on nodes that exert a couple."""

from __future__ import annotations

import numpy as np

from strainsight.fem.constraints import Constraint
from strainsight.mesh.model import Mesh

FLAT = 1e-9
"""A principal moment of inertia of nodes below this share of the largest: they exert no couple about that axis."""


def couple(mesh: Mesh, constraint: Constraint, nodes: np.ndarray, weight: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Forces and moments on the rows of z (3n + 3r,) that exert a moment (3,) [N m] on nodes (k,) (indices) of some weight (k,).

    On the rotations of a single node, where it has some that lead others; else as forces w (ω × r) with Jω = M, r from the
    centre of the nodes and J = Σ w (r·r I − r rᵀ), on the nodes (k > 1), or on those of the elements at a single one and of the
    ties that it leads: as an averaging element distributes a moment. A couple that the nodes cannot exert, such as that of
    nodes in a line about the line, is left out.
    """
    T, x = constraint.transform, mesh.position
    e = np.zeros(T.shape[0])
    if len(nodes) == 1:
        row = constraint.reference_rows.get(int(nodes[0]))
        if row is not None and T[row : row + 3].nnz:
            e[row : row + 3] = moment
            return e
        nodes = nodes_at(mesh, int(nodes[0]))
        weight = np.ones(len(nodes))
    moves = np.diff(T.indptr[: 3 * len(x) + 1]).reshape(-1, 3)[nodes].sum(axis=1) > 0
    nodes, weight = nodes[moves], weight[moves]
    if len(nodes) < 2:
        return e
    r = x[nodes] - np.average(x[nodes], axis=0, weights=weight)
    J = np.einsum(
        "k,kij->ij", weight, np.einsum("k,ij->kij", np.sum(r**2, axis=1), np.eye(3)) - r[:, :, None] * r[:, None]
    )
    omega = np.linalg.pinv(J, rcond=FLAT, hermitian=True) @ moment
    np.add.at(e[: 3 * len(x)].reshape(-1, 3), nodes, weight[:, None] * np.cross(omega, r))
    return e


def exerted(mesh: Mesh, constraint: Constraint, e: np.ndarray) -> np.ndarray:
    """The moment (3,) [N m] about the origin of forces and moments e (3n + 3r,) on the rows of z."""
    forces = e[: 3 * len(mesh.position)].reshape(-1, 3)
    turned = [e[row : row + 3] for row in constraint.reference_rows.values()]
    return np.cross(mesh.position, forces).sum(axis=0) + np.sum([np.zeros(3), *turned], axis=0)


def nodes_at(mesh: Mesh, node: int) -> np.ndarray:
    """Nodes (indices) of the elements at a node, and of the ties that it leads: where the couple of a moment on it acts."""
    found = [nodes[(nodes == node).any(axis=1)].ravel() for nodes in mesh.connectivity]
    found += [e.nodes for e in mesh.rigid if e.reference == node]
    found += [e.nodes for e in mesh.averaging if e.reference == node]
    return np.unique(np.concatenate([*found, np.zeros(0, dtype=np.int64)]))

"""Sanity checks of ready matrices on their mesh."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import sparse
from scipy.linalg import eigh

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import AffineOperator
from strainsight.fem.constraints import Constraint, describe_row
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.ties import rigid_rows
from strainsight.mesh.model import Mesh

LOOSE = 1e-14
"""ε: energy of a rigid motion over that of its entries one by one, below which nothing holds it."""
MOTIONS = (
    "translation x",
    "translation y",
    "translation z",
    "rotation about x",
    "rotation about y",
    "rotation about z",
)


def rows_used(operator: AffineOperator) -> np.ndarray:
    """Rows (r,) with an entry in any term."""
    return np.any([np.diff(X.indptr) > 0 for X in (operator.constant, *operator.terms.values())], axis=0)


def check_diagonal(model: FiniteElementModel) -> None:
    diagonal = model.stiffness.at(dict.fromkeys(model.stiffness.parameters, 1.0)).diagonal()
    if not np.all(diagonal > 0):
        free = int(np.argmin(diagonal > 0))
        name = describe_row(model.mesh, model.constraint, int(model.constraint.free_rows[free]))
        raise DeckError(
            f"{name}: its stiffness is {diagonal[free]:g} ({np.count_nonzero(~(diagonal > 0))} such motions)",
            remedy="a stiffness is positive on its diagonal: check the matrix and its numbering",
        )


def unmoved_solids(mesh: Mesh, constraint: Constraint, rows: int) -> list[str]:
    """A sentence on translations of the solids that no row of the matrices and no tie moves, nor a support holds."""
    n = len(mesh.position)
    still = np.diff(constraint.transform[: 3 * n].tocsr().indptr).reshape(n, 3) == 0
    solid = np.zeros(n, dtype=bool)
    for block in mesh.blocks:
        solid[block.nodes] = True
    still &= solid[:, None]
    for node, component in mesh.fixed.tolist():
        still[node, component if component < 3 and node not in mesh.axes else slice(None)] = False
    for e in mesh.rigid:
        for component in e.components:
            if component < 3:
                still[e.nodes, component] = False
    for a in mesh.averaging:
        still[a.reference] = False
    for node, component in (relation.follower for relation in mesh.relations):
        if component < 3:
            still[node, component] = False
    if not still.any():
        return []
    named = mesh.node_ids[still.any(axis=1)]
    listed = ", ".join(map(str, named[:5])) + (", …" if len(named) > 5 else "")
    return [
        f"{np.count_nonzero(still)} translations of {len(named)} nodes of the solids have no stiffness in the {rows} rows of the "
        f"matrices and are taken as zero, so that gauges there read too little (nodes {listed})"
    ]


def lost_mass(
    mesh: Mesh, mass: AffineOperator, nodes: np.ndarray, components: np.ndarray, B: sparse.csr_array
) -> list[str]:
    """A sentence on rows that have a mass but do not move, though no support says so."""
    lost = rows_used(mass) & (np.diff(B.indptr) == 0)
    lost &= ~np.isin(6 * nodes + components, mesh.fixed.reshape(-1, 2) @ np.array([6, 1]))
    lost &= ~np.isin(nodes, [int(node) for e in mesh.rigid for node in e.nodes])
    lost &= ~np.isin(6 * nodes + components, [6 * node + c for node, c in (own.follower for own in mesh.relations)])
    if not lost.any():
        return []
    row = int(np.argmax(lost))
    return [
        f"{np.count_nonzero(lost)} rows have mass but no stiffness and are left out, the first of them node "
        f"{mesh.node_ids[nodes[row]]}, component {components[row] + 1}"
    ]


def check_support(model: FiniteElementModel, at: Mapping[str, float]) -> list[str]:
    """Whether supports and matrices resist the six rigid motions R, those of the free motions that a rigid body would have:

        c:  cᵀRᵀKR c < ε cᵀRᵀ diag(K) R c   is free

    Returns a sentence with the frequency ω² = min eig(RᵀKR, RᵀMR) where the mesh fixes nothing and the matrices do.
    Raises UserError that names the free motions.
    """
    R = _rigid_motions(model)
    K, M = model.stiffness.at(at), model.mass.at(at)
    size = np.sqrt(K.diagonal() @ R**2)
    there = size > 0  # nodes on a line do not turn about it
    R = R[:, there] / size[there]
    strength, U = np.linalg.eigh(R.T @ (K.diagonal()[:, None] * R))
    W = (U / np.sqrt(np.maximum(strength, 1e-300)))[:, strength > 1e-10]  # the others move nothing that is free
    R = R @ W
    resistance = R.T @ (K @ R)
    energy, V = np.linalg.eigh(resistance)
    if np.any(energy < LOOSE):
        loose = np.linalg.qr(W @ V[:, energy < LOOSE])[0]
        share = np.linalg.norm(loose, axis=1)
        named = [word for word, part in zip(np.array(MOTIONS)[there], share, strict=True) if part > 0.99]
        raise UserError(
            f"the structure can move freely: {', '.join(named) or f'{loose.shape[1]} rigid motion(s)'}; neither the supports of "
            "the mesh nor the matrices resist",
            remedy="fix nodes that the matrices have (mesh.supports), or give matrices with the supports in them",
        )
    if len(model.mesh.fixed):
        return []
    said = "the mesh fixes nothing: the matrices hold the structure by themselves"
    inertia = R.T @ (M @ R)
    if np.linalg.eigvalsh(inertia)[0] <= 0:
        return [said]
    softest = np.sqrt(eigh(resistance, inertia, eigvals_only=True)[0]) / (2 * np.pi)
    return [f"{said} (moving as a rigid body it would swing at {softest:.3g} Hz)"]


def _rigid_motions(model: FiniteElementModel) -> np.ndarray:
    """Six rigid motions on the free motions (n_free, 6)."""
    mesh, constraint = model.mesh, model.constraint
    R = np.zeros((constraint.transform.shape[0], 6))
    R[: 3 * len(mesh.position)] = rigid_rows(mesh.position - mesh.position.mean(axis=0)).reshape(-1, 6)
    for row in constraint.reference_rows.values():
        R[row : row + 3, 3:] = np.eye(3)
    return (R if constraint.turn is None else constraint.turn.T @ R)[constraint.free_rows]

"""Model from the stiffness and mass matrices of another program, on the nodes and constraints of a mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.linalg import eigh

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import AffineOperator
from strainsight.fem.constraints import Constraint, constraint_transform, describe_row
from strainsight.fem.equations import rigid_rows, rotation_rows
from strainsight.fem.model import FiniteElementModel, FullModel, restricted
from strainsight.fem.patch import held_components
from strainsight.mesh.model import IdTable, Mesh

LOOSE = 1e-14
"""ε: energy of a rigid motion relative to that of its separate entries below which the motion is unconstrained."""
MOTIONS = tuple(f"{motion} {axis}" for motion in ("translation", "rotation about") for axis in "xyz")


@dataclass(frozen=True)
class Term:
    """A matrix (r, r) of a file; parameter that scales it, None for a constant; at: the parameter value [SI] of the file."""

    matrix: sparse.csr_array
    parameter: str | None = None
    at: float = 1.0


@dataclass(frozen=True)
class ImportedMatrices:
    """Stiffness and mass on numbered rows, in SI units.

    node_ids (r,) of the file and components (r,) 0-5 along nodal axes; stiffness and mass (r, r) [N/m, N, N m; kg, kg m, kg m²]
    on translations [m] and rotations [rad]; at: parameter values [SI] of the files; source: file of the numbering."""

    node_ids: np.ndarray
    components: np.ndarray
    stiffness: AffineOperator
    mass: AffineOperator
    at: Mapping[str, float]
    source: str = ""


def convert_matrices(
    node_ids: np.ndarray,
    components: np.ndarray,
    stiffness: Sequence[Term],
    mass: Sequence[Term],
    length: float = 1.0,
    mass_unit: float = 1.0,
    source: str = "",
) -> ImportedMatrices:
    """Terms in deck units → affine operators in SI:

        X(θ) = Σ M s_i s_j X_ij θ/at,     s = 1 for translations, L for rotations

    length L [m] and mass_unit M [kg] of the deck; time in s, angles in rad. Raises UserError if a parameter has two
    values in `at`."""
    scale = sparse.diags_array(row_scale(components, length))
    at: dict[str, float] = {}
    for term in (*stiffness, *mass):
        if term.parameter is not None and at.setdefault(term.parameter, term.at) != term.at:
            raise UserError(
                f"the matrices of parameter {term.parameter} have different values of `at`: {at[term.parameter]:g} and "
                f"{term.at:g}",
                remedy="set the same `at` in mesh.matrices for all matrices of this parameter",
            )

    def operator(terms: Sequence[Term]) -> AffineOperator:
        parts: dict[str | None, sparse.csr_array] = {None: sparse.csr_array((len(node_ids),) * 2)}
        for term in terms:
            part = sparse.csr_array(scale @ term.matrix @ scale) * (mass_unit / term.at)
            parts[term.parameter] = parts[term.parameter] + part if term.parameter in parts else part
        return AffineOperator(parts.pop(None), {str(name): part for name, part in parts.items()})

    return ImportedMatrices(node_ids, components, operator(stiffness), operator(mass), at, source)


def row_scale(components: np.ndarray, length: float) -> np.ndarray:
    """s (r,): 1 for a translation, L for a rotation, so that s z is the motion in deck lengths times L."""
    return np.where(components < 3, 1.0, length)


def build_imported_model(mesh: Mesh, ready: ImportedMatrices) -> FullModel:
    """Put the matrices on the nodes of the mesh, with its supports and ties:

        u_rows = P z,   z = T z_free,     K_free = Bᵀ K B,   M_free = Bᵀ M B,   B = P T

    P contains the nodal axes (CD). The matrices may contain all motions, to which the supports and ties of the mesh
    are applied, or have dependent and fixed motions already removed. A motion without stiffness that does not follow
    others is left out. Raises DeckError for a node that is not in the mesh, inconsistent constraints, and a motion
    with non-positive stiffness; UserError if no motion is free or the structure is unconstrained."""
    nodes = _nodes_of(mesh, ready)
    stiff = rows_used(ready.stiffness)
    rotations = np.unique(nodes[stiff & (ready.components >= 3)])
    first = rotation_rows(mesh, rotations)
    size = 3 * len(mesh.position) + 3 * len(first)
    P = _places(mesh, nodes, ready.components, first, size)
    supported = np.zeros(size, dtype=bool)
    supported[P[np.flatnonzero(stiff)].tocoo().col] = True
    constrained_mesh = _for_constraints(mesh, nodes, ready.components, stiff)
    constraint = constraint_transform(constrained_mesh, supported=supported, rotations=rotations)
    if constraint.transform.shape[1] == 0:
        raise UserError(
            "no degree of freedom is free: each row of the matrices is fixed by a support or has no stiffness",
            remedy="remove supports from the mesh file or from mesh.supports, or check that the stiffness matrix is not empty",
        )
    B = sparse.csr_array(P @ constraint.transform)
    model = FiniteElementModel(mesh, constraint, restricted(ready.stiffness, B), restricted(ready.mass, B))
    check_diagonal(model)
    notes = (
        *unmoved_solids(mesh, constraint, len(ready.node_ids)),
        *lost_mass(mesh, ready.mass, nodes, ready.components, B),
        *check_support(model, ready.at),
    )
    return FullModel(model, B, notes)


def _nodes_of(mesh: Mesh, ready: ImportedMatrices) -> np.ndarray:
    """Index of the node of every row."""
    nodes, missing = IdTable(mesh.node_ids).rows(ready.node_ids)
    if missing.any():
        row = int(np.argmax(missing))
        raise DeckError(
            f"row {row + 1} of the matrices belongs to node {ready.node_ids[row]}, which is not in the mesh "
            f"(affected rows: {missing.sum()})",
            where=f"{ready.source}:{row + 2}" if ready.source else None,
            remedy="use a mesh with all nodes of the matrices; nodes without elements are allowed",
        )
    return nodes


def _places(
    mesh: Mesh, nodes: np.ndarray, components: np.ndarray, first: Mapping[int, int], size: int
) -> sparse.csr_array:
    """P (r, size): each row is along one axis of its node; a rotation without entry in z is zero."""
    start = 3 * nodes
    turning = components >= 3
    start[turning] = [first.get(int(node), -1) for node in nodes[turning]]
    axes = np.eye(3)[components % 3]
    for row in np.flatnonzero(np.isin(nodes, list(mesh.axes))) if mesh.axes else ():
        axes[row] = mesh.axes[int(nodes[row])][:, components[row] % 3]
    rows = np.repeat(np.arange(len(nodes)), 3)
    columns = (start[:, None] + np.arange(3)).ravel()
    keep = np.repeat(start >= 0, 3) & (axes.ravel() != 0)
    return sparse.csr_array((axes.ravel()[keep], (rows[keep], columns[keep])), shape=(len(nodes), size))


def _for_constraints(mesh: Mesh, nodes: np.ndarray, components: np.ndarray, stiff: np.ndarray) -> Mesh:
    """The mesh without its masses, and with nodal axes fixed along which a node has no stiffness. In basic axes such motions are
    left out by `supported`; nodal axes would mix them."""
    mesh = replace(mesh, point_masses=())  # included in the mass matrix
    if not mesh.axes:
        return mesh
    led = {node for tie in mesh.ties for node in (tie.reference, *tie.nodes.tolist())}
    led |= {int(node) for relation in mesh.relations for node in relation.node}
    fixed = {(int(node), int(component)) for node, component in mesh.fixed}
    has_axes = np.isin(nodes, [node for node in mesh.axes if node not in led])
    has = {(int(n), int(c)) for n, c in zip(nodes[has_axes & stiff], components[has_axes & stiff], strict=True)}
    loose = [
        (node, component)
        for node, kind in sorted({(n, c // 3) for n, c in has})
        for component in range(3 * kind, 3 * kind + 3)
        if (node, component) not in has and (node, component) not in fixed
    ]
    if not loose:
        return mesh
    return replace(mesh, fixed=np.vstack([mesh.fixed.reshape(-1, 2), np.array(loose)]))


def rows_used(operator: AffineOperator) -> np.ndarray:
    """Rows (r,) with an entry in any term."""
    return np.any([np.diff(X.indptr) > 0 for X in (operator.constant, *operator.terms.values())], axis=0)


def check_diagonal(model: FiniteElementModel) -> None:
    diagonal = model.stiffness.at(dict.fromkeys(model.stiffness.parameters, 1.0)).diagonal()
    if not np.all(diagonal > 0):
        free = int(np.argmin(diagonal > 0))
        name = describe_row(model.mesh, model.constraint, int(model.constraint.free_rows[free]))
        raise DeckError(
            f"{name}: the diagonal entry of the stiffness matrix is {diagonal[free]:g}, not positive "
            f"(affected degrees of freedom: {np.count_nonzero(~(diagonal > 0))})",
            remedy="check the stiffness matrix and the file of mesh.matrices.numbering: all diagonal entries must be positive",
        )


def unmoved_solids(mesh: Mesh, constraint: Constraint, rows: int) -> list[str]:
    """Note on translations of solids without rows in the matrices, ties or supports."""
    n = len(mesh.position)
    still = np.diff(constraint.transform[: 3 * n].tocsr().indptr).reshape(n, 3) == 0
    solid = np.zeros((n, 1), dtype=bool)
    for block in mesh.blocks:
        solid[block.nodes] = True
    still &= solid & ~held_components(mesh)
    if not still.any():
        return []
    named = mesh.node_ids[still.any(axis=1)]
    listed = ", ".join(map(str, named[:5])) + (", …" if len(named) > 5 else "")
    return [
        f"the matrices ({rows} rows) have no stiffness for some translations of solid nodes. These translations are set to "
        f"zero, so strains near these nodes are too small (translations: {np.count_nonzero(still)}; nodes: {len(named)}, "
        f"ids {listed})"
    ]


def lost_mass(
    mesh: Mesh, mass: AffineOperator, nodes: np.ndarray, components: np.ndarray, B: sparse.csr_array
) -> list[str]:
    """Note on rows with a mass that do not move although they have no support."""
    lost = rows_used(mass) & (np.diff(B.indptr) == 0)
    lost &= ~np.isin(6 * nodes + components, mesh.fixed.reshape(-1, 2) @ np.array([6, 1]))
    lost &= ~np.isin(nodes, [int(node) for e in mesh.rigid for node in e.nodes])
    lost &= ~np.isin(
        6 * nodes + components, [6 * node + c for node, c in (relation.follower for relation in mesh.relations)]
    )
    if not lost.any():
        return []
    row = int(np.argmax(lost))
    return [
        f"matrix rows with mass but without stiffness are omitted ({np.count_nonzero(lost)} in total), for example node "
        f"{mesh.node_ids[nodes[row]]}, component {components[row] + 1}"
    ]


def check_support(model: FiniteElementModel, at: Mapping[str, float]) -> list[str]:
    """Check that supports and matrices constrain the six rigid-body motions R, restricted to the free motions:

        c:  cᵀRᵀKR c < ε cᵀRᵀ diag(K) R c   is free

    Returns a note with the frequency ω² = min eig(RᵀKR, RᵀMR) if only the matrices constrain the structure. Raises
    UserError with the names of the free motions."""
    R = _rigid_motions(model)
    K, M = model.stiffness.at(at), model.mass.at(at)
    size = np.sqrt(K.diagonal() @ R**2)
    exists = size > 0  # nodes on a line have no rotation about it
    R = R[:, exists] / size[exists]
    strength, U = np.linalg.eigh(R.T @ (K.diagonal()[:, None] * R))
    W = (U / np.sqrt(np.maximum(strength, 1e-300)))[:, strength > 1e-10]  # the others move no free motion
    R = R @ W
    resistance = R.T @ (K @ R)
    energy, V = np.linalg.eigh(resistance)
    if np.any(energy < LOOSE):
        loose = np.linalg.qr(W @ V[:, energy < LOOSE])[0]
        share = np.linalg.norm(loose, axis=1)
        named = [word for word, part in zip(np.array(MOTIONS)[exists], share, strict=True) if part > 0.99]
        raise UserError(
            f"the structure can move freely ({', '.join(named) or f'rigid-body motions: {loose.shape[1]}'}): "
            "neither the supports of the mesh nor the matrices prevent this motion",
            remedy="fix nodes of the matrices (mesh.supports), or use matrices that include the supports",
        )
    if len(model.mesh.fixed):
        return []
    note = "the mesh needs no supports, because the imported stiffness matrix prevents all rigid-body motions"
    inertia = R.T @ (M @ R)
    if np.linalg.eigvalsh(inertia)[0] <= 0:
        return [note]
    softest = np.sqrt(eigh(resistance, inertia, eigvals_only=True)[0]) / (2 * np.pi)
    return [f"{note} (lowest natural frequency of the structure as a rigid body: {softest:.3g} Hz)"]


def _rigid_motions(model: FiniteElementModel) -> np.ndarray:
    """Six rigid-body motions on the free motions (n_free, 6)."""
    mesh, constraint = model.mesh, model.constraint
    R = np.zeros((constraint.transform.shape[0], 6))
    R[: 3 * len(mesh.position)] = rigid_rows(mesh.position - mesh.position.mean(axis=0)).reshape(-1, 6)
    for row in constraint.reference_rows.values():
        R[row : row + 3, 3:] = np.eye(3)
    return (R if constraint.turn is None else constraint.turn.T @ R)[constraint.free_rows]

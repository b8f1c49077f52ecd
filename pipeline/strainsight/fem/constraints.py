"""Constraints by elimination: z = T z_free, so that K and M stay symmetric and K positive definite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from strainsight.errors import DeckError
from strainsight.mesh.model import AveragingElement, Mesh, RigidElement


@dataclass(frozen=True)
class Constraint:
    """z = T z_free.

    transform T, CSR (3n + 3r, n_free): row 3·node + component for the displacements [m], then three rotations [rad]
    for each of the r reference nodes; reference_rows: node index → row of its first rotation; free_rows (n_free,): the
    row of z that each free motion is.
    """

    transform: sparse.csr_array
    reference_rows: Mapping[int, int]
    free_rows: np.ndarray


@dataclass
class _Equations:
    """Rows of z that follow others: z[row] = Σ value z[column]; by: row → the element that says so."""

    rows: list[np.ndarray]
    columns: list[np.ndarray]
    values: list[np.ndarray]
    by: dict[int, str]


def constraint_transform(mesh: Mesh) -> Constraint:
    """Clamped components (SPC), rigid elements (RBE2) and averaging elements (RBE3) as one transformation.

        RBE2   u_i = u_r + θ_r × (x_i − x_r)                                    in the stated components
        RBE3   (u_r, θ_r) = (Σ w_i R_iᵀR_i)⁻¹ Σ w_i R_iᵀ u_i,   R_i = [I, −(x_i − x_r)×]

    Chains are resolved whatever their order. Solids have no rotations: a clamped rotation counts only at a reference
    node. Motions that neither an element nor, through a rigid element, its dependents have are left out (AUTOSPC in
    Nastran). Raises DeckError, naming nodes, for a motion that two elements prescribe, that is prescribed and clamped,
    for a cycle, for an RBE3 whose nodes do not hold its reference, for a mass or an RBE3 on nodes of no stiffness.
    """
    n = len(mesh.position)
    references = sorted({e.reference for e in mesh.rigid} | {e.reference for e in mesh.averaging})
    first = {node: 3 * n + 3 * i for i, node in enumerate(references)}
    size = 3 * n + 3 * len(references)

    equations = _Equations([], [], [], {})
    for rigid in mesh.rigid:
        _add_rigid(mesh, rigid, first, equations)
    for averaging in mesh.averaging:
        _add_averaging(mesh, averaging, first, equations)

    clamped = np.zeros(size, dtype=bool)
    for node, component in mesh.fixed:
        row = _row(int(node), int(component), first)
        if row is None:
            continue
        if row in equations.by:
            raise DeckError(
                f"node {mesh.node_ids[node]} is clamped in component {component + 1} and dependent in "
                f"{equations.by[row]}",
                remedy="clamp the reference node instead, or take the node out of the element",
            )
        clamped[row] = True

    supported = _supported_rows(mesh, size)
    dependent = np.zeros(size, dtype=bool)
    dependent[list(equations.by)] = True
    independent = supported.copy()
    for node, row in first.items():
        independent[3 * node : 3 * node + 3] = independent[row : row + 3] = True
    for averaging in mesh.averaging:
        independent[_translations(averaging.nodes)] = True
    free = np.flatnonzero(independent & ~clamped & ~dependent)

    D = sparse.csr_array(
        (_joined(equations.values), (_joined(equations.rows, int), _joined(equations.columns, int))), shape=(size, size)
    )
    T = _resolved(mesh, D, free, dependent, first)
    carried = np.zeros(len(free), dtype=bool)
    carried[T[supported].tocoo().col] = True
    _check_carried(mesh, T, carried, free)
    T = T[:, np.flatnonzero(carried)].tocsr()
    T.sort_indices()
    return Constraint(T, first, free[carried])


def describe_row(mesh: Mesh, constraint: Constraint, row: int) -> str:
    """A row of z in the user's words: "node 17, translation y"."""
    n = len(mesh.position)
    if row < 3 * n:
        return f"node {mesh.node_ids[row // 3]}, translation {'xyz'[row % 3]}"
    node = next(node for node, at in constraint.reference_rows.items() if at <= row < at + 3)
    return f"node {mesh.node_ids[node]}, rotation {'xyz'[(row - 3 * n) % 3]}"


def rigid_rows(arm: np.ndarray) -> np.ndarray:
    """Six motions of a reference node → displacement at distance r: [I, −r×] (k, 3, 6), arm r (k, 3) [m]."""
    rows = np.zeros((len(arm), 3, 6))
    rows[:, :, :3] = np.eye(3)
    x, y, z = arm.T
    rows[:, 0, 4], rows[:, 0, 5] = z, -y
    rows[:, 1, 3], rows[:, 1, 5] = -z, x
    rows[:, 2, 3], rows[:, 2, 4] = y, -x
    return rows


def _translations(nodes: np.ndarray) -> np.ndarray:
    return (3 * np.asarray(nodes)[:, None] + np.arange(3)).ravel()


def _supported_rows(mesh: Mesh, size: int) -> np.ndarray:
    """Rows of z that an element acts on."""
    supported = np.zeros(size, dtype=bool)
    for block in mesh.blocks:
        supported[_translations(np.unique(block.nodes))] = True
    return supported


def _row(node: int, component: int, first: Mapping[int, int]) -> int | None:
    """Row of component 0-5 of a node; None for a rotation of a node that has none."""
    if component < 3:
        return 3 * node + component
    return first[node] + component - 3 if node in first else None


def _six(node: int, first: Mapping[int, int]) -> np.ndarray:
    return np.concatenate([3 * node + np.arange(3), first[node] + np.arange(3)])


def _joined(parts: list[np.ndarray], kind: type = float) -> np.ndarray:
    return np.concatenate(parts).astype(kind) if parts else np.zeros(0, kind)


def _claim(mesh: Mesh, equations: _Equations, row: int, node: int, name: str) -> None:
    if row in equations.by:
        raise DeckError(
            f"node {mesh.node_ids[node]} is dependent in {equations.by[row]} and in {name}",
            remedy="let it follow one of them only",
        )
    equations.by[row] = name


def _add_rigid(mesh: Mesh, e: RigidElement, first: Mapping[int, int], equations: _Equations) -> None:
    name = f"RBE2 {e.id}"
    nodes = np.asarray(e.nodes)
    if len(nodes) == 0 or e.reference in nodes:
        own = f"depends on its own reference node {mesh.node_ids[e.reference]}"
        fault = "has no dependent nodes" if len(nodes) == 0 else own
        raise DeckError(f"{name} {fault}", remedy="correct its nodes")
    motion = np.zeros((len(nodes), 6, 6))
    motion[:, :3] = rigid_rows(mesh.position[nodes] - mesh.position[e.reference])
    motion[:, 3:, 3:] = np.eye(3)
    source = _six(e.reference, first)
    for component in sorted(set(e.components)):
        for node, coefficients in zip(nodes.tolist(), motion[:, component], strict=True):
            row = _row(node, component, first)
            if row is None:
                continue
            _claim(mesh, equations, row, node, name)
            used = np.flatnonzero(coefficients)
            equations.rows.append(np.full(len(used), row))
            equations.columns.append(source[used])
            equations.values.append(coefficients[used])


def _add_averaging(mesh: Mesh, e: AveragingElement, first: Mapping[int, int], equations: _Equations) -> None:
    name = f"RBE3 {e.id}"
    nodes, w = np.asarray(e.nodes), np.asarray(e.weight, dtype=float)
    if len(nodes) == 0 or e.reference in nodes or not np.all(w >= 0) or not w.sum() > 0:
        raise DeckError(
            f"{name} needs nodes other than its reference and weights that are not negative",
            remedy="correct its nodes and weights",
        )
    arm = mesh.position[nodes] - mesh.position[e.reference]
    length = np.linalg.norm(arm, axis=1).max() or 1.0
    scale = np.array([1.0, 1.0, 1.0, length, length, length])
    R = rigid_rows(arm) / scale
    A = np.einsum("k,kci,kcj->ij", w / w.sum(), R, R)
    strength, V = np.linalg.eigh(A)
    held = strength > 1e-10 * strength[-1]
    wanted = sorted(set(e.components))
    loose = np.abs(V[:, ~held][wanted]) > 1e-6
    if loose.any():
        words = ["translation x", "translation y", "translation z", "rotation x", "rotation y", "rotation z"]
        motion = words[wanted[int(np.argmax(loose.any(axis=1)))]]
        raise DeckError(
            f"the {len(nodes)} nodes of {name} do not hold {motion} of its reference node {mesh.node_ids[e.reference]}",
            remedy="they lie on a line or a point: add nodes off it, or drop rotations from its components",
        )
    inverse = (V[:, held] / strength[held]) @ V[:, held].T
    mean = np.einsum("ij,k,kcj->ikc", inverse / scale[:, None], w / w.sum(), R).reshape(6, -1)
    for component in wanted:
        row = _row(e.reference, component, first)
        assert row is not None
        _claim(mesh, equations, row, e.reference, name)
        equations.rows.append(np.full(mean.shape[1], row))
        equations.columns.append(_translations(nodes))
        equations.values.append(mean[component])


def _resolved(
    mesh: Mesh, D: sparse.csr_array, free: np.ndarray, dependent: np.ndarray, first: Mapping[int, int]
) -> sparse.csr_array:
    """T = (I + D + D² + …) E, E the columns of the free rows; D is nilpotent unless elements follow each other."""
    size = D.shape[0]
    count, loop = connected_components(D, directed=True, connection="strong")
    if count < size:
        rows = np.flatnonzero(loop == np.argmax(np.bincount(loop)))
        owner = {row + k: node for node, row in first.items() for k in range(3)}
        nodes = sorted({int(mesh.node_ids[owner.get(int(r), int(r) // 3)]) for r in rows})
        raise DeckError(
            f"rigid elements follow each other in a circle through nodes {', '.join(map(str, nodes))}",
            remedy="make one of these nodes independent",
        )
    T = step = sparse.csr_array((np.ones(len(free)), (free, np.arange(len(free)))), shape=(size, len(free)))
    inner = D[:, np.flatnonzero(dependent)]
    while True:
        step = D @ step if step is T else inner @ step[np.flatnonzero(dependent)]
        if step.nnz == 0:
            return sparse.csr_array(T)
        T = T + step


def _check_carried(mesh: Mesh, T: sparse.csr_array, carried: np.ndarray, free: np.ndarray) -> None:
    """Masses and RBE3 may not hang on motions that nothing carries."""
    reached = np.diff(T[:, np.flatnonzero(carried)].tocsr().indptr) > 0
    lost = np.zeros(T.shape[0], dtype=bool)
    lost[T[:, np.flatnonzero(~carried)].tocoo().row] = True
    for e in mesh.averaging:
        rows = _translations(e.nodes)[np.repeat(np.asarray(e.weight) > 0, 3)]
        if lost[rows].any():
            node = int(rows[np.argmax(lost[rows])]) // 3
            raise DeckError(
                f"RBE3 {e.id} averages node {mesh.node_ids[node]}, which no element holds",
                remedy="take the node out, or connect it",
            )
    attached = {int(node) for node, _ in mesh.fixed}
    for point in mesh.point_masses:
        rows = _translations(np.array([point.node]))
        if point.mass > 0 and point.node not in attached and not reached[rows].all():
            raise DeckError(
                f"point mass {point.id} sits on node {mesh.node_ids[point.node]}, which no element holds",
                remedy="connect the node with an RBE2 or RBE3, or remove the mass",
            )

"""A model from the stiffness and mass of another program, on the nodes and constraints of a mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import AffineOperator
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.model import FiniteElementModel, restricted
from strainsight.fem.ready_checks import check_diagonal, check_support, lost_mass, rows_used, unmoved_solids
from strainsight.fem.ties import rotation_rows
from strainsight.mesh.model import Mesh


@dataclass(frozen=True)
class Term:
    """A matrix (r, r) as its file has it; parameter it is proportional to, None for a constant; at: the parameter's value
    [SI] that it was made with."""

    matrix: sparse.csr_array
    parameter: str | None = None
    at: float = 1.0


@dataclass(frozen=True)
class ReadyMatrices:
    """Stiffness and mass on numbered rows, in SI units.

    node_ids (r,) of the file and components (r,) 0-5 along the axes of the node; stiffness and mass (r, r) [N/m, N,
    N m; kg, kg m, kg m²] on translations [m] and rotations [rad]; at: the parameters' values [SI] of the files;
    source: where the numbering stands.
    """

    node_ids: np.ndarray
    components: np.ndarray
    stiffness: AffineOperator
    mass: AffineOperator
    at: Mapping[str, float]
    source: str = ""


@dataclass(frozen=True)
class ReadyModel:
    """model; motion B, CSR (r, n_free): the rows of the matrices that the free motions cause; notes: sentences for a warning."""

    model: FiniteElementModel
    motion: sparse.csr_array
    notes: tuple[str, ...]


def ready_matrices(
    node_ids: np.ndarray,
    components: np.ndarray,
    stiffness: Sequence[Term],
    mass: Sequence[Term],
    length: float = 1.0,
    mass_unit: float = 1.0,
    source: str = "",
) -> ReadyMatrices:
    """Terms in deck units → affine operators in SI:

        X(θ) = Σ M s_i s_j X_ij θ/at,     s = 1 for translations, L for rotations

    length L [m] and mass_unit M [kg] of the deck; time in s, angles in rad. Raises UserError where one parameter has two
    values in `at`.
    """
    scale = sparse.diags_array(row_scale(components, length))
    at: dict[str, float] = {}
    for term in (*stiffness, *mass):
        if term.parameter is not None and at.setdefault(term.parameter, term.at) != term.at:
            raise UserError(
                f"terms of {term.parameter} were made at {at[term.parameter]:g} and at {term.at:g}",
                remedy="one value for all terms of a parameter",
            )

    def operator(terms: Sequence[Term]) -> AffineOperator:
        parts: dict[str | None, sparse.csr_array] = {None: sparse.csr_array((len(node_ids),) * 2)}
        for term in terms:
            part = sparse.csr_array(scale @ term.matrix @ scale) * (mass_unit / term.at)
            parts[term.parameter] = parts[term.parameter] + part if term.parameter in parts else part
        return AffineOperator(parts.pop(None), {str(name): part for name, part in parts.items()})

    return ReadyMatrices(node_ids, components, operator(stiffness), operator(mass), at, source)


def row_scale(components: np.ndarray, length: float) -> np.ndarray:
    """s (r,): 1 for a translation, L for a rotation, so that s z is the motion in the deck's lengths times L."""
    return np.where(components < 3, 1.0, length)


def build_ready_model(mesh: Mesh, ready: ReadyMatrices) -> ReadyModel:
    """Put the matrices on the nodes of the mesh, under its supports and ties:

        u_rows = P z,   z = T z_free,     K_free = Bᵀ K B,   M_free = Bᵀ M B,   B = P T

    P has the axes of the node (CD) in it. Both kinds of matrices fit: those of all motions, of which the mesh's supports
    and ties then take their part, and those from which dependent and clamped motions were removed. A motion without
    stiffness of its own that nothing leads is left out.
    Raises DeckError for a node that the mesh lacks, for constraints that contradict each other, and for a motion that
    the stiffness couples but does not hold; UserError where nothing is free or nothing holds the structure.
    """
    nodes = _nodes_of(mesh, ready)
    stiff = rows_used(ready.stiffness)
    rotations = np.unique(nodes[stiff & (ready.components >= 3)])
    first = rotation_rows(mesh, rotations)
    size = 3 * len(mesh.position) + 3 * len(first)
    P = _places(mesh, nodes, ready.components, first, size)
    supported = np.zeros(size, dtype=bool)
    supported[P[np.flatnonzero(stiff)].tocoo().col] = True
    held = _for_constraints(mesh, nodes, ready.components, stiff)
    constraint = constraint_transform(held, supported=supported, rotations=rotations)
    if constraint.transform.shape[1] == 0:
        raise UserError("no motion is free: every row is clamped or has no stiffness", remedy="free some nodes")
    B = sparse.csr_array(P @ constraint.transform)
    model = FiniteElementModel(mesh, constraint, restricted(ready.stiffness, B), restricted(ready.mass, B))
    check_diagonal(model)
    notes = (
        *unmoved_solids(mesh, constraint, len(ready.node_ids)),
        *lost_mass(mesh, ready.mass, nodes, ready.components, B),
        *check_support(model, ready.at),
    )
    return ReadyModel(model, B, notes)


def _nodes_of(mesh: Mesh, ready: ReadyMatrices) -> np.ndarray:
    """Index of the node of every row."""
    order = np.argsort(mesh.node_ids, kind="stable")
    at = np.minimum(np.searchsorted(mesh.node_ids, ready.node_ids, sorter=order), len(order) - 1)
    nodes = order[at]
    missing = np.flatnonzero(mesh.node_ids[nodes] != ready.node_ids)
    if missing.size:
        row = int(missing[0])
        raise DeckError(
            f"row {row + 1} of the matrices is of node {ready.node_ids[row]}, which the mesh lacks ({missing.size} such rows)",
            where=f"{ready.source}:{row + 2}" if ready.source else None,
            remedy="give a mesh with all nodes of the matrices; nodes without elements are welcome",
        )
    return nodes


def _places(
    mesh: Mesh, nodes: np.ndarray, components: np.ndarray, first: Mapping[int, int], size: int
) -> sparse.csr_array:
    """P (r, size): the motion of a row is along one axis of its node; a rotation that has no place in z is zero."""
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
    """The mesh without its masses, and with those axes of a node clamped along which alone it has no stiffness.

    Along the basic axes such a motion is left out by `supported`; a node with axes of its own mixes them.
    """
    mesh = replace(mesh, point_masses=())  # they are in the mass
    if not mesh.axes:
        return mesh
    ties = [(e.reference, e.nodes) for e in mesh.rigid] + [(e.reference, e.nodes) for e in mesh.averaging]
    led = {node for reference, nodes_of_it in ties for node in (reference, *np.asarray(nodes_of_it).tolist())}
    led |= {int(node) for relation in mesh.relations for node in relation.node}
    taken = {(int(node), int(component)) for node, component in mesh.fixed}
    own = np.isin(nodes, [node for node in mesh.axes if node not in led])
    has = {(int(n), int(c)) for n, c in zip(nodes[own & stiff], components[own & stiff], strict=True)}
    loose = [
        (node, component)
        for node, kind in sorted({(n, c // 3) for n, c in has})
        for component in range(3 * kind, 3 * kind + 3)
        if (node, component) not in has and (node, component) not in taken
    ]
    if not loose:
        return mesh
    return replace(mesh, fixed=np.vstack([mesh.fixed.reshape(-1, 2), np.array(loose)]))

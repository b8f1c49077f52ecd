"""Constraints by elimination: z = T z_free, so that K and M stay symmetric and K positive definite."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from strainsight.errors import DeckError
from strainsight.fem.affine import from_entries
from strainsight.fem.beam_matrices import GAUSS, beam_strains
from strainsight.fem.by_region import poisson_ratios
from strainsight.fem.equations import (
    Equations,
    MotionRows,
    entity_of,
    equations,
    local_axes,
    references,
    relation_terms,
    rigid_rows,
    rotation_rows,
    translation_rows,
)
from strainsight.fem.springs import sprung_rows
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import BeamBlock
from strainsight.mesh.thin_faces import ALONG, SIDES, around, axes_along


@dataclass(frozen=True)
class Constraint:
    """z = T z_free, with z along the basic axes.

    transform T, CSR (3n + 3r, n_free): row 3·node + component for the displacements [m], then three rotations [rad]
    for each of the r nodes with rotations; reference_rows: node index → row of its first rotation; free_rows (n_free,): the
    row of z' = Qᵀz of each free motion; turn Q, CSR: block-diagonal local axes of the nodes whose components are clamped or
    tied in a local coordinate system, None without any."""

    transform: sparse.csr_array
    reference_rows: Mapping[int, int]
    free_rows: np.ndarray
    turn: sparse.csr_array | None = None

    def rotations(self, nodes: np.ndarray) -> np.ndarray:
        """Rows (k, 3) of z of the rotations of nodes (k,)."""
        first = np.array([self.reference_rows[node] for node in nodes.tolist()], dtype=np.int64)
        return first[:, None] + np.arange(3)

    def along_local_axes(self, X: sparse.csr_array) -> sparse.csr_array:
        """Rows of z → rows of z' (local axes): Qᵀ X."""
        return X if self.turn is None else sparse.csr_array(self.turn.T @ X)


def constraint_transform(
    mesh: Mesh, *, supported: np.ndarray | None = None, rotations: Sequence[int] | np.ndarray = ()
) -> Constraint:
    """Clamped components, rigid elements, averaging elements and relations as one transformation.

        z = Q z',   z' = D z' + E z_free,   T = Q (I + D + D² + …) E

    z' are motions along the local axes (CD) of each node, which supports and elements refer to; D contains the `equations`
    of the elements, E selects the free rows. Chains are resolved in any order. Rotations are those of reference nodes, of
    nodes whose rotations are in a relation or a mean, and of the nodes `rotations` (indices); solids have none. Motions
    without stiffness are left out (AUTOSPC in Nastran): neither they nor their dependents are `supported` rows (3n + 3r,) of z
    (default: those of solids and springs).
    Raises DeckError that names nodes for a motion that two elements prescribe, that is dependent and clamped, for a cycle,
    for an RBE3 whose nodes do not determine its reference, for a mass or an RBE3 on nodes without stiffness."""
    n = len(mesh.position)
    rows = MotionRows(n, rotation_rows(mesh, rotations), local_axes(mesh))
    dependencies = equations(mesh, rows)
    clamped = _clamped(mesh, rows, dependencies)
    Q = rows.turn()

    if supported is None:
        supported = np.zeros(rows.size, dtype=bool)
        supported[translation_rows(mesh.nodes_of_elements)] = True
        supported[sprung_rows(mesh, rows.first)] = True
        supported[3 * mesh.own_nodes : 3 * n] = False  # arms follow their nodes
        for node in set(mesh.turning.tolist()) & rows.first.keys():
            supported[rows.first[node] : rows.first[node] + 3] = True
    independent = supported.copy() if Q is None else np.asarray(abs(Q).T @ supported.astype(float) > 0)
    for node in references(mesh):
        independent[rows.of(np.full(6, node), np.arange(6))] = True
    for averaging in mesh.averaging:
        independent[rows.averaged(averaging)] = True
    _, node, component, value = relation_terms(mesh)
    independent[rows.of(node, component)[value != 0]] = True
    independent[clamped] = False
    independent[list(dependencies.by)] = False
    free = np.flatnonzero(independent)

    local = _resolve_chains(mesh, rows, dependencies, free)
    T = local if Q is None else sparse.csr_array(Q @ local)
    if len(mesh.arms):
        T = with_arms(mesh, rows, T)
    has_stiffness = np.zeros(len(free), dtype=bool)
    has_stiffness[T[np.flatnonzero(supported)].tocoo().col] = True
    _check_has_stiffness(mesh, rows, local, has_stiffness)
    if not has_stiffness.all():
        T = T[:, np.flatnonzero(has_stiffness)].tocsr()
    T.sort_indices()
    if max(T.nnz, rows.size) < 2**31:  # or every product with T, as large as K, has column numbers of 8 bytes
        T = sparse.csr_array((T.data, T.indices.astype(np.int32), T.indptr.astype(np.int32)), shape=T.shape)
    return Constraint(T, rows.first, free[has_stiffness], Q)


def describe_row(mesh: Mesh, constraint: Constraint, row: int) -> str:
    """A row of z' in words: "node 17, translation y", or "translation 2 in its local coordinate system"."""
    n = len(mesh.position)
    if row < 3 * n:
        node, component, word = row // 3, row % 3, "translation"
    else:
        node = next(node for node, at in constraint.reference_rows.items() if at <= row < at + 3)
        component, word = (row - 3 * n) % 3, "rotation"
    if constraint.turn is not None and node in mesh.axes:
        return f"node {mesh.node_ids[node]}, {word} {component + 1} in its local coordinate system"
    return f"node {mesh.node_ids[node]}, {word} {'xyz'[component]}"


def _clamped(mesh: Mesh, rows: MotionRows, dependencies: Equations) -> np.ndarray:
    """Rows of clamped motions; a rotation of a node without rotations is left out."""
    fixed = np.asarray(mesh.fixed, dtype=np.int64).reshape(-1, 2)
    clamped = rows.of(fixed[:, 0], fixed[:, 1])
    for (node, component), row in zip(fixed.tolist(), clamped.tolist(), strict=True):
        if row in dependencies.by:
            raise DeckError(
                f"component {component + 1} of node {mesh.node_ids[node]} is clamped, but also dependent in "
                f"{dependencies.by[row]}",
                remedy=f"Clamp an independent node of {dependencies.by[row]} instead, or remove this node from the dependent "
                "nodes.",
                entity=entity_of(dependencies.by[row]),
            )
    return clamped[clamped >= 0]


def _resolve_chains(mesh: Mesh, rows: MotionRows, dependencies: Equations, free: np.ndarray) -> sparse.csr_array:
    """(I + D + D² + …) E, E the columns of the free rows; D is nilpotent unless elements form a cycle."""
    D, size = dependencies.matrix(), rows.size
    T = step = sparse.csr_array((np.ones(len(free)), (free, np.arange(len(free)))), shape=(size, len(free)))
    if not dependencies.by:
        return T
    count, loop = connected_components(D, directed=True, connection="strong")
    if count < size:
        inside = np.flatnonzero(loop == np.argmax(np.bincount(loop)))
        owner = {row + k: node for node, row in rows.first.items() for k in range(3)}
        nodes = sorted({int(mesh.node_ids[owner.get(int(row), int(row) // 3)]) for row in inside})
        raise DeckError(
            f"ties form a cycle through nodes {', '.join(map(str, nodes))}: each of these nodes depends on itself",
            remedy="Remove one of these nodes from the dependent nodes of its tie.",
            entity=entity_of(dependencies.by[int(inside[0])]),
        )
    dependent = np.fromiter(dependencies.by, dtype=np.int64)
    inner = D[:, dependent]
    while True:
        step = D @ step if step is T else inner @ step[dependent]
        if step.nnz == 0:
            return sparse.csr_array(T)
        T = T + step


def _check_has_stiffness(mesh: Mesh, rows: MotionRows, T: sparse.csr_array, has_stiffness: np.ndarray) -> None:
    """Raise DeckError for masses and averaging elements on motions without stiffness."""
    if not mesh.averaging and not mesh.point_masses:
        return
    reached = np.diff(T[:, np.flatnonzero(has_stiffness)].tocsr().indptr) > 0
    unsupported = np.zeros(T.shape[0], dtype=bool)
    unsupported[T[:, np.flatnonzero(~has_stiffness)].tocoo().row] = True
    for tie in mesh.averaging:
        counts = np.repeat(np.asarray(tie.weight)[:, None] > 0, 3, axis=1)
        counted = (counts if tie.directions is None else counts & tie.directions).ravel()
        if tie.rotations is not None:
            counted = np.concatenate([counted, tie.rotations[tie.rotations.any(axis=1)].ravel()])
        rows_of_mean, nodes_of_mean = (
            rows.averaged(tie)[counted],
            np.repeat(np.concatenate([tie.nodes, tie.turned]), 3)[counted],
        )
        if unsupported[rows_of_mean].any():
            node = int(nodes_of_mean[np.argmax(unsupported[rows_of_mean])])
            raise DeckError(
                f"{tie} averages node {mesh.node_ids[node]}, which is connected to no element",
                remedy="Remove the node from the averaging element, or connect the node to an element.",
                entity=("tie", tie.id),
            )
    attached = {int(node) for node, _ in mesh.fixed}
    for point in mesh.point_masses:
        if point.mass > 0 and point.node not in attached and not reached[translation_rows([point.node])].all():
            raise DeckError(
                f"point mass {point.id} is on node {mesh.node_ids[point.node]}, which is connected to no element",
                remedy="Tie the node to the solids (mesh.ties), or remove the mass.",
                entity=("node", int(mesh.node_ids[point.node])),
            )


def with_arms(mesh: Mesh, rows: MotionRows, T: sparse.csr_array) -> sparse.csr_array:
    """T of z = T z_free (3n + 3r, n_free), extended by the nodes that follow a node of a shell or beam on a rigid arm:

        u_a = u + θ × (x_a − x),     on a side of a beam also  − ν ε d  ∓ ½ γ L ŝ

    ŝ across the beam in the side, d along it from the middle of the side, ε the axial strain of that middle: the side
    contracts as in uniaxial stress. γ = (u_B − u_A)·ŝ/L − ½(θ_A + θ_B)·(x̂ × ŝ) of the ends (− at B): bending rotates straight
    sides by γ relative to their sections, because the deflection between nodes is not linear; γ is not shear."""
    T = sparse.csr_array(T + _arm_matrix(mesh, rows) @ T)
    sides = [block for block in mesh.beams if (block.on_sides >= 0).any()]
    for block in sides:
        side_terms = _curved_side_terms if block.nodes.shape[1] == 3 else _side_terms
        T = sparse.csr_array(T + side_terms(mesh, block, rows) @ T)
    return T


def _arm_matrix(mesh: Mesh, rows: MotionRows) -> sparse.csr_array:
    arm, reference = mesh.arms.T
    leads = rows.of(reference[:, None], np.arange(6))
    values = rigid_rows(mesh.position[arm] - mesh.position[reference])
    row = (3 * arm[:, None] + np.arange(3))[:, :, None]
    return from_entries([(values, row, leads[:, None, :])], (rows.size, rows.size))


def _side_terms(mesh: Mesh, block: BeamBlock, rows: MotionRows) -> sparse.csr_array:
    """Terms that the sides (s) of the beams of a block add to their rigid arms."""
    element, side = np.nonzero(block.on_sides[:, :, 0] >= 0)
    corners, ends = block.on_sides[element, side], block.nodes[element]
    x, node = mesh.position[corners], mesh.position[ends] + block.offset[element]
    along, across = block.axes[element, :, 0], block.axes[element][np.arange(len(element)), :, 2 - side % 2]
    length = np.linalg.norm(node[:, 1] - node[:, 0], axis=1)
    # end of the beam at each corner, by its position along the beam
    at_b = np.einsum("sci,si->sc", x - node[:, :1], along) > 0.5 * length[:, None]
    sign = np.where(at_b, 1.0, -1.0)
    d = np.einsum("sci,si->sc", x - x.mean(axis=1, keepdims=True), across)
    nu = poisson_ratios(mesh, block.region[element])
    strain = (0.5 * sign / length[:, None])[:, :, None] * along[:, None]
    contraction = -(nu[:, None] * d)[:, :, None, None, None] * across[:, None, :, None, None] * strain[:, None, None]
    # γ on the six motions of both nodes
    arms = rigid_rows(block.offset[element].reshape(-1, 3)).reshape(-1, 2, 3, 6)
    slope = np.einsum("e,s,si,seik->sek", [-1.0, 1.0], 1 / length, across, arms)
    slope[:, :, 3:] -= 0.5 * np.cross(along, across)[:, None]
    rotation = (
        -0.5 * (sign * length[:, None])[:, :, None, None, None] * across[:, None, :, None, None] * slope[:, None, None]
    )
    corner = 3 * corners[:, :, None] + np.arange(3)
    row, six = corner[..., None, None], rows.of(ends[:, :, None], np.arange(6))
    entries = [(contraction, row, corner[:, None, None]), (rotation, row, six[:, None, None])]
    return from_entries(entries, (rows.size, rows.size))


def _curved_side_terms(mesh: Mesh, block: BeamBlock, rows: MotionRows) -> sparse.csr_array:
    """The same for beams of three nodes, on the six motions of these."""
    element, side = np.nonzero(block.on_sides[:, :, 0] >= 0)
    corners, nodes, offset = block.on_sides[element, side], block.nodes[element], block.offset[element]
    position = mesh.position[nodes]
    axes, size = axes_along(position + offset, block.axes[element], ALONG)
    strains = beam_strains(position, block.axes[element], offset, GAUSS)
    # from the Gauss points to A, B and the middle node
    line = np.stack([0.5 * (1 + ALONG / GAUSS[0]), 0.5 * (1 + ALONG / GAUSS[1])], axis=1)
    nu = poisson_ratios(mesh, block.region[element])
    value = np.zeros((len(element), 8, 3, 18))
    for number, (axis, sign) in enumerate(SIDES):
        on_side = np.flatnonzero(side == number)
        if not len(on_side):
            continue
        at = np.array([node for node, _ in around(axis, sign)])
        arm = mesh.position[corners[on_side]] - (position + offset)[on_side][:, at]
        y, z = (np.einsum("sci,sci->sc", arm, axes[on_side][:, at][..., i]) for i in (1, 2))
        # the middle of the side: the mean with the corner at the same place of the beam on its other edge
        out, along = (y, z) if axis == 0 else (z, y)
        middle = np.stack([along[:, (at == at[c])].mean(axis=1) for c in range(8)], axis=1)
        my, mz = (out, middle) if axis == 0 else (middle, out)
        B = np.einsum("pg,sgrm->sprm", line, strains[on_side])[:, at]
        strain = B[:, :, 0] - my[..., None] * B[:, :, 5] + mz[..., None] * B[:, :, 4]
        shift = -(nu[on_side, None] * (along - middle))[..., None] * strain
        gamma = strains[on_side][:, :, 2 - axis]  # along z of the sides ±y, along y of the sides ±z
        mean, rise = gamma.mean(axis=1), 0.5 * (gamma[:, 1] - gamma[:, 0]) / GAUSS[1]
        xi = ALONG[at]
        shift -= size[on_side, 2, None, None] * (xi[:, None] * mean[:, None] + 0.5 * xi[:, None] ** 2 * rise[:, None])
        value[on_side] = axes[on_side][:, at][..., 2 - axis, None] * shift[:, :, None]
    row = (3 * corners[:, :, None] + np.arange(3))[..., None]
    return from_entries(
        [(value, row, rows.of(nodes[:, :, None], np.arange(6)).reshape(-1, 1, 1, 18))], (rows.size, rows.size)
    )

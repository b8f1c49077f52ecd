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
    references,
    relation_terms,
    rigid_rows,
    rotation_rows,
    translation_rows,
    turned_nodes,
)
from strainsight.fem.springs import sprung_rows
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import BeamBlock
from strainsight.mesh.thin_faces import ALONG, SIDES, around, axes_along


@dataclass(frozen=True)
class Constraint:
    """z = T z_free, with z along the basic axes.

    transform T, CSR (3n + 3r, n_free): row 3·node + component for the displacements [m], then three rotations [rad]
    for each of the r nodes that have them; reference_rows: node index → row of its first rotation; free_rows (n_free,): the
    row of z' = Qᵀz that each free motion is; turn Q, CSR: the axes of the nodes whose components are held or tied along
    axes of their own on its diagonal, None where there are none.
    """

    transform: sparse.csr_array
    reference_rows: Mapping[int, int]
    free_rows: np.ndarray
    turn: sparse.csr_array | None = None

    def rotations(self, nodes: np.ndarray) -> np.ndarray:
        """Rows (k, 3) of z of the rotations of nodes (k,) that have some."""
        first = np.array([self.reference_rows[node] for node in nodes.tolist()], dtype=np.int64)
        return first[:, None] + np.arange(3)

    def along_own_axes(self, X: sparse.csr_array) -> sparse.csr_array:
        """Rows of z → rows of z': Qᵀ X."""
        return X if self.turn is None else sparse.csr_array(self.turn.T @ X)


def constraint_transform(
    mesh: Mesh, *, supported: np.ndarray | None = None, rotations: Sequence[int] | np.ndarray = ()
) -> Constraint:
    """Clamped components, rigid elements, averaging elements and relations as one transformation.

        z = Q z',   z' = D z' + E z_free,   T = Q (I + D + D² + …) E

    z' are motions along the axes of each node (CD), which supports and elements mean; D holds the `equations` of the
    elements, E picks the free rows. Chains are resolved whatever their order. Rotations are those of reference nodes, of those
    whose rotations are in a relation or a mean, and of the nodes `rotations` (indices), others are left out: solids have
    none. Motions that neither `supported` rows (3n + 3r,) of z (those of the solids and springs where it is not given) nor,
    through elements, their dependents have are left out too (AUTOSPC in Nastran).
    Raises DeckError, naming nodes, for a motion that two elements prescribe, that is prescribed and clamped, for a cycle,
    for an RBE3 whose nodes do not hold its reference, for a mass or an RBE3 on nodes of no stiffness.
    """
    n = len(mesh.position)
    rows = MotionRows(n, rotation_rows(mesh, rotations), turned_nodes(mesh))
    found = equations(mesh, rows)
    clamped = _clamped(mesh, rows, found)
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
    independent[list(found.by)] = False
    free = np.flatnonzero(independent)

    own = _resolved(mesh, rows, found, free)
    T = own if Q is None else sparse.csr_array(Q @ own)
    if len(mesh.arms):
        T = with_arms(mesh, rows, T)
    carried = np.zeros(len(free), dtype=bool)
    carried[T[np.flatnonzero(supported)].tocoo().col] = True
    _check_carried(mesh, rows, own, carried)
    if not carried.all():
        T = T[:, np.flatnonzero(carried)].tocsr()
    T.sort_indices()
    if max(T.nnz, rows.size) < 2**31:  # or every product with T, as large as K, has column numbers of 8 bytes
        T = sparse.csr_array((T.data, T.indices.astype(np.int32), T.indptr.astype(np.int32)), shape=T.shape)
    return Constraint(T, rows.first, free[carried], Q)


def describe_row(mesh: Mesh, constraint: Constraint, row: int) -> str:
    """A row of z' in the user's words: "node 17, translation y"; "translation 2 along its own axes" where it has some."""
    n = len(mesh.position)
    if row < 3 * n:
        node, component, word = row // 3, row % 3, "translation"
    else:
        node = next(node for node, at in constraint.reference_rows.items() if at <= row < at + 3)
        component, word = (row - 3 * n) % 3, "rotation"
    if constraint.turn is not None and node in mesh.axes:
        return f"node {mesh.node_ids[node]}, {word} {component + 1} along its own axes"
    return f"node {mesh.node_ids[node]}, {word} {'xyz'[component]}"


def _clamped(mesh: Mesh, rows: MotionRows, found: Equations) -> np.ndarray:
    """Rows that are held; a rotation of a node that has none is left out."""
    fixed = np.asarray(mesh.fixed, dtype=np.int64).reshape(-1, 2)
    held = rows.of(fixed[:, 0], fixed[:, 1])
    for (node, component), row in zip(fixed.tolist(), held.tolist(), strict=True):
        if row in found.by:
            raise DeckError(
                f"node {mesh.node_ids[node]} is clamped in component {component + 1} and dependent in {found.by[row]}",
                remedy="clamp the reference node instead, or take the node out of the element",
                entity=entity_of(found.by[row]),
            )
    return held[held >= 0]


def _resolved(mesh: Mesh, rows: MotionRows, found: Equations, free: np.ndarray) -> sparse.csr_array:
    """(I + D + D² + …) E, E the columns of the free rows; D is nilpotent unless elements follow each other."""
    D, size = found.matrix(), rows.size
    T = step = sparse.csr_array((np.ones(len(free)), (free, np.arange(len(free)))), shape=(size, len(free)))
    if not found.by:
        return T
    count, loop = connected_components(D, directed=True, connection="strong")
    if count < size:
        inside = np.flatnonzero(loop == np.argmax(np.bincount(loop)))
        owner = {row + k: node for node, row in rows.first.items() for k in range(3)}
        nodes = sorted({int(mesh.node_ids[owner.get(int(row), int(row) // 3)]) for row in inside})
        raise DeckError(
            f"ties follow each other in a circle through nodes {', '.join(map(str, nodes))}",
            remedy="make one of these nodes independent",
            entity=entity_of(found.by[int(inside[0])]),
        )
    dependent = np.fromiter(found.by, dtype=np.int64)
    inner = D[:, dependent]
    while True:
        step = D @ step if step is T else inner @ step[dependent]
        if step.nnz == 0:
            return sparse.csr_array(T)
        T = T + step


def _check_carried(mesh: Mesh, rows: MotionRows, T: sparse.csr_array, carried: np.ndarray) -> None:
    """Masses and averaging elements may not hang on motions that nothing carries."""
    if not mesh.averaging and not mesh.point_masses:
        return
    reached = np.diff(T[:, np.flatnonzero(carried)].tocsr().indptr) > 0
    lost = np.zeros(T.shape[0], dtype=bool)
    lost[T[:, np.flatnonzero(~carried)].tocoo().row] = True
    for e in mesh.averaging:
        counts = np.repeat(np.asarray(e.weight)[:, None] > 0, 3, axis=1)
        counted = (counts if e.directions is None else counts & e.directions).ravel()
        if e.rotations is not None:
            counted = np.concatenate([counted, e.rotations[e.rotations.any(axis=1)].ravel()])
        own, of = rows.averaged(e)[counted], np.repeat(np.concatenate([e.nodes, e.turned]), 3)[counted]
        if lost[own].any():
            node = int(of[np.argmax(lost[own])])
            raise DeckError(
                f"{e} averages node {mesh.node_ids[node]}, which no element holds",
                remedy="take the node out, or connect it",
                entity=("tie", e.id),
            )
    attached = {int(node) for node, _ in mesh.fixed}
    for point in mesh.point_masses:
        if point.mass > 0 and point.node not in attached and not reached[translation_rows([point.node])].all():
            raise DeckError(
                f"point mass {point.id} sits on node {mesh.node_ids[point.node]}, which no element holds",
                remedy="tie the node to the solids (mesh.ties), or remove the mass",
                entity=("node", int(mesh.node_ids[point.node])),
            )


def with_arms(mesh: Mesh, rows: MotionRows, T: sparse.csr_array) -> sparse.csr_array:
    """T of z = T z_free (3n + 3r, n_free), with its rows of the nodes that follow one of a shell or beam as rigid arms:

        u_a = u + θ × (x_a − x),     on a side of a beam  − ν ε d  ∓ ½ γ L ŝ  too

    ŝ across the beam in the side, d along it from the middle of the side, ε the strain of that middle along the beam: the side
    contracts as in uniaxial stress. γ = (u_B − u_A)·ŝ/L − ½(θ_A + θ_B)·(x̂ × ŝ) of the ends (− at B): so much are straight
    sides turned against their sections by bending alone, as the deflection between nodes is none of a line; it is no shear.
    """
    T = sparse.csr_array(T + _rigid(mesh, rows) @ T)
    sides = [block for block in mesh.beams if (block.on_sides >= 0).any()]
    for block in sides:
        own = _of_curved_sides if block.nodes.shape[1] == 3 else _of_sides
        T = sparse.csr_array(T + own(mesh, block, rows) @ T)
    return T


def _rigid(mesh: Mesh, rows: MotionRows) -> sparse.csr_array:
    arm, reference = mesh.arms.T
    leads = rows.of(reference[:, None], np.arange(6))
    values = rigid_rows(mesh.position[arm] - mesh.position[reference])
    row = (3 * arm[:, None] + np.arange(3))[:, :, None]
    return from_entries([(values, row, leads[:, None, :])], (rows.size, rows.size))


def _of_sides(mesh: Mesh, block: BeamBlock, rows: MotionRows) -> sparse.csr_array:
    """What the sides (s) of the beams of a block add to their rigid arms."""
    element, side = np.nonzero(block.on_sides[:, :, 0] >= 0)
    corners, ends = block.on_sides[element, side], block.nodes[element]
    x, node = mesh.position[corners], mesh.position[ends] + block.offset[element]
    along, across = block.axes[element, :, 0], block.axes[element][np.arange(len(element)), :, 2 - side % 2]
    length = np.linalg.norm(node[:, 1] - node[:, 0], axis=1)
    # which end each corner is at, by its place along the beam
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
    turned = (
        -0.5 * (sign * length[:, None])[:, :, None, None, None] * across[:, None, :, None, None] * slope[:, None, None]
    )
    corner = 3 * corners[:, :, None] + np.arange(3)
    row, six = corner[..., None, None], rows.of(ends[:, :, None], np.arange(6))
    entries = [(contraction, row, corner[:, None, None]), (turned, row, six[:, None, None])]
    return from_entries(entries, (rows.size, rows.size))


def _of_curved_sides(mesh: Mesh, block: BeamBlock, rows: MotionRows) -> sparse.csr_array:
    """The same of beams of three nodes, on the six motions of these."""
    element, side = np.nonzero(block.on_sides[:, :, 0] >= 0)
    corners, nodes, offset = block.on_sides[element, side], block.nodes[element], block.offset[element]
    position = mesh.position[nodes]
    axes, size = axes_along(position + offset, block.axes[element], ALONG)
    strains = beam_strains(position, block.axes[element], offset, GAUSS)
    # from the points of Gauss to A, B and between
    line = np.stack([0.5 * (1 + ALONG / GAUSS[0]), 0.5 * (1 + ALONG / GAUSS[1])], axis=1)
    nu = poisson_ratios(mesh, block.region[element])
    value = np.zeros((len(element), 8, 3, 18))
    for number, (axis, sign) in enumerate(SIDES):
        own = np.flatnonzero(side == number)
        if not len(own):
            continue
        at = np.array([node for node, _ in around(axis, sign)])
        arm = mesh.position[corners[own]] - (position + offset)[own][:, at]
        y, z = (np.einsum("sci,sci->sc", arm, axes[own][:, at][..., i]) for i in (1, 2))
        # of the middle of the side: which node stands at the same place of the beam on its other edge
        out, along = (y, z) if axis == 0 else (z, y)
        middle = np.stack([along[:, (at == at[c])].mean(axis=1) for c in range(8)], axis=1)
        my, mz = (out, middle) if axis == 0 else (middle, out)
        B = np.einsum("pg,sgrm->sprm", line, strains[own])[:, at]
        strain = B[:, :, 0] - my[..., None] * B[:, :, 5] + mz[..., None] * B[:, :, 4]
        shift = -(nu[own, None] * (along - middle))[..., None] * strain
        gamma = strains[own][:, :, 2 - axis]  # along z of the sides ±y, along y of the sides ±z
        mean, rise = gamma.mean(axis=1), 0.5 * (gamma[:, 1] - gamma[:, 0]) / GAUSS[1]
        xi = ALONG[at]
        shift -= size[own, 2, None, None] * (xi[:, None] * mean[:, None] + 0.5 * xi[:, None] ** 2 * rise[:, None])
        value[own] = axes[own][:, at][..., 2 - axis, None] * shift[:, :, None]
    row = (3 * corners[:, :, None] + np.arange(3))[..., None]
    return from_entries(
        [(value, row, rows.of(nodes[:, :, None], np.arange(6)).reshape(-1, 1, 1, 18))], (rows.size, rows.size)
    )

"""Row numbers of nodal motions, and equations of the dependent motions."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError
from strainsight.fem.affine import from_entries
from strainsight.mesh.joins import AveragingElement, Relation, RigidElement
from strainsight.mesh.model import Mesh

ROUNDING = 1e-13
"""Share of the largest coefficient of an equation: a smaller coefficient is rounding."""

Tie = RigidElement | AveragingElement | Relation


def entity_of(e: Tie) -> tuple[str, int]:
    """Kind and id of a tie for error messages, as `Mesh.where` expects them."""
    return ("relation" if isinstance(e, Relation) else "tie", e.id)


def translation_rows(nodes: np.ndarray | list[int]) -> np.ndarray:
    """Rows (3k,) of z of the translations of nodes (k,)."""
    return (3 * np.asarray(nodes, dtype=np.int64)[:, None] + np.arange(3)).ravel()


@dataclass(frozen=True)
class MotionRows:
    """Row numbers of the motions in z': 3·node + component, then three rotations of each node with rotations.

    nodes n; first: node → row of its first rotation; axes: node → (3, 3) local axes of its components, one in a column;
    nodes without an entry use the basic axes."""

    nodes: int
    first: Mapping[int, int]
    axes: Mapping[int, np.ndarray]

    @property
    def size(self) -> int:
        """3n + 3r."""
        return 3 * self.nodes + 3 * len(self.first)

    def of(self, nodes: np.ndarray, components: np.ndarray | int) -> np.ndarray:
        """Rows of components 0-5 of nodes, which broadcast; −1 for a rotation of a node without rotations."""
        nodes, components = np.broadcast_arrays(np.asarray(nodes, dtype=np.int64), components)
        rows = 3 * nodes + components
        is_rotation = components > 2
        rows[is_rotation] = [
            self.first[node] + c - 3 if node in self.first else -1
            for node, c in zip(nodes[is_rotation].tolist(), components[is_rotation].tolist(), strict=True)
        ]
        return rows

    def averaged(self, e: AveragingElement) -> np.ndarray:
        """Rows of the motions in a mean: translations of all nodes, then rotations of the nodes whose rotations count."""
        rotation_nodes = np.repeat(e.turned, 3)
        return np.concatenate(
            [translation_rows(e.nodes), self.of(rotation_nodes, np.arange(len(rotation_nodes)) % 3 + 3)]
        )

    def axes_of(self, nodes: np.ndarray) -> np.ndarray:
        """Axes (k, 3, 3) of nodes (k,)."""
        axes = np.tile(np.eye(3), (len(nodes), 1, 1))
        if self.axes:
            for i, node in enumerate(np.asarray(nodes).tolist()):
                axes[i] = self.axes.get(node, axes[i])
        return axes

    def turn(self) -> sparse.csr_array | None:
        """Q (size, size) of z = Q z', the axes of every node on its diagonal; None where all are basic."""
        if not self.axes:
            return None
        starts = [
            (row, axes) for node, axes in self.axes.items() for row in (3 * node, self.first.get(node, -1)) if row >= 0
        ]
        turned_rows = np.array([row for row, _ in starts])[:, None] + np.arange(3)
        same = np.setdiff1d(np.arange(self.size), turned_rows)
        blocks = np.array([axes for _, axes in starts]), turned_rows[:, :, None], turned_rows[:, None]
        return from_entries([(np.ones(len(same)), same, same), blocks], (self.size, self.size))


@dataclass
class Equations:
    """z'[row] = Σ value z'[column] for the dependent rows; entries: value, row, column; by: row → the tie that prescribes it."""

    size: int
    entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=list)
    by: dict[int, Tie] = field(default_factory=dict)

    def add(
        self, mesh: Mesh, tie: Tie, nodes: np.ndarray, rows: np.ndarray, columns: np.ndarray, values: np.ndarray
    ) -> None:
        """Make rows (m,), motions of nodes (m,), depend on columns (c,) with values (m, c).

        Raises DeckError for a row that is already dependent."""
        for row, node in zip(rows.tolist(), nodes.tolist(), strict=True):
            self.claim(mesh, tie, node, row)
        self.entries.append((values, rows[:, None], columns))

    def claim(self, mesh: Mesh, tie: Tie, node: int, row: int) -> None:
        """Register a row, a motion of a node, as dependent in a tie. Raises DeckError for a row that is already dependent."""
        if row in self.by:
            first = self.by[row]
            at = mesh.where(*entity_of(first)) if str(first) == str(tie) else None
            raise DeckError(
                f"node {mesh.node_ids[node]} is dependent in {first}{f' ({at})' if at else ''} and in {tie}",
                remedy="Remove the node from the dependent nodes of one of these two ties.",
                entity=entity_of(tie),
            )
        self.by[row] = tie

    def matrix(self) -> sparse.csr_array:
        """D (size, size) of z' = D z' on the dependent rows."""
        return from_entries(self.entries, (self.size, self.size))


def relation_terms(mesh: Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Number of the relation, node, component and value of all terms (t,) of the relations."""
    relation = np.repeat(np.arange(len(mesh.relations)), [len(tie.node) for tie in mesh.relations])
    none = np.zeros(0, dtype=np.int64)
    node = np.concatenate([none, *(tie.node for tie in mesh.relations)])
    component = np.concatenate([none, *(tie.component for tie in mesh.relations)])
    return relation, node, component, np.concatenate([np.zeros(0), *(tie.value for tie in mesh.relations)])


def add_relations(mesh: Mesh, rows: MotionRows, dependencies: Equations) -> None:
    """Add  z'_1 = −Σ_{k>1} c_k z'_k / c_1  of all relations to the equations.

    Raises DeckError for a first term that is zero, and for a motion that is already dependent."""
    relation, node, component, value = relation_terms(mesh)
    at, nonzero = rows.of(node, component), value != 0
    # a motion that occurs twice in a relation has the sum of its coefficients
    term, place = np.unique((relation * rows.size + at)[nonzero], return_inverse=True)
    c, size = (np.bincount(place, part[nonzero], len(term)) for part in (value, np.abs(value)))
    c = np.where(np.abs(c) > ROUNDING * size, c, 0.0)
    of, column = np.divmod(term, rows.size)
    follower = at[np.searchsorted(relation, np.arange(len(mesh.relations)))]
    leading = column == follower[of]
    first = np.zeros(len(mesh.relations))
    first[of[leading]] = c[leading]
    for equation, row, coefficient in zip(mesh.relations, follower.tolist(), first.tolist(), strict=True):
        dependent_node, dependent_component = equation.follower
        if coefficient == 0:
            raise DeckError(
                f"the first term of {equation}, component {dependent_component + 1} of node {mesh.node_ids[dependent_node]}, "
                "has the coefficient 0, but the equation is solved for the first term",
                remedy="Put a term with a nonzero coefficient first.",
                entity=entity_of(equation),
            )
        dependencies.claim(mesh, equation, dependent_node, row)
    others = ~leading & (c != 0)
    dependencies.entries.append((-c[others] / first[of[others]], follower[of[others]], column[others]))


def followers(mesh: Mesh) -> set[int]:
    """Nodes (indices) whose rotations depend on a RigidElement."""
    return {int(node) for e in mesh.rigid if max(e.components, default=0) > 2 for node in e.nodes}


def joined(mesh: Mesh) -> set[int]:
    """Nodes (indices) whose rotations belong to ties, relations, shells or beams."""
    return references(mesh) | rotations_in_ties(mesh) | followers(mesh) | {*mesh.turning.tolist()}


def turning_nodes(mesh: Mesh) -> list[int]:
    """Nodes of shells and beams, nodes with rotational springs, and nodes whose rotations depend on a RigidElement if a mass or
    a spring acts on them, or a load of the file has a moment there."""
    loaded = {point.node for point in mesh.point_masses if point.turns}
    for spring in mesh.springs:
        loaded.update(spring.turned.tolist())
    for load in mesh.loads.values():
        if load.moment is not None:
            loaded.update(load.nodes[load.moment.any(axis=1)].tolist())
    return sorted((loaded & followers(mesh)).union(mesh.turning.tolist(), mesh.turned_by_springs.tolist()))


MOTIONS = ("translation x", "translation y", "translation z", "rotation x", "rotation y", "rotation z")
LEAST_STRENGTH = 1e-10
"""Least ratio of the stiffness with which an averaging element, or its dependent motions, determine a motion."""


def references(mesh: Mesh) -> set[int]:
    """Nodes (indices) whose six motions are the reference of a tie."""
    return {e.reference for e in mesh.rigid} | {e.reference for e in mesh.averaging}


def rotations_in_ties(mesh: Mesh) -> set[int]:
    """Nodes (indices) whose rotations are in a relation or in the mean of an averaging element."""
    _, node, component, value = relation_terms(mesh)
    of_relations = np.unique(node[(component > 2) & (value != 0)])
    return {int(node) for nodes in (of_relations, *(e.turned for e in mesh.averaging)) for node in nodes}


def rotation_rows(mesh: Mesh, rotations: Sequence[int] | np.ndarray = ()) -> dict[int, int]:
    """Node → row of z of its first rotation, after the 3n translations: for reference nodes, nodes whose rotations are in a
    relation or a mean, and the nodes `rotations`."""
    nodes = sorted((references(mesh) | rotations_in_ties(mesh)).union(int(node) for node in rotations))
    return {node: 3 * len(mesh.position) + 3 * i for i, node in enumerate(nodes)}


def local_axes(mesh: Mesh) -> dict[int, np.ndarray]:
    """Local axes of the nodes whose components are clamped or in ties; those of other nodes have no effect."""
    if not mesh.axes:
        return {}
    named: set[int] = set(mesh.fixed[:, 0].tolist())
    for rigid in mesh.rigid:
        named.update((rigid.reference, *np.asarray(rigid.nodes).tolist()))
    for e in mesh.averaging:
        named.add(e.reference)
        if e.directions is not None or e.rotations is not None or e.dependent is not None:
            named.update(np.asarray(e.nodes).tolist())
    named.update(relation_terms(mesh)[1].tolist())
    return {node: np.asarray(axes, dtype=float) for node, axes in mesh.axes.items() if node in named}


def equations(mesh: Mesh, rows: MotionRows) -> Equations:
    """Equations of the rigid and averaging elements and the relations of a mesh, with Q_i the axes of node i:

        rigid       Q_iu'_i = u_r + θ_r × (x_i − x_r),   Q_iθ'_i = θ_r           in the components of u'_i, θ'_i that it names
        averaging   (u_r, θ_r) = (Σ w_i R_iᵀR_i)⁻¹ Σ w_i R_iᵀ u'_i,   R_i = Q_iᵀ[I, −(x_i − x_r)×], of the directions that count
        relation    z'_1 = −Σ_{k>1} c_k z'_k / c_1

    Rotations θ'_i that count in a mean have R_i = Q_iᵀ[0, I] and the weight w_i L², L the mean |x_i − x_r|, 1 m where that is
    zero (RBE3 of Nastran, as in `formrbe3` of pyyeti). If an averaging element names dependent motions, it is solved for
    them. Raises DeckError that names element and nodes for a motion that two elements prescribe, an averaging element whose
    nodes do not determine its reference, dependent motions without a solution, and a relation whose first term is zero."""
    dependencies = Equations(rows.size)
    for rigid in mesh.rigid:
        _add_rigid(mesh, rigid, rows, dependencies)
    for averaging in mesh.averaging:
        _add_averaging(mesh, averaging, rows, dependencies)
    if mesh.relations:
        add_relations(mesh, rows, dependencies)
    return dependencies


def rigid_rows(arm: np.ndarray) -> np.ndarray:
    """Six motions of a reference node → displacement at distance r: [I, −r×] (k, 3, 6), arm r (k, 3) [m]."""
    rows = np.zeros((len(arm), 3, 6))
    rows[:, :, :3] = np.eye(3)
    x, y, z = arm.T
    rows[:, 0, 4], rows[:, 0, 5] = z, -y
    rows[:, 1, 3], rows[:, 1, 5] = -z, x
    rows[:, 2, 3], rows[:, 2, 4] = y, -x
    return rows


def _six_axes(axes: np.ndarray) -> np.ndarray:
    """Axes (..., 3, 3) applied to translations and rotations (..., 6, 6)."""
    twice = np.zeros((*axes.shape[:-2], 6, 6))
    twice[..., :3, :3] = twice[..., 3:, 3:] = axes
    return twice


def _clear_rounding(values: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Values with zeros in place of rounding (relative to `size`), so that no spurious coupling remains."""
    return np.where(np.abs(values) > ROUNDING * size, values, 0.0)


def _add_rigid(mesh: Mesh, tie: RigidElement, rows: MotionRows, dependencies: Equations) -> None:
    nodes = np.asarray(tie.nodes, dtype=np.int64)
    if len(nodes) == 0 or tie.reference in nodes:
        fault = "has no dependent nodes"
        if len(nodes):
            fault = f"has the same node as reference and dependent node: {mesh.node_ids[tie.reference]}"
        remedy = "Specify at least one dependent node other than the reference node."
        raise DeckError(f"{tie} {fault}", remedy=remedy, entity=("tie", tie.id))
    arm = mesh.position[nodes] - mesh.position[tie.reference]
    motion = np.zeros((len(nodes), 6, 6))
    motion[:, :3] = rigid_rows(arm)
    motion[:, 3:, 3:] = np.eye(3)
    if rows.axes:
        reference = _six_axes(rows.axes_of(np.array([tie.reference])))[0]
        motion = _six_axes(rows.axes_of(nodes)).swapaxes(1, 2) @ motion @ reference
    size = np.ones((len(nodes), 6, 6))
    size[:, :3, 3:] = np.linalg.norm(arm, axis=1)[:, None, None]
    motion = _clear_rounding(motion, size)
    source = rows.of(np.full(6, tie.reference), np.arange(6))
    for component in sorted(set(tie.components)):
        dependent_rows = rows.of(nodes, component)
        existing = dependent_rows >= 0
        dependencies.add(mesh, tie, nodes[existing], dependent_rows[existing], source, motion[existing, component])


def _add_averaging(mesh: Mesh, tie: AveragingElement, rows: MotionRows, dependencies: Equations) -> None:
    wanted = sorted(set(tie.components))
    mean, length = _mean_motion(mesh, tie, rows, wanted)
    reference_rows = rows.of(np.full(len(wanted), tie.reference), np.array(wanted))
    averaged = rows.averaged(tie)
    if tie.dependent is None:
        dependencies.add(mesh, tie, np.full(len(wanted), tie.reference), reference_rows, averaged, mean)
        return
    # C z' = 0 on the motions of the reference and the nodes, rotations times a length so that all entries are comparable
    columns, place = np.unique(np.concatenate([reference_rows, averaged]), return_inverse=True)
    C = np.zeros((len(wanted), len(columns)))
    np.add.at(C.T, place, np.hstack([np.eye(len(wanted)), -mean]).T)
    scale = np.where(np.array(wanted) > 2, length, 1.0)
    unit = np.where(columns >= 3 * rows.nodes, length, 1.0)
    C *= scale[:, None] / unit
    dependent = np.asarray(tie.dependent, dtype=np.int64).reshape(-1, 2)
    solved = rows.of(dependent[:, 0], dependent[:, 1])
    chosen = np.isin(columns, solved)
    A = C[:, np.searchsorted(columns, solved[np.isin(solved, columns)])]
    strength = np.linalg.svd(A, compute_uv=False) if A.shape == (len(wanted),) * 2 else np.zeros(1)
    if not strength[-1] > LEAST_STRENGTH * np.linalg.norm(C, 2):
        named = ", ".join(f"{mesh.node_ids[node]} component {c + 1}" for node, c in dependent.tolist())
        raise DeckError(
            f"the equations of {tie} cannot be solved for its dependent motions (UM: node {named})",
            remedy="Specify as many UM components as reference components, on nodes that do not lie on one line.",
            entity=("tie", tie.id),
        )
    values = -np.linalg.solve(A, C[:, ~chosen])
    values = _clear_rounding(values, np.abs(values).max(axis=1, keepdims=True))
    values *= unit[~chosen] / unit[np.searchsorted(columns, solved)][:, None]
    dependencies.add(mesh, tie, dependent[:, 0], solved, columns[~chosen], values)


def _mean_motion(
    mesh: Mesh, tie: AveragingElement, rows: MotionRows, wanted: Collection[int]
) -> tuple[np.ndarray, float]:
    """Wanted motions of the reference as means of `MotionRows.averaged` (c, 3k + 3t), and the length of the arms [m]."""
    nodes, w = np.asarray(tie.nodes, dtype=np.int64), np.asarray(tie.weight, dtype=float)
    if len(nodes) == 0 or tie.reference in nodes or not np.all(w >= 0) or not w.sum() > 0:
        raise DeckError(
            f"{tie} has no averaged nodes, averages its own reference node, or has weights that are negative or all zero",
            remedy="Specify averaged nodes other than the reference node, and weights ≥ 0 that are not all zero.",
            entity=("tie", tie.id),
        )
    arm = mesh.position[nodes] - mesh.position[tie.reference]
    length = float(np.linalg.norm(arm, axis=1).max()) or 1.0
    scale = np.array([1.0, 1.0, 1.0, length, length, length])
    R = rigid_rows(arm) / scale
    if rows.axes:
        R = rows.axes_of(nodes).swapaxes(1, 2) @ R
    weight = np.repeat(w[:, None] / w.sum(), 3, axis=1)
    if tie.directions is not None:
        weight = weight * tie.directions
    if tie.rotations is not None:
        with_rotation = tie.rotations.any(axis=1)
        mean_arm = float(np.linalg.norm(arm[np.unique(nodes, return_index=True)[1]], axis=1).mean()) or 1.0
        turn = np.zeros((np.count_nonzero(with_rotation), 3, 6))
        turn[:, :, 3:] = rows.axes_of(nodes[with_rotation]).swapaxes(1, 2) / length
        R = np.concatenate([R, turn])
        weight = np.concatenate(
            [weight, (mean_arm**2 * w[with_rotation] / w.sum())[:, None] * tie.rotations[with_rotation]]
        )
    strength, V = np.linalg.eigh(np.einsum("kc,kci,kcj->ij", weight, R, R))
    determined = strength > LEAST_STRENGTH * strength[-1]
    local = _six_axes(rows.axes_of(np.array([tie.reference])))[0].T
    if (loose := np.abs((local @ V[:, ~determined])[list(wanted)]) > 1e-6).any():
        motion = MOTIONS[list(wanted)[int(np.argmax(loose.any(axis=1)))]]
        raise DeckError(
            f"the averaged nodes of {tie} do not determine the {motion} of its reference node {mesh.node_ids[tie.reference]}",
            remedy="Add averaged nodes that do not lie on one line, or remove rotations from the reference components.",
            entity=("tie", tie.id),
        )
    inverse = (V[:, determined] / strength[determined]) @ V[:, determined].T
    mean = np.einsum("ij,kc,kcj->ikc", local @ (inverse / scale[:, None]), weight, R).reshape(6, -1)[list(wanted)]
    return _clear_rounding(mean, np.abs(mean).max(axis=1, keepdims=True)), length

"""Coincident nodes and elements of a mesh: warnings if they are not connected, and merging of nodes (mesh.merge)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from strainsight.errors import DeckError, UserError
from strainsight.mesh.coincident import Coincident, Joints, component_labels, doubled
from strainsight.mesh.joins import NodalForces, RigidElement
from strainsight.mesh.model import FloatArray, IdTable, IntArray, Mesh, element_error
from strainsight.mesh.projection import hanging, inside, patches


def check_doubled(mesh: Mesh) -> None:
    """Raise DeckError for solids and shells that coincide with another, in parts that nothing connects."""
    joints = Joints(mesh)
    for pair in doubled(mesh, joints, Coincident(mesh, joints)):
        if pair.joined:
            continue
        more = f" ({pair.count} coincident pairs in total)" if pair.count > 1 else ""
        raise element_error(
            pair.second,
            f"elements {pair.first} and {pair.second} ({pair.kind}) coincide, but have separate nodes{more}: stiffness and mass "
            "would count twice",
            "If the mesh is duplicated, remove one copy. If two layers are intended, share their nodes or tie them.",
        )


def connectivity_warnings(mesh: Mesh) -> tuple[str, ...]:
    """Warnings: coincident nodes without connection, hanging nodes on elements, overlapping solids."""
    joints = Joints(mesh)
    coincident, surface, warnings = Coincident(mesh, joints), patches(mesh), []
    if len(coincident.pairs):
        a, b = mesh.node_ids[coincident.pairs[0]]
        warnings.append(
            f"{len(coincident.unjoined)} nodes coincide with another node without connection, for example {a} and {b} at "
            f"{_at(mesh, coincident.pairs[0, 0])}: parts touch there, but transfer no load. Set mesh.merge to "
            f"{merge_distance(coincident.distance):g}, or tie the parts (mesh.ties). Change nothing if the parts may separate."
        )
    warnings += [
        f"elements {pair.first} and {pair.second} ({pair.kind}) coincide but have separate nodes"
        + (f" ({pair.count} coincident pairs in total)" if pair.count > 1 else "")
        + "; their parts are connected at other nodes. This is correct for two fastened layers. If the mesh is duplicated, "
        "stiffness and mass count twice: remove one copy."
        for pair in doubled(mesh, joints, coincident)
        if pair.joined
    ]
    if count := len(contacts := hanging(mesh, surface, joints, coincident)):
        words = (
            f"{count} nodes lie on the surface of elements without belonging to them"
            if count > 1
            else "a node lies on the surface of an element without belonging to it"
        )
        warnings.append(
            f"{words}, for example {mesh.node_ids[contacts.node[0]]} on element {contacts.element[0]} at "
            f"{_at(mesh, contacts.node[0])}: non-matching meshes transfer no load there. Tie the finer side to the coarser one "
            "(mesh.ties, type: surface), or use matching meshes."
        )
    if len(contacts := inside(mesh, surface, joints, coincident)):
        count = len(np.unique(contacts.element))
        words = (
            f"{count} solids contain nodes of other parts" if count > 1 else "a solid contains nodes of another part"
        )
        warnings.append(
            f"{words}, for example element {contacts.element[0]} contains node {mesh.node_ids[contacts.node[0]]} at "
            f"{_at(mesh, contacts.node[0])}: stiffness and mass of overlapping volumes count twice, and untied inner parts "
            "transfer no load."
        )
    return tuple(warnings)


def merge_distance(distance: FloatArray) -> float:
    """A distance [m] that merges nodes this far apart: the next power of ten, at least a micrometre."""
    widest = 2 * float(distance.max(initial=0.0))
    return 10.0 ** max(-6, int(np.ceil(np.log10(widest)))) if widest > 0 else 1e-6


def _at(mesh: Mesh, node: int) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*(mesh.position[node] + 0.0))


def merged(mesh: Mesh, distance: float) -> Mesh:
    """Merge the nodes of elements within a distance [m] of each other into the one with the lowest id, with a note.

    References to the other nodes are replaced. Coincident nodes that a tie, relation or spring connects stay separate, and so do
    two clamped nodes. For a mesh without nodes on faces of shells or sides of beams.
    Raises UserError if an element would lose a node, and DeckError for nodes with different local axes."""
    nodes = mesh.nodes_of_elements
    pairs = np.zeros((0, 2), dtype=np.int64)
    if len(nodes):
        pairs = nodes[cKDTree(mesh.position[nodes]).query_pairs(distance, output_type="ndarray")]
    intended = Joints(mesh).between(*pairs.T)
    connected = np.zeros(len(mesh.position), dtype=bool)
    connected[pairs[intended]] = True
    pairs = pairs[~connected[pairs].any(axis=1)]
    into = _lowest(mesh, pairs)
    is_merged = into != np.arange(len(into))
    more = f"; {np.count_nonzero(connected)} coincident nodes stay separate, because a tie, equation or spring connects them"
    more *= bool(connected.any())
    if not is_merged.any():
        return replace(mesh, notes=(*mesh.notes, f"mesh.merge: no nodes to merge within {distance:g} m{more}"))
    _check_elements(mesh, into, distance)
    _check_axes(mesh, into, is_merged)
    first = int(np.flatnonzero(is_merged)[np.argmin(mesh.node_ids[is_merged])])
    count = int(np.count_nonzero(is_merged))
    words = f"{count} nodes were merged into others" if count > 1 else "a node was merged into another"
    note = f"mesh.merge: {words} within {distance:g} m, for example {mesh.node_ids[first]} into {mesh.node_ids[into[first]]}"
    renumbered = np.cumsum(~is_merged) - 1
    return replace(_renumber(mesh, renumbered[into], is_merged), notes=(*mesh.notes, note + more))


def _lowest(mesh: Mesh, pairs: IntArray) -> IntArray:
    """(n,): for every node the coincident one with the lowest id."""
    group = component_labels(len(mesh.position), *pairs.T)
    order = np.lexsort((mesh.node_ids, group))
    first = order[np.unique(group[order], return_index=True)[1]]
    return np.asarray(first[group], dtype=np.int64)


def _check_elements(mesh: Mesh, into: IntArray, distance: float) -> None:
    for block in mesh.elements:
        if (twice := (np.diff(np.sort(into[block.nodes], axis=1), axis=1) == 0).any(axis=1)).any():
            i = int(np.argmax(twice))
            x = mesh.position[block.nodes[i]]
            side = np.linalg.norm(x[:, None] - x[None], axis=2)[np.triu_indices(len(x), 1)].min()
            raise UserError(
                f"element {block.ids[i]} would lose a node: two of its nodes are {side:.4g} m apart",
                key="mesh.merge",
                remedy=f"Set mesh.merge below {side:.4g} m (now {distance:g} m).",
            )


def _check_axes(mesh: Mesh, into: IntArray, is_merged: NDArray[np.bool_]) -> None:
    for node in np.flatnonzero(is_merged).tolist():
        axes, other = (mesh.axes.get(i, np.eye(3)) for i in (node, int(into[node])))
        if not np.allclose(axes, other, atol=1e-9):
            number = int(mesh.node_ids[node])
            raise DeckError(
                f"nodes {mesh.node_ids[into[node]]} and {number} coincide but have different local coordinate systems",
                remedy="Use the same coordinate system for both nodes (CD, *TRANSFORM).",
                entity=("node", number),
            )


def _renumber(mesh: Mesh, index: IntArray, is_merged: NDArray[np.bool_]) -> Mesh:
    """The mesh without merged nodes; index (n,): the new index of every node."""
    new_ids = mesh.node_ids[~is_merged][index]
    table = IdTable(mesh.node_ids)

    def in_set(ids: IntArray) -> IntArray:
        rows, missing = table.rows(ids)
        return np.unique(np.where(missing, ids, new_ids[rows]))

    return replace(
        mesh,
        node_ids=mesh.node_ids[~is_merged],
        position=mesh.position[~is_merged],
        blocks=tuple(replace(block, nodes=index[block.nodes]) for block in mesh.blocks),
        shells=tuple(replace(block, nodes=index[block.nodes]) for block in mesh.shells),
        beams=tuple(replace(block, nodes=index[block.nodes]) for block in mesh.beams),
        fixed=np.unique(np.column_stack([index[mesh.fixed[:, 0]], mesh.fixed[:, 1]]), axis=0),
        rigid=tuple(new for tie in mesh.rigid if len((new := _rigid(tie, index)).nodes)),
        averaging=tuple(tie.with_nodes(int(index[tie.reference]), index[tie.nodes], index) for tie in mesh.averaging),
        relations=tuple(replace(tie, node=index[tie.node]) for tie in mesh.relations),
        point_masses=tuple(replace(point, node=int(index[point.node])) for point in mesh.point_masses),
        springs=tuple(replace(spring, node=index[spring.node]) for spring in mesh.springs),
        axes={int(index[node]): axes for node, axes in mesh.axes.items() if not is_merged[node]},
        node_sets={name: in_set(ids) for name, ids in mesh.node_sets.items()},
        loads={name: _load(load, index) for name, load in mesh.loads.items()},
    )


def _rigid(tie: RigidElement, index: IntArray) -> RigidElement:
    nodes, reference = np.unique(index[tie.nodes]), int(index[tie.reference])
    return replace(tie, reference=reference, nodes=nodes[nodes != reference])


def _load(load: NodalForces, index: IntArray) -> NodalForces:
    """The forces on merged nodes are added."""
    nodes, of = np.unique(index[load.nodes], return_inverse=True)
    sums = sparse.csr_array((np.ones(len(of)), (of, np.arange(len(of)))), shape=(len(nodes), len(of)))
    moment = None if load.moment is None else np.asarray(sums @ load.moment)
    return replace(load, nodes=nodes, force=np.asarray(sums @ load.force), moment=moment)

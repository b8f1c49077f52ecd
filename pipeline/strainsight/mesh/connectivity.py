"""Nodes and elements of a mesh that lie in one place: warnings where nothing joins them, and nodes merged (mesh.merge)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from strainsight.errors import DeckError, UserError
from strainsight.mesh.joins import NodalForces, RigidElement
from strainsight.mesh.model import FloatArray, IdTable, IntArray, Mesh, element_error
from strainsight.mesh.projection import hanging, inside, patches
from strainsight.mesh.unjoined import Coincident, Joints, component_labels, doubled


def check_doubled(mesh: Mesh) -> None:
    """Raise DeckError for solids and shells that lie in one place with another, of a part that nothing joins to theirs."""
    joints = Joints(mesh)
    for own in doubled(mesh, joints, Coincident(mesh, joints)):
        if own.joined:
            continue
        more = f", and so do {own.count - 1} others" if own.count > 1 else ""
        raise element_error(
            own.second,
            f"elements {own.first} and {own.second} ({own.kind}) lie in one place, with nodes of their own{more}: stiffness and "
            "mass would count twice",
            "the mesh is there twice: remove one; two layers that are meant share their nodes, or are tied",
        )


def connectivity_warnings(mesh: Mesh) -> tuple[str, ...]:
    """Nodes in one place that nothing joins, nodes that hang on elements without being theirs, solids inside of each other."""
    joints = Joints(mesh)
    coincident, own, found = Coincident(mesh, joints), patches(mesh), []
    if len(coincident.pairs):
        a, b = mesh.node_ids[coincident.pairs[0]]
        found.append(
            f"{len(coincident.unjoined)} nodes lie in the place of another that is not joined to them, as {a} and {b} at "
            f"{_at(mesh, coincident.pairs[0, 0])}: parts touch there and hand on no load; make them one with mesh.merge: "
            f"{merge_distance(coincident.distance):g}, or tie them (mesh.ties); leave them where the parts may part"
        )
    found += [
        f"elements {two.first} and {two.second} ({two.kind})"
        + (f" and {two.count - 1} more pairs" if two.count > 1 else "")
        + " lie in one place, with nodes of their own, and are joined elsewhere only: right for two layers that are fastened "
        "there; of a mesh that is there twice stiffness and mass count twice, remove one"
        for two in doubled(mesh, joints, coincident)
        if two.joined
    ]
    if count := len(met := hanging(mesh, own, joints, coincident)):
        words = (
            f"{count} nodes lie on elements that are not theirs"
            if count > 1
            else "a node lies on an element not its own"
        )
        found.append(
            f"{words}, as {mesh.node_ids[met.node[0]]} on element {met.element[0]} at {_at(mesh, met.node[0])}: meshes that do "
            "not fit together hand on no load there; tie the finer side to the coarser (mesh.ties, type: surface), or mesh both "
            "alike"
        )
    if len(met := inside(mesh, own, joints, coincident)):
        count = len(np.unique(met.element))
        words = f"{count} solids hold" if count > 1 else "a solid holds"
        found.append(
            f"{words} what is not theirs, as element {met.element[0]} by node {mesh.node_ids[met.node[0]]} at "
            f"{_at(mesh, met.node[0])}: volumes that overlap count stiffness and mass twice, and what lies inside without a tie "
            "hands on no load"
        )
    return tuple(found)


def merge_distance(distance: FloatArray) -> float:
    """A distance [m] that makes nodes one that are so far apart: the power of ten above, a micrometre at least."""
    widest = 2 * float(distance.max(initial=0.0))
    return 10.0 ** max(-6, int(np.ceil(np.log10(widest)))) if widest > 0 else 1e-6


def _at(mesh: Mesh, node: int) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*(mesh.position[node] + 0.0))


def merged(mesh: Mesh, distance: float) -> Mesh:
    """A mesh of which nodes of elements within a distance [m] of each other are one, that of the lowest id, and a note on it.

    What names the others names that one. Nodes that a tie, relation or spring joins to one in their place stay two, as they were
    meant to be, and so do nodes that are both clamped. For a mesh without nodes on faces of shells or sides of beams yet.
    Raises UserError where an element would lose a node, and DeckError for nodes whose displacement systems differ.
    """
    nodes = mesh.nodes_of_elements
    pairs = np.zeros((0, 2), dtype=np.int64)
    if len(nodes):
        pairs = nodes[cKDTree(mesh.position[nodes]).query_pairs(distance, output_type="ndarray")]
    meant = Joints(mesh).between(*pairs.T)
    joined = np.zeros(len(mesh.position), dtype=bool)
    joined[pairs[meant]] = True
    pairs = pairs[~joined[pairs].any(axis=1)]
    into = _lowest(mesh, pairs)
    gone = into != np.arange(len(into))
    if not gone.any():
        more = f"; {np.count_nonzero(joined)} are joined otherwise" * bool(joined.any())
        return replace(mesh, notes=(*mesh.notes, f"mesh.merge: no two nodes lie within {distance:g} m{more}"))
    _check_elements(mesh, into, distance)
    _check_axes(mesh, into, gone)
    first = int(np.flatnonzero(gone)[np.argmin(mesh.node_ids[gone])])
    count = int(np.count_nonzero(gone))
    words = f"{count} nodes became others" if count > 1 else "a node became another"
    note = f"mesh.merge: {words} within {distance:g} m, as {mesh.node_ids[first]} which is {mesh.node_ids[into[first]]} now"
    if joined.any():
        note += f"; {np.count_nonzero(joined)} that a tie or spring joins in their place stayed"
    renumbered = np.cumsum(~gone) - 1
    return replace(_renamed(mesh, renumbered[into], gone), notes=(*mesh.notes, note))


def _lowest(mesh: Mesh, pairs: IntArray) -> IntArray:
    """(n,) for every node that of the lowest id in its place, itself where it is alone."""
    group = component_labels(len(mesh.position), *pairs.T)
    order = np.lexsort((mesh.node_ids, group))
    first = order[np.unique(group[order], return_index=True)[1]]
    return np.asarray(first[group], dtype=np.int64)


def _check_elements(mesh: Mesh, into: IntArray, distance: float) -> None:
    for block in mesh.elements:
        twice = (np.diff(np.sort(into[block.nodes], axis=1), axis=1) == 0).any(axis=1)
        if twice.any():
            i = int(np.argmax(twice))
            x = mesh.position[block.nodes[i]]
            side = np.linalg.norm(x[:, None] - x[None], axis=2)[np.triu_indices(len(x), 1)].min()
            raise UserError(
                f"element {block.ids[i]} would lose a node: two of its own are {side:.4g} m apart",
                key="mesh.merge",
                remedy=f"give less than that; this was {distance:g} m",
            )


def _check_axes(mesh: Mesh, into: IntArray, gone: NDArray[np.bool_]) -> None:
    for node in np.flatnonzero(gone).tolist():
        own, other = (mesh.axes.get(i, np.eye(3)) for i in (node, int(into[node])))
        if not np.allclose(own, other, atol=1e-9):
            number = int(mesh.node_ids[node])
            raise DeckError(
                f"nodes {mesh.node_ids[into[node]]} and {number} lie in one place and have different displacement systems",
                remedy="give both the same (CD, *TRANSFORM) so that mesh.merge can make them one",
                entity=("node", number),
            )


def _renamed(mesh: Mesh, index: IntArray, gone: NDArray[np.bool_]) -> Mesh:
    """The mesh without the nodes that are gone; index (n,): the new one of every node."""
    new_ids = mesh.node_ids[~gone][index]
    table = IdTable(mesh.node_ids)

    def in_set(ids: IntArray) -> IntArray:
        rows, missing = table.rows(ids)
        return np.unique(np.where(missing, ids, new_ids[rows]))

    return replace(
        mesh,
        node_ids=mesh.node_ids[~gone],
        position=mesh.position[~gone],
        blocks=tuple(replace(block, nodes=index[block.nodes]) for block in mesh.blocks),
        shells=tuple(replace(block, nodes=index[block.nodes]) for block in mesh.shells),
        beams=tuple(replace(block, nodes=index[block.nodes]) for block in mesh.beams),
        fixed=np.unique(np.column_stack([index[mesh.fixed[:, 0]], mesh.fixed[:, 1]]), axis=0),
        rigid=tuple(own for tie in mesh.rigid if len((own := _rigid(tie, index)).nodes)),
        averaging=tuple(tie.with_nodes(int(index[tie.reference]), index[tie.nodes], index) for tie in mesh.averaging),
        relations=tuple(replace(own, node=index[own.node]) for own in mesh.relations),
        point_masses=tuple(replace(own, node=int(index[own.node])) for own in mesh.point_masses),
        springs=tuple(replace(own, node=index[own.node]) for own in mesh.springs),
        axes={int(index[node]): own for node, own in mesh.axes.items() if not gone[node]},
        node_sets={name: in_set(own) for name, own in mesh.node_sets.items()},
        loads={name: _load(own, index) for name, own in mesh.loads.items()},
    )


def _rigid(tie: RigidElement, index: IntArray) -> RigidElement:
    nodes, reference = np.unique(index[tie.nodes]), int(index[tie.reference])
    return replace(tie, reference=reference, nodes=nodes[nodes != reference])


def _load(load: NodalForces, index: IntArray) -> NodalForces:
    """Of nodes that became one the forces add up."""
    nodes, of = np.unique(index[load.nodes], return_inverse=True)
    sums = sparse.csr_array((np.ones(len(of)), (of, np.arange(len(of)))), shape=(len(nodes), len(of)))
    moment = None if load.moment is None else np.asarray(sums @ load.moment)
    return replace(load, nodes=nodes, force=np.asarray(sums @ load.force), moment=moment)

"""What of a mesh is not joined though it looks so, in sentences for a warning."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.model import FloatArray, Mesh
from strainsight.mesh.projection import Met, hanging, inside, patches
from strainsight.mesh.unjoined import Coincident, Doubled, Joints, doubled


def check_doubled(mesh: Mesh) -> None:
    """Raise DeckError for solids and shells that lie in one place with another, of a part that nothing joins to theirs."""
    joints = Joints(mesh)
    for own in doubled(mesh, joints, Coincident(mesh, joints)):
        if own.joined:
            continue
        more = f", and so do {own.count - 1} others" if own.count > 1 else ""
        raise DeckError(
            f"elements {own.first} and {own.second} ({own.kind}) lie in one place, with nodes of their own{more}: stiffness and "
            "mass would count twice",
            remedy="the mesh is there twice: remove one; two layers that are meant share their nodes, or are tied",
            entity=("element", own.second),
        )


def connectivity_warnings(mesh: Mesh) -> tuple[str, ...]:
    """Nodes in one place that nothing joins, nodes that hang on elements without being theirs, solids inside of each other."""
    joints = Joints(mesh)
    coincident, own = Coincident(mesh, joints), patches(mesh)
    return (
        *_unmerged(mesh, coincident),
        *_layers(doubled(mesh, joints, coincident)),
        *_hanging(mesh, hanging(mesh, own, joints, coincident)),
        *_overlaps(mesh, inside(mesh, own, joints, coincident)),
    )


def merge_distance(distance: FloatArray) -> float:
    """A distance [m] that makes nodes one that are so far apart: the power of ten above, a micrometre at least."""
    widest = 2 * float(distance.max(initial=0.0))
    return 10.0 ** max(-6, int(np.ceil(np.log10(widest)))) if widest > 0 else 1e-6


def _unmerged(mesh: Mesh, found: Coincident) -> list[str]:
    if not len(found.pairs):
        return []
    a, b = mesh.node_ids[found.pairs[0]]
    count, at = len(found.unjoined), _at(mesh, found.pairs[0, 0])
    return [
        f"{count} nodes lie in the place of another that is not joined to them, as {a} and {b} at {at}: "
        f"parts touch there and hand on no load; make them one with mesh.merge: {merge_distance(found.distance):g}, or tie them "
        "(mesh.ties); leave them where the parts may part"
    ]


def _layers(found: Iterable[Doubled]) -> list[str]:
    return [
        f"elements {own.first} and {own.second} ({own.kind})"
        + (f" and {own.count - 1} more pairs" if own.count > 1 else "")
        + " lie in one place, with nodes of their own, and are joined elsewhere only: right for two layers that are fastened "
        "there; of a mesh that is there twice stiffness and mass count twice, remove one"
        for own in found
        if own.joined
    ]


def _hanging(mesh: Mesh, found: Met) -> list[str]:
    if not len(found):
        return []
    several = len(found) > 1
    words = (
        f"{len(found)} nodes lie on elements that are not theirs"
        if several
        else "a node lies on an element not its own"
    )
    return [
        f"{words}, as {mesh.node_ids[found.node[0]]} on element "
        f"{found.element[0]} at {_at(mesh, found.node[0])}: meshes that do not fit together hand on no load there; tie the "
        "finer side to the coarser (mesh.ties, type: surface), or mesh both alike"
    ]


def _overlaps(mesh: Mesh, found: Met) -> list[str]:
    if not len(found):
        return []
    count = len(np.unique(found.element))
    words = f"{count} solids hold" if count > 1 else "a solid holds"
    return [
        f"{words} what is not theirs, as element {found.element[0]} by node {mesh.node_ids[found.node[0]]} at "
        f"{_at(mesh, found.node[0])}: volumes that overlap count stiffness and mass twice, and what lies inside without a tie "
        "hands on no load"
    ]


def _at(mesh: Mesh, node: int) -> str:
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*(mesh.position[node] + 0.0))

"""The rigid-body check of springs and relations: what resists a rigid motion of the whole though it leads to no ground."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.fem.motion_words import AXES
from strainsight.fem.ties import rigid_rows
from strainsight.mesh.model import FloatArray, IntArray, Mesh

EXACT = 1e-6
"""Of the largest term of a spring or relation: rounding of the positions in a deck."""
MOTIONS = (*(f"translation {axis}" for axis in AXES), *(f"rotation about {axis}" for axis in AXES))


@dataclass(frozen=True)
class Grounded:
    """A spring or relation between several nodes that a rigid motion stretches: name; the motion that stretches it most; share:
    |Σ r z| over Σ |r| |z| under it, 0 where all is well; apart [m]: the largest distance between its nodes."""

    name: str
    motion: str
    share: float
    apart: float


def grounded(mesh: Mesh) -> tuple[Grounded, ...]:
    """Springs and relations with s = Σ r z ≠ 0 under a rigid motion z = u + ω × (x − x₀) of the whole, the worst first.

    What has one node alone leads to the ground, and is a support. Elements, rigid and averaging elements follow a rigid motion
    exactly.
    """
    return tuple(own for own in links(mesh) if own.share > EXACT)


def links(mesh: Mesh) -> tuple[Grounded, ...]:
    """All springs and relations between several nodes, the one that a rigid motion stretches most first."""
    return tuple(sorted(_each(mesh), key=lambda own: -own.share))


def _each(mesh: Mesh) -> Iterator[Grounded]:
    x = mesh.position - mesh.position.mean(axis=0)
    for own in mesh.springs:
        for i in np.flatnonzero(own.stiffness > 0):
            part = own.spring == i
            yield from _checked(x, own.name, own.node[part], own.component[part], own.value[part], {})
    for tie in mesh.relations:
        yield from _checked(x, str(tie), tie.node, tie.component, tie.value, mesh.axes)


def _checked(
    x: FloatArray, name: str, node: IntArray, component: IntArray, value: FloatArray, axes: Mapping[int, FloatArray]
) -> Iterator[Grounded]:
    kept = value != 0
    node, component, value = node[kept], component[kept], value[kept]
    if len(np.unique(node)) < 2:
        return
    terms = value[:, None] * _rows(x, node, component, axes)
    size = np.abs(terms).sum(axis=0)
    share = np.divide(np.abs(terms.sum(axis=0)), size, out=np.zeros(6), where=size > EXACT * size.max(initial=0.0))
    worst = int(np.argmax(share))
    apart = float(np.linalg.norm(x[node] - x[node[0]], axis=1).max())
    yield Grounded(name, MOTIONS[worst], float(share[worst]), apart)


def _rows(x: FloatArray, node: IntArray, component: IntArray, axes: Mapping[int, FloatArray]) -> FloatArray:
    """(k, 6): each component of motion of its node under six rigid motions, along the axes of the node."""
    rows = np.zeros((len(node), 6, 6))
    rows[:, :3] = rigid_rows(x[node])
    rows[:, 3:, 3:] = np.eye(3)
    for i, own in enumerate(node.tolist()):
        if own in axes:
            Q = np.asarray(axes[own])
            rows[i] = np.vstack([Q.T @ rows[i, :3], Q.T @ rows[i, 3:]])
    return rows[np.arange(len(node)), component]

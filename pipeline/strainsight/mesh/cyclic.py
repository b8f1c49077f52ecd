"""A sector of a structure that repeats itself about an axis, as the whole ring."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from strainsight.errors import UserError
from strainsight.mesh.model import FloatArray, IntArray, Mesh
from strainsight.mesh.sector_copies import Copies

CLOSE = 1e-3
"""Of the shortest distance between nodes of a cut face: nodes of both that are this near after the turn are one."""
ON_AXIS = 1e-6
"""Of the largest radius: how far nodes of the axis may lie off it, as a deck of seven digits has them."""


@dataclass(frozen=True)
class Ring:
    """The whole of a sector: its mesh, and at (N, n): the node of every node of the sector in each copy; shift: what ids of one
    copy are above those of the one before; loose: of each pair of cut faces the nodes of the first one, in all copies, that no
    node of the second meets, and all nodes of the second."""

    mesh: Mesh
    at: IntArray
    shift: int
    loose: tuple[tuple[IntArray, IntArray], ...]


def whole_ring(
    mesh: Mesh, count: int, c: FloatArray, axis: FloatArray, cuts: Sequence[tuple[IntArray, IntArray]]
) -> Ring:
    """The ring of `count` copies of a mesh of solids, copy j turned by 2πj/count about the line through c (3,) along axis (3,):

        x_j = c + R_j (x − c)

    cuts: nodes (index) of one cut face of a part and of the opposite one, which meet in the next copy and become one; nodes on
    the axis are one in all copies. Copies carry everything that the sector has: elements, supports, ties, relations, masses,
    springs, material axes and loads, turned with them, and sets, which hold all copies; sets SECTOR-1, SECTOR-2, … have one
    each. Ids of copy j are those of the sector + j 10^k, and of the sector itself as they were.
    Raises UserError where a cut face does not meet the opposite one, where elements are shells or beams, where supports of two
    nodes that become one hold other directions, and where a relation is for a node that becomes one without any.
    """
    if mesh.thin:
        raise UserError(
            "a sector with shells or beams is not made a whole ring",
            remedy="mesh the whole structure, or its solids alone",
        )
    e = axis / np.linalg.norm(axis)
    turns = np.array([_turn(e, 2 * np.pi * j / count) for j in range(count)])
    n = len(mesh.position)
    met: list[IntArray] = []  # pairs (k, 2) of nodes that are one; copy j of node i is j n + i
    follows = np.zeros(n, dtype=bool)
    loose: list[tuple[IntArray, IntArray]] = []
    rows = np.arange(count)[:, None] * n
    for first, second in cuts:
        pair, step, left = _meeting(mesh.position, first, second, c, e, count)
        follows[pair[:, 0]] = True
        met += [np.column_stack([j * n + pair[:, 0], (j + step) % count * n + pair[:, 1]]) for j in range(count)]
        loose.append(((rows + left).ravel(), (rows + second).ravel()))
    apart = mesh.position - c
    radius = np.linalg.norm(apart - np.outer(apart @ e, e), axis=1)
    on_axis = np.flatnonzero(radius <= ON_AXIS * max(radius.max(), 1e-300))
    met += [np.column_stack([j * n + on_axis, on_axis]) for j in range(1, count)]
    into = _as_one(np.concatenate(met), np.tile(follows, count))
    kept = np.flatnonzero(into == np.arange(count * n))
    new = np.zeros(count * n, dtype=np.int64)
    new[kept] = np.arange(len(kept))
    at = new[into].reshape(count, n)
    largest = max([int(mesh.node_ids.max()), *(int(block.ids.max()) for block in mesh.blocks)])
    shift = 10 ** len(str(largest))
    made = Copies(mesh, turns, c, at, kept, shift).made()
    return Ring(made, at, shift, tuple((np.unique(new[into[a]]), np.unique(new[into[b]])) for a, b in loose))


def _turn(e: FloatArray, angle: float) -> FloatArray:
    """R (3, 3) = cos φ I + sin φ [e]× + (1 − cos φ) e eᵀ."""
    across = np.cross(np.eye(3), -e)
    return np.asarray(np.cos(angle) * np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * np.outer(e, e))


def _meeting(
    position: FloatArray, first: IntArray, second: IntArray, c: FloatArray, e: FloatArray, count: int
) -> tuple[IntArray, int, IntArray]:
    """Pairs (k, 2) of nodes of the first and the second cut face that are one where the second belongs to the copy `step` (±1)
    on, and the nodes of the first that meet none."""
    beside = np.asarray(cKDTree(position[second]).query(position[second], k=min(len(second), 2))[0])
    spacing = beside.reshape(len(second), -1)[:, -1]
    best: tuple[float, int, FloatArray, IntArray] | None = None
    for step in (1, -1):
        there = c + (position[second] - c) @ _turn(e, 2 * np.pi * step / count).T
        off, which = map(np.asarray, cKDTree(there).query(position[first]))
        if best is None or off.mean() < best[0]:
            best = (float(off.mean()), step, off, which)
    assert best is not None
    mean, step, off, which = best
    if mean > spacing.mean():
        raise UserError(
            f"the cut faces of the sector do not meet where one is turned by 360°/{count}: their nodes are {mean:.3g} apart",
            remedy="check the number of sectors, the axis, and the two surfaces",
        )
    near = off <= CLOSE * spacing.min()
    pair = np.column_stack([first[near], second[which[near]]])
    return pair, step, first[~near]


def _as_one(pairs: IntArray, follows: NDArray[np.bool_]) -> IntArray:
    """Each node's representative (k,) where the nodes of pairs (m, 2) are one: the first of them that does not follow, else the
    first."""
    k = len(follows)
    group = connected_components(sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(k, k)), directed=False)[1]
    rank = np.arange(k) + k * follows
    least = np.full(k, 2 * k)
    np.minimum.at(least, group, rank)
    return np.asarray(least[group] % k)

"""Facets of cells, and the surface of a mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.model import IntArray, Mesh


@dataclass(frozen=True)
class Facets:
    """Facets of cells, sorted by element id, then facet.

    element_id (f,) of the file; facet (f,) local number from 1; kind (f,) index into FACETS; nodes (f, 8) indices
    padded with −1, corners first, normal outward; region (f,) id.
    """

    element_id: IntArray
    facet: IntArray
    kind: IntArray
    nodes: IntArray
    region: IntArray

    @property
    def key(self) -> IntArray:
        """(f,): one number for element and local number."""
        return facet_key(self.element_id, self.facet)


def facet_key(element_id: IntArray, facet: IntArray) -> IntArray:
    """One number for an element id and the local number of a facet, 1 to 6."""
    return element_id * 8 + facet


def all_facets(mesh: Mesh) -> Facets:
    """Every facet of every cell."""
    ids, facet, kind, nodes, region = [], [], [], [], []
    for block in mesh.blocks:
        count = len(block.ids)
        for number, (facet_kind, local) in enumerate(kind_of(block.kind).facets, start=1):
            padded = np.full((count, 8), -1, dtype=np.int64)
            padded[:, : len(local)] = block.nodes[:, local]
            ids.append(block.ids)
            facet.append(np.full(count, number))
            kind.append(np.full(count, FACETS.index(facet_kind)))
            nodes.append(padded)
            region.append(block.region)
    nodes.append(np.zeros((0, 8), dtype=np.int64))
    parts = ([*part, np.zeros(0)] for part in (ids, facet, kind, region))
    *columns, last = (np.concatenate(part).astype(np.int64) for part in parts)
    columns += [np.concatenate(nodes), last]
    order = np.lexsort((columns[1], columns[0]))
    return Facets(*(column[order] for column in columns))


def exterior_facets(mesh: Mesh) -> Facets:
    """The facets whose corner nodes occur once among all facets of all cells.

    Raises DeckError where three or more elements share a facet, and where two that share one do not share all its nodes
    (linear beside quadratic, mid-side nodes not merged): their displacements would part there.
    """
    facets = all_facets(mesh)
    corners = np.array([kind.corners for kind in FACETS])[facets.kind]
    key = np.where(np.arange(4) < corners[:, None], facets.nodes[:, :4], -1)
    key.sort(axis=1)
    order = np.lexsort(key.T)
    new = np.r_[True, np.any(np.diff(key[order], axis=0) != 0, axis=1)]
    group = np.empty(len(key), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    times = np.bincount(group)
    if times.max(initial=0) > 2:
        shared = facets.element_id[group == np.argmax(times)]
        raise DeckError(
            f"elements {', '.join(map(str, shared[:4]))} share one facet",
            remedy="remove elements that overlap",
            entity=("element", int(shared[-1])),
        )
    _check_conforming(facets, order, new)
    outside = times[group] == 1
    columns = (facets.element_id, facets.facet, facets.kind, facets.nodes, facets.region)
    return Facets(*(column[outside] for column in columns))


def _check_conforming(facets: Facets, order: np.ndarray, new: np.ndarray) -> None:
    pair = np.flatnonzero(~new)
    a, b = order[pair - 1], order[pair]
    apart = np.any(np.sort(facets.nodes[a], axis=1) != np.sort(facets.nodes[b], axis=1), axis=1)
    if apart.any():
        i = int(np.argmax(apart))
        first, second = facets.element_id[a[i]], facets.element_id[b[i]]
        mixed = facets.kind[a[i]] != facets.kind[b[i]]
        raise DeckError(
            f"elements {first} and {second} share a facet's corners but not its mid-side nodes",
            remedy="mesh both with elements of the same order" if mixed else "merge the coincident nodes",
            entity=("element", int(second)),
        )

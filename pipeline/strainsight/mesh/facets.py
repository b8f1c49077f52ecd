"""Facets of cells, and the surface of a mesh."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.model import IntArray, Mesh

FACET_KINDS = ("tri3", "tri6", "quad4", "quad8")
CORNERS = {"tri3": 3, "tri6": 3, "quad4": 4, "quad8": 4}

FACETS: Mapping[str, tuple[tuple[str, tuple[int, ...]], ...]] = {
    "tet4": (("tri3", (0, 2, 1)), ("tri3", (0, 1, 3)), ("tri3", (1, 2, 3)), ("tri3", (0, 3, 2))),
    "tet10": (
        ("tri6", (0, 2, 1, 6, 5, 4)),
        ("tri6", (0, 1, 3, 4, 8, 7)),
        ("tri6", (1, 2, 3, 5, 9, 8)),
        ("tri6", (0, 3, 2, 7, 9, 6)),
    ),
    "hex8": (
        ("quad4", (0, 3, 2, 1)),
        ("quad4", (4, 5, 6, 7)),
        ("quad4", (0, 1, 5, 4)),
        ("quad4", (1, 2, 6, 5)),
        ("quad4", (2, 3, 7, 6)),
        ("quad4", (3, 0, 4, 7)),
    ),
    "hex20": (
        ("quad8", (0, 3, 2, 1, 11, 10, 9, 8)),
        ("quad8", (4, 5, 6, 7, 12, 13, 14, 15)),
        ("quad8", (0, 1, 5, 4, 8, 17, 12, 16)),
        ("quad8", (1, 2, 6, 5, 9, 18, 13, 17)),
        ("quad8", (2, 3, 7, 6, 10, 19, 14, 18)),
        ("quad8", (3, 0, 4, 7, 11, 16, 15, 19)),
    ),
    "wedge6": (
        ("tri3", (0, 2, 1)),
        ("tri3", (3, 4, 5)),
        ("quad4", (0, 1, 4, 3)),
        ("quad4", (1, 2, 5, 4)),
        ("quad4", (2, 0, 3, 5)),
    ),
    "wedge15": (
        ("tri6", (0, 2, 1, 8, 7, 6)),
        ("tri6", (3, 4, 5, 9, 10, 11)),
        ("quad8", (0, 1, 4, 3, 6, 13, 9, 12)),
        ("quad8", (1, 2, 5, 4, 7, 14, 10, 13)),
        ("quad8", (2, 0, 3, 5, 8, 12, 11, 14)),
    ),
}
"""Kind → its facets: (facet kind, local nodes in VTK order, normal outward). Facet 1 of an element is the first."""


@dataclass(frozen=True)
class Facets:
    """Facets of cells, sorted by element id, then facet.

    element_id (f,) of the file; facet (f,) local number from 1; kind (f,) index into FACET_KINDS; nodes (f, 8) indices
    padded with −1, corners first, normal outward; region (f,) id.
    """

    element_id: IntArray
    facet: IntArray
    kind: IntArray
    nodes: IntArray
    region: IntArray


def all_facets(mesh: Mesh) -> Facets:
    """Every facet of every cell."""
    element, facet, kind, nodes, region = [], [], [], [], []
    for block in mesh.blocks:
        count = len(block.ids)
        for number, (facet_kind, local) in enumerate(FACETS[block.kind], start=1):
            padded = np.full((count, 8), -1, dtype=np.int64)
            padded[:, : len(local)] = block.nodes[:, local]
            element.append(block.ids)
            facet.append(np.full(count, number))
            kind.append(np.full(count, FACET_KINDS.index(facet_kind)))
            nodes.append(padded)
            region.append(block.region)
    nodes.append(np.zeros((0, 8), dtype=np.int64))
    parts = ([*part, np.zeros(0)] for part in (element, facet, kind, region))
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
    corners = np.array([CORNERS[kind] for kind in FACET_KINDS])[facets.kind]
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

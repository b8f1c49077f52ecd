"""Facets of cells, and the surface of a mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from strainsight.mesh.coincident import component_labels
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh, element_error
from strainsight.mesh.thin import BeamBlock, ShellBlock, concatenate

CODE = {kind.name: code for code, kind in enumerate(FACETS)}
ON_SHELL = {"quad8": "shell8", "tri6": "shell6"}
"""Kind of a shell → that of its faces, if different."""
UPPER, LOWER = 1, 2
"""Local numbers of the faces of a shell: the one on the side of its normal, and the opposite one."""
CHUNK = 2048
"""Number of facets at a time."""
TOUCHING = 1e-7
"""Largest distance of coincident positions, as a share of the size of the structure."""
OUTWARD = {3: [0, 2, 1], 4: [0, 3, 2, 1], 6: [0, 2, 1, 5, 4, 3], 8: [0, 3, 2, 1, 7, 6, 5, 4]}
"""Nodes of a shell as seen from below."""


@dataclass(frozen=True)
class Facets:
    """Facets of cells, sorted by element id, then facet.

    element_id (f,) of the file; facet (f,) local number from 1; kind (f,) index into FACETS; nodes (f, 8) indices
    padded with −1, corners first, normal outward; region (f,) id; corners (f, 4) common identifiers of the corners of connected
    facets: the nodes, or for sides of two beams that meet the first of their nodes there."""

    element_id: IntArray
    facet: IntArray
    kind: IntArray
    nodes: IntArray
    region: IntArray
    corners: IntArray = field(default_factory=lambda: np.zeros((0, 4), dtype=np.int64))

    def __post_init__(self) -> None:
        if not len(self.corners):
            object.__setattr__(self, "corners", self.nodes[:, :4])

    def some(self, chosen: NDArray[np.bool_] | IntArray) -> Facets:
        """The selected facets, by a mask (f,) or indices."""
        return Facets(*(getattr(self, entry.name)[chosen] for entry in fields(self)))

    def columns(self, index: IntArray) -> dict[str, Any]:
        """Element, facet, kind and nodes of selected facets, by these names."""
        return {
            "element": self.element_id[index],
            "facet": self.facet[index],
            "kind": self.kind[index],
            "nodes": self.nodes[index],
        }

    @property
    def key(self) -> IntArray:
        """(f,): one number for element and local number."""
        return facet_key(self.element_id, self.facet)

    def of(self, blocks: Sequence[CellBlock | ShellBlock | BeamBlock]) -> NDArray[np.bool_]:
        """Which facets (f,) belong to the elements of some blocks."""
        return np.isin(self.element_id, concatenate(block.ids for block in blocks))


def by_kind(code: IntArray, nodes: IntArray) -> Iterator[tuple[Kind, IntArray, IntArray]]:
    """(kind, facets (m,), nodes (m, k) unpadded) of every facet kind that occurs; code (f,) into FACETS, nodes (f, 8)."""
    for number in np.unique(code):
        kind = FACETS[number]
        which = np.flatnonzero(code == number)
        yield kind, which, nodes[which, : len(kind.nodes)]


def facet_key(element_id: IntArray, facet: IntArray) -> IntArray:
    """One number for an element id and the local number of a facet, 1 to 6."""
    return element_id * 8 + facet


def on_solids(mesh: Mesh, facets: Facets) -> Iterator[tuple[CellBlock, tuple[int, ...], IntArray, IntArray]]:
    """Facets of solids by block and local facet: (block, local nodes of the facet, facets (m,), rows of their elements in the
    block (m,)), CHUNK at most."""
    for block in mesh.blocks:
        order = np.argsort(block.ids)
        place = np.searchsorted(block.ids, facets.element_id, sorter=order)
        row = order[np.minimum(place, len(order) - 1)] if len(order) else np.zeros(len(place), dtype=np.int64)
        in_block = np.flatnonzero(block.ids[row] == facets.element_id) if len(order) else row[:0]
        for number, (_, local) in enumerate(kind_of(block.kind).facets, start=1):
            which = in_block[facets.facet[in_block] == number]
            for start in range(0, len(which), CHUNK):
                part = which[start : start + CHUNK]
                yield block, local, part, row[part]


def all_facets(mesh: Mesh) -> Facets:
    """Every facet of every cell, the two faces of every shell, and the four sides of beams."""
    parts = [tuple(np.zeros(shape, dtype=np.int64) for shape in (0, 0, 0, (0, 8), 0))]

    def add(
        block: CellBlock | ShellBlock | BeamBlock, rows: IntArray | slice, number: int, code: int, around: IntArray
    ) -> None:
        padded = np.full((len(around), 8), -1, dtype=np.int64)
        padded[:, : around.shape[1]] = around
        numbers = (np.full(len(around), value) for value in (number, code))
        parts.append((block.ids[rows], *numbers, padded, block.region[rows]))

    for block in mesh.blocks:
        for number, (facet_kind, local) in enumerate(kind_of(block.kind).facets, start=1):
            add(block, slice(None), number, FACETS.index(facet_kind), block.nodes[:, local])
    for shell in (block for block in mesh.shells if len(block.on_faces)):
        for number, face in enumerate(np.moveaxis(shell.on_faces, 1, 0), start=UPPER):
            # the lower face is seen from below
            around = face if number == UPPER else face[:, OUTWARD[face.shape[1]]]
            add(shell, slice(None), number, CODE[ON_SHELL.get(shell.kind, shell.kind)], around)
    for beam in mesh.beams:
        for number, side in enumerate(np.moveaxis(beam.on_sides, 1, 0), start=1):
            rows = np.flatnonzero(side[:, 0] >= 0)
            add(beam, rows, number, CODE["quad4" if side.shape[1] == 4 else ON_SHELL["quad8"]], side[rows])
    columns = [np.concatenate(part) for part in zip(*parts, strict=True)]
    order = np.lexsort((columns[1], columns[0]))
    facets = Facets(*(column[order] for column in columns))
    return replace(facets, corners=_coincident_corners(mesh)[facets.nodes[:, :4]]) if mesh.beams else facets


def facets_of_face(mesh: Mesh, name: str) -> Facets:
    """The facets of a named face (`Mesh.faces`)."""
    facets = all_facets(mesh)
    return facets.some(np.isin(facets.key, facet_key(*mesh.faces[name].T)))


def _coincident_corners(mesh: Mesh) -> IntArray:
    """For every node, and for −1 at the end, the node (n + 1,) that represents it as a corner: nodes on sides of beams are merged
    if they follow the same node from the same position."""
    same = np.append(np.arange(len(mesh.position)), -1)
    sides = np.unique(np.concatenate([block.on_sides[block.on_sides >= 0] for block in mesh.beams]))
    if len(sides):
        follows = mesh.arms[sides - mesh.own_nodes, 1]
        size = float(np.ptp(mesh.position, axis=0).max())
        pairs = cKDTree(mesh.position[sides]).query_pairs(TOUCHING * size, output_type="ndarray")
        a, b = pairs[follows[pairs[:, 0]] == follows[pairs[:, 1]]].T
        group = component_labels(len(sides), a, b)
        same[sides] = sides[np.unique(group, return_index=True)[1]][group]
    return same


def exterior_facets(mesh: Mesh) -> Facets:
    """The facets whose corner nodes occur once among all facets of all cells, except those of shells and beams inside solids, and
    those of solids under shells.

    Raises DeckError if three or more elements share a facet, and if two elements share the corners of a facet but not all its
    nodes (linear next to quadratic, mid-side nodes not merged): their displacements would be incompatible."""
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
        raise element_error(
            shared[-1],
            f"elements {', '.join(map(str, shared[:4]))} share the same facet",
            "Remove overlapping elements.",
        )
    _check_conforming(mesh, facets, order, new)
    outside = times[group] == 1
    if mesh.blocks and mesh.thin:
        outside &= ~_covered(mesh, facets, key, outside)
    return facets.some(outside)


def _covered(mesh: Mesh, facets: Facets, key: IntArray, outside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which facets (f,) are covered where shells and beams meet solids; key (f, 4) sorted corners.
    All facets of a shell or beam with a node that only interior facets of solids have, or with corners of such a facet. For
    corners of an exterior facet of a solid: that facet, and the face of the shell towards the solid."""
    thin = facets.of(mesh.thin)
    exterior, interior = outside & ~thin, ~outside & ~thin
    deep = np.zeros(len(mesh.position), dtype=bool)
    for block in mesh.blocks:
        deep[block.nodes] = True
    deep[facets.nodes[exterior]] = False
    hidden = np.concatenate([block.ids[deep[block.nodes].any(axis=1)] for block in mesh.thin])
    on_shell = np.zeros(len(mesh.position) + 1, dtype=bool)
    on_shell[np.concatenate([[-1], *(shell.nodes.ravel() for shell in mesh.shells)])] = True
    likely = np.flatnonzero(~thin & on_shell[key].all(axis=1))
    solid: dict[tuple[int, ...], int] = {}
    for i, corners in zip(likely.tolist(), key[likely].tolist(), strict=True):
        solid[tuple(corners)] = i
        # two triangles may lie on a quadrilateral
        solid |= {(-1, *three): i for three in combinations(corners, 3) if -1 not in corners}
    covered = np.zeros(len(thin), dtype=bool)
    inner: list[int] = []
    for shell in mesh.shells:
        corners = np.full((len(shell.ids), 4), -1)
        corners[:, : shell.corners.shape[1]] = shell.corners
        for number, nodes, around in zip(
            shell.ids.tolist(), shell.corners, np.sort(corners, axis=1).tolist(), strict=True
        ):
            i = solid.get(tuple(around), -1)
            if i >= 0 and interior[i]:
                inner += [number * 8 + UPPER, number * 8 + LOWER]
            elif i >= 0:
                covered[i] = True
                inner.append(number * 8 + (LOWER if _same_orientation(facets.nodes[i], nodes) else UPPER))
    return covered | (thin & (np.isin(facets.element_id, hidden) | np.isin(facets.key, inner)))


def _same_orientation(around: IntArray, nodes: IntArray) -> bool:
    """Whether corners (k,) run around the corners of a facet in the same direction."""
    known = around.tolist()
    at = [known.index(node) for node in nodes.tolist()]
    return sum(b > a for a, b in zip(at, [*at[1:], at[0]], strict=True)) > len(at) / 2


def straight_sides(mesh: Mesh) -> NDArray[np.bool_]:
    """Which nodes (n,), and −1 at the end, follow the mean motion of two others, so that their sides are straight."""
    components = np.zeros(len(mesh.position) + 1, dtype=np.int64)
    for relation in mesh.relations:
        if not relation.ties:
            components[relation.follower[0]] += 1
    return components == 3


def _coincide(position: FloatArray, first: IntArray, second: IntArray) -> bool:
    """Whether nodes (k,) and (l,), −1 for none, lie at the same positions."""
    x, y = (position[nodes[nodes >= 0]] for nodes in (first, second))
    distance = np.linalg.norm(x[:, None] - y[None], axis=2)
    return bool(max(distance.min(axis=0).max(), distance.min(axis=1).max()) <= 1e-3 * distance.max())


def _check_conforming(mesh: Mesh, facets: Facets, order: np.ndarray, new: np.ndarray) -> None:
    straight = straight_sides(mesh)  # nodes without effect
    pair = np.flatnonzero(~new)
    a, b = order[pair - 1], order[pair]
    nodes = np.where(straight[facets.nodes], -1, facets.nodes)
    if (differ := np.any(np.sort(nodes[a], axis=1) != np.sort(nodes[b], axis=1), axis=1)).any():
        i = int(np.argmax(differ))
        first, second = facets.element_id[a[i]], facets.element_id[b[i]]
        other = "Check the node order of these elements."
        if facets.kind[a[i]] != facets.kind[b[i]]:
            other = "Use elements of the same order (linear or quadratic)."
        elif _coincide(mesh.position, nodes[a[i]], nodes[b[i]]):
            other = "Merge the coincident nodes."
        raise element_error(
            second, f"elements {first} and {second} share the corners of a facet, but not its mid-side nodes", other
        )


Traction = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""x (f, q, 3) [m], outward unit normal n (f, q, 3), place ξ (q, 2) in the reference domain → t (f, q, 3) [Pa]."""


def consistent_forces(position: FloatArray, kind: Kind, nodes: IntArray, traction: Traction) -> FloatArray:
    """f_a = ∫ N_a t dA over each facet: (f, k, 3) [N]; nodes (f, k) rows of position (n, 3) [m]; with the rule of N Nᵀ."""
    xi, w = kind.mass
    N, dN = kind.functions(xi)
    x = np.einsum("qa,fac->fqc", N, position[nodes])
    J = np.einsum("qad,fac->fqcd", dN, position[nodes])
    area = np.cross(J[..., 0], J[..., 1])
    dA = np.linalg.norm(area, axis=-1)
    n = area / np.where(dA > 0, dA, 1.0)[..., None]
    return np.asarray(np.einsum("q,qa,fq,fqc->fac", w, N, dA, traction(x, n, xi)))

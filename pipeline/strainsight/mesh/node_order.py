"""Order of the nodes of second-order elements, by where their mid-side nodes lie."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.kinds import facet_of, kind_of
from strainsight.mesh.kinds.kind import Edges, ElementKind
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh, element_error
from strainsight.mesh.thin import ShellBlock

OFF = 0.3
"""Distance of a mid-side node from the middle of its edge, over the length of that, that no shape of an element explains."""
SEEN = 1000
"""Elements of which it is asked whether their mid-side nodes lie on other edges."""


def check_node_order(mesh: Mesh) -> None:
    """Raise DeckError where in every element of a kind mid-side nodes lie in the middles of other edges than their own."""
    for kind, edges, blocks in _kinds(mesh):
        nodes = np.concatenate([block.nodes for block in blocks])
        a, b = (mesh.position[nodes[:, ends]] for ends in np.transpose(edges))
        middle, half = mesh.position[nodes[:, -len(edges) :]], 0.5 * (a + b)
        length = np.maximum(np.linalg.norm(b - a, axis=2), np.finfo(float).tiny)
        off = (np.linalg.norm(middle - half, axis=2) / length).max(axis=1)
        if not off.min() > OFF:
            continue
        apart = np.linalg.norm(middle[:SEEN, :, None] - half[:SEEN, None], axis=3) / length[:SEEN, None]
        if apart.min(axis=2).max() <= OFF and (np.sort(apart.argmin(axis=2), axis=1) == np.arange(len(edges))).all():
            raise element_error(
                blocks[0].ids[0],
                f"mid-side nodes lie off the middles of their edges in all {len(off)} {kind} elements, by {off.min():.2g} of "
                "the length of the edge and more, and in the middles of other edges: the order of the nodes is another one",
                "write the nodes of these elements in the order that the format of the file has",
            )


def _kinds(mesh: Mesh) -> Iterator[tuple[str, Edges, list[CellBlock | ShellBlock]]]:
    """Name, edges with a node between, and blocks of each kind of second-order solids and shells."""
    of_kind: dict[str, list[CellBlock | ShellBlock]] = {}
    second: list[CellBlock | ShellBlock] = [*mesh.blocks, *mesh.shells]
    for block in second:
        of_kind.setdefault(block.kind, []).append(block)
    for kind, blocks in of_kind.items():
        edges = (kind_of(kind) if isinstance(blocks[0], CellBlock) else facet_of(kind)).edges
        if edges and any(len(block.nodes) for block in blocks):
            yield kind, edges, blocks


def left_handed(kind: ElementKind, nodes: IntArray, position: FloatArray) -> np.ndarray:
    """Elements (n,) of nodes (n, k) whose edges a, b, c at every corner are left-handed: (a × b) · c < 0."""
    found = np.ones(len(nodes), dtype=bool)
    for a, *others in kind.sides:
        edges = np.stack([position[nodes[:, b]] - position[nodes[:, a]] for b in others], axis=1)
        with np.errstate(all="ignore"):
            found &= np.einsum("ei,ei->e", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2]) < 0
    return found


WARPED, MOST_WARPED = 0.05, 0.3
"""Distance of the corners from their mean plane over the mean diagonal: of a note, and the largest."""
PARALLEL = 1e-6
"""Sine of an angle below which two directions are one."""


def plate_normals(
    x: FloatArray,
    fault: Callable[[int, str, str], DeckError],
    called: Callable[[int], str],
    triangle: str,
    notes: list[str],
) -> FloatArray:
    """Unit normals (n, 3) of shells with corners x (n, k, 3) in order around them, of a quadrangle across both diagonals.

    fault: row, what is wrong and remedy → error; called: row → the shell in the words of the deck, "CQUAD4 12"; triangle: its
    word for one. Raises DeckError for a shell of no area, folded or warped too much; warp becomes a note.
    """
    corners = x.shape[1]
    a, b = (x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]) if corners == 4 else (x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    across = np.cross(a, b)
    area = np.linalg.norm(across, axis=1)
    sides = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).max(axis=1)
    flat = ~(area > PARALLEL * sides**2)
    if flat.any():
        raise fault(int(np.argmax(flat)), "has no area", "correct its nodes, or take it out")
    normal = across / area[:, None]
    if corners == 3:
        return normal
    before, after = np.roll(x, 1, axis=1) - x, np.roll(x, -1, axis=1) - x
    turned = np.einsum("nkc,nc->nk", np.cross(after, before), normal).min(axis=1) <= 0
    if turned.any():
        raise fault(
            int(np.argmax(turned)),
            "is folded, or has a corner of 180° or more",
            "give its nodes in order around it, or make triangles of it",
        )
    height = 0.5 * np.abs(np.einsum("nc,nc->n", x[:, 1] - x[:, 0], normal))
    warp = height / (0.5 * (np.linalg.norm(a, axis=1) + np.linalg.norm(b, axis=1)))
    worst = int(np.argmax(warp))
    if warp[worst] > MOST_WARPED:
        raise fault(
            worst,
            f"its corners lie {warp[worst]:.2g} of its mean diagonal off their plane, {MOST_WARPED:g} at most is supported",
            f"make two triangles of it ({triangle})",
        )
    if warp[worst] > WARPED:
        notes.append(
            f"{np.sum(warp > WARPED)} {called(worst).split()[0]} warped: corners lie more than {WARPED:g} of their mean diagonal "
            f"off their plane ({called(worst)} {warp[worst]:.2g})"
        )
    return normal

"""Check of the node order of second-order elements by the positions of their mid-side nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.kinds import facet_of, kind_of
from strainsight.mesh.kinds.kind import Edges, ElementKind
from strainsight.mesh.model import CellBlock, FloatArray, IntArray, Mesh, element_error
from strainsight.mesh.thin import ShellBlock

OFF = 0.3
"""Distance of a mid-side node from the middle of its edge, relative to the edge, that no element shape explains."""
SEEN = 1000
"""Number of elements whose mid-side nodes are compared with other edges."""


def check_node_order(mesh: Mesh) -> None:
    """Raise DeckError if in every element of a kind the mid-side nodes are at the middles of other edges."""
    for kind, edges, blocks in _kinds(mesh):
        nodes = np.concatenate([block.nodes for block in blocks])
        a, b = (mesh.position[nodes[:, ends]] for ends in np.transpose(edges))
        middle, half = mesh.position[nodes[:, -len(edges) :]], 0.5 * (a + b)
        length = np.maximum(np.linalg.norm(b - a, axis=2), np.finfo(float).tiny)
        off = (np.linalg.norm(middle - half, axis=2) / length).max(axis=1)
        if not off.min() > OFF:
            continue
        distance = np.linalg.norm(middle[:SEEN, :, None] - half[:SEEN, None], axis=3) / length[:SEEN, None]
        if (
            distance.min(axis=2).max() <= OFF
            and (np.sort(distance.argmin(axis=2), axis=1) == np.arange(len(edges))).all()
        ):
            raise element_error(
                blocks[0].ids[0],
                f"in all {kind} elements, the mid-side nodes are at the middles of wrong edges (at least {off.min():.2g} "
                "of the edge length away from the correct middle). The node order differs from that of the file format.",
                "Write the element nodes in the order of the file format.",
            )


def _kinds(mesh: Mesh) -> Iterator[tuple[str, Edges, list[CellBlock | ShellBlock]]]:
    """Name, edges with mid-side nodes, and blocks of each kind of second-order solids and shells."""
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
    result = np.ones(len(nodes), dtype=bool)
    for a, *others in kind.sides:
        edges = np.stack([position[nodes[:, b]] - position[nodes[:, a]] for b in others], axis=1)
        with np.errstate(all="ignore"):
            result &= np.einsum("ei,ei->e", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2]) < 0
    return result


WARPED, MOST_WARPED = 0.05, 0.3
"""Distance of the corners from their mean plane over the mean diagonal: threshold of a note, and limit."""
PARALLEL = 1e-6
"""Sine of an angle below which two directions are parallel."""


def plate_normals(
    x: FloatArray,
    fault: Callable[[int, str, str], DeckError],
    called: Callable[[int], str],
    triangle: str,
    notes: list[str],
) -> FloatArray:
    """Unit normals (n, 3) of shells with corners x (n, k, 3) in order, for a quadrangle from both diagonals.

    fault: row, fault and remedy → error; called: row → name of the shell in the deck, "CQUAD4 12"; triangle: name of a triangle
    in the deck. Raises DeckError for a shell without area, folded or too warped; warp is noted."""
    corners = x.shape[1]
    a, b = (x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]) if corners == 4 else (x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    across = np.cross(a, b)
    area = np.linalg.norm(across, axis=1)
    sides = np.linalg.norm(x - np.roll(x, 1, axis=1), axis=2).max(axis=1)
    if (flat := ~(area > PARALLEL * sides**2)).any():
        remedy = "Correct the nodes of the element, or remove the element."
        raise fault(int(np.argmax(flat)), "the element has no area", remedy)
    normal = across / area[:, None]
    if corners == 3:
        return normal
    before, after = np.roll(x, 1, axis=1) - x, np.roll(x, -1, axis=1) - x
    is_folded = np.einsum("nkc,nc->nk", np.cross(after, before), normal).min(axis=1) <= 0
    if is_folded.any():
        raise fault(
            int(np.argmax(is_folded)),
            "the element is folded, or has a corner of 180° or more",
            "List the nodes in order around the element, or split the element into triangles.",
        )
    height = 0.5 * np.abs(np.einsum("nc,nc->n", x[:, 1] - x[:, 0], normal))
    warp = height / (0.5 * (np.linalg.norm(a, axis=1) + np.linalg.norm(b, axis=1)))
    worst = int(np.argmax(warp))
    if warp[worst] > MOST_WARPED:
        raise fault(
            worst,
            f"the element is warped: corners are {warp[worst]:.2g} of the mean diagonal off the mean plane (limit "
            f"{MOST_WARPED:g})",
            f"Split the element into two triangles ({triangle}).",
        )
    if warp[worst] > WARPED:
        notes.append(
            f"warped shells ({np.sum(warp > WARPED)} in total): corners are more than {WARPED:g} of the mean diagonal off the "
            f"mean plane (largest {warp[worst]:.2g}, {called(worst)})"
        )
    return normal

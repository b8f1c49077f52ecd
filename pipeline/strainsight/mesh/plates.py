"""Normals of the shells of a file, and shapes that no shell can have."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.model import FloatArray

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

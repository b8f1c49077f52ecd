"""The plane of a shell element: its axes, its nodes on it, and the motions there of the motions of the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.thin import CORNERS

LEAST_CORNER = 1e-6
"""Of the square of the largest side, what the two sides at a corner must span; below it an element is degenerate."""


@dataclass(frozen=True)
class Plane:
    """axes (e, 3, 3) x, y and the normal z of elements, one in a column; xy (e, k, 2) [m] their nodes projected along z;
    arm (e, k) [m] from each node along z to the middle surface."""

    axes: np.ndarray
    xy: np.ndarray
    arm: np.ndarray


def shell_axes(position: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Axes of elements: z along the cross product of the diagonals (four corners) or sides (three), x along the side from
    the first node to the second, projected on the plane across z, and y = z × x.

    position (e, k, 3) [m], of second-order elements the corners first; ids (e,) for the error message. Returns (e, 3, 3), an
    axis in a column. Raises DeckError for an element without area, or with a corner that turns back.
    """
    position = position[:, : CORNERS[position.shape[1]]]
    size = np.linalg.norm(position - np.roll(position, 1, axis=1), axis=2).max(axis=1)
    first, second = _across(position)
    normal = np.cross(first, second)
    length = np.linalg.norm(normal, axis=1)
    _refuse(length > LEAST_CORNER * size**2, length, position, ids, "have no area")
    z = normal / length[:, None]
    sides = np.roll(position, -1, axis=1) - position
    corner = np.einsum("ekc,ec->ek", np.cross(np.roll(sides, 1, axis=1), sides), z).min(axis=1)
    _refuse(corner > LEAST_CORNER * size**2, corner, position, ids, "have a corner that turns back")
    x = sides[:, 0] - np.einsum("ec,ec->e", sides[:, 0], z)[:, None] * z
    x /= np.linalg.norm(x, axis=1)[:, None]
    return np.stack([x, np.cross(z, x), z], axis=2)


def plane_of(position: np.ndarray, offset: np.ndarray, ids: np.ndarray) -> Plane:
    """The mean plane of elements: nodes of a warped one are h above and below it by turns.

    position (e, k, 3) [m]; offset (e,) [m] of the middle surface from the nodes along the normal; ids (e,). Raises what
    `shell_axes` does.
    """
    axes = shell_axes(position, ids)
    local = np.matmul(position - position.mean(axis=1, keepdims=True), axes)
    return Plane(axes, np.ascontiguousarray(local[:, :, :2]), offset[:, None] - local[:, :, 2])


def to_basic(K: np.ndarray, plane: Plane) -> np.ndarray:
    """TᵀKT of matrices K (e, 6k, 6k) on the plane, T from the motions of the nodes along the basic axes to those along the
    element's at the end of a rigid arm d z from each node:

        u = Rᵀ(u_a + φ_a × d z),    φ = Rᵀ φ_a

    Rigid motions stay free of strain whatever the warp and the offset. Returns (e, 6k, 6k).
    """
    return _columns(_columns(K, plane).swapaxes(1, 2), plane).swapaxes(1, 2)


def rows_to_basic(rows: np.ndarray, plane: Plane) -> np.ndarray:
    """The rows (e, r, 6k) of motions on the plane as rows of motions of the nodes along the basic axes, `rows` T."""
    return _columns(rows, plane)


def _columns(X: np.ndarray, plane: Plane) -> np.ndarray:
    """X T (e, r, 6k)."""
    e, r = X.shape[:2]
    parts = X.reshape(e, r, -1, 6).copy()
    parts[..., 4] += plane.arm[:, None] * parts[..., 0]
    parts[..., 3] -= plane.arm[:, None] * parts[..., 1]
    return np.matmul(parts.reshape(e, -1, 3), plane.axes.swapaxes(1, 2)).reshape(X.shape)


def _across(position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The diagonals of four nodes, or two sides of three."""
    if position.shape[1] == 4:
        return position[:, 2] - position[:, 0], position[:, 3] - position[:, 1]
    return position[:, 1] - position[:, 0], position[:, 2] - position[:, 0]


def _refuse(good: np.ndarray, area: np.ndarray, position: np.ndarray, ids: np.ndarray, what: str) -> None:
    if good.all():
        return
    worst = int(np.argmin(np.where(good, np.inf, area)))
    names = ", ".join(str(id) for id in ids[~good][:5]) + (", …" if (~good).sum() > 5 else "")
    raise DeckError(
        f"{(~good).sum()} shells of {position.shape[1]} nodes {what}: {names} "
        f"(the least cross product of sides or diagonals is {area[worst]:.3g} m² in element {ids[worst]})",
        remedy="check the order of their nodes around the element, and whether two of them are one",
        entity=("element", int(ids[worst])),
    )

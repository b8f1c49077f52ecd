"""Where accelerometers and displacement sensors can sit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import UserError
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.admissible import admissible
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.zones import Zone

Axis = Literal["normal"] | Sequence[float]


def motion_candidates(
    mesh: Mesh,
    facets: Facets,
    quantity: int,
    axes: Sequence[Axis] = ("normal",),
    *,
    surface: str = "all",
    include: Sequence[Zone] = (),
    exclude: Sequence[Zone] = (),
    on_constraints: bool = False,
    every: float | None = None,
    array: int = 1,
    key: str = "motion_sensors",
) -> Candidates:
    """One sensor of motion at the centre of every admissible exterior facet, with a channel for each axis.

    quantity ACCELERATION or DISPLACEMENT; axes: "normal", outward, or a direction (3,) of any length in global coordinates;
    every [m]: facets nearer than this to the centre of an earlier one are passed over. Which facets are admissible, and what
    `key` is for: see `admissible`.
    Raises UserError for a set that is not there and an axis of no length, InfeasibleError where no facet is left.
    """
    keep, centre, normal = admissible(
        mesh, facets, surface=surface, include=include, exclude=exclude, on_constraints=on_constraints, key=key
    )
    if every is not None:
        keep = keep[spaced(centre[keep], every)]
    each = np.repeat(keep, len(axes))
    direction = np.stack([_direction(axis, normal[keep], key) for axis in axes], axis=1).reshape(-1, 3)
    return Candidates(
        **facets.columns(each),
        position=centre[each],
        normal=normal[each],
        direction=direction,
        angle=np.zeros(len(each)),
        quantity=np.full(len(each), quantity),
        gauge=np.repeat(np.arange(len(keep)), len(axes)),
        array=np.full(len(each), array),
    )


def spaced(points: np.ndarray, distance: float) -> np.ndarray:
    """Indices of points (m, 3) [m], each at least `distance` [m] from those before it that were taken, in their order."""
    tree = cKDTree(points)
    free = np.ones(len(points), dtype=bool)
    taken = []
    for i in range(len(points)):
        if free[i]:
            taken.append(i)
            free[tree.query_ball_point(points[i], distance * (1 - 1e-9))] = False
    return np.array(taken, dtype=np.int64)


def _direction(axis: Axis, normal: np.ndarray, key: str) -> np.ndarray:
    if isinstance(axis, str):
        return normal
    a = np.asarray(axis, dtype=float)
    length = np.linalg.norm(a)
    if a.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise UserError(
            f"the sensor axis is {tuple(axis)}",
            key=f"{key}.axes",
            remedy='give three numbers, not all zero, or "normal"',
        )
    return np.broadcast_to(a / length, normal.shape)

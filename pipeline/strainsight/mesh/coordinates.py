"""Coordinate systems: rectangular, cylindrical, spherical, and their directions at points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from strainsight.columns import Column
from strainsight.mesh.thin import FloatArray

ON_AXIS = 1e-10
"""Distance from the axis over the extent of the model, below which a point lies on the axis."""


@dataclass(frozen=True)
class CoordinateSystem:
    """A coordinate system in the basic one."""

    kind: Annotated[
        str, Column("1", "", "type of the coordinate system of the material axes: rectangular, cylindrical, spherical")
    ]
    origin: Annotated[FloatArray, Column("m", "3", "origin of the coordinate system of the material axes")]
    axes: Annotated[
        FloatArray, Column("1", "3 × 3", "axes x, y, z of the coordinate system of the material axes, as columns")
    ]


def rotation(axis: FloatArray, angle: float) -> FloatArray:
    """R (3, 3) = cos φ I + sin φ [e]× + (1 − cos φ) e eᵀ about the unit vector e = axis (3,), angle φ [rad] (Rodrigues)."""
    across = np.cross(np.eye(3), axis)
    return np.asarray(np.cos(angle) * np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * np.outer(axis, axis))


BASIC = CoordinateSystem("rectangular", np.zeros(3), np.eye(3))


def local_axes(position: FloatArray, system: CoordinateSystem) -> tuple[FloatArray, np.ndarray]:
    """The unit vectors 1, 2, 3 of a system at points: x, y, z, or e_r, e_θ, e_z, or e_r, e_θ, e_φ.

    position (n, 3) basic. Returns axes (n, 3, 3), one in a column, in the basic system, and (n,) whether a point lies on the
    axis. There e_r and e_θ of a cylinder, and e_θ and e_φ of a sphere (at its centre also e_r), are undefined, and the axes
    are those of the system (as in Nastran)."""
    n = len(position)
    if system.kind == "rectangular":
        return np.broadcast_to(system.axes, (n, 3, 3)).copy(), np.zeros(n, dtype=bool)
    x, y, z = ((position - system.origin) @ system.axes).T
    rho = np.hypot(x, y)
    on_axis = rho <= ON_AXIS * max(np.abs(position).max(initial=0.0), np.abs(system.origin).max())
    cos, sin = x / np.where(on_axis, 1.0, rho), y / np.where(on_axis, 1.0, rho)
    local = np.zeros((n, 3, 3))
    if system.kind == "cylindrical":
        local[:, 0, 0], local[:, 1, 0] = cos, sin
        local[:, 0, 1], local[:, 1, 1] = -sin, cos
        local[:, 2, 2] = 1.0
    else:
        r = np.where(on_axis, 1.0, np.hypot(rho, z))
        cos_theta, sin_theta = z / r, rho / r
        local[:, :, 0] = np.column_stack([sin_theta * cos, sin_theta * sin, cos_theta])
        local[:, :, 1] = np.column_stack([cos_theta * cos, cos_theta * sin, -sin_theta])
        local[:, :, 2] = np.column_stack([-sin, cos, np.zeros(n)])
    local[on_axis] = np.eye(3)
    return system.axes @ local, on_axis

"""Relations between frames: every one is the scalar product of two vectors that bodies carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.multibody.frames import Carried, Frame, constant


@dataclass(frozen=True)
class Relation:
    """ρ(q) = x·y − value, with x and y a carried vector or the difference of two: (plus,) or (plus, minus).

    ∇ρ = J_xᵀ y + J_yᵀ x,     ∇²ρ = J_xᵀ J_y + J_yᵀ J_x + y·∇²x + x·∇²y     (∇²x, ∇²y constant)
    """

    name: str
    x: tuple[Carried, ...]
    y: tuple[Carried, ...]
    value: float = 0.0


def coincidence(i: Frame, j: Frame, k: int, value: float = 0.0) -> Relation:
    """e_k·(p_j − p_i) = value [m], component k in global axes."""
    return Relation(f"{'xyz'[k]} of {j.name} on {i.name}", (constant(np.eye(3)[k]),), (j.point, -i.point), value)


def dot(i: Frame, a: int, j: Frame, b: int, value: float = 0.0) -> Relation:
    """a_{i,a}·a_{j,b} = value [-]."""
    return Relation(f"{'xyz'[a]} of {i.name} · {'xyz'[b]} of {j.name}", (i.axis(a),), (j.axis(b),), value)


def cosine(i: Frame, a: int, j: Frame, b: int) -> Relation:
    """a_{i,a}·a_{j,b}: 1 where the two axes point the same way [-]."""
    return Relation(f"the axes of '{i.name}' and '{j.name}'", (i.axis(a),), (j.axis(b),))


def offset(i: Frame, a: int, j: Frame, value: float = 0.0) -> Relation:
    """a_{i,a}·(p_j − p_i) = value [m]: the place of j along an axis of i."""
    return Relation(f"{j.name} along {'xyz'[a]} of {i.name}", (i.axis(a),), (j.point, -i.point), value)


def distance_squared(i: Frame, j: Frame, value: float = 0.0) -> Relation:
    """|p_j − p_i|² = value [m²]."""
    apart = (j.point, -i.point)
    return Relation(f"distance of {i.name} and {j.name}", apart, apart, value)


def place(j: Frame, direction: np.ndarray, value: float = 0.0) -> Relation:
    """direction·p_j = value [m]."""
    return Relation(f"place of {j.name}", (constant(direction),), (j.point,), value)


def bearing_displacements(i: Frame, j: Frame) -> tuple[Relation, ...]:
    """The five displacements of ring j in ring i, x the axis: [axial x, radial y, radial z, tilt about y, about z].

    d_k = a_{i,k}·(p_j − p_i),     tilt_y = −a_{j,x}·a_{i,z},     tilt_z = a_{j,x}·a_{i,y}     [m, m, m, rad, rad]
    """
    tilt_y = Relation(f"tilt of {j.name} about y of {i.name}", (-i.axis(2),), (j.axis(0),))
    tilt_z = Relation(f"tilt of {j.name} about z of {i.name}", (i.axis(1),), (j.axis(0),))
    return offset(i, 0, j), offset(i, 1, j), offset(i, 2, j), tilt_y, tilt_z


def bushing_displacements(i: Frame, j: Frame) -> tuple[Relation, ...]:
    """Those of a bearing and the turn about x, a_{j,y}·a_{i,z}: along x, y, z of i [m], then about them [rad]."""
    along_x, along_y, along_z, about_y, about_z = bearing_displacements(i, j)
    about_x = Relation(f"turn of {j.name} about x of {i.name}", (i.axis(2),), (j.axis(1),))
    return along_x, along_y, along_z, about_x, about_y, about_z

"""A torsion spring and damper about an axis."""

from __future__ import annotations

import numpy as np

from strainsight.compiled import carray
from strainsight.errors import NumericalError
from strainsight.multibody.compiled.law import MOVING, NONE, STILL
from strainsight.multibody.forces import RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.laws.spring import SpringDamper
from strainsight.multibody.relations import cosine, dot

FARTHEST = 3.0
"""[rad] from its angle without moment to which a torsion spring turns: at π its moment would jump."""


def torsion(
    name: str, i: Frame, j: Frame, stiffness: float, damping: float = 0.0, angle: float = 0.0, axis: str = "z"
) -> RelativeElement:
    """About an axis that both frames keep together, T = k(φ − φ₀) + c φ̇ on i, −T on j.

    φ = atan2(y_i·x_j, x_i·x_j) with the axis as z; stiffness k [N m/rad], damping c [N m s/rad], angle φ₀ [rad]. A damper
    alone turns as far as it likes. Raises NumericalError in `load` for |φ − φ₀| above FARTHEST.
    """
    i, j = i.turned(axis), j.turned(axis)
    c, s = np.cos(angle), np.sin(angle)

    def turn(rho: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        x, y = rho
        phi = float(np.arctan2(y * c - x * s, x * c + y * s))
        if stiffness and not abs(phi) <= FARTHEST:
            raise NumericalError(
                f"it is turned by {phi:.3g} rad from its angle without moment, beyond {FARTHEST:g} rad",
                remedy="a torsion spring turns by less than half a turn: check its angle and its stiffness",
            )
        return phi, *turned_by(rho)[1:]

    law = SpringDamper(turn, stiffness, damping, _turned, angle)
    return RelativeElement(name, (dot(i, 0, j, 0), dot(i, 1, j, 0)), law, aligned=(cosine(i, 2, j, 2),))


def turned_by(rho: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """φ = atan2(y, x) of ρ = (x, y), ∇φ (2,), ∇²φ (2, 2): slopes and so rates are regular at every angle."""
    x, y = float(rho[0]), float(rho[1])
    r = x * x + y * y
    bend = np.array([[2 * x * y, y * y - x * x], [y * y - x * x, -2 * x * y]]) / r**2
    return float(np.arctan2(y, x)), np.array([-y, x]) / r, bend


def _turned(k, p, numbers, memory, rho, rate, theta, F, F_rho, F_rate, F_theta):  # type: ignore[no-untyped-def]
    given, x, y, dx, dy = (
        carray(numbers, 3),
        carray(rho, 2)[0],
        carray(rho, 2)[1],
        carray(rate, 2)[0],
        carray(rate, 2)[1],
    )
    stiffness, damping, c, s = given[0], given[1], np.cos(given[2]), np.sin(given[2])
    phi = np.arctan2(y * c - x * s, x * c + y * s)
    if stiffness != 0.0 and not abs(phi) <= FARTHEST:
        return NONE
    r = x * x + y * y
    slope = (-y / r, x / r)
    bend = ((2 * x * y / r**2, (y * y - x * x) / r**2), ((y * y - x * x) / r**2, -2 * x * y / r**2))
    T = stiffness * phi + damping * (slope[0] * dx + slope[1] * dy)
    out, by_rho, by_rate = carray(F, 2), carray(F_rho, (2, 2)), carray(F_rate, (2, 2))
    for i in range(2):
        out[i] = T * slope[i]
        for j in range(2):
            bent = bend[j][0] * dx + bend[j][1] * dy
            by_rho[i, j] = slope[i] * (stiffness * slope[j] + damping * bent) + T * bend[i][j]
            by_rate[i, j] = damping * slope[i] * slope[j]
    return MOVING if damping != 0.0 else STILL

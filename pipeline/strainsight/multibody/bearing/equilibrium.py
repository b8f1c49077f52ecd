"""The equilibrium of the inner ring under a load."""

from __future__ import annotations

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError, StrainsightError, UserError
from strainsight.multibody.bearing.element import ball_loads, bearing_load
from strainsight.multibody.bearing.geometry import Bearing

ITERATIONS = 200
FLOOR = 1e-9
"""Approach, as a share of the ball diameter, at which the forces are below all that a load is resolved to."""


def displacement(bearing: Bearing, load: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """q that minimises Π(q) − F·q, i.e. ∂Π/∂q = F: Newton within a trust region, which a convex function always lets end.

    A small load on a ring with clearance has a minimum at the end of a narrow curved valley: it is reached from larger
    loads of the same direction.
    load F (5,) [N, N, N, N m, N m] on the inner ring; start (5,), by default the centred ring. Where clearance leaves the
    ring free, one of its many positions. Returns q (5,) [m, m, m, rad, rad], with F to 1e-9 of itself and of z K (FLOOR D)^1.5.
    Raises UserError for a load or start that is no five numbers, InfeasibleError for a load that is beyond the bearing,
    NumericalError where no equilibrium was reached.
    Source: Conn, Gould and Toint, Trust-Region Methods, algorithm 6.1.1; the tangent is that of `bearing_load`.
    """
    F, y = _five("load", load), np.zeros(5) if start is None else _five("start", start)
    # tilts as motions of the pitch circle, so that all five are lengths
    unit = np.array([1.0, 1.0, 1.0, 2 / bearing.pitch_diameter, 2 / bearing.pitch_diameter])
    size, most = float(np.abs(unit * F).max()), _largest_force(bearing)
    if size > most:
        raise _none(InfeasibleError, F, f"its balls together carry {most:.3g} N at an approach of one ball diameter")
    y, left = _newton(bearing, unit, F, y / unit)
    factor = 1e-6 * most / size if left > 1 else 1.0
    while left > 1 or factor > 1:
        factor = max(factor / 4, 1.0)
        y, left = _newton(bearing, unit, factor * F, y)
        if left > 1:
            why = f"after {ITERATIONS} steps {left:.1e} times the tolerated force remains unbalanced"
            raise _none(NumericalError, factor * F, why)
    semi_axis = float(ball_loads(bearing, unit * y).semi_axes.max())
    if semi_axis > bearing.ball_diameter / 2:
        raise _none(InfeasibleError, F, f"a contact ellipse would reach {1e3 * semi_axis:.4g} mm, beyond the ball")
    return unit * y


def _largest_force(bearing: Bearing) -> float:
    """z K D^1.5 [N]: the scale of the forces of all balls."""
    return bearing.balls * float(np.max(bearing.contacts.table[:, 3])) * bearing.ball_diameter**1.5


def _none(kind: type[StrainsightError], F: np.ndarray, why: str) -> StrainsightError:
    return kind(
        f"the bearing finds no equilibrium under the load ({', '.join(f'{x:.4g}' for x in F)}): {why}",
        remedy="load or preload may be far beyond what the bearing carries: look at the pressures under a smaller one",
    )


def _newton(bearing: Bearing, unit: np.ndarray, F: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """The minimiser in y = q/unit, and the force that remains unbalanced as a multiple of what is tolerated."""
    span = float(np.max(bearing.contacts.table[:, 2]))
    floor = FLOOR**1.5 * _largest_force(bearing)
    trust = 1e-3 * bearing.ball_diameter

    def at(y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        here = bearing_load(bearing, unit * y, slopes=False)
        return here.energy - F @ (unit * y), unit * (here.force - F), here.tangent * np.outer(unit, unit)

    value, g, H = at(y)
    left = np.inf
    for _ in range(ITERATIONS):
        step = _bounded_newton(H, g, trust)
        left = float(np.linalg.norm(g) / (1e-9 * np.linalg.norm(unit * F) + 1e-14 * span * np.linalg.norm(H) + floor))
        new_value, new_g, new_H = at(y + step)
        better = np.linalg.norm(new_g) < np.linalg.norm(g)
        if left <= 1:
            return (y + step if better else y), left
        promised = -(g @ step + 0.5 * step @ H @ step)
        # close to the end the energies differ by less than their rounding: the residual decides
        rounded = promised <= 1e-12 * (abs(value) + abs(F @ (unit * y)))
        kept = float(better) if rounded else (value - new_value) / promised
        if kept < 0.25:
            trust = 0.25 * float(np.linalg.norm(step))
        elif kept > 0.75:
            trust = max(trust, 3 * float(np.linalg.norm(step)))
        if kept > 1e-4:
            y, value, g, H = y + step, new_value, new_g, new_H
    return y, left


def _five(what: str, values: np.ndarray) -> np.ndarray:
    found = np.asarray(values, float)
    if found.shape != (5,) or not np.isfinite(found).all():
        raise UserError(
            f"a bearing {what} {found.tolist()}",
            remedy="give five finite numbers: axial, two radial, two about y and z",
        )
    return found


def _bounded_newton(H: np.ndarray, g: np.ndarray, trust: float) -> np.ndarray:
    """argmin g·s + ½ sᵀHs within |s| ≤ trust, H positive semidefinite: s = −(H + λ)⁻¹ g."""
    values, vectors = np.linalg.eigh(H)
    values = np.maximum(values, 1e-14 * max(values[-1], 0.0))
    h = vectors.T @ g
    size = float(np.linalg.norm(h))
    if size == 0:
        return np.zeros_like(g)

    def length(shift: float) -> float:
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(np.linalg.norm(np.where(h == 0, 0.0, h / (values + shift))))

    shift = 0.0
    if not length(0.0) <= trust:
        low, high = 0.0, size / trust
        for _ in range(60):
            shift = 0.5 * (low + high)
            low, high = (shift, high) if length(shift) > trust else (low, shift)
        shift = high
    return -vectors @ np.where(h == 0, 0.0, h / np.where(h == 0, 1.0, values + shift))

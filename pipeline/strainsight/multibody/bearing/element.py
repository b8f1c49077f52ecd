"""The bearing as a force element: the load that holds the inner ring, its derivatives, and what each ball carries."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError, UserError
from strainsight.multibody.bearing.geometry import (
    AXIAL,
    PARAMETERS,
    RADIAL,
    Bearing,
    contact_ellipse,
    groove_curvatures,
    peak_pressure,
)
from strainsight.multibody.bearing.ring import each_ball, ring_load


@dataclass(frozen=True)
class BearingLoad:
    """F = ∂Π/∂q, the load on the inner ring that holds it at q while the outer ring is at rest.

    force (5,) [N, N, N, N m, N m]; tangent (5, 5) = ∂F/∂q, symmetric, positive semidefinite;
    slopes (5, 6) = ∂F/∂θ, θ in the order of PARAMETERS, zero where they were not asked for; energy Π [J].
    """

    force: np.ndarray
    tangent: np.ndarray
    slopes: np.ndarray
    energy: float


@dataclass(frozen=True)
class BallLoads:
    """What every ball carries, contacts in the order il, ir, ol, or.

    angle (z,) station φ [rad]; force (z, 4) Q [N]; contact_angle (z, 4) β [rad] from the radial plane; pressure (z, 4) peak
    [Pa]; approach (z, 4) |p − c_k| − L_k [m], negative: gap; centre (z, 2) p = (V, W), axial and radial from the pitch
    circle [m]; semi_axes (z, 4, 2) of the contact ellipse along and across the raceway [m].
    """

    angle: np.ndarray
    force: np.ndarray
    contact_angle: np.ndarray
    pressure: np.ndarray
    approach: np.ndarray
    centre: np.ndarray
    semi_axes: np.ndarray


def bearing_load(bearing: Bearing, q: np.ndarray, slopes: bool = True) -> BearingLoad:
    """The load of the bearing at a displacement of its inner ring, with all derivatives.

        Π(q) = min over the ball centres p of  Σ_balls [Σ_k 0.4 K_k δ_k^2.5 − F_c p_ρ],   δ_k = max(|p − c_k| − L_k, 0)
        c_k = c_k⁰ + T_k q  (inner),   T_k = [1 0 0 R_k sin φ −R_k cos φ; 0 cos φ sin φ −x_k sin φ x_k cos φ]

    convex in q; the stationarity in p is (1.18) with −Q_or cos β_or in its second line.
    q (5,) [m, m, m, rad, rad]: axial x, radial y and z, tilt about y and about z, small, of the inner ring relative to the
    outer; F_4, F_5 are the moments T_kᵀ gives, so that (1.24-1.25) hold with the signs + and −.
    Raises UserError for a q that is no five numbers, NumericalError where a ball finds no equilibrium.
    Source: thesis (1.18-1.25) after Halpin and Tran, Journal of Tribology 138 (2016).
    """
    q = _displacement(q)
    force, tangent, slope = np.zeros(5), np.zeros((5, 5)), np.zeros((5, len(PARAMETERS)))
    contacts = bearing.contacts
    energy, ball, excess = ring_load(
        contacts.table,
        contacts.centrifugal,
        bearing.pitch_diameter / 2,
        bearing.ball_diameter,
        bearing.turns,
        q,
        np.zeros(0),
        slopes,
        force,
        tangent,
        slope,
    )
    if ball >= 0:
        raise _unsettled(ball, excess, q)
    return BearingLoad(force, tangent, slope, float(energy))


def ball_loads(bearing: Bearing, q: np.ndarray) -> BallLoads:
    """Forces (1.19), contact angles and pressures of every ball at q (5,) as in `bearing_load`."""
    q = _displacement(q)
    contacts = bearing.contacts
    table, D, cosine = contacts.table, bearing.ball_diameter, math.cos(bearing.contact_angle)
    angle = bearing.first_ball + 2 * np.pi * np.arange(bearing.balls) / bearing.balls
    centre, arm, ball, excess = each_ball(table, contacts.centrifugal[0], bearing.pitch_diameter / 2, D, angle, q)
    if ball >= 0:
        raise _unsettled(ball, excess, q)
    approach = np.linalg.norm(arm, axis=2) - table[:, 2]
    delta = np.maximum(approach, 0)
    force = table[:, 3] * delta**1.5
    axes = np.empty((*delta.shape, 2))
    for k, (r, side) in enumerate(zip(bearing.radii, RADIAL, strict=True)):
        along, across = groove_curvatures(D, r, bearing.pitch_diameter, cosine, side)
        axes[:, k] = np.stack(contact_ellipse(along, across, bearing.effective_modulus, delta[:, k]), axis=1)
    beta = np.arctan2(AXIAL * arm[..., 0], RADIAL * arm[..., 1])
    pressure = peak_pressure(force, axes[..., 0], axes[..., 1])
    return BallLoads(angle, force, beta, pressure, approach, centre, axes)


def _displacement(q: np.ndarray) -> np.ndarray:
    q = np.ascontiguousarray(q, dtype=float)
    if q.shape != (5,) or not np.isfinite(q).all():
        raise UserError(
            f"a bearing displacement {q.tolist()}", remedy="give five finite numbers: axial, two radial, two tilts"
        )
    return q


def _unsettled(ball: int, excess: float, q: np.ndarray) -> NumericalError:
    return NumericalError(
        f"ball {ball} of the bearing finds no equilibrium: its force remains unbalanced by {excess:.1e} times the tolerance"
        f" at the displacement ({', '.join(f'{value:.4g}' for value in q)})",
        remedy="the displacement may be absurd: take a smaller time step or a better start",
    )

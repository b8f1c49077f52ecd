"""The bearing as a force element and a force law: load, derivatives, loads of balls, equilibrium, friction (figure 1.8)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError, StrainsightError, UserError
from strainsight.multibody.bearing.balls import each_ball
from strainsight.multibody.bearing.geometry import (
    AXIAL,
    PARAMETERS,
    RADIAL,
    Bearing,
    contact_ellipse,
    groove_curvatures,
    peak_pressure,
)
from strainsight.multibody.bearing.ring import BALLS, KEPT, ring_law, ring_load
from strainsight.multibody.bodies import Frame
from strainsight.multibody.forces import Load, compiled_law
from strainsight.multibody.laws import regular_friction, turned_by
from strainsight.multibody.relations import Relation, bearing_displacements, dot


@dataclass(frozen=True)
class BearingLoad:
    """F = ∂Π/∂q, the load on the inner ring that holds it at q while the outer ring is at rest. force (5,) [N, N, N, N m, N
    m]; tangent (5, 5) = ∂F/∂q, symmetric, positive semidefinite; slopes (5, 6) = ∂F/∂θ, θ in the order of PARAMETERS, zero
    where they were not asked for; energy Π [J]."""

    force: np.ndarray
    tangent: np.ndarray
    slopes: np.ndarray
    energy: float


@dataclass(frozen=True)
class BallLoads:
    """What every ball carries, contacts in the order il, ir, ol, or. angle (z,) station φ [rad]; force (z, 4) Q [N];
    contact_angle (z, 4) β [rad] from the radial plane; pressure (z, 4) peak [Pa]; approach (z, 4) |p − c_k| − L_k [m],
    negative: gap; centre (z, 2) p = (V, W), axial and radial from the pitch circle [m]; semi_axes (z, 4, 2) of the contact
    ellipse along and across the raceway [m]."""

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
    Source: thesis (1.18-1.25) after Halpin and Tran, Journal of Tribology 138 (2016)."""
    q = _five("displacement", q, "two tilts")
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
    q = _five("displacement", q, "two tilts")
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


def _five(what: str, values: np.ndarray, last: str = "two moments about y and z") -> np.ndarray:
    """Five numbers (5,) along the motions of the inner ring. Raises UserError for others; last: what the last two are."""
    x = np.ascontiguousarray(values, dtype=float)
    if x.shape != (5,) or not np.isfinite(x).all():
        raise UserError(
            f"invalid bearing {what} {x.tolist()}",
            remedy=f"specify five finite numbers: axial (x), radial (y, z), {last}",
        )
    return x


def _unsettled(ball: int, excess: float, q: np.ndarray) -> NumericalError:
    return NumericalError(
        f"ball {ball} of the bearing has no equilibrium: the unbalanced force on the ball is {excess:.1e} times the tolerance"
        f" at the displacement of the inner ring ({', '.join(f'{value:.4g}' for value in q)}) [m, m, m, rad, rad]",
        remedy="if this displacement is not realistic, use a smaller time step, or an initial displacement of the ring closer to "
        "the equilibrium",
    )


ITERATIONS = 200
FLOOR = 1e-9
"""Approach, as a share of the ball diameter, below which forces are negligible."""


def displacement(bearing: Bearing, load: np.ndarray, start: np.ndarray | None = None) -> np.ndarray:
    """q that minimises Π(q) − F·q, i.e. ∂Π/∂q = F: Newton within a trust region, which a convex function always lets end.

    A small load on a ring with clearance has a minimum at the end of a narrow curved valley: it is reached from larger
    loads of the same direction.
    load F (5,) [N, N, N, N m, N m] on the inner ring; start (5,), by default the centred ring. Where clearance leaves the
    ring free, one of its many positions. Returns q (5,) [m, m, m, rad, rad], with F to 1e-9 of itself and of z K (FLOOR D)^1.5.
    Raises UserError for a load or start that is no five numbers, InfeasibleError for a load that is beyond the bearing,
    NumericalError where no equilibrium was reached.
    Source: Conn, Gould and Toint, Trust-Region Methods, algorithm 6.1.1; the tangent is that of `bearing_load`."""
    F, y = _five("load", load), np.zeros(5) if start is None else _five("initial displacement", start, "two tilts")
    # tilts as motions of the pitch circle, so that all five are lengths
    unit = np.array([1.0, 1.0, 1.0, 2 / bearing.pitch_diameter, 2 / bearing.pitch_diameter])
    size, most = float(np.abs(unit * F).max()), _largest_force(bearing)
    if size > most:
        raise _none(
            InfeasibleError,
            F,
            f"even if every contact is compressed by one ball diameter, the balls carry only {most:.3g} N",
        )
    y, left = _newton(bearing, unit, F, y / unit)
    factor = 1e-6 * most / size if left > 1 else 1.0
    while left > 1 or factor > 1:
        factor = max(factor / 4, 1.0)
        y, left = _newton(bearing, unit, factor * F, y)
        if left > 1:
            why = f"after {ITERATIONS} iterations the unbalanced force on the inner ring is {left:.1e} times the tolerance"
            raise _none(NumericalError, factor * F, why)
    semi_axis = float(ball_loads(bearing, unit * y).semi_axes.max())
    if semi_axis > bearing.ball_diameter / 2:
        raise _none(
            InfeasibleError,
            F,
            f"a contact ellipse has a semi-axis of {1e3 * semi_axis:.4g} mm, more than the ball radius",
        )
    return unit * y


def _largest_force(bearing: Bearing) -> float:
    """z K D^1.5 [N]: the scale of the forces of all balls."""
    return bearing.balls * float(np.max(bearing.contacts.table[:, 3])) * bearing.ball_diameter**1.5


def _none(kind: type[StrainsightError], F: np.ndarray, why: str) -> StrainsightError:
    return kind(
        f"the bearing has no equilibrium under the load ({', '.join(f'{x:.4g}' for x in F)}) [N, N, N, N m, N m]: {why}",
        remedy="reduce the load or the preload, and check whether the contact pressures exceed the capacity of the bearing",
    )


def _newton(bearing: Bearing, unit: np.ndarray, F: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float]:
    """The minimiser in y = q/unit, and the unbalanced force as a multiple of the tolerance."""
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
        decrease = float(better) if rounded else (value - new_value) / promised
        if decrease < 0.25:
            trust = 0.25 * float(np.linalg.norm(step))
        elif decrease > 0.75:
            trust = max(trust, 3 * float(np.linalg.norm(step)))
        if decrease > 1e-4:
            y, value, g, H = y + step, new_value, new_g, new_H
    return y, left


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


TILT_WEIGHT, RADIAL_WEIGHT = 4.4, 2.2 * 1.73
"""Friction of a ball slewing bearing: weights of tilting moment and radial force relative to the axial force."""
SMALL = 1.0
"""[N or N m] below which the size of a load is smoothed, so that it has a slope at zero."""


@dataclass(frozen=True)
class Drag:
    """What a bearing takes from motion: a moment against its turn, regular as `regular_friction`, and damping of the ring.

        T_c = T₀ + µ/2 (4.4 M + D F_a + 3.81 D F_r),     T = T_c tanh(ω/ω₀) + c ω

    moment T₀ [N m], of seals and preload; coefficient µ [-]; viscous c [N m s/rad]; speed ω₀ [rad/s]; F_a, F_r, M axial and
    radial force and tilting moment that the balls carry, D the pitch diameter. damping (5,): of the five displacements
    [N s/m, N s/m, N s/m, N m s/rad, N m s/rad].
    Source: thyssenkrupp rothe erde, slewing bearings, starting torque of ball bearings."""

    moment: float = 0.0
    coefficient: float = 0.0
    viscous: float = 0.0
    speed: float = 1e-3
    damping: np.ndarray = field(default_factory=lambda: np.zeros(5))

    @property
    def turns(self) -> bool:
        """Whether friction resists the rotation."""
        return bool(self.moment or self.coefficient or self.viscous)


def ring_relations(outer: Frame, inner: Frame, drag: Drag) -> tuple[Relation, ...]:
    """The five displacements of the inner ring relative to the outer one; with friction also cosine and sine of its rotation
    about x."""
    five = bearing_displacements(outer, inner)
    return (*five, dot(outer, 1, inner, 1), dot(outer, 2, inner, 1)) if drag.turns else five


class BearingLaw:
    """F(ρ, ρ̇, θ) of a bearing on `ring_relations`; θ: its free parameters, by name, in order."""

    def __init__(self, bearing: Bearing, free: Sequence[str] = (), drag: Drag | None = None):
        self._places = [PARAMETERS.index(name) for name in free]
        self._bearing = self._at = bearing
        self._drag = drag or Drag()

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        """F (5 or 7,), ∂F/∂ρ, ∂F/∂ρ̇, ∂F/∂θ (, number of free parameters). Raises the errors of `bearing_load` and `Bearing`."""
        self._move(theta)
        balls, drag = bearing_load(self._at, rho[:5], slopes=bool(self._places)), self._drag
        ring = Load(balls.force, balls.tangent, None, balls.slopes[:, self._places])
        if drag.damping.any():
            rate = np.diag(drag.damping)
            ring = ring._replace(F=ring.F + rate @ rho_dot[:5], F_rate=rate)
        return self._add_friction(balls.force, ring, rho[5:], rho_dot[5:]) if drag.turns else ring

    def _move(self, theta: np.ndarray) -> None:
        if self._places and not np.array_equal(self._at.parameters[self._places], theta):
            values = self._bearing.parameters
            values[self._places] = theta
            self._at = self._bearing.with_parameters(values)

    def _add_friction(self, force: np.ndarray, ring: Load, rho: np.ndarray, rho_dot: np.ndarray) -> Load:
        """Add the friction moment about the bearing axis; force (5,): load of the balls."""
        drag, D = self._drag, self._at.pitch_diameter
        squares = np.array([force[0] ** 2, force[1] ** 2 + force[2] ** 2, force[3] ** 2 + force[4] ** 2])
        size = np.sqrt(squares + SMALL**2)
        share = 0.5 * drag.coefficient * np.array([D, RADIAL_WEIGHT * D, TILT_WEIGHT])
        by_load = force * (share / size)[[0, 1, 1, 2, 2]]
        _, slope, bend = turned_by(rho)
        coulomb = drag.moment + float(share @ (size - SMALL))
        T, steep, by_coulomb = regular_friction(float(slope @ rho_dot), coulomb, drag.viscous, drag.speed)
        F_rho, F_rate = np.zeros((7, 7)), np.zeros((7, 7))
        F_rho[:5, :5] = ring.F_rho
        F_rho[5:, :5] = np.outer(slope, by_coulomb * (by_load @ ring.F_rho))
        F_rho[5:, 5:] = steep * np.outer(slope, bend @ rho_dot) + T * bend
        F_rate[:5, :5] = 0.0 if ring.F_rate is None else ring.F_rate
        F_rate[5:, 5:] = steep * np.outer(slope, slope)
        F_theta = np.vstack([ring.F_theta, np.outer(slope, by_coulomb * (by_load @ ring.F_theta))])
        return Load(np.concatenate([ring.F, T * slope]), F_rho, F_rate, F_theta)

    @property
    def address(self) -> int:
        """Address of the compiled law; 0, for a law in Python, with friction or damping."""
        if self._drag.turns or self._drag.damping.any():
            return 0
        return int(compiled_law(ring_law, BALLS).address)

    @property
    def memory(self) -> int:
        """Stored values of the balls, from which they are tracked."""
        return 6 + KEPT * self._bearing.balls

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """Numbers of `ring_law`."""
        self._move(theta)
        cache = self._at
        sizes = [cache.pitch_diameter / 2, cache.ball_diameter, cache.balls]
        parts = cache.contacts.table.ravel(), cache.contacts.centrifugal, sizes, cache.turns.ravel(), self._places
        return np.concatenate([np.asarray(part, dtype=float) for part in parts])

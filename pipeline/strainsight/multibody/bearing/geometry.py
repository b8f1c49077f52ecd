"""Geometry of a four-point-contact ball bearing: its parameters and groove centres."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal

import numpy as np

from strainsight.compiled import inner, kept
from strainsight.errors import UserError


@kept()
def point_contact(along: float, across: float, modulus: float) -> tuple[float, float]:
    """Contact constant K and the share of the first axis in the approach, from the two relative curvatures.

        Q = K δ^1.5,   a_i² = 2 sᵢ δ/ρᵢ,   s₁ + s₂ = 1,   K = (2π E*/3 K(m)) √(2 s/ρ)  of the long axis,   m = 1 − (b/a)²
        the ellipse from the curvatures:   ρ_short/ρ_long = (1 − s)/(s (b/a)²),   s(m) = (1 − E(m)/K(m))/m
        ∂ ln K/∂ρᵢ = −sᵢ/(2 ρᵢ)

    The slopes follow without another elliptic integral because 0.4 K δ^2.5 is the least elastic energy under a given
    approach: a change of the gap ρᵢ xᵢ²/2 does the work of the pressure on it, and ⟨xᵢ²⟩ = aᵢ²/5 under half an ellipsoid.

    along, across [1/m] > 0: relative principal curvatures; modulus E* [Pa]: 1/E* = Σ (1 − ν²)/E of the two bodies.
    Returns K [N/m^1.5] and s₁ of `along`. Source: Johnson, Contact Mechanics, section 4.2; Hertz 1881."""
    long, short = min(along, across), max(along, across)
    ratio = _axis_ratio(short / long)
    integral, share = _elliptic(ratio)
    constant = 2 * math.pi * modulus / (3 * integral) * math.sqrt(2 * share / long)
    return constant, share if along <= across else 1 - share


@inner
def _elliptic(k: float) -> tuple[float, float]:
    """K(m) and s(m) = (1 − E(m)/K(m))/m at m = 1 − k², by the arithmetic-geometric mean, to round-off for 0 < k ≤ 1. c₁² = m
    (1 − k)/(4 (1 + k)) is divided by m beforehand, so that the circle m = 0 is no special case."""
    a, b = 0.5 * (1 + k), math.sqrt(k)
    c = 0.5 * (1 - k)
    term = 0.25 * (1 - k) / (1 + k)
    share, weight = 0.5 + term, 1.0
    while c > 1e-17 * a:
        mean = 0.5 * (a + b)
        b = math.sqrt(a * b)
        term *= c * c / (16 * mean * mean)
        c *= 0.25 * c / mean
        a = mean
        weight *= 2
        share += weight * term
    return 0.5 * math.pi / a, share


@inner
def _axis_ratio(curvatures: float) -> float:
    """b/a ≤ 1 of the contact ellipse at ρ_short/ρ_long ≥ 1, by the secant rule in logarithms."""
    goal = math.log(curvatures)
    x = -2 / math.pi * goal
    before, f_before = 0.0, -goal
    for _ in range(40):
        _, s = _elliptic(math.exp(x))
        f = math.log((1 - s) / s) - 2 * x - goal
        if f == f_before or x == before:
            break
        step = -f * (x - before) / (f - f_before)
        before, f_before = x, f
        x = min(x + step, 0.0)
        if abs(step) < 1e-15:
            break
    return math.exp(x)


@kept()
def groove_curvatures(ball: float, groove: float, pitch: float, cosine: float, side: float) -> tuple[float, float]:
    """Relative curvatures along and across the raceway of a ball in a groove.

        ρ_along = 2/(D (1 ∓ D cos α/d_m)),   upper sign at the inner ring,      ρ_across = 2/D − 1/r

    ball D, groove r, pitch d_m [m]; cosine: cos α at the free angle; side: +1 inner, −1 outer ring. Returns two [1/m].
    Source: Harris, Rolling Bearing Analysis, chapter 2 (curvature sum and difference)."""
    return 2 / (ball * (1 - side * ball * cosine / pitch)), 2 / ball - 1 / groove


@kept()
def groove_contact(
    ball: float, groove: float, pitch: float, cosine: float, side: float, modulus: float
) -> tuple[float, float, float]:
    """K of a ball in a groove, ∂K/∂D and ∂K/∂r by the chain rule of `point_contact` over `groove_curvatures`. Arguments as in
    `groove_curvatures`; modulus E* [Pa]. Returns [N/m^1.5], [N/m^2.5], [N/m^2.5]."""
    along, across = groove_curvatures(ball, groove, pitch, cosine, side)
    constant, share = point_contact(along, across, modulus)
    gamma = side * ball * cosine / pitch
    along_slope = -0.5 * along * along * (1 - 2 * gamma)
    by_along, by_across = -0.5 * constant * share / along, -0.5 * constant * (1 - share) / across
    by_ball = by_along * along_slope - by_across * 2 / (ball * ball)
    return constant, by_ball, by_across / (groove * groove)


def contact_ellipse(along: float, across: float, modulus: float, approach: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Semi-axes of the contact ellipse along and across, a_i = √(2 sᵢ δ/ρᵢ); approach δ (...) [m] ≥ 0. Returns [m], [m]."""
    _, share = point_contact(along, across, modulus)
    return np.sqrt(2 * share / along * approach), np.sqrt(2 * (1 - share) / across * approach)


def peak_pressure(force: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """p₀ = 3Q/(2π a b), zero without contact; force (...) [N], semi-axes (...) [m]. Returns (...) [Pa]."""
    area = np.pi * a * b
    return np.divide(1.5 * force, area, out=np.zeros_like(area), where=area > 0)


PARAMETERS = (
    "ball_diameter",
    "radius_inner_left",
    "radius_inner_right",
    "radius_outer_left",
    "radius_outer_right",
    "preload",
)
"""θ, in the order of every derivative in θ."""

CONTACTS = ("inner left", "inner right", "outer left", "outer right")
"""k = il, ir, ol, or, in the order of every array over the contacts of a ball."""

AXIAL = np.array([1.0, -1.0, 1.0, -1.0])
RADIAL = np.array([1.0, 1.0, -1.0, -1.0])
"""Sign of the direction from the ball to the groove centre, (± sin α, ± cos α), which is also that of the force on the ball."""

LEAST_GAP, WIDEST = 1e-9, 1e6
"""Least relative excess of the groove radius over the ball radius, and its largest ratio: beyond, rounding leaves no contact
ellipse."""


@dataclass(frozen=True)
class Bearing:
    """A ball bearing with four grooves; the outer ring is at rest, x is the axis, ball i stands at φᵢ = first + 2π i/z.

    balls z ≥ 3; pitch_diameter d_m [m]; contact_angle α [rad] of the free bearing, from the radial plane;
    ball_diameter D [m]; radius_… r_k [m]: groove radii, above D/2 and D/2 + preload;
    preload [m]: oversize of the balls on the radius, negative: clearance;
    groove_centres: "follow": they stand r_k − D/2 from the pitch circle whatever D and r_k are, so that a groove always
    touches the free ball under α; "fixed": they stay where `nominal` has them, and a change of ball or groove becomes
    interference; nominal: (D, r_il, r_ir, r_ol, r_or) [m] that the grooves were cut for, by default the bearing's own;
    youngs_modulus [Pa], poisson_ratio: of balls and rings; density [kg/m³]: of the balls, for their centrifugal force;
    speed [rad/s] of the inner ring; first_ball [rad].
    Raises UserError where no such bearing can be built, with the values."""

    balls: int
    pitch_diameter: float
    contact_angle: float
    ball_diameter: float
    radius_inner_left: float
    radius_inner_right: float
    radius_outer_left: float
    radius_outer_right: float
    preload: float = 0.0
    groove_centres: Literal["follow", "fixed"] = "follow"
    youngs_modulus: float = 2.08e11
    poisson_ratio: float = 0.3
    density: float = 7850.0
    speed: float = 0.0
    first_ball: float = 0.0
    nominal: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not self.nominal:
            object.__setattr__(self, "nominal", tuple(float(value) for value in self.parameters[:5]))
        _check(self)

    @property
    def parameters(self) -> np.ndarray:
        """θ (6,) [m] in the order of PARAMETERS."""
        return np.array([getattr(self, name) for name in PARAMETERS])

    @property
    def radii(self) -> np.ndarray:
        """r_k (4,) [m] in the order of CONTACTS."""
        return self.parameters[1:5]

    @property
    def effective_modulus(self) -> float:
        """E* [Pa] of ball against ring, 1/E* = 2 (1 − ν²)/E."""
        return self.youngs_modulus / (2 * (1 - self.poisson_ratio**2))

    def with_parameters(self, theta: np.ndarray) -> Bearing:
        """The bearing at other θ (6,) [m]; the grooves remain cut for the same nominal values."""
        values = np.asarray(theta, float)
        if values.shape != (len(PARAMETERS),):
            raise UserError(
                f"the array of bearing parameters has shape {values.shape}",
                remedy=f"specify six values: {', '.join(PARAMETERS)}",
            )
        return replace(self, **dict(zip(PARAMETERS, values.tolist(), strict=True)))

    @cached_property
    def turns(self) -> np.ndarray:
        """cos φ, sin φ of the stations of the balls (z, 2)."""
        angle = self.first_ball + 2 * np.pi * np.arange(self.balls) / self.balls
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)

    @cached_property
    def contacts(self) -> Contacts:
        """What the forces need, computed once. Groove centres  c_k = ℓ_k (± sin α, ± cos α),  ℓ_k = r_k − D/2  of now
        ("follow") or of the nominal ("fixed"). Hertz constants at the free contact angle, as Harris has them. Balls orbit at
        half the speed of the contact of the inner ring, ω_c = ω (1 − D cos α/d_m)/2, on the pitch circle:  F_c = (π/6) ρ D³
        ω_c² d_m/2."""
        D, d_m = self.ball_diameter, self.pitch_diameter
        sine, cosine = math.sin(self.contact_angle), math.cos(self.contact_angle)
        follow = self.groove_centres == "follow"
        reach = self.radii - D / 2 if follow else np.array(self.nominal[1:]) - self.nominal[0] / 2
        table = np.empty((4, 10))
        table[:, 0], table[:, 1] = AXIAL * sine * reach, RADIAL * cosine * reach
        table[:, 2] = self.radii - D / 2 - self.preload
        for k, (r, side) in enumerate(zip(self.radii, RADIAL, strict=True)):
            table[k, 3:6] = groove_contact(D, r, d_m, cosine, side, self.effective_modulus)
        for column, signs in ((6, AXIAL * sine), (8, RADIAL * cosine)):
            table[:, column], table[:, column + 1] = -0.5 * follow * signs, 1.0 * follow * signs
        orbit = 0.5 * self.speed * (1 - D * cosine / d_m)
        push = math.pi / 12 * self.density * d_m * D**2 * orbit
        slope = push * (3 * orbit - self.speed * D * cosine / d_m)
        return Contacts(table, np.array([push * D * orbit, slope]))


@dataclass(frozen=True)
class Contacts:
    """The four contacts of a ball, relative to the pitch circle, with their slopes. table (4, 10): x_k, ρ_k: groove centre
    [m];  L_k = r_k − D/2 − preload: distance of the ball centre at touch [m]; K_k [N/m^1.5];  ∂K_k/∂D, ∂K_k/∂r_k;  ∂x_k/∂D,
    ∂x_k/∂r_k;  ∂ρ_k/∂D, ∂ρ_k/∂r_k centrifugal (2,): F_c [N], radially outwards, and ∂F_c/∂D [N/m]"""

    table: np.ndarray
    centrifugal: np.ndarray


def _check(bearing: Bearing) -> None:
    for field in fields(bearing):
        value = getattr(bearing, field.name)
        if field.name not in ("groove_centres", "nominal") and not math.isfinite(value):
            raise UserError(f"the bearing's {field.name} is {value}", remedy="specify a finite number")
    if bearing.balls < 3 or bearing.balls != int(bearing.balls):
        raise UserError(
            f"the bearing has {bearing.balls} balls", remedy="specify at least 3 balls; fewer give no tilt stiffness"
        )
    for name in ("pitch_diameter", "ball_diameter", "youngs_modulus"):
        if getattr(bearing, name) <= 0:
            raise UserError(f"the bearing's {name} is {getattr(bearing, name):.6g}", remedy="specify a positive value")
    if not 0 < bearing.contact_angle < math.pi / 2:
        raise UserError(
            f"the free contact angle is {math.degrees(bearing.contact_angle):.4g}°",
            remedy="specify an angle between 0 and 90°",
        )
    if not -1 < bearing.poisson_ratio < 0.5 or bearing.density < 0:
        raise UserError(
            f"the bearing has Poisson's ratio {bearing.poisson_ratio:.4g} and a density of {bearing.density:.4g} kg/m³",
            remedy="specify a Poisson's ratio between -1 and 0.5, and a density of at least 0",
        )
    if bearing.groove_centres not in ("follow", "fixed"):
        raise UserError(
            f"unknown groove centres '{bearing.groove_centres}'",
            remedy="set `groove_centres` to follow (they move with the ball diameter and the groove radii) or "
            "fixed (they stay at the nominal position)",
        )
    if bearing.ball_diameter >= bearing.pitch_diameter:
        raise UserError(
            f"the ball diameter is {1e3 * bearing.ball_diameter:.6g} mm, the pitch diameter "
            f"{1e3 * bearing.pitch_diameter:.6g} mm",
            remedy="specify a ball diameter smaller than the pitch diameter",
        )
    _check_grooves(bearing.ball_diameter, bearing.radii.tolist(), max(bearing.preload, 0.0), "")
    if len(bearing.nominal) != 5 or not all(math.isfinite(value) for value in bearing.nominal):
        raise UserError(
            f"invalid nominal dimensions {bearing.nominal} of the bearing",
            remedy="specify five finite numbers [m]: the ball diameter and four groove radii",
        )
    _check_grooves(bearing.nominal[0], list(bearing.nominal[1:]), 0.0, "nominal ")


def _check_grooves(ball: float, radii: list[float], oversize: float, which: str) -> None:
    for name, radius in zip(CONTACTS, radii, strict=True):
        if radius <= (1 + LEAST_GAP) * ball / 2 + oversize:
            raise UserError(
                f"the {which}{name} groove of radius {1e3 * radius:.6f} mm is too small for a ball of radius"
                f" {1e3 * ball / 2:.6f} mm" + (f" with {1e6 * oversize:.4g} µm of preload" if oversize else ""),
                remedy="specify a groove radius larger than the ball radius, usually by 2 to 8 %",
            )
        if radius > WIDEST * ball / 2:
            raise UserError(
                f"the {which}{name} groove of radius {1e3 * radius:.6g} mm is {2 * radius / ball:.3g} times the ball radius",
                remedy="check the units of the ball diameter; groove radii are usually 2 to 8 % larger than the ball radius",
            )

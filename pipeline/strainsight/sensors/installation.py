"""Gauges as they are installed: drawn from tolerances, what they read, and how that depends on the installation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.mesh.facets import Facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.properties import Thickness
from strainsight.sensors.candidates import ACCELERATION, STRAIN, Candidates
from strainsight.sensors.rows import (
    ChannelPoints,
    channel_rows,
    installation_axes,
    matrix_of,
    misplaced,
    points_within,
    surface_of,
)
from strainsight.sensors.surface import facet_frames, turned
from strainsight.sensors.walk import Skin

LEAST = 1e-6
"""Over a step: a way that is shorter is none."""
CALIBRATION_POISSON = 0.285
"""ν₀ of the steel bar on which a manufacturer measures the gauge factor."""
REACH = 3.0**0.5
"""Over the σ of a position: how far from the nominal place, on both sides, the reading is taken."""
BEYOND = 0.75
"""Over the size of a facet: how far at least on facets of straight edges, whose strain hardly changes before the next one."""


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives (g, r) of every grid's reading of r displacement fields with respect to how its gauge is installed; but for
    bridges, whose arms are gauges here (`Candidates.grids`), a channel is one grid.

    along, across [unit of the channel/m]: position of the gauge along e₁ and e₂ of `installation_axes`
    angle [unit/rad]: turn of the gauge about the outward normal, right-handed
    tilt_along, tilt_across [unit/rad]: turn of a motion sensor about e₁ and e₂; zero for strain gauges, which lie on the surface
    gain [unit]: relative error of the factor on the reading, which is the row itself
    transverse [strain]: transverse sensitivity K_t of a strain gauge; zero for motion sensors, whose tilts say it
    along_twice, across_twice, along_across [unit of the channel/m²], turned_twice [unit/rad²]: second derivatives

    Gain and transverse belong to each channel, the others to a gauge, all channels of which move and turn as one.
    """

    along: np.ndarray
    across: np.ndarray
    angle: np.ndarray
    tilt_along: np.ndarray
    tilt_across: np.ndarray
    gain: np.ndarray
    transverse: np.ndarray
    along_twice: np.ndarray
    across_twice: np.ndarray
    along_across: np.ndarray
    turned_twice: np.ndarray


SECOND = ("along_twice", "across_twice", "along_across", "turned_twice")
COMMON = ("along", "across", "angle", "tilt_along", "tilt_across", *SECOND)
"""What all channels of a gauge have in common."""
OWN = ("gain", "transverse")
"""What every channel has for itself."""


def sensitivity_rows(
    position: np.ndarray,
    candidates: Candidates,
    field: np.ndarray,
    std: float,
    *,
    facets: Facets | Skin | None = None,
    thickness: Thickness | None = None,
) -> Sensitivity:
    """What misplaced, turned and imperfect gauges read of displacement fields, less what they are meant to:

        position      [ε(+s eₖ) − ε(−s eₖ)]/(2s),  s = √3 σ,          moved over the surface by `misplaced`
        twice         [ε(+s eₖ) + ε(−s eₖ) − 2ε]/s²;  mixed: [ε(+,+) + ε(−,−) − Σₖ(ε(+s eₖ) + ε(−s eₖ)) + 2ε]/(2s²)
        angle         dε/dα = 2 dᵀE(n × d) = γ = ε(+45°) − ε(−45°),     d²ε/dα² = 2(ε_t − ε)          (Mohr's circle)
        transverse    dε̂/dK_t = ε_t + ν₀ ε,   of   ε̂ = (ε + K_t ε_t)/(1 − ν₀ K_t),   ε_t = (n × d)ᵀE(n × d)
        motion        reading d·z: gain as above, turns (ω × d)·z about ω = n, e₁, e₂

    Differences in position are taken at the nodes of Gauss-Hermite quadrature of three points: the slope is that of statistical
    linearisation over a normal distribution of σ, exact of a cubic, and the mean is that of the quadrature. On facets without
    nodes between their corners, in which strain is constant or nearly so, the step is at least ¾ of the facet's size. A gauge
    that a sharp edge holds back has the slope over the way it can go, zero where it cannot move at all, and the second
    differences of the ways that are open.

    Over a grid all are means of its points; that its ends move aside as it turns is left out, which is nothing where strain
    varies linearly over the grid. ν₀ = 0.285, that of the manufacturers' calibration, after which uniaxial stress in such a
    material is read without error.

    position (n, 3) [m]; candidates (m); field (3n, r) [m per unit], row 3·node + component; std σ [m] of the position along
    each direction, 0 leaves its rows zero; facets of the whole surface; thickness as in `channel_matrix`. Raises InfeasibleError
    as that does.
    Sources: Micro-Measurements, Tech Notes TN-509 (transverse sensitivity) and TN-511 (misalignment); Gelb, Applied Optimal
    Estimation (1974), section 6.2 (statistical linearisation).
    """
    candidates = candidates.grids
    skin = surface_of(position, candidates, facets)
    points = points_within(position, candidates, skin)
    z = np.asarray(field).reshape(3 * len(position), -1)

    def read(direction: np.ndarray) -> np.ndarray:
        return np.asarray(matrix_of(position, replace(points, direction=direction), len(candidates), thickness) @ z)

    n, d = normals_of(position, points), points.direction
    straining = (candidates.quantity == STRAIN)[:, None]
    own, aside = read(d), read(np.cross(n, d))
    quarter = np.full(len(d), 45.0)
    shear = read(turned(d, n, quarter)) - read(turned(d, n, -quarter))
    e1, e2 = (axis[candidates.gauge[points.channel]] for axis in installation_axes(candidates))
    nothing = np.zeros_like(own)
    (along, across), second = (nothing, nothing), (nothing, nothing, nothing)
    if std > 0:
        (along, across), second = _in_place(
            position, candidates, z, skin, _steps(candidates, skin, std), own, thickness
        )
    return Sensitivity(
        along=along,
        across=across,
        angle=np.where(straining, shear, aside),
        tilt_along=nothing if straining.all() else np.where(straining, 0.0, read(np.cross(e1, d))),
        tilt_across=nothing if straining.all() else np.where(straining, 0.0, read(np.cross(e2, d))),
        gain=own,
        transverse=np.where(straining, aside + CALIBRATION_POISSON * own, 0.0),
        along_twice=second[0],
        across_twice=second[1],
        along_across=second[2],
        turned_twice=np.where(straining, 2 * (aside - own), -own),
    )


def given_sensitivity(rows: np.ndarray) -> Sensitivity:
    """That of channels whose rows (m, r) are given without a surface: their gain, and nothing else that is known."""
    nothing = np.zeros_like(rows)
    return Sensitivity(nothing, nothing, nothing, nothing, nothing, rows, nothing, nothing, nothing, nothing, nothing)


def _steps(candidates: Candidates, skin: Skin, std: float) -> np.ndarray:
    """How far (gauges,) [m] a gauge is moved: √3 σ, and on facets without nodes between corners out of its own."""
    first = candidates.take(candidates.first)
    size = skin.size[skin.index_of(first.element, first.facet)]
    straight = np.array([not kind.edges for kind in FACETS])[first.kind]
    return np.where(straight, np.maximum(REACH * std, BEYOND * size), REACH * std)


def _in_place(
    position: np.ndarray,
    candidates: Candidates,
    field: np.ndarray,
    skin: Skin,
    step: np.ndarray,
    own: np.ndarray,
    thickness: Thickness | None,
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """First and second differences of the readings own (m, r) in the place, over steps (gauges,) [m] along e₁ and e₂: along e₁,
    along e₂; twice along e₁, twice along e₂, along both."""
    axes = installation_axes(candidates)

    def at(*ways: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Readings after steps these ways along e₁ and e₂, and how far (gauges,) they went along each, over the step."""
        moved, _ = misplaced(position, candidates, skin, np.outer(step, ways))
        went = moved.position[moved.first] - candidates.position[candidates.first]
        return channel_rows(position, moved, field, facets=skin, thickness=thickness), [
            np.sum(went * e, axis=1) / step for e in axes
        ]

    def over(length: np.ndarray, exists: np.ndarray) -> np.ndarray:
        """One over a length (gauges,), for every channel; zero where it does not exist."""
        return np.asarray(np.where(exists, 1 / np.where(exists, length, 1.0), 0.0)[candidates.gauge][:, None])

    first, twice, ends = [], [], 2 * own
    free = np.ones(candidates.gauges, dtype=bool)
    for axis, ways in enumerate(((1, 0), (0, 1))):
        further, ahead = at(*ways)
        nearer, behind = at(*(-way for way in ways))
        a, b = ahead[axis], -behind[axis]
        both = (a > LEAST) & (b > LEAST)
        first.append((further - nearer) * over(step * (a + b), a + b > LEAST))
        bent = (further - own) * over(a, both) - (own - nearer) * over(b, both)
        twice.append(2 * bent * over(step**2 * (a + b), both))
        ends = ends - further - nearer
        free &= (a > 1 - LEAST) & (b > 1 - LEAST)
    for way in (1, -1):
        corner, went = at(way, way)
        ends = ends + corner
        free &= (way * went[0] > 1 - LEAST) & (way * went[1] > 1 - LEAST)
    return (first[0], first[1]), (twice[0], twice[1], ends * over(2 * step**2, free))


def normals_of(position: np.ndarray, points: ChannelPoints) -> np.ndarray:
    """Outward unit normals (p, 3) of the facets at the points."""
    return facet_frames(position, points.kind, points.nodes, points.local)[1]


@dataclass(frozen=True)
class InstallationStd:
    """σ of how gauges are installed: position [m] along each of two directions; angle [rad]; gain [-]; transverse [-]: K_t;
    offset [strain]. At the end of a record: drift [strain] of the zero, temperature [K] of the part, of which all gauges read
    thermal_output [strain/K], and each thermal_spread [strain/K] beside."""

    position: float = 0.0
    angle: float = 0.0
    gain: float = 0.0
    transverse: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    temperature: float = 0.0
    thermal_output: float = 0.0
    thermal_spread: float = 0.0

    @property
    def warmed(self) -> tuple[float, float]:
        """σ [strain] at the end of a record of what the temperature makes all gauges read, and each of them beside."""
        return self.temperature * self.thermal_output, self.temperature * self.thermal_spread

    @property
    def by_name(self) -> dict[str, float]:
        """σ of what each array of a `Sensitivity` is multiplied by: of the error x itself, and for second derivatives of
        (x² − σ²)/2, which is σ²/√2, and of x₁x₂, which is σ²."""
        place, turn = self.position, self.angle
        first = {"along": place, "across": place, "angle": turn, "tilt_along": turn, "tilt_across": turn}
        twice = {"along_twice": place**2 / 2**0.5, "across_twice": place**2 / 2**0.5, "along_across": place**2}
        return first | twice | {"turned_twice": turn**2 / 2**0.5, "gain": self.gain, "transverse": self.transverse}

    def mean(self, sensitivity: Sensitivity) -> np.ndarray:
        """What gauges read on average (g, r) beyond what they are meant to: ½ σ² of every second derivative in one error."""
        place = sensitivity.along_twice + sensitivity.across_twice
        return 0.5 * (self.position**2 * place + self.angle**2 * sensitivity.turned_twice)


@dataclass(frozen=True)
class Installation:
    """How each gauge, grid and channel really is; the arms of a bridge are gauges (`Candidates.grids`, g of them).

    place (gauges, 2) [m] along the `installation_axes`; angle (gauges,) [rad] about the normal; tilt (gauges, 2) [rad] about
    those axes, of motion sensors; gain (g,) relative error of the reading; transverse (g,) K_t; offset (m,) [strain] that is
    always there; drift (m,) [strain] that is there at the end of the record, t/T of it before.

    """

    place: np.ndarray
    angle: np.ndarray
    tilt: np.ndarray
    gain: np.ndarray
    transverse: np.ndarray
    offset: np.ndarray
    drift: np.ndarray

    def take(self, candidates: Candidates, gauges: np.ndarray) -> Installation:
        """Of some gauges (k,) of the candidates, in their order."""
        own, (grids, each) = candidates.channels(gauges), candidates.grids_of(gauges)
        return Installation(
            self.place[each],
            self.angle[each],
            self.tilt[each],
            self.gain[grids],
            self.transverse[grids],
            self.offset[own],
            self.drift[own],
        )


def drawn_installation(candidates: Candidates, std: InstallationStd, rng: np.random.Generator) -> Installation:
    """Normal and independent: place, angle and tilt of every gauge, gain and K_t of every grid, offset and drift of every
    channel, one temperature of the part, and what every gauge reads of a kelvin. The arms of a bridge are gauges.

    Gauges that are bonded already keep place and direction. Only channels of strain have K_t, an offset and a drift, only
    motion sensors tilt.

    """
    grids, m = candidates.grids, len(candidates)
    common, own = rng.standard_normal((grids.gauges, 5)), rng.standard_normal((len(grids), 3))
    common *= ~grids.bonded[grids.first][:, None]
    straining = grids.quantity == STRAIN
    # drawn after what was there before it
    drift, warmer = std.drift * rng.standard_normal(m), std.temperature * rng.standard_normal()
    of_kelvin = std.thermal_output + std.thermal_spread * rng.standard_normal(grids.gauges)
    return Installation(
        place=std.position * common[:, :2],
        angle=std.angle * common[:, 2],
        tilt=std.angle * common[:, 3:] * ~straining[grids.first][:, None],
        gain=std.gain * own[:, 0],
        transverse=std.transverse * own[:, 1] * straining,
        offset=std.offset * own[:m, 2] * straining[:m],
        drift=(drift + warmer * candidates.read(of_kelvin[grids.gauge])) * straining[:m],
    )


def installation_variance(
    sensitivity: Sensitivity, std: InstallationStd, candidates: Candidates, still: np.ndarray, moving: np.ndarray
) -> np.ndarray:
    """How far the readings of a motion are off by the installation, mean square in time and over installations:

        vⱼ = Σₖ σₖ² mean_t (sₖⱼ·q)² = Σₖ σₖ² sₖⱼ C sₖⱼᵀ,     C = mean_t q qᵀ,   of accelerometers of q̈

    k: place and turns, to second order, gain and transverse sensitivity; σ² of an offset is added where strain is read, and a
    third of that at the end of what grows from nothing, but for what a temperature adds to all gauges. Gauges that are bonded
    already have errors of gain, K_t, offset and drift alone. The variances of the arms of a bridge add up. still, moving
    (r, r): C of the coordinates and of their second rates. Returns (m,) [unit² of the channel].

    """
    grids = candidates.grids
    free, sensing = ~grids.bonded, grids.quantity == ACCELERATION
    at_end = std.drift**2 + std.warmed[1] ** 2 * candidates.added(np.ones(len(grids)))
    variance = (std.offset**2 + at_end / 3) * (candidates.quantity == STRAIN)
    for name, sigma in std.by_name.items():
        s = getattr(sensitivity, name)
        square = [np.einsum("mi,ij,mj->m", s, C, s, optimize=True) for C in (still, moving)]
        own = sigma**2 * np.where(sensing, square[1], square[0]) * (free if name in COMMON else 1.0)
        variance = variance + candidates.added(own)
    return variance


def installed_rows(
    position: np.ndarray,
    candidates: Candidates,
    field: np.ndarray,
    installation: Installation,
    *,
    facets: Facets | Skin | None = None,
    thickness: Thickness | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """What the gauges as installed read of displacement fields, without offset and drift:

        (1 + g)(ε + K_t ε_t)/(1 − ν₀ K_t),   ε and ε_t along and across each grid where and how it really lies

    and of a bridge the sum of that over its arms.
    position (n, 3) [m]; field (3n, r) [m per unit]; facets of the whole surface; thickness as in `channel_matrix`. Returns rows
    (m, r) [unit of the channel] and which gauges (gauges,) a sharp edge has kept from going as far as asked, of bridges with an
    arm. K_t as in `sensitivity_rows`. Raises InfeasibleError where the grid of a gauge runs over a sharp edge.
    """
    grids = candidates.grids
    skin, held = surface_of(position, grids, facets), np.zeros(grids.gauges, dtype=bool)
    if installation.place.any() or installation.angle.any():
        grids, held = misplaced(position, grids, skin, installation.place, np.rad2deg(installation.angle))
    grids = _tilted(grids, installation.tilt)
    points = points_within(position, grids, skin)
    z = np.asarray(field).reshape(3 * len(position), -1)
    rows = np.asarray(matrix_of(position, points, len(grids), thickness) @ z)
    k = installation.transverse[:, None]
    if k.any():
        aside = replace(points, direction=np.cross(normals_of(position, points), points.direction))
        rows = (rows + k * (matrix_of(position, aside, len(grids), thickness) @ z)) / (1 - CALIBRATION_POISSON * k)
    held_back = candidates.any_grid(held[grids.gauge])[candidates.first]
    return candidates.read((1 + installation.gain[:, None]) * rows), held_back


def _tilted(candidates: Candidates, tilt: np.ndarray) -> Candidates:
    if not tilt.any():
        return candidates
    e1, e2 = installation_axes(candidates)
    about = (tilt[:, :1] * e1 + tilt[:, 1:] * e2)[candidates.gauge]
    angle = np.linalg.norm(about, axis=1)
    axis = about / np.where(angle > 0, angle, 1.0)[:, None]
    return replace(candidates, direction=turned(candidates.direction, axis, np.rad2deg(angle)))

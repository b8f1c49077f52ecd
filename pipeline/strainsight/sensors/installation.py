"""Installation of gauges: errors sampled from tolerances, readings with them, and their sensitivity to them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.mesh.facets import Facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.properties import Thickness
from strainsight.sensors.candidates import ACCELERATION, STRAIN, Candidates
from strainsight.sensors.mesh_error import mesh_error_matrix
from strainsight.sensors.strain_operator import (
    ChannelPoints,
    channel_rows,
    installation_axes,
    matrix_of,
    misplaced,
    points_within,
    surface_of,
)
from strainsight.sensors.surface import facet_frames, turned
from strainsight.sensors.surface_paths import Skin

LEAST = 1e-6
"""Smallest displacement over a step that counts as movement."""
CALIBRATION_POISSON = 0.285
"""ν₀ of the steel bar on which manufacturers calibrate the gauge factor."""
REACH = 3.0**0.5
"""Distance from the nominal position on both sides, over σ of the position, at which the reading is evaluated."""
LEAST_SHARE = 0.75
"""Least distance over the size of a facet with straight edges, whose strain hardly changes up to the next facet."""


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives (g, r) of the reading of every grid, in r displacement fields, with respect to the installation of its gauge; a
    channel is one grid, except for bridges, whose arms are gauges here (`Candidates.grids`).

    along, across [unit of the channel/m]: position of the gauge along e₁ and e₂ of `installation_axes`
    angle [unit/rad]: rotation of the gauge about the outward normal, right-handed
    tilt_along, tilt_across [unit/rad]: rotation of a motion sensor about e₁ and e₂; zero for strain gauges on the surface
    gain [unit]: relative error of the scale factor of the reading; this is the row itself
    common_gain [strain]: relative error common to all strain gauges; zero for motion sensors
    transverse [strain]: transverse sensitivity K_t of a strain gauge; zero for motion sensors, which have tilts
    along_twice, across_twice, along_across [unit of the channel/m²], turned_twice [unit/rad²]: second derivatives
    mesh [strain]: estimated error of a strain gauge by the mesh (`mesh_error_matrix`); zero for motion sensors

    Gain, transverse and mesh belong to each channel, the others to a gauge, whose channels move and rotate as one."""

    along: np.ndarray
    across: np.ndarray
    angle: np.ndarray
    tilt_along: np.ndarray
    tilt_across: np.ndarray
    gain: np.ndarray
    common_gain: np.ndarray
    transverse: np.ndarray
    along_twice: np.ndarray
    across_twice: np.ndarray
    along_across: np.ndarray
    turned_twice: np.ndarray
    mesh: np.ndarray


SECOND = ("along_twice", "across_twice", "along_across", "turned_twice")
COMMON = ("along", "across", "angle", "tilt_along", "tilt_across", *SECOND)
"""Errors that all channels of a gauge have in common."""
COMMON_GAIN = "common_gain"
"""Error that all strain gauges have in common."""


def sensitivity_rows(
    position: np.ndarray,
    candidates: Candidates,
    field: np.ndarray,
    std: float,
    *,
    facets: Facets | Skin | None = None,
    thickness: Thickness | None = None,
    mesh: bool = False,
) -> Sensitivity:
    """Changes of the readings of displacement fields by position, rotation and imperfections of gauges:

        position      [ε(+s eₖ) − ε(−s eₖ)]/(2s),  s = √3 σ,          moved over the surface by `misplaced`
        twice         [ε(+s eₖ) + ε(−s eₖ) − 2ε]/s²;  mixed: [ε(+,+) + ε(−,−) − Σₖ(ε(+s eₖ) + ε(−s eₖ)) + 2ε]/(2s²)
        angle         dε/dα = 2 dᵀE(n × d) = γ = ε(+45°) − ε(−45°),     d²ε/dα² = 2(ε_t − ε)          (Mohr's circle)
        transverse    dε̂/dK_t = ε_t + ν₀ ε,   of   ε̂ = (ε + K_t ε_t)/(1 − ν₀ K_t),   ε_t = (n × d)ᵀE(n × d)
        motion        reading d·z: gain as above, turns (ω × d)·z about ω = n, e₁, e₂

    Differences in position are evaluated at the nodes of three-point Gauss-Hermite quadrature: the slope is that of statistical
    linearisation over a normal distribution of σ, exact for a cubic, and the mean is that of the quadrature. On facets without
    mid-side nodes, where strain is (nearly) constant, the step is at least ¾ of the facet size. For a gauge at a sharp edge the
    slope uses the possible movement, zero if it cannot move, and the second differences the open directions.

    With a grid all are means over its points; the lateral movement of its ends by rotation is neglected, which has no effect if
    the strain varies linearly over the grid. ν₀ = 0.285 of the calibration makes the reading exact for uniaxial stress in such a
    material.

    position (n, 3) [m]; candidates (m); field (3n, r) [m per unit], row 3·node + component; std σ [m] of the position along
    each direction, 0 leaves its rows zero; facets of the whole surface; thickness as in `channel_matrix`; mesh: whether to
    estimate errors by the mesh, else zero. Raises InfeasibleError as `channel_matrix` does.
    Sources: Micro-Measurements, Tech Notes TN-509 (transverse sensitivity) and TN-511 (misalignment); Gelb, Applied Optimal
    Estimation (1974), section 6.2 (statistical linearisation)."""
    candidates = candidates.grids
    skin = surface_of(position, candidates, facets)
    points = points_within(position, candidates, skin)
    z = np.asarray(field).reshape(3 * len(position), -1)

    def read(direction: np.ndarray) -> np.ndarray:
        return np.asarray(matrix_of(position, replace(points, direction=direction), len(candidates), thickness) @ z)

    n, d = normals_of(position, points), points.direction
    straining = (candidates.quantity == STRAIN)[:, None]
    reading, transverse_reading = read(d), read(np.cross(n, d))
    quarter = np.full(len(d), 45.0)
    shear = read(turned(d, n, quarter)) - read(turned(d, n, -quarter))
    e1, e2 = (axis[candidates.gauge[points.channel]] for axis in installation_axes(candidates))
    nothing = np.zeros_like(reading)
    (along, across), second = (nothing, nothing), (nothing, nothing, nothing)
    if std > 0:
        (along, across), second = _position_differences(
            position, candidates, z, skin, _steps(candidates, skin, std), reading, thickness
        )
    return Sensitivity(
        along=along,
        across=across,
        angle=np.where(straining, shear, transverse_reading),
        tilt_along=nothing if straining.all() else np.where(straining, 0.0, read(np.cross(e1, d))),
        tilt_across=nothing if straining.all() else np.where(straining, 0.0, read(np.cross(e2, d))),
        gain=reading,
        common_gain=np.where(straining, reading, 0.0),
        transverse=np.where(straining, transverse_reading + CALIBRATION_POISSON * reading, 0.0),
        along_twice=second[0],
        across_twice=second[1],
        along_across=second[2],
        turned_twice=np.where(straining, 2 * (transverse_reading - reading), -reading),
        mesh=mesh_error_matrix(position, points, len(candidates), skin.facets, thickness) @ z if mesh else nothing,
    )


def given_sensitivity(rows: np.ndarray) -> Sensitivity:
    """Sensitivity of channels with imported rows (m, r), without a surface: their gain only."""
    nothing = np.zeros_like(rows)
    return Sensitivity(
        nothing, nothing, nothing, nothing, nothing, rows, rows, nothing, nothing, nothing, nothing, nothing, nothing
    )


def _steps(candidates: Candidates, skin: Skin, std: float) -> np.ndarray:
    """Displacement step (gauges,) [m]: √3 σ, on facets without mid-side nodes at least `LEAST_SHARE` of their size."""
    first = candidates.take(candidates.first)
    size = skin.size[skin.index_of(first.element, first.facet)]
    straight = np.array([not kind.edges for kind in FACETS])[first.kind]
    return np.where(straight, np.maximum(REACH * std, LEAST_SHARE * size), REACH * std)


def _position_differences(
    position: np.ndarray,
    candidates: Candidates,
    field: np.ndarray,
    skin: Skin,
    step: np.ndarray,
    reading: np.ndarray,
    thickness: Thickness | None,
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """First and second differences of the readings (m, r), over steps (gauges,) [m] along e₁ and e₂: along e₁, along e₂; twice
    along e₁, twice along e₂, along both."""
    axes = installation_axes(candidates)

    def at(*ways: int) -> tuple[np.ndarray, list[np.ndarray]]:
        """Readings after steps in these directions along e₁ and e₂, and the movement (gauges,) along each, over the step."""
        moved, _ = misplaced(position, candidates, skin, np.outer(step, ways))
        went = moved.position[moved.first] - candidates.position[candidates.first]
        return channel_rows(position, moved, field, facets=skin, thickness=thickness), [
            np.sum(went * e, axis=1) / step for e in axes
        ]

    def over(length: np.ndarray, exists: np.ndarray) -> np.ndarray:
        """Reciprocal of a length (gauges,) for every channel; zero where it does not exist."""
        return np.asarray(np.where(exists, 1 / np.where(exists, length, 1.0), 0.0)[candidates.gauge][:, None])

    first, twice, ends = [], [], 2 * reading
    free = np.ones(candidates.gauges, dtype=bool)
    for axis, ways in enumerate(((1, 0), (0, 1))):
        further, ahead = at(*ways)
        nearer, behind = at(*(-way for way in ways))
        a, b = ahead[axis], -behind[axis]
        both = (a > LEAST) & (b > LEAST)
        first.append((further - nearer) * over(step * (a + b), a + b > LEAST))
        bent = (further - reading) * over(a, both) - (reading - nearer) * over(b, both)
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
    """σ of installation errors: position [m] along each of two directions; angle [rad]; gain [-];
    common_gain [-] of all strain gauges; transverse [-]: K_t; mesh [-]: factor on the estimated error by the mesh; offset
    [strain]. At the end of a record: drift [strain] of the
    zero, temperature [K] of the part, which changes all gauges by thermal_output [strain/K], and each gauge in addition by
    thermal_spread [strain/K]."""

    position: float = 0.0
    angle: float = 0.0
    gain: float = 0.0
    common_gain: float = 0.0
    transverse: float = 0.0
    mesh: float = 0.0
    offset: float = 0.0
    drift: float = 0.0
    temperature: float = 0.0
    thermal_output: float = 0.0
    thermal_spread: float = 0.0

    @property
    def warmed(self) -> tuple[float, float]:
        """σ [strain] at the end of a record of the common and of the individual thermal output of the gauges."""
        return self.temperature * self.thermal_output, self.temperature * self.thermal_spread

    @property
    def by_name(self) -> dict[str, float]:
        """σ of the factor of each array of a `Sensitivity`: of the error x itself, and for second derivatives of (x² − σ²)/2,
        which is σ²/√2, and of x₁x₂, which is σ²."""
        place, turn = self.position, self.angle
        first = {"along": place, "across": place, "angle": turn, "tilt_along": turn, "tilt_across": turn}
        twice = {"along_twice": place**2 / 2**0.5, "across_twice": place**2 / 2**0.5, "along_across": place**2}
        gains = {"gain": self.gain, COMMON_GAIN: self.common_gain, "transverse": self.transverse, "mesh": self.mesh}
        return first | twice | {"turned_twice": turn**2 / 2**0.5} | gains

    def mean(self, sensitivity: Sensitivity) -> np.ndarray:
        """Mean change of the readings (g, r) by installation errors: ½ σ² of every second derivative in one error."""
        place = sensitivity.along_twice + sensitivity.across_twice
        return 0.5 * (self.position**2 * place + self.angle**2 * sensitivity.turned_twice)


@dataclass(frozen=True)
class Installation:
    """Actual installation of each gauge, grid and channel; the arms of a bridge are gauges (`Candidates.grids`, g of them).

    place (gauges, 2) [m] along the `installation_axes`; angle (gauges,) [rad] about the normal; tilt (gauges, 2) [rad] about
    those axes, of motion sensors; gain (g,) relative error of the reading; transverse (g,) K_t; offset (m,) [strain], constant;
    drift (m,) [strain] at the end of the record, t/T of it before; mesh (g,) error by the mesh, over its estimate.

    """

    place: np.ndarray
    angle: np.ndarray
    tilt: np.ndarray
    gain: np.ndarray
    transverse: np.ndarray
    offset: np.ndarray
    drift: np.ndarray
    mesh: np.ndarray

    def take(self, candidates: Candidates, gauges: np.ndarray) -> Installation:
        """Installation of some gauges (k,) of the candidates, in their order."""
        channels, (grids, each) = candidates.channels(gauges), candidates.grids_of(gauges)
        return Installation(
            self.place[each],
            self.angle[each],
            self.tilt[each],
            self.gain[grids],
            self.transverse[grids],
            self.offset[channels],
            self.drift[channels],
            self.mesh[grids],
        )


def sample_installation(candidates: Candidates, std: InstallationStd, rng: np.random.Generator) -> Installation:
    """Sample independent normal errors: position, angle and tilt of every gauge, gain and K_t of every grid, offset and drift of
    every channel, one temperature of the part, and the thermal output of every gauge. The arms of a bridge are gauges.

    Bonded gauges keep their position and direction. Only strain channels have K_t, an offset and a drift, only motion sensors
    tilt.

    """
    grids, m = candidates.grids, len(candidates)
    of_gauge, of_grid = rng.standard_normal((grids.gauges, 5)), rng.standard_normal((len(grids), 3))
    of_gauge *= ~grids.bonded[grids.first][:, None]
    straining = grids.quantity == STRAIN
    # sampled last, so that the other samples do not change with them
    drift, warmer = std.drift * rng.standard_normal(m), std.temperature * rng.standard_normal()
    of_kelvin = std.thermal_output + std.thermal_spread * rng.standard_normal(grids.gauges)
    common = std.common_gain * rng.standard_normal() * straining
    mesh = std.mesh * rng.standard_normal(len(grids))
    return Installation(
        place=std.position * of_gauge[:, :2],
        angle=std.angle * of_gauge[:, 2],
        tilt=std.angle * of_gauge[:, 3:] * ~straining[grids.first][:, None],
        gain=std.gain * of_grid[:, 0] + common,
        transverse=std.transverse * of_grid[:, 1] * straining,
        offset=std.offset * of_grid[:m, 2] * straining[:m],
        drift=(drift + warmer * candidates.read(of_kelvin[grids.gauge])) * straining[:m],
        mesh=mesh,
    )


def installation_variance(
    sensitivity: Sensitivity, std: InstallationStd, candidates: Candidates, still: np.ndarray, moving: np.ndarray
) -> np.ndarray:
    """Mean square change of the readings in a motion by the installation, in time and over installations:

        vⱼ = Σₖ σₖ² mean_t (sₖⱼ·q)² = Σₖ σₖ² sₖⱼ C sₖⱼᵀ,     C = mean_t q qᵀ,   of accelerometers of q̈

    k: position and rotations, to second order, gain, transverse sensitivity and mesh. For strain, σ² of the offset and a third
    of the final variance of the drift are added. Errors common to all gauges, gain and thermal output, are not. Bonded gauges
    have errors of gain, K_t, mesh, offset and drift only. Variances of the arms of a bridge are added. still, moving (r, r): C
    of the coordinates and of their accelerations. Returns (m,) [unit² of the channel].

    """
    grids = candidates.grids
    free, is_accelerometer = ~grids.bonded, grids.quantity == ACCELERATION
    at_end = std.drift**2 + std.warmed[1] ** 2 * candidates.added(np.ones(len(grids)))
    variance = (std.offset**2 + at_end / 3) * (candidates.quantity == STRAIN)
    for name, sigma in std.by_name.items():
        if name == COMMON_GAIN:
            continue
        s = getattr(sensitivity, name)
        square = [np.einsum("mi,ij,mj->m", s, C, s, optimize=True) for C in (still, moving)]
        grid_variance = sigma**2 * np.where(is_accelerometer, square[1], square[0]) * (free if name in COMMON else 1.0)
        variance = variance + candidates.added(grid_variance)
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
    """Strain operator of the gauges as installed, for displacement fields, without offset and drift:

        (1 + g)((ε + K_t ε_t)/(1 − ν₀ K_t) + e),   ε and ε_t along and across each grid at its actual position and direction

    summed over the arms of a bridge; e: error by the mesh.
    position (n, 3) [m]; field (3n, r) [m per unit]; facets of the whole surface; thickness as in `channel_matrix`. Returns rows
    (m, r) [unit of the channel], and which gauges (gauges,), of bridges any arm, a sharp edge has limited in their movement. K_t
    as in `sensitivity_rows`. Raises InfeasibleError if the grid of a gauge crosses a sharp edge."""
    grids = candidates.grids
    skin, limited = surface_of(position, grids, facets), np.zeros(grids.gauges, dtype=bool)
    if installation.place.any() or installation.angle.any():
        grids, limited = misplaced(position, grids, skin, installation.place, np.rad2deg(installation.angle))
    grids = _tilt(grids, installation.tilt)
    points = points_within(position, grids, skin)
    z = np.asarray(field).reshape(3 * len(position), -1)
    rows = np.asarray(matrix_of(position, points, len(grids), thickness) @ z)
    if (k := installation.transverse[:, None]).any():
        aside = replace(points, direction=np.cross(normals_of(position, points), points.direction))
        rows = (rows + k * (matrix_of(position, aside, len(grids), thickness) @ z)) / (1 - CALIBRATION_POISSON * k)
    if installation.mesh.any():
        error = mesh_error_matrix(position, points, len(grids), skin.facets, thickness)
        rows = rows + installation.mesh[:, None] * (error @ z)
    any_limited = candidates.any_grid(limited[grids.gauge])[candidates.first]
    return candidates.read((1 + installation.gain[:, None]) * rows), any_limited


def _tilt(candidates: Candidates, tilt: np.ndarray) -> Candidates:
    if not tilt.any():
        return candidates
    e1, e2 = installation_axes(candidates)
    about = (tilt[:, :1] * e1 + tilt[:, 1:] * e2)[candidates.gauge]
    angle = np.linalg.norm(about, axis=1)
    axis = about / np.where(angle > 0, angle, 1.0)[:, None]
    return replace(candidates, direction=turned(candidates.direction, axis, np.rad2deg(angle)))

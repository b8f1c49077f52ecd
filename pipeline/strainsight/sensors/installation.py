"""Gauges as they are installed: drawn from tolerances, and what they read."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.mesh.facets import Facets
from strainsight.mesh.properties import Thickness
from strainsight.sensors.candidates import ACCELERATION, STRAIN, Candidates
from strainsight.sensors.misplaced import installation_axes, misplaced
from strainsight.sensors.points import surface_of
from strainsight.sensors.rows import matrix_of, points_within
from strainsight.sensors.sensitivity import CALIBRATION_POISSON, COMMON, Sensitivity, normals_of
from strainsight.sensors.surface import turned
from strainsight.sensors.walk import Skin


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

"""Every sensor of a config on the surface of the mesh: strain gauges, bonded gauges, sensors of motion."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from strainsight.config.gauges import BondedBridge, Gauges, NamedGauge
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, InfeasibleError, blame
from strainsight.experiment.layout.gauge_list import GaugeList, gauge_list, sites_of, strain_candidates, zone_of
from strainsight.experiment.recorded import named_regions
from strainsight.experiment.structure.bonded_gauges import AXES, STRAIN_KINDS, USED, BondedPlace, read_bonded
from strainsight.experiment.structure.references import families, without_surface
from strainsight.fem.affine import NO_CHANGE, AffineOperator, Parameter
from strainsight.fem.by_region import interpolated
from strainsight.loads.linearisation import Sensed
from strainsight.mesh.additions import region_ids
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import THICKNESS, Thickness, thickness_of
from strainsight.mesh.thin_faces import lines_without_sides
from strainsight.records.training import Screened, Training
from strainsight.rom.model import ReducedModel, accelerations
from strainsight.sensors.bonded import BondedEntry, StrainGauges, bonded, bridges
from strainsight.sensors.candidates import (
    ACCELERATION,
    DISPLACEMENT,
    STRAIN,
    channels_of_gauges,
    concatenate,
    grouped,
    motion_candidates,
    units_in_words,
)
from strainsight.sensors.strain_operator import fits
from strainsight.sensors.surface import facet_centres
from strainsight.sensors.surface_paths import skin_of
from strainsight.sensors.zones import admissible, inside

FILE = "gauges.fixed_file"
SHOWN = 3
"""Number of coordinates that a warning lists."""
NUMBERS_AT_A_TIME = 2**22
"""Largest number of readings in memory at a time."""


@dataclass(frozen=True)
class OnSurface(StrainGauges):
    """All channels that the config allows, bonded gauges first.

    names: of bonded gauges, empty if unnamed; moved (bonded,) [m]: distance each was moved to the surface; empty: keys of zones
    that contain no facet; lines: line elements without a surface, in words."""

    names: tuple[str, ...] = ()
    moved: np.ndarray = field(default_factory=lambda: np.zeros(0))
    empty: tuple[str, ...] = ()
    lines: str = ""


def candidates_on_surface(
    mesh: Mesh, config: PlacementConfig, files: Mapping[str, Path], basis: np.ndarray, moment: np.ndarray
) -> OnSurface:
    """Candidate sensors of the config on the exterior facets.

    files: `gauges.fixed_file`; basis (3 nodes, n): displacement per reduced coordinate; moment (n, n): mean of q qᵀ in training,
    for principal directions."""
    if not mesh.has_surface:
        raise without_surface(mesh)
    facets, parts, distance = exterior_facets(mesh), [], np.zeros(0)
    fixed = fixed_gauges(config.gauges, files.get("gauges.fixed_file"))
    if fixed:
        with blame("gauges.fixed"):
            bonded_pool, distance = bonded(mesh, facets, fixed, float(config.gauges.snap_tolerance))
        parts.append(bonded_pool)
    strain = _strain_gauges(mesh, facets, config.gauges, basis, moment)
    parts.append(strain.candidates)
    for array, (key, sensors) in enumerate(families(config).items()):
        if isinstance(sensors, Gauges):
            continue
        with blame(key):
            parts.append(
                motion_candidates(
                    mesh,
                    facets,
                    ACCELERATION if sensors.quantity == "acceleration" else DISPLACEMENT,
                    sensors.axes,
                    **sites_of(sensors),
                    every=sensors.every,
                    array=array,
                    key=key,
                )
            )
    names = tuple(entry.name for entry in fixed)
    empty = _empty_zones(mesh, facets, config)
    lines = lines_without_sides(mesh)
    return OnSurface(concatenate(parts), strain.alone, strain.twice, strain.left_out, names, distance, empty, lines)


def _empty_zones(mesh: Mesh, facets: Facets, config: PlacementConfig) -> tuple[str, ...]:
    """Keys of excluded zones that contain no facet, usually because of a wrong unit of length."""
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    empty = []
    for key, sensors in families(config).items():
        for i, entry in enumerate(sensors.exclude):
            with blame(f"{key}.exclude.{i}"):
                if not inside(zone_of(entry), mesh, facets, centre, normal).any():
                    empty.append(f"{key}.exclude.{i}")
    return tuple(empty)


def _strain_gauges(mesh: Mesh, facets: Facets, gauges: Gauges, basis: np.ndarray, moment: np.ndarray) -> StrainGauges:
    """Gauges, rosettes or bridges on the admissible facets."""
    length = gauges.grid_length
    assert gauges.direction is not None  # required by the config unless gauges are imported
    with blame("gauges.surface"):
        pool = strain_candidates(
            mesh, facets, gauges, gauges.direction, basis, lambda rows: moment, "gauges", gauges.rosette, length
        )
        strain = StrainGauges(pool)
        if gauges.bridge is not None:
            keep, _, _ = admissible(mesh, facets, **sites_of(gauges))
            strain = bridges(skin_of(mesh.position, facets), pool, gauges.bridge, keep)
            pool = strain.candidates
            if not len(pool):
                raise InfeasibleError(
                    f"no location for a {gauges.bridge} bridge: none of {strain.alone} candidate locations has an opposite facet "
                    "that allows a gauge in the same direction",
                    key="gauges.bridge",
                    remedy="Include both sides of the wall (gauges.surface, gauges.include, gauges.exclude), choose another "
                    "direction, or remove gauges.bridge.",
                )
    if length == 0:
        return strain
    well = fits(mesh.position, pool, facets)
    if not well.any():
        raise ConfigError(
            f"a measuring grid of {length:g} m length crosses a sharp edge at all {len(pool)} candidate locations",
            key="gauges.grid_length",
            remedy="Reduce gauges.grid_length.",
        )
    fitting = pool.take(np.flatnonzero(well))
    return replace(strain, candidates=fitting, left_out=pool.gauges - fitting.gauges)


def fixed_gauges(gauges: Gauges, file: Path | None) -> list[BondedEntry]:
    """Bonded gauges of the config, then those of the file `gauges.fixed_file`.

    Warns of coordinates in the file that differ from the position. Raises ConfigError for a duplicate name, and for a line of
    the file that is not a strain gauge."""
    entries = [_bonded_entry(gauges, i, entry) for i, entry in enumerate(gauges.fixed)]
    if file is not None:
        with blame(FILE):
            places = read_bonded(file)
            entries += [_entry(gauges, file, name, place) for name, place in places.items()]
        _warn_of_unused(places)
    names = [entry.name for entry in entries]
    for i, entry in enumerate(entries):
        if entry.name and entry.name in names[:i]:
            raise ConfigError(
                f"two bonded gauges have the name {entry.name}",
                key=entry.key.partition(".arms")[0],
                remedy="Rename one of these gauges in gauges.fixed or in the file of gauges.fixed_file.",
            )
    return entries


def _warn_of_unused(places: Mapping[str, BondedPlace]) -> None:
    """Warn of coordinates (x_mm …) that differ from the position, which is used."""
    texts = [
        one.differs_in_words(name, float(place.position[one.grid, one.axis]), f"in position_{AXES[one.axis]}")
        for name, place in places.items()
        for one in place.unused
    ]
    if texts:
        shown = "; ".join(texts[:SHOWN]) + " …" * (len(texts) > SHOWN)
        warnings.warn(
            f"{FILE}: {shown}. Only {USED} are used. Enter the bonded position there, and correct or delete the other columns.",
            stacklevel=2,
        )


def _bonded_entry(gauges: Gauges, i: int, entry: NamedGauge | BondedBridge) -> BondedEntry:
    key, name = f"gauges.fixed.{i}", entry.name or ""
    if isinstance(entry, NamedGauge):
        return BondedEntry(entry.position, entry.direction, _length(gauges, entry.length), entry.angles, name, key)
    arms = [
        (BondedEntry(arm.position, arm.direction, _length(gauges, arm.length), key=f"{key}.arms.{k}"), arm.sign)
        for k, arm in enumerate(entry.arms)
    ]
    return bridge_of(arms, name, name or str(i + 1))


def bridge_of(arms: Sequence[tuple[BondedEntry, int]], name: str, called: str) -> BondedEntry:
    """Bridge of arms with signs; the first arm with sign 1 defines its position; called: name in messages."""
    named = [(replace(arm, name=f"{called}, arm {k + 1}"), sign) for k, (arm, sign) in enumerate(arms)]
    (first, _), *others = sorted(named, key=lambda arm: -arm[1])
    return replace(first, name=name, arms=others)


def _entry(gauges: Gauges, file: Path, name: str, place: BondedPlace) -> BondedEntry:
    if place.kind not in STRAIN_KINDS:
        raise ConfigError(
            f"{name} has the kind '{place.kind}' ({file.name}:{place.line}); the file may contain only strain gauges",
            key=FILE,
            remedy="Remove this line of the file.",
        )
    grids = [
        BondedEntry(position, direction, _length(gauges, length), key=FILE)
        for position, direction, length in zip(
            place.position.tolist(), place.direction.tolist(), place.length, strict=True
        )
    ]
    if place.bridge:
        return bridge_of(list(zip(grids, place.sign.tolist(), strict=True)), name, name)
    return replace(grids[0], angles=place.angles, name=name)


def _length(gauges: Gauges, length: float | None) -> float:
    return float(gauges.grid_length if length is None else length)


@dataclass(frozen=True)
class CandidateChannels:
    """All candidates, one row a channel, channels of one gauge consecutive.

    rows (m, n): strain or displacement per reduced coordinate at the reference parameters; change: what θ adds if a shell
    thickness is estimated; quantity (m,): 0 strain, 1 acceleration, 2 displacement; noise_std (m,): of one sample at the training
    time step [unit of the quantity]; gauge (m,): number of the gauge; bridged (m,): whether it is a bridge of several arms."""

    rows: np.ndarray
    change: AffineOperator
    quantity: np.ndarray
    noise_std: np.ndarray
    gauge: np.ndarray
    bridged: np.ndarray

    def sensed(self, channels: np.ndarray) -> Sensed:
        """Measurement operator of some channels (k,)."""
        return Sensed(self.rows[channels], self.quantity[channels], self.change.of_terms(lambda X: X[channels]))

    @property
    def gauges(self) -> int:
        """Number of gauges."""
        return int(self.gauge[-1]) + 1

    def of(self, gauges: np.ndarray) -> np.ndarray:
        """Channels (..., c) of gauges (...), padded with −1."""
        return channels_of_gauges(self.gauge, gauges)


def of_channels(values: np.ndarray, channels: np.ndarray) -> np.ndarray:
    """Rows (..., n) of values (m, n) at channels (...), zero where the channel is −1."""
    return np.where((channels >= 0)[..., None], values[channels], 0.0)


def training_units(quantity: np.ndarray) -> dict[str, str]:
    """Units of datasets of channels of these quantities (m,)."""
    still = np.where(quantity == STRAIN, STRAIN, DISPLACEMENT)
    unit, row = units_in_words(quantity), f"{grouped(units_in_words(still))}/(kg^1/2 m)"
    return {"the channel": unit, "the variance": f"{grouped(unit)}^2", "the strain operator": row}


def channels_of(training: Training, screened: Screened) -> CandidateChannels:
    """All channels of the training simulation with their noise."""
    pool = training.candidates
    return CandidateChannels(
        training.rows, training.change, pool.quantity, screened.noise_std, pool.gauge, pool.bridged
    )


def listed_gauges(gauges: np.ndarray, training: Training, screened: Screened) -> GaugeList:
    """List of gauges (k,) with their readings in the training simulation."""
    return gauge_list(
        training.candidates, training.name, gauges, screened.family, training.peak, screened.range, training.strained
    )


def reading_sizes(
    model: ReducedModel, rows: np.ndarray, quantity: np.ndarray, x: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """RMS and largest reading (m,) of every channel without noise: row·q for strain and displacement, row·q̈ for acceleration.

    rows (m, n); quantity (m,); x (s, 2n) = [q, q̇]; u (s, n_u) [N] at the same instants. Some channels at a time."""
    q, moving = x[:, : model.size], quantity == ACCELERATION
    acceleration = accelerations(model, model.reference, x, u) if moving.any() else q
    count = max(1, NUMBERS_AT_A_TIME // len(x))
    rms, peak = np.empty((2, len(rows)))
    for first in range(0, len(rows), count):
        part = slice(first, first + count)
        reading, which = q @ rows[part].T, moving[part]
        reading[:, which] = acceleration @ rows[part][which].T
        rms[part], peak[part] = np.sqrt(np.mean(reading**2, axis=0)), np.abs(reading).max(axis=0)
    return rms, peak


def largest_of_quantity(peak: np.ndarray, quantity: np.ndarray) -> np.ndarray:
    """Largest peak (m,) among channels of the same quantity (m,), for every channel."""
    return np.array([peak[quantity == q].max() for q in quantity])


SMALL = 1e-4
"""Relative to the largest entry of all rows: smaller rows are accurate to this, not to their last digits."""


def free_thicknesses(config: PlacementConfig, mesh: Mesh, reference: Mapping[str, float]) -> tuple[Parameter, ...]:
    """Estimated thicknesses at their reference values [m]."""
    thicknesses = {name: entry for name, entry in config.parameters.items() if entry.property == THICKNESS}
    return tuple(
        Parameter(name, THICKNESS, region_ids(mesh, named_regions(entry.region)), reference[name], range=entry.range)
        for name, entry in thicknesses.items()
    )


def thickness_at(mesh: Mesh, free: Sequence[Parameter], theta: Mapping[str, float]) -> Thickness | None:
    """Thickness of the shells at θ [m], None if no thickness is estimated."""
    return thickness_of(mesh, [(parameter.regions, theta[parameter.name]) for parameter in free]) if free else None


def rows_along(
    mesh: Mesh, free: Sequence[Parameter], read: Callable[[Thickness | None], np.ndarray]
) -> tuple[np.ndarray, AffineOperator]:
    """Rows X(θ₀) (m, r) at the reference parameters, and ΔX(θ) = X(θ) − X(θ₀), empty if no thickness is estimated:

        X(θ) = X(θ₀) + Σᵢ (X(θᵢ) − X(θ₀)),     each difference that of `interpolated`, every row over its largest entry

    as a row is a sum over points, each on a shell of one thickness. On shells that are flat around a node the rows are linear in
    the thickness, else rational. read: returns the rows (m, r) for a thickness."""
    reference = {parameter.name: parameter.reference for parameter in free}
    first = read(thickness_at(mesh, free, reference))
    size = np.abs(first).max(axis=1, initial=0.0, keepdims=True)
    size = np.maximum(size, SMALL * size.max(initial=0.0))  # rows of rounding errors only
    change = NO_CHANGE
    for parameter in free:

        def at(theta: Mapping[str, float]) -> np.ndarray:
            return read(thickness_at(mesh, free, {**reference, **theta})) / size

        slope = interpolated(at, [parameter])
        terms = {label: size * X for label, X in slope.terms.items()}
        change = AffineOperator(0.0, {**change.terms, **terms}, {**change.coefficients, **slope.coefficients})
    return first, change

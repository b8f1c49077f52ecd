"""Every sensor of a config on the surface of the mesh: strain gauges, bonded gauges, sensors of motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from strainsight.config.gauges import AxisDirection, BondedBridge, Gauges, NamedGauge
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, InfeasibleError, blame
from strainsight.experiment.layout.zones import zone_of
from strainsight.experiment.structure.bonded_file import STRAIN_KINDS, BondedPlace, read_bonded
from strainsight.experiment.structure.settings import families
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.admissible import admissible
from strainsight.sensors.bonded import BondedEntry, bonded
from strainsight.sensors.bridges import StrainGauges, bridges
from strainsight.sensors.candidates import ACCELERATION, DISPLACEMENT, candidates, concatenate
from strainsight.sensors.motion import motion_candidates
from strainsight.sensors.principal import ROSETTE, principal_angles
from strainsight.sensors.rows import channel_rows, fits
from strainsight.sensors.surface import facet_centres
from strainsight.sensors.walk import skin_of
from strainsight.sensors.zones import inside

FILE = "gauges.fixed_file"


@dataclass(frozen=True)
class OnSurface(StrainGauges):
    """All channels that the config allows, bonded gauges first; names of these, empty where they have none; moved (bonded,) [m]:
    how far each of them was moved to the surface; empty: keys of zones that take no facet."""

    names: tuple[str, ...] = ()
    moved: np.ndarray = field(default_factory=lambda: np.zeros(0))
    empty: tuple[str, ...] = ()


def candidates_on_surface(
    mesh: Mesh, config: PlacementConfig, files: Mapping[str, Path], basis: np.ndarray, moment: np.ndarray
) -> OnSurface:
    """Every sensor of the config on the exterior facets.

    files: that of `gauges.fixed_file`; basis (3 nodes, n) displacement per reduced coordinate; moment (n, n): mean of q qᵀ in
    training, for principal directions.
    """
    if not mesh.has_surface:
        raise ConfigError(
            "the mesh has no solids, shells or sides of beams, and so no surface",
            key="gauges.surface",
            remedy="give beams without pin flags in place of rods, or mesh.matrices and gauges.given: strain rows of the gauges",
        )
    facets, parts, distance = exterior_facets(mesh), [], np.zeros(0)
    fixed = fixed_gauges(config.gauges, files.get("gauges.fixed_file"))
    if fixed:
        with blame("gauges.fixed"):
            there, distance = bonded(mesh, facets, fixed, float(config.gauges.snap_tolerance))
        parts.append(there)
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
                    surface=sensors.surface,
                    include=[zone_of(entry) for entry in sensors.include],
                    exclude=[zone_of(entry) for entry in sensors.exclude],
                    every=sensors.every,
                    array=array,
                    key=key,
                )
            )
    names = tuple(entry.name for entry in fixed)
    empty = _empty_zones(mesh, facets, config)
    return OnSurface(concatenate(parts), strain.alone, strain.twice, strain.left_out, names, distance, empty)


def _empty_zones(mesh: Mesh, facets: Facets, config: PlacementConfig) -> tuple[str, ...]:
    """Keys of excluded zones without a facet in them: a box in millimetres, more often than not."""
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    found = []
    for key, sensors in families(config).items():
        for i, entry in enumerate(sensors.exclude):
            with blame(f"{key}.exclude.{i}"):
                if not inside(zone_of(entry), mesh, facets, centre, normal).any():
                    found.append(f"{key}.exclude.{i}")
    return tuple(found)


def _strain_gauges(mesh: Mesh, facets: Facets, gauges: Gauges, basis: np.ndarray, moment: np.ndarray) -> StrainGauges:
    """Gauges, rosettes or bridges on the facets that the config admits."""
    direction, length = gauges.direction, gauges.grid_length
    assert direction is not None  # the config asks for one where gauges are not given
    include, exclude = ([zone_of(entry) for entry in zones] for zones in (gauges.include, gauges.exclude))
    axis, turn = direction.axis if isinstance(direction, AxisDirection) else None, None
    with blame("gauges.surface"):
        if axis is None:
            base = candidates(
                mesh, facets, None, ROSETTE, exclude, gauges.surface, include=include, rosette=True, length=0.0
            )
            rows = channel_rows(mesh.position, base, basis, facets=facets).reshape(-1, len(ROSETTE), basis.shape[1])
            turn = principal_angles(rows, moment)
        pool = candidates(
            mesh,
            facets,
            axis,
            direction.angles,
            exclude,
            gauges.surface,
            include=include,
            rosette=gauges.rosette,
            length=length,
            turn=turn,
        )
        found = StrainGauges(pool)
        if gauges.bridge is not None:
            keep, _, _ = admissible(mesh, facets, surface=gauges.surface, include=include, exclude=exclude)
            found = _bridged(bridges(skin_of(mesh.position, facets), pool, gauges.bridge, keep), gauges.bridge)
            pool = found.candidates
    if length == 0:
        return found
    well = fits(mesh.position, pool, facets)
    if not well.any():
        raise ConfigError(
            f"a grid of {length:g} m runs over a sharp edge at every one of {len(pool)} places",
            key="gauges.grid_length",
            remedy="a shorter grid",
        )
    kept = pool.take(np.flatnonzero(well))
    return replace(found, candidates=kept, left_out=pool.gauges - kept.gauges)


def _bridged(found: StrainGauges, pattern: str) -> StrainGauges:
    """Raises InfeasibleError where no place has one opposite."""
    if not len(found.candidates):
        raise InfeasibleError(
            f"no place has one opposite for the arms of a {pattern} bridge: behind none of {found.alone} is a facet that takes a "
            "gauge along its direction",
            key="gauges.bridge",
            remedy="include both sides (gauges.surface, gauges.include, gauges.exclude), take another direction, or remove it",
        )
    return found


def fixed_gauges(gauges: Gauges, file: Path | None) -> list[BondedEntry]:
    """All of them, those of the config itself first; file: that of `gauges.fixed_file`.

    Raises ConfigError for a name that is there twice, and for a line of the file that is no strain gauge.
    """
    entries = [_stated(gauges, i, entry) for i, entry in enumerate(gauges.fixed)]
    if file is not None:
        with blame(FILE):
            entries += [_entry(gauges, file, name, place) for name, place in read_bonded(file).items()]
    names = [entry.name for entry in entries]
    for i, entry in enumerate(entries):
        if entry.name and entry.name in names[:i]:
            raise ConfigError(
                f"two bonded gauges are called {entry.name}",
                key=entry.key.partition(".arms")[0],
                remedy="rename one of them",
            )
    return entries


def _stated(gauges: Gauges, i: int, entry: NamedGauge | BondedBridge) -> BondedEntry:
    key, name = f"gauges.fixed.{i}", entry.name or ""
    if isinstance(entry, NamedGauge):
        return BondedEntry(entry.position, entry.direction, _length(gauges, entry.length), entry.angles, name, key)
    arms = [
        (BondedEntry(arm.position, arm.direction, _length(gauges, arm.length), key=f"{key}.arms.{k}"), arm.sign)
        for k, arm in enumerate(entry.arms)
    ]
    return bridge_of(arms, name, name or str(i + 1))


def bridge_of(arms: Sequence[tuple[BondedEntry, int]], name: str, said: str) -> BondedEntry:
    """A bridge of arms with their signs, one of them 1 at least, the first of which becomes its place; said: what messages call
    it."""
    named = [(replace(arm, name=f"{said}, arm {k + 1},"), sign) for k, (arm, sign) in enumerate(arms)]
    (first, _), *others = sorted(named, key=lambda arm: -arm[1])
    return replace(first, name=name, arms=others)


def _entry(gauges: Gauges, file: Path, name: str, place: BondedPlace) -> BondedEntry:
    if place.kind not in STRAIN_KINDS:
        raise ConfigError(
            f"{name} is of the kind '{place.kind}' ({file.name}:{place.line}), and only strain gauges can be bonded beforehand",
            key=FILE,
            remedy="remove its line",
        )
    if place.arms:
        arms = [
            (
                BondedEntry(arm.position.tolist(), arm.direction.tolist(), _length(gauges, arm.length), key=FILE),
                arm.sign,
            )
            for arm in place.arms
        ]
        return bridge_of(arms, name, name)
    return BondedEntry(
        place.position.tolist(), place.direction[0].tolist(), _length(gauges, place.length), place.angles, name, FILE
    )


def _length(gauges: Gauges, stated: float | None) -> float:
    return float(gauges.grid_length if stated is None else stated)

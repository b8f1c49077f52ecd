"""The surface in a test: as a grid in time, with damage, and at the moment of the largest reading."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from strainsight.config.estimate import Estimate
from strainsight.config.loads import Load
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, DeckError
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoothed import Smoothed, Wanted
from strainsight.experiment.structure.filtered_test import Filtering
from strainsight.experiment.structure.nuisances import Tolerated
from strainsight.experiment.structure.settings import parameters_of
from strainsight.experiment.structure.surface import (
    Displaced,
    Skin,
    Virtual,
    damage_on_surface,
    frames_of,
    largest_reading,
    places_of,
    skin_of,
    surface_in_time,
    surface_then,
)
from strainsight.experiment.structure.tolerated_loads import field_beyond
from strainsight.mesh.model import Mesh
from strainsight.mesh.vtkhdf import VtkHdf
from strainsight.records.damage import DamageAt
from strainsight.records.estimated import Moment
from strainsight.records.reduced import Reduced
from strainsight.sensors.candidates import STRAIN


def displaced(reduced: Reduced, tolerances: Tolerated, given: Filtering) -> Displaced:
    """By the coordinates of a filter, and by what misaligned loads add where it is a bank, which has z behind its states."""
    basis, n = reduced.basis, reduced.basis.shape[1]
    if given.problem.method == "bank":
        basis = np.hstack([basis, field_beyond(tolerances.loads, given.model, reduced)])
    return Displaced(basis, n)


def skin_in_test(
    config: PlacementConfig, settings: Estimate, mesh: Mesh, field: Displaced, files: Mapping[str, Path]
) -> tuple[Skin | None, tuple[str, ...]]:
    """The surface, or None where nothing is solid or no stress known, with the reason.

    Raises ConfigError where something of the surface is asked for and the mesh has no solids, DeckError
    where they have no material.
    """
    keys = {"estimate.field": settings.field, "estimate.damage": settings.damage}
    asked = [key for key, stated in keys.items() if stated is not None]
    if not mesh.has_surface:
        if asked:
            raise ConfigError(
                "the mesh has no solids, shells or sides of beams, and so no surface",
                key=asked[0],
                remedy="remove the key",
            )
        return None, ()
    try:
        return skin_of(mesh, field, parameters_of(config.parameters, mesh, files, config.mesh)), ()
    except DeckError as error:
        # A model that came as matrices needs no materials, but for this.
        if asked:
            raise
        return None, (f"no strain and stress of the surface: {error.what}",)


def grid_of(
    settings: Estimate, skin: Skin | None, given: Filtering, smoothed: Smoothed, damage: DamageAt | None
) -> VtkHdf | None:
    """The surface as a grid, with steps where it is asked for in time; None where neither that nor damage is."""
    if skin is None or (settings.field is None and damage is None):
        return None
    if settings.field is not None:
        return surface_in_time(skin, given.model, smoothed, settings.field, damage)
    assert damage is not None
    return damage_on_surface(skin, damage)


def moment_of(skin: Skin, given: Filtering, run: FilterRun, smoothed: Smoothed) -> Moment:
    """The surface when a channel reads most, by the offsets of the filter: the instant whose covariance `wanted_of` has kept."""
    k, channel = largest(given, run.mean[-1, 0])
    then, test = (k + 1) * given.test.every, given.test
    return surface_then(skin, given.model, smoothed, then, float(test.time[k + 1]), test.labels[channel])


def largest(given: Filtering, last: np.ndarray) -> tuple[int, int]:
    """Sample and channel of the largest reading: strains are looked at alone where there are any, else each channel beside its
    noise. last (n,): the states at the end, offsets of channels among them."""
    test, model = given.test, given.model
    offset = np.zeros(len(test.labels))
    offset[given.biased] = last[model.size :]
    kinds = STRAIN if model.quantity is None else np.asarray(model.quantity)
    noise = np.sqrt(model.noise.reshape(-1, len(test.labels)).mean(axis=0))
    scale = np.where(kinds == STRAIN, 1.0, np.inf) if np.any(kinds == STRAIN) else noise
    return largest_reading(test.values, offset, np.broadcast_to(scale, noise.shape))


def wanted_of(
    settings: Estimate, loads: Mapping[str, Load], given: Filtering, virtual: Virtual | None, run: FilterRun
) -> Wanted:
    """Covariances that the results of a test need of the smoother: of virtual gauges, of loads at one place, of the surface in
    its pictures. run: what the filter found."""
    field = np.zeros(0) if settings.field is None else frames_of(settings.field, run.time)
    most = (largest(given, run.mean[-1, 0])[0] + 1) * given.test.every
    together = [at for _, at in places_of(loads, given.problem.unknowns.inputs)]
    return Wanted(
        np.zeros((0, given.smoothed_states)) if virtual is None else virtual.read(given.model, run.mean[:, 0])[1],
        given.model.position[np.unique(np.concatenate([np.zeros(0, int), *together]))],
        np.unique([*field, most]).astype(int),
    )

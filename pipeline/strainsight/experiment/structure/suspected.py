"""The record of a test as a suspect: the bank that judges it, and what its gauges would read turned."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.faults import ANGLES
from strainsight.estimation.model import FilterModel
from strainsight.estimation.suspect import Suspect
from strainsight.experiment.structure.filtered_test import Filtering
from strainsight.experiment.structure.nuisances import nuisances_of, on_average, tolerated
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.thickness import Thickness
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.rows import channel_rows, fits
from strainsight.sensors.surface import turned


@dataclass(frozen=True)
class Turning:
    """What gauges would read turned on the surface.

    rows (m, angles, n): of channels by ANGLES, per reduced coordinate, NaN where a channel cannot be turned; missed
    (m, angles, n_u, misalignments): likewise, of misaligned loads; channels (m,) of train.h5.
    """

    channels: np.ndarray
    rows: np.ndarray
    missed: np.ndarray


def turning_of(
    mesh: Mesh, reduced: Reduced, training: Training, channels: np.ndarray, thickness: Thickness | None = None
) -> Turning:
    """Of channels (m,) of train.h5; only gauges of strain on the mesh can be turned, whose grid then stays on the surface, and no
    bridges, the arms of which would be turned each by itself. thickness: of shells at the guess, where it is free."""
    n, missed = training.rows.shape[1], reduced.misaligned.missed
    rows = np.full((len(channels), len(ANGLES), n), np.nan)
    more = np.zeros((*rows.shape[:2], *missed.shape[1:]))
    pool = training.candidates
    own = np.flatnonzero((pool.quantity == STRAIN)[channels] & ~pool.bridged[channels] & (training.given is None))
    if len(own):
        both = np.hstack([reduced.basis, missed.reshape(len(missed), -1)])
        facets = exterior_facets(mesh)
        for k, angle in enumerate(ANGLES):
            part = _apart(_turned(pool.take(channels[own]), angle))
            well = np.flatnonzero(fits(mesh.position, part, facets))
            read = channel_rows(mesh.position, part.take(well), both, facets=facets, thickness=thickness)
            rows[own[well], k], more[own[well], k] = read[:, :n], read[:, n:].reshape(-1, *missed.shape[1:])
    return Turning(channels, rows, more)


def suspect_of(
    config: PlacementConfig,
    mesh: Mesh,
    reduced: Reduced,
    training: Training,
    given: Filtering,
    turning: Turning,
) -> Suspect:
    """By the bank, whatever filter estimates: no other takes the tolerances in."""
    model, test = given.model, given.test
    channels = test.channels
    Q, at = np.array(model.Q), model.parameter_states
    Q[..., at, :], Q[..., :, at] = 0.0, 0.0
    constant = replace(model, Q=Q)
    wide = np.full((*turning.rows.shape[:2], model.size), 0.0)
    wide[..., : turning.rows.shape[-1]] = turning.rows
    moving, motion = np.array(given.covariance), given.model.motion
    moving[motion, motion] = np.diag(np.abs(given.problem.x).max(axis=0) ** 2)

    def with_turned(j: int, angle: float) -> tuple[FilterModel, Nuisances]:
        k, channel = ANGLES.index(angle), channels[j]
        H = np.array(constant.H)
        H[j] = wide[j, k]
        # rows of the guess: how they change with a thickness is known of the channel as it was meant
        change = constant.change.of_terms(lambda X: np.where((np.arange(len(X)) == j)[:, None], 0.0, X))
        one = np.zeros(len(training.candidates))
        one[channel] = angle
        rows, missed = np.array(training.rows), np.array(training.missed)
        rows[channel], missed[channel] = turning.rows[j, k], turning.missed[j, k]
        as_turned = replace(training, candidates=_turned(training.candidates, one), rows=rows, missed=missed)
        own = tolerated(config, mesh, reduced, as_turned, channels)
        # the others have what they read on average over their installations already
        H[j] = on_average(own, replace(constant, H=H), channels).H[j]
        changed = replace(constant, H=H, change=change)
        return changed, nuisances_of(own, changed, channels)

    return Suspect(
        model=constant,
        mean=np.zeros(len(given.covariance)),
        covariance=given.covariance,
        known=test.known,
        samples=test.values,
        nuisances=nuisances_of(given.tolerances, constant, channels),
        biased=given.biased,
        settled=given.settled,
        turned_rows=wide,
        turned=with_turned,
        load=np.tile(np.arange(len(given.problem.known)), 2)[: test.known.shape[-1]],
        moving=moving,
    )


def _turned(pool: Candidates, angle: float | np.ndarray) -> Candidates:
    each = np.broadcast_to(np.asarray(angle, dtype=float), (len(pool),))
    return replace(pool, direction=turned(pool.direction, pool.normal, each))


def _apart(pool: Candidates) -> Candidates:
    """Every channel a gauge of its own."""
    return replace(pool, gauge=np.arange(len(pool)))

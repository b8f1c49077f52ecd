"""Errors of installation as a white noise of the readings, for a pool and a placement that avoid where they cost much."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.errors import blame
from strainsight.experiment.structure.drawn import installation_std
from strainsight.experiment.structure.load_cases import Run, run_as_stated, runs_of
from strainsight.experiment.structure.start import motion_of
from strainsight.experiment.structure.thick_rows import thickness_of_guess
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced
from strainsight.records.training import CaseMotion, Training, with_missed
from strainsight.rom.model import ReducedModel, accelerations
from strainsight.sensors.installation import installation_variance
from strainsight.sensors.points import surface_of
from strainsight.sensors.sensitivity import Sensitivity, given_sensitivity, sensitivity_rows

COHERENCE = 0.01
"""Over the length of the training run: how long errors of installation are correlated in the white noise that stands for them. A
constant error weighs as white noise of its variance over all that is averaged: the record for a parameter, less for a load. Where
such errors are larger than the noise of a gauge, its size hardly changes the layout."""
AT_A_TIME = 4000
"""Gauges whose sensitivities are held in memory."""


def avoids_errors(config: PlacementConfig) -> bool:
    """Whether the pool and the layout are to avoid errors of installation."""
    return config.place.installation == "avoid" and config.process_noise.rule != "as_printed"


def installation_variances(
    config: PlacementConfig,
    files: Mapping[str, Path],
    mesh: Mesh,
    reduced: Reduced,
    training: Training,
    gauges: np.ndarray,
) -> np.ndarray:
    """Mean square of what errors of installation add to the readings of the training motions at the guess:

        v_j of `installation_variance`,     C = mean_t q qᵀ + Σₖ mean_t qₖ qₖᵀ

    qₖ is the motion that one σ of an error of a load's direction or point adds: a misplaced gauge reads the strain there
    of what really moves. What that is beyond the coordinates stands behind them, in proportion to the load.
    An error of installation is constant, and its share of a reading moves with the motion: a white noise of the variance v
    that is correlated over τ has the intensity τ v. Correlation between the channels of a gauge is left out.
    gauges: those that are wanted, ascending. Returns (cases, m) [unit²] for all channels of the training run in every load case
    by name, (1, m) where there are none; zero for those that are not wanted.
    """
    pool, std, inputs = training.candidates, installation_std(config), reduced.model.inputs
    runs = runs_of(config, inputs, files) or (run_as_stated(config, inputs, files),)
    moments = [_moments(config, reduced, training.motion_in(run.name), run) for run in runs]
    v = np.zeros((len(runs), len(pool)))
    for own, slopes in _sensitivities(config, mesh, reduced, training, gauges):
        part = pool.take(own)
        v[:, own] = [installation_variance(slopes, std, part, still, moving) for still, moving in moments]
    return v


def _sensitivities(
    config: PlacementConfig, mesh: Mesh, reduced: Reduced, training: Training, gauges: np.ndarray
) -> Iterator[tuple[np.ndarray, Sensitivity]]:
    """Channels and their derivatives, of so many gauges at a time."""
    pool = training.candidates
    if training.given is not None:
        own = pool.channels(gauges)
        yield own, given_sensitivity(with_missed(training.rows[own], training.missed[own]))
        return
    field, std = with_missed(reduced.basis, reduced.misaligned.missed), installation_std(config).position
    skin = surface_of(mesh.position, pool, exterior_facets(mesh))
    thickness = thickness_of_guess(config, mesh, reduced.model.reference)
    for few in np.array_split(gauges, len(gauges) // AT_A_TIME + 1):
        own = pool.channels(few)
        yield own, sensitivity_rows(mesh.position, pool.take(own), field, std, facets=skin, thickness=thickness)


def _moments(
    config: PlacementConfig, reduced: Reduced, own: Training | CaseMotion, run: Run
) -> tuple[np.ndarray, np.ndarray]:
    """C of [q, what is beyond], and of the second rates, which nothing beyond has."""
    n = reduced.model.size
    motions = list(_motions(config, reduced, own, run))
    load = own.load[: len(motions[0][1])]
    z = np.vstack([np.hstack([x[:, :n], missed.reshape(len(x), -1)]) for _, x, missed in motions])
    a = np.vstack([accelerations(model, model.reference, x, load) for model, x, _ in motions])
    return z.T @ z / len(load), np.pad(a.T @ a / len(load), (0, z.shape[1] - n))


def _motions(
    config: PlacementConfig, reduced: Reduced, own: Training | CaseMotion, run: Run
) -> Iterator[tuple[ReducedModel, np.ndarray, np.ndarray]]:
    """The training run, and what one σ of every misalignment adds to it: model, x (T + 1, 2n), and what it is beyond
    (T + 1, n_u, misalignments) [N rad or N m]."""
    own_std, off = tolerances_of(config.tolerances), reduced.misaligned
    std = np.repeat([np.deg2rad(own_std.load_angle), own_std.load_position], 2)
    nothing = np.zeros((len(own.load), *off.missed.shape[1:]))
    yield reduced.model, np.hstack([own.coordinate, own.velocity]), nothing
    with blame(run.key):
        loading = run.loading()
    for i, way in np.argwhere((off.shape.any(axis=0) | off.missed.any(axis=0)) & (std > 0)):
        shape, missed = np.zeros_like(reduced.model.input_shape), nothing.copy()
        shape[:, i], missed[:, i, way] = std[way] * off.shape[:, i, way], std[way] * own.load[:, i]
        model = reduced.model.acted_on(shape)
        yield model, motion_of(model, model.reference, loading), missed

"""Errors of installation as a white noise of the readings, for a placement that is to avoid where they cost much."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from strainsight.cases.structure.channels import accelerations
from strainsight.cases.structure.drawn import installation_std
from strainsight.cases.structure.problem import Problem
from strainsight.cases.structure.start import motion_of
from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.gauges.installation import installation_variance
from strainsight.gauges.sensitivity import given_sensitivity, sensitivity_rows
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training, with_missed
from strainsight.rom.model import ReducedModel
from strainsight.signals.histories import instant_values


def installation_intensity(
    config: PlacementConfig,
    mesh: Mesh,
    reduced: Reduced,
    training: Training,
    problem: Problem,
    channels: np.ndarray,
    coherence: float,
) -> np.ndarray:
    """Intensity of the white noise that stands for the installation of gauges in the training motion at the guess:

        r_j = τ v_j,     v_j of `installation_variance`,     C = mean_t q qᵀ + Σₖ mean_t qₖ qₖᵀ

    qₖ is the motion that one σ of an error of a load's direction or point adds: a misplaced gauge reads the strain there
    of what really moves. What that is beyond the coordinates stands behind them, in proportion to the load.
    An error of installation is constant, and its share of a reading moves with the motion: a white noise of the variance v
    that is correlated over τ has the intensity τ v. Correlation between the channels of a gauge is left out.
    channels: rows of train.h5 that are wanted, −1 for none; coherence τ [s]. Returns (m,) [unit² s] for all channels of the
    training run, zero for those that are not wanted.
    """
    pool, std = training.candidates, installation_std(config)
    wanted = np.unique(pool.gauge[channels[channels >= 0]])
    own = pool.channels(wanted)
    part = pool.take(own)
    if training.given is None:
        field, facets = with_missed(reduced.basis, reduced.misaligned.missed), exterior_facets(mesh)
        slopes = sensitivity_rows(mesh.position, part, field, std.position, facets=facets)
    else:
        slopes = given_sensitivity(with_missed(training.rows[own], training.missed[own]))
    still, moving = _moments(config, reduced, problem)
    r = np.zeros(len(pool))
    r[own] = coherence * installation_variance(slopes, std, part, still, moving)
    return r


def _moments(config: PlacementConfig, reduced: Reduced, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """C of [q, what is beyond], and of the second rates, which nothing beyond has."""
    load, n = instant_values(problem.u), problem.model.size
    motions = list(_motions(config, reduced, problem, load))
    z = np.vstack([np.hstack([x[:, :n], missed.reshape(len(x), -1)]) for _, x, missed in motions])
    a = np.vstack([accelerations(own, own.reference, x, load) for own, x, _ in motions])
    return z.T @ z / len(load), np.pad(a.T @ a / len(load), (0, z.shape[1] - n))


def _motions(
    config: PlacementConfig, reduced: Reduced, problem: Problem, load: np.ndarray
) -> Iterator[tuple[ReducedModel, np.ndarray, np.ndarray]]:
    """The training run, and what one σ of every misalignment adds to it: model, x (T + 1, 2n), and what it is beyond
    (T + 1, n_u, misalignments) [N rad or N m]."""
    own, off = tolerances_of(config.tolerances), reduced.misaligned
    std = np.repeat([np.deg2rad(own.load_angle), own.load_position], 2)
    nothing = np.zeros((len(load), *off.missed.shape[1:]))
    yield problem.model, problem.x, nothing
    for i, way in np.argwhere((off.shape.any(axis=0) | off.missed.any(axis=0)) & (std > 0)):
        shape, missed = np.zeros_like(problem.model.input_shape), nothing.copy()
        shape[:, i], missed[:, i, way] = std[way] * off.shape[:, i, way], std[way] * load[:, i]
        model = replace(problem.model, input_shape=shape)
        yield model, motion_of(model, model.reference, problem.loading), missed

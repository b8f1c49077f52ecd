"""Errors of installation as a white noise of the readings, for a placement that is to avoid where they cost much."""

from __future__ import annotations

import numpy as np

from strainsight.cases.structure.channels import accelerations
from strainsight.cases.structure.drawn import installation_std
from strainsight.cases.structure.problem import Problem
from strainsight.config.placement import PlacementConfig
from strainsight.gauges.installation import installation_variance
from strainsight.gauges.sensitivity import given_sensitivity, sensitivity_rows
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
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

        r_j = τ v_j,     v_j of `installation_variance`

    An error of installation is constant, and its share of a reading moves with the motion: a white noise of the variance v
    that is correlated over τ has the intensity τ v. Correlation between the channels of a gauge is left out.
    channels: rows of train.h5 that are wanted, −1 for none; coherence τ [s]. Returns (m,) [unit² s] for all channels of the
    training run, zero for those that are not wanted.
    """
    pool, std, n = training.candidates, installation_std(config), problem.model.size
    wanted = np.unique(pool.gauge[channels[channels >= 0]])
    own = pool.channels(wanted)
    part = pool.take(own)
    if training.given is None:
        facets = exterior_facets(mesh)
        slopes = sensitivity_rows(mesh.position, part, reduced.basis, std.position, facets=facets)
    else:
        slopes = given_sensitivity(training.rows[own])
    a = accelerations(problem.model, problem.model.reference, problem.x, instant_values(problem.u))
    still, moving = (np.einsum("ti,tj->ij", z, z) / len(z) for z in (problem.x[:, :n], a))
    r = np.zeros(len(pool))
    r[own] = coherence * installation_variance(slopes, std, part, still, moving)
    return r

"""The scenarios of a placement: instants of the training motion, at one or several parameter values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.config.placement import Place
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.start import motion_of
from strainsight.loads.histories import instant_values
from strainsight.loads.linearisation import linearisation_instants, linearise
from strainsight.loads.noise import Rule, channel_intensity
from strainsight.placement.scenario import Scenario


def scenarios_of(
    problem: Problem,
    channels: np.ndarray,
    settings: Place,
    ranges: Mapping[str, Sequence[float]],
    seed: int,
    installation: np.ndarray | None = None,
) -> tuple[Scenario, ...]:
    """One fixed linearisation an instant and parameter sample, without a metric yet.

    channels (pool, c): rows of train.h5 of every pool row, −1 for none; settings: `place` of a config; ranges: parameter →
    (lowest, highest) [SI]; installation (m,) [unit² s]: intensity that is added to the noise of every channel of train.h5
    (`installation_variances`).
    """
    p = problem
    u = instant_values(p.u)
    plain: list[Scenario] = []
    for theta in parameter_samples(p.model.reference, ranges, settings.parameter_samples, seed):
        x = p.x if theta == p.model.reference else motion_of(p.model, theta, p.loading)
        chosen = placed_instants(p, theta, x, settings, seed)
        F = linearise(p.model, p.unknowns, theta, x[chosen], u[chosen], settings.damping_slope)
        for own, H, r in zip(F, *_measured(p, channels, theta, x[chosen], u[chosen], F, installation), strict=True):
            plain.append(Scenario(own, p.frozen_Q, H, r, np.zeros(len(own))))
    return tuple(plain)


def placed_instants(
    problem: Problem, theta: Mapping[str, float], x: np.ndarray, settings: Place, seed: int
) -> np.ndarray:
    """Indices of the instants to place for, in the motion x (steps + 1, 2n) at θ [SI]."""
    # One instant is the thesis's case: any of them, also where a parameter hardly acts.
    share = 0.0 if settings.instants == 1 else 0.5
    u = instant_values(problem.u)
    return linearisation_instants(problem.model, problem.unknowns, theta, x, u, settings.instants, seed, share)


def parameter_samples(
    reference: Mapping[str, float], ranges: Mapping[str, Sequence[float]], count: int, seed: int
) -> list[dict[str, float]]:
    """The guess, then count − 1 points of the box of ranges, evenly by a scrambled Halton sequence; name → value [SI]."""
    names = sorted(reference)
    if count == 1 or not names:
        return [dict(reference)]
    from scipy.stats import qmc  # a quarter of a second to import, which most runs need not spend

    low, high = (np.array([float(ranges[name][end]) for name in names]) for end in (0, 1))
    points = low + (high - low) * qmc.Halton(len(names), seed=seed).random(count - 1)
    return [dict(reference), *({n: float(v) for n, v in zip(names, row, strict=True)} for row in points)]


def _measured(
    problem: Problem,
    channels: np.ndarray,
    theta: Mapping[str, float],
    x: np.ndarray,
    u: np.ndarray,
    F: np.ndarray,
    installation: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """H* (s, pool, c, n*) and r (s, pool, c), or without c where every pool row has one channel, at s instants."""
    own, there = problem.channels, channels >= 0
    used = np.unique(channels[there])
    sensed = own.sensed(used)
    rule: Rule = "as_printed" if problem.printed else "intensity"
    H = sensed.linearised(problem.model, problem.unknowns, theta, x, u, F)
    r = channel_intensity(own.noise_std[used], problem.h, sensed.rows, sensed.quantity, problem.frozen_Q, rule)
    r = r if installation is None else r + installation[used]
    at = np.searchsorted(used, channels)
    at[~there] = 0
    blocks, intensity = np.where(there[..., None], H[:, at], 0.0), np.broadcast_to(r[at], (len(F), *at.shape))
    return (blocks[:, :, 0], intensity[:, :, 0]) if channels.shape[1] == 1 else (blocks, intensity)

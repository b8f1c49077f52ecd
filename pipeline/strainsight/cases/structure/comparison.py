"""The layout beside those by other rules, all scored by the same covariances."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.augmentation.linearisation import linearise
from strainsight.augmentation.measurement import measurement_rows
from strainsight.cases.structure.problem import Problem
from strainsight.errors import InfeasibleError, NumericalError
from strainsight.placement.baselines import d_optimal, effective_independence, qr_pivoting, random_sets
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.metric import Metric
from strainsight.placement.scenario import Aggregate, Pool
from strainsight.placement.score import Scores, scores
from strainsight.signals.histories import instant_values

RANDOM_SETS = 10
"""Random sets of the pool, scored beside the other rules."""
CRITERION_SCENARIOS = 3
"""Scenarios that layouts by other criteria are made with; all of them score every layout."""


@dataclass(frozen=True)
class Comparison:
    """rule → the set of pool rows that it chooses, none where it finds none, and its scores; ours first, and in the scores the
    criterion that it was chosen by."""

    sets: dict[str, np.ndarray]
    scores: dict[str, Scores]


def comparison(
    problem: Problem,
    pools: Sequence[Pool],
    metrics: Mapping[str, Metric],
    criterion: str,
    channels: np.ndarray,
    final: np.ndarray,
    greedy: np.ndarray,
    aggregate: Aggregate,
    fixed: frozenset[int],
    allowed: Callable[[np.ndarray], bool],
    seed: int,
) -> Comparison:
    """Sets of as many pool rows as the layout `final`: by other criteria, by rules that look at strains only, at random.

    metrics: every criterion by its name, `criterion` that of the layout; channels (pool, c): rows of train.h5, −1 for none;
    fixed: pool rows that stay; allowed: whether a set keeps the limits of the layout, which only the random sets are held to.
    """
    keep, unknown = len(final), problem.unknowns.position(problem.model)
    rows, variance = _rows(problem, channels)
    prior = np.cov(problem.x[:, : problem.model.size], rowvar=False)
    some = [pools[i] for i in np.unique(np.linspace(0, len(pools) - 1, CRITERION_SCENARIOS).astype(int))]
    sets: dict[str, np.ndarray | None] = {
        "final": final,
        "greedy": greedy,
        **{name: _kept(some, metric, keep, fixed) for name, metric in metrics.items() if name != criterion},
        "effective_independence": effective_independence(rows / np.sqrt(variance)[..., None], keep),
        "qr_pivoting": qr_pivoting(rows / np.sqrt(variance)[..., None], keep),
        "d_optimal": d_optimal(rows, variance, prior, keep),
    }
    drawn = random_sets(len(channels), keep, RANDOM_SETS, seed, allowed)
    sets |= {f"random_{i}": gauges for i, gauges in enumerate(drawn, start=1)}
    scale, ordered = problem.unknowns.scale, {criterion: metrics[criterion]} | dict(metrics)
    chosen = {name: np.zeros(0, dtype=int) if gauges is None else gauges for name, gauges in sets.items()}
    found = {
        name: Scores.all(metrics, np.nan, len(unknown))
        if gauges is None
        else scores(pools, gauges, ordered, unknown, scale, aggregate)
        for name, gauges in sets.items()
    }
    return Comparison(chosen, found)


def _kept(pools: Sequence[Pool], metric: Metric, keep: int, fixed: frozenset[int]) -> np.ndarray | None:
    """What an elimination by this metric keeps; None where it cannot go so far."""
    try:
        return eliminate_from([pool.under(metric) for pool in pools], keep, fixed=fixed).kept
    except (InfeasibleError, NumericalError):
        return None


def _rows(problem: Problem, channels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings per reduced coordinate (pool, c, n), of accelerometers at the guess, and noise variance (pool, c)."""
    p, there = problem, channels >= 0
    F = linearise(p.model, p.unknowns, p.model.reference, p.x[:1], instant_values(p.u)[:1])[0]
    every = measurement_rows(p.channels.rows, p.channels.quantity, F)[:, : p.model.size]
    return np.where(there[..., None], every[channels], 0.0), p.channels.noise_std[channels] ** 2

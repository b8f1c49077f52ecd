"""What gauges of a body mean for the bench: scenarios that rank them, and what a filter on them comes to claim."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.bench.layout.linear import expected_std, factors_along, scenario_of
from strainsight.errors import InfeasibleError, NumericalError
from strainsight.multibody.inverse.linear import LinearBench
from strainsight.placement.metric import Metric
from strainsight.placement.scenario import Aggregate, Scenario, solve_pool

UNTOLD = 0.9
"""Share of σ of its guess above which the gauges tell next to nothing of a parameter."""


@dataclass(frozen=True)
class Known:
    """What parameters add: start (unknowns, unknowns) factor of the covariance of loads and ξ when the run begins; drawn
    (unknowns,): σ of their changes in a step; slopes (p, p) ∂θ/∂ξ; steps (poses,): how long the run stays in each."""

    start: np.ndarray
    drawn: np.ndarray
    slopes: np.ndarray
    steps: tuple[int, ...]


@dataclass(frozen=True)
class Strained:
    """benches, linear in every pose; readings: of every pose (m, n*) what candidates read of (η, η̇, unknowns); noise (m,) σ of a
    sample; white (poses, m): its variance by the white force, as of `scenario_of`; acceleration [m/s²] of that of the filter;
    aggregate of the metric over poses; off (poses, m): σ of a constant error of each, noise of a sample to a ranking, and to σ
    of loads alone what it leaves of them; known: None where loads alone are unknown."""

    benches: tuple[LinearBench, ...]
    readings: tuple[np.ndarray, ...]
    noise: np.ndarray
    white: np.ndarray
    acceleration: float
    aggregate: Aggregate
    off: np.ndarray
    known: Known | None = None

    @property
    def scale(self) -> np.ndarray:
        """One of each unknown of the state in its unit (unknowns,): 1 of a load, ∂θ/∂ξ of a parameter."""
        scale = np.ones(len(self.benches[0].increment))
        if self.known is not None:
            scale[len(scale) - len(self.known.slopes) :] = np.abs(np.diag(self.known.slopes))
        return scale

    def in_poses(self, gauges: np.ndarray) -> np.ndarray:
        """σ (poses, unknowns) [N, N m, Pa, m] that a filter on these gauges comes to claim: of loads alone, inf where one is
        lost; beside parameters at the end of each pose of the run."""
        rows, noise, known = [own[gauges] for own in self.readings], self.noise[gauges], self.known
        if known is None:
            triples = zip(self.benches, rows, self.off[:, gauges], strict=True)
            return np.array([expected_std(bench, H, noise, self.acceleration, off) for bench, H, off in triples])
        factors = factors_along(self.benches, rows, noise, self.acceleration, known.drawn, known.start, known.steps)
        loads = len(known.drawn) - len(known.slopes)
        own = [np.vstack([L[:loads], known.slopes @ L[loads:]]) for L in factors]
        return np.array([np.linalg.norm(L, axis=1) for L in own])

    def summed_up(self, std: np.ndarray) -> np.ndarray:
        """Of σ in every pose (poses, unknowns) the largest of each load, and the last of each parameter."""
        worst = std.max(axis=0)
        if self.known is not None:
            loads = len(worst) - len(self.known.slopes)
            worst[loads:] = std[-1, loads:]
        return np.asarray(worst)

    def untold(self, std: np.ndarray) -> np.ndarray:
        """Numbers, from the first parameter on, of those whose σ (unknowns,) is hardly below that of the guess."""
        if self.known is None:
            return np.zeros(0, dtype=int)
        loads = len(std) - len(self.known.slopes)
        guess = np.linalg.norm(self.known.slopes @ self.known.start[loads:], axis=1)
        return np.flatnonzero(std[loads:] > UNTOLD * guess)

    def claimed(self, gauges: np.ndarray) -> np.ndarray:
        """That of all poses (unknowns,), NaN where it is not solved."""
        try:
            return self.summed_up(self.in_poses(gauges))
        except NumericalError:
            return np.full(len(self.benches[0].increment), np.nan)

    def without_each(self, gauges: np.ndarray) -> np.ndarray:
        """The same without each of them (k, unknowns)."""
        return np.array([self.claimed(np.delete(gauges, i)) for i in range(len(gauges))])

    def scenarios(self, gauges: np.ndarray) -> list[Scenario]:
        """Every pose with these gauges as a pool."""
        return [
            scenario_of(bench, own[gauges], np.hypot(self.noise, off)[gauges], self.acceleration, white[gauges])
            for bench, own, white, off in zip(self.benches, self.readings, self.white, self.off, strict=True)
        ]

    def metric(self, gauges: np.ndarray, metric: Metric) -> float:
        """The metric with these gauges; inf where an unknown is lost, NaN where the equation is not solved to accuracy."""
        found = []
        for own in self.scenarios(gauges):
            try:
                solved = solve_pool(replace(own, weight=metric.weight, criterion=metric.criterion))
            except InfeasibleError:
                return float("inf")
            except NumericalError:
                return float("nan")
            found.append(solved.metric.value(solved.P))
        return float(np.mean(found) if self.aggregate == "mean" else np.max(found))

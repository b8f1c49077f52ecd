"""Channels of a bench that read too much: offsets that are estimated beside everything else, and those that a truth draws."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.estimation.model import StepModel
from strainsight.estimation.reduced import Biased, bordered
from strainsight.experiment.bench.inverse.unknowns import asked
from strainsight.experiment.bench.sensors import Sensors
from strainsight.multibody.inverse.model import AugmentedStep

DRAWN = 4
"""Last word of the seed by which a seed's offsets are drawn."""


@dataclass(frozen=True)
class Offsets:
    """at (k,): channels that have an offset; std (k,): σ of it at the start, walk (k,): of its change in a step [unit of
    each]."""

    at: np.ndarray
    std: np.ndarray
    walk: np.ndarray

    def model(self, base: AugmentedStep) -> StepModel:
        """Of [x, b]."""
        return Biased(base, self.at, self.walk**2) if len(self.at) else base

    def start(self, x: np.ndarray) -> np.ndarray:
        """x (…, size) with offsets of zero behind."""
        return np.concatenate([x, np.zeros((*x.shape[:-1], len(self.at)))], axis=-1)

    def covariance(self, P: np.ndarray) -> np.ndarray:
        """P (…, size, size) with that of the offsets."""
        return bordered(P, np.diag(self.std**2)) if len(self.at) else P

    def projected(self, base: AugmentedStep) -> Callable[[np.ndarray, int], np.ndarray]:
        """That of the state, with offsets as they are."""

        def project(x: np.ndarray, k: int) -> np.ndarray:
            return np.concatenate([base.projected(x[:, : base.size], k), x[:, base.size :]], axis=1)

        return project

    def drawn(self, steps: int, runs: int, channels: int, seed: int) -> np.ndarray:
        """What every channel reads too much (steps, runs, channels), anew for every run."""
        found = np.zeros((steps, runs, channels))
        for run in range(runs if len(self.at) else 0):
            draw = np.random.default_rng((seed, run, DRAWN))
            first = self.std * draw.standard_normal(len(self.at))
            found[:, run, self.at] = first + np.cumsum(self.walk * draw.standard_normal((steps, len(self.at))), axis=0)
        return found


def offsets_of(config: BenchConfig, used: Sensors, h: float) -> Offsets:
    """As `estimate.sensors` states them, h [s] the filter's step."""
    std, rate = np.zeros((2, len(used.zeroed)))
    for name, own in used.channels.items():
        entry = asked(config).sensors[name]
        std[own], rate[own] = np.asarray(entry.bias, dtype=float), np.asarray(entry.drift, dtype=float)
    at = np.flatnonzero((std > 0) | (rate > 0))
    return Offsets(at, std[at], rate[at] * np.sqrt(h))

"""Advice to use slower loads where natural frequencies or damping limit the σ of a parameter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from strainsight.experiment.layout.advice import Expectation
from strainsight.experiment.structure.considered import Tolerated
from strainsight.experiment.structure.expectation import expectation
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.start import motion_of
from strainsight.loads.histories import instant_values
from strainsight.rom.model import accelerations, modal_basis

DYNAMIC = {"frequency": "frequency", "mass": "load_mass", "damping": "damping"}
"""Sources of variance that a static response does not have → key of `tolerances`."""
LIMITING = 0.5
"""Share of the variance from which they limit σ."""
NAMED = 0.05
"""Smallest share of a source that is named."""
SLOW = 20.0
"""Frequency of the first mode over that of a slow load, whose dynamic amplification is 1/(1 − 1/400)."""
SLOWEST = 1e4
"""Largest factor by which a load is slowed; modes of free structures would need more."""
BETTER = 0.8
"""Largest ratio of σ under the slow load to σ under the configured load that is advised."""


def slow_load_advice(
    problem: Problem, tolerances: Tolerated, gauges: np.ndarray, expected: Expectation
) -> Iterator[str]:
    """Sentences on parameters that a slow load would determine better than the configured known loads.

    problem: under the configured loads; gauges (k,): numbers; expected: σ and budget of these gauges."""
    share = {
        name: [expected.budget[name].get(source, 0.0) for source in DYNAMIC] for name in problem.unknowns.parameters
    }
    limited = [name for name, parts in share.items() if sum(parts) > LIMITING]
    factor = slowness(problem)
    if problem.unknowns.inputs or not limited or not 1 < factor < SLOWEST:
        return
    slow = expectation(slowed(problem, factor), gauges, tolerances, failures=False)
    for name in limited:
        if slow.std[name] > BETTER * expected.std[name]:
            continue
        parts = [
            f"tolerances.{key} ({100 * s:.0f} % of its variance)"
            for key, s in zip(DYNAMIC.values(), share[name], strict=True)
        ]
        limits = " and ".join(part for part, s in zip(parts, share[name], strict=True) if s >= NAMED)
        yield (
            f"A static or slow load would determine {name} without the natural frequencies: its σ is limited by {limits}. With "
            f"the same load {factor:.2g} times slower, the expected σ({name}) would be {100 * slow.std[name]:.2g} % instead of "
            f"{100 * expected.std[name]:.2g} %."
        )


def slowness(problem: Problem) -> float:
    """Factor on time that makes all loads slow: SLOW rms u̇ / (ω₁ rms u) of the fastest load; 0 without loads."""
    u = instant_values(problem.u)
    size = np.sqrt(np.mean(u**2, axis=0))
    rate = np.sqrt(np.mean(np.diff(u, axis=0) ** 2, axis=0)) / problem.h
    lam, _ = modal_basis(problem.model, problem.model.reference)
    if not lam[0] > 0 or not (size > 0).any():
        return 0.0
    return float(SLOW * np.max(rate[size > 0] / size[size > 0]) / np.sqrt(lam[0]))


def slowed(problem: Problem, factor: float) -> Problem:
    """The problem with loads `factor` times slower, and as many samples of the same noise."""
    loading, model, n = problem.loading, problem.model, problem.model.size
    tones = None if loading.tones is None else replace(loading.tones, frequency=loading.tones.frequency / factor)
    slow = replace(loading, h=factor * loading.h, tones=tones)
    x, Q = motion_of(model, model.reference, slow), problem.Q.copy()
    u = problem.u[:, 0]
    after, before = (
        np.mean(accelerations(model, model.reference, z[: len(u)], u) ** 2, axis=0) for z in (x, problem.x)
    )
    moving = np.arange(n, 2 * n)
    Q[moving, moving] *= np.divide(after, before, out=np.ones(n), where=before > 0)
    return replace(problem, x=x, loading=slow, Q=Q)

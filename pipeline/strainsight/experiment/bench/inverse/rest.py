"""What the bench at rest says before a filter runs: zeros of gauges, loads that explain a reading, what moves it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import NumericalError, UserError, blame
from strainsight.experiment.bench.bench import Bench, start_of
from strainsight.experiment.bench.inverse.unknowns import Unknowns, asked
from strainsight.experiment.bench.sensors import Sensors
from strainsight.multibody.accelerations import at_rest
from strainsight.multibody.inverse.parameters import Zero, static_response, zero_at_rest
from strainsight.multibody.sensors import CompiledSensors

FITS, SETTLED = 20, 1e-9
"""Gauss-Newton steps to loads at rest, and the share of their σ below which they are found."""
HALVINGS = 12
"""How often a step of them is halved that explains less, or that no rest carries."""


def zero_of(
    config: BenchConfig, bench: Bench, sensors: Sensors, unknowns: Unknowns, theta: np.ndarray, zeroing: np.ndarray
) -> np.ndarray:
    """What zeroed channels read when they were zeroed (channels,), by a bench with these parameters; 0 for the others."""
    if not sensors.zeroed.any():
        return np.zeros(len(sensors.zeroed))
    with blame("estimate"):
        q, v = start_of(replace(bench, theta=theta), config.simulate, zeroing)
    return np.where(sensors.zeroed, sensors.readings.read(q, v, at_rest(bench.system, zeroing))[0], 0.0)


def free_zero(
    config: BenchConfig, bench: Bench, sensors: Sensors, unknowns: Unknowns, zeroing: np.ndarray
) -> Zero | None:
    """The same for every trial value of the parameters; None where none is estimated, none zeroed, or the start no rest."""
    if not (sensors.zeroed.any() and unknowns.free and config.simulate.start == "equilibrium"):
        return None
    q, _ = start_of(replace(bench, theta=unknowns.starts[0]), config.simulate, zeroing)
    return zero_at_rest(bench.system, sensors.readings, sensors.zeroed, q, zeroing, unknowns.coordinates)


def loads_at_rest(
    config: BenchConfig,
    bench: Bench,
    channels: CompiledSensors,
    unknowns: Unknowns,
    guess: np.ndarray,
    first: np.ndarray,
    noise: np.ndarray,
) -> np.ndarray:
    """Loads (nu,) under which the bench at rest reads what was measured first, by damped Gauss-Newton from the guess:

    min ‖(y₀ − h(q₀(u)))/σ‖² + ‖(u − û)/σ_u‖²     over the inputs whose guess the config leaves open

    first y₀ (m,), NaN where nothing was measured.
    """
    free = [i for i, entry in enumerate(asked(config).inputs.values()) if entry.guess is None]
    there = np.isfinite(first)
    columns, theta = unknowns.inputs[free], unknowns.starts[0]

    def misfit(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What is to be explained by a change of the loads, and its slopes."""
        q, v = start_of(replace(bench, theta=theta), config.simulate, u)
        by_u, _ = static_response(bench.system, q, u, theta)
        read, H, _ = channels.read(q, v, at_rest(bench.system, u))
        r = np.concatenate([((first - read) / noise)[there], (guess - u)[columns] / unknowns.std_u[free]])
        slopes = np.concatenate([((H @ by_u[:, columns]) / noise[:, None])[there], np.diag(1 / unknowns.std_u[free])])
        return r, slopes

    u = guess.copy()
    if not free:
        return u
    with blame("estimate.measured"):
        r, slopes = misfit(u)
    for _ in range(FITS):
        du = np.linalg.lstsq(slopes, r, rcond=None)[0]
        if np.all(np.abs(du) < SETTLED * unknowns.std_u[free]):
            u[columns] += du
            break
        for halvings in range(HALVINGS):
            trial = u.copy()
            trial[columns] += 0.5**halvings * du
            try:
                found = misfit(trial)
            except (NumericalError, UserError):
                continue  # no rest under loads that go too far
            if np.linalg.norm(found[0]) < np.linalg.norm(r):
                u, (r, slopes) = trial, found
                break
        else:
            break
    return u


def moved_at_rest(
    config: BenchConfig, bench: Bench, channels: CompiledSensors, unknowns: Unknowns, under: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, NumericalError | None]:
    """What one σ of every unknown, or of its change in a step, moves every reading by at rest (m, nu + p): the most of all
    these loads, because a stiffness is felt under load only. Zeros where the bench does not start from rest. With the error
    of loads, the first ones aside, under which no rest was found: they may move more."""
    unsolved: NumericalError | None = None
    most = np.zeros((len(channels.channels), len(unknowns.std_u) + len(unknowns.std)))
    if config.simulate.start != "equilibrium":
        return most, unsolved
    theta = unknowns.starts[0]
    std = np.concatenate([
        np.maximum(unknowns.std_u, unknowns.increment_u), np.maximum(unknowns.std, unknowns.increment)
    ])  # fmt: skip
    free = [bench.system.parameters.index(unknowns.parameters[name]) for name in unknowns.free]
    for i, u in enumerate(under):
        try:
            with blame("estimate"):
                q, v = start_of(replace(bench, theta=theta), config.simulate, u)
                by_u, by_theta = static_response(bench.system, q, u, theta)
        except (UserError, NumericalError) as error:
            if i == 0:
                raise
            unsolved = error if isinstance(error, NumericalError) else unsolved
            continue  # loads that rest cannot carry say nothing
        response = np.concatenate([by_u[:, unknowns.inputs], by_theta[:, free]], axis=1)
        most = np.maximum(most, np.abs(channels.read(q, v, at_rest(bench.system, u))[1] @ response) * std)
    return most, unsolved

"""A bench's filter before it runs: its model, where it starts, and the measurements it is given."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from strainsight.errors import ConfigError, blame
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.start import start_covariance, static_response, white_force
from strainsight.multibody.inverse.zeroed import zero_at_rest
from strainsight.stages.bench.case.bench import Bench
from strainsight.stages.bench.case.sensors import Sensors
from strainsight.stages.bench.case.start import start_of
from strainsight.stages.bench.inverse.unknowns import Unknowns

FLOOR = 1e-8
"""Share of a sensor's largest reading that its noise is raised to: a tenth of that is the rounding of a step, which a filter
would try to explain."""
SPAN = 1e-7
"""Share of what a load or parameter may move a reading by that its noise is raised to: squared, the digits of a number."""
NOTHING = 1e-12
"""Noise of a channel that reads nothing at all [its unit]."""
FELT = 1e-3
"""σ of its noise by which one σ of an unknown must move a reading to be felt."""


@dataclass(frozen=True)
class Trial:
    """model; start (B, size), covariance (B, size, size): of every run, seeds outside and starts inside; noise (m,) σ of the
    readings; said: what was done to the config's wishes, in words."""

    model: AugmentedStep
    start: np.ndarray
    covariance: np.ndarray
    noise: np.ndarray
    said: tuple[str, ...]


def trial_of(
    config: Any,
    bench: Bench,
    used: Sensors,
    unknowns: Unknowns,
    known: np.ndarray,
    largest: np.ndarray,
    heaviest: np.ndarray,
    h: float,
) -> Trial:
    """The filter of `estimate`; known (T + 1, nu) all loads as the filter knows them, guesses in the columns of unknown ones;
    largest (m,) reading of every channel without noise; heaviest (nu,): loads under which a parameter has to be felt.

    Every start is the one of the simulation, with what the filter takes the parameters and loads for; where it is an
    equilibrium, its covariance says what badly known loads and parameters do to it.
    """
    channels, guess, runs = used.readings, known[0].copy(), int(config.estimate.runs)
    model = AugmentedStep(
        bench.system, channels, np.zeros(len(largest)), h, known[1:], unknowns.inputs, unknowns.coordinates,
        white_force(bench.system, float(config.estimate.disturbance)), unknowns.increment_u**2,
        unknowns.coordinates.std(unknowns.starts[0], unknowns.increment) ** 2, np.zeros(len(largest)),
    )  # fmt: skip
    states, covariances, offsets = [], [], []
    for theta in unknowns.starts:
        with blame("estimate"):
            q, v = start_of(replace(bench, theta=theta), config.simulate, guess)
            states.append(model.pack(q, v, guess[unknowns.inputs], theta))
            covariances.append(_covariance(config, model, unknowns, q, guess, theta))
        offsets.append(np.where(used.zeroed, channels.read(q, v)[0], 0.0))
    moved = _moved(config, model, bench, unknowns, (guess, heaviest))
    noise, raised = _noise(config.estimate, used, largest, moved.max(axis=1, initial=0.0))
    said = _felt(config, unknowns, used, moved / noise[:, None])
    if used.zeroed.any() and unknowns.free and config.simulate.start == "equilibrium":
        q = states[0][model.q]
        model = replace(model, zero=zero_at_rest(bench.system, channels, used.zeroed, q, guess, unknowns.coordinates))
        offsets = [np.zeros(len(largest))] * len(states)
    model = replace(model, offset=np.tile(offsets, (runs, 1)), R=noise**2)
    return Trial(model, np.tile(states, (runs, 1)), np.tile(covariances, (runs, 1, 1)), noise, (*raised, *said))


def _noise(
    estimate: Any, used: Sensors, largest: np.ndarray, moved: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """σ of every channel (m,), and which were raised; moved (m,): by one σ of an unknown."""
    noise, said = np.empty(len(largest)), []
    least = np.maximum(np.maximum(FLOOR * largest, SPAN * moved), NOTHING)
    for name, own in used.channels.items():
        stated = np.broadcast_to(np.asarray(estimate.sensors[name].noise, dtype=float), own.stop - own.start)
        noise[own] = np.maximum(stated, least[own])
        if (raised := stated < least[own]).any():
            said.append(
                f"the noise of {name} is raised from {stated[raised].min():.3g} to {least[own][raised].max():.3g} or less: with "
                "none, rounding is all that a filter would explain"
            )
    return noise, tuple(said)


def _covariance(
    config: Any, model: AugmentedStep, unknowns: Unknowns, q: np.ndarray, u: np.ndarray, theta: np.ndarray
) -> np.ndarray:
    spread = unknowns.coordinates.covariance(theta, unknowns.std)
    if config.simulate.start == "equilibrium":
        return start_covariance(
            model.system, q, u, theta, unknowns.coordinates, unknowns.inputs, unknowns.std_u, spread
        )
    P = np.zeros((model.size, model.size))
    P[model.u, model.u], P[model.xi, model.xi] = np.diag(unknowns.std_u**2), spread
    return P


def _moved(
    config: Any, model: AugmentedStep, bench: Bench, unknowns: Unknowns, under: tuple[np.ndarray, ...]
) -> np.ndarray:
    """What one σ of every unknown, or of its change in a step, moves every reading by at rest (m, nu + p): the most of all
    these loads, because a stiffness is felt under load only. Zeros where the bench does not start from rest."""
    most = np.zeros((model.channels, model.size - model.u.start))
    if config.simulate.start != "equilibrium":
        return most
    theta = unknowns.starts[0]
    std = np.concatenate([
        np.maximum(unknowns.std_u, unknowns.increment_u), np.maximum(unknowns.std, unknowns.increment)
    ])  # fmt: skip
    free = [bench.system.parameters.index(unknowns.parameters[name]) for name in unknowns.free]
    for u in under:
        with blame("estimate"):
            q, v = start_of(replace(bench, theta=theta), config.simulate, u)
            by_u, by_theta = static_response(bench.system, q, u, theta)
        response = np.concatenate([by_u[:, unknowns.inputs], by_theta[:, free]], axis=1)
        most = np.maximum(most, np.abs(model.sensors.read(q, v)[1] @ response) * std)
    return most


def _felt(config: Any, unknowns: Unknowns, used: Sensors, moved: np.ndarray) -> tuple[str, ...]:
    """Refuse an unknown that no sensor feels at rest, name the sensors that feel none; moved (m, nu + p) in σ of the noise.

    Where the start is no equilibrium, or a sensor measures a velocity, rest says nothing.
    """
    quantities = [config.sensors[name].get("quantity") for name in used.channels]
    if config.simulate.start != "equilibrium" or "velocity" in quantities:
        return ()
    names = [f"inputs.{name}" for name in config.estimate.inputs] + [f"parameters.{name}" for name in unknowns.free]
    for name, column in zip(names, moved.T, strict=True):
        if column.max() < FELT:
            raise ConfigError(
                f"no sensor feels it: one σ of it moves every reading by less than {FELT:g} σ of its noise",
                key=f"estimate.{name}",
                remedy="give the filter a sensor on a body that it deforms or moves, or make it known",
            )
    return tuple(
        f"{name} feels none of the unknowns: no σ of one moves it by more than {FELT:g} σ of its noise"
        for name, own in used.channels.items()
        if moved[own].max() < FELT
    )


def measurements(
    readings: np.ndarray, noise: np.ndarray, runs: int, starts: int, seed: int, noisy: bool
) -> np.ndarray:
    """What the filter is given (T, runs · starts, m): readings (T, 1 or runs, m), noise drawn anew for every run, the same for
    all starts of one."""
    steps, m = len(readings), len(noise)
    found = np.broadcast_to(readings, (steps, runs, m)).copy()
    if noisy:
        for run in range(runs):
            found[:, run] += noise * np.random.default_rng((seed, 1, run)).standard_normal((steps, m))
    return np.repeat(found, starts, axis=1)


def command_history(time: np.ndarray, loads: Mapping[str, np.ndarray]) -> bytes:
    """loads.csv: what a test rig has to do to the bench, time [s] and every load [N, N m]."""
    lines = [",".join(["time", *loads])]
    for k, instant in enumerate(time):
        lines.append(",".join([f"{instant:.9g}", *(f"{values[k]:.9g}" for values in loads.values())]))
    return ("\n".join(lines) + "\n").encode()



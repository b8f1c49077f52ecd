"""A bench's filter before it runs: its model, where it starts, the noise of its channels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, MotionSensor
from strainsight.config.bench.estimate import BenchEstimateSection
from strainsight.errors import ConfigError, NumericalError, UserError, blame
from strainsight.estimation.model import StepModel
from strainsight.estimation.reduced import Biased, bordered
from strainsight.experiment.bench.bench import Bench, start_of
from strainsight.experiment.bench.inverse.installed import Toleranced, rows_of
from strainsight.experiment.bench.inverse.rest import free_zero, loads_at_rest, moved_at_rest, zero_of
from strainsight.experiment.bench.inverse.unknowns import Unknowns, asked, corrects, has_other_poses
from strainsight.experiment.bench.sensors import Sensors
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import start_covariance, white_force

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


FLOOR = 1e-8
"""Share of a sensor's largest reading that its noise is raised to: a tenth of that is the rounding of a step, which a filter
would try to explain."""
SPAN = 1e-7
"""Share of what a load or parameter may move a reading by that its noise is raised to: squared, the digits of a number."""
NOTHING = 1e-12
"""Least noise of a channel, as of one that reads nothing at all [its unit]."""
FAR = 100.0
"""Times that a stated noise may be raised by; beyond, it is a unit that is wrong."""
FELT = 1e-3
"""σ of its noise by which one σ of an unknown must move a reading to be felt."""
STILL = 1e-9
"""Share of its largest rate below which a drive stands still."""


@dataclass(frozen=True)
class Trial:
    """model; start (B, size), covariance (B, size, size): of every run, seeds outside and starts inside; begin: parameters
    ξ (b, p) → the start (b, size) and its covariance (b, size, size) given them, NaN where there is none; noise (m,) σ of the
    readings; offsets of channels, of which model and start know nothing; installed: D, o of `rows_of`; notes: what was done to
    the config's wishes, in words."""

    model: AugmentedStep
    start: np.ndarray
    covariance: np.ndarray
    begin: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    noise: np.ndarray
    offsets: Offsets
    installed: tuple[np.ndarray, np.ndarray]
    notes: tuple[str, ...]


def trial_of(
    config: BenchConfig,
    bench: Bench,
    used: Sensors,
    unknowns: Unknowns,
    known: np.ndarray,
    second: np.ndarray,
    largest: np.ndarray,
    heaviest: np.ndarray,
    zeroing: np.ndarray,
    first: np.ndarray | None,
    given: np.ndarray,
    errors: tuple[Toleranced, ...],
    h: float,
) -> Trial:
    """The filter of `estimate`; known (T + 1, nu) all loads as the filter knows them, guesses in the columns of unknown ones;
    second (T + 1, nd): p̈ of driven joints;
    largest (m,) reading of every channel without noise; heaviest (nu,): loads under which a parameter has to be felt;
    zeroing (nu,): those under which gauges were zeroed at rest, which a test knows; first (m,): what was measured at the
    start, which guesses that the config leaves open have to explain at rest; given (m,): the
    channels that the filter has; errors: of gauges.

    Every start is the one of the simulation, with what the filter takes the parameters and loads for; where it is an
    equilibrium, its covariance says what badly known loads and parameters do to it.
    """
    channels, guess, runs = used.readings, known[0].copy(), asked(config).runs
    model = AugmentedStep(
        bench.system, channels, np.zeros(len(largest)), config.simulate.method,
        known, unknowns.inputs, unknowns.loads, unknowns.coordinates, white_force(bench.system, asked(config).disturbance),
        unknowns.coordinates.covariance(unknowns.starts[0], unknowns.increment), np.zeros(len(largest)),
        rest=config.simulate.start == "equilibrium" and _begins_at_rest(bench, known), corrected=corrects(config),
        printed=asked(config).method.noise == "as_printed", second=second,
    )  # fmt: skip
    raised_by = guess.copy()
    raised_by[unknowns.inputs] += unknowns.std_u
    moved, unsolved = moved_at_rest(config, bench, channels, unknowns, (guess, heaviest, raised_by))
    noise, raised = _noise(asked(config), used, largest, moved.max(axis=1, initial=0.0))
    notes = (*raised, *_felt(config, unknowns, used, given, moved / noise[:, None], unsolved))
    with blame("estimate"):
        at_zero = start_of(replace(bench, theta=unknowns.starts[0]), config.simulate, zeroing)[0] if errors else None
    still = np.zeros(bench.system.size) if at_zero is None else at_zero
    biased, rows = offsets_of(config, used, h), rows_of(bench, used, errors, still)
    if first is not None:
        first = first.copy()
        first[biased.at] = np.nan  # what it reads too much would be taken for a load
    if first is not None and config.simulate.start == "equilibrium":
        guess = loads_at_rest(config, bench, channels, unknowns, guess, first, noise)
    states, covariances, offsets = [], [], []
    for theta in unknowns.starts:
        x, P = _start(config, bench, model, unknowns, guess, theta, unknowns.std)
        states.append(x)
        covariances.append(P)
        offsets.append(zero_of(config, bench, used, unknowns, theta, zeroing))
    zero = free_zero(config, bench, used, unknowns, zeroing)
    if zero is not None:
        model, offsets = replace(model, zero=zero), [np.zeros(len(largest))] * len(states)
    model = replace(model, offset=np.tile(offsets, (runs, 1)), R=noise**2)

    def begin(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _starts_given(config, bench, model, unknowns, guess, xi)

    return Trial(
        model, np.tile(states, (runs, 1)), np.tile(covariances, (runs, 1, 1)), begin, noise, biased, rows, notes
    )


def _begins_at_rest(bench: Bench, known: np.ndarray) -> bool:
    """Whether no drive moves at the start, beside how it moves later."""
    rates = np.abs(known[:, bench.system.drives.rates])
    return bool(np.all(rates[0] <= STILL * rates.max(axis=0, initial=0.0)))


def _start(
    config: BenchConfig,
    bench: Bench,
    model: AugmentedStep,
    unknowns: Unknowns,
    guess: np.ndarray,
    theta: np.ndarray,
    std: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """x (size,) and its covariance at the start, of parameters θ (nθ,) known to std (p,)."""
    with blame("estimate"):
        q, v = start_of(replace(bench, theta=theta), config.simulate, guess)
        return model.pack(q, v, guess[unknowns.inputs], theta), _covariance(
            config, model, unknowns, q, guess, theta, std
        )


def _starts_given(
    config: BenchConfig, bench: Bench, model: AugmentedStep, unknowns: Unknowns, guess: np.ndarray, xi: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """x (B, size) and its covariance (B, size, size) at the start, of parameters ξ (B, p) that are known; NaN where rest is not
    found."""
    x, P = np.full((len(xi), model.size), np.nan), np.zeros((len(xi), model.size, model.size))
    for i, own in enumerate(xi):
        try:
            theta = model.coordinates.theta(own)[0]
            x[i], P[i] = _start(config, bench, model, unknowns, guess, theta, np.zeros(len(own)))
        except (NumericalError, UserError):
            continue
        x[i, model.xi] = own
    return x, P


def _noise(
    estimate: BenchEstimateSection, used: Sensors, largest: np.ndarray, moved: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """σ of every channel (m,), and which were raised; moved (m,): by one σ of an unknown."""
    noise, notes = np.empty(len(largest)), []
    least = np.maximum(np.maximum(FLOOR * largest, SPAN * moved), NOTHING)
    for name, own in used.channels.items():
        stated = np.broadcast_to(np.asarray(estimate.sensors[name].noise, dtype=float), own.stop - own.start)
        noise[own] = np.maximum(stated, least[own])
        if not (raised := stated < least[own]).any():
            continue
        low, high = float(stated[raised].min()), float(least[own][raised].max())
        if low > 0 and high > FAR * low:
            raise _too_quiet(f"estimate.sensors.{name}.noise", low, float(moved[own].max()), float(largest[own].max()))
        notes.append(
            f"the noise of {name} is raised from {low:.3g} to {high:.3g}, below which a filter only explains rounding"
        )
    return noise, tuple(notes)


def _too_quiet(key: str, noise: float, moved: float, largest: float) -> ConfigError:
    """The error for a stated noise far below what rounding leaves of the reading, of what an unknown moves it by, or of none."""
    if max(SPAN * moved, FLOOR * largest) < NOTHING:
        what, remedy = f"{noise:g} is less than {NOTHING:g}, the least of a channel", "take larger loads and noises"
        return ConfigError(what, key=key, remedy=remedy)
    by_unknown = SPAN * moved >= FLOOR * largest
    what, reach = ("one σ of an unknown moves it by", moved) if by_unknown else ("it reads up to", largest)
    return ConfigError(
        f"{what} {reach:.3g}, {reach / noise:.1e} times its noise of {noise:g}: more digits than a number has",
        key=key,
        remedy=f"check the units of {'guesses, std and increments' if by_unknown else 'the loads'}, or take smaller ones",
    )


def _covariance(
    config: BenchConfig,
    model: AugmentedStep,
    unknowns: Unknowns,
    q: np.ndarray,
    u: np.ndarray,
    theta: np.ndarray,
    std: np.ndarray,
) -> np.ndarray:
    spread = unknowns.coordinates.covariance(theta, std)
    if config.simulate.start == "equilibrium":
        return model.spread(
            start_covariance(model.system, q, u, theta, unknowns.coordinates, unknowns.inputs, unknowns.std_u, spread)
        )
    n, nu = model.v.stop, len(unknowns.inputs)
    P = np.zeros((n + nu + len(spread),) * 2)
    P[n : n + nu, n : n + nu], P[n + nu :, n + nu :] = np.diag(unknowns.std_u**2), spread
    return model.spread(P)


def _felt(
    config: BenchConfig,
    unknowns: Unknowns,
    used: Sensors,
    given: np.ndarray,
    moved: np.ndarray,
    unsolved: NumericalError | None,
) -> tuple[str, ...]:
    """Refuse an unknown that no sensor feels at rest, and name sensors that feel none; moved (m, nu + p) in σ of the noise, by
    channels that are given (m,); unsolved: raised in place of a refusal, where an unknown may be felt under loads of which rest
    was not found.

    Where the start is no equilibrium, a sensor measures a velocity or an acceleration, or drives or gravity take the bench to
    other poses, rest says nothing: `undistinguished` asks along the run.
    """
    there = [config.sensors[name] for name, own in used.channels.items() if given[own].any()]
    moving = any(
        isinstance(own, AccelerationSensor) or (isinstance(own, MotionSensor) and own.quantity == "velocity")
        for own in there
    )
    if config.simulate.start != "equilibrium" or moving or has_other_poses(config):
        return ()
    moved = np.where(given[:, None], moved, 0.0)
    names = [f"inputs.{name}" for name in asked(config).inputs] + [f"parameters.{name}" for name in unknowns.free]
    for name, column, std in zip(names, moved.T, [*unknowns.std_u, *unknowns.std], strict=True):
        if column.max() < FELT and not asked(config).allow_unobservable:
            if unsolved is not None:
                raise unsolved
            raise ConfigError(
                f"no sensor feels it: one σ of it ({std:.3g}) moves every reading by less than {FELT:g} σ of its noise",
                key=f"estimate.{name}",
                remedy="give the filter a sensor on a body that it deforms or moves, make it known, or set "
                "estimate.allow_unobservable: true",
            )
    return tuple(
        f"{name} feels none of the unknowns: no σ of one moves it by more than {FELT:g} σ of its noise"
        for name, own in used.channels.items()
        if moved[own].max(initial=0.0) < FELT and given[own].any()
    )

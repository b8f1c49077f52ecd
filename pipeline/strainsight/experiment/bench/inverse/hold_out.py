"""Channels of a bench left out of its filter in turn: what the others say that each of them reads, beside what it read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig, StrainSensorSection
from strainsight.config.bench.estimate import Method
from strainsight.errors import ConfigError, NumericalError
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.filtering import predicted
from strainsight.experiment.bench.inverse.trial import Trial
from strainsight.experiment.bench.inverse.truth import Reality
from strainsight.experiment.bench.inverse.unknowns import Unknowns, asked, corrects, has_drives
from strainsight.experiment.bench.sensors import Sensors, units_of
from strainsight.experiment.hold_out import Left, left_out
from strainsight.multibody.coupled import coupled_modes, followed, missed
from strainsight.multibody.inverse.linear import indistinct


@dataclass(frozen=True)
class HeldOut:
    """Of every channel of the filter (m,): predicted and std (T, seeds, m) by the others, NaN where there is none; left_in: why
    it was not left out, empty where it was; units; rows: the judgement over all seeds."""

    predicted: np.ndarray
    std: np.ndarray
    left_in: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[Left, ...]


def held_out(
    config: BenchConfig,
    method: Method,
    used: Sensors,
    given: np.ndarray,
    y: np.ndarray,
    trial_with: Callable[[np.ndarray], Trial],
    tells: Callable[[Trial, np.ndarray], None],
    starts: int,
    progress: Callable[[str, float], None],
) -> HeldOut:
    """Predict every gauge with all its grids, and every component of another sensor, by the other channels, for all seeds of
    y (T, B, m) from their first starts:

        ŷ = h(x̂),     σ² = H P Hᵀ + R + Σₖ (H Sₖ − Dₖ x̂ − oₖ)²

    x̂, P filtered from the other channels up to this sample, its own offset among the states with what is known of it beforehand;
    R of one sample; S what installation of the others leaves x̂ off by, D x̂ + o what its own does to the reading (`considered`).
    given (m,): channels that were measured; trial_with: the filter by some of these; tells: raises ConfigError where they cannot
    tell the unknowns. A channel without which that is so, or a filter diverges, stays in.
    """
    own = y[:, ::starts]
    mean, std = (np.full(own.shape, np.nan) for _ in range(2))
    left_in = ["the filter is not given it"] * len(given)
    parts = [part for part in _parts(config, used) if given[part].any()]
    for i, part in enumerate(parts):
        progress(f"without {_label(used, part[0])}", i / len(parts))
        others = given.copy()
        others[part] = False
        why = ""
        try:
            if not others.any():
                why = "there is no other"
            else:
                trial = trial_with(others)
                tells(trial, others)
                mean[..., part], std[..., part], lost = predicted(method, _of_seeds(trial, starts), own, part)
                if lost.any():
                    why = f"without it {lost.sum()} of {len(lost)} runs diverge"
        except (ConfigError, NumericalError) as error:
            why = f"without it {error.key}: {error.what}" if error.key else f"without it: {error.what}"
        for channel in part:
            left_in[channel] = why if given[channel] else left_in[channel]
    stayed = [bool(why) for why in left_in]
    mean[..., stayed] = std[..., stayed] = np.nan
    labels = [_label(used, channel) for channel in range(len(given))]
    units = tuple(unit for name, part in used.channels.items() for unit in units_of(config.sensors[name], part))
    return HeldOut(mean, std, tuple(left_in), units, left_out(mean, std, left_in, labels, own))


def _parts(config: BenchConfig, used: Sensors) -> Iterator[np.ndarray]:
    """Channels that are left out together."""
    for name, part in used.channels.items():
        channels, entry = np.arange(part.start, part.stop), config.sensors[name]
        grids = np.ones(len(channels), dtype=int)
        if isinstance(entry, StrainSensorSection) and entry.gauges:
            grids = np.array([len(gauge.angles) if gauge.angles else 1 for gauge in entry.gauges])
        yield from np.split(channels, np.cumsum(grids)[:-1])


def _label(used: Sensors, channel: int) -> str:
    """Sensor and component, as numbers of a summary name them."""
    name, part = next(own for own in used.channels.items() if own[1].start <= channel < own[1].stop)
    return f"{name}.{channel - part.start + 1}"


def _of_seeds(trial: Trial, starts: int) -> Trial:
    """The first start of every seed."""
    first = slice(None, None, starts)
    model = replace(trial.model, offset=trial.model.offset[first])
    return replace(trial, model=model, start=trial.start[first], covariance=trial.covariance[first])


INSTANTS = 5
"""Of the run, evenly, at which the sensors are asked whether they tell the unknowns."""
MISSED = 0.05
"""Share of a load that the step may get wrong."""
TURN = 0.1
"""[rad] that a body may turn in a step which is linearised half-way."""


def undistinguished(
    config: BenchConfig, trial: Trial, given: np.ndarray, unknowns: Unknowns, mean: np.ndarray
) -> Iterator[str]:
    """Combinations of unknowns that no sensor separates at any of a few instants of the first run, mean (T + 1, size), by the
    channels that are given (m,); raises ConfigError, where the config does not allow for them."""
    model = replace(trial.model, R=np.where(given, trial.model.R, np.inf))
    names = (*asked(config).inputs, *unknowns.free)
    there = np.flatnonzero(np.isfinite(mean).all(axis=1))
    found: list[list[str]] = []
    for k in np.unique(there[np.linspace(0, len(there) - 1, INSTANTS).round().astype(int)]) if len(there) else []:
        try:
            found.append(indistinct(model, mean[k], min(k, len(model.known) - 1), names))
        except NumericalError:
            return  # nothing separates what decays from what does not: no statement
        if not found[-1]:
            return
    if not found:
        return
    words = "; ".join(found[0])
    if not asked(config).allow_unobservable:
        raise ConfigError(
            f"the sensors cannot tell {words}, at none of {len(found)} instants of the run",
            key="estimate.inputs" if asked(config).inputs else "estimate.parameters",
            remedy="give the filter another sensor, make one of them known, or set estimate.allow_unobservable: true",
        )
    yield f"the sensors cannot tell {words}: what is given of each rests on its first σ alone"


def unfollowed(
    config: BenchConfig, bench: Bench, trial: Trial, reality: Reality, mean: np.ndarray, std: np.ndarray
) -> Iterator[str]:
    """Loads that the step does not follow, and bodies that turn too far in it, mean, std (T + 1, size) of the first run; raises
    ConfigError, where the config does not allow for them.

    A step that is taken for true gets wrong what its loads have above its band (`missed`): of a load that is known more than
    MISSED; of one that is only estimated, whose spectrum is also that of its errors, more than its σ besides.
    """
    said = list(_turning(bench, trial, mean) if corrects(config) else _missed(config, bench, trial, reality, mean, std))
    if said and not asked(config).allow_unfollowed:
        made_up_for = "" if corrects(config) or has_drives(config) else "method.step_error: estimated, "
        raise ConfigError(
            said[0],
            key="estimate.time_step",
            remedy=f"take a smaller estimate.time_step, {made_up_for}or set estimate.allow_unfollowed: true",
        )
    yield from (f"{text}: σ does not allow for that" for text in said)


def _missed(
    config: BenchConfig, bench: Bench, trial: Trial, reality: Reality, mean: np.ndarray, std: np.ndarray
) -> Iterator[str]:
    estimate, model = asked(config), trial.model
    if estimate.measured is None and estimate.truth.model not in ("fine", "other"):
        return
    x = mean[0]
    u = np.array(model.known[0], dtype=float)
    u[model.inputs] = x[model.u]
    frequency = coupled_modes(bench.system, x[model.q], x[model.v], u, bench.theta).held_frequency
    h, method = model.h, config.simulate.method
    if not len(frequency) or not np.isfinite(mean).all():
        return
    true = reality.inputs[:, 0]
    for column, name in enumerate(bench.system.inputs):
        known = bool(np.isfinite(true[:, column]).all())
        at = np.flatnonzero(model.inputs == column)
        load = true[:, column] if known else mean[:, model.u[at[0]]] if len(at) else model.known[:, column]
        share = float(missed(load[:, None], frequency, h, method)[0])
        if share <= MISSED:
            continue
        size, claimed = float(np.std(load)), float(np.median(std[1:, model.u[at[0]]])) if len(at) else 0.0
        if known or not len(at) or share * size > claimed:
            yield (
                f"the step of {h:g} s follows loads up to {followed(frequency, h, method):.3g} Hz, and of {name} it gets "
                f"{100 * share:.2g} % wrong"
            )


def _turning(bench: Bench, trial: Trial, mean: np.ndarray) -> Iterator[str]:
    """‖Ṙ‖/√2 is the angular velocity of a body."""
    v = mean[:, trial.model.v]
    for name in bench.poses:
        at = bench.system.of[name].start
        turn = float(trial.model.h * np.nanmax(np.linalg.norm(v[:, at + 3 : at + 12], axis=1)) / np.sqrt(2))
        if turn > TURN:
            yield f"{name} turns by {turn:.2g} rad in a step of {trial.model.h:g} s, which is linearised for at most {TURN:g}"

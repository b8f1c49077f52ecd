"""Channels of a bench left out of its filter in turn; what its sensors cannot tell, and its step cannot follow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from strainsight.config.bench.bench import StrainSensor
from strainsight.errors import ConfigError, NumericalError
from strainsight.experiment.bench.inverse.filtering import predicted
from strainsight.experiment.bench.inverse.trial import Trial
from strainsight.experiment.bench.inverse.truth import Reality
from strainsight.experiment.bench.inverse.unknowns import corrects, has_drives
from strainsight.experiment.bench.sensors import channel_labels
from strainsight.multibody.coupled import coupled_modes, followed, missed
from strainsight.multibody.inverse.linear import indistinct


@dataclass(frozen=True)
class FilteredBench:
    """The `System` of a bench, all seeds at once from their first starts: y (T, B, m) of all runs; trial_with: the filter with
    some channels (m,); mean (T + 1, size) of the first run, where the others have to tell the unknowns.

        ŷ = h(x̂),     σ² = H P Hᵀ + R + Σₖ (H Sₖ − Dₖ x̂ − oₖ)²

    x̂, P filtered from the other channels up to this sample, its own offset among the states with what is known of it beforehand;
    R of one sample; S what installation of the others leaves x̂ off by, D x̂ + o what its own does to the reading (`considered`).
    """

    trial: Trial
    y: np.ndarray
    trial_with: Callable[[np.ndarray], Trial]
    mean: np.ndarray

    @property
    def labels(self) -> tuple[str, ...]:
        return channel_labels(self.trial.problem.used)

    @property
    def given(self) -> np.ndarray:
        return self.trial.given

    @cached_property
    def measured(self) -> Sequence[np.ndarray]:
        return (self.y[:, :: len(self.trial.problem.unknowns.starts)],)

    @property
    def parts(self) -> Sequence[np.ndarray]:
        """A gauge with all its grids, a component of another sensor."""
        parts: list[np.ndarray] = []
        for name, channels in self.trial.problem.used.channels.items():
            sensor = self.trial.problem.config.sensors[name]
            grids = np.ones(channels.stop - channels.start, dtype=int)
            if isinstance(sensor, StrainSensor) and sensor.gauges:
                grids = np.array([len(gauge.angles) if gauge.angles else 1 for gauge in sensor.gauges])
            parts += np.split(np.arange(channels.start, channels.stop), np.cumsum(grids)[:-1])
        return parts

    def by_others(self, part: np.ndarray) -> tuple[Sequence[tuple[np.ndarray, np.ndarray]], str]:
        """None where the others cannot tell the unknowns, or a filter diverges."""
        others = self.given.copy()
        others[part] = False
        if not others.any():
            return (), "there is no other"
        try:
            trial = self.trial_with(others)
            list(undistinguished(trial, self.mean))
            mean, std, lost = predicted(trial.of_seeds(), self.measured[0], part)
        except (ConfigError, NumericalError) as error:
            return (), f"without it {error.key}: {error.what}" if error.key else f"without it: {error.what}"
        if lost.any():
            return (), f"without it {lost.sum()} of {len(lost)} runs diverge"
        return ((mean, std),), ""


INSTANTS = 5
"""Of the run, evenly, at which the sensors are asked whether they tell the unknowns."""
MISSED = 0.05
"""Share of a load that the step may get wrong."""
TURN = 0.1
"""[rad] that a body may turn in a step which is linearised half-way."""


def undistinguished(trial: Trial, mean: np.ndarray) -> Iterator[str]:
    """Combinations of unknowns that no sensor separates at any of a few instants of the first run, mean (T + 1, size); raises
    ConfigError, where the config does not allow for them."""
    model, estimate = replace(trial.model, R=np.where(trial.given, trial.model.R, np.inf)), trial.problem.estimate
    there = np.flatnonzero(np.isfinite(mean).all(axis=1))
    found: list[list[str]] = []
    for k in np.unique(there[np.linspace(0, len(there) - 1, INSTANTS).round().astype(int)]) if len(there) else []:
        try:
            found.append(indistinct(model, mean[k], min(k, len(model.known) - 1), trial.problem.names))
        except NumericalError:
            return  # nothing separates what decays from what does not: no statement
        if not found[-1]:
            return
    if not found:
        return
    words = "; ".join(found[0])
    if not estimate.allow_unobservable:
        raise ConfigError(
            f"the sensors cannot tell {words}, at none of {len(found)} instants of the run",
            key="estimate.inputs" if estimate.inputs else "estimate.parameters",
            remedy="give the filter another sensor, make one of them known, or set estimate.allow_unobservable: true",
        )
    yield f"the sensors cannot tell {words}: what is given of each rests on its first σ alone"


def unfollowed(trial: Trial, reality: Reality, mean: np.ndarray, std: np.ndarray) -> Iterator[str]:
    """Loads that the step does not follow, and bodies that turn too far in it, mean, std (T + 1, size) of the first run; raises
    ConfigError, where the config does not allow for them.

    A step that is taken for true gets wrong what its loads have above its band (`missed`): of a load that is known more than
    MISSED; of one that is only estimated, whose spectrum is also that of its errors, more than its σ besides.
    """
    config = trial.problem.config
    doubts = list(_turning(trial, mean) if corrects(config) else _missed(trial, reality, mean, std))
    if doubts and not trial.problem.estimate.allow_unfollowed:
        made_up_for = "" if corrects(config) or has_drives(config) else "method.step_error: estimated, "
        raise ConfigError(
            doubts[0],
            key="estimate.time_step",
            remedy=f"take a smaller estimate.time_step, {made_up_for}or set estimate.allow_unfollowed: true",
        )
    yield from (f"{text}: σ does not allow for that" for text in doubts)


def _missed(trial: Trial, reality: Reality, mean: np.ndarray, std: np.ndarray) -> Iterator[str]:
    estimate, model, bench = trial.problem.estimate, trial.model, trial.problem.bench
    if estimate.measured is None and estimate.truth.model not in ("fine", "other"):
        return
    x = mean[0]
    u = np.array(model.known[0], dtype=float)
    u[model.inputs] = x[model.u]
    frequency = coupled_modes(bench.system, x[model.q], x[model.v], u, bench.theta).held_frequency
    h, method = model.h, bench.config.simulate.method
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


def _turning(trial: Trial, mean: np.ndarray) -> Iterator[str]:
    """‖Ṙ‖/√2 is the angular velocity of a body."""
    bench, v = trial.problem.bench, mean[:, trial.model.v]
    for name in bench.poses:
        at = bench.system.of[name].start
        turn = float(trial.model.h * np.nanmax(np.linalg.norm(v[:, at + 3 : at + 12], axis=1)) / np.sqrt(2))
        if turn > TURN:
            yield f"{name} turns by {turn:.2g} rad in a step of {trial.model.h:g} s, which is linearised for at most {TURN:g}"

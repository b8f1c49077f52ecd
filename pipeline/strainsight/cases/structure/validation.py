"""The chosen gauges put to the test on a truth that is not the filter's model (thesis 6.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.resources import Resources
from strainsight.cases.structure.accuracy import Accuracy, accuracies
from strainsight.cases.structure.channels import units_in_words
from strainsight.cases.structure.compared import compared
from strainsight.cases.structure.nuisances import tolerated
from strainsight.cases.structure.posterior import posteriors_of
from strainsight.cases.structure.problem import filter_model, problem_of
from strainsight.cases.structure.studies import (
    Studies,
    noise_levels,
    random_sets,
    repeated,
    studies_of,
)
from strainsight.cases.structure.sweeps import sweeps_of
from strainsight.cases.structure.trial import Trial, scaled_error, trial_of
from strainsight.cases.structure.truth import truth_of
from strainsight.cases.structure.variance import budget_of
from strainsight.config.placement import PlacementConfig
from strainsight.estimation.consistency import nees, nis, verdict, whiteness
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.motion import surface_reading
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoothed import Smoothed
from strainsight.estimation.update import output_std
from strainsight.estimation.verdict import band_of
from strainsight.gauges.candidates import ACCELERATION, STRAIN
from strainsight.gauges.screening import CLEARANCE
from strainsight.mesh.model import Mesh
from strainsight.ordering import first_of_largest
from strainsight.records.budget import budget_of_shares
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.training import Screened, Training
from strainsight.records.validated import Channels, Consistency, Field, SweepTable, Validated
from strainsight.sweep.sweep import Sweep, watched
from strainsight.sweep.threads import side_by_side


@dataclass(frozen=True)
class Validation:
    """What a validation has found.

    trial: the truth, and what the filter is given of it; validated: histories, studies and the field; accuracy: by unknown;
    whiteness: correlation of neighbouring innovations, verdict on them in words; diverged: runs of the studies that did;
    without: why an unknown has no budget, a sentence each.
    """

    trial: Trial
    validated: Validated
    accuracy: dict[str, Accuracy]
    whiteness: float
    verdict: str
    diverged: int
    without: tuple[str, ...]

    @property
    def units(self) -> dict[str, str]:
        """Of what `validated` holds."""
        kinds, own = self.trial.problem.channels.quantity, self.trial.chosen
        still = np.where(kinds == ACCELERATION, STRAIN, kinds)
        return {**self.trial.units, "the channel": units_in_words(kinds[own]), "the candidate": units_in_words(still)}


def validation_of(
    config: PlacementConfig,
    mesh: Mesh,
    spectrum: Modes | None,
    reduced: Reduced,
    training: Training,
    screened: Screened,
    gauges: np.ndarray,
    using: Resources,
) -> Validation:
    """Simulate the truth, measure it with noise, filter and smooth; then noise levels, repeats, random sets and sweeps.

    spectrum: that of `spectrum_of` where the truth is made of modes; gauges (k,): numbers of the layout's gauges.
    """
    seed, settings = config.seed, config.validation
    using.progress("truth", 0.0)
    problem = problem_of(config, using.files, reduced, training, screened)
    # modes of the whole model are compiled code, which has all cores in the main thread alone; what misplaced gauges read is not
    tolerances, truth = side_by_side(
        lambda: tolerated(config, mesh, reduced, training, np.arange(len(training.candidates))),
        lambda: truth_of(config, mesh, spectrum, reduced, training, problem, using),
    )
    trial = trial_of(config, problem, truth, tolerances, gauges)
    using.progress("filter", 0.2)
    model = filter_model(problem, trial.chosen, trial.h)
    measured, true = trial.measured(seed)
    found = trial.filtered(model, trial.chosen, measured, keep="all")
    run, smoothed = found.run, trial.smoothed(model, measured, found)
    compare = problem.method == "bank" and config.filter.compare is not False
    beside = compared(problem, model, trial.covariance, trial.known, measured) if compare else None
    watch = _watched(using, "noise levels, repeats, random sets", 0.4, 0.8)
    studies = studies_of(trial, settings, screened.kept, np.flatnonzero(screened.reason != CLEARANCE), seed, watch)
    swept = sweeps_of(trial, settings, seed, _watched(using, "sweeps", 0.8, 1.0))
    last, P, known, start = trial.names[-1], trial.covariance, trial.known, trial.settled
    budget, without = budget_of(problem, tolerances, model, trial.chosen, P, known, measured, run, smoothed, start)
    bank = found.banks[0] if found.banks else None
    return Validation(
        trial,
        replace(
            _validated(trial, model, run, smoothed, measured, true, studies, swept),
            posterior=posteriors_of(problem, P, bank),
            compared=beside,
            budget=budget_of_shares(budget),
        ),
        accuracies(trial, model, run, smoothed, studies),
        float(whiteness(run.whitened[:, 0])),
        verdict(run.whitened[:, 0]).text,
        int(sum(np.isnan(study.real[last]).sum() for study in vars(studies).values())),
        without,
    )


def _watched(using: Resources, doing: str, start: float, end: float) -> Sweep:
    using.progress(doing, start)
    return watched(using.sweep, lambda share: using.progress(doing, start + (end - start) * share))


def _validated(
    trial: Trial,
    model: FilterModel,
    run: FilterRun,
    smoothed: Smoothed,
    measured: np.ndarray,
    true: np.ndarray,
    studies: Studies,
    swept: SweepTable | None,
) -> Validated:
    estimate, later = (physical(model, own.mean[:, 0], own.std[:, 0]) for own in (run, smoothed))
    innovations = nis(run.whitened[:, 0])
    bands = np.square([band_of(len(trial.names)), band_of(len(trial.chosen) * len(innovations))])
    return Validated(
        time=trial.time,
        truth={name: trial.history[name] for name in trial.names},
        estimate={name: own[0] for name, own in estimate.items()},
        std={name: own[1] for name, own in estimate.items()},
        smoothed={name: own[0] for name, own in later.items()},
        smoothed_std={name: own[1] for name, own in later.items()},
        gauge=Channels(
            time=trial.time[1:], measured=measured, true=true, estimated=run.gauge_mean[:, 0], std=run.gauge_std[:, 0]
        ),
        consistency=Consistency(
            nees=nees(scaled_error(trial, run.mean)[1:, 0], run.unknown_covariance[1:, 0]),
            nis=innovations,
            band=bands,
        ),
        field=_field(trial, model, run),
        noise=noise_levels(studies.noise),
        repeats=repeated(studies.repeats),
        screened=random_sets(studies.screened),
        all=random_sets(studies.all),
        sweep=swept,
        posterior={},
    )


def _field(trial: Trial, model: FilterModel, run: FilterRun) -> Field:
    """Every candidate, bonded or not, at the instant of the largest true strain."""
    own = trial.problem.channels
    straining = np.flatnonzero(own.quantity == STRAIN)
    instant = _instant_of_largest(trial, straining if len(straining) else np.arange(len(own.quantity)))
    moving = own.quantity == ACCELERATION
    assert run.covariance is not None
    true = np.concatenate([trial.reading(part)[instant] for part in _parts(np.arange(len(moving)))])
    strain, J = surface_reading(model, own.rows, own.change, run.mean[instant])
    return Field(
        instant=float(trial.time[instant]),
        true=np.where(moving, np.nan, true),
        strain=np.where(moving, np.nan, strain[0]),
        std=np.where(moving, np.nan, output_std(J[0], run.covariance[instant, 0])),
    )


def _instant_of_largest(trial: Trial, channels: np.ndarray) -> int:
    """Index of the instant at which any of the channels reads most, after the start."""
    largest = np.max([np.abs(trial.reading(part)[1:]).max(axis=1) for part in _parts(channels)], axis=0)
    return first_of_largest(largest) + 1


PART = 1000
"""Channels that are read in time at once: pools are large."""


def _parts(channels: np.ndarray) -> list[np.ndarray]:
    return np.array_split(channels, max(1, len(channels) // PART))

"""Validation of a layout on a simulated truth that differs from the filter's model (thesis 6.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import NONE, tolerances_of
from strainsight.estimation.conditional import none_considered
from strainsight.estimation.consistency import after_start, check_innovations, nees, nis, settling_time, whiteness
from strainsight.estimation.decision import (
    WITHHELD,
    Benefit,
    Claim,
    Decision,
    autocorrelation_time,
    band_of,
    benefit_of,
    claims_of,
    without_sigma,
)
from strainsight.estimation.model import FilterModel, physical, surface_reading
from strainsight.estimation.record import GridRecord
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import Smoothed
from strainsight.estimation.update import output_std
from strainsight.experiment.filters_compared import comparison_table, disagreements_in_words, ratios
from strainsight.experiment.layout.advice import budget_tables
from strainsight.experiment.layout.gauge_list import layout_labels
from strainsight.experiment.structure.budget import budget_of
from strainsight.experiment.structure.considered import tolerated
from strainsight.experiment.structure.filtering import (
    by_grid,
    compared,
    excluded,
    excluded_in_words,
    histories,
    out_of_ranges,
    posterior_doubts,
    posterior_numbers,
    posteriors_of,
    ranges_in_words,
)
from strainsight.experiment.structure.problem import (
    damping_dependence_text,
    filter_model,
    load_dependence_text,
    problem_of,
    scheme_in_words,
)
from strainsight.experiment.structure.structure import Structure
from strainsight.experiment.structure.studies import Rank, rank_of, studies_of, sweep_table, sweeps_of
from strainsight.experiment.structure.trial import Trial, real_and_claimed, scaled_error, trial_of
from strainsight.experiment.structure.truth import truth_of
from strainsight.experiment.system import Resources
from strainsight.ordering import index_of_largest
from strainsight.parallel import Sweep, side_by_side, watched
from strainsight.records.mesh import STRAIN as STRAIN_UNIT
from strainsight.records.mesh import gauge_grid
from strainsight.records.placed import budget_of_shares
from strainsight.records.record import written
from strainsight.records.reduced import Modes
from strainsight.records.training import Screened
from strainsight.records.validated import Consistency, Field, RandomSetErrors, SimulatedChannels, Validated
from strainsight.runner.output import Output, Scalar, Table
from strainsight.sensors.candidates import ACCELERATION, STRAIN, units_in_words
from strainsight.sensors.screening import UNSUITABLE
from strainsight.text import csv_bytes, number

SETTLED = 0.01
"""Relative error within which an estimate counts as settled."""
UNITS = ("m/m", "m/s2", "m")
"""Units of strain, acceleration and displacement in measurement files."""


@dataclass(frozen=True)
class Validation:
    """Result of a validation.

    trial: truth and data of the filter; validated: histories, studies and field; accuracy: by unknown; whiteness: correlation of
    consecutive innovations; innovation_text: result of the innovation check; diverged: number of diverged study runs; without:
    sentences on unknowns without a variance budget."""

    trial: Trial
    validated: Validated
    accuracy: dict[str, Accuracy]
    whiteness: float
    innovation_text: str
    diverged: int
    without: tuple[str, ...]

    @property
    def units(self) -> dict[str, str]:
        """Units of `validated`."""
        kinds, chosen = self.trial.problem.channels.quantity, self.trial.chosen
        return {
            **self.trial.units,
            "the channel": units_in_words(kinds[chosen]),
            "the candidate": units_in_words(np.where(kinds == ACCELERATION, STRAIN, kinds)),
        }


def validation_of(
    structure: Structure, spectrum: Modes | None, screened: Screened, gauges: np.ndarray, using: Resources
) -> Validation:
    """Simulate the truth, add noise, filter and smooth; then run noise levels, repeats, random layouts and sweeps.

    spectrum: from `spectrum_of` for a truth of modes; gauges (k,): numbers of the layout."""
    config = structure.config
    seed, settings = config.seed, config.validation
    using.progress("simulated test", 0.0)
    problem = problem_of(structure, screened)
    # the eigenvalue solver needs the main thread to use all cores
    tolerances, truth = side_by_side(
        lambda: tolerated(structure, np.arange(len(structure.pool))),
        lambda: truth_of(structure, spectrum, problem, using),
    )
    trial = trial_of(config, problem, truth, tolerances, gauges)
    using.progress("filter", 0.2)
    model = filter_model(problem, trial.chosen, trial.h)
    measured, true = trial.measured(seed)
    filtered = trial.filtered(model, trial.chosen, measured, keep="all")
    run, smoothed = filtered.run, trial.smoothed(model, measured, filtered)
    compare = problem.method == "grid" and config.filter.compare is not False
    samples = trial.covariance, trial.known, measured
    record = GridRecord(model, np.zeros(model.size), *samples, none_considered(model), settled=trial.settled)
    watch = _watched(using, "studies of noise levels, repeated runs and random layouts", 0.4, 0.8)
    allowed = np.flatnonzero(~np.isin(screened.reason, UNSUITABLE))
    studies, lost = studies_of(trial, config.studies, settings.initial_std, screened.kept, allowed, seed, watch)
    swept = sweeps_of(trial, settings, seed, _watched(using, "sweeps", 0.8, 1.0))
    grid_run = filtered.grid_runs[0] if filtered.grid_runs else None
    budget, without = budget_of(problem, tolerances, record, trial.chosen, run, smoothed, grid_run)
    innovations = nis(run.whitened[:, 0])
    validated = Validated(
        time=trial.time,
        truth={name: trial.history[name] for name in trial.names},
        **(studies | histories(model, run, smoothed)),
        gauge=SimulatedChannels(
            time=trial.time[1:], measured=measured, true=true, estimated=run.gauge_mean[:, 0], std=run.gauge_std[:, 0]
        ),
        consistency=Consistency(
            nees=nees(scaled_error(trial, run.mean)[1:, 0], run.unknown_covariance[1:, 0]),
            nis=innovations,
            band=np.square([band_of(len(trial.names)), band_of(len(trial.chosen) * len(innovations))]),
        ),
        field=_field(trial, model, run),
        sweep=swept,
        posterior=posteriors_of(problem, trial.covariance, grid_run),
        compared=compared(problem, record) if compare else None,
        budget=budget_of_shares(budget),
    )
    return Validation(
        trial,
        validated,
        accuracies(trial, model, run, smoothed, validated.all),
        float(whiteness(run.whitened[:, 0])),
        check_innovations(run.whitened[:, 0]).text,
        lost,
        without,
    )


OF_SIGMA = ("std", "smoothed_std", "ratio", "rank_claimed", "rank_correlation")
"""Summary numbers that depend on σ."""


def validation_output(structure: Structure, validation: Validation) -> Output:
    """Output of a validation, with the strain of every candidate as a point grid and the measurements as a file; without σ if it
    is withheld."""
    config = structure.config
    labels = layout_labels(structure.training.name, validation.trial.gauges)
    shown, repeats = validation.validated, validation.validated.repeats
    numbers, decision = _numbers(validation, config.validation.truth.model), _decision(config, validation)
    claims = {}
    if decision.withheld:
        numbers = {key: value for key, value in numbers.items() if key.split(".")[0] not in OF_SIGMA}
        numbers |= {"out_of_range": decision.withheld, "verdict": WITHHELD}
        # random layouts and repeats are separate estimates and keep their σ
        rest = {name: getattr(shown, name) for name in ("repeats", "screened", "all", "sweep")}
        shown = replace(without_sigma(shown), compared=None, budget=None, **rest)
    else:
        claims = {
            name: claims_of(name, numbers, (repeats.error[name], repeats.std[name])) for name in validation.accuracy
        }
        numbers |= {f"claim.{name}": every[0].result for name, every in claims.items() if every}
    units = {name: load.unit for name, load in config.loads.items()}
    field = {"true": shown.field.true, "strain": shown.field.strain, "std": shown.field.std}
    # with other sensors the arrays have several units
    strains = np.all(structure.pool.quantity == STRAIN)
    grid, attributes = gauge_grid(structure.pool.position, field, dict.fromkeys(field, STRAIN_UNIT) if strains else {})
    return Output(
        datasets=grid | written(shown, validation.units),
        attributes=attributes,
        summary=numbers,
        message=_message(validation, claims, decision.withheld),
        tables=(
            _table(validation, bool(decision.withheld)),
            *budget_tables(shown.budget, validation.without),
            *([] if shown.compared is None else [comparison_table(shown.compared, validation.units)]),
            *([] if shown.sweep is None else [sweep_table(shown.sweep)]),
        ),
        files={"measured.csv": _measured_csv(validation.trial, labels, shown.gauge.measured, units)},
    )


def _decision(config: PlacementConfig, validation: Validation) -> Decision:
    """Decide whether σ is withheld: for parameters outside their ranges, and if another filter excludes the estimate."""
    accuracy, trial = validation.validated, validation.trial
    ends = {name: (accuracy.smoothed[name][-1], accuracy.smoothed_std[name][-1]) for name in accuracy.smoothed}
    exclusion = excluded(ends, by_grid(accuracy.compared)) if tolerances_of(config.tolerances) == NONE else ""
    exceeded = out_of_ranges(
        config, trial.problem, {name: accuracy.estimate for name, accuracy in validation.accuracy.items()}
    )
    reasons = (excluded_in_words(exclusion, trial.settled is not None, "train.settle"),)
    return Decision(reasons=reasons, out_of_range=exceeded, remedy=f"widen {ranges_in_words(exceeded)}")


def _watched(using: Resources, activity: str, start: float, end: float) -> Sweep:
    using.progress(activity, start)
    return watched(using.sweep, lambda share: using.progress(activity, start + (end - start) * share))


def _field(trial: Trial, model: FilterModel, run: FilterRun) -> Field:
    """True and estimated strain of every candidate at the instant of the largest true strain."""
    channels = trial.problem.channels
    straining = np.flatnonzero(channels.quantity == STRAIN)
    looked_at = straining if len(straining) else np.arange(len(channels.quantity))
    largest = np.max([np.abs(trial.reading(part)[1:]).max(axis=1) for part in _parts(looked_at)], axis=0)
    instant = index_of_largest(largest) + 1  # after the start
    moving = channels.quantity == ACCELERATION
    assert run.covariance is not None
    true = np.concatenate([trial.reading(part)[instant] for part in _parts(np.arange(len(moving)))])
    strain, J = surface_reading(model, channels.rows, channels.change, run.mean[instant])
    return Field(
        instant=float(trial.time[instant]),
        true=np.where(moving, np.nan, true),
        strain=np.where(moving, np.nan, strain[0]),
        std=np.where(moving, np.nan, output_std(J[0], run.covariance[instant, 0])),
    )


PART = 1000
"""Channels evaluated at a time, to limit memory."""


def _parts(channels: np.ndarray) -> list[np.ndarray]:
    return np.array_split(channels, max(1, len(channels) // PART))


@dataclass(frozen=True)
class Accuracy:
    """Accuracy of an unknown with the layout.

    estimate [SI]: final parameter (mean of the last half if drifting) or RMS of a load; error, std: real and claimed error of the
    filter, smoothed, smoothed_std: of the smoother, all relative to scale [SI]; zero: whether a load is zero, so that scale is
    its amplitude; draws, smoothed_draws: number of independent samples in the RMS, 1 for a parameter; settling_time [s]: until
    the error of a parameter stays within SETTLED, None for a load; rank, benefit: among random layouts, None for too few."""

    estimate: float
    error: float
    std: float
    smoothed: float
    smoothed_std: float
    scale: float
    zero: bool
    draws: int
    smoothed_draws: int
    settling_time: float | None
    rank: Rank | None
    benefit: Benefit | None


def accuracies(
    trial: Trial, model: FilterModel, run: FilterRun, smoothed: Smoothed, random: RandomSetErrors
) -> dict[str, Accuracy]:
    """Accuracy by unknown; random: random layouts of all candidates."""
    error, std = real_and_claimed(trial, model, run.mean, run.std)
    later_error, later_std = real_and_claimed(trial, model, smoothed.mean, smoothed.std)
    accuracy, later = {}, physical(model, smoothed.mean[:, 0], smoothed.std[:, 0])
    for name, (value, sigma) in physical(model, run.mean[:, 0], run.std[:, 0]).items():
        constant = name in trial.problem.unknowns.parameters
        scale, zero = trial.scale(name)
        accuracy[name] = Accuracy(
            estimate=float(
                np.mean(value[trial.constant_from(len(value)) :]) if constant else np.sqrt(np.mean(value**2))
            ),
            error=float(error[name][0]),
            std=float(std[name][0]),
            smoothed=float(later_error[name][0]),
            smoothed_std=float(later_std[name][0]),
            scale=scale,
            zero=zero,
            draws=1 if constant else _draws(value - trial.history[name], sigma),
            smoothed_draws=1 if constant else _draws(later[name][0] - trial.history[name], later[name][1]),
            settling_time=settling_time(trial.time, value, trial.truth.theta[name], SETTLED) if constant else None,
            rank=rank_of(random, name, float(error[name][0]), float(std[name][0])),
            benefit=benefit_of(float(error[name][0]), random.error[name]),
        )
    return accuracy


def _draws(error: np.ndarray, std: np.ndarray) -> int:
    """Number of independent samples in a load error (T + 1,) after the first tenth of the run."""
    scaled = after_start(np.divide(error, std, out=np.full_like(error, np.nan), where=std > 0))
    return max(1, int(np.count_nonzero(np.isfinite(scaled)) / autocorrelation_time(scaled)))


def _measured_csv(trial: Trial, labels: Sequence[str], measured: np.ndarray, units: Mapping[str, str]) -> bytes:
    """CSV of time, channels ("G2.3 [m/m]" is the third grid of G2) and known loads; the first row has loads only.
    labels (k,): of the gauges; measured (T, m): of their channels; units: of the loads."""
    channels = trial.problem.channels.of(trial.gauges)
    which, grid = np.nonzero(channels >= 0)
    quantity = trial.problem.channels.quantity[channels[which, grid]]
    each = zip(which.tolist(), grid.tolist(), quantity.tolist(), strict=True)
    names = [f"{labels[i]}{f'.{j + 1}' if j else ''} [{UNITS[q]}]" for i, j, q in each]
    loads = [f"{name} [{units[name]}]" for name in trial.problem.known]
    first = np.concatenate([trial.time[:1], np.full(len(names), np.nan), trial.known[0, 0]])
    rows = np.vstack([first, np.column_stack([trial.time[1:], measured, trial.known.sum(axis=1)])])
    numbers = (["" if np.isnan(x) else f"{x:.12g}" for x in row] for row in rows)
    return csv_bytes([["time [s]", *names, *loads], *numbers])


def _numbers(validation: Validation, model: str) -> dict[str, Scalar]:
    """Summary numbers; model: of the truth in the config."""
    trial, scheme = validation.trial, scheme_in_words(validation.trial.problem, validation.trial.h)
    stopped = (
        f"number of gauges whose sampled position error was limited by an edge: {trial.stopped}"
        if trial.stopped
        else ""
    )
    consistency = validation.validated.consistency
    numbers: dict[str, Scalar] = {
        "truth": model,
        "description": "; ".join(filter(None, (trial.truth.description, scheme, stopped))),
    }
    for name, accuracy in validation.accuracy.items():
        for key in ("estimate", "error", "std", "draws", "smoothed", "smoothed_std", "smoothed_draws", "scale"):
            numbers[f"{key}.{name}"] = getattr(accuracy, key)
        if name in trial.problem.unknowns.inputs:
            numbers[f"zero.{name}"] = accuracy.zero
        if accuracy.settling_time is not None:
            numbers[f"settling_time.{name}"] = accuracy.settling_time
        if accuracy.benefit is not None:
            numbers[f"benefit.{name}"] = accuracy.benefit.result
        if accuracy.rank is not None:
            numbers |= {f"rank_{key}.{name}": value for key, value in vars(accuracy.rank).items()}
    return (
        numbers
        | posterior_numbers(validation.validated.posterior)
        | ratios(validation.validated.compared)
        | {
            "nees": float(np.mean(consistency.nees)),
            "nis": float(np.mean(consistency.nis)),
            "whiteness": validation.whiteness,
            "verdict": validation.innovation_text,
            "lost_runs": validation.diverged,
        }
    )


def _message(validation: Validation, claims: Mapping[str, tuple[Claim, ...]], withheld: str) -> str:
    """Message of one line, problems first; claims: by unknown, the decisive one first; withheld: why σ is withheld."""
    trial, problem = validation.trial, validation.trial.problem
    words = [*filter(None, (withheld, load_dependence_text(problem), damping_dependence_text(problem)))]
    words += [
        f"the estimate of {name} is {every[0].words(number)}"
        for name, every in claims.items()
        if every and every[0].overconfident
    ]
    words += posterior_doubts(validation.validated.posterior, trial.units)
    words += [
        f"no benefit of the placement for {name}, because {accuracy.benefit.as_well} of {accuracy.benefit.sets} random layouts "
        "of the same size are at least as accurate"
        for name, accuracy in validation.accuracy.items()
        if accuracy.benefit is not None and accuracy.benefit.result == "none"
    ]
    for name, accuracy in validation.accuracy.items():
        if name in trial.problem.unknowns.parameters:
            value = f"{name} {accuracy.estimate:.4g} {trial.units[name]} (true value {trial.truth.theta[name]:.4g})"
            claimed = "" if withheld else f" (claimed σ {100 * accuracy.std:.2g} %)"
            words.append(f"{value}, error {100 * accuracy.error:.2f} %{claimed}")
        else:
            over = f" of its amplitude {accuracy.scale:.4g} N" if accuracy.zero else ""
            words.append(
                f"{name} error {100 * accuracy.error:.1f} %{over} filtered, {100 * accuracy.smoothed:.1f} % smoothed"
            )
    words += disagreements_in_words(validation.validated.compared)
    return "; ".join(words)


MEDIANS = ("random layouts (screened candidates, median)", "random layouts (all candidates, median)")


def _table(validation: Validation, withheld: bool) -> Table:
    """Table of every unknown with the layout, and the median error of random layouts."""
    trial, validated = validation.trial, validation.validated
    columns = ("unknown", "estimate", "true value", "error", "claimed σ", "smoothed", *MEDIANS)
    rows = []
    for name, accuracy in validation.accuracy.items():
        if name in trial.problem.unknowns.parameters:
            rms, truth = "", f"{trial.truth.theta[name]:.5g}"
        else:
            rms, truth = " RMS", f"{np.sqrt(np.mean(trial.history[name] ** 2)):.5g}"
        truth += f" (errors in % of the amplitude {accuracy.scale:.4g})" if accuracy.zero else ""
        medians = (
            f"{100 * np.nanmedian(sets.error[name]):.3f} %" if len(sets.error[name]) else "-"
            for sets in (validated.screened, validated.all)
        )
        errors = [f"{100 * value:.3f} %" for value in (accuracy.error, accuracy.std, accuracy.smoothed)]
        errors[1] = "withheld" if withheld else errors[1]
        rows.append((name, f"{accuracy.estimate:.5g} {trial.units[name]}{rms}", truth, *errors, *medians))
    return Table(f"estimates; simulated test: {trial.truth.description}", columns, tuple(rows))

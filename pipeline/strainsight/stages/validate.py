"""validate: the chosen gauges put to the test on a truth that is not the filter's model (thesis 6.1)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.cases.structure.full_model import FILES, READS
from strainsight.cases.structure.measured_csv import measured_csv
from strainsight.cases.structure.problem import filter_model, filter_options, sample_std, scheme_in_words
from strainsight.cases.structure.studies import Study, identified, ranks, sample_noise, studies_of, study_datasets
from strainsight.cases.structure.sweeps import sweep_datasets, sweep_table, sweeps_of
from strainsight.cases.structure.trial import Trial, real_and_claimed, scaled_error, trial_of
from strainsight.estimation.consistency import chi_square_band, nees, nis, verdict, whiteness
from strainsight.estimation.filter import FilterRun, output_std, run_filter
from strainsight.estimation.model import physical
from strainsight.estimation.smoother import smooth
from strainsight.gauges.candidates import ACCELERATION, STRAIN
from strainsight.ordering import first_of_largest
from strainsight.records.grids import gauge_grid
from strainsight.stages.pages.claims import claims_of, doubt_of
from strainsight.sweep.sweep import watched
from strainsight.workflow.output import Dataset, Output, Scalar, Table
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Simulate the truth, measure it with noise, filter and smooth; then noise levels, repeats and random sets in one batch."""
    context.progress("truth", 0.0)
    trial = trial_of(context)
    context.progress("filter", 0.2)
    model = filter_model(trial.problem, trial.chosen, trial.h)
    noise = sample_noise(context.seed, 0, len(trial.time) - 1, len(trial.chosen))
    true = trial.reading(trial.chosen)[1:]
    measured = true + noise * sample_std(trial.problem, trial.chosen, trial.h)
    main = run_filter(
        model,
        np.zeros(model.size),
        trial.covariance,
        trial.known,
        measured,
        keep="all",
        **filter_options(trial.problem),
    )
    smoothed = smooth(model, main)
    context.progress("noise levels, repeats, random sets", 0.4)
    settings, kept = context.config.validation, context.upstream["screen"]["/kept"]
    watch = watched(
        context.sweep, lambda share: context.progress("noise levels, repeats, random sets", 0.4 + 0.4 * share)
    )
    studies = studies_of(trial, settings, kept, context.seed, watch)
    context.progress("sweeps", 0.8)
    watch = watched(context.sweep, lambda share: context.progress("sweeps", 0.8 + 0.2 * share))
    swept = sweeps_of(trial, settings, context.seed, watch)
    estimate = physical(model, main.mean[:, 0], main.std[:, 0])
    later = physical(model, smoothed.mean[:, 0], smoothed.std[:, 0])
    filtered_error = real_and_claimed(trial, model, main.mean, main.std)
    smoothed_error = real_and_claimed(trial, model, smoothed.mean, smoothed.std)
    errors = dict(zip(("error", "std", "smoothed", "smoothed_std"), (*filtered_error, *smoothed_error), strict=True))
    consistency = (
        nees(scaled_error(trial, main.mean)[1:, 0], main.unknown_covariance[1:, 0]),
        nis(main.whitened[:, 0]),
    )
    summary: dict[str, Scalar] = {
        "truth": str(context.config.validation.truth.model),
        "description": trial.truth.description
        + (f"; {words}" if (words := scheme_in_words(trial.problem, trial.h)) else "")
        + (f"; {trial.stopped} of the layout stopped at an edge" if trial.stopped else ""),
    }
    for name in trial.names:
        summary[f"estimate.{name}"] = _one_number(trial, name, estimate[name][0])
        summary |= {f"{key}.{name}": float(values[name][0]) for key, values in errors.items()}
        summary[f"scale.{name}"], zero = trial.scale(name)
        if name in trial.problem.unknowns.inputs:
            summary[f"zero.{name}"] = zero
    summary |= {f"identified.{name}": answer for name, answer in identified(trial, studies["starts"]).items()}
    summary |= {"nees": float(np.mean(consistency[0])), "nis": float(np.mean(consistency[1]))}
    field = _field(trial, main)
    grid, grid_attributes = gauge_grid(
        context.upstream["train"]["/gauges/position"],
        {path.rpartition("/")[2]: entry.array for path, entry in field.items() if entry.array.ndim},
    )
    summary["whiteness"] = float(whiteness(main.whitened[:, 0]))
    summary["verdict"] = verdict(main.whitened[:, 0]).text
    summary |= ranks(trial, studies["all"], errors["error"], errors["std"])
    summary["lost_runs"] = int(sum(np.isnan(study.real[trial.names[-1]]).sum() for study in studies.values()))
    return Output(
        datasets=grid
        | _histories(trial, estimate, later)
        | _gauges(trial, measured, true, main)
        | _consistency(trial, *consistency)
        | study_datasets(studies, trial)
        | sweep_datasets(swept, trial.names)
        | field,
        attributes=grid_attributes,
        summary=summary,
        message=_message(trial, summary, studies["repeats"]),
        tables=(_table(trial, summary, studies), *([sweep_table(swept, trial.names)] if swept else [])),
        files={"measured.csv": measured_csv(trial, measured, context.upstream["place"]["/selected/final/channel"])},
    )


def _one_number(trial: Trial, name: str, value: np.ndarray) -> float:
    """Mean over the last half of a parameter, RMS of an input."""
    if name in trial.problem.unknowns.parameters:
        return float(np.mean(value[len(value) // 2 :]))
    return float(np.sqrt(np.mean(value**2)))


Histories = Mapping[str, tuple[np.ndarray, np.ndarray]]


def _histories(trial: Trial, estimate: Histories, smoothed: Histories) -> dict[str, Dataset]:
    record = {"/time": Dataset(trial.time, "s", "time of the validation run")}
    for name in trial.names:
        for group, what, values in (
            ("truth", f"true history of {name}", trial.history[name]),
            ("estimate", f"filtered estimate of {name}", estimate[name][0]),
            ("std", f"claimed standard deviation of the filtered {name}", estimate[name][1]),
            ("smoothed", f"smoothed estimate of {name}", smoothed[name][0]),
            ("smoothed_std", f"claimed standard deviation of the smoothed {name}", smoothed[name][1]),
        ):
            record[f"/{group}/{name}"] = Dataset(values, trial.units[name], what, ("/time",))
    return record


def _gauges(trial: Trial, measured: np.ndarray, true: np.ndarray, main: FilterRun) -> dict[str, Dataset]:
    scales = ("/gauge/time", "")
    return {
        "/gauge/time": Dataset(trial.time[1:], "s", "sampling times of the gauges"),
        "/gauge/measured": Dataset(
            measured, "strain", "measured by every channel, with noise, of motion in m/s² or m (time × channel)", scales
        ),
        "/gauge/true": Dataset(true, "strain", "the same without noise (time × channel)", scales),
        "/gauge/estimated": Dataset(main.gauge_mean[:, 0], "strain", "its estimate (time × channel)", scales),
        "/gauge/std": Dataset(
            main.gauge_std[:, 0], "strain", "its claimed standard deviation (time × channel)", scales
        ),
    }


def _consistency(trial: Trial, own_nees: np.ndarray, own_nis: np.ndarray) -> dict[str, Dataset]:
    bands = np.array([chi_square_band(len(trial.names)), chi_square_band(len(trial.chosen), len(own_nis))])
    return {
        "/consistency/nees": Dataset(
            own_nees, "1", "normalised estimation error squared of the unknowns over their number", ("/gauge/time",)
        ),
        "/consistency/nis": Dataset(
            own_nis, "1", "normalised innovation squared over the number of gauges", ("/gauge/time",)
        ),
        "/consistency/band": Dataset(bands, "1", "95 % bands (one instant of NEES, mean NIS of the run × low, high)"),
    }


def _field(trial: Trial, main: FilterRun) -> dict[str, Dataset]:
    """The strain of every candidate, glued or not, at the instant of the largest true strain."""
    n, own = trial.problem.model.size, trial.problem.channels
    straining = np.flatnonzero(own.quantity == STRAIN)
    instant = _instant_of_largest(trial, straining if len(straining) else np.arange(len(own.quantity)))
    still = own.quantity != ACCELERATION
    assert main.covariance is not None
    true = np.where(still, _at_instant(trial, instant, len(own.quantity)), np.nan)
    return {
        "/field/instant": Dataset(np.array(trial.time[instant]), "s", "instant of the largest true strain"),
        "/field/true": Dataset(
            true, "strain", "true strain of every candidate at that instant, of displacement sensors in m, else NaN"
        ),
        "/field/strain": Dataset(
            np.where(still, own.rows @ main.mean[instant, 0, :n], np.nan), "strain", "the same as estimated"
        ),
        "/field/std": Dataset(
            np.where(still, output_std(own.rows, main.covariance[instant, 0, :n, :n]), np.nan),
            "strain",
            "its claimed standard deviation",
        ),
    }


PART = 1000
"""Channels that are read in time at once: pools are large."""


def _at_instant(trial: Trial, instant: int, channels: int) -> np.ndarray:
    parts = np.array_split(np.arange(channels), max(1, channels // PART))
    return np.concatenate([trial.reading(part)[instant] for part in parts])


def _instant_of_largest(trial: Trial, channels: np.ndarray) -> int:
    """Index of the instant at which any of the channels reads most, after the start."""
    parts = np.array_split(channels, max(1, len(channels) // PART))
    largest = np.max([np.abs(trial.reading(part)[1:]).max(axis=1) for part in parts], axis=0)
    return first_of_largest(largest) + 1


def _message(trial: Trial, summary: Mapping[str, Scalar], repeats: Study) -> str:
    said = []
    for name in trial.names:
        error = 100 * float(summary[f"error.{name}"])
        if name in trial.problem.unknowns.parameters:
            value, truth = float(summary[f"estimate.{name}"]), trial.truth.theta[name]
            said.append(f"{name} {value:.4g} {trial.units[name]} (truth {truth:.4g}), error {error:.2f} %")
        else:
            over = f" of its amplitude, {summary[f'scale.{name}']:.4g} N," if summary[f"zero.{name}"] else ""
            smoothed = 100 * float(summary[f"smoothed.{name}"])
            said.append(f"{name} error {error:.1f} %{over} filtered, {smoothed:.1f} % smoothed")
        if doubt := doubt_of(claims_of(name, summary, (repeats.real[name], repeats.claimed[name]))):
            said.append(f"{name} is overconfident: {doubt}")
        if summary.get(f"identified.{name}") is False:
            said.append(f"{name} is not identified: other starts end elsewhere")
    return "; ".join(said)


def _table(trial: Trial, summary: Mapping[str, Scalar], studies: Mapping[str, Study]) -> Table:
    def percent(value: Scalar) -> str:
        return f"{100 * float(value):.3f} %"

    def middle(key: str, name: str) -> str:
        errors = studies[key].real[name]
        return percent(float(np.nanmedian(errors))) if len(errors) else "-"

    def truth(name: str) -> str:
        if name in trial.problem.unknowns.parameters:
            return f"{trial.truth.theta[name]:.5g}"
        rms = f"{np.sqrt(np.mean(trial.history[name] ** 2)):.5g}"
        return rms + (f", in % of its amplitude, {summary[f'scale.{name}']:.4g}" if summary[f"zero.{name}"] else "")

    rows = []
    for name in trial.names:
        parameter = name in trial.problem.unknowns.parameters
        rows.append(
            (
                name,
                f"{summary[f'estimate.{name}']:.5g} {trial.units[name]}" + ("" if parameter else " RMS"),
                truth(name),
                percent(summary[f"error.{name}"]),
                percent(summary[f"std.{name}"]),
                percent(summary[f"smoothed.{name}"]),
                middle("screened", name),
                middle("all", name),
            )
        )
    columns = (
        "unknown",
        "estimate",
        "truth",
        "error",
        "claimed σ",
        "smoothed",
        "random sets, screened: median",
        "all: median",
    )
    return Table(f"estimates; truth: {trial.truth.description}", columns, tuple(rows))


VALIDATE = Stage(
    "validate",
    version=7,
    reads=("seed", "parameters", "loads", "process_noise", "train", "place.estimate", "filter", "validate", *READS),
    upstream=("import", "rom", "train", "screen", "place", "spectrum"),
    files=("parameters.*.guess.from", "loads.*.signal.file", *FILES),
    run=run,
)

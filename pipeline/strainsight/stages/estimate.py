"""estimate: the filter on the measurements of a test (1.53-1.60)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from strainsight.augmentation.linearisation import linearisation_instants, linearise
from strainsight.augmentation.measurement import measurement_rows
from strainsight.augmentation.observability import undetectable_directions, undetectable_in_words
from strainsight.cases.structure.full_model import FILES, READS
from strainsight.cases.structure.measured import Measured, measured_of
from strainsight.cases.structure.problem import (
    Problem,
    filter_model,
    filter_options,
    initial_covariance,
    scheme_in_words,
)
from strainsight.cases.structure.surface import FieldInTime, Virtual, field_in_time, virtual_gauges
from strainsight.cases.structure.trial import PARAMETER_UNITS
from strainsight.errors import InfeasibleError, blame
from strainsight.estimation.biased import Biased
from strainsight.estimation.consistency import Verdict, verdict
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.model import FilterModel, physical
from strainsight.estimation.reduced import Driven
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import Smoothed, smooth
from strainsight.estimation.tuning import Tuning, scale_noise, tune
from strainsight.fem.memory import require_memory
from strainsight.records.estimate import csv_of, estimate_datasets, estimate_table, resultants_of
from strainsight.signals.histories import instant_values
from strainsight.stages import inputs
from strainsight.workflow.output import Dataset, Output, Scalar, Table
from strainsight.workflow.stage import Context, Stage

SHORTER = "give a part of the record at a time, or a larger machine"


@dataclass(frozen=True)
class Estimated:
    """What the filter made of a test: model, its run and the smoothed run, the factors on its noises and the verdict."""

    model: FilterModel
    run: FilterRun
    smoothed: Smoothed
    tuning: Tuning | None
    verdict: Verdict


def run(context: Context) -> Output:
    """Read the file, check that it can tell the unknowns, filter and smooth; then what no gauge measured."""
    settings = context.config.estimate
    problem, place = inputs.problem(context), context.upstream["place"]
    context.progress("reading", 0.0)
    test = measured_of(settings, context.files["estimate.file"], problem, place, inputs.training(context).numbers)
    doubt = _check_observable(context, problem, test.channels, bool(settings.allow_unobservable))
    context.progress("filter", 0.2)
    found = _estimated(context, problem, test)
    context.progress("field", 0.7)
    mesh, basis = inputs.mesh(context), inputs.reduced(context).basis
    q = slice(0, problem.model.size)
    with blame("estimate.virtual"):
        virtual = virtual_gauges(mesh, basis, settings.virtual, context.config.gauges, found.smoothed, q)
    field = (
        None
        if settings.field is None
        else field_in_time(context, mesh, basis, found.model, found.smoothed, settings.field.every)
    )
    return _output(context, problem, test, found, virtual, field, doubt)


def _check_observable(context: Context, problem: Problem, channels: np.ndarray, allowed: bool) -> str:
    """In words what these channels cannot tell, empty where nothing; refused unless allowed."""
    p, u = problem, instant_values(problem.u)
    count = int(context.config.place.instants)
    at = linearisation_instants(p.model, p.unknowns, p.model.reference, p.x, u, count, context.seed)
    rows, quantity = p.channels.rows[channels], p.channels.quantity[channels]
    for F in linearise(p.model, p.unknowns, p.model.reference, p.x[at], u[at]):
        lost = undetectable_directions(F, measurement_rows(rows, quantity, F))
        if lost.shape[1]:
            words = undetectable_in_words(lost, p.unknowns.state_names)
            if allowed:
                return words
            raise InfeasibleError(
                f"the {len(channels)} channels cannot tell {words}",
                key="estimate.channels",
                remedy="give more channels, or go on all the same with --allow-unobservable",
            )
    return ""


def _estimated(context: Context, problem: Problem, test: Measured) -> Estimated:
    settings = context.config.estimate
    model = replace(filter_model(problem, test.channels, test.h), every=test.every)
    # A stated σ is that of a sample of the file.
    r = np.where(np.isnan(test.std), model.r, np.nan_to_num(test.std) ** 2 * test.h * test.every)
    model = replace(model, r=r)
    names = problem.unknowns.names
    initial = {name: float(context.config.validation.initial_std[name]) for name in names}
    initial |= {name: float(value) for name, value in settings.initial_std.items()}
    P = initial_covariance(problem, initial, moving=settings.start == "moving")
    mean, tuning = np.zeros(model.size), None
    if settings.tune.parts:
        context.progress("tuning", 0.3)
        with blame("estimate.tune"):
            tuning = tune(model, mean, P, test.known, test.values, tuple(settings.tune.parts))
        model = scale_noise(model, tuning.factors)
    at = np.flatnonzero(test.bias > 0)
    driven: Any = Driven(model, test.known)
    core = Biased(driven, at) if len(at) else driven
    steps, kept = len(test.values) * test.every, 2 if core.linear else 3
    # covariances of filter and smoother, and the Jacobians between them
    require_memory(8.0 * kept * steps * core.size**2, f"{steps} steps of {core.size} states", SHORTER)
    start = np.zeros(core.size)
    covariance = np.diag(np.concatenate([np.diag(P), test.bias[at] ** 2]))
    samples = np.full((steps, len(test.channels)), np.nan)
    samples[test.every - 1 :: test.every] = test.values
    run = filter_runs(core, start, covariance, samples, keep="all", **filter_options(problem))
    return Estimated(model, run, smooth(core, run, covariance=True), tuning, verdict(run.whitened[:, 0]))


def _output(
    context: Context,
    problem: Problem,
    test: Measured,
    found: Estimated,
    virtual: Virtual,
    field: FieldInTime | None,
    doubt: str,
) -> Output:
    names, run, later = problem.unknowns.names, found.run, found.smoothed
    units = {
        name: "N" if name in problem.unknowns.inputs else PARAMETER_UNITS[context.config.parameters[name].property]
        for name in names
    }
    estimate = physical(found.model, run.mean[:, 0], run.std[:, 0])
    smoothed = physical(found.model, later.mean[:, 0], later.std[:, 0])
    time = test.time[0] + run.time
    resultants = resultants_of(context.config.loads, problem.unknowns.inputs, found.model, later)
    summary: dict[str, Scalar] = {
        "samples": len(test.values),
        "channels": len(test.channels),
        "verdict": found.verdict.text,
    }
    summary |= {"innovation_ratio": found.verdict.ratio, "consistent": bool(found.verdict.consistent)}
    for name in names:
        value, std = smoothed[name]
        parameter = name in problem.unknowns.parameters
        summary[f"estimate.{name}"] = float(np.mean(value)) if parameter else float(np.sqrt(np.mean(value**2)))
        summary[f"std.{name}"] = float(np.sqrt(np.mean(std**2)))
    if found.tuning:
        summary |= {f"factor.{part}": float(value) for part, value in found.tuning.factors.items()}
    if doubt:
        summary["unobservable"] = doubt
    bias = scheme_in_words(problem, test.h)
    notes = [*test.notes, *([bias] if bias else []), *_doubts(found, doubt)]
    return Output(
        datasets=estimate_datasets(time, names, units, estimate, smoothed, test, found, resultants, virtual)
        | ({} if field is None else field.datasets)
        | {"/notes": Dataset(np.array(notes, dtype=np.str_), "1", "what was done to the measurements, and doubts")},
        attributes={} if field is None else field.attributes,
        summary=summary,
        message=_message(summary, names, units),
        tables=(
            estimate_table(names, units, smoothed, problem.unknowns.inputs),
            Table("measurements", ("",), tuple((note,) for note in [*notes, found.verdict.text])),
        ),
        files={"estimate.csv": csv_of(time, names, units, estimate, smoothed, virtual, resultants)},
    )


def _doubts(found: Estimated, doubt: str) -> list[str]:
    said = []
    if doubt:
        said.append(f"the channels cannot tell {doubt}: what is estimated of it comes from the initial values")
    if found.tuning:
        factors = ", ".join(f"{part} {value:.3g}" for part, value in found.tuning.factors.items())
        said.append(f"noises were scaled by the measurements: {factors}")
        if found.tuning.undecided:
            said.append(f"the measurements say nothing about the noise of {', '.join(found.tuning.undecided)}")
    return said


def _message(summary: Mapping[str, Scalar], names: tuple[str, ...], units: Mapping[str, str]) -> str:
    parts = [f"{summary['samples']} samples of {summary['channels']} channels"]
    for name in names:
        what = " RMS" if units[name] == "N" else ""
        parts.append(f"{name} {summary[f'estimate.{name}']:.4g} ± {summary[f'std.{name}']:.2g} {units[name]}{what}")
    if not summary["consistent"]:
        parts.append("the noise does not fit the innovations")
    return ", ".join(parts)


ESTIMATE = Stage(
    "estimate",
    version=3,
    reads=(
        "seed",
        "loads",
        "parameters",
        "process_noise",
        "train",
        "place.estimate",
        "place.instants",
        "validate.initial_std",
        "estimate",
        "filter",
        "gauges.grid_length",
        "gauges.snap_tolerance",
        *READS,
    ),
    upstream=("import", "rom", "train", "screen", "place"),
    files=("loads.*.signal.file", "estimate.file", "parameters.*.guess.from", *FILES),
    run=run,
)

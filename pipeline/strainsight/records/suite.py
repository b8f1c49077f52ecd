"""suite.h5: runs, unknowns, cases and claims as tables; NaN and empty text mark missing values."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

import numpy as np

from strainsight.records.record import dataset, group, record

Rows = TypeVar("Rows")


@record
class RunRows:
    name: tuple[str, ...] = dataset("1", "/name", "name of every run")
    label: tuple[str, ...] = dataset("1", "/name", "label of every run on the results page")
    reached: tuple[str, ...] = dataset("1", "/name", "last completed stage of every run")
    study: tuple[str, ...] = dataset("1", "/name", "name of the study of every run; empty: no study")
    group: tuple[str, ...] = dataset("1", "/name", "name of the group of every run; empty: no group")
    at: np.ndarray = dataset("SI", "/name", "value of the config key that the runs of the study vary")
    gauges: np.ndarray = dataset("1", "/name", "number of gauges in the layout of every run")
    pool: np.ndarray = dataset(
        "1", "/name", "number of candidate gauges in every run that remain after the stage `screen`"
    )
    metric: tuple[str, ...] = dataset("1", "/name", "name of the placement criterion")
    metric_initial: np.ndarray = dataset(
        "1", "/name", "value of the placement criterion with all candidates that remain after the stage `screen`"
    )
    metric_final: np.ndarray = dataset("1", "/name", "value of the placement criterion with the layout")
    gap: np.ndarray = dataset("1", "/name", "optimality gap: (metric_final − lower bound) / metric_final")
    nis: np.ndarray = dataset(
        "1", "/name", "normalised innovation squared (NIS) of the filter, mean over channels and instants"
    )


@record
class UnknownRows:
    """Unknowns, relative to the true parameter, to the RMS of the load (placement), or to the largest true load (bench)."""

    run: np.ndarray = dataset("1", "/name", "index in /run/name of the run of every unknown")
    name: tuple[str, ...] = dataset("1", "/name", "name of every unknown of every run")
    unit: tuple[str, ...] = dataset("1", "/name", "unit of every unknown")
    truth: np.ndarray = dataset("SI", "/name", "true value of a parameter, or RMS of a true load")
    estimate: np.ndarray = dataset("SI", "/name", "estimate of a parameter, or RMS of an estimated load")
    error: np.ndarray = dataset(
        "1",
        "/name",
        "error of the filter estimate. Parameter: final error, relative to the true value. Load: RMS error, relative to the "
        "RMS load (structure) or the largest load (bench)",
    )
    smoothed: np.ndarray = dataset("1", "/name", "error of the smoothed estimate, defined as `error`")
    std: np.ndarray = dataset("1", "/name", "standard deviation of the filter estimate (relative, see `error`)")
    expected: np.ndarray = dataset(
        "1",
        "/name",
        "standard deviation predicted by the stage `place`, relative to the guess (loads: RMS in the stage `train`)",
    )
    repeats_rms: np.ndarray = dataset(
        "1",
        "/name",
        "RMS error of the repeated filter runs that did not diverge (relative, see `error`)",
    )
    repeats_worst: np.ndarray = dataset(
        "1",
        "/name",
        "largest error of the repeated filter runs (relative, see `error`); inf: a run diverged",
    )
    verdict: tuple[str, ...] = dataset("1", "/name", "result of the consistency check for every unknown")
    slope: np.ndarray = dataset("1", "/name", "slope of the linear fit: estimated load = slope · true load + offset")
    offset: np.ndarray = dataset(
        "N or N m", "/name", "offset of the linear fit: estimated load = slope · true load + offset"
    )
    ratio_slope: np.ndarray = dataset(
        "1", "/name", "slope of the linear fit: estimated load = slope · load of the bench in `measured.from` + offset"
    )
    ratio_offset: np.ndarray = dataset(
        "N or N m",
        "/name",
        "offset of the linear fit: estimated load = slope · load of the bench in `measured.from` + offset",
    )


@record
class CaseRows:
    run: np.ndarray = dataset("1", "check", "index in /run/name of the run of every observability check")
    unknowns: tuple[str, ...] = dataset("1", "check", "unknowns of every observability check")
    excitation: tuple[str, ...] = dataset(
        "1",
        "check",
        "excitation of every observability check: load case, training simulation (stage `train`) or frequency",
    )
    condition: np.ndarray = dataset("1", "check", "condition number of the scaled observability (PBH) matrix at λ = 0")
    condition_raw: np.ndarray = dataset(
        "1", "check", "condition number of the unscaled observability (PBH) matrix at λ = 0; depends on units"
    )


@record
class StatementRows:
    text: tuple[str, ...] = dataset("1", "/text", "text of every claim in the config of the suite")
    verdict: tuple[str, ...] = dataset(
        "1", "/text", "result of every claim: confirmed, contradicted, or no number (filter diverged)"
    )
    why: tuple[str, ...] = dataset("1", "/text", "explanation of the result of every claim")


@record
class NumberRows:
    claim: np.ndarray = dataset("1", "number", "claim that uses the number, as index in /claim/text")
    run: np.ndarray = dataset("1", "number", "run that gives the number, as index in /run/name")
    name: tuple[str, ...] = dataset("1", "number", "name of the number in the summary of the stage")
    seed: np.ndarray = dataset("1", "number", "index of the random seed of the run, from 0")
    value: np.ndarray = dataset(
        "SI",
        "number",
        "value of the number, multiplied by `times` of the claim. If the claim has `against`: also divided by the same number "
        "(or `against_number`) of that run",
    )


@record
class ComparisonRows:
    source: tuple[str, ...] = dataset("1", "/source", "location in the publication, such as a figure number")
    statement: tuple[str, ...] = dataset("1", "/source", "statement of the publication that the runs check")
    published: tuple[str, ...] = dataset(
        "1", "/source", "reference value exactly as printed in the publication, as text"
    )
    published_settings: tuple[str, ...] = dataset(
        "1",
        "/source",
        "results of runs with the settings of the publication; in brackets: required range of the result",
    )
    other_settings: tuple[str, ...] = dataset(
        "1", "/source", "results of runs with other settings; in brackets: required range of the result"
    )
    verdict: tuple[str, ...] = dataset(
        "1",
        "/source",
        "comparison of statement and runs: `holds` (with all settings), `holds with the published settings only`, "
        "`holds with other settings only`, or `contradicted`. Without a result: `no number` (filter diverged) or "
        "`not measured` (no run)",
    )
    why: tuple[str, ...] = dataset("1", "/source", "explanation of `verdict`")


@record
class SuiteNumbers:
    """suite.h5."""

    runs: RunRows = group(path="/run")
    unknowns: UnknownRows = group(path="/unknown")
    cases: CaseRows = group(path="/case")
    statements: StatementRows = group(path="/claim")
    numbers: NumberRows = group(path="/number")
    comparisons: ComparisonRows = group(path="/comparison")


def columns(kind: type[Rows], rows: Iterable[Mapping[str, Any]]) -> Rows:
    """Rows as columns of such a table; NaN or empty text for missing values."""
    rows = list(rows)
    columns: dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        cells = [row.get(field.name) for row in rows]
        text = str(field.type).startswith("tuple")
        columns[field.name] = (
            tuple("" if cell is None else str(cell) for cell in cells)
            if text
            else np.array([np.nan if cell is None else cell for cell in cells])
        )
    return kind(**columns)

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
    label: tuple[str, ...] = dataset("1", "/name", "label of the run on the page")
    reached: tuple[str, ...] = dataset("1", "/name", "last stage of the run")
    study: tuple[str, ...] = dataset("1", "/name", "study of the run")
    group: tuple[str, ...] = dataset("1", "/name", "group of the run")
    at: np.ndarray = dataset("SI", "/name", "value of the key varied by the study")
    gauges: np.ndarray = dataset("1", "/name", "number of gauges of the layout")
    pool: np.ndarray = dataset("1", "/name", "number of gauges in the pool")
    metric: tuple[str, ...] = dataset("1", "/name", "name of the placement criterion")
    metric_initial: np.ndarray = dataset("1", "/name", "value of the criterion with the whole pool")
    metric_final: np.ndarray = dataset("1", "/name", "value of the criterion with the layout")
    gap: np.ndarray = dataset("1", "/name", "optimality gap: (criterion of the layout − lower bound) / criterion")
    nis: np.ndarray = dataset("1", "/name", "normalised innovation squared (NIS), mean over the channels")


@record
class UnknownRows:
    """Unknowns, relative to the true parameter, to the RMS of the load (placement), or to the largest true load (bench)."""

    run: np.ndarray = dataset("1", "/name", "row in /run of the run of every unknown")
    name: tuple[str, ...] = dataset("1", "/name", "name of every unknown of every run")
    unit: tuple[str, ...] = dataset("1", "/name", "unit of every unknown")
    truth: np.ndarray = dataset("SI", "/name", "true value of a parameter, or RMS of a load")
    estimate: np.ndarray = dataset("SI", "/name", "estimate of a parameter, or RMS of an estimated load")
    error: np.ndarray = dataset("1", "/name", "actual relative error of the filter")
    smoothed: np.ndarray = dataset("1", "/name", "relative error of the smoother")
    std: np.ndarray = dataset("1", "/name", "relative standard deviation of the filter")
    expected: np.ndarray = dataset("1", "/name", "relative standard deviation predicted by the stage place")
    repeats_rms: np.ndarray = dataset("1", "/name", "relative RMS error of the repetitions that did not diverge")
    repeats_worst: np.ndarray = dataset("1", "/name", "largest relative error of the repetitions; inf if one diverged")
    verdict: tuple[str, ...] = dataset("1", "/name", "result of the consistency check")
    slope: np.ndarray = dataset("1", "/name", "slope of the fit estimate = slope · truth + offset")
    offset: np.ndarray = dataset("N or N m", "/name", "offset of the fit estimate = slope · truth + offset")
    ratio_slope: np.ndarray = dataset(
        "1", "/name", "slope of the fit estimate = slope · load on the measured bench + offset"
    )
    ratio_offset: np.ndarray = dataset(
        "N or N m", "/name", "offset of the fit estimate = slope · load on the measured bench + offset"
    )


@record
class CaseRows:
    run: np.ndarray = dataset("1", "case", "row in /run of the run of every case")
    unknowns: tuple[str, ...] = dataset("1", "case", "unknowns of every case")
    excitation: tuple[str, ...] = dataset("1", "case", "excitation of every case")
    condition: np.ndarray = dataset("1", "case", "condition number of the scaled PBH matrix at λ = 0")
    condition_raw: np.ndarray = dataset(
        "1", "case", "condition number of the unscaled PBH matrix at λ = 0; depends on units"
    )


@record
class StatementRows:
    text: tuple[str, ...] = dataset("1", "/text", "text of every claim")
    verdict: tuple[str, ...] = dataset("1", "/text", "result of every claim: confirmed, contradicted or no number")
    why: tuple[str, ...] = dataset("1", "/text", "explanation of every claim")


@record
class NumberRows:
    claim: np.ndarray = dataset("1", "number", "row in /claim of the claim of every number")
    run: np.ndarray = dataset("1", "number", "row in /run of the run of every number")
    name: tuple[str, ...] = dataset("1", "number", "name of the number in the summary of the stage")
    seed: np.ndarray = dataset("1", "number", "seed number of the run, from 0")
    value: np.ndarray = dataset("SI", "number", "value of the number, after the options `times` and `against`")


@record
class ComparisonRows:
    source: tuple[str, ...] = dataset("1", "/source", "location of the statement in the source")
    statement: tuple[str, ...] = dataset("1", "/source", "statement of the source")
    published: tuple[str, ...] = dataset("1", "/source", "published number, as text")
    published_settings: tuple[str, ...] = dataset(
        "1", "/source", "results with the settings of the source, with limits"
    )
    other_settings: tuple[str, ...] = dataset("1", "/source", "results with other settings, with limits")
    verdict: tuple[str, ...] = dataset("1", "/source", "result of the comparison, with the settings used")
    why: tuple[str, ...] = dataset("1", "/source", "explanation of the comparison")


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

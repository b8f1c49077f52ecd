"""suite.h5: runs, unknowns, cases and statements as tables; NaN and empty text stand for what a run does not have."""

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
    label: tuple[str, ...] = dataset("1", "/name", "what the page calls it")
    reached: tuple[str, ...] = dataset("1", "/name", "its last stage")
    study: tuple[str, ...] = dataset("1", "/name", "its study")
    group: tuple[str, ...] = dataset("1", "/name", "its group")
    at: np.ndarray = dataset("SI", "/name", "value of the key that its study varies")
    gauges: np.ndarray = dataset("1", "/name", "gauges of its layout")
    pool: np.ndarray = dataset("1", "/name", "gauges that these were chosen from")
    metric: tuple[str, ...] = dataset("1", "/name", "what its layout was chosen by")
    metric_initial: np.ndarray = dataset("1", "/name", "metric with the whole pool")
    metric_final: np.ndarray = dataset("1", "/name", "metric of the layout")
    gap: np.ndarray = dataset("1", "/name", "(metric of the layout − lower bound) / metric")
    nis: np.ndarray = dataset("1", "/name", "mean NIS over channels")


@record
class UnknownRows:
    """Of a placement relative to the true parameter or to the RMS of the load, of a bench to the largest true load."""

    run: np.ndarray = dataset("1", "/name", "row of its run")
    name: tuple[str, ...] = dataset("1", "/name", "name of every unknown of every run")
    unit: tuple[str, ...] = dataset("1", "/name", "its unit")
    truth: np.ndarray = dataset("SI", "/name", "true value of a parameter, RMS of a load")
    estimate: np.ndarray = dataset("SI", "/name", "that as estimated")
    error: np.ndarray = dataset("1", "/name", "real error of the filter, relative")
    smoothed: np.ndarray = dataset("1", "/name", "error of the smoother, relative")
    std: np.ndarray = dataset("1", "/name", "error that the filter claims, relative")
    expected: np.ndarray = dataset("1", "/name", "error that place expected, relative")
    repeats_rms: np.ndarray = dataset("1", "/name", "RMS error over the repeats that did not diverge, relative")
    repeats_worst: np.ndarray = dataset("1", "/name", "worst error over the repeats, relative; inf where one diverged")
    verdict: tuple[str, ...] = dataset("1", "/name", "consistent, too cautious, or what is wrong with it")
    slope: np.ndarray = dataset("1", "/name", "slope of the fit estimate = slope · truth + offset")
    offset: np.ndarray = dataset("N or N m", "/name", "offset of the fit of slope")
    ratio_slope: np.ndarray = dataset("1", "/name", "slope of the load over that of the bench that was measured")
    ratio_offset: np.ndarray = dataset("N or N m", "/name", "offset of the fit of ratio_slope")


@record
class CaseRows:
    run: np.ndarray = dataset("1", "case", "row of the run of every case")
    unknowns: tuple[str, ...] = dataset("1", "case", "unknown together")
    excitation: tuple[str, ...] = dataset("1", "case", "name of the excitation")
    condition: np.ndarray = dataset("1", "case", "condition of the scaled PBH matrix at λ = 0")
    condition_raw: np.ndarray = dataset("1", "case", "the same of the unscaled one, which orders cases by units")


@record
class StatementRows:
    text: tuple[str, ...] = dataset("1", "/text", "every statement")
    verdict: tuple[str, ...] = dataset("1", "/text", "confirmed, contradicted or no number")
    why: tuple[str, ...] = dataset("1", "/text", "why, in words")


@record
class NumberRows:
    claim: np.ndarray = dataset("1", "number", "row of the statement of every number")
    run: np.ndarray = dataset("1", "number", "row of its run")
    name: tuple[str, ...] = dataset("1", "number", "its name in the stage's summary")
    seed: np.ndarray = dataset("1", "number", "which seed, from 0")
    value: np.ndarray = dataset("SI", "number", "its value, after times and against")


@record
class ComparisonRows:
    source: tuple[str, ...] = dataset("1", "/source", "where a source says it")
    says: tuple[str, ...] = dataset("1", "/source", "what it says")
    printed: tuple[str, ...] = dataset("1", "/source", "its number, in words")
    as_printed: tuple[str, ...] = dataset("1", "/source", "numbers under its settings, and their bounds")
    ours: tuple[str, ...] = dataset("1", "/source", "numbers under ours, and their bounds")
    verdict: tuple[str, ...] = dataset("1", "/source", "whether it holds, and under which settings")
    why: tuple[str, ...] = dataset("1", "/source", "why, in words")


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
    """Rows as the columns of such a table; NaN or empty text for what a row does not have."""
    rows = list(rows)
    found: dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        cells = [row.get(field.name) for row in rows]
        text = str(field.type).startswith("tuple")
        found[field.name] = (
            tuple("" if cell is None else str(cell) for cell in cells)
            if text
            else np.array([np.nan if cell is None else cell for cell in cells])
        )
    return kind(**found)

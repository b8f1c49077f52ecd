"""The numbers of a suite as datasets and as a table: a row a run, a row an unknown, a row a case."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.report.suite.data import SuiteReport, SuiteRun, metric_name, metrics_of
from strainsight.report.suite.results import Result, results_of
from strainsight.workflow.output import Dataset, Table

NONE = float("nan")


def suite_datasets(report: SuiteReport) -> dict[str, Dataset]:
    """Tables of the runs, of their unknowns and of the cases that each could tell apart; NaN for what was not computed."""
    runs = report.runs
    unknowns = [(i, result.unknown, result) for i, run in enumerate(runs) for result in results_of(run)]
    cases = [(i, case) for i, run in enumerate(runs) for case in run.cases]

    def of_runs(values: Sequence[float | int | None], what: str) -> Dataset:
        return Dataset(_numbers(values), "1", what, ("/run/name",))

    def of_unknowns(values: Sequence[float | None], what: str, unit: str = "1") -> Dataset:
        return Dataset(_numbers(values), unit, what, ("/unknown/name",))

    trends = [run.trend for run in runs]
    return {
        "/run/name": Dataset(_text([run.name for run in runs]), "1", "name of every run"),
        "/run/label": Dataset(_text([run.label for run in runs]), "1", "what the page calls it", ("/run/name",)),
        "/run/reached": Dataset(_text([run.reached for run in runs]), "1", "its last stage", ("/run/name",)),
        "/run/gauges": of_runs([run.gauges for run in runs], "gauges of its layout"),
        "/run/pool": of_runs([run.pool for run in runs], "gauges that these were chosen from"),
        "/run/metric": Dataset(
            _text([trend.metric.symbol if trend else "" for trend in trends]),
            "1",
            "what its layout was chosen by",
            ("/run/name",),
        ),
        "/run/metric_initial": of_runs(
            [trend.value[0] if trend else None for trend in trends], "metric with the whole pool"
        ),
        "/run/metric_final": of_runs([trend.final if trend else None for trend in trends], "metric of the layout"),
        "/run/gap": of_runs(
            [trend.gap if trend else None for trend in trends], "(metric of the layout − lower bound) / metric"
        ),
        "/unknown/run": Dataset(_rows([i for i, _, _ in unknowns]), "1", "row of its run", ("/unknown/name",)),
        "/unknown/name": Dataset(_text([u.name for _, u, _ in unknowns]), "1", "name of every unknown of every run"),
        "/unknown/unit": Dataset(_text([u.unit for _, u, _ in unknowns]), "1", "its unit", ("/unknown/name",)),
        "/unknown/truth": of_unknowns(
            [u.truth for _, u, _ in unknowns], "true value of a parameter, RMS of a load", "SI"
        ),
        "/unknown/estimate": of_unknowns([u.estimate for _, u, _ in unknowns], "the same as estimated", "SI"),
        "/unknown/error": of_unknowns([u.error for _, u, _ in unknowns], "real error of the filter, relative"),
        "/unknown/smoothed": of_unknowns([u.smoothed_error for _, u, _ in unknowns], "the same of the smoother"),
        "/unknown/std": of_unknowns([u.std for _, u, _ in unknowns], "error that the filter claims, relative"),
        "/unknown/expected": of_unknowns(
            [u.expected_std for _, u, _ in unknowns], "error that place expected, relative"
        ),
        "/unknown/repeats_rms": of_unknowns(
            [result.rms for _, _, result in unknowns], "RMS error over the repeats that did not diverge, relative"
        ),
        "/unknown/repeats_worst": of_unknowns(
            [result.worst for _, _, result in unknowns],
            "worst error over the repeats, relative; inf where one diverged",
        ),
        "/unknown/verdict": Dataset(
            _text([result.verdict for _, _, result in unknowns]),
            "1",
            "as claimed, cautious, or what is wrong with it; empty where it was not estimated",
            ("/unknown/name",),
        ),
        "/case/run": Dataset(_rows([i for i, _ in cases]), "1", "row of the run of every case"),
        "/case/unknowns": Dataset(_text([", ".join(case.unknowns) for _, case in cases]), "1", "unknown together"),
        "/case/excitation": Dataset(_text([case.excitation for _, case in cases]), "1", "name of the excitation"),
        "/case/condition": Dataset(
            _numbers([case.condition for _, case in cases]), "1", "condition of the scaled PBH matrix at λ = 0"
        ),
        "/case/condition_raw": Dataset(
            _numbers([case.raw for _, case in cases]), "1", "the thesis's number there, which orders cases by units"
        ),
    }


def suite_tables(report: SuiteReport) -> tuple[Table, ...]:
    """The result for the terminal: a row an unknown of a run."""
    metrics = metrics_of(report.runs)
    columns = (
        "run", "unknown", "gauges", metric_name(metrics), "gap", "error", "smoothed", "claimed σ",
        "expected σ", "repeats", "verdict",
    )  # fmt: skip
    rows = []
    for run in report.runs:
        absent = f"not estimated ({run.reached})"
        for i, result in enumerate(results_of(run)):
            unknown = result.unknown
            rows.append(
                (
                    run.label if i == 0 else "",
                    unknown.name,
                    *(_layout_cells(run, len(metrics) > 1) if i == 0 else ("", "", "")),
                    *(
                        _percent(value)
                        for value in (unknown.error, unknown.smoothed_error, unknown.std, unknown.expected_std)
                    ),
                    *((_repeats(result), result.verdict) if result.error is not None else ("", absent)),
                )
            )
    return (Table(report.title, columns, tuple(rows)),)


def _layout_cells(run: SuiteRun, mixed: bool) -> tuple[str, str, str]:
    if run.trend is None:
        return ("", "", "")
    trend = run.trend
    gap = "" if trend.gap is None else f"{100 * trend.gap:.2g} %"
    metric = f"{trend.metric.symbol}: " * mixed + f"{trend.value[0]:.3g} → {trend.final:.3g}"
    return f"{run.gauges} of {run.pool}", metric, gap


def _repeats(result: Result) -> str:
    if result.rms is None:
        return ""
    lost = f"{result.lost} of {result.repeats} diverged" if result.lost else f"worst {_percent(result.worst)}"
    return f"RMS {_percent(result.rms)}, {lost}"


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2g} %"


def _numbers(values: Sequence[float | int | None]) -> np.ndarray:
    return np.array([NONE if value is None else value for value in values], dtype=float)


def _rows(values: Sequence[int]) -> np.ndarray:
    return np.array(values, dtype=np.int64)


def _text(values: Sequence[str]) -> np.ndarray:
    return np.array(values, dtype=np.str_)

"""The numbers of a suite as a record and as tables for the terminal: a row a run, an unknown, a case, a statement."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from strainsight.records.suite import (
    CaseRows,
    ComparisonRows,
    NumberRows,
    RunRows,
    StatementRows,
    SuiteNumbers,
    UnknownRows,
    columns,
)
from strainsight.report.bench.answer import faults
from strainsight.report.bench.data import BenchRun
from strainsight.report.suite.comparisons import side
from strainsight.report.suite.data import Comparison, PlacementRun, Suite, SuiteRun, metric_name, metrics_of
from strainsight.report.suite.results import Result, results_of
from strainsight.report.suite.statements import measured, target
from strainsight.workflow.output import Table

OF_A_LOAD = ("error", "std", "slope", "offset", "ratio_slope", "ratio_offset")
"""Numbers of a bench's unknown that the file keeps."""
SAID = ("source", "printed", "as_printed", "ours", "verdict")
OF_PLACEMENTS = ("error", "smoothed", "claimed σ", "expected σ", "repeats", "verdict")
OF_BENCHES = ("error", "claimed σ", "slope", "load ratio", "verdict")


def numbers_of(suite: Suite) -> SuiteNumbers:
    """What suite.h5 keeps."""
    statements, runs = suite.statements, list(enumerate(suite.runs))
    return SuiteNumbers(
        runs=columns(RunRows, [_run(run) for run in suite.runs]),
        unknowns=columns(UnknownRows, [{"run": i} | row for i, run in runs for row in _unknowns(run)]),
        cases=columns(
            CaseRows,
            [
                vars(case) | {"run": i - 1, "unknowns": ", ".join(case.unknowns), "condition_raw": case.raw}
                for i, run in suite.placements
                for case in run.cases
            ],
        ),
        statements=columns(StatementRows, [vars(own) | {"verdict": own.verdict} for own in statements]),
        numbers=columns(
            NumberRows,
            [
                {"claim": i, "run": run, "name": name, "seed": seed, "value": value}
                for i, own in enumerate(statements)
                for (run, name), values in own.seeds.items()
                for seed, value in enumerate(values)
            ],
        ),
        comparisons=columns(ComparisonRows, [_comparison(row) for row in suite.comparisons]),
    )


def _comparison(row: Comparison) -> Mapping[str, str]:
    return {
        **{key: getattr(row, key) for key in ("source", "says", "printed", "verdict", "why")},
        "as_printed": side(row.as_printed),
        "ours": side(row.ours),
    }


def _run(run: SuiteRun) -> Mapping[str, Any]:
    if isinstance(run, BenchRun):
        return vars(run) | {"nis": run.number("nis")}
    if (trend := run.trend) is None:
        return vars(run)
    metric = {"metric": trend.metric.symbol, "metric_initial": trend.value[0], "metric_final": trend.final}
    return vars(run) | metric | {"gap": trend.gap}


def _unknowns(run: SuiteRun) -> Iterator[dict[str, Any]]:
    if isinstance(run, BenchRun):
        for own in run.unknowns:
            numbers = {key: run.number(f"{key}.{own.name}") for key in OF_A_LOAD}
            yield {"name": own.name, "unit": own.history.unit, "verdict": _verdict(run, own.name)} | numbers
        return
    for result in results_of(run):
        unknown = result.unknown
        yield vars(unknown) | {
            "smoothed": unknown.smoothed_error,
            "expected": unknown.expected_std,
            "repeats_rms": result.rms,
            "repeats_worst": result.worst,
            "verdict": result.verdict,
        }


def suite_tables(suite: Suite) -> tuple[Table, ...]:
    """Comparisons, statements, and a row an unknown of a run."""
    tables = []
    if suite.comparisons:
        said = tuple(tuple(_comparison(row)[key] for key in SAID) for row in suite.comparisons)
        tables.append(Table("said and measured", ("source", "printed", "as printed, here", "ours", ""), said))
    if suite.statements:
        lines = tuple((own.text, target(own), measured(own), own.verdict) for own in suite.statements)
        tables.append(Table("statements", ("statement", "target", "measured", ""), lines))
    if suite.placements:
        metrics = metrics_of(run for _, run in suite.placements)
        head = ("run", "unknown", "gauges", metric_name(metrics), "gap", *OF_PLACEMENTS)
        rows = tuple(row for _, run in suite.placements for row in _of_placement(run, len(metrics) > 1))
        tables.append(Table(suite.title, head, rows))
    if suite.benches:
        rows = tuple(row for _, run in suite.benches for row in _of_bench(run))
        tables.append(Table(suite.title, ("run", "unknown", *OF_BENCHES), rows))
    return tuple(tables)


def _of_bench(run: BenchRun) -> Iterator[tuple[str, ...]]:
    if not run.unknowns:
        yield run.label, "", f"not estimated ({run.reached})", "", "", "", ""
    for i, unknown in enumerate(run.unknowns):
        error, std, slope, ratio = (
            run.number(f"{key}.{unknown.name}") for key in ("error", "std", "slope", "ratio_slope")
        )
        fits = ("" if value is None else f"{value:.5g}" for value in (slope, ratio))
        yield (
            run.label if i == 0 else "",
            unknown.name,
            _percent(error),
            _percent(std),
            *fits,
            _verdict(run, unknown.name),
        )


def _verdict(run: BenchRun, name: str) -> str:
    """What is wrong with it, else whether its σ holds; empty where that was not judged."""
    return ", ".join(faults(run, name)) or str(run.summary.get(f"claim.{name}", ""))


def _of_placement(run: PlacementRun, mixed: bool) -> Iterator[tuple[str, ...]]:
    for i, result in enumerate(results_of(run)):
        unknown = result.unknown
        values = (unknown.error, unknown.smoothed_error, unknown.std, unknown.expected_std)
        yield (
            run.label if i == 0 else "",
            unknown.name,
            *(_layout_cells(run, mixed) if i == 0 else ("", "", "")),
            *map(_percent, values),
            *(
                (_repeats(result), result.verdict)
                if result.error is not None
                else ("", f"not estimated ({run.reached})")
            ),
        )


def _layout_cells(run: PlacementRun, mixed: bool) -> tuple[str, str, str]:
    if (trend := run.trend) is None:
        return ("", "", "")
    metric = f"{trend.metric.symbol}: " * mixed + f"{trend.value[0]:.3g} → {trend.final:.3g}"
    return f"{run.gauges} of {run.pool}", metric, _percent(trend.gap)


def _repeats(result: Result) -> str:
    if result.rms is None:
        return ""
    lost = f"{result.lost} of {result.repeats} diverged" if result.lost else f"worst {_percent(result.worst)}"
    return f"RMS {_percent(result.rms)}, {lost}"


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2g} %"

"""suite: the page, tables and numbers of several runs, gathered from their artefacts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np

from strainsight import __version__
from strainsight.config.suite_runs import all_of
from strainsight.errors import ConfigError, did_you_mean
from strainsight.estimation.decision import FAULTS
from strainsight.experiment.layout.advice import sigma_text
from strainsight.pages.arrays import rms
from strainsight.pages.bench.data import BenchPageRun
from strainsight.pages.picture.scene import draw_or_explain, look, render_all
from strainsight.pages.placement.data import Repeats
from strainsight.pages.suite.data import (
    CONFIRMED,
    CONTRADICTED,
    HOLDS,
    PlacementRun,
    SourceComparison,
    Statement,
    Suite,
    SuiteRun,
    SuiteStudy,
    measured,
    metric_name,
    metrics_of,
    side,
    target,
)
from strainsight.pages.suite.figures import suite_figures
from strainsight.pages.suite.page import suite_page
from strainsight.pages.suite.summary import counts, results_of, without_benefit
from strainsight.records.bench import BenchEstimated
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read, written
from strainsight.records.reduced import Reduced
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
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Output, Table
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench.report import run_of
from strainsight.stages.pages.page import cases_of, history_of, trend_of, unknown_of, warnings_of
from strainsight.stages.pages.page_layout import layout_of_page


def suite_of(context: Context[SimpleNamespace]) -> Suite:
    """The page's content, run by run. Raises ConfigError for every number that a claim or a study names and no run has."""
    runs: list[SuiteRun] = []
    provenance = {"strainsight": __version__}
    for i, entry in enumerate(context.config.runs):
        context.progress(f"reading {entry.name}", 0.5 * i / len(context.config.runs))
        start = f"runs.{i}.artefacts."
        files = {key.removeprefix(start): path for key, path in context.files.items() if key.startswith(start)}
        up = {stage: Artefact(path) for stage, path in files.items()}
        if hasattr(entry, "loads"):
            runs.append(_placement(entry, up))
        else:
            seeds = read(BenchEstimated, up["estimate"]).seeds if "estimate" in up else {}
            runs.append(BenchPageRun(**_entry_data(entry, up), **run_of(up), seeds=seeds))
        # The digest and not the key, which changes with inputs that made no difference.
        provenance |= {f"{entry.name}, {stage}": up[stage].digest[:16] for stage in (*up,)[-1:]}
    studies = _studies(context.config.studies, runs)
    statements = statements_of(context.config.claims, runs)
    comparisons = tuple(all_of(context.config.comparisons, lambda row: _comparison(row, runs)))
    name, title = str(context.config.name), str(context.config.title)
    return Suite(name, title, tuple(runs), studies, statements, comparisons, provenance)


def _entry_data(entry: Any, up: Mapping[str, Artefact]) -> dict[str, Any]:
    """Data on the page of any run, apart from its artefacts."""
    page = f"../{entry.name}/report.html" if "report" in up else None
    return {key: getattr(entry, key) for key in ("name", "label", "note", "study", "group", "at", "reached")} | {
        "page": page
    }


def _placement(entry: Any, up: Mapping[str, Artefact]) -> PlacementRun:
    described, loads, mesh = vars(entry.unknowns), vars(entry.loads), mesh_from(up["import"])
    names = list(described)
    validate, place = up.get("validate"), up.get("place")
    return PlacementRun(
        **_entry_data(entry, up),
        numbers={stage: artefact.summary for stage, artefact in up.items()},
        unknowns=tuple(unknown_of(name, entry.kind, entry.unit, up) for name, entry in described.items()),
        pool=int(place.summary["pool"]) if place else None,
        trend=trend_of(place) if place else None,
        layout=layout_of_page(mesh, up, loads) if place else None,
        histories=tuple(history_of(name, validate) for name in names) if validate else (),
        cases=cases_of(up["observe"]) if "observe" in up else (),
        frequencies=tuple(read(Reduced, up["rom"]).frequency.tolist()) if "rom" in up else (),
        truth_description=str(validate.summary["description"]) if validate else "",
        warnings=warnings_of(up, names, mesh, loads),
    )


def _studies(described: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[SuiteStudy, ...]:
    """The studies in the order in which the runs name them, with what the suite says more of each."""
    more = {study.name: (i, study) for i, study in enumerate(described)}
    studies = []
    for name in dict.fromkeys(run.study for run in runs if run.study):
        places = tuple(i for i, run in enumerate(runs) if run.study == name)
        if name not in more:
            studies.append(SuiteStudy(name, "", None, (), places))
            continue
        i, study = more[name]
        known = list(dict.fromkeys(key for j in places for key in runs[j].summary if runs[j].number(key) is not None))
        for number in study.numbers:
            if number not in known:
                raise ConfigError(
                    f"no run of the study '{name}' has a result '{number}'",
                    key=f"studies.{i}.numbers",
                    remedy=did_you_mean(number, known, f"the runs have the results {', '.join(known) or '(none)'}"),
                )
        studies.append(SuiteStudy(name, study.note, study.over, tuple(study.numbers), places))
    return tuple(studies)


def statements_of(claims: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[Statement, ...]:
    """Raises ConfigError for every claim about a number that its run does not have."""
    return tuple(all_of(claims, lambda claim: _statement(claim.measure, claim.text, claim.why, runs)))


def _comparison(row: Any, runs: Sequence[SuiteRun]) -> SourceComparison:
    published_settings, other_settings = (
        None if measure is None else _statement(measure, row.statement, "", runs)
        for measure in (row.published_settings, row.other_settings)
    )
    return SourceComparison(row.source, row.statement, row.published, published_settings, other_settings, row.why)


def _statement(measure: Any, text: str, why: str, runs: Sequence[SuiteRun]) -> Statement:
    values, compared = [], ""
    for place in measure.runs:
        for name in measure.number:
            numbers = measure.times * _numbers(measure, runs[place], name, "number")
            if measure.against is not None:
                key = "number" if measure.against_number is None else "against_number"
                divisor = _numbers(measure, runs[measure.against], measure.against_number or name, key)
                # seed by seed, where both have as many
                divisor = divisor if len(divisor) == len(numbers) else divisor[:1]
                numbers = np.divide(numbers, divisor, out=np.full(len(numbers), np.nan), where=divisor != 0)
            values += [(int(place), str(name), float(value)) for value in numbers]
    if measure.against is not None:
        compared = ", ".join(filter(None, (runs[measure.against].label, measure.against_number)))
    return Statement(text, tuple(values), measure.above, measure.below, measure.equals, measure.unit, compared, why)


def _numbers(measure: Any, run: SuiteRun, name: str, key: str) -> np.ndarray:
    """A number of the estimate once a seed, where it has several, else that of the run's summary (1,)."""
    if measure.stage == "estimate" and name in run.seeds:
        return np.asarray(run.seeds[name], dtype=float)
    return np.array([_number(measure, run, name, key)])


def _number(measure: Any, run: SuiteRun, name: str, key: str) -> float:
    """A number of the run's summary; NaN for one that is not there because a filter diverged."""
    numbers = run.numbers[measure.stage]
    value = numbers.get(name)
    if isinstance(value, bool | int | float):
        if isinstance(value, bool) != (measure.equals is not None):
            boolean = isinstance(value, bool)
            what = f"the result '{name}' of run '{run.name}' is {'true or false' if boolean else 'a number'}"
            remedy = "set `equals`, not `above` and `below`" if boolean else "set `above` or `below`, not `equals`"
            raise ConfigError(what, key=measure.key, remedy=remedy)
        return float(value)
    if value is None and numbers.get("lost"):
        return float("nan")
    known = [key for key in numbers if not isinstance(numbers[key], str)]
    what = f"result '{name}' not found in the stage '{measure.stage}' of run '{run.name}'"
    raise ConfigError(
        what, key=f"{measure.key}.{key}", remedy=did_you_mean(name, known, f"use one of {', '.join(known)}")
    )


OF_A_LOAD = ("error", "std", "slope", "offset", "ratio_slope", "ratio_offset")
"""Numbers of a bench's unknown that the file keeps."""
SAID = ("source", "published", "published_settings", "other_settings", "verdict")
OF_PLACEMENTS = ("error", "smoothed error", "claimed σ", "expected σ", "error of repeated filter runs", "consistency")
OF_BENCHES = ("error", "claimed σ", "slope", "load ratio", "consistency")


def numbers_of(suite: Suite) -> SuiteNumbers:
    """Content of suite.h5."""
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
        statements=columns(
            StatementRows, [vars(statement) | {"verdict": statement.result} for statement in statements]
        ),
        numbers=columns(
            NumberRows,
            [
                {"claim": i, "run": run, "name": name, "seed": seed, "value": value}
                for i, statement in enumerate(statements)
                for (run, name), values in statement.seeds.items()
                for seed, value in enumerate(values)
            ],
        ),
        comparisons=columns(ComparisonRows, [_comparison_cells(row) for row in suite.comparisons]),
    )


def _comparison_cells(row: SourceComparison) -> Mapping[str, str]:
    return {
        **{key: getattr(row, key) for key in ("source", "statement", "published", "why")},
        "verdict": row.result,
        "published_settings": side(row.published_settings),
        "other_settings": side(row.other_settings),
    }


def _run(run: SuiteRun) -> Mapping[str, Any]:
    if isinstance(run, BenchPageRun):
        return vars(run) | {"nis": run.number("nis")}
    if (trend := run.trend) is None:
        return vars(run) | {"gauges": run.gauges}
    metric = {"metric": trend.metric.symbol, "metric_initial": trend.value[0], "metric_final": trend.final}
    return vars(run) | metric | {"gauges": run.gauges, "gap": trend.gap}


def _unknowns(run: SuiteRun) -> Iterator[dict[str, Any]]:
    """Numbers and verdict of every unknown by the names of `UnknownRows`."""
    if isinstance(run, BenchPageRun):
        for entry in run.unknowns:
            numbers = {key: run.number(f"{key}.{entry.name}") for key in OF_A_LOAD}
            word = ", ".join(run.faults(entry.name)) or str(run.summary.get(f"claim.{entry.name}", ""))
            yield {"name": entry.name, "unit": entry.unit, "verdict": word} | numbers
        return
    for result in results_of(run):
        unknown, repeats = result.unknown, result.unknown.repeats
        yield vars(unknown) | {
            "smoothed": unknown.smoothed_error,
            "expected": unknown.expected_std,
            "repeats_rms": None if repeats is None else rms(repeats.error),
            "repeats_worst": None if repeats is None else repeats.worst,
            "verdict": result.status,
        }


def suite_tables(suite: Suite) -> tuple[Table, ...]:
    """Comparisons, statements, and a row an unknown of a run."""
    tables = []
    if suite.comparisons:
        compared = tuple(tuple(_comparison_cells(row)[key] for key in SAID) for row in suite.comparisons)
        tables.append(
            Table(
                "published and computed numbers",
                ("source", "published", "computed with published settings", "computed with other settings", "result"),
                compared,
                answer=True,
            )
        )
    if suite.statements:
        lines = tuple((one.text, target(one), measured(one), one.result) for one in suite.statements)
        tables.append(Table("claims", ("claim", "target", "measured", "result"), lines, answer=True))
    metrics = metrics_of(run for _, run in suite.placements)
    placement = ("run", "unknown", "gauges", metric_name(metrics), "gap", *OF_PLACEMENTS)
    for kind, head in ((PlacementRun, placement), (BenchPageRun, ("run", "unknown", *OF_BENCHES))):
        runs = [run for run in suite.runs if isinstance(run, kind)]
        rows = tuple(row for run in runs for row in _rows(run, len(head), len(metrics) > 1))
        if runs:
            tables.append(Table(f"unknowns: {suite.title}", head, rows, answer=True))
    return tuple(tables)


def _rows(run: SuiteRun, columns: int, mixed: bool) -> Iterator[tuple[str, ...]]:
    """A row an unknown; mixed: runs differ in their metric."""
    label, layout = run.label, () if isinstance(run, BenchPageRun) else _layout_cells(run, mixed)
    missing = f"no estimate (the last stage of the run is '{run.reached}')"
    if isinstance(run, BenchPageRun) and not run.unknowns:
        yield (label, "", missing, *[""] * (columns - 3))
    for unknown in _unknowns(run):
        cells = [_percent(unknown[key]) for key in ("error", "smoothed", "std") if key in unknown]
        if (expected := unknown.get("expected")) is not None:
            cells.append(sigma_text(expected, unknown["reference"], unknown["unit"]))
        elif "expected" in unknown:
            cells.append("")
        if isinstance(run, BenchPageRun):
            cells += ["" if (fit := unknown[key]) is None else f"{fit:.5g}" for key in ("slope", "ratio_slope")]
        else:
            cells.append(_repeats(unknown["repeats"]))
            unknown["verdict"] = unknown["verdict"] or missing
        yield (label, unknown["name"], *layout, *cells, unknown["verdict"])
        label, layout = "", ("",) * len(layout)


def _layout_cells(run: PlacementRun, mixed: bool) -> tuple[str, ...]:
    if (trend := run.trend) is None:
        return ("", "", "")
    metric = f"{trend.metric.symbol}: " * mixed + f"{trend.value[0]:.3g} → {trend.final:.3g}"
    return f"{run.gauges} of {run.pool} candidates", metric, _percent(trend.gap)


def _repeats(repeats: Repeats | None) -> str:
    if repeats is None:
        return ""
    lost = (
        f"{repeats.lost} of {len(repeats.error)} runs diverged"
        if repeats.lost
        else f"largest error {_percent(repeats.worst)}"
    )
    return f"RMS error {_percent(rms(repeats.error))}, {lost}"


def _percent(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2g} %"


def run(context: Context[SimpleNamespace]) -> Output:
    """Gather what the page shows, measure the claims, write it as one self-contained file."""
    suite = suite_of(context)
    context.progress("pictures and figures", 0.5)
    with ThreadPoolExecutor(1) as pool:  # the pictures are another process's work
        waiting = pool.submit(_scenes, suite)
        drawings = suite_figures(suite)
        scenes, problem = waiting.result()
    page = suite_page(suite, drawings, scenes).encode()
    results = [statement.result for statement in suite.statements]
    many, estimated, confirmed = len(suite.runs), sum(run.is_estimated for run in suite.runs), results.count(CONFIRMED)
    wrong = ", ".join(f"{len(places)} {word}" for word, places in counts(suite).items() if word in FAULTS)
    none = without_benefit(suite)
    message = f"{wrong} of " * bool(wrong) + f"{many} run{'s' * (many != 1)}, {estimated} with an estimate"
    message += (
        f"; random layouts are as accurate as the selected layout in {len(none)} run{'s' * (len(none) != 1)}"
        * bool(none)
    )
    message += f"; {confirmed} of {len(results)} claims confirmed" if results else ""
    agreeing = sum(row.result == HOLDS for row in suite.comparisons)
    message += f"; {agreeing} of {len(suite.comparisons)} published results confirmed" if suite.comparisons else ""
    message += f"; report.html, {len(page) / 1024:.0f} KiB"
    return Output(
        datasets=written(numbers_of(suite)),
        summary={
            "pictures": len(scenes),
            "figures": len(drawings),
            "runs": many,
            "estimated": estimated,
            "claims": len(results),
            "confirmed": confirmed,
            "contradicted": results.count(CONTRADICTED),
            "comparisons": len(suite.comparisons),
            "hold": agreeing,
        },
        message=message + (f"; no 3D pictures: {problem}" if problem else ""),
        tables=suite_tables(suite),
        files={"report.html": page},
    )


def _scenes(suite: Suite) -> tuple[dict[str, bytes], str]:
    """Run → its picture, and the reason if a picture is missing; runs with the same layout share one."""
    layouts = {run.name: run.layout for _, run in suite.placements if run.layout is not None}
    looks = {name: look(layout) for name, layout in layouts.items()}
    different = {looks[name]: layout for name, layout in layouts.items()}
    if not different:
        return {}, ""
    rendered, problem = draw_or_explain(lambda: render_all(list(different.values())))
    pictures = dict(zip(different, rendered or (), strict=False))
    return {name: pictures[digest] for name, digest in looks.items() if digest in pictures}, problem


SUITE = Stage(
    "suite",
    version=13,
    reads=("name", "title", "runs", "studies", "claims", "comparisons"),
    upstream=(),
    files=("runs.*.artefacts.*",),
    run=run,
)

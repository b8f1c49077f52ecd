"""Everything that the page of a suite shows, gathered from the artefacts of its runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight import __version__
from strainsight.config.suite_runs import all_of
from strainsight.errors import ConfigError, did_you_mean
from strainsight.records.bench_estimated import BenchEstimated
from strainsight.records.mesh import mesh_from
from strainsight.records.placed import Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.report.bench.data import BenchRun
from strainsight.report.picture.layout import Layout
from strainsight.report.placement.data import Unknown
from strainsight.report.suite.data import Comparison, PlacementRun, Statement, Study, Suite, SuiteRun
from strainsight.stages.pages.bench_run import estimate_of, motion_of, warnings_in
from strainsight.stages.pages.page import warnings_of
from strainsight.stages.pages.page_layout import layout_of_page, placed_scale, placed_size
from strainsight.stages.pages.page_numbers import cases_of, history_of, repeats_of, trend_of, unknown_of
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.slices import Slice
from strainsight.workflow.stage import Context

PAGE = "report"
"""The stage of a run that writes its own page, report.html."""
OF_SEEDS = "estimate"
"""The stage that has numbers once a seed."""


def suite_of(context: Context[Slice]) -> Suite:
    """The page's content, run by run. Raises ConfigError for every number that a claim or a study names and no run has."""
    runs: list[SuiteRun] = []
    provenance = {"strainsight": __version__}
    for i, entry in enumerate(context.config.runs):
        context.progress(f"reading {entry.name}", 0.5 * i / len(context.config.runs))
        up = _artefacts(context.files, i)
        runs.append(_placement(entry, up) if "loads" in entry else _bench(entry, up))
        # The digest and not the key, which changes with inputs that made no difference.
        provenance |= {f"{entry.name}, {stage}": up[stage].digest[:16] for stage in (*up,)[-1:]}
    studies = _studies(context.config.studies, runs)
    statements = statements_of(context.config.claims, runs)
    comparisons = comparisons_of(context.config.comparisons, runs)
    name, title = str(context.config.name), str(context.config.title)
    return Suite(name, title, tuple(runs), studies, statements, comparisons, provenance)


def _artefacts(files: Mapping[str, Path], i: int) -> dict[str, Artefact]:
    start = f"runs.{i}.artefacts."
    return {key.removeprefix(start): Artefact(path) for key, path in files.items() if key.startswith(start)}


def _stated(entry: Any, up: Mapping[str, Artefact]) -> dict[str, Any]:
    """What the page shows of any run."""
    return {key: entry[key] for key in ("name", "label", "note", "study", "group", "at", "reached")} | {
        "page": f"../{entry.name}/report.html" if PAGE in up else None,
        "numbers": {stage: artefact.summary for stage, artefact in up.items()},
    }


def _bench(entry: Any, up: Mapping[str, Artefact]) -> BenchRun:
    return BenchRun(
        **_stated(entry, up),
        motion=motion_of(up["simulate"]) if "simulate" in up else None,
        estimate=estimate_of(up["estimate"]) if "estimate" in up else None,
        seeds=read(BenchEstimated, up["estimate"]).seeds if "estimate" in up else {},
        warnings=warnings_in(up),
    )


def _placement(entry: Any, up: Mapping[str, Artefact]) -> PlacementRun:
    names = list(entry.unknowns)
    mesh = mesh_from(up["import"])
    validate, place = up.get("validate"), up.get("place")
    expected = read(Placed, place).expected_std if place else {}
    layout = layout_of_page(mesh, up, entry.loads) if place else None
    return PlacementRun(
        **_stated(entry, up),
        unknowns=tuple(_unknown(name, entry.unknowns[name], up) for name in names),
        gauges=len(layout.gauges) if layout else None,
        pool=int(place.summary["pool"]) if place else None,
        trend=trend_of(place) if place else None,
        layout=layout,
        expected_std={n: expected[n] / placed_size(n, up) for n in names if n in expected},
        histories=tuple(history_of(name, validate) for name in names) if validate else (),
        repeats=repeats_of(names, validate) if validate else (),
        cases=cases_of(up["observe"]) if "observe" in up else (),
        frequencies=tuple(read(Reduced, up["rom"]).frequency.tolist()) if "rom" in up else (),
        truth_description=str(validate.summary["description"]) if validate else "",
        pairs=nearest(layout) if layout else (),
        warnings=warnings_of(up, names, mesh, entry.loads),
    )


def _unknown(name: str, entry: Any, up: Mapping[str, Artefact]) -> Unknown:
    if "validate" in up:
        return unknown_of(name, entry.kind, up)
    guess, expected = _guess(name, entry, up), None
    if "place" in up:
        guess = placed_scale(name, up["place"])
        expected = read(Placed, up["place"]).expected_std[name] / guess
    return Unknown(name=name, unit=entry.unit, kind=entry.kind, guess=guess, expected_std=expected)


def _guess(name: str, entry: Any, up: Mapping[str, Artefact]) -> float:
    """Before anything is placed: a parameter's reference, an input's largest training load; NaN before that is known."""
    if entry.kind == "parameter":
        return read(Reduced, up["rom"]).model.reference.get(name, float("nan")) if "rom" in up else float("nan")
    if "train" not in up:
        return float("nan")
    loads = read(Reduced, up["rom"]).model.inputs
    return float(np.abs(read(Training, up["train"]).load[:, loads.index(name)]).max())


def nearest(layout: Layout) -> tuple[tuple[str, str, float], ...]:
    """Every gauge with its nearest other one and the distance between them [m]."""
    found = []
    for gauge in layout.gauges:
        others = [
            (float(np.linalg.norm(gauge.position - other.position)), other.label)
            for other in layout.gauges
            if other is not gauge
        ]
        if others:
            distance, label = min(others)
            found.append((gauge.label, label, distance))
    return tuple(found)


def _studies(described: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[Study, ...]:
    """The studies in the order in which the runs name them, with what the suite says more of each."""
    more = {study.name: (i, study) for i, study in enumerate(described)}
    found = []
    for name in dict.fromkeys(run.study for run in runs if run.study):
        places = tuple(i for i, run in enumerate(runs) if run.study == name)
        if name not in more:
            found.append(Study(name, "", None, (), places))
            continue
        i, study = more[name]
        known = list(dict.fromkeys(key for j in places for key in runs[j].summary if runs[j].number(key) is not None))
        for number in study.numbers:
            if number not in known:
                raise ConfigError(
                    f"no run of the study '{name}' has a number '{number}'",
                    key=f"studies.{i}.numbers",
                    remedy=did_you_mean(number, known, f"they have {', '.join(known) or 'none'}"),
                )
        found.append(Study(name, study.note, study.over, tuple(study.numbers), places))
    return tuple(found)


def statements_of(claims: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[Statement, ...]:
    """Raises ConfigError for every claim about a number that its run does not have."""
    return tuple(all_of(claims, lambda claim: _statement(claim.measure, claim.text, claim.why, runs)))


def comparisons_of(rows: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[Comparison, ...]:
    """Raises ConfigError for every row about a number that its run does not have."""
    return tuple(all_of(rows, lambda row: _comparison(row, runs)))


def _comparison(row: Any, runs: Sequence[SuiteRun]) -> Comparison:
    as_printed, ours = (
        None if own is None else _statement(own, row.says, "", runs) for own in (row.as_printed, row.ours)
    )
    return Comparison(row.source, row.says, row.printed, as_printed, ours, row.why)


def _statement(measure: Any, text: str, why: str, runs: Sequence[SuiteRun]) -> Statement:
    values = []
    for place in measure.runs:
        for name in measure.number:
            found = measure.times * _numbers(measure, runs[place], name, "number")
            if measure.against is not None:
                key = "number" if measure.against_number is None else "against_number"
                divisor = _numbers(measure, runs[measure.against], measure.against_number or name, key)
                # seed by seed, where both have as many
                divisor = divisor if len(divisor) == len(found) else divisor[:1]
                found = np.divide(found, divisor, out=np.full(len(found), np.nan), where=divisor != 0)
            values += [(int(place), str(name), float(value)) for value in found]
    compared = ""
    if measure.against is not None:
        compared = f"{runs[measure.against].label}" + (f", {measure.against_number}" if measure.against_number else "")
    return Statement(text, tuple(values), measure.above, measure.below, measure.equals, measure.unit, compared, why)


def _numbers(measure: Any, run: SuiteRun, name: str, key: str) -> np.ndarray:
    """A number of the estimate once a seed, where it has several, else that of the run's summary (1,)."""
    if measure.stage == OF_SEEDS and name in run.seeds:
        return np.asarray(run.seeds[name], dtype=float)
    return np.array([_number(measure, run, name, key)])


def _number(measure: Any, run: SuiteRun, name: str, key: str) -> float:
    """A number of the run's summary; NaN for one that is not there because a filter diverged."""
    numbers = run.numbers[measure.stage]
    value = numbers.get(name)
    if isinstance(value, bool | int | float):
        if isinstance(value, bool) != (measure.equals is not None):
            what = f"'{name}' is {'true or false' if isinstance(value, bool) else 'a number'} in '{run.name}'"
            remedy = "give equals: true or false" if isinstance(value, bool) else "give above or below"
            raise ConfigError(what, key=measure.key, remedy=remedy)
        return float(value)
    if value is None and numbers.get("lost"):
        return float("nan")
    known = [own for own, there in numbers.items() if not isinstance(there, str)]
    what = f"no number '{name}' in the stage '{measure.stage}' of '{run.name}'"
    raise ConfigError(what, key=f"{measure.key}.{key}", remedy=did_you_mean(name, known, f"it has {', '.join(known)}"))

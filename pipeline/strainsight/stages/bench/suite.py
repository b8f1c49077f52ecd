"""suite of benches: statements and studies over several runs; everything on the page is read from the runs' artefacts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from strainsight import __version__
from strainsight.errors import ConfigError, did_you_mean
from strainsight.report.bench.data import BenchClaim, BenchRun, BenchStudy, BenchSuite
from strainsight.report.bench.studies import study_figures
from strainsight.report.bench.suite_page import bench_suite_page
from strainsight.stages.pages.bench_run import estimate_of, motion_of, warnings_in
from strainsight.stages.pages.bench_suite_numbers import suite_datasets, suite_tables
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage

PAGE = "report"
"""The stage of a run that writes its own page, report.html."""


def run(context: Context) -> Output:
    """Gather what the page shows, measure the claims, write it as one self-contained file."""
    suite = bench_suite(context)
    drawings = {}
    for i, study in enumerate(suite.studies):
        context.progress(f"figures of {study.name}", 0.5 + 0.5 * i / len(suite.studies))
        drawings[study.name] = study_figures(suite, study)
    page = bench_suite_page(suite, drawings).encode()
    verdicts = [claim.verdict for claim in suite.claims]
    confirmed = verdicts.count("confirmed")
    estimated = sum(1 for run in suite.runs if run.estimate is not None)
    said = f"{len(suite.runs)} run{'s' * (len(suite.runs) != 1)}, {estimated} estimated"
    if verdicts:
        said += f"; {confirmed} of {len(verdicts)} statements confirmed"
    return Output(
        datasets=suite_datasets(suite),
        summary={
            "figures": sum(len(entries) for entries in drawings.values()),
            "runs": len(suite.runs),
            "estimated": estimated,
            "claims": len(verdicts),
            "confirmed": confirmed,
            "contradicted": verdicts.count("contradicted"),
        },
        message=f"{said}; report.html, {len(page) / 1024:.0f} KiB",
        tables=suite_tables(suite),
        files={"report.html": page},
    )


def bench_suite(context: Context) -> BenchSuite:
    """The page's content. Raises ConfigError for every claim about a number that its run does not have."""
    runs, provenance = [], {"strainsight": __version__}
    entries = context.config.runs
    for i, entry in enumerate(entries):
        context.progress(f"reading {entry.name}", 0.5 * i / len(entries))
        up = _artefacts(context.files, i)
        runs.append(_run(entry, up))
        provenance |= {f"{entry.name}, {stage}": up[stage].digest[:16] for stage in (*up,)[-1:]}
    found = tuple(runs)
    return BenchSuite(
        context.name,
        str(context.config.title),
        found,
        _studies(context, found),
        _claims(context.config.claims, found),
        provenance,
    )


def _artefacts(files: Mapping[str, Path], i: int) -> dict[str, Artefact]:
    start = f"runs.{i}.artefacts."
    return {key.removeprefix(start): Artefact(path) for key, path in files.items() if key.startswith(start)}


def _run(entry: Any, up: Mapping[str, Artefact]) -> BenchRun:
    return BenchRun(
        name=entry.name,
        label=entry.label,
        note=entry.note,
        study=entry.study,
        group=entry.group,
        at=None if entry["at"] is None else float(entry["at"]),
        reached=entry.reached,
        page=f"../{entry.name}/report.html" if PAGE in up else None,
        motion=motion_of(up["simulate"]) if "simulate" in up else None,
        estimate=estimate_of(up["estimate"]) if "estimate" in up else None,
        numbers={stage: artefact.summary for stage, artefact in up.items()},
        warnings=warnings_in(up),
    )


def _studies(context: Context, runs: tuple[BenchRun, ...]) -> tuple[BenchStudy, ...]:
    """The studies in the order in which the runs name them, with what the suite says more of each."""
    more = {study.name: study for study in context.config.studies}
    found = []
    for name in dict.fromkeys(run.study for run in runs if run.study):
        places = tuple(i for i, run in enumerate(runs) if run.study == name)
        said = more.get(name)
        if said is not None:
            key = f"studies.{context.config.studies.index(said)}.numbers"
            _refuse_absent(said, [runs[i] for i in places], key)
        found.append(
            BenchStudy(name, "", None, (), places)
            if said is None
            else BenchStudy(name, said.note, said.over, tuple(said.numbers), places)
        )
    return tuple(found)


def _refuse_absent(study: Any, runs: list[BenchRun], key: str) -> None:
    """Raise ConfigError for a number to draw that no run has."""
    known = list(dict.fromkeys(name for run in runs for name in run.told if run.number(name) is not None))
    for name in study.numbers:
        if name not in known:
            what = f"no run of the study '{study.name}' has a number '{name}'"
            raise ConfigError(
                what, key=key, remedy=did_you_mean(name, known, f"they have {', '.join(known) or 'none'}")
            )


def _claims(claims: Any, runs: tuple[BenchRun, ...]) -> tuple[BenchClaim, ...]:
    found, problems = [], []
    for i, claim in enumerate(claims):
        try:
            found.append(_claim(i, claim, runs))
        except ConfigError as error:
            problems.append(error)
    if problems:
        problems[0].others = tuple(problems[1:])
        raise problems[0]
    return tuple(found)


def _claim(i: int, claim: Any, runs: tuple[BenchRun, ...]) -> BenchClaim:
    values = []
    for place in claim.runs:
        for name in claim.number:
            value = claim.times * _number(i, claim, runs[place], name, "number")
            if claim.against is not None:
                key = "number" if claim.against_number is None else "against_number"
                divisor = _number(i, claim, runs[claim.against], claim.against_number or name, key)
                value = value / divisor if divisor else float("nan")
            values.append((int(place), str(name), float(value)))
    compared = ""
    if claim.against is not None:
        compared = f"{runs[claim.against].label}" + (f", {claim.against_number}" if claim.against_number else "")
    return BenchClaim(claim.text, tuple(values), claim.above, claim.below, claim.equals, claim.unit, compared)


def _number(i: int, claim: Any, run: BenchRun, name: str, key: str) -> float:
    """A number of the run's summary; NaN for one that is not there because a filter lost its way."""
    numbers = run.numbers[claim.stage]
    value = numbers.get(name)
    if isinstance(value, bool | int | float):
        if isinstance(value, bool) != (claim.equals is not None):
            what = f"'{name}' is {'true or false' if isinstance(value, bool) else 'a number'} in '{run.name}'"
            remedy = "give equals: true or false" if isinstance(value, bool) else "give above or below"
            raise ConfigError(what, key=f"claims.{i}", remedy=remedy)
        return float(value)
    if value is None and numbers.get("lost"):
        return float("nan")
    known = [own for own, there in numbers.items() if not isinstance(there, str)]
    what = f"no number '{name}' in the stage '{claim.stage}' of '{run.name}'"
    raise ConfigError(what, key=f"claims.{i}.{key}", remedy=did_you_mean(name, known, f"it has {', '.join(known)}"))


BENCH_SUITE = Stage(
    "suite",
    version=2,
    reads=("name", "title", "runs", "studies", "claims"),
    upstream=(),
    files=("runs.*.artefacts.*",),
    run=run,
)

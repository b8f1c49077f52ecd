"""One self-contained page of a suite of benches: statements first, then study by study, then what it rests on."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from strainsight.report.bench.claims import answer, claims_table
from strainsight.report.bench.data import BenchRun, BenchSuite
from strainsight.report.bench.page import FOOTER, STYLES, run_answer
from strainsight.report.bench.tables import MEANINGS, runs_table
from strainsight.report.chart.drawing import Drawing
from strainsight.report.page.document import document
from strainsight.report.page.markup import bullets, figure, pairs, plain, table
from strainsight.report.suite.summary import link


def bench_suite_page(suite: BenchSuite, drawings: Mapping[str, tuple[Drawing, ...]]) -> str:
    """The page as HTML text without any resource outside itself but links to the runs' own pages.

    drawings: study's name → its figures, from `bench_studies.study_figures`.
    """
    parts, count = [], 0
    for place, study in enumerate(suite.studies, start=1):
        shown = drawings.get(study.name, ())
        cards = "".join(figure(entry, i) for i, entry in enumerate(shown, start=count))
        count += len(shown)
        entries = [(_heading(i, suite.runs[i]), suite.runs[i]) for i in study.runs]
        note = f'<p class="lead">{escape(study.note)}</p>' if study.note else ""
        numbers = f'<div class="card">{runs_table(f"runs of study {place}", entries, explained=False)}</div>'
        parts.append(
            f'<section id="study-{place}"><h2>{place}. {escape(study.name)}</h2>{note}{numbers}'
            f'<div class="figures">{cards}</div>{_remarks(suite, study.runs)}</section>'
        )
    alone = tuple(i for i, run in enumerate(suite.runs) if not run.study)
    if alone:
        entries = [(_heading(i, suite.runs[i]), suite.runs[i]) for i in alone]
        title = "Other runs" if suite.studies else "Runs"
        numbers = runs_table("other runs", entries, explained=False)
        parts.append(f'<h2>{title}</h2><div class="card">{numbers}</div>{_remarks(suite, alone)}')
    parts.append(
        f'<details class="card below"><summary>What the columns mean</summary>{bullets(MEANINGS.values())}</details>'
    )
    return document(
        "suite",
        suite.name,
        suite.title,
        answer(suite),
        (claims_table(suite), _contents(suite), *parts, _facts(suite)),
        FOOTER,
        STYLES,
    )


def _contents(suite: BenchSuite) -> str:
    if len(suite.studies) < 2:
        return ""
    items = "".join(
        f'<li><a href="#study-{i}">{escape(study.name)}</a> <small>({_many(len(study.runs))})</small></li>'
        for i, study in enumerate(suite.studies, start=1)
    )
    return f'<nav class="card" aria-label="studies"><h2>Studies</h2><ol class="contents">{items}</ol></nav>'


def _many(runs: int) -> str:
    return f"{runs} run{'s' * (runs != 1)}"


def _heading(index: int, run: BenchRun) -> str:
    page = f'<small class="aside"><br>{link(run.page, "its page")}</small>' if run.page else ""
    return f'<span id="run-{index + 1}">{index + 1}. {escape(run.label)}</span>{page}'


def _remarks(suite: BenchSuite, places: tuple[int, ...]) -> str:
    """Notes and warnings of the runs, what the filter says of each in words."""
    items = ""
    for i in places:
        run = suite.runs[i]
        said = run_answer(run)
        said += f" {escape(run.note)}" if run.note else ""
        said += (
            f"<details><summary>Warnings ({len(run.warnings)})</summary>{bullets(run.warnings)}</details>"
            if run.warnings
            else ""
        )
        if said:
            items += f"<li><strong>{i + 1}. {escape(run.label)}</strong>: {said}</li>"
    return f'<details class="card below"><summary>Run by run</summary><ul>{items}</ul></details>' if items else ""


def _facts(suite: BenchSuite) -> str:
    rows = []
    for i, run in enumerate(suite.runs, start=1):
        numbers = run.motion.numbers if run.motion is not None else {}
        cells = [numbers.get(key) for key in ("coordinates", "constraints", "first_frequency")]
        shown = ["–" if not isinstance(value, int | float) else plain(float(value), 4) for value in cells]
        method = run.told.get("method")
        rows.append([f"{i}. {escape(run.name)}", escape(run.reached), *shown, escape(str(method)) if method else "–"])
    head = ("config", "reached", "coordinates", "constraints", "first frequency [Hz]", "correction")
    cards = f'<section class="card"><h3>Benches</h3>{table("benches", head, rows, numeric=(2, 3, 4))}</section>'
    said = pairs("provenance", suite.provenance.items())
    return f'<h2>What it rests on</h2>{cards}<details class="card"><summary>Provenance</summary>{said}</details>'

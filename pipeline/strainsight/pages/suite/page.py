"""One self-contained HTML page of a suite: statements and an answer a run first, study by study, then what it rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from strainsight.pages.bench.data import BenchRun
from strainsight.pages.bench.page import FOOTER as BENCHES
from strainsight.pages.bench.page import STYLE
from strainsight.pages.bench.tables import MEANINGS, run_answer
from strainsight.pages.bench.tables import runs_table as benches_table
from strainsight.pages.chart.drawing import Drawing
from strainsight.pages.page.markup import (
    AXES,
    axes,
    badge,
    block,
    bullets,
    cell,
    decimals,
    figure,
    figures,
    grouped_table,
    measure,
    pairs,
    plain,
    scene,
    table,
)
from strainsight.pages.page.sections import document
from strainsight.pages.picture.layout import Layout
from strainsight.pages.placement.page import FOOTER as PLACEMENTS
from strainsight.pages.space.section import space_section
from strainsight.pages.suite import data, summary
from strainsight.pages.suite.data import PlacementRun, Suite, SuiteRun
from strainsight.pages.suite.summary import numbered, observability_section
from strainsight.pages.text import number, unbroken

Cards = Mapping[str, str]
"""Key of a drawing → its card."""


def suite_page(suite: Suite, drawings: Sequence[Drawing], scenes: Mapping[str, bytes]) -> str:
    """The page as HTML text without any resource outside itself but links to the runs' own pages.

    drawings from `figures.suite_figures`; scenes: run's name → PNG bytes of its gauges on the structure, those there are.
    """
    cards = {entry.key: figure(entry, i) for i, entry in enumerate(drawings)}
    tables = (data.comparisons_table(suite), data.statements_table(suite))
    first = "".join(tables) + (summary.runs_table(suite) if suite.placements else "")
    turned = suite_space(suite)
    answers = [data.comparisons_answer(suite), summary.answer(suite), data.answer(suite)]
    sections = (
        f'<section id="answer" aria-label="answer" class="card">{first}</section>' if first else "",
        turned,
        figures([cards[key] for key in ("errors", "trends") if key in cards], "<h2>All runs beside each other</h2>"),
        observability_section(suite, cards),
        gauges_section(suite, scenes),
        *_studies(suite, cards),
        _placements(suite, cards),
        _facts(suite),
    )
    footer = " ".join([PLACEMENTS] * bool(suite.placements) + [BENCHES] * bool(suite.benches))
    return document(
        "suite",
        suite.name,
        summary.headline(suite) + suite.title,
        " ".join(filter(None, answers)),
        sections,
        footer,
        STYLE,
        turned=bool(turned),
    )


def _studies(suite: Suite, cards: Cards) -> list[str]:
    """Where to find which study, every one with its runs and figures, and the benches that belong to none."""
    parts = []
    if len(suite.studies) > 1:
        items = "".join(
            f'<li><a href="#study-{i}">{escape(study.name)}</a> '
            f"<small>({len(study.runs)} run{'s' * (len(study.runs) != 1)})</small></li>"
            for i, study in enumerate(suite.studies, start=1)
        )
        parts.append(f'<nav class="card" aria-label="studies"><h2>Studies</h2><ol class="contents">{items}</ol></nav>')
    for place, study in enumerate(suite.studies):
        shown = figures(card for key, card in cards.items() if key.startswith(f"study-{place}-"))
        note = f'<p class="lead">{escape(study.note)}</p>' if study.note else ""
        runs = _benches(suite, study.runs, f"runs of study {place + 1}", shown)
        heading = f"<h2>{place + 1}. {escape(study.name)}</h2>"
        parts.append(f'<section id="study-{place + 1}">{heading}{note}{runs}</section>')
    if alone := [i for i, run in enumerate(suite.runs) if isinstance(run, BenchRun) and not run.study]:
        heading = "Other runs" if suite.studies else "Runs"
        parts.append(f"<h2>{heading}</h2>{_benches(suite, alone, 'other runs')}")
    if suite.benches:
        meanings = bullets(MEANINGS.values())
        parts.append(f'<details class="card below"><summary>What the columns mean</summary>{meanings}</details>')
    return parts


def _benches(suite: Suite, places: Sequence[int], name: str, drawn: str = "") -> str:
    """The numbers of the benches among the runs at these places, the figures, and what the filter says of each in words."""
    entries = [(number, run) for number, run in suite.benches if number - 1 in places]
    if not entries:
        return drawn
    headings = [f'<span id="run-{i}">{i}. {escape(run.label)}</span>' for i, run in entries]
    rows = [
        (heading + summary.link(run, around=summary.ASIDE), run)
        for heading, (_, run) in zip(headings, entries, strict=True)
    ]
    remarks = [(i, run, " ".join(filter(None, (run_answer(run), _remarks(run))))) for i, run in entries]
    items = "".join(f"<li><strong>{i}. {escape(run.label)}</strong>: {text}</li>" for i, run, text in remarks if text)
    words = f'<details class="card below"><summary>Run by run</summary><ul>{items}</ul></details>' if items else ""
    return f'<div class="card">{benches_table(name, rows, explained=False)}</div>{drawn}{words}'


def _remarks(run: SuiteRun) -> str:
    """The note of a run and its warnings."""
    text = f"<p>{escape(run.note)}</p>" if run.note else ""
    if run.warnings:
        text += f"<details><summary>Warnings ({len(run.warnings)})</summary>{bullets(run.warnings)}</details>"
    return text


def _placements(suite: Suite, cards: Cards) -> str:
    """A section a placement: its answer, its note and warnings, and its estimates side by side."""
    if not suite.placements:
        return ""
    text = '<h2>Run by run</h2><p class="lead">Estimate (blue), smoothed (green), truth (dashed).</p>'
    for index, run in suite.placements:
        shown = "".join(card for key, card in cards.items() if key.startswith(f"estimate-{index}-"))
        # Three in a row, or two where three would leave a hole.
        grid = "multiples" if (1 + shown.count("<figure")) % 3 == 0 else "figures"
        words = f"<p>{summary.run_answer(run)}</p>"
        words += (
            f'<p class="note">Truth: {unbroken(escape(run.truth_description))}.</p>' if run.truth_description else ""
        )
        words += _remarks(run)
        text += (
            f'<section id="run-{index}"><h3 class="run">{index}. {escape(run.label)} '
            f"<small>{escape(run.name)}{summary.link(run, 'its own page', ' · {}')}</small></h3>"
            f'<div class="{grid}"><div class="card">{words}</div>{shown}</div></section>'
        )
    return text


def _facts(suite: Suite) -> str:
    """Configs, how far they went, and the numbers of their models."""
    tables = []
    if suite.placements:
        rows = [[*_named(i, run), _modes(run)] for i, run in suite.placements]
        tables.append(table("models", ("config", "reached", "first modes"), rows))
    if suite.benches:
        head = ("config", "reached", "coordinates", "constraints", "first frequency [Hz]", "correction")
        benches = [[*_named(i, run), *_of_bench(run)] for i, run in suite.benches]
        tables.append(table("benches" if suite.placements else "models", head, benches, numeric=(2, 3, 4)))
    provenance = pairs("provenance", suite.provenance.items())
    return (
        f'<h2>What it rests on</h2><section class="card"><h3>Models</h3>{"".join(tables)}</section>'
        f'<details class="card"><summary>Provenance</summary>{provenance}</details>'
    )


def _named(index: int, run: SuiteRun) -> tuple[str, str]:
    return f"{index}. {escape(run.name)}", escape(run.reached)


def _modes(run: PlacementRun) -> str:
    return ", ".join(measure(value, "Hz") for value in run.frequencies[:3]) or "–"


def _of_bench(run: BenchRun) -> list[str]:
    numbers = run.numbers.get("simulate", {})
    cells = [numbers.get(key) for key in ("coordinates", "constraints", "first_frequency")]
    method = run.summary.get("method")
    shown = ["–" if not isinstance(value, int | float) else plain(float(value), 4) for value in cells]
    return [*shown, escape(str(method)) if method else "–"]


def suite_space(report: Suite) -> str:
    """HTML: the structure of the first run that has gauges, with the layouts of all runs on the same one to choose from.

    Equal layouts are offered once, under the numbers of their runs.
    """
    found: dict[bytes, tuple[list[int], Layout]] = {}
    placed = [(index, run.layout) for index, run in report.placements if run.layout is not None]
    for index, layout in placed:
        if _same_structure(layout, placed[0][1]):
            found.setdefault(_look(layout), ([], layout))[0].append(index)
    label = {index: run.label for index, run in report.placements}
    return space_section(
        [(f"{', '.join(f'{index}.' for index in runs)} {label[runs[0]]}", layout) for runs, layout in found.values()]
    )


def gauges_section(report: Suite, scenes: Mapping[str, bytes]) -> str:
    """HTML: pictures of the layouts, equal ones once, and where every gauge sits; scenes: run's name → PNG."""
    shared: dict[bytes, list[int]] = {}
    for index, run in report.placements:
        if run.name in scenes:
            shared.setdefault(scenes[run.name], []).append(index)
    shown = figures(_picture(report, png, numbers) for png, numbers in shared.items())
    placed = [(index, run) for index, run in report.placements if run.layout is not None]
    if not placed:
        return f"<h2>Where the gauges go</h2>{shown}" if shown else ""
    bodies = [_gauge_rows(index, run) for index, run in placed]
    caption = "Gauges that stand together are redundant: they average noise, and one can replace the other."
    head = ("run", "gauge", "element", *AXES, "nearest", "distance")
    numbers = grouped_table("gauges", head, bodies, caption=caption, numeric=(2, 3, 4, 5, 7))
    return (
        f'<h2>Where the gauges go</h2>{shown}<details class="card below"><summary>All gauges of all runs, '
        f"and how near they stand to each other</summary>{numbers}</details>"
    )


def _picture(report: Suite, png: bytes, numbers: list[int]) -> str:
    """One layout with the runs that have it, and how near its gauges stand to each other."""
    run = dict(report.placements)[numbers[0]]
    title = "<br>".join(f"{index}. {escape(report.runs[index - 1].label)}" for index in numbers)
    near = "; ".join(f"{one} – {other} {number(1000 * size, 3)}\u00a0mm" for one, other, size in _distances(run))
    many = f"{run.gauges} gauges of a pool of {run.pool}" if run.gauges is not None else "the gauges"
    alt = f"The structure with {many} of {numbered(tuple(numbers))}" + (
        f"; nearest to each other: {near}." if near else "."
    )
    nearest = f"Nearest to each other: {near}." if near else ""
    shown = scene(png, alt, f"picture of the gauges of {numbered(tuple(numbers))}")
    return f'<figure class="card"><h3>{title}</h3>{shown}<figcaption>{escape(nearest)}</figcaption></figure>'


def _nearest(layout: Layout) -> tuple[tuple[str, str, float], ...]:
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


def _distances(run: PlacementRun) -> list[tuple[str, str, float]]:
    """Every pair of nearest gauges once, the closest first."""
    found: dict[frozenset[str], tuple[str, str, float]] = {}
    for one, other, size in _nearest(run.layout) if run.layout is not None else ():
        found.setdefault(frozenset((one, other)), (one, other, size))
    return sorted(found.values(), key=lambda pair: pair[2])


def _gauge_rows(index: int, run: PlacementRun) -> str:
    assert run.layout is not None
    places = decimals(run.layout.points)
    nearest = {one: (other, size) for one, other, size in _nearest(run.layout)}
    rows = []
    for i, gauge in enumerate(run.layout.gauges):
        other, size = nearest.get(gauge.label, ("", None))
        row = [cell(badge(gauge.label, i, hollow=gauge.bonded)), cell(str(gauge.element), right=True)]
        row += [cell(text, right=True) for text in axes(gauge.position, places)]
        distance = "–" if size is None else measure(1000 * size, "mm", 3)
        rows.append([*row, cell(escape(other) or "–"), cell(distance, right=True)])
    return block(f"{index}. {escape(run.label)}", rows)


def _same_structure(one: Layout, other: Layout) -> bool:
    return np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces)


def _look(layout: Layout) -> bytes:
    """What two layouts have in common that are drawn alike."""
    marks = [
        np.concatenate(
            [gauge.position, *gauge.channels, *(own for arm in gauge.arms for own in (arm.position, arm.direction))]
        )
        for gauge in layout.gauges
    ]
    return b"".join(np.asarray(array, dtype=float).tobytes() for array in (*marks, layout.pool))

"""One self-contained HTML page of a suite: statements and an answer a run first, study by study, then what it rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from strainsight.pages.bench.data import BenchPageRun
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
    unfolding,
)
from strainsight.pages.page.sections import document
from strainsight.pages.picture.layout import PictureLayout
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
    parts, items = [], ""
    for place, study in enumerate(suite.studies, start=1):
        shown = figures(card for key, card in cards.items() if key.startswith(f"study-{place - 1}-"))
        note = f'<p class="lead">{escape(study.note)}</p>' if study.note else ""
        runs = _benches(suite, study.runs, f"runs of study {place}", shown)
        name, many = escape(study.name), f"{len(study.runs)} run{'s' * (len(study.runs) != 1)}"
        items += f'<li><a href="#study-{place}">{name}</a> <small>({many})</small></li>'
        parts.append(f'<section id="study-{place}"><h2>{place}. {name}</h2>{note}{runs}</section>')
    if len(suite.studies) > 1:
        contents = f'<h2>Studies</h2><ol class="contents">{items}</ol>'
        parts.insert(0, f'<nav class="card" aria-label="studies">{contents}</nav>')
    if alone := [i for i, run in enumerate(suite.runs) if isinstance(run, BenchPageRun) and not run.study]:
        heading = "Other runs" if suite.studies else "Runs"
        parts.append(f"<h2>{heading}</h2>{_benches(suite, alone, 'other runs')}")
    if suite.benches:
        parts.append(unfolding("What the columns mean", bullets(MEANINGS.values())))
    return parts


def _benches(suite: Suite, places: Sequence[int], name: str, drawn: str = "") -> str:
    """The numbers of the benches among the runs at these places, the figures, and what the filter says of each in words."""
    rows, items = [], ""
    for i, run in suite.benches:
        if i - 1 in places:
            label = f"{i}. {escape(run.label)}"
            rows.append((f'<span id="run-{i}">{label}</span>{summary.link(run, around=summary.ASIDE)}', run))
            if text := " ".join(filter(None, (run_answer(run), _remarks(run)))):
                items += f"<li><strong>{label}</strong>: {text}</li>"
    if not rows:
        return drawn
    words = unfolding("Run by run", f"<ul>{items}</ul>") if items else ""
    return f'<div class="card">{benches_table(name, rows, explained=False)}</div>{drawn}{words}'


def _remarks(run: SuiteRun) -> str:
    """The note of a run and its warnings."""
    text = f"<p>{escape(run.note)}</p>" if run.note else ""
    if run.warnings:
        text += f"<details><summary>Warnings ({len(run.warnings)})</summary>{bullets(run.warnings)}</details>"
    return text


def _placements(suite: Suite, cards: Cards) -> str:
    """A section a placement: its answer, its note and warnings, and its estimates side by side."""
    text = ""
    for index, run in suite.placements:
        shown = [card for key, card in cards.items() if key.startswith(f"estimate-{index}-")]
        # Three in a row, or two where three would leave a hole.
        grid = "multiples" if (1 + len(shown)) % 3 == 0 else "figures"
        truth = (
            f'<p class="note">Truth: {unbroken(escape(run.truth_description))}.</p>' if run.truth_description else ""
        )
        words = f'<div class="card"><p>{summary.run_answer(run)}</p>{truth}{_remarks(run)}</div>'
        text += (
            f'<section id="run-{index}"><h3 class="run">{index}. {escape(run.label)} '
            f"<small>{escape(run.name)}{summary.link(run, 'its own page', ' · {}')}</small></h3>"
            f"{figures([words, *shown], grid=grid)}</section>"
        )
    lead = '<p class="lead">Estimate (blue), smoothed (green), truth (dashed).</p>'
    return f"<h2>Run by run</h2>{lead}{text}" if text else ""


def _facts(suite: Suite) -> str:
    """Configs, how far they went, and the numbers of their models."""
    tables, names = "", iter(("models", "benches"))
    if suite.placements:
        rows = [[*_named(i, run), _modes(run)] for i, run in suite.placements]
        tables += table(next(names), ("config", "reached", "first modes"), rows)
    if suite.benches:
        head = ("config", "reached", "coordinates", "constraints", "first frequency [Hz]", "correction")
        rows = [[*_named(i, run), *_of_bench(run)] for i, run in suite.benches]
        tables += table(next(names), head, rows, numeric=(2, 3, 4))
    provenance = pairs("provenance", suite.provenance.items())
    return (
        f'<h2>What it rests on</h2><section class="card"><h3>Models</h3>{tables}</section>'
        f'<details class="card"><summary>Provenance</summary>{provenance}</details>'
    )


def _named(index: int, run: SuiteRun) -> tuple[str, str]:
    return f"{index}. {escape(run.name)}", escape(run.reached)


def _modes(run: PlacementRun) -> str:
    return ", ".join(measure(value, "Hz") for value in run.frequencies[:3]) or "–"


def _of_bench(run: BenchPageRun) -> list[str]:
    numbers, method = run.numbers.get("simulate", {}), run.summary.get("method")
    cells = [numbers.get(key) for key in ("coordinates", "constraints", "first_frequency")]
    shown = ["–" if not isinstance(value, int | float) else plain(float(value), 4) for value in cells]
    return [*shown, escape(str(method)) if method else "–"]


def suite_space(report: Suite) -> str:
    """HTML: the structure of the first run that has gauges, with the layouts of all runs on the same one to choose from.

    Equal layouts are offered once, under the numbers of their runs.
    """
    layouts: dict[bytes, tuple[list[int], PictureLayout]] = {}
    placed = [(index, run.layout) for index, run in report.placements if run.layout is not None]
    for index, layout in placed:
        if _same_structure(layout, placed[0][1]):
            layouts.setdefault(_look(layout), ([], layout))[0].append(index)
    label = {index: run.label for index, run in report.placements}
    return space_section(
        [(f"{', '.join(f'{index}.' for index in runs)} {label[runs[0]]}", layout) for runs, layout in layouts.values()]
    )


def gauges_section(report: Suite, scenes: Mapping[str, bytes]) -> str:
    """HTML: pictures of the layouts, equal ones once, and where every gauge sits; scenes: run's name → PNG."""
    shared: dict[bytes, list[int]] = {}
    for index, run in report.placements:
        if run.name in scenes:
            shared.setdefault(scenes[run.name], []).append(index)
    shown, more = figures(_picture(report, png, numbers) for png, numbers in shared.items()), ""
    if bodies := [_gauge_rows(index, run, run.layout) for index, run in report.placements if run.layout is not None]:
        caption = "Gauges that stand together are redundant: they average noise, and one can replace the other."
        head = ("run", "gauge", "element", *AXES, "nearest", "distance")
        numbers = grouped_table("gauges", head, bodies, caption=caption, numeric=(2, 3, 4, 5, 7))
        more = unfolding("All gauges of all runs, and how near they stand to each other", numbers)
    return f"<h2>Where the gauges go</h2>{shown}{more}" if shown or more else ""


def _picture(report: Suite, png: bytes, numbers: list[int]) -> str:
    """One layout with the runs that have it, and how near its gauges stand to each other."""
    run, runs = dict(report.placements)[numbers[0]], numbered(tuple(numbers))
    title = "<br>".join(f"{index}. {escape(report.runs[index - 1].label)}" for index in numbers)
    closest: dict[frozenset[str], tuple[float, str]] = {}
    for one, (other, size) in _nearest(run.layout).items():
        closest.setdefault(frozenset((one, other)), (size, f"{one} – {other} {number(1000 * size, 3)}\u00a0mm"))
    near = "; ".join(words for _, words in sorted(closest.values(), key=lambda pair: pair[0]))
    many = f"{run.gauges} gauges of a pool of {run.pool}" if run.gauges is not None else "the gauges"
    alt = f"The structure with {many} of {runs}{f'; nearest to each other: {near}' * bool(near)}."
    nearest = f"Nearest to each other: {near}." if near else ""
    shown = scene(png, alt, f"picture of the gauges of {runs}")
    return f'<figure class="card"><h3>{title}</h3>{shown}<figcaption>{escape(nearest)}</figcaption></figure>'


def _nearest(layout: PictureLayout | None) -> dict[str, tuple[str, float]]:
    """Gauge → its nearest other one and the distance between them [m]."""
    gauges, nearest = () if layout is None else layout.gauges, {}
    for gauge in gauges:
        others = [(float(np.linalg.norm(gauge.position - g.position)), g.label) for g in gauges if g is not gauge]
        if others:
            distance, label = min(others)
            nearest[gauge.label] = (label, distance)
    return nearest


def _gauge_rows(index: int, run: PlacementRun, layout: PictureLayout) -> str:
    places, nearest = decimals(layout.points), _nearest(layout)
    rows = []
    for i, gauge in enumerate(layout.gauges):
        other, size = nearest.get(gauge.label, ("–", None))
        numbers = [str(gauge.element), *axes(gauge.position, places)]
        distance = "–" if size is None else measure(1000 * size, "mm", 3)
        row = [cell(badge(gauge.label, i, hollow=gauge.bonded)), *(cell(text, right=True) for text in numbers)]
        rows.append([*row, cell(escape(other)), cell(distance, right=True)])
    return block(f"{index}. {escape(run.label)}", rows)


def _same_structure(one: PictureLayout, other: PictureLayout) -> bool:
    return np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces)


def _look(layout: PictureLayout) -> bytes:
    """What two layouts have in common that are drawn alike."""
    marks = [vector for gauge in layout.gauges for position, along, _ in gauge.grids for vector in (position, along)]
    return b"".join(np.asarray(array, dtype=float).tobytes() for array in (*marks, layout.pool))

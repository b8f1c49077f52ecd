"""Self-contained HTML page of a suite: statements, results of runs and studies, models and provenance."""

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
from strainsight.text import number, unbroken

Cards = Mapping[str, str]
"""Key of a drawing → its card."""


def suite_page(suite: Suite, drawings: Sequence[Drawing], scenes: Mapping[str, bytes]) -> str:
    """Self-contained HTML page with links to the pages of the runs.

    drawings: from `figures.suite_figures`; scenes: name of a run → PNG bytes of its gauges on the structure."""
    cards = {entry.key: figure(entry, i) for i, entry in enumerate(drawings)}
    tables = (data.comparisons_table(suite), data.statements_table(suite))
    first = "".join(tables) + (summary.runs_table(suite) if suite.placements else "")
    turned = suite_space(suite)
    answers = [data.comparisons_answer(suite), summary.answer(suite), data.answer(suite)]
    sections = (
        f'<section id="answer" aria-label="answer" class="card">{first}</section>' if first else "",
        turned,
        figures([cards[key] for key in ("errors", "trends") if key in cards], "<h2>Comparison of all runs</h2>"),
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
    """List of studies, every study with its runs and figures, and benches without a study."""
    parts, items = [], ""
    for index, study in enumerate(suite.studies, start=1):
        shown = figures(card for key, card in cards.items() if key.startswith(f"study-{index - 1}-"))
        note = f'<p class="lead">{escape(study.note)}</p>' if study.note else ""
        runs = _benches(suite, study.runs, f"runs of study {index}", shown)
        name, many = escape(study.name), f"{len(study.runs)} run{'s' * (len(study.runs) != 1)}"
        items += f'<li><a href="#study-{index}">{name}</a> <small>({many})</small></li>'
        parts.append(f'<section id="study-{index}"><h2>{index}. {name}</h2>{note}{runs}</section>')
    if len(suite.studies) > 1:
        contents = f'<h2>Studies</h2><ol class="contents">{items}</ol>'
        parts.insert(0, f'<nav class="card" aria-label="studies">{contents}</nav>')
    if alone := [i for i, run in enumerate(suite.runs) if isinstance(run, BenchPageRun) and not run.study]:
        heading = "Other runs" if suite.studies else "Runs"
        parts.append(f"<h2>{heading}</h2>{_benches(suite, alone, 'other runs')}")
    if suite.benches:
        parts.append(unfolding("Explanation of the columns", bullets(MEANINGS.values())))
    return parts


def _benches(suite: Suite, places: Sequence[int], name: str, cards: str = "") -> str:
    """Table, figures and sentences of the benches among the runs at these indices."""
    rows, items = [], ""
    for i, run in suite.benches:
        if i - 1 in places:
            label = f"{i}. {escape(run.label)}"
            rows.append((f'<span id="run-{i}">{label}</span>{summary.link(run, around=summary.ASIDE)}', run))
            if text := " ".join(filter(None, (run_answer(run), _remarks(run)))):
                items += f"<li><strong>{label}</strong>: {text}</li>"
    card = f'<div class="card">{benches_table(name, rows, explained=False)}</div>' if rows else ""
    return f"{card}{cards}{unfolding('Results of the runs', f'<ul>{items}</ul>') if items else ''}"


def _remarks(run: SuiteRun) -> str:
    """Note and warnings of a run."""
    warnings = f"<details><summary>Warnings ({len(run.warnings)})</summary>{bullets(run.warnings)}</details>"
    return f"<p>{escape(run.note)}</p>" * bool(run.note) + warnings * bool(run.warnings)


def _placements(suite: Suite, cards: Cards) -> str:
    """Section of every placement: results, note, warnings and estimates."""
    text = ""
    for index, run in suite.placements:
        shown = [card for key, card in cards.items() if key.startswith(f"estimate-{index}-")]
        # Three cards in a row, or two if three would leave a gap.
        grid = "multiples" if (1 + len(shown)) % 3 == 0 else "figures"
        truth = (
            f'<p class="note">Truth: {unbroken(escape(run.truth_description))}.</p>' if run.truth_description else ""
        )
        words = f'<div class="card"><p>{summary.run_answer(run)}</p>{truth}{_remarks(run)}</div>'
        text += (
            f'<section id="run-{index}"><h3 class="run">{index}. {escape(run.label)} '
            f"<small>{escape(run.name)}{summary.link(run, 'page of the run', ' · {}')}</small></h3>"
            f"{figures([words, *shown], grid=grid)}</section>"
        )
    lead = '<p class="lead">Estimate (blue), smoothed estimate (green) and true value (dashed).</p>'
    return f"<h2>Results of the runs</h2>{lead}{text}" if text else ""


def _facts(suite: Suite) -> str:
    """Configs, last stages, and model data."""
    tables, names, placements, benches = "", iter(("models", "benches")), [], []
    for i, run in enumerate(suite.runs, start=1):
        named = f"{i}. {escape(run.name)}", escape(run.reached)
        if isinstance(run, PlacementRun):
            modes = ", ".join(measure(value, "Hz") for value in run.frequencies[:3])
            placements.append([*named, modes or "–"])
        else:
            simulated = run.numbers.get("simulate", {})
            cells = [simulated.get(key) for key in ("coordinates", "constraints", "first_frequency")]
            shown = ["–" if not isinstance(value, int | float) else plain(float(value), 4) for value in cells]
            benches.append([*named, *shown, escape(str(run.summary.get("method") or "–"))])
    if placements:
        tables += table(next(names), ("config", "last stage", "first natural frequencies"), placements)
    if benches:
        head = ("config", "last stage", "coordinates", "constraints", "first natural frequency [Hz]", "filter method")
        tables += table(next(names), head, benches, numeric=(2, 3, 4))
    provenance = pairs("provenance", suite.provenance.items())
    return (
        f'<h2>Models and provenance</h2><section class="card"><h3>Models</h3>{tables}</section>'
        f'<details class="card"><summary>Provenance</summary>{provenance}</details>'
    )


def suite_space(report: Suite) -> str:
    """3D view of the structure of the first run with gauges, with a selection of the layouts of all runs on this structure.

    Equal layouts occur once, with the numbers of their runs."""
    layouts: dict[bytes, tuple[list[int], PictureLayout]] = {}
    placed = [(index, run.layout) for index, run in report.placements if run.layout is not None]
    for index, layout in placed:
        first = placed[0][1]
        if np.array_equal(layout.points, first.points) and np.array_equal(layout.faces, first.faces):
            grids = [
                vector for gauge in layout.gauges for position, along, _ in gauge.grids for vector in (position, along)
            ]
            look = b"".join(np.asarray(array, dtype=float).tobytes() for array in (*grids, layout.pool))
            layouts.setdefault(look, ([], layout))[0].append(index)
    label = {index: run.label for index, run in report.placements}
    return space_section(
        [(f"{', '.join(f'{index}.' for index in runs)} {label[runs[0]]}", layout) for runs, layout in layouts.values()]
    )


def gauges_section(report: Suite, scenes: Mapping[str, bytes]) -> str:
    """Pictures of the distinct layouts, and gauge positions; scenes: name of a run → PNG."""
    shared: dict[bytes, list[int]] = {}
    for index, run in report.placements:
        if run.name in scenes:
            shared.setdefault(scenes[run.name], []).append(index)
    shown, more = figures(_picture(report, png, numbers) for png, numbers in shared.items()), ""
    if bodies := [_gauge_rows(index, run, run.layout) for index, run in report.placements if run.layout is not None]:
        caption = "Gauges close together mainly average noise."
        head = ("run", "gauge", "element", *AXES, "nearest gauge", "distance to the nearest gauge")
        numbers = grouped_table("gauges", head, bodies, caption=caption, numeric=(2, 3, 4, 5, 7))
        more = unfolding("All gauges of all runs, with distances to the nearest gauge", numbers)
    return f"<h2>Gauge positions</h2>{shown}{more}" if shown or more else ""


def _picture(report: Suite, png: bytes, numbers: list[int]) -> str:
    """One layout with its runs, and distances between neighbouring gauges."""
    run, runs = dict(report.placements)[numbers[0]], numbered(tuple(numbers))
    title = "<br>".join(f"{index}. {escape(report.runs[index - 1].label)}" for index in numbers)
    closest: dict[frozenset[str], tuple[float, str]] = {}
    for one, (size, other) in _nearest(run.layout).items():
        closest.setdefault(frozenset((one, other)), (size, f"{one} – {other} {number(1000 * size, 3)}\u00a0mm"))
    near = "; ".join(words for _, words in sorted(closest.values(), key=lambda pair: pair[0]))
    many = f"{run.gauges} of {run.pool} candidate gauges" if run.gauges is not None else "the gauges"
    alt = f"The structure with {many} of {runs}{f'; shortest distances: {near}' * bool(near)}."
    nearest = f"Shortest distances: {near}." if near else ""
    shown = scene(png, alt, f"picture of the gauges of {runs}")
    return f'<figure class="card"><h3>{title}</h3>{shown}<figcaption>{escape(nearest)}</figcaption></figure>'


def _nearest(layout: PictureLayout | None) -> dict[str, tuple[float, str]]:
    """Gauge → distance [m] to the nearest other gauge, and its label."""
    gauges = () if layout is None or len(layout.gauges) < 2 else layout.gauges
    return {
        gauge.label: min(
            (float(np.linalg.norm(gauge.position - g.position)), g.label) for g in gauges if g is not gauge
        )
        for gauge in gauges
    }


def _gauge_rows(index: int, run: PlacementRun, layout: PictureLayout) -> str:
    places, nearest = decimals(layout.points), _nearest(layout)
    rows = []
    for i, gauge in enumerate(layout.gauges):
        size, other = nearest.get(gauge.label, (None, "–"))
        numbers = [str(gauge.element), *axes(gauge.position, places)]
        distance = measure(None if size is None else 1000 * size, "mm", 3)
        row = [cell(badge(gauge.label, i, hollow=gauge.bonded)), *(cell(text, right=True) for text in numbers)]
        rows.append([*row, cell(escape(other)), cell(distance, right=True)])
    return block(f"{index}. {escape(run.label)}", rows)

"""One self-contained HTML page of a suite: what every run came to in one table first, then what it rests on."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape

from strainsight.report.chart.drawing import Drawing
from strainsight.report.page.document import document
from strainsight.report.page.markup import badge, bullets, figure, grouped_table, measure, pairs, plain, table
from strainsight.report.page.text import number
from strainsight.report.placement.gauge_table import AXES, axes, decimals
from strainsight.report.space.section import STYLE, script
from strainsight.report.suite.cases import groups_of, numbered, series_of
from strainsight.report.suite.data import SuiteReport, SuiteRun
from strainsight.report.suite.space import suite_space
from strainsight.report.suite.summary import answer, link, run_answer, runs_table


def suite_page(report: SuiteReport, drawings: tuple[Drawing, ...], scenes: Mapping[str, bytes]) -> str:
    """The report as HTML text without any resource outside itself but links to the runs' own pages.

    drawings from `suite_figures.suite_figures`; scenes: run's name → PNG bytes of its gauges on the structure, those there are.
    """
    cards = {entry.key: figure(entry, i) for i, entry in enumerate(drawings)}
    turned = suite_space(report)
    sections = (
        f'<section id="answer" aria-label="answer" class="card">{runs_table(report)}</section>',
        turned,
        _overview(cards),
        _observability(report, cards),
        _gauges(report, scenes),
        _runs(report, drawings, cards),
        _facts(report),
    )
    return document(
        "suite",
        report.name,
        report.title,
        answer(report),
        sections,
        "σ is one standard deviation. Relative errors: of a parameter to its true value, of a load to the RMS of all true "
        "loads, after the first tenth of the run.",
        (STYLE,) * bool(turned),
        (script(),) * bool(turned),
    )


def _overview(cards: Mapping[str, str]) -> str:
    shown = "".join(cards[key] for key in ("errors", "trends") if key in cards)
    return f'<h2>All runs beside each other</h2><div class="figures">{shown}</div>' if shown else ""


def _observability(report: SuiteReport, cards: Mapping[str, str]) -> str:
    """The figure beside its excitations and what is lost; the numbers below."""
    series = series_of(report)
    if not series:
        return ""
    groups = groups_of(series)
    motions = [[escape(entry.heading), escape(entry.label)] for entry in series]
    lost = {
        group: list(dict.fromkeys(entry.cases[group].lost for entry in series if group in entry.cases))
        for group in groups
    }
    said = table("excitations", ("excitation of", "label of the first"), motions)
    missing = [[escape(group), "<br>".join(escape(text) for text in texts if text)] for group, texts in lost.items()]
    if missing := [row for row in missing if row[1]]:
        said += '<h3 class="run">Nearly lost at one of them at least</h3>'
        said += table("nearly lost", ("unknown together", "what"), missing)
    rows = [
        [escape(group)]
        + ["–" if group not in entry.cases else plain(entry.cases[group].condition, 3) for entry in series]
        for group in groups
    ]
    head = ["unknown together", *(escape(entry.heading) for entry in series)]
    caption = "Condition number of the scaled Popov-Belevitch-Hautus matrix at λ = 0: whole pool, median over instants."
    numbers = table("conditions", head, rows, caption=caption, numeric=range(1, len(head)))
    return (
        f'<h2>What can be told apart</h2><div class="figures">{cards.get("pbh", "")}<div class="card">{said}</div></div>'
        f'<details class="card below"><summary>The same in numbers</summary>{numbers}</details>'
    )


def _gauges(report: SuiteReport, scenes: Mapping[str, bytes]) -> str:
    """Pictures of the layouts, equal ones once, and where every gauge sits."""
    shared: dict[bytes, list[int]] = {}
    for index, run in enumerate(report.runs, start=1):
        if run.name in scenes:
            shared.setdefault(scenes[run.name], []).append(index)
    shown = "".join(_picture(report, png, numbers) for png, numbers in shared.items())
    shown = f'<div class="figures">{shown}</div>' if shown else ""
    placed = [(index, run) for index, run in enumerate(report.runs, start=1) if run.layout is not None]
    if not placed:
        return f"<h2>Where the gauges go</h2>{shown}" if shown else ""
    bodies = [_gauge_rows(index, run) for index, run in placed]
    caption = "Gauges that stand together read alike: they average noise, and one can stand in for the other."
    head = ("run", "gauge", "element", *AXES, "nearest", "distance")
    numbers = grouped_table("gauges", head, bodies, caption=caption, numeric=(2, 3, 4, 5, 7))
    return (
        f'<h2>Where the gauges go</h2>{shown}<details class="card below"><summary>All gauges of all runs, '
        f"and how near they stand to each other</summary>{numbers}</details>"
    )


def _picture(report: SuiteReport, png: bytes, numbers: list[int]) -> str:
    """One layout with the runs that have it, and how near its gauges stand to each other."""
    run = report.runs[numbers[0] - 1]
    title = "<br>".join(f"{index}. {escape(report.runs[index - 1].label)}" for index in numbers)
    near = "; ".join(f"{one} – {other} {number(1000 * size, 3)}\u00a0mm" for one, other, size in _distances(run))
    many = f"{run.gauges} gauges of a pool of {run.pool}" if run.gauges is not None else "the gauges"
    alt = f"The structure with {many} of {numbered(tuple(numbers))}" + (
        f"; nearest to each other: {near}." if near else "."
    )
    said = f"Nearest to each other: {near}." if near else ""
    label = f"picture of the gauges of {numbered(tuple(numbers))}"
    return (
        f'<figure class="card"><h3>{title}</h3><div class="scene" tabindex="0" role="region" aria-label="{label}">'
        f'<img alt="{escape(alt)}" width="1280" height="840" src="data:image/png;base64,{base64.b64encode(png).decode()}">'
        f"</div><figcaption>{escape(said)}</figcaption></figure>"
    )


def _distances(run: SuiteRun) -> list[tuple[str, str, float]]:
    """Every pair of nearest gauges once, the closest first."""
    found: dict[frozenset[str], tuple[str, str, float]] = {}
    for one, other, size in run.pairs:
        found.setdefault(frozenset((one, other)), (one, other, size))
    return sorted(found.values(), key=lambda pair: pair[2])


def _gauge_rows(index: int, run: SuiteRun) -> str:
    assert run.layout is not None
    places = decimals(run.layout.points)
    nearest = {one: (other, size) for one, other, size in run.pairs}
    rows = []
    for i, gauge in enumerate(run.layout.gauges):
        other, size = nearest.get(gauge.label, ("", None))
        cells = [
            f"<td>{badge(gauge.label, i, hollow=gauge.glued)}</td>",
            f'<td class="n">{gauge.element}</td>',
            *(f'<td class="n">{cell}</td>' for cell in axes(gauge.position, places)),
            f"<td>{escape(other) or '–'}</td>",
            f'<td class="n">{"–" if size is None else measure(1000 * size, "mm", 3)}</td>',
        ]
        many = len(run.layout.gauges)
        heading = f'<th scope="rowgroup" rowspan="{many}">{index}. {escape(run.label)}</th>' if i == 0 else ""
        rows.append(f"<tr>{heading}{''.join(cells)}</tr>")
    return f"<tbody>{''.join(rows)}</tbody>" if rows else ""


def _runs(report: SuiteReport, drawings: tuple[Drawing, ...], cards: Mapping[str, str]) -> str:
    """A section a run: its answer, its note and warnings, and its estimates side by side."""
    text = '<h2>Run by run</h2><p class="lead">Estimate (blue), smoothed (green), truth (dashed).</p>'
    for index, run in enumerate(report.runs, start=1):
        shown = "".join(cards[d.key] for d in drawings if d.key.startswith(f"estimate-{index}-"))
        # Three in a row, or two where three would leave a hole.
        grid = "multiples" if (1 + shown.count("<figure")) % 3 == 0 else "figures"
        own = link(run.page, "its own page") if run.page else ""
        said = f"<p>{run_answer(run)}</p>"
        said += f"<p>{escape(run.note)}</p>" if run.note else ""
        said += f'<p class="note">Truth: {escape(run.truth_description)}.</p>' if run.truth_description else ""
        if run.warnings:
            said += f"<details><summary>Warnings ({len(run.warnings)})</summary>{bullets(run.warnings)}</details>"
        text += (
            f'<section id="run-{index}"><h3 class="run">{index}. {escape(run.label)} '
            f"<small>{escape(run.name)}{' · ' + own if own else ''}</small></h3>"
            f'<div class="{grid}"><div class="card">{said}</div>{shown}</div></section>'
        )
    return text if report.runs else ""


def _facts(report: SuiteReport) -> str:
    """Configs, how far they went, and the modes of their models."""
    rows = [
        [
            f"{index}. {escape(run.name)}",
            escape(run.reached),
            ", ".join(measure(value, "Hz") for value in run.frequencies[:3]) or "–",
        ]
        for index, run in enumerate(report.runs, start=1)
    ]
    cards = (
        f'<section class="card"><h3>Models</h3>{table("models", ("config", "reached", "first modes"), rows)}</section>'
    )
    if report.provenance:
        cards += f'<section class="card"><h3>Provenance</h3>{pairs("provenance", report.provenance.items())}</section>'
    return f'<h2>What it rests on</h2><div class="panels">{cards}</div>'

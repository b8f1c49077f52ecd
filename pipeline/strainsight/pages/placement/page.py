"""HTML page of a placement: answer first, then details."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

import numpy as np

from strainsight.estimation.decision import WITHHELD
from strainsight.pages.chart.drawing import Drawing
from strainsight.pages.page import markup, sections
from strainsight.pages.page.markup import data, figures, folded, measure, plain, select_figures, share, table
from strainsight.pages.page.problems import faults, headline
from strainsight.pages.placement.data import PlacementReport
from strainsight.pages.placement.first_screen import answer, first_screen
from strainsight.pages.placement.gauge_table import (
    cases_table,
    criteria_meaning,
    criteria_table,
    gauge_table,
    load_cases_table,
)
from strainsight.pages.sheets.sheet import sheets_section
from strainsight.pages.space.model import ShownState
from strainsight.runner.output import Table
from strainsight.text import capital, unbroken

INFLUENCE = (
    "The parameters have their guess. The condition number is that of the columns of the unknown loads, relative to noise; a "
    "large number means that the readings hardly separate these loads."
)

FOOTER = (
    "σ is one standard deviation. Expected σ: predicted by the placement for the filter, relative to the guess of a "
    "parameter or to the RMS of a load in the training simulation. Claimed σ: computed by the filter in the simulated test; it "
    "and errors are relative to the true value of a parameter or to the true RMS of a load. If the RMS of a load is zero, its "
    "configured amplitude is the reference. Errors and σ of loads omit the first tenth of the run. Smoothed: estimate of the "
    "smoother. Steady-state σ: only for ranking layouts."
)

RANDOM = markup.titled(
    "Comparison with random layouts", "Errors of the estimates with random layouts of the same number of gauges."
)
TEST_PAGE = "test.html"
"""Page of the test in the same folder."""


def placement_page(
    report: PlacementReport,
    drawings: tuple[Drawing, ...],
    scene: bytes | None,
    scene_problem: str = "",
    shapes: tuple[ShownState, ...] = (),
    sheets: tuple[bytes, ...] = (),
) -> str:
    """Self-contained HTML text of a placement page.

    drawings: from `figures.placement_figures`; scene: PNG bytes from `scene.render`, or None with the reason `scene_problem`;
    shapes: states of the 3D view; sheets: drawing sheets as SVG."""
    link = f'<a href="{TEST_PAGE}">page of the test</a>'
    words = f"<p>{escape(report.test)}. See the {link}.</p>"
    words += "<p>The rest of this page refers to a simulated test.</p>" * (report.noise is not None)
    parts = (
        first_screen(report, scene, scene_problem, shapes),
        sections.notes_card("Test", words * bool(report.test)),
        sections.section("Remark", escape(report.settings.remark).replace("\n", "<br>"), "remark"),
        sections.warnings_section(report.warnings),
        sections.section("Gauges", gauge_table(report)),
        _influence(report.influence),
        sections.section("Load cases", load_cases_table(report), "load-cases"),
        sections.budget_section(report.budget),
        sections.advice_card(report.advice),
        _validation(report, drawings),
        f'<div class="details">{"".join(_details(report, drawings, sheets))}</div>',
    )
    title = headline((unknown.name, faults(unknown)) for unknown in report.unknowns) + report.title
    return sections.document("gauge placement", report.name, title, answer(report), parts, FOOTER, turned=True)


def _details(report: PlacementReport, drawings: tuple[Drawing, ...], sheets: tuple[bytes, ...]) -> Iterator[str]:
    """Sections that are not printed."""
    yield figures(select_figures(drawings, "frequency-response"), "<h2>Frequency response</h2>")
    yield sheets_section(sheets)
    meaning = f'<div class="card">{criteria_meaning(report.metrics)}</div>' * bool(report.criteria)
    cards = "".join(select_figures(drawings, "trend")) + meaning
    rules = criteria_table(report.trend, report.metrics, report.criteria, report.units)
    below = f'<div class="card below">{rules}</div>'
    yield sections.section("Quality of the layout", cards, kind="figures", more=below)
    strains = all(signal.unit == "strain" for signal in report.gauge_signals)
    heading = markup.titled(
        "Gauge strains" if strains else "Readings", "Measured and estimated readings of each gauge."
    )
    yield folded(select_figures(drawings, "signal-"), heading=heading)
    yield figures(select_figures(drawings, "random-"), RANDOM)
    yield figures([*select_figures(drawings, "noise", "repeats-"), *_noise(report)], "<h2>Noise and repeats</h2>")
    yield sections.filters_section(report.filters, report.units)
    yield _observability(report)
    time = sections.panel("Computing time", _time(report))
    yield sections.provenance_section(report.facts, report.provenance, time)
    rows = [[*map(escape, row)] for row in report.assumes]
    assumes = table("assumptions", ("item", "number", "detail"), rows, numeric=(1,)) if rows else ""
    yield sections.section("Model assumptions", assumes, "assumes")


def _validation(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    """Errors and claimed σ of the simulated test, with the estimates over time."""
    if report.noise is None:
        return ""
    rows = [
        [
            escape(one.name),
            measure(one.truth, one.unit),
            measure(one.estimate, one.unit),
            share(one.error),
            WITHHELD if one.withheld else share(one.std),
            share(one.smoothed_error if one.kind == "input" else None),
            "<br>".join(claim.words(plain, limit=False) for claim in one.claims) or "–",
        ]
        for one in report.unknowns
    ]
    head = ("unknown", "true value, RMS", "estimate, RMS", "error", "claimed σ", "error, smoothed", "calibration of σ")
    caption = f"Truth: {unbroken(escape(report.truth_description))}. Of a load: RMS."
    numbers = table("simulated test", head, rows, caption=caption, numeric=range(1, 6))
    shown = figures(select_figures(drawings, "estimate-", "closing-", "posterior-"))
    return sections.section("Simulated test", numbers, more=shown)


def _influence(matrix: Table | None) -> str:
    if matrix is None:
        return ""
    rows = [[*map(escape, row[:2]), *(data(float(x), x) for x in row[2:])] for row in matrix.rows]
    head, caption = [*map(escape, matrix.columns)], f"{capital(matrix.title)}. {INFLUENCE}"
    return sections.section(
        "Influence matrix", table("influence", head, rows, caption=caption, numeric=range(2, len(head)))
    )


def _noise(report: PlacementReport) -> list[str]:
    """Card with errors and claimed σ by gauge noise."""
    if (noise := report.noise) is None:
        return []
    columns = {"gauge noise": noise.level}
    for name in report.units:
        columns |= {f"error of {escape(name)}": noise.error[name], f"claimed σ of {escape(name)}": noise.std[name]}
    rows = [list(map(share, row)) for row in np.column_stack([*columns.values()]).tolist()]
    caption = "True error and claimed σ; gauge noise relative to the largest RMS reading of a candidate."
    numbers = table("noise", list(columns), rows, caption=caption, numeric=range(1, len(columns)))
    return [f'<div class="card">{numbers}</div>']


def _observability(report: PlacementReport) -> str:
    cards = []
    if report.observability:
        rows = [[escape(name), plain(value)] for name, value in report.observability.items()]
        caption = (
            "Popov-Belevitch-Hautus matrix at λ = 0 of the augmented system: "
            "a larger condition number means weaker observability."
        )
        cards.append(table("observability", ("observability", "number"), rows, caption=caption, numeric=(1,)))
    if report.consistency:
        rows = [
            [
                escape(check.name),
                plain(check.value, 3),
                f"{plain(check.band[0], 2)} to {plain(check.band[1], 3)}",
                sections.consistency_mark(check.result),
            ]
            for check in report.consistency
        ]
        caption = (
            "Number: normalised estimation error squared (NEES) or normalised innovation squared (NIS), per dimension; "
            "ideally 1. Band: range of the number if σ is calibrated."
        )
        head = ("check", "number", "band", "result")
        cards.append(table("consistency", head, rows, caption=caption, numeric=(1, 2)))
    if report.frequencies:
        rows = [[str(i), measure(value, "Hz")] for i, value in enumerate(report.frequencies, start=1)]
        caption = "Natural frequencies of the model with the initial guess of the parameters."
        cards.append(table("modes", ("mode", "frequency"), rows, caption=caption, numeric=(1,)))
    body = figures((f'<div class="card">{card}</div>' for card in cards), grid="panels")
    if report.cases:
        body = f'<div class="card"><h3>Observability of groups of unknowns</h3>{cases_table(report.cases)}</div>{body}'
    return f"<h2>Observability, consistency, modes</h2>{body}" if body else ""


def _time(report: PlacementReport) -> str:
    """Table of computing time by stage."""
    if not report.seconds:
        return ""
    total = sum(report.seconds.values())
    rows = [
        [escape(stage), measure(time, "s", 3), share(time / total) if total > 0 else "–"]
        for stage, time in report.seconds.items()
    ]
    foot = ("all stages", measure(total, "s", 3), "")
    caption = "Computing time of each stage. For a result reused from another run, it is the time of the original computation."
    return table("time", ("stage", "time", "share"), rows, caption=caption, numeric=(1, 2), foot=foot)

"""One self-contained HTML page of a placement: the answer first, then what it rests on."""

from __future__ import annotations

from html import escape

from strainsight.pages.chart.drawing import Drawing
from strainsight.pages.page.markup import chosen, figures, folded, measure, plain, share, table
from strainsight.pages.page.sections import (
    advice_card,
    budget_section,
    document,
    filters_section,
    held_mark,
    notes_card,
    panel,
    rests_on,
    section,
    warnings_section,
)
from strainsight.pages.page.verdicts import faults, headline
from strainsight.pages.placement.data import PlacementReport
from strainsight.pages.placement.first import answer, placement_screen
from strainsight.pages.placement.gauge_table import (
    cases_table,
    criteria_meaning,
    criteria_table,
    gauge_table,
    load_cases_table,
)
from strainsight.pages.sheets.sheet import sheets_section
from strainsight.pages.space.model import ShownState
from strainsight.pages.space.section import space_section
from strainsight.pages.text import unbroken

FOOTER = (
    "σ is one standard deviation. Errors and σ are relative: of a parameter to its true value, of a load to its own true RMS "
    "(to its amplitude where it is zero throughout), after the first tenth of the run. Claimed σ: what the filter states; "
    "smoothed: what the smoother states; expected: what placement foresaw for the filter; steady-state: what ranks layouts."
)

RANDOM = '<h2>Beside random sets</h2><p class="lead">The same estimation with as many gauges drawn at random.</p>'

TEST_PAGE = "test.html"
"""Page of the test, in the same folder."""


def placement_page(
    report: PlacementReport,
    drawings: tuple[Drawing, ...],
    scene: bytes | None,
    scene_problem: str = "",
    shapes: tuple[ShownState, ...] = (),
    sheets: tuple[bytes, ...] = (),
) -> str:
    """The report as HTML text without any resource outside itself.

    drawings from `figures.placement_figures`; scene: PNG bytes from `scene.render`, or None with the sentence on why;
    shapes: deformed states that the view in space offers; sheets: drawing sheets of the gauges, as SVG.
    """
    sections = (
        placement_screen(report, scene, scene_problem),
        _test(report),
        space_section([("", report.layout)], shapes),
        advice_card(report.advice),
        section("Load cases", load_cases_table(report), "load-cases"),
        section("Gauge by gauge", gauge_table(report)),
        sheets_section(sheets),
        budget_section(report.budget),
        _trend(report, drawings),
        _estimates(report, drawings),
        figures(chosen(drawings, "random-"), RANDOM),
        figures([*chosen(drawings, "noise", "repeats-"), *_noise(report)], "<h2>How sure one can be</h2>"),
        filters_section(report.filters, report.units),
        _observability(report),
        rests_on(report.facts, report.provenance, panel("Where the time went", _time(report))),
        section("What this model assumes", _assumes(report), "assumes"),
        warnings_section(report.warnings),
    )
    title = headline((unknown.name, faults(unknown)) for unknown in report.unknowns) + report.title
    return document("gauge placement", report.name, title, answer(report), sections, FOOTER, turned=True)


def _test(report: PlacementReport) -> str:
    if not report.test:
        return ""
    link = f'<a href="{TEST_PAGE}">the page of the test</a>'
    words = f"<p>{escape(report.test)}: {link}.</p><p>The rest of this page is of a simulated test.</p>"
    return notes_card("The test", words)


def _trend(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    cards = "".join(chosen(drawings, "trend"))
    if report.criteria:
        cards += f'<div class="card">{criteria_meaning(report.metrics)}</div>'
    rules = criteria_table(report.trend, report.metrics, report.criteria, report.units)
    return section("How good the set is", cards, kind="figures", more=f'<div class="card below">{rules}</div>')


def _estimates(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    shown = figures(chosen(drawings, "estimate-", "closing-", "posterior-"))
    signals, text = folded(chosen(drawings, "signal-"), "figures"), ""
    if shown or signals:
        truth = unbroken(escape(report.truth_description))
        lead = f'<p class="lead">Truth: {truth}.</p>' if truth else ""
        text = f"<h2>What they tell</h2>{lead}{shown}"
    if signals:
        strains = all(signal.unit == "strain" for signal in report.gauge_signals)
        lead = '<p class="lead">What each gauge measured and what the filter makes of it.</p>'
        text += f"<h2>{'Gauge strains' if strains else 'Readings'}</h2>{lead}{signals}"
    return text


def _noise(report: PlacementReport) -> list[str]:
    """A card with errors and claimed σ by gauge noise."""
    if (noise := report.noise) is None:
        return []
    names = list(report.units)
    head = ["gauge noise"] + [f"{what} {escape(name)}" for name in names for what in ("error of", "claimed σ of")]
    columns = [noise.level, *(values[name] for name in names for values in (noise.error, noise.std))]
    rows = [list(map(share, row)) for row in zip(*(column.tolist() for column in columns), strict=True)]
    caption = "Noise as a share of the strongest candidate's RMS reading; real error beside claimed σ."
    return [f'<div class="card">{table("noise", head, rows, caption=caption, numeric=range(1, len(head)))}</div>']


def _observability(report: PlacementReport) -> str:
    cards = []
    if report.observability:
        rows = [[escape(name), plain(value)] for name, value in report.observability.items()]
        caption = (
            "Popov-Belevitch-Hautus matrix at λ = 0 of the augmented system: "
            "the larger its condition number, the harder the estimate."
        )
        cards.append(table("observability", ("observability", "number"), rows, caption=caption, numeric=(1,)))
    if report.consistency:
        rows = []
        for check in report.consistency:
            band = f"{plain(check.band[0], 2)} to {plain(check.band[1], 3)}"
            rows.append([escape(check.name), plain(check.value, 3), band, held_mark(check.verdict)])
        caption = "Squared errors over claimed variances, per dimension; 1 is ideal."
        head = ("consistency", "number", "band", "verdict")
        cards.append(table("consistency", head, rows, caption=caption, numeric=(1, 2)))
    if report.frequencies:
        rows = [[str(i), measure(value, "Hz")] for i, value in enumerate(report.frequencies, start=1)]
        caption = "Natural frequencies of the model at the first guess."
        cards.append(table("modes", ("mode", "frequency"), rows, caption=caption, numeric=(1,)))
    body = figures((f'<div class="card">{card}</div>' for card in cards), grid="panels")
    if report.cases:
        body = f'<div class="card"><h3>What can be distinguished</h3>{cases_table(report.cases)}</div>{body}'
    return f"<h2>Observability, consistency, modes</h2>{body}" if body else ""


def _assumes(report: PlacementReport) -> str:
    """The fate of every card, connections, rigid-body check, mass by part, and what differs from the program of the deck."""
    rows = [[escape(cell) for cell in row] for row in report.assumes]
    return table("assumptions", ("what", "how many", "detail"), rows, numeric=(1,)) if rows else ""


def _time(report: PlacementReport) -> str:
    """Seconds a stage took when it was computed, and its share of all."""
    if not report.seconds:
        return ""
    whole = sum(report.seconds.values())
    rows = [
        [escape(stage), measure(time, "s", 3), share(time / whole) if whole > 0 else "–"]
        for stage, time in report.seconds.items()
    ]
    foot = ("all stages", measure(whole, "s", 3), "")
    caption = "When each was computed last; one that was reused from another run took its time there."
    return table("time", ("stage", "time", "share"), rows, caption=caption, numeric=(1, 2), foot=foot)

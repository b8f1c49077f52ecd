"""One self-contained HTML page of a placement: the answer first, then what it rests on."""

from __future__ import annotations

from collections.abc import Callable
from html import escape

from strainsight.estimation.decision import CONSISTENT
from strainsight.report.chart.drawing import Drawing
from strainsight.report.page.budget import budget_section
from strainsight.report.page.document import document
from strainsight.report.page.filters import filters_section
from strainsight.report.page.markup import bullets, figure, figures, measure, pairs, plain, share, table
from strainsight.report.placement.data import PlacementReport
from strainsight.report.placement.first import answer, first_screen, lost_of
from strainsight.report.placement.gauge_table import gauge_table
from strainsight.report.placement.tables import cases_table, criteria_meaning, criteria_table, load_cases_table
from strainsight.report.placement.verdicts import faults, headline
from strainsight.report.sheets.section import sheets_section
from strainsight.report.space.model import Shape
from strainsight.report.space.section import STYLE, script, space_section
from strainsight.report.text import unbroken

FOOTER = (
    "σ is one standard deviation. Errors and σ are relative: of a parameter to its true value, of a load to its own true RMS "
    "(to its amplitude where it is zero throughout), after the first tenth of the run. Claimed σ: what the filter states; "
    "smoothed: what the smoother states; expected: what placement foresaw for the filter; steady-state: what ranks layouts."
)

TEST_PAGE = "test.html"
"""Page of the test, in the same folder."""


def placement_page(
    report: PlacementReport,
    drawings: tuple[Drawing, ...],
    scene: bytes | None,
    scene_problem: str = "",
    shapes: tuple[Shape, ...] = (),
    sheets: tuple[bytes, ...] = (),
) -> str:
    """The report as HTML text without any resource outside itself.

    drawings from `figures.placement_figures`; scene: PNG bytes from `scene.render`, or None with the sentence on why;
    shapes: deformed states that the view in space offers; sheets: drawing sheets of the gauges, as SVG.
    """
    sections = (
        first_screen(report, scene, scene_problem),
        _test(report),
        space_section([("", report.layout)], shapes),
        _advice(report),
        _load_cases(report),
        _gauges(report),
        sheets_section(sheets),
        budget_section(report.budget),
        _trend(report, drawings),
        _estimates(report, drawings),
        _random(drawings),
        _noise(report, drawings),
        filters_section(report.filters),
        _observability(report),
        _facts(report),
        _assumes(report),
        _warnings(report),
    )
    lost = lost_of(report)
    title = headline((own.name, faults(own, own.name in lost)) for own in report.unknowns) + report.title
    return document("gauge placement", report.name, title, answer(report), sections, FOOTER, (STYLE,), (script(),))


def _test(report: PlacementReport) -> str:
    if not report.test:
        return ""
    link = f'<a href="{TEST_PAGE}">the page of the test</a>'
    return (
        f'<section class="card notes advice"><h2>The test</h2><p>{escape(report.test)}: {link}.</p>'
        "<p>The rest of this page is of a simulated test.</p></section>"
    )


def _advice(report: PlacementReport) -> str:
    if not report.advice:
        return ""
    return f'<section class="card notes advice"><h2>What to do with this layout</h2>{bullets(report.advice)}</section>'


def _load_cases(report: PlacementReport) -> str:
    if not report.load_cases:
        return ""
    return f'<h2 id="load-cases">Load cases</h2><div class="card">{load_cases_table(report)}</div>'


def _gauges(report: PlacementReport) -> str:
    return f'<h2>Gauge by gauge</h2><div class="card">{gauge_table(report)}</div>'


def _warnings(report: PlacementReport) -> str:
    if not report.warnings:
        return ""
    return f'<h2 id="warnings">Warnings</h2><div class="card warnings">{bullets(report.warnings)}</div>'


def _chosen(drawings: tuple[Drawing, ...], wanted: Callable[[str], bool], unfolded: int | None = None) -> str:
    """Cards of the wanted figures; from number `unfolded` on they are shown on demand."""
    cards = [figure(entry, i) for i, entry in enumerate(drawings) if wanted(entry.key)]
    shown, folded = cards[:unfolded], cards[len(cards[:unfolded]) :]
    return figures(shown) + (
        f"<details>{figures(folded, f'<summary>{len(folded)} more</summary>')}</details>" if folded else ""
    )


def _estimates(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    shown = _chosen(drawings, lambda key: key.startswith(("estimate-", "closing-", "posterior-")))
    signals = _chosen(drawings, lambda key: key.startswith("signal-"), unfolded=12)
    if not shown and not signals:
        return ""
    lead = (
        f'<p class="lead">Truth: {unbroken(escape(report.truth_description))}.</p>' if report.truth_description else ""
    )
    text = f"<h2>What they tell</h2>{lead}{shown}"
    if signals:
        strains = all(signal.unit == "strain" for signal in report.gauge_signals)
        lead = '<p class="lead">What each gauge measured and what the filter makes of it.</p>'
        text += f"<h2>{'Gauge strains' if strains else 'Readings'}</h2>{lead}{signals}"
    return text


def _trend(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    cards = "".join(figure(entry, i) for i, entry in enumerate(drawings) if entry.key == "trend")
    if report.criteria:
        cards += f'<div class="card">{criteria_meaning(report)}</div>'
    below = f'<div class="card below">{criteria_table(report)}</div>'
    return f'<h2>How good the set is</h2><div class="figures">{cards}</div>{below}'


def _random(drawings: tuple[Drawing, ...]) -> str:
    lead = '<p class="lead">The same estimation with as many gauges drawn at random.</p>'
    cards = [figure(entry, i) for i, entry in enumerate(drawings) if entry.key.startswith("random-")]
    return figures(cards, f"<h2>Beside random sets</h2>{lead}")


def _noise(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    cards = [
        figure(entry, i) for i, entry in enumerate(drawings) if entry.key == "noise" or entry.key.startswith("repeats-")
    ]
    if report.noise:
        names = [unknown.name for unknown in report.unknowns]
        head = ["gauge noise"] + [f"{what} {escape(name)}" for name in names for what in ("error of", "claimed σ of")]
        rows = [
            [share(row.level), *(share(source.get(name)) for name in names for source in (row.error, row.std))]
            for row in report.noise
        ]
        caption = "Noise as a share of the strongest candidate's RMS reading; real error beside claimed σ."
        text = table("noise", head, rows, caption=caption, numeric=range(1, len(head)))
        cards.append(f'<div class="card">{text}</div>')
    return figures(cards, "<h2>How sure one can be</h2>")


def _observability(report: PlacementReport) -> str:
    cards = []
    if report.observability:
        rows = [[escape(name), plain(value)] for name, value in report.observability.items()]
        caption = (
            "Popov-Belevitch-Hautus matrix at λ = 0 of the augmented system: "
            "the larger its condition number, the harder the estimate."
        )
        cards.append(table("observability", ("observability", "number"), rows, caption=caption, numeric=(1,)))
    check = report.consistency
    rows = [
        [
            name,
            plain(value, 3),
            "–" if band is None else f"{plain(band[0], 2)} to {plain(band[1], 3)}",
            f"{'✓' if verdict == CONSISTENT else '✕'} {verdict}" * bool(verdict),
        ]
        for name, value, band, verdict in (
            ("NEES of the run; band of one instant", check.nees, check.nees_band, check.nees_verdict),
            ("NIS of the gauges", check.nis, check.nis_band, check.nis_verdict),
        )
        if value is not None
    ]
    if rows:
        caption = "Squared errors over claimed variances, per dimension; 1 is ideal."
        head = ("consistency", "number", "band", "verdict")
        cards.append(table("consistency", head, rows, caption=caption, numeric=(1, 2)))
    if report.frequencies:
        rows = [[str(i + 1), measure(value, "Hz")] for i, value in enumerate(report.frequencies)]
        caption = "Natural frequencies of the model at the first guess."
        cards.append(table("modes", ("mode", "frequency"), rows, caption=caption, numeric=(1,)))
    body = "".join(f'<div class="card">{card}</div>' for card in cards)
    body = f'<div class="panels">{body}</div>' if cards else ""
    if report.cases:
        body = f'<div class="card"><h3>What can be distinguished</h3>{cases_table(report.cases)}</div>{body}'
    return f"<h2>Observability, consistency, modes</h2>{body}" if body else ""


def _facts(report: PlacementReport) -> str:
    cards = ""
    if report.facts:
        text = pairs("model and run", report.facts.items())
        cards += f'<section class="card"><h3>Model and run</h3>{text}</section>'
    cards += _time(report)
    if report.provenance:
        text = pairs("provenance", report.provenance.items())
        cards += f'<section class="card"><h3>Provenance</h3>{text}</section>'
    return f'<h2>What it rests on</h2><div class="panels">{cards}</div>' if cards else ""


def _assumes(report: PlacementReport) -> str:
    """The fate of every card, connections, rigid-body check, mass by part, and what differs from the program of the deck."""
    if not report.assumes:
        return ""
    rows = [[escape(cell) for cell in row] for row in report.assumes]
    text = table("assumptions", ("what", "how many", "detail"), rows, numeric=(1,))
    return f'<h2 id="assumes">What this model assumes</h2><div class="card">{text}</div>'


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
    text = table("time", ("stage", "time", "share"), rows, caption=caption, numeric=(1, 2), foot=foot)
    return f'<section class="card"><h3>Where the time went</h3>{text}</section>'

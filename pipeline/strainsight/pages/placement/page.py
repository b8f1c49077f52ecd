"""One self-contained HTML page of a placement: the answer first, then what it rests on."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from html import escape

import numpy as np

from strainsight.estimation.decision import LOST, WITHHELD
from strainsight.pages.chart.drawing import VERMILION, Drawing
from strainsight.pages.page import markup, sections
from strainsight.pages.page.markup import (
    axes,
    badge,
    bullets,
    chosen,
    coordinates,
    count,
    decimals,
    figures,
    folded,
    items,
    mark,
    measure,
    plain,
    share,
    table,
    tile,
)
from strainsight.pages.page.verdicts import HARDLY, faults, headline, leading, not_shown
from strainsight.pages.picture.geometry import shape
from strainsight.pages.picture.layout import PictureLayout
from strainsight.pages.picture.scene import CLAMP, LINES, POOL
from strainsight.pages.placement.data import ObservabilityCase, PlacementReport, Unknown
from strainsight.pages.placement.gauge_table import (
    SINGLE,
    cases_table,
    criteria_meaning,
    criteria_table,
    expected_with_all,
    gauge_table,
    load_cases_table,
    names_without,
)
from strainsight.pages.sheets.sheet import sheets_section
from strainsight.pages.space.model import ShownState
from strainsight.pages.space.section import space_section
from strainsight.text import listed, unbroken


def denominator(unknown: Unknown) -> str:
    """What errors and σ of an unknown are relative to."""
    if unknown.kind == "parameter":
        return "of its true value"
    return "of its amplitude" if unknown.zero else "of its RMS"


def answer(report: PlacementReport) -> str:
    """The first sentences: what does not hold, then how many gauges tell what, how well, and which unknown is weakest."""
    gauges, pool = report.layout.gauges, int(report.trend.count[0])
    bonded = sum(gauge.bonded for gauge in gauges)
    word = "gauge" if {gauge.kind for gauge in gauges} <= SINGLE else "sensor"
    many = f"{word}{'s' * (len(gauges) != 1)}, {f'{count(bonded)} of them bonded already, ' if bonded else ''}chosen"
    text = leading(report.unknowns)
    text += f"<strong>{count(len(gauges))} {many} from {count(pool)} candidate{'s' * (pool != 1)}</strong>"
    sound = [unknown for unknown in report.unknowns if not faults(unknown)]
    known = [unknown for unknown in sound if _sigma(unknown) is not None]
    if parts := [f"{escape(one.name)} to within ±{share(_sigma(one))} {denominator(one)}" for one in known]:
        names = dict.fromkeys(_name_of_sigma(unknown) for unknown in known)
        summary = f"{listed(parts)} ({' or '.join(names)})"
    else:
        summary = listed([escape(unknown.name) for unknown in sound])
    text += f" {'tells' if len(gauges) == 1 else 'tell'} {summary}." if summary else "."
    if len(known) > 1:
        weakest = max(known, key=lambda unknown: _sigma(unknown) or 0.0)
        text += f" The weakest unknown is <strong>{escape(weakest.name)}</strong>."
    return text + _worst_cases(report)


def _worst_cases(report: PlacementReport) -> str:
    """In which load case every unknown is known least; empty without load cases."""
    if report.load_cases is None:
        return ""
    worst = [unknown for unknown in report.unknowns if unknown.worst_case]
    parts = listed([f"{escape(one.name)} ±{share(one.expected_std)} in {escape(one.worst_case)}" for one in worst])
    many = len(report.load_cases.name)
    return f" Expected at worst over {count(many)} load case{'s' * (many > 1)}: {parts}, of the amplitude there."


def placement_screen(report: PlacementReport, scene: bytes | None, problem: str) -> str:
    """The unknowns and the distance from the best, where the gauges go and what each is worth, and what to mind. Every number in
    it is a `data` element."""
    order = sorted(report.unknowns, key=lambda unknown: not faults(unknown))
    tiles = "".join(map(_tile, order)) + _bound_tile(report)
    return sections.first_screen(tiles, _without(report) + pictured(report.layout, scene, problem), _cautions(report))


def _sigma(unknown: Unknown) -> float | None:
    """The standard deviation to show first: the filter's own where it ran, else what placement expects."""
    if unknown.withheld:
        return None
    return unknown.expected_std if unknown.std is None else unknown.std


def _name_of_sigma(unknown: Unknown) -> str:
    return "expected σ" if unknown.std is None else "claimed σ"


def _tile(unknown: Unknown) -> str:
    """One unknown: its estimate and band, whether the claim held, and what they are beside."""
    load, sigma = unknown.kind == "input", _sigma(unknown)
    if not load and unknown.estimate is not None:
        value = measure(unknown.estimate, unknown.unit)
        value += f' <small class="whole">± {share(sigma)}</small>' if sigma is not None else ""
    else:
        value = "σ withheld" if unknown.withheld else f"± {share(sigma)}"
    rows = [
        (f"± {_name_of_sigma(unknown)}", denominator(unknown) if sigma is not None else "–"),
        ("true RMS" if load else "true value", measure(unknown.truth, unknown.unit)),
        ("estimated RMS", measure(unknown.estimate if load else None, unknown.unit)),
        ("error in the test", share(unknown.error)),
        ("error after smoothing", share(unknown.smoothed_error if load else None)),
        ("amplitude", measure(unknown.guess if unknown.zero else None, unknown.unit)),
        ("expected σ", share(None if unknown.std is None else unknown.expected_std)),
        ("expected in load case", escape(unknown.worst_case) or "–"),
    ]
    return tile(f"{escape(unknown.name)}, {'load' if load else 'parameter'}", value, rows, _mark(unknown))


def _mark(unknown: Unknown) -> str:
    """Whether the claim held in the test and over the repeats: a sure filter can be wrong."""
    if unknown.lost or unknown.withheld:
        return mark(f"{LOST}: {HARDLY}" if unknown.lost else WITHHELD, False)
    return "".join(mark(claim.words(plain, limit=False), not claim.overconfident) for claim in unknown.claims[:1])


def _bound_tile(report: PlacementReport) -> str:
    """How far the chosen set can be from the best one."""
    trend = report.trend
    rows = [(f"metric {escape(trend.metric.symbol)}", plain(trend.final))]
    if trend.lower_bound is not None:
        rows.append(("no set can go below", plain(trend.lower_bound)))
    if others := [entry for entry in report.criteria[1:] if math.isfinite(entry.chosen)]:
        best = min(others, key=lambda entry: entry.chosen)
        # what is below the bound is no better layout: other rules know no limits
        beyond = trend.lower_bound is not None and best.chosen < trend.lower_bound * (1 - 1e-9)
        rows.append((f"best other rule{', beyond the limits' * beyond} ({escape(best.rule)})", plain(best.chosen)))
    value = "not certified" if trend.gap is None else f"{share(max(trend.gap, 0.0))} <small>at most</small>"
    return tile("distance from the best possible set", value, rows)


def _without(report: PlacementReport) -> str:
    """Every gauge, its place, and what the unknowns would be without it; what they are with all."""
    gauges, names = report.layout.gauges, names_without(report)
    frame = report.layout.frame
    places = decimals(report.layout.points, frame)
    rows = [
        [
            badge(gauge.label, index, hollow=gauge.bonded),
            *(share(gauge.without.get(name, math.nan)) for name in names),
            *axes(gauge.position, places, frame),
        ]
        for index, gauge in enumerate(gauges)
    ]
    expected = expected_with_all(report, names)
    text = table(
        "with and without",
        ["gauge", *(f"expected σ({escape(name)})" for name in names), *frame.heads],
        rows,
        title="<h2>With all and without each gauge</h2>" if names else "<h2>Gauges</h2>",
        numeric=range(1, 4 + len(names)),
        foot=["with all", *expected, "", "", ""] if expected else (),
    )
    lost = any(math.isinf(value) for gauge in gauges for value in gauge.without.values())
    more = " ∞: without that gauge the unknown can no longer be observed." if lost else ""
    note = f'<p class="note">Expected σ if that gauge fails.{more}</p>' if names else ""
    return f'<div class="card without">{text}{note}</div>'


def _cautions(report: PlacementReport) -> Iterator[str]:
    """What can be known and what cannot, what was not tested, and how many warnings there are."""
    yield sections.caution("What can be known", items(_observable(report)))
    yield sections.caution("Not tested", bullets(report.not_tested))
    if many := len(report.warnings):
        link = f'<a href="#warnings">{count(many)} warning{"s" * (many > 1)}</a>'
        words = f"<p>{link}: read {'them' if many > 1 else 'it'} before you decide.</p>"
        yield sections.caution("Warnings", words, "warnings")


def _observable(report: PlacementReport) -> list[str]:
    """Items: whether all unknowns are observable, and the smallest sets that are not."""
    asked = frozenset(unknown.name for unknown in report.unknowns)
    lost: dict[frozenset[str], list[ObservabilityCase]] = {}
    for case in report.cases:
        if case.lost:
            lost.setdefault(frozenset(case.unknowns), []).append(case)
    excitations = {case.excitation for case in report.cases}
    gone = [unknown.name for unknown in report.unknowns if math.isinf(_sigma(unknown) or 0.0)]
    known = []
    if gone:
        known.append(f'<strong class="bad">{listed([escape(name) for name in gone])}: not with these gauges.</strong>')
    elif asked and asked not in lost and (report.cases or all(u.expected_std is not None for u in report.unknowns)):
        known.append("All unknowns are observable.")
    for names, cases in lost.items():
        where = {case.excitation for case in cases}
        if any(other < names and where <= {case.excitation for case in others} for other, others in lost.items()):
            continue
        how = "cannot be estimated" if any(math.isinf(case.condition) for case in cases) else "can hardly be estimated"
        at = "" if where == excitations else f" in {listed([escape(case.excitation) for case in cases])}"
        text = f"{listed([escape(name) for name in sorted(names)])} {how}{' together' * (len(names) > 1)}{at}."
        known.append(f'<strong class="bad">{text}</strong>' if names == asked else text)
    return known + not_shown(report.unknowns)


OUTLINES = {
    "bar": "polygon(0 30%,100% 30%,100% 70%,0 70%)",
    "star": "polygon(38% 0,62% 0,62% 38%,100% 38%,100% 62%,62% 62%,62% 100%,38% 100%,38% 62%,0 62%,0 38%,38% 38%)",
    "cone": "polygon(0 0,100% 0,50% 100%)",
}
"""The shapes of `geometry.shape` that are no square, in small."""


def pictured(layout: PictureLayout, scene: bytes | None, problem: str = "") -> str:
    """Where the gauges go, as a picture with its key; scene: PNG bytes, or None with the sentence on why ("": no card)."""
    if scene is None:
        shown = f"<p><strong>No picture.</strong> {escape(problem)}</p>" if problem else ""
    else:
        frame, places = layout.frame, decimals(layout.points, layout.frame)
        where = "; ".join(
            f"{gauge.label} at {coordinates(frame.place(gauge.position), places)} {frame.unit}"
            for gauge in layout.gauges
        )
        alt = f"The structure from one or two sides with its {len(layout.gauges)} gauges: {where}."
        key = ""
        for colour, name, text in _entries(layout):
            outline = f";clip-path:{OUTLINES[name]}" if name in OUTLINES else ""
            style = f"background:{colour}{outline}"
            if name == "hollow":
                style = f"background:#ffffff;border:2px solid {colour}"
            key += f'<li><i class="{name}" style="{style}"></i>{text}</li>'
        shown = f'{markup.scene(scene, alt, "picture of the gauges")}<ul class="key">{key}</ul>'
    return f'<figure class="card"><h2>Where the gauges go</h2>{shown}</figure>' if shown else ""


def _entries(layout: PictureLayout) -> Iterator[tuple[str, str, str]]:
    """Colour, shape and words of all that the picture shows: only what occurs."""
    for kind, many in Counter(gauge.kind for gauge in layout.gauges).items():
        yield "var(--muted)", shape(kind), f"{count(many)} {escape(kind)}{'s' * (many > 1)}"
    if bonded := sum(gauge.bonded for gauge in layout.gauges):
        yield "var(--muted)", "hollow", f"{count(bonded)} of them bonded already"
    yield POOL, "dot", f"{count(len(layout.pool))} candidates in the pool"
    if layout.loads:
        loads = [f"{escape(load.name)} ({'known' if load.known else 'unknown'})" for load in layout.loads]
        yield VERMILION, "", f"load {', '.join(loads)}"
    if len(layout.fixed):
        yield CLAMP, "", "clamped nodes"
    if len(layout.loose):
        yield LINES, "", "nodes outside the solids"


FOOTER = (
    "σ is one standard deviation. Errors and σ are relative: of a parameter to its true value, of a load to its own true RMS "
    "(to its amplitude where it is zero throughout), after the first tenth of the run. Claimed σ: what the filter states; "
    "smoothed: what the smoother states; expected: what placement foresaw for the filter; steady-state: what ranks layouts."
)

RANDOM = markup.titled("Beside random sets", "The same estimation with as many gauges drawn at random.")
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
    link = f'<a href="{TEST_PAGE}">the page of the test</a>'
    words = f"<p>{escape(report.test)}: {link}.</p><p>The rest of this page is of a simulated test.</p>"
    assumed = [[*map(escape, row)] for row in report.assumes]
    assumes = table("assumptions", ("what", "how many", "detail"), assumed, numeric=(1,)) if assumed else ""
    parts = (
        placement_screen(report, scene, scene_problem),
        sections.notes_card("The test", words * bool(report.test)),
        sections.section("Remark", escape(report.settings.remark).replace("\n", "<br>"), "remark"),
        space_section([("", report.layout)], shapes),
        sections.advice_card(report.advice),
        sections.section("Load cases", load_cases_table(report), "load-cases"),
        sections.section("Gauge by gauge", gauge_table(report)),
        sheets_section(sheets),
        sections.budget_section(report.budget),
        _trend(report, drawings),
        _estimates(report, drawings),
        figures(chosen(drawings, "random-"), RANDOM),
        figures([*chosen(drawings, "noise", "repeats-"), *_noise(report)], "<h2>How sure one can be</h2>"),
        sections.filters_section(report.filters, report.units),
        _observability(report),
        sections.rests_on(report.facts, report.provenance, sections.panel("Where the time went", _time(report))),
        sections.section("What this model assumes", assumes, "assumes"),
        sections.warnings_section(report.warnings),
    )
    title = headline((unknown.name, faults(unknown)) for unknown in report.unknowns) + report.title
    return sections.document("gauge placement", report.name, title, answer(report), parts, FOOTER, turned=True)


def _trend(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    meaning = f'<div class="card">{criteria_meaning(report.metrics)}</div>' * bool(report.criteria)
    cards = "".join(chosen(drawings, "trend")) + meaning
    rules = criteria_table(report.trend, report.metrics, report.criteria, report.units)
    return sections.section("How good the set is", cards, kind="figures", more=f'<div class="card below">{rules}</div>')


def _estimates(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    strains = all(signal.unit == "strain" for signal in report.gauge_signals)
    lead = "What each gauge measured and what the filter makes of it."
    heading = markup.titled("Gauge strains" if strains else "Readings", lead)
    text = figures(chosen(drawings, "estimate-", "closing-", "posterior-"))
    text += folded(chosen(drawings, "signal-"), heading=heading)
    truth = f"Truth: {unbroken(escape(report.truth_description))}." * bool(report.truth_description)
    return markup.titled("What they tell", truth) + text if text else ""


def _noise(report: PlacementReport) -> list[str]:
    """A card with errors and claimed σ by gauge noise."""
    if (noise := report.noise) is None:
        return []
    columns = {"gauge noise": noise.level}
    for name in report.units:
        columns |= {f"error of {escape(name)}": noise.error[name], f"claimed σ of {escape(name)}": noise.std[name]}
    rows = [list(map(share, row)) for row in np.column_stack([*columns.values()]).tolist()]
    caption = "Noise as a share of the strongest candidate's RMS reading; real error beside claimed σ."
    numbers = table("noise", list(columns), rows, caption=caption, numeric=range(1, len(columns)))
    return [f'<div class="card">{numbers}</div>']


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
        rows = [
            [
                escape(check.name),
                plain(check.value, 3),
                f"{plain(check.band[0], 2)} to {plain(check.band[1], 3)}",
                sections.held_mark(check.verdict),
            ]
            for check in report.consistency
        ]
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

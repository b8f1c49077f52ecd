"""HTML page of a placement: answer first, then details."""

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
    coordinates,
    count,
    data,
    decimals,
    figures,
    folded,
    items,
    mark,
    measure,
    plain,
    select_figures,
    share,
    table,
    tile,
)
from strainsight.pages.page.problems import HARDLY, faults, headline, leading, not_shown
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
from strainsight.runner.output import Table
from strainsight.text import capital, listed, unbroken

INFLUENCE = (
    "The parameters have their guess. The condition number is that of the columns of the unknown loads, relative to noise; a "
    "large number means that the readings hardly separate these loads."
)


def answer(report: PlacementReport) -> str:
    """First sentences: problems, then number of gauges, expected accuracy, and the weakest unknown."""
    gauges, pool = report.layout.gauges, int(report.trend.count[0])
    bonded = sum(gauge.bonded for gauge in gauges)
    word = "gauge" if {gauge.kind for gauge in gauges} <= SINGLE else "sensor"
    many = f"{word}{'s' * (len(gauges) != 1)}{f' ({count(bonded)} already bonded)' if bonded else ''} chosen"
    text = leading(report.unknowns)
    text += f"<strong>{count(len(gauges))} {many} from {count(pool)} candidate{'s' * (pool != 1)}</strong>"
    sound = [unknown for unknown in report.unknowns if not faults(unknown)]
    known = [unknown for unknown in sound if _sigma(unknown) is not None]
    if parts := [f"{escape(one.name)} to within ±{share(_sigma(one))}" for one in known]:
        summary = f"{listed(parts)} (expected σ)"
    else:
        summary = listed([escape(unknown.name) for unknown in sound])
    text += f" estimate{'s' if len(gauges) == 1 else ''} {summary}." if summary else "."
    if len(known) > 1:
        weakest = max(known, key=lambda unknown: _sigma(unknown) or 0.0)
        text += f" Largest relative uncertainty: <strong>{escape(weakest.name)}</strong>."
    return text + _worst_cases(report)


def _worst_cases(report: PlacementReport) -> str:
    """Load case with the largest σ of every unknown; empty without load cases."""
    if report.load_cases is None:
        return ""
    worst = [unknown for unknown in report.unknowns if unknown.worst_case]
    parts = listed([f"{escape(one.name)} ±{share(one.expected_std)} in {escape(one.worst_case)}" for one in worst])
    many = len(report.load_cases.name)
    cases = f"{count(many)} load case{'s' * (many > 1)}"
    return f" Largest expected σ of the estimates over {cases}: {parts}."


def _sigma(unknown: Unknown) -> float | None:
    """σ of the layout, expected by the placement."""
    return None if unknown.withheld else unknown.expected_std


def _tile(unknown: Unknown) -> str:
    """Tile of one unknown: expected σ, calibration and further numbers."""
    load, sigma = unknown.kind == "input", _sigma(unknown)
    value = "σ withheld" if unknown.withheld else f"± {share(sigma)}"
    rows = [
        ("± expected σ", "–" if sigma is None else measure(sigma * unknown.reference, unknown.unit, 3)),
        ("true RMS" if load else "true value", measure(unknown.truth, unknown.unit)),
        ("estimated RMS" if load else "estimated value", measure(unknown.estimate, unknown.unit)),
        ("error in the simulated test", share(unknown.error)),
        ("error of the smoothed estimate", share(unknown.smoothed_error if load else None)),
        ("amplitude of the load", measure(unknown.reference if unknown.zero else None, unknown.unit)),
        ("claimed σ in the simulated test", share(unknown.std)),
        ("load case with the largest expected σ", escape(unknown.worst_case) or "–"),
    ]
    return tile(f"{escape(unknown.name)}, {'load' if load else 'parameter'}", value, rows, _mark(unknown))


def _mark(unknown: Unknown) -> str:
    """Calibration of σ in the validation."""
    if unknown.lost or unknown.withheld:
        return mark(f"{LOST}: {HARDLY}" if unknown.lost else WITHHELD, False)
    return "".join(mark(claim.words(plain, limit=False), not claim.overconfident) for claim in unknown.claims[:1])


def _bound_tile(report: PlacementReport) -> str:
    """Tile with the optimality bound of the layout."""
    trend = report.trend
    rows = [(f"placement criterion {escape(trend.metric.symbol)}", plain(trend.final))]
    if trend.lower_bound is not None:
        rows.append(("lower bound", plain(trend.lower_bound)))
    if others := [entry for entry in report.criteria[1:] if math.isfinite(entry.chosen)]:
        best = min(others, key=lambda entry: entry.chosen)
        # a value below the bound violates the limits, which other rules ignore
        violating = trend.lower_bound is not None and best.chosen < trend.lower_bound * (1 - 1e-9)
        name = f"best criterion of the other placement rules{', limits violated' * violating} ({escape(best.rule)})"
        rows.append((name, plain(best.chosen)))
    value = "not computed" if trend.gap is None else f"≤\u00a0{share(max(trend.gap, 0.0))}"
    return tile("gap of the criterion to its lower bound", value, rows)


def _without(report: PlacementReport) -> str:
    """Table of gauges with positions, and expected σ with all gauges and without each."""
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
        "expected σ without each gauge",
        ["gauge", *(f"expected σ({escape(name)})" for name in names), *frame.heads],
        rows,
        title="<h2>Expected σ with all and without each gauge</h2>" if names else "<h2>Gauges</h2>",
        numeric=range(1, 4 + len(names)),
        foot=["all gauges", *expected, "", "", ""] if expected else (),
    )
    lost = any(math.isinf(value) for gauge in gauges for value in gauge.without.values())
    more = " ∞: without this gauge the unknown is not observable." if lost else ""
    note = f'<p class="note">Expected σ if this gauge fails.{more}</p>' if names else ""
    return f'<div class="card without">{text}{note}</div>'


def _cautions(report: PlacementReport) -> Iterator[str]:
    """Cards on observability, missing tests, and warnings."""
    yield sections.caution("Observability", items(_observable(report)))
    yield sections.caution("Not tested", bullets(report.not_tested))
    if many := len(report.warnings):
        link = f'<a href="#warnings">{count(many)} warning{"s" * (many > 1)}</a>'
        words = f"<p>{link}. Read {'them' if many > 1 else 'it'} before you use this layout.</p>"
        yield sections.caution("Warnings", words, "warnings")


def _observable(report: PlacementReport) -> list[str]:
    """Items on observability of all unknowns, and on the smallest unobservable sets."""
    wanted = frozenset(unknown.name for unknown in report.unknowns)
    lost: dict[frozenset[str], list[ObservabilityCase]] = {}
    for case in report.cases:
        if case.lost:
            lost.setdefault(frozenset(case.unknowns), []).append(case)
    excitations = {case.excitation for case in report.cases}
    hidden = [one.name for one in report.unknowns if math.inf in (one.std, one.expected_std)]
    known = []
    if hidden:
        names_hidden = listed([escape(name) for name in hidden])
        known.append(f'<strong class="bad">Not observable with these gauges: {names_hidden}.</strong>')
    elif wanted and wanted not in lost and (report.cases or all(u.expected_std is not None for u in report.unknowns)):
        known.append("All unknowns are observable.")
    for names, cases in lost.items():
        where = {case.excitation for case in cases}
        if any(other < names and where <= {case.excitation for case in others} for other, others in lost.items()):
            continue
        how = "not observable" if any(math.isinf(case.condition) for case in cases) else "weakly observable"
        at = "" if where == excitations else f" at {listed([escape(case.excitation) for case in cases])}"
        jointly = "jointly " * (len(names) > 1)
        text = f"{listed([escape(name) for name in sorted(names)])}: {jointly}{how}{at}."
        known.append(f'<strong class="bad">{text}</strong>' if names == wanted else text)
    return known + not_shown(report.unknowns)


OUTLINES = {
    "bar": "polygon(0 30%,100% 30%,100% 70%,0 70%)",
    "star": "polygon(38% 0,62% 0,62% 38%,100% 38%,100% 62%,62% 62%,62% 100%,38% 100%,38% 62%,0 62%,0 38%,38% 38%)",
    "cone": "polygon(0 0,100% 0,50% 100%)",
}
"""Outlines of the shapes of `geometry.shape` for the legend, except squares."""


def pictured(layout: PictureLayout, scene: bytes | None, problem: str = "") -> str:
    """Picture of the gauges with legend; scene: PNG bytes, or None with the reason ("": no card)."""
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
    return f'<figure class="card"><h2>Gauge positions</h2>{shown}</figure>' if shown else ""


def _entries(layout: PictureLayout) -> Iterator[tuple[str, str, str]]:
    """Legend entries of the picture: colour, shape and text."""
    for kind, many in Counter(gauge.kind for gauge in layout.gauges).items():
        yield "var(--muted)", shape(kind), f"{count(many)} {escape(kind)}{'s' * (many > 1)}"
    if bonded := sum(gauge.bonded for gauge in layout.gauges):
        yield "var(--muted)", "hollow", f"{count(bonded)} gauge{'s' * (bonded > 1)} already bonded"
    yield POOL, "dot", f"{count(len(layout.pool))} candidate positions"
    if layout.loads:
        loads = [f"{'known' if load.known else 'unknown'} load {escape(load.name)}" for load in layout.loads]
        yield VERMILION, "", ", ".join(loads)
    if len(layout.fixed):
        yield CLAMP, "", "supported nodes"
    if len(layout.loose):
        yield LINES, "", "nodes without solid or shell elements"


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
    words = f"<p>{escape(report.test)}. See the {link}.</p><p>The rest of this page refers to a simulated test.</p>"
    assumption_rows = [[*map(escape, row)] for row in report.assumes]
    head = ("item", "number", "detail")
    assumes = table("assumptions", head, assumption_rows, numeric=(1,)) if assumption_rows else ""
    # every number of the first screen is a `data` element
    order = sorted(report.unknowns, key=lambda unknown: not faults(unknown))
    tiles = "".join(map(_tile, order)) + _bound_tile(report)
    picture = _without(report) + pictured(report.layout, scene, scene_problem)
    parts = (
        sections.first_screen(tiles, picture, _cautions(report)),
        sections.notes_card("Test", words * bool(report.test)),
        sections.section("Remark", escape(report.settings.remark).replace("\n", "<br>"), "remark"),
        space_section([("", report.layout)], shapes),
        sections.advice_card(report.advice),
        sections.section("Load cases", load_cases_table(report), "load-cases"),
        sections.section("Gauges", gauge_table(report)),
        _influence(report.influence),
        sheets_section(sheets),
        sections.budget_section(report.budget),
        _trend(report, drawings),
        _estimates(report, drawings),
        figures(select_figures(drawings, "random-"), RANDOM),
        figures([*select_figures(drawings, "noise", "repeats-"), *_noise(report)], "<h2>Noise and repeats</h2>"),
        sections.filters_section(report.filters, report.units),
        _observability(report),
        sections.provenance_section(report.facts, report.provenance, sections.panel("Computing time", _time(report))),
        sections.section("Model assumptions", assumes, "assumes"),
        sections.warnings_section(report.warnings),
    )
    title = headline((unknown.name, faults(unknown)) for unknown in report.unknowns) + report.title
    return sections.document("gauge placement", report.name, title, answer(report), parts, FOOTER, turned=True)


def _trend(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    meaning = f'<div class="card">{criteria_meaning(report.metrics)}</div>' * bool(report.criteria)
    cards = "".join(select_figures(drawings, "trend")) + meaning
    rules = criteria_table(report.trend, report.metrics, report.criteria, report.units)
    return sections.section(
        "Quality of the layout", cards, kind="figures", more=f'<div class="card below">{rules}</div>'
    )


def _estimates(report: PlacementReport, drawings: tuple[Drawing, ...]) -> str:
    strains = all(signal.unit == "strain" for signal in report.gauge_signals)
    lead = "Measured and estimated readings of each gauge."
    heading = markup.titled("Gauge strains" if strains else "Readings", lead)
    text = figures(select_figures(drawings, "estimate-", "closing-", "posterior-"))
    text += folded(select_figures(drawings, "signal-"), heading=heading)
    truth = f"Truth: {unbroken(escape(report.truth_description))}." * bool(report.truth_description)
    return markup.titled("Estimates", truth) + text if text else ""


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

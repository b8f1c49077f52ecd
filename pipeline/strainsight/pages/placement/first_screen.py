"""First screen of a placement page: answer in words, structure with strain and gauges, numbers, cautions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from html import escape

from strainsight.estimation.decision import LOST, WITHHELD
from strainsight.pages.chart.drawing import VERMILION
from strainsight.pages.page import markup, sections
from strainsight.pages.page.markup import (
    bullets,
    coordinates,
    count,
    decimals,
    items,
    mark,
    measure,
    plain,
    share,
    tile,
)
from strainsight.pages.page.problems import HARDLY, faults, leading, not_shown
from strainsight.pages.picture.geometry import shape
from strainsight.pages.picture.layout import PictureLayout
from strainsight.pages.picture.scene import CLAMP, LINES, POOL
from strainsight.pages.placement.data import ObservabilityCase, PlacementReport, Unknown
from strainsight.pages.placement.gauge_table import SINGLE
from strainsight.pages.space.model import ShownState
from strainsight.pages.space.section import space_section
from strainsight.text import listed


def first_screen(report: PlacementReport, scene: bytes | None, scene_problem: str, shapes: Sequence[ShownState]) -> str:
    """3D view, beginning with the first of the shapes if that has a contour, or the picture where no script runs and on paper;
    numbers; cautions."""
    order = sorted(report.unknowns, key=lambda unknown: not faults(unknown))
    gap, symbol = report.trend.gap, escape(report.trend.metric.symbol)
    bound = "not computed" if gap is None else f"≤\u00a0{share(max(gap, 0.0))}"
    tiles = "".join(map(_tile, order)) + tile(f"gap of the criterion {symbol} to its lower bound", bound)
    first = 0 if shapes and shapes[0].contour is not None else -1
    view = space_section([("", report.layout)], shapes, first=first)
    picture = _picture(report.layout, scene, scene_problem)
    cautions = (
        sections.caution("Observability", items(_observable(report))),
        sections.caution("Not tested", bullets(report.not_tested)),
    )
    return sections.first_screen(f'<div class="first">{view}{picture}<div class="tiles">{tiles}</div></div>', cautions)


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
    """Tile of one unknown: expected σ, error of the simulated test and calibration."""
    kind, sigma = "load" if unknown.kind == "input" else "parameter", _sigma(unknown)
    value = "σ withheld" if unknown.withheld else f"± {share(sigma)}"
    rows = [
        ("± expected σ", "–" if sigma is None else measure(sigma * unknown.reference, unknown.unit, 3)),
        ("load case with the largest expected σ", escape(unknown.worst_case) or "–"),
        ("error in the simulated test", share(unknown.error)),
    ]
    if unknown.zero:
        rows.append(("amplitude, as the load is zero", measure(unknown.reference, unknown.unit, 3)))
    return tile(f"{escape(unknown.name)}, {kind}", value, rows, _mark(unknown))


def _mark(unknown: Unknown) -> str:
    """Calibration of σ in the validation."""
    if unknown.lost or unknown.withheld:
        return mark(f"{LOST}: {HARDLY}" if unknown.lost else WITHHELD, False)
    return "".join(mark(claim.words(plain, limit=False), not claim.overconfident) for claim in unknown.claims[:1])


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


def _picture(layout: PictureLayout, scene: bytes | None, problem: str) -> str:
    """Picture of the gauges with legend, shown on paper or without the 3D view; scene: PNG bytes, or None with the reason ("":
    no card)."""
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
    return f'<figure class="card still"><h2>Gauge positions</h2>{shown}</figure>' if shown else ""


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

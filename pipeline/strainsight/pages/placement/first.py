"""The first screen of a placement report: where the gauges go, what they will tell and how well, and what to mind."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from html import escape

from strainsight.estimation.decision import LOST, WITHHELD
from strainsight.pages.chart.drawing import VERMILION
from strainsight.pages.page import markup
from strainsight.pages.page.markup import (
    axes,
    badge,
    bullets,
    coordinates,
    count,
    decimals,
    items,
    mark,
    measure,
    plain,
    share,
    table,
    tile,
)
from strainsight.pages.page.sections import caution, first_screen
from strainsight.pages.page.verdicts import HARDLY, faults, leading, not_shown
from strainsight.pages.picture.geometry import shape
from strainsight.pages.picture.layout import PictureLayout
from strainsight.pages.picture.scene import CLAMP, LINES, POOL
from strainsight.pages.placement.data import ObservabilityCase, PlacementReport, Unknown
from strainsight.pages.placement.gauge_table import SINGLE, expected_with_all, names_without
from strainsight.pages.text import listed


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
    parts = [
        f"{escape(unknown.name)} ±{share(unknown.expected_std)} in {escape(unknown.worst_case)}"
        for unknown in report.unknowns
        if unknown.worst_case
    ]
    many = len(report.load_cases.name)
    return (
        f" Expected at worst over {count(many)} load case{'s' * (many > 1)}: {listed(parts)}, of the amplitude there."
    )


def placement_screen(report: PlacementReport, scene: bytes | None, problem: str) -> str:
    """The unknowns and the distance from the best, where the gauges go and what each is worth, and what to mind. Every number in
    it is a `data` element."""
    order = sorted(report.unknowns, key=lambda unknown: not faults(unknown))
    tiles = "".join(map(_tile, order)) + _bound_tile(report)
    return first_screen(tiles, _without(report) + pictured(report.layout, scene, problem), _cautions(report))


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
    if not unknown.claims:
        return ""
    claim = unknown.claims[0]
    return mark(claim.words(plain, limit=False), not claim.overconfident)


def _bound_tile(report: PlacementReport) -> str:
    """How far the chosen set can be from the best one."""
    trend = report.trend
    rows = [(f"metric {escape(trend.metric.symbol)}", plain(trend.final))]
    if trend.lower_bound is not None:
        rows.append(("no set can go below", plain(trend.lower_bound)))
    others = [entry for entry in report.criteria[1:] if math.isfinite(entry.chosen)]
    if others:
        best = min(others, key=lambda entry: entry.chosen)
        # what is below the bound is no better layout: other rules know no limits
        beyond = trend.lower_bound is not None and best.chosen < trend.lower_bound * (1 - 1e-9)
        rows.append((f"best other rule{', beyond the limits' * beyond} ({escape(best.rule)})", plain(best.chosen)))
    value = "not certified"
    if trend.gap is not None:
        value = f"{share(max(trend.gap, 0.0))} <small>at most</small>"
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
    yield caution("What can be known", items(_observable(report)))
    yield caution("Not tested", bullets(report.not_tested))
    if many := len(report.warnings):
        link = f'<a href="#warnings">{count(many)} warning{"s" * (many > 1)}</a>'
        words = f"<p>{link}: read {'them' if many > 1 else 'it'} before you decide.</p>"
        yield caution("Warnings", words, "warnings")


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
        key = "".join(_key(*entry) for entry in _entries(layout))
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


def _key(colour: str, name: str, text: str) -> str:
    """One entry of the picture's key: a small shape in its colour, and its words as HTML."""
    outline = f";clip-path:{OUTLINES[name]}" if name in OUTLINES else ""
    style = f"background:{colour}{outline}" if name != "hollow" else f"background:#ffffff;border:2px solid {colour}"
    return f'<li><i class="{name}" style="{style}"></i>{text}</li>'

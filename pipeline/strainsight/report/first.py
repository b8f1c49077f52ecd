"""The first screen of a placement report: where the gauges go, what they will tell and how well, and what to mind."""

from __future__ import annotations

import base64
import math
from collections import Counter
from html import escape

from strainsight.report import picture
from strainsight.report.data import PlacementReport, Unknown
from strainsight.report.drawing import VERMILION
from strainsight.report.gauge_table import SINGLE, coordinates, decimals
from strainsight.report.layout import Gauge
from strainsight.report.markers import shape
from strainsight.report.markup import bullets, measure, plain, share

OUTLINES = {
    "bar": "polygon(0 30%,100% 30%,100% 70%,0 70%)",
    "star": "polygon(38% 0,62% 0,62% 38%,100% 38%,100% 62%,62% 62%,62% 100%,38% 100%,38% 62%,0 62%,0 38%,38% 38%)",
    "cone": "polygon(0 0,100% 0,50% 100%)",
}
"""The shapes of `markers.shape` that are no square, in small."""


def answer(report: PlacementReport) -> str:
    """The first sentence: how many gauges tell what, how well, how far from the best, and which unknown is weakest."""
    gauges, pool = len(report.layout.gauges), int(report.trend.count[0])
    glued = sum(gauge.glued for gauge in report.layout.gauges)
    word = "gauge" if {gauge.kind for gauge in report.layout.gauges} <= SINGLE else "sensor"
    many = f"{word}{'s' * (gauges != 1)}, {f'{glued} of them glued already, ' * bool(glued)}chosen"
    known = [unknown for unknown in report.unknowns if _sigma(unknown) is not None]
    parts = [f"{escape(unknown.name)} to within ±{share(_sigma(unknown))}" for unknown in known]
    text = f"<strong>{gauges} {many} from {pool} candidates</strong>"
    relative = ", of a load relative to its RMS" if any(unknown.kind == "input" for unknown in known) else ""
    if parts:
        text += f" tell {_join(parts)} (one standard deviation{relative})."
    elif report.unknowns:
        text += f" tell {_join([escape(unknown.name) for unknown in report.unknowns])}."
    else:
        text += "."
    tested = [unknown for unknown in report.unknowns if unknown.error is not None]
    if tested:
        errors = _join([f"{share(unknown.error)} for {escape(unknown.name)}" for unknown in tested])
        text += f" In a simulated test the error was {errors}."
    if report.trend.gap is not None:
        most = share(max(report.trend.gap, 0.0))
        text += f" No other set of {gauges} from this pool can lower the metric by more than {most}."
    if len(known) > 1:
        weakest = max(known, key=lambda unknown: _sigma(unknown) or 0.0)
        text += f" The weakest unknown is {escape(weakest.name)}."
    lost = [repeats.name for repeats in report.repeats if repeats.verdict == "not identified"]
    if lost:
        text += f" <strong>Not identified: {_join([escape(name) for name in lost])}</strong> (see the repeats below)."
    return text


def first_screen(report: PlacementReport, scene: bytes | None, problem: str) -> str:
    """The picture beside the numbers; the warnings under it where three tiles or more would leave a hole there."""
    lost = {repeats.name for repeats in report.repeats if repeats.verdict == "not identified"}
    tiles = "".join(_tile(unknown, unknown.name in lost) for unknown in report.unknowns) + _bound_tile(report)
    inside, after = (_panels(report), "") if len(report.unknowns) > 1 else ("", _panels(report))
    left = f"<div>{_picture(report, scene, problem)}{inside}</div>"
    return f'<div class="first">{left}<div class="tiles">{tiles}</div></div>{after}'


def _sigma(unknown: Unknown) -> float | None:
    """The standard deviation to show first: the filter's own where it ran, else what placement expects."""
    return unknown.expected_std if unknown.std is None else unknown.std


def _join(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1] if parts else ""


def _tile(unknown: Unknown, lost: bool) -> str:
    """One unknown: its estimate and band, beside guess and truth."""
    kind = "load" if unknown.kind == "input" else "parameter"
    sigma = _sigma(unknown)
    if unknown.kind == "parameter" and unknown.estimate is not None:
        value = measure(unknown.estimate, unknown.unit) + (
            f" <small>± {share(sigma)}</small>" if sigma is not None else ""
        )
    else:
        value = f"± {share(sigma)}"
    rows: list[tuple[str, str]] = []
    if unknown.kind == "parameter":
        rows += [
            ("true value", measure(unknown.truth, unknown.unit)),
            ("first guess", measure(unknown.guess, unknown.unit)),
        ]
    else:
        rows += [
            ("true RMS", measure(unknown.truth, unknown.unit)),
            ("estimated RMS", measure(unknown.estimate, unknown.unit)),
        ]
    rows.append(("error in the test", share(unknown.error)))
    if unknown.smoothed_error is not None:
        rows.append(("error after smoothing", share(unknown.smoothed_error)))
    rows.append(("σ, filter", share(unknown.std)))
    rows.append(("σ, expected when placed", share(unknown.expected_std)))
    items = "".join(f"<dt>{name}</dt><dd>{text}</dd>" for name, text in rows if text != "–")
    return (
        f'<section class="card tile"><div class="name">{escape(unknown.name)}, {kind}</div>'
        f'<div class="value">{value}</div><dl>{items}</dl>{_mark(unknown, lost)}</section>'
    )


def _mark(unknown: Unknown, lost: bool) -> str:
    """Whether the claim held in the test and over the repeats: a sure filter can be wrong."""
    if lost:
        return '<p class="mark bad">✕ not identified: the repeats disagree</p>'
    if unknown.error is None or not unknown.std:
        return ""
    ratio = unknown.error / unknown.std
    if ratio <= 2:
        return f'<p class="mark good">✓ error is {plain(ratio, 2)} σ, as claimed</p>'
    return f'<p class="mark bad">✕ error is {plain(ratio, 2)} σ: the claim did not hold</p>'


def _bound_tile(report: PlacementReport) -> str:
    """How far the chosen set can be from the best one."""
    trend = report.trend
    rows = [("metric tr(W P), chosen set", plain(trend.final_trace))]
    if trend.lower_bound is not None:
        rows.append(("no set can go below", plain(trend.lower_bound)))
    rows.append((f"all {int(trend.count[0])} gauges", plain(float(trend.trace[0]))))
    others = [entry for entry in report.criteria[1:] if math.isfinite(entry.trace)]
    if others:
        best = min(others, key=lambda entry: entry.trace)
        rows.append((f"best other rule ({escape(best.rule)})", plain(best.trace)))
    items = "".join(f"<dt>{name}</dt><dd>{text}</dd>" for name, text in rows)
    gap = (
        "not certified"
        if trend.gap is None
        else f"{share(max(trend.gap, 0.0))} <small class='under'>at most, above the best set</small>"
    )
    size = ' style="font-size:1.3rem"' if trend.gap is None else ""
    return (
        '<section class="card tile"><div class="name">distance from the best possible</div>'
        f'<div class="value"{size}>{gap}</div><dl>{items}</dl></section>'
    )


def _picture(report: PlacementReport, scene: bytes | None, problem: str) -> str:
    """Where the gauges go, as a picture with its key."""
    layout = report.layout
    if scene is None:
        shown = f"<p><strong>No picture.</strong> {escape(problem)}</p>" if problem else ""
    else:
        places = decimals(layout.points)
        where = "; ".join(f"{gauge.label} at {coordinates(gauge.position, places)} m" for gauge in layout.gauges)
        alt = f"The structure from one or two sides with its {len(layout.gauges)} gauges: {where}."
        key = [("var(--muted)", name, text) for name, text in _kinds(layout.gauges)]
        key.append((picture.POOL, "dot", f"{len(layout.pool)} candidates in the pool"))
        if layout.loads:
            key.append(
                (
                    VERMILION,
                    "",
                    "load "
                    + ", ".join(f"{load.name} ({'known' if load.known else 'unknown'})" for load in layout.loads),
                )
            )
        if len(layout.fixed):
            key.append((picture.CLAMP, "", "clamped nodes"))
        if len(layout.loose):
            key.append((picture.LINES, "", "nodes outside the solids"))
        items = "".join(_key(*entry) for entry in key)
        shown = (
            '<div class="scene" tabindex="0" role="region" aria-label="picture of the gauges">'
            f'<img alt="{escape(alt)}" width="1200" height="700" '
            f'src="data:image/png;base64,{base64.b64encode(scene).decode()}"></div><ul class="key">{items}</ul>'
        )
    return f'<figure class="card"><h2>Where the gauges go</h2>{shown}</figure>'


def _kinds(gauges: tuple[Gauge, ...]) -> list[tuple[str, str]]:
    """Which marks stand for sensors, and how many of each kind: only what occurs."""
    count = Counter(gauge.kind for gauge in gauges)
    marks = [(shape(kind), f"{many} {kind}{'s' * (many > 1)}") for kind, many in count.items()]
    glued = sum(gauge.glued for gauge in gauges)
    return marks + [("hollow", f"{glued} of them glued already")] * bool(glued)


def _key(colour: str, name: str, text: str) -> str:
    """One entry of the picture's key: a small shape in its colour, and its words."""
    outline = f";clip-path:{OUTLINES[name]}" if name in OUTLINES else ""
    style = f"background:{colour}{outline}" if name != "hollow" else f"background:#ffffff;border:2px solid {colour}"
    return f'<li><i class="{name}" style="{style}"></i>{escape(text)}</li>'


def _panels(report: PlacementReport) -> str:
    """What to do with the layout, the warnings, and what was not tested."""
    panels = ""
    if report.advice:
        panels += f'<section class="card notes"><h3>What to do with this layout</h3>{bullets(report.advice)}</section>'
    if report.warnings:
        panels += f'<section class="card warnings"><h3>Warnings</h3>{bullets(report.warnings)}</section>'
    if report.not_tested:
        panels += f'<section class="card notes"><h3>Not tested</h3>{bullets(report.not_tested)}</section>'
    return f'<div class="panels">{panels}</div>' if panels else ""

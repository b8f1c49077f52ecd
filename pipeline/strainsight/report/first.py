"""The first screen of a placement report: where the gauges go, what they will tell and how well, and what to mind."""

from __future__ import annotations

import base64
import math
from html import escape

import numpy as np

from strainsight.report import picture
from strainsight.report.data import FloatArray, Gauge, PlacementReport, Unknown
from strainsight.report.drawing import VERMILION
from strainsight.report.markup import badge, bullets, measure, plain, share, table
from strainsight.report.text import number


def answer(report: PlacementReport) -> str:
    """The first sentence: how many gauges tell what, how well, how far from the best, and which unknown is weakest."""
    gauges, pool = len(report.layout.gauges), int(report.trend.count[0])
    many = "gauge, chosen" if gauges == 1 else "gauges, chosen"
    known = [unknown for unknown in report.unknowns if _sigma(unknown) is not None]
    parts = [f"{escape(unknown.name)} to within ±{share(_sigma(unknown))}" for unknown in known]
    text = f"<strong>{gauges} {many} from {pool} candidates</strong>"
    relative = ", of a load relative to its RMS" if any(unknown.kind == "input" for unknown in known) else ""
    text += (
        f" tell {_join(parts)} (one standard deviation{relative})."
        if parts
        else " tell " + _join([escape(unknown.name) for unknown in report.unknowns]) + "."
    )
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
    finite = {name: value for name, value in report.baselines.items() if math.isfinite(value)}
    if finite:
        best = min(finite, key=lambda name: finite[name])
        rows.append((f"best baseline ({escape(best)})", plain(finite[best])))
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
        where = "; ".join(
            f"{gauge.label} at {_coordinates(gauge.position, _decimals(layout.points))} m" for gauge in layout.gauges
        )
        alt = f"The structure from one or two sides with its {len(layout.gauges)} gauges: {where}."
        key = [(picture.POOL, "dot", f"{len(layout.pool)} candidates in the pool")]
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
        items = "".join(
            f'<li><i class="{shape}" style="background:{colour}"></i>{escape(text)}</li>' for colour, shape, text in key
        )
        shown = (
            '<div class="scene" tabindex="0" role="region" aria-label="picture of the gauges">'
            f'<img alt="{escape(alt)}" width="1200" height="700" '
            f'src="data:image/png;base64,{base64.b64encode(scene).decode()}"></div><ul class="key">{items}</ul>'
        )
    return f'<figure class="card"><h2>Where the gauges go</h2>{shown}</figure>'


def _panels(report: PlacementReport) -> str:
    """The warnings and what was not tested."""
    panels = ""
    if report.warnings:
        panels += f'<section class="card warnings"><h3>Warnings</h3>{bullets(report.warnings)}</section>'
    if report.not_tested:
        panels += f'<section class="card notes"><h3>Not tested</h3>{bullets(report.not_tested)}</section>'
    return f'<div class="panels">{panels}</div>' if panels else ""


def gauge_table(report: PlacementReport) -> str:
    gauges = report.layout.gauges
    places = _decimals(report.layout.points)
    names = [unknown.name for unknown in report.unknowns if any(unknown.name in gauge.without for gauge in gauges)]
    sigma = {unknown.name: unknown.expected_std for unknown in report.unknowns}

    def row(index: int, gauge: Gauge) -> list[str]:
        nodes = " ".join(str(node) for node in gauge.nodes) or "–"
        left_out = [share(gauge.without.get(name, math.nan)) for name in names]
        return [
            badge(gauge.label, index), str(gauge.element), str(gauge.facet or "–"), nodes,
            _whole(_coordinates(gauge.position, places)), _whole(_direction(gauge.direction)),
            f"{number(gauge.angle, 3)}°", *left_out,
        ]  # fmt: skip

    head = ["gauge", "element", "facet", "nodes", "x y z [m]", "direction", "angle"]
    head += [f"σ({escape(name)}) without it" for name in names]
    foot = (
        ["all together", *[""] * 6, *[share(sigma[name]) for name in names]]
        if any(sigma[n] is not None for n in names)
        else []
    )
    caption = (
        "Ids are those of the mesh file; direction is the measuring one in global axes, angle from the projected axis."
    )
    if any(math.isinf(value) for gauge in gauges for value in gauge.without.values()):
        caption += " ∞: without that gauge the unknown can no longer be observed."
    rows = [row(i, gauge) for i, gauge in enumerate(gauges)]
    return table(head, rows, caption=caption, numeric=[1, 2, 6, *range(7, 7 + len(names))], foot=foot)


def _decimals(points: FloatArray) -> int:
    """Decimals that show a position to about a ten-thousandth of the structure's size."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    return min(max(4 - math.floor(math.log10(size)), 0), 9) if size > 0 else 4


def _coordinates(position: FloatArray, places: int) -> str:
    return " ".join(f"{round(float(value), places) + 0.0:.{places}f}".replace("-", "−") for value in position)


def _whole(text: str) -> str:
    return f'<span class="whole">{text}</span>'


def _direction(vector: FloatArray) -> str:
    return " ".join(number(round(float(value), 4), 4) for value in vector)

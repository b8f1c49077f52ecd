"""The still picture of a layout on a page: the PNG in its frame, what it shows in words, and the key to its marks."""

from __future__ import annotations

from collections import Counter
from html import escape

from strainsight.report.chart.drawing import VERMILION
from strainsight.report.page import markup
from strainsight.report.page.markup import coordinates, count, decimals
from strainsight.report.picture import picture
from strainsight.report.picture.layout import Gauge, Layout
from strainsight.report.picture.markers import shape

OUTLINES = {
    "bar": "polygon(0 30%,100% 30%,100% 70%,0 70%)",
    "star": "polygon(38% 0,62% 0,62% 38%,100% 38%,100% 62%,62% 62%,62% 100%,38% 100%,38% 62%,0 62%,0 38%,38% 38%)",
    "cone": "polygon(0 0,100% 0,50% 100%)",
}
"""The shapes of `markers.shape` that are no square, in small."""


def pictured(layout: Layout, scene: bytes | None, problem: str = "") -> str:
    """Where the gauges go, as a picture with its key; scene: PNG bytes, or None with the sentence on why ("": no card)."""
    if scene is None:
        shown = f"<p><strong>No picture.</strong> {escape(problem)}</p>" if problem else ""
    else:
        frame = layout.frame
        places = decimals(layout.points, frame)
        where = "; ".join(
            f"{gauge.label} at {coordinates(frame.place(gauge.position), places)} {frame.unit}"
            for gauge in layout.gauges
        )
        alt = f"The structure from one or two sides with its {len(layout.gauges)} gauges: {where}."
        key = [("var(--muted)", name, text) for name, text in _kinds(layout.gauges)]
        key.append((picture.POOL, "dot", f"{count(len(layout.pool))} candidates in the pool"))
        if layout.loads:
            loads = [f"{escape(load.name)} ({'known' if load.known else 'unknown'})" for load in layout.loads]
            key.append((VERMILION, "", f"load {', '.join(loads)}"))
        if len(layout.fixed):
            key.append((picture.CLAMP, "", "clamped nodes"))
        if len(layout.loose):
            key.append((picture.LINES, "", "nodes outside the solids"))
        items = "".join(_key(*entry) for entry in key)
        shown = (
            '<div class="scene" tabindex="0" role="region" aria-label="picture of the gauges">'
            f'{markup.picture(scene, alt, 1280, 840)}</div><ul class="key">{items}</ul>'
        )
    return f'<figure class="card"><h2>Where the gauges go</h2>{shown}</figure>' if shown else ""


def _kinds(gauges: tuple[Gauge, ...]) -> list[tuple[str, str]]:
    """Which marks stand for sensors, and how many of each kind, as HTML: only what occurs."""
    found = Counter(gauge.kind for gauge in gauges)
    marks = [(shape(kind), f"{count(many)} {escape(kind)}{'s' * (many > 1)}") for kind, many in found.items()]
    bonded = sum(gauge.bonded for gauge in gauges)
    return marks + [("hollow", f"{count(bonded)} of them bonded already")] * bool(bonded)


def _key(colour: str, name: str, text: str) -> str:
    """One entry of the picture's key: a small shape in its colour, and its words as HTML."""
    outline = f";clip-path:{OUTLINES[name]}" if name in OUTLINES else ""
    style = f"background:{colour}{outline}" if name != "hollow" else f"background:#ffffff;border:2px solid {colour}"
    return f'<li><i class="{name}" style="{style}"></i>{text}</li>'

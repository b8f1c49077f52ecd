"""Section of a page with the interactive 3D view of the structure, and its data."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.chart.drawing import gauge_colour, ink_on
from strainsight.pages.page.markup import coordinates, decimals, measure
from strainsight.pages.picture.geometry import scale_bar, stops
from strainsight.pages.picture.layout import Gauge, PictureLayout
from strainsight.pages.space.model import ShownState, Space, space, vertex_shift
from strainsight.positions import PositionAxes
from strainsight.text import number, percent

AXES = (
    '<svg id="space-axes" viewBox="-44 -44 88 88" aria-hidden="true">'
    + "".join(f'<g><line/><text dy=".35em">{name}</text></g>' for name in "xyz")
    + "</svg>"
)

MANNERS = (
    "Drag to rotate; drag with Shift or the right button to move. Zoom with two fingers or, after a click, with the mouse wheel. "
    "Click a gauge to show its position."
)
VIEWS = (
    '<span class="views"><button type="button" data-eye="home">Reset</button>'
    + "".join(f'<button type="button" data-eye="{axis}" aria-label="from {axis}">{axis}</button>' for axis in "xyz")
    + '<button type="button" data-zoom="1.25" aria-label="zoom in">+</button>'
    '<button type="button" data-zoom="0.8" aria-label="zoom out">−</button></span>'
)

TRUE_SIZE = (
    '<button type="button" id="space-true" aria-pressed="false" title="gauges at true scale; zoom in to see them">Gauges to scale'
    "</button>"
)


def space_section(
    layouts: Sequence[tuple[str, PictureLayout]], shapes: Sequence[ShownState] = (), name: str = "", first: int = -1
) -> str:
    """View with buttons, a chip for every gauge, and details of the selected gauge, as HTML.

    layouts: caption and layout on one structure; shapes: selectable states by group; name: of the body, if there are several;
    first: initial state, −1: undeformed without colours. The section is hidden until its script runs."""
    if not layouts or not len(layouts[0][1].points):
        return ""
    model = space([layout for _, layout in layouts])
    bars = ""
    for i, shape in enumerate(shapes):
        if (contour := shape.contour) is not None:
            # extremes of the surface: the ends of a symmetric scale differ
            least, largest = (measure(value, contour.scale.unit, 3) for value in (contour.least, contour.largest))
            extremes = f'<p class="note">Values from {least} to {largest}, at the facet centres.</p>'
            bars += f'<div data-state="{i}"{" hidden" * (i != first)}>{scale_bar(contour.scale)}{extremes}</div>'
    bar = f'<div id="space-bars" aria-live="polite">{bars}</div>' if bars else ""
    true = any(part.when == "scale" for part in model.parts)
    choices = _choices([caption for caption, _ in layouts], shapes, first) + TRUE_SIZE * true
    gauges = [
        _gauge(gauge, i, group, layout.frame, decimals(layout.points, layout.frame))
        for group, (_, layout) in enumerate(layouts)
        for i, gauge in enumerate(layout.gauges)
    ]
    many = str(len(gauges)) if len(layouts) == 1 else ""
    what = f"The structure with its {many} gauge{'s' * (len(gauges) != 1)}" if gauges else "The structure"
    return (
        f'<section id="space" class="card" hidden><h2>{escape(name or "The structure")} in space</h2>'
        f'<div class="space-frame"><div><div id="space-view" tabindex="0" role="application" aria-label="{what}: '
        f'arrow keys rotate, plus and minus zoom, 0 resets"><canvas></canvas>{AXES}</div>{bar}'
        f'<div class="space-controls">{VIEWS}{choices}</div></div>'
        f'<div class="space-side">{_side(gauges)}</div></div>'
        f'<p class="note">{MANNERS}{" The mesh is simplified for this view." * model.thinned}</p></section>'
        f'<script type="application/json" id="space-data">{_data(model, gauges, shapes, first)}</script>'
    )


def _side(gauges: Sequence[Mapping[str, Any]]) -> str:
    """Chips of the gauges, and the element for details of the selected gauge."""
    if not gauges:
        return ""
    chips = "".join(
        f'<button type="button" class="chip" data-gauge="{escape(gauge["label"])}" data-index="{i}" aria-pressed="false" '
        f'style="background:{gauge["colour"]};color:{gauge["ink"]}"{" hidden" * (gauge["group"] > 0)}>'
        f"{escape(gauge['label'])}</button>"
        for i, gauge in enumerate(gauges)
    )
    return (
        f'<div class="chips" role="group" aria-label="gauges">{chips}</div><div id="space-picked" aria-live="polite">'
        '<p class="note">Select a gauge to show its position.</p></div>'
    )


def _choices(captions: Sequence[str], shapes: Sequence[ShownState], first: int) -> str:
    """Selection of layout and state."""

    def options(names: Iterable[tuple[int, str]]) -> str:
        return "".join(f'<option value="{i}"{" selected" * (i == first)}>{escape(name)}</option>' for i, name in names)

    text = ""
    if len(captions) > 1:
        listed = "".join(f'<option value="{i}">{escape(name)}</option>' for i, name in enumerate(captions))
        text += f'<label>Gauges of <select id="space-layout">{listed}</select></label>'
    if shapes:
        groups: dict[str, list[tuple[int, str]]] = {}
        for i, shape in enumerate(shapes):
            groups.setdefault(shape.group, []).append((i, shape.caption))
        offered = "".join(
            f'<optgroup label="{escape(name)}">{options(members)}</optgroup>' for name, members in groups.items()
        )
        text += (
            f'<label>Show <select id="space-shape">{options([(-1, "undeformed body")])}{offered}</select></label>'
            '<button type="button" id="space-play" hidden>Hold</button>'
        )
    return text


def _data(model: Space, gauges: Sequence[Mapping[str, Any]], shapes: Sequence[ShownState], first: int) -> str:
    """Data of the script as JSON: numbers, texts, and all arrays as compressed, base64-coded bytes.
    Positions are 16-bit fractions of the bounding box; normals and shifts have 8 bits, about a pixel. A contour has one byte per
    vertex: position on the scale from 0 to 254, 255 without a value."""
    low, span = model.position.min(axis=0), np.ptp(model.position, axis=0)
    span = np.where(span > 0, span, 1.0)
    arrays = [
        np.round((model.position - low) / span * 65535).astype("<u2"),
        np.round(127 * model.normal).astype("i1"),
        model.colour,
        *(part.index.astype("<u4") for part in model.parts),
    ]
    states = []
    for shape in shapes:
        state: dict[str, Any] = {"largest": 0.0, "stops": []}
        if len(shape.shift):
            shift = vertex_shift(model, shape)
            state["largest"] = float(np.abs(shift).max(initial=0.0)) or 1.0
            arrays.append(np.round(127 * shift / state["largest"]).astype("i1"))
        if shape.contour is not None:
            share = shape.contour.scale.share(shape.contour.values[model.source[: model.surface]])
            arrays.append(np.where(np.isfinite(share), np.round(254 * np.nan_to_num(share)), 255).astype("u1"))
            state["stops"] = [rgb.tolist() for rgb in stops(shape.contour.scale)]
        states.append(state)
    content = {
        "low": low.tolist(),
        "span": span.tolist(),
        "vertices": len(model.position),
        "eye": model.eye.tolist(),
        "parts": [
            {"count": int(part.index.size)}
            | {key: getattr(part, key) for key in ("primitive", "colour", "size", "group", "when")}
            for part in model.parts
        ],
        "surface": model.surface,
        "states": states,
        "first": first,
        "gauges": [{**gauge, "anchor": anchor} for gauge, anchor in zip(gauges, model.anchor, strict=True)],
        "arrays": base64.b64encode(zlib.compress(b"".join(array.tobytes() for array in arrays), 9)).decode(),
    }
    return json.dumps(content, allow_nan=False).replace("<", "\\u003c")


def _vector(direction: FloatArray) -> str:
    return " ".join(number(round(float(value), 4), 4) for value in direction)


def _place(position: FloatArray, frame: PositionAxes, places: int) -> str:
    return f"{coordinates(frame.place(position), places)} {frame.unit}"


def _gauge(gauge: Gauge, index: int, group: int, frame: PositionAxes, places: int) -> dict[str, Any]:
    """Marker data and details of a gauge."""
    text = [("kind", gauge.kind)]
    text += [("element" if gauge.facet else "number", str(gauge.element))] * bool(gauge.element)
    text += [("facet", str(gauge.facet))] * bool(gauge.facet)
    text += [("nodes", " ".join(map(str, gauge.nodes)))] * bool(gauge.nodes)
    text.append(
        (
            "position" if frame.is_deck_system else "position relative to the datum",
            _place(gauge.position, frame, places),
        )
    )
    for direction in gauge.channels:
        text.append(("direction", _vector(frame.turn(direction))))
    for k, arm in enumerate(gauge.arms):
        where = f"{_place(arm.position, frame, places)}, direction {_vector(frame.turn(arm.direction))}"
        text.append((f"arm {k + 1}, {'+' if arm.sign > 0 else '−'}", where))
    text += [("angle", f"{number(gauge.angle, 3)}°")] * bool(gauge.element)
    text += [
        (f"σ({name}) without gauge", "not observable" if math.isinf(value) else percent(value))
        for name, value in gauge.without.items()
        if not math.isnan(value)
    ]
    return {
        "label": gauge.label,
        "group": group,
        "colour": gauge_colour(index),
        "ink": ink_on(gauge_colour(index)),
        "position": np.asarray(gauge.position, dtype=float).tolist(),
        "normal": np.asarray(gauge.normal, dtype=float).tolist(),
        "details": text,
    }

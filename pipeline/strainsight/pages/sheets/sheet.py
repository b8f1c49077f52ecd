"""Drawing sheet (A4) of a gauge for the workshop, without a date, and the sheets on a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.pages.arrays import FloatArray, round_factor
from strainsight.pages.sheets import views
from strainsight.text import short

EDGE, COLUMN = 8.0, 196.0
"""[mm] from the border of the paper to the frame; position of the right column."""
MARGIN, BETWEEN, ABOVE = 22.0, 34.0, 20.0
"""[mm] to the left of the views, between them and above the upper view, for dimensions and captions."""
WINDOW = (42.0, 33.0)
"""Half width and height of the detail [mm]."""
NEAR = 2.0
"""Distance in carrier lengths up to which the detail shows the nearest edge."""
OUTSIDE, THROUGH = (
    "View from outside, along the normal",
    "View along the normal, through the part in front of the gauge",
)


def sheet_svg(sheet: views.Sheet) -> str:
    """Sheet as a self-contained SVG text."""
    paper = views.Paper()
    right, bottom = views.WIDTH - EDGE, views.HEIGHT - EDGE
    paper.path([(EDGE, EDGE), (right, EDGE), (right, bottom), (EDGE, bottom), (EDGE, EDGE)], views.THICK)
    paper.path([(COLUMN, EDGE), (COLUMN, views.HEIGHT - EDGE)])
    ratio = _views(paper, sheet)
    enlarged = _detail(paper, sheet)
    for i, (name, value) in enumerate(_rows(sheet)):
        y = 88.0 + 4.7 * i
        paper.text((COLUMN + 3, y), name, size=2.9)
        paper.text((COLUMN + 36, y), value, size=2.9, bold=True)
    _title(paper, sheet, 171.0, f"scale: views {ratio}, detail {enlarged}")
    return paper.svg(f"Drawing sheet of {sheet.name}")


def _views(paper: views.Paper, sheet: views.Sheet) -> str:
    """Draw the part against the normal of the gauge and, below, from the side; return their scale as text."""
    shown = _near_datum(sheet)
    boxes = [_extent(view, sheet, shown) for view in (sheet.front, sheet.side)]
    (low, high), (low2, high2) = boxes
    width, height = high[0] - low[0], (high - low)[1] + (high2 - low2)[1]
    room = COLUMN - EDGE - MARGIN - 8.0, views.HEIGHT - 2 * EDGE - ABOVE - BETWEEN - 8.0
    ratio = round_factor(min(room[0] / max(width, 1e-12), room[1] / max(height, 1e-12)) / _millimetres(sheet))
    scale = ratio * _millimetres(sheet)
    left = EDGE + MARGIN + 0.5 * (room[0] - scale * width)
    top = EDGE + ABOVE + 0.5 * (room[1] - scale * height)
    top2 = top + scale * (high - low)[1] + BETWEEN
    for view, (near, far), y, caption in (
        (sheet.front, boxes[0], top, OUTSIDE if sheet.outside else THROUGH),
        (sheet.side, boxes[1], top2, "Side view, surface normal upward"),
    ):
        placed = views.PlacedView(view, np.array([low[0], far[1]]), (left, y), scale)
        bottom = y + scale * float(far[1] - near[1])
        paper.text((EDGE + 4, y - 15.5), f"{caption}, {_ratio_text(ratio)}", size=3.0)
        views.outline(paper, placed)
        front = view is sheet.front
        if front:
            views.foil(paper, placed, sheet, axis=2.0)
            views.to_edges(paper, placed, sheet)
        else:
            views.profile(paper, placed, sheet)
        if shown:
            views.datum(paper, placed)
            views.from_datum(paper, placed, sheet, (bottom, left), across=front)
    return _ratio_text(ratio)


def _detail(paper: views.Paper, sheet: views.Sheet) -> str:
    """Draw the enlarged gauge; return its scale as text."""
    reach = 0.75 * sheet.carrier[0]
    if sheet.distance[0] <= NEAR * sheet.carrier[0]:
        reach = max(reach, 1.3 * float(sheet.distance[0]))
    ratio = round_factor(WINDOW[1] / reach / _millimetres(sheet))
    centre = ((COLUMN + views.WIDTH - EDGE) / 2, EDGE + 8 + WINDOW[1])
    viewed = "from outside" if sheet.outside else "against the normal"
    paper.text((COLUMN + 3, EDGE + 4), f"Gauge viewed {viewed}, {_ratio_text(ratio)}", size=3.0)
    views.detail(paper, sheet, centre, WINDOW, ratio * _millimetres(sheet))
    return _ratio_text(ratio)


def _rows(sheet: views.Sheet) -> Iterator[tuple[str, str]]:
    frame = sheet.frame
    for axis, value in zip("xyz", sheet.position, strict=True):
        yield f"{axis} relative to datum", f"{views.size(value, sheet)} {frame.unit}"
    for k, d in enumerate(sheet.directions, start=1):
        yield f"measuring direction {k}" if len(sheet.directions) > 1 else "measuring direction", _vector(d)
    yield "normal", _vector(sheet.normal)
    for name, distance, angle in zip(("nearest edge", "transverse edge"), sheet.distance, sheet.angle, strict=True):
        if np.isfinite(distance):
            turn = f", at {views.degrees(angle)}" if np.isfinite(angle) else ""
            yield name, f"{views.size(distance, sheet)} {frame.unit}{turn}"
    if sheet.strain:
        yield "measuring grid", f"{views.size(sheet.grid, sheet)} {frame.unit}" if sheet.grid else "grid length unknown"
        if len(sheet.directions) == 1:
            yield (
                "carrier size as drawn",
                " × ".join(views.size(side, sheet) for side in sheet.carrier) + f" {frame.unit}, {sheet.carrier_of}",
            )
    yield "element, facet", f"{sheet.element}, {sheet.facet}"
    yield "datum origin in mesh", f"({_numbers(frame.origin)}) {frame.unit}"
    if not np.array_equal(frame.axes, np.eye(3)):
        yield "datum x axis in mesh", _vector(frame.axes[0])
        yield "datum y axis in mesh", _vector(frame.axes[1])


def _title(paper: views.Paper, sheet: views.Sheet, top: float, scales: str) -> None:
    right = views.WIDTH - EDGE
    paper.path([(COLUMN, top), (right, top)], views.THICK)
    paper.text((COLUMN + 3, top + 6), sheet.name, size=6.0, bold=True)
    paper.text((right - 3, top + 6), sheet.kind, size=3.4, anchor="end")
    lines = (
        f"lengths in {sheet.frame.unit}; angles counter-clockwise about the normal",
        f"{scales} (printed at 100 % on A4)",
        f"mesh file {short(sheet.deck, 32)}",
        f"run {short(sheet.run, 32)}, layout {sheet.layout}",
    )
    for i, words in enumerate(lines):
        paper.text((COLUMN + 3, top + 13 + 4.4 * i), words, size=2.7)


def _extent(view: views.Projection, sheet: views.Sheet, with_datum: bool) -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right corner (2,) [unit] of a view."""
    points = [
        view.visible.reshape(-1, 3),
        view.hidden.reshape(-1, 3),
        sheet.position[None],
        *[np.zeros((1, 3))] * with_datum,
    ]
    flat = view.flat(np.concatenate(points))
    return flat.min(axis=0), flat.max(axis=0)


def _near_datum(sheet: views.Sheet) -> bool:
    """Whether the distance of the datum from the part is at most half its size; else the datum is not shown."""
    points = sheet.front.visible.reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    off = np.linalg.norm(np.maximum(np.maximum(low, -high), 0.0))
    return bool(off <= 0.5 * np.linalg.norm(high - low))


def _millimetres(sheet: views.Sheet) -> float:
    """Millimetres per unit of the sheet."""
    return 1e3 * sheet.frame.metres


def _ratio_text(ratio: float) -> str:
    return f"{ratio:g}:1" if ratio >= 1 else f"1:{1 / ratio:.4g}"


def _vector(d: FloatArray) -> str:
    return f"({_numbers(np.round(d, 4))})"


def _numbers(values: FloatArray) -> str:
    return " ".join(f"{round(float(v), 4) + 0.0:g}" for v in values).replace("-", views.MINUS)


LARGEST = 2_000_000
"""Largest total size of the sheets on a page [bytes]; further sheets are in files only."""


def sheets_section(sheets: Sequence[bytes]) -> str:
    """Collapsed section with the sheets, empty without sheets."""
    shown, room = [], LARGEST
    for sheet in sheets:
        room -= len(sheet)
        if room < 0:
            break
        # Without the size in millimetres, which is for printing: the page scales the sheet.
        text = sheet.decode()
        shown.append(f'<figure class="card">{text.replace(views.SIZE, "", 1)}</figure>')
    if not sheets:
        return ""
    more = len(sheets) - len(shown)
    rest = f" To limit its size, this page omits {more} sheet{'s' * (more > 1)}, available as files only." * bool(more)
    return (
        f"<details><summary>{len(sheets)} drawing sheet{'s' * (len(sheets) > 1)} for the workshop</summary>"
        f'<p class="note">For printing at 100 % on A4, use the files sheet-….svg in the folder of this page.{rest}</p>'
        f"{''.join(shown)}</details>"
    )

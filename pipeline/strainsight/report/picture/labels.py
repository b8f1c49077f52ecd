"""Names over the picture: who is where, set so that none covers another, by matplotlib."""

from __future__ import annotations

import io
import warnings
from typing import Any

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.chart.drawing import VERMILION, gauge_colour, ink_on, styled
from strainsight.report.picture.layout import Layout
from strainsight.report.picture.markers import EMPTY, free_end
from strainsight.report.text import short

CAPTION = "#7b8794"
FONT = 10.0
"""Size of a name [pt], 100 pixels of the page an inch."""
WIDE, HIGH, MARGIN = 4.6, 12.5, 7.5
"""Half the width of a name is MARGIN + WIDE a letter, half its height HIGH [px]."""


@styled({})
def labelled(layout: Layout, panels: list[Any], rows: int, columns: int, size: tuple[int, int], finer: int) -> bytes:
    """The views side by side or one above the other, with names, axes and a word on where one looks from."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = size[0] * columns, size[1] * rows
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    FigureCanvasAgg(figure)
    figure.patch.set_alpha(0)
    middle = layout.points.mean(axis=0)
    diagonal = float(np.linalg.norm(np.ptp(layout.points, axis=0)))
    for place, (image, pixels, seen, named, corner) in enumerate(panels):
        row, column = divmod(place, columns)
        axes = figure.add_axes((column / columns, 1 - (row + 1) / rows, 1 / columns, 1 / rows))
        axes.imshow(image, extent=(0, size[0], size[1], 0), interpolation="none", aspect="auto")
        axes.set_axis_off()
        centre = pixels(middle[None])[0]
        anchors, names, colours, hollow, away = [], [], [], [], []
        for i, gauge in enumerate(layout.gauges):
            if seen[i]:
                anchors.append(pixels(gauge.position[None])[0])
                names.append(short(gauge.label))
                colours.append(gauge_colour(i))
                hollow.append(gauge.bonded)
                away.append(np.array([0.0, -1.0 if anchors[-1][1] <= centre[1] else 1.0]))
        for load, shown in zip(layout.loads, named, strict=True):
            if not shown:
                continue
            fixed, free = pixels(np.array([load.point, free_end(load, layout)]))
            anchors.append(free)
            away.append((free - fixed) / max(float(np.linalg.norm(free - fixed)), 1.0))
            names.append(short(load.name))
            colours.append(VERMILION)
            hollow.append(False)
        places = spread_labels(np.array(anchors).reshape(-1, 2), np.array(away).reshape(-1, 2), names, size)
        for anchor, spot, name, colour, empty in zip(anchors, places, names, colours, hollow, strict=True):
            ground = EMPTY if empty else colour
            axes.annotate(
                name,
                xy=anchor,
                xytext=spot,
                ha="center",
                va="center",
                fontsize=FONT,
                fontweight="bold",
                color=ink_on(ground),
                parse_math=False,
                bbox={
                    "boxstyle": "round,pad=0.32",
                    "fc": ground,
                    "ec": colour if empty else "white",
                    "lw": 2.2 if empty else 0.8,
                },
                arrowprops={"arrowstyle": "-", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 2},
            )
        _triad(axes, pixels, middle, diagonal, size)
        side = "above" if corner[2] > 0 else "below"
        axes.text(8, 13, f"seen from {side}", color=CAPTION, fontsize=FONT, va="center")
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(buffer, format="png", dpi=100 * finer, transparent=True, metadata={"Software": None})
    return buffer.getvalue()


def spread_labels(anchors: FloatArray, away: FloatArray, names: list[str], size: tuple[int, int]) -> FloatArray:
    """Where labels go: off their anchors, inside the picture, and none on another.

    anchors (k, 2) [pixel], away (k, 2) the direction each would go by itself; returns (k, 2). Labels are taken in turn;
    each tries rings of growing distance, turning from its own direction, and takes the first place that is free.
    """
    half = np.array([[MARGIN + WIDE * len(name), HIGH] for name in names]).reshape(-1, 2)
    places: list[FloatArray] = []
    for i, (anchor, ahead) in enumerate(zip(anchors, away, strict=True)):
        aside = np.array([-ahead[1], ahead[0]])
        options = [
            np.clip(
                anchor + radius * (np.cos(turn) * ahead + np.sin(turn) * aside),
                half[i] + 4,
                np.array(size) - half[i] - 4,
            )
            for radius in (28, 38, 50, 64, 82, 104, 130)
            for turn in np.radians([0, 25, -25, 50, -50, 75, -75, 105, -105, 130, -130, 180])
        ]
        free = (option for option in options if _is_free(option, half[i], places, half, anchors, i))
        places.append(next(free, options[0]))
    return np.array(places).reshape(-1, 2)


def _is_free(
    option: FloatArray, half: FloatArray, places: list[FloatArray], halves: FloatArray, anchors: FloatArray, own: int
) -> bool:
    for other, place in enumerate(places):
        if np.all(np.abs(option - place) < half + halves[other] + 4):
            return False
    others = np.delete(anchors, own, axis=0)
    return not np.any(np.all(np.abs(others - option) < half + 7, axis=1))


def _triad(axes: Any, pixels: Any, middle: FloatArray, diagonal: float, size: tuple[int, int]) -> None:
    """The global axes in the lower left corner."""
    base = np.array([40.0, size[1] - 38.0])
    step = 1e-3 * diagonal
    shift = pixels(middle + step * np.eye(3)) - pixels(middle[None])
    shift *= 26 / np.linalg.norm(shift, axis=1).max()
    for name, arrow in zip("xyz", shift, strict=True):
        axes.annotate(
            "",
            base + arrow,
            base,
            arrowprops={"arrowstyle": "-|>", "color": CAPTION, "lw": 1.3, "shrinkA": 0, "shrinkB": 0},
        )
        reach = float(np.linalg.norm(arrow))
        axes.text(
            *(base + arrow * (1 + 9 / max(reach, 6.0))), name, color=CAPTION, fontsize=FONT, ha="center", va="center"
        )

"""What `strainsight view` shows."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.picture.layout import Layout

POINTS, FACETS, DOTS = "points", "facets", "dots"
"""Where the values of a panel stand."""
NO_DISPLAY = 3
"""Exit code of the process that draws, where the display did not give it a window."""


@dataclass(frozen=True)
class Panel:
    """One picture of the structure: title; values (n,), (f,) or (d,) where the view says, none: plain; shift (n, 3) [m] of the
    points, none: where they are."""

    title: str = ""
    values: FloatArray = field(default_factory=lambda: np.empty(0))
    shift: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True)
class View:
    """A structure in one or more panels side by side.

    title; layout: structure, gauges, loads, grey dots (its pool); panels, all with as many values; quantity, unit: of the
    scalar bar; on: "points", "facets" or "dots"; dots (d, 3) [m]: coloured ones, where values stand on them;
    size: width and height of its picture [px]; bar: whether the scalar bar is in it.
    """

    title: str
    layout: Layout
    panels: tuple[Panel, ...] = (Panel(),)
    quantity: str = ""
    unit: str = ""
    on: str = POINTS
    dots: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    size: tuple[int, int] = (1400, 900)
    bar: bool = True


def untitled(view: View) -> View:
    """The same without words in the picture but for the scalar bar's."""
    return replace(view, title="", panels=tuple(replace(panel, title="") for panel in view.panels))


def exaggerated(points: FloatArray, shift: FloatArray, share: float = 0.06) -> float:
    """By what a displacement (n, 3) [m] is to be multiplied to be seen: a round factor with which the largest is about this
    share of the structure; 1 where it is larger by itself or nothing moves."""
    largest = float(np.linalg.norm(shift, axis=1).max(initial=0.0))
    if not largest > 0:
        return 1.0
    factor = share * float(np.linalg.norm(np.ptp(points, axis=0))) / largest
    if factor <= 1:
        return 1.0
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * max(step for step in (1, 2, 5) if step * power <= factor * (1 + 1e-9)))

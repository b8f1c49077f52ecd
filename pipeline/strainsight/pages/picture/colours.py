"""Values as colours, and the bar that says which colour is which value."""

from __future__ import annotations

from dataclasses import dataclass, replace
from html import escape

import numpy as np
from numpy.typing import NDArray

from strainsight.pages.arrays import FloatArray
from strainsight.pages.chart.drawing import matplotlib
from strainsight.pages.text import number

MAP, DIVERGING = "viridis", "coolwarm"
"""Of values of one sign, and of values about zero."""
STEPS = 9
"""Colours that a bar on a page is made of."""
TAIL = 0.01
"""Share of a surface that may have the colour of an end of its scale and more: a peak leaves the rest pale otherwise."""
WORTH = 0.8
"""Of the largest size: a scale that would end above it goes all the way."""


@dataclass(frozen=True)
class Scale:
    """quantity and unit in words; the values low and high at the ends of the bar; name of its colours; below, above: whether
    there are values beyond an end, which have its colour."""

    quantity: str
    unit: str
    low: float
    high: float
    name: str
    below: bool = False
    above: bool = False

    def share(self, values: FloatArray) -> FloatArray:
        """Where values are on the scale, 0 to 1."""
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)


def limits(values: FloatArray) -> tuple[float, float]:
    """From the least to the largest finite value; about zero where both signs occur."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if low < 0 < high:
        low, high = -max(-low, high), max(-low, high)
    return low, high if high > low else low + 1.0


def scale_of(quantity: str, unit: str, values: FloatArray, area: FloatArray | None = None) -> Scale:
    """The scale of these values; area (f,) [m²] of the facets that they are on: one that a peak does not stretch."""
    low, high = limits(values)
    whole = Scale(quantity, unit, low, high, DIVERGING if low < 0 < high else MAP)
    if area is None or not np.isfinite(values).any():
        return whole
    known = np.isfinite(values)
    return _without_peaks(whole, values[known], area[known])


def _without_peaks(scale: Scale, values: FloatArray, area: FloatArray) -> Scale:
    """The scale, its ends no farther from zero than the values (f,) on all but TAIL of the area (f,) [m²]."""
    order = np.argsort(np.abs(values))
    size, covered = np.abs(values)[order], np.cumsum(area[order])
    end = float(size[np.searchsorted(covered, (1 - TAIL) * covered[-1])])
    low, high = max(scale.low, -end), min(scale.high, end)
    if end > WORTH * size[-1] or not low < high:
        return scale
    return replace(scale, low=low, high=high, below=bool(values.min() < low), above=bool(values.max() > high))


def colours(scale: Scale, values: FloatArray, missing: str) -> NDArray[np.uint8]:
    """(n, 3) of 0 to 255; missing: "#rrggbb" of what is no number."""
    share = scale.share(values)
    rgb = np.asarray(matplotlib().colormaps[scale.name](np.nan_to_num(share)), dtype=float)[..., :3]
    found = np.round(255 * rgb).astype(np.uint8)
    found[~np.isfinite(share)] = np.frombuffer(bytes.fromhex(missing[1:]), np.uint8)
    return found


def stops(scale: Scale) -> NDArray[np.uint8]:
    """(STEPS, 3) of 0 to 255: the colours at equal distances from low to high, between which a page goes straight."""
    return colours(scale, np.linspace(scale.low, scale.high, STEPS), "#000000")


def gradient(scale: Scale) -> str:
    """The colours from low to high, as a background of CSS."""
    listed = ", ".join(f"#{bytes(rgb.tolist()).hex()}" for rgb in stops(scale))
    return f"linear-gradient(to right, {listed})"


def scale_bar(scale: Scale) -> str:
    """Colours from low to high with their values, in words for those who do not see them."""
    low, middle, high = (number(value, 3) for value in (scale.low, (scale.low + scale.high) / 2, scale.high))
    low, high = "≤\u00a0" * scale.below + low, "≥\u00a0" * scale.above + high
    said = escape(f"{scale.quantity} from {low} to {high} {scale.unit}")
    return (
        f'<div class="scale" role="img" aria-label="{said}"><p>{escape(scale.quantity)} [{escape(scale.unit)}]</p>'
        f'<i style="background:{gradient(scale)}"></i><p class="ends"><span>{low}</span><span>{middle}</span>'
        f"<span>{high}</span></p></div>"
    )

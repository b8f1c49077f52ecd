"""What every figure shares: colours, axes, and one SVG writer whose bytes depend on the data alone."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from strainsight.imports import in_package_folder
from strainsight.pages.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito (2008): distinguished by colour-blind readers and in grey.
BLUE, VERMILION, GREEN, ORANGE = "#0072b2", "#d55e00", "#009e73", "#e69f00"
PURPLE, SKY, YELLOW = "#cc79a7", "#56b4e9", "#f0e442"
INK, MUTED, GRID = "#1c2430", "#6b7480", "#dfe3e8"
SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
# Vermilion is kept for loads: a gauge never has the colour of an arrow.
GAUGES = (BLUE, GREEN, ORANGE, PURPLE, SKY, YELLOW)

STYLE: Mapping[str, Any] = {
    "svg.hashsalt": "strainsight",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 10.5,
    "axes.titlesize": 10.0,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.unicode_minus": True,
    "axes.formatter.use_mathtext": False,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "text.color": INK,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.fontsize": 9.5,
    "lines.linewidth": 1.5,
    "lines.solid_capstyle": "round",
    "lines.solid_joinstyle": "round",
    "path.simplify": False,
    # A name from a config may hold a dollar sign.
    "text.parse_math": False,
}


@dataclass(frozen=True)
class Drawing:
    """One figure of the page: key for its place on the page, title, caption, alternative text, SVG bytes."""

    key: str
    title: str
    caption: str
    alt: str
    svg: bytes


def gauge_colour(index: int) -> str:
    """The colour of gauge number `index` from 0, the same in the scene, the table and the figures."""
    return GAUGES[index % len(GAUGES)]


def ink_on(colour: str) -> str:
    """Black or white, whichever has the higher contrast on `colour` (WCAG relative luminance)."""
    channel = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channel]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return "#ffffff" if luminance < 0.179 else "#10151c"


def visible_instants(columns: FloatArray, buckets: int = 360) -> IntArray:
    """What can be seen of curves on a common time axis: the instants (k,) at which a bucket's extremes stand.

    columns (T, c), equally spaced in time. Keeps the first and last instant and, of every bucket and column,
    its minimum and maximum, so that no peak is lost and none is moved. Short histories are kept whole.
    """
    steps = len(columns)
    if steps <= 2 * buckets:
        return np.arange(steps)
    edges = np.linspace(0, steps, buckets + 1).astype(int)
    kept = {0, steps - 1}
    for start, stop in pairwise(edges):
        block = columns[start:stop]
        kept.update((start + np.where(np.isnan(block), np.inf, block).argmin(axis=0)).tolist())
        kept.update((start + np.where(np.isnan(block), -np.inf, block).argmax(axis=0)).tolist())
    return np.array(sorted(kept))


WIDE, SMALL = 5.2, 4.0
"""Width of a figure, and of one among many [inch]: the page shows them so that letters are of about the same size."""


def figure(height: float = 3.4, ratios: tuple[float, ...] = (1.0,), shared: bool = True, width: float = WIDE) -> Any:
    """An empty figure and its panels, one over the other; drawn on inside `styled()`.

    height, width [inch]; shared: on one x axis, which the lowest panel labels.
    """
    matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawn = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(drawn)
    drawn.patch.set_visible(False)
    panels = drawn.subplots(len(ratios), sharex=shared, squeeze=False, height_ratios=ratios)[:, 0]
    for axes in panels:
        axes.patch.set_visible(False)
    return drawn, *panels


@cache
def matplotlib() -> Any:
    """Matplotlib, imported without the settings of the working folder."""
    with in_package_folder():
        import matplotlib as mpl
    return mpl


@contextmanager
def styled(style: Mapping[str, Any] = STYLE) -> Iterator[None]:
    """Matplotlib's defaults, whatever its settings files say, and a style, that of all figures."""
    mpl = matplotlib()
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(style)
        yield


def svg(drawn: Figure) -> bytes:
    """SVG of a figure: no date, no creator, coordinates to a hundredth of a point, the same bytes for the same data."""

    def hundredth(match: re.Match[str]) -> str:
        return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")

    nothing: dict[str, Any] = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    text = saved(drawn, format="svg", metadata=nothing).decode()
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.S)
    # Only inside attributes: what stands between the tags is the text of tick labels.
    text = re.sub(r'"[^"<>]*"', lambda quoted: re.sub(r"-?\d+\.\d{3,}", hundredth, quoted[0]), text)
    text = re.sub(r"font: [^;\"']*?(\d+(?:\.\d+)?px)[^;\"]*", r"font: \1 system-ui, sans-serif", text)
    image = re.sub(r"\s*\n\s*", "\n", text).encode()
    if (figures := _KEPT.get()) is not None:
        figures[image] = drawn
    return image


_KEPT: ContextVar[dict[bytes, Figure] | None] = ContextVar("kept", default=None)


@contextmanager
def kept() -> Iterator[dict[bytes, Figure]]:
    """Gather SVG → figure of all that is drawn within, for whoever wants its numbers or another format."""
    figures: dict[bytes, Figure] = {}
    token = _KEPT.set(figures)
    try:
        yield figures
    finally:
        _KEPT.reset(token)


def saved(drawn: Figure, **options: Any) -> bytes:
    """The figure as a file with these options of `savefig`. Letters are left to the reader's fonts; the one that they are
    measured by need not have them all."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        drawn.savefig(buffer, **options)
    return buffer.getvalue()

"""Common parts of figures: colours, axes, and a deterministic SVG writer."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator, Mapping
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

# Okabe and Ito (2008): suitable for colour-blind readers and in grey
BLUE, VERMILION, GREEN, ORANGE = "#0072b2", "#d55e00", "#009e73", "#e69f00"
PURPLE, SKY, YELLOW = "#cc79a7", "#56b4e9", "#f0e442"
INK, MUTED, GRID = "#1c2430", "#6b7480", "#dfe3e8"
SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
# vermilion is reserved for loads
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
    # names from a config may contain a dollar sign
    "text.parse_math": False,
}


@dataclass(frozen=True)
class Drawing:
    """One figure of a page: key, title, caption, alternative text, SVG bytes."""

    key: str
    title: str
    caption: str
    alt: str
    svg: bytes


def gauge_colour(index: int) -> str:
    """Colour of gauge `index` (from 0), the same in pictures, tables and figures."""
    return GAUGES[index % len(GAUGES)]


def ink_on(colour: str) -> str:
    """Black or white text with the higher contrast on `colour` (WCAG relative luminance)."""
    channel = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channel]
    luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
    return "#ffffff" if luminance < 0.179 else "#10151c"


def visible_instants(columns: FloatArray, buckets: int = 360) -> IntArray:
    """Indices (k,) of instants that represent curves: first, last, and the extremes of every bucket and column.

    columns (T, c), equally spaced in time. No peak is lost or moved. Short histories are kept completely."""
    steps = len(columns)
    if steps <= 2 * buckets:
        return np.arange(steps)
    edges = np.linspace(0, steps, buckets + 1).astype(int)
    instants = {0, steps - 1}
    for start, stop in pairwise(edges):
        block = columns[start:stop]
        instants.update((start + np.where(np.isnan(block), np.inf, block).argmin(axis=0)).tolist())
        instants.update((start + np.where(np.isnan(block), -np.inf, block).argmax(axis=0)).tolist())
    return np.array(sorted(instants))


WIDE, SMALL = 5.2, 4.0
"""Width of a figure, and of a small multiple [inch], for similar letter sizes on the page."""


def figure(height: float = 3.4, ratios: tuple[float, ...] = (1.0,), shared: bool = True, width: float = WIDE) -> Any:
    """Empty figure with panels one above the other, to be used inside `styled()`.

    height, width [inch]; ratios: of panel heights; shared: whether panels share the x axis."""
    matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(canvas)
    canvas.patch.set_visible(False)
    panels = canvas.subplots(len(ratios), sharex=shared, squeeze=False, height_ratios=ratios)[:, 0]
    for axes in panels:
        axes.patch.set_visible(False)
    return canvas, *panels


@cache
def matplotlib() -> Any:
    """Import matplotlib without settings from the working folder."""
    with in_package_folder():
        import matplotlib as mpl
    return mpl


@contextmanager
def styled(style: Mapping[str, Any] = STYLE) -> Iterator[None]:
    """Matplotlib defaults, without settings files, plus a style."""
    mpl = matplotlib()
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(style)
        yield


def svg(canvas: Figure) -> bytes:
    """Deterministic SVG of a figure, with coordinates to a hundredth of a point."""
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    def hundredth(match: re.Match[str]) -> str:
        return f"{float(match[0]):.2f}".rstrip("0").rstrip(".")

    nothing: dict[str, Any] = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    # print_svg computes the layout and draws; savefig would draw everything once more for the layout
    text = _written(FigureCanvasSVG(canvas).print_svg, metadata=nothing).decode()
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.S)
    # only inside attributes, not in tick labels
    text = re.sub(r'"[^"<>]*"', lambda quoted: re.sub(r"-?\d+\.\d{3,}", hundredth, quoted[0]), text)
    text = re.sub(r"font: [^;\"']*?(\d+(?:\.\d+)?px)[^;\"]*", r"font: \1 system-ui, sans-serif", text)
    image = re.sub(r"\s*\n\s*", "\n", text).encode()
    if (figures := _RECORDED.get()) is not None:
        figures[image] = canvas
    return image


_RECORDED: ContextVar[dict[bytes, Figure] | None] = ContextVar("recorded", default=None)


@contextmanager
def recorded_figures() -> Iterator[dict[bytes, Figure]]:
    """Record SVG → figure of all figures drawn in the context, for their numbers and other formats."""
    figures: dict[bytes, Figure] = {}
    token = _RECORDED.set(figures)
    try:
        yield figures
    finally:
        _RECORDED.reset(token)


def saved(canvas: Figure, **options: Any) -> bytes:
    """Figure as a file with options of `savefig`."""
    return _written(canvas.savefig, **options)


def _written(write: Callable[..., None], **options: Any) -> bytes:
    """Content that a method of Matplotlib writes; missing glyphs are ignored, as the reader's fonts are used."""
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=r"Glyph \d+ .*missing from font")
        write(buffer, **options)
    return buffer.getvalue()

"""Figures of a page as files: SVG, PNG, and their numbers as CSV."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.chart.drawing import MUTED, Drawing, saved, styled
from strainsight.pages.chart.panels import DOTS
from strainsight.text import csv_bytes
from strainsight.writing import make_folder, write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INDEX = "figures.csv"
"""Index of the folder: file, title and caption of every figure."""
LONGEST = 80
DPI = 200


def figure_files(drawings: Iterable[Drawing], figures: Mapping[bytes, Figure]) -> dict[str, bytes]:
    """File name → content; figures: SVG → figure, from `drawing.recorded_figures`."""
    files: dict[str, bytes] = {}
    rows = []
    for drawing in drawings:
        name = file_name(drawing.key, {Path(other).stem.lower() for other in files})
        figure = figures[drawing.svg]
        # numbers first, because writing the PNG changes the figure
        files[f"{name}.csv"] = figure_csv(figure)
        files |= {f"{name}.svg": drawing.svg, f"{name}.png": _png(figure)}
        rows.append((name, drawing.title, drawing.caption))
    return files | {INDEX: csv_bytes([("figure", "title", "caption"), *rows])}


def write_figures(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write figure files and remove figures of an earlier run that no longer exist; other files are kept."""
    make_folder(folder.parent)
    make_folder(folder)
    index = folder / INDEX
    text = index.read_text(encoding="utf-8", errors="replace") if index.is_file() else ""
    names = {row[0] for row in list(csv.reader(io.StringIO(text)))[1:] if row and re.fullmatch(r"\w[\w.-]*", row[0])}
    for name in names - {Path(file).stem for file in files}:
        for suffix in (".svg", ".png", ".csv"):
            (folder / f"{name}{suffix}").unlink(missing_ok=True)
    for name, content in files.items():
        write_file(folder / name, content)


def file_name(key: str, used: set[str]) -> str:
    """Valid file name for a key, unique also on case-insensitive file systems."""
    plain = re.sub(r"[^\w.-]+", "_", key).strip("._-")[:LONGEST] or "figure"
    name, count = plain, 2
    while name.lower() in {*used, Path(INDEX).stem}:
        name, count = f"{plain}-{count}", count + 1
    return name


def _png(canvas: Figure) -> bytes:
    """PNG on a white background."""
    with styled():
        for axes in canvas.axes:
            axes.autoscale(False)
            for _, places in dots_of(axes):  # lines of zero length, which this renderer omits
                axes.plot(*places.T, ".", color=MUTED, ms=4, alpha=0.8, zorder=1)
        canvas.patch.set_visible(True)
        return saved(canvas, format="png", dpi=DPI, facecolor="white", metadata={"Software": None})


Series = tuple[str, FloatArray, dict[str, FloatArray]]
"""One line, band or row of bars: legend, x (k,), and columns: suffix of the axis label → (k,)."""


def figure_csv(canvas: Figure) -> bytes:
    """CSV, UTF-8, with one column per series in the unit of its axis, and each different abscissa.

    Headings are "legend: axis label [unit]"; repeated names are numbered. Long records are thinned as drawn, with their peaks.
    """
    head: list[str] = []
    columns: list[list[str]] = []

    def add(title: str, cells: list[str]) -> None:
        again = sum(other == title or other.startswith(f"{title} (") for other in head)
        head.append(f"{title} ({again + 1})" if again else title)
        columns.append(cells)

    below = next((axes.get_xlabel() for axes in reversed(canvas.axes) if axes.get_xlabel()), "")
    shown: list[FloatArray] = []
    for axes in canvas.axes:
        across, up = _label(axes.get_xlabel() or below), _label(axes.get_ylabel())
        for name, x, over in _series(axes):
            if len(x) and not any(np.array_equal(x, other, equal_nan=True) for other in shown):
                shown.append(x)
                add(across or "x", [_number(value) for value in x])
            for what, values in over.items():
                words = " ".join(filter(None, (name, what)))
                add(": ".join(filter(None, (words, up or "row"))), _cells(axes, values, named=not up))
    return csv_bytes([head, *zip_longest(*columns, fillvalue="")])


def _series(axes: Any) -> Iterator[Series]:
    """Yield all series on the axes in the order of drawing, without legend-only entries."""
    for container in axes.containers:
        bars = [bar for bar in container if np.isfinite(bar.get_height())]
        if not bars:
            continue
        upright = container.orientation == "vertical"
        across = np.array([bar.get_x() + (bar.get_width() / 2 if upright else bar.get_width()) for bar in bars])
        ends = np.array([bar.get_y() + (bar.get_height() if upright else bar.get_height() / 2) for bar in bars])
        yield _name(container), across, {"": ends}
    for band in axes.collections:
        for path in band.get_paths():
            # vertices: one edge, then the other in reverse, each after a corner, and a closing corner
            count = (len(path.vertices) - 3) // 2
            if count < 1:
                continue
            one, other = path.vertices[1 : count + 1], path.vertices[count + 2 : 2 * count + 2][::-1]
            yield _name(band) or "band", one[:, 0], {"low": one[:, 1], "high": other[:, 1]}
    for label, places in dots_of(axes):
        yield _label(label), places[:, 0], {"": places[:, 1]}
    for line in axes.lines:
        x, y = np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)
        if not len(x):
            continue
        if line.get_transform() == axes.transData:
            yield _name(line), x, {"": y}
        elif y[0] == y[-1]:  # a horizontal line represents one value
            yield _name(line), np.empty(0), {"": y[:1]}
        else:
            yield _name(line), x[:1], {}


def dots_of(axes: Any) -> list[tuple[str, FloatArray]]:
    """Label and positions (k, 2) of everything drawn by `panels.dots`."""
    patches = [patch for patch in axes.patches if str(patch.get_label()).startswith(DOTS)]
    # each dot is a line of zero length
    return [(str(patch.get_label()).removeprefix(DOTS), patch.get_path().vertices[::2]) for patch in patches]


def _name(artist: Any) -> str:
    """Legend label; names with a leading underscore belong to matplotlib."""
    name = str(artist.get_label() or "")
    return "" if name.startswith("_") else _label(name)


def _label(text: str) -> str:
    return " ".join(text.split())


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.9g}"


def _cells(axes: Any, values: FloatArray, named: bool) -> list[str]:
    """Values as text, or row names on an axis with named rows and no label."""
    labels = [text.get_text() for text in axes.get_yticklabels()]
    ticks = np.asarray(axes.get_yticks(), dtype=float)
    if not (named and labels and all(labels) and len(ticks) == len(labels)):
        return [_number(value) for value in values]
    labels = [_label(label) for label in labels]
    return [labels[int(np.argmin(np.abs(ticks - value)))] for value in values]

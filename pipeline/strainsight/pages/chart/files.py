"""The figures of a page as files of their own: SVG, PNG, and the numbers in them as CSV."""

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
"""What is in the folder: file, title and caption of every figure."""
LONGEST = 80
DPI = 200


def figure_files(drawings: Iterable[Drawing], drawn: Mapping[bytes, Figure]) -> dict[str, bytes]:
    """File name → content; drawn: SVG → the figure that it was written from, as `drawing.kept` gathers them."""
    files: dict[str, bytes] = {}
    rows = []
    for drawing in drawings:
        name = file_name(drawing.key, {Path(other).stem.lower() for other in files})
        figure = drawn[drawing.svg]
        # The numbers first: the figure is changed for the other picture.
        files[f"{name}.csv"] = figure_csv(figure)
        files |= {f"{name}.svg": drawing.svg, f"{name}.png": _png(figure)}
        rows.append((name, drawing.title, drawing.caption))
    return files | {INDEX: csv_bytes([("figure", "title", "caption"), *rows])}


def write_figures(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write them; figures of an earlier time that there are no more are removed, other files are left alone."""
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


def file_name(key: str, taken: set[str]) -> str:
    """A plain file name for a key, which may hold any name of a config; apart from others on any file system."""
    plain = re.sub(r"[^\w.-]+", "_", key).strip("._-")[:LONGEST] or "figure"
    name, count = plain, 2
    while name.lower() in {*taken, Path(INDEX).stem}:
        name, count = f"{plain}-{count}", count + 1
    return name


def _png(drawn: Figure) -> bytes:
    """On white: the page's figures have no ground of their own, and a picture that is pasted somewhere needs one."""
    with styled():
        for axes in drawn.axes:
            axes.autoscale(False)
            for _, places in dots_of(axes):  # lines of no length, which this renderer leaves out
                axes.plot(*places.T, ".", color=MUTED, ms=4, alpha=0.8, zorder=1)
        drawn.patch.set_visible(True)
        return saved(drawn, format="png", dpi=DPI, facecolor="white", metadata={"Software": None})


Series = tuple[str, FloatArray, dict[str, FloatArray]]
"""What one line, band or row of bars draws: name of its legend, x (k,), and the columns over it: what is added to the axis label
→ (k,)."""


def figure_csv(drawn: Figure) -> bytes:
    """CSV, UTF-8: a column a series in the unit of its axis, beside it its abscissa where that is another one.

    Headers are "legend: axis label [unit]"; of columns of the same name the further ones are numbered. Curves are as they
    are drawn: long records are thinned to what one can see, their peaks kept.
    """
    head: list[str] = []
    columns: list[list[str]] = []

    def add(title: str, cells: list[str]) -> None:
        again = sum(other == title or other.startswith(f"{title} (") for other in head)
        head.append(f"{title} ({again + 1})" if again else title)
        columns.append(cells)

    below = next((axes.get_xlabel() for axes in reversed(drawn.axes) if axes.get_xlabel()), "")
    shown: list[FloatArray] = []
    for axes in drawn.axes:
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
    """Everything on the axes that stands for numbers, in the order of drawing; entries of the legend alone are left out."""
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
            # Matplotlib goes along one edge and back along the other, with a corner before each and one to close.
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
        elif y[0] == y[-1]:  # a line across the axes stands for one value
            yield _name(line), np.empty(0), {"": y[:1]}
        else:
            yield _name(line), x[:1], {}


def dots_of(axes: Any) -> list[tuple[str, FloatArray]]:
    """Label and places (k, 2) of everything that `panels.dots` has drawn."""
    drawn = [patch for patch in axes.patches if str(patch.get_label()).startswith(DOTS)]
    # Each dot is a line of no length.
    return [(str(patch.get_label()).removeprefix(DOTS), patch.get_path().vertices[::2]) for patch in drawn]


def _name(artist: Any) -> str:
    """What the legend calls it; names that begin with an underscore are matplotlib's own."""
    name = str(artist.get_label() or "")
    return "" if name.startswith("_") else _label(name)


def _label(text: str) -> str:
    return " ".join(text.split())


def _number(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.9g}"


def _cells(axes: Any, values: FloatArray, named: bool) -> list[str]:
    """Values as text; on an axis whose rows have names and no label, the names."""
    labels = [text.get_text() for text in axes.get_yticklabels()]
    ticks = np.asarray(axes.get_yticks(), dtype=float)
    if not (named and labels and all(labels) and len(ticks) == len(labels)):
        return [_number(value) for value in values]
    labels = [_label(label) for label in labels]
    return [labels[int(np.argmin(np.abs(ticks - value)))] for value in values]

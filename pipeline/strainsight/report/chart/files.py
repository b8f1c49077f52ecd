"""The figures of a page as files of their own: SVG, PNG, and the numbers in them as CSV."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from strainsight.csv_cells import csv_bytes
from strainsight.report.chart.data import dots_of, figure_csv
from strainsight.report.chart.drawing import MUTED, Drawing, styled
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
        own = drawn[drawing.svg]
        # The numbers first: the figure is changed for the other picture.
        files[f"{name}.csv"] = figure_csv(own)
        files |= {f"{name}.svg": drawing.svg, f"{name}.png": _png(own)}
        rows.append((name, drawing.title, drawing.caption))
    return files | {INDEX: csv_bytes([("figure", "title", "caption"), *rows])}


def write_figures(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write them; figures of an earlier time that there are no more are removed, other files are left alone."""
    make_folder(folder.parent)
    make_folder(folder)
    for name in _listed(folder / INDEX) - {Path(own).stem for own in files}:
        for suffix in (".svg", ".png", ".csv"):
            (folder / f"{name}{suffix}").unlink(missing_ok=True)
    for name, content in files.items():
        write_file(folder / name, content)


def _listed(index: Path) -> set[str]:
    """The names that an index lists, as far as they are plain names."""
    if not index.is_file():
        return set()
    rows = list(csv.reader(io.StringIO(index.read_text(encoding="utf-8", errors="replace"))))
    return {row[0] for row in rows[1:] if row and re.fullmatch(r"\w[\w.-]*", row[0])}


def file_name(key: str, taken: set[str]) -> str:
    """A plain file name for a key, which may hold any name of a config; apart from others on any file system."""
    plain = re.sub(r"[^\w.-]+", "_", key).strip("._-")[:LONGEST] or "figure"
    name, count = plain, 2
    while name.lower() in {*taken, Path(INDEX).stem}:
        name, count = f"{plain}-{count}", count + 1
    return name


def _png(drawn: Figure) -> bytes:
    """On white: the page's figures have no ground of their own, and a picture that is pasted somewhere needs one."""
    buffer = io.BytesIO()
    with styled(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        for axes in drawn.axes:
            axes.autoscale(False)
            for _, places in dots_of(axes):  # lines of no length, which this renderer leaves out
                axes.plot(*places.T, ".", color=MUTED, ms=4, alpha=0.8, zorder=1)
        drawn.patch.set_visible(True)
        drawn.savefig(buffer, format="png", dpi=DPI, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()

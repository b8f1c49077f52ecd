"""A view as a PNG, or in a window: either way drawn by a child process."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.errors import StrainsightError, UserError
from strainsight.imports import FOLDER
from strainsight.pages.arrays import FloatArray
from strainsight.pages.picture.layout import PictureLayout
from strainsight.pages.picture.scene import draw_apart, last_words, thinned
from strainsight.processes import inherited, python

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
    layout: PictureLayout
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


CHILD = "strainsight.pages.view.viewer"
TIME_LIMIT = 300.0
"""For a screenshot [s]."""


def screenshot(view: View) -> bytes:
    """PNG of the view on white. Raises StrainsightError that names the Debian packages where nothing can render."""
    return screenshots([view])[0]


def screenshots(views: Sequence[View]) -> list[bytes]:
    """A picture of each, as `screenshot` makes it, by one child process."""
    return draw_apart(CHILD, [_sent(view) for view in views], TIME_LIMIT)


def window(view: View) -> None:
    """Show the view until its window is closed. Raises UserError without a display, StrainsightError if the window crashes."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise _no_display("there is no display to open a window on")
    # By stdin and not by a file: nothing is left behind where this process is interrupted.
    shown = pickle.dumps(_sent(view))
    done = subprocess.run(python(CHILD), env=inherited(), cwd=FOLDER, input=shown, stderr=subprocess.PIPE, check=False)
    if done.returncode == NO_DISPLAY:
        raise _no_display("the display does not answer")
    if done.returncode:
        text = last_words(done.stderr.decode(errors="replace"))
        raise StrainsightError(
            f"the window broke off (exit code {done.returncode}{text})",
            remedy="draw it into a file instead: --screenshot FILE.png",
        )


def _sent(view: View) -> View:
    return replace(view, layout=thinned(view.layout))


def _no_display(what: str) -> UserError:
    return UserError(what, remedy="draw it into a file: --screenshot FILE.png")

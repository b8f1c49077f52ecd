"""The child process of viewing.py: draws a view with PyVista, into a file or in a window."""

from __future__ import annotations

import os
import pickle
import signal
import sys
from collections.abc import Sequence
from io import BytesIO
from textwrap import shorten
from typing import Any

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.picture.geometry import seen_from, triangles, views
from strainsight.report.picture.layout import Layout
from strainsight.report.picture.markers import free_end
from strainsight.report.picture.offscreen import OFF_SCREEN, answer
from strainsight.report.picture.picture import across, aim
from strainsight.report.view.parts import INK, add_names, add_panel, carried, font, plain
from strainsight.report.view.viewed import NO_DISPLAY, View

OF_A_SCREEN = 0.9
"""What a window may take of it, which leaves its frame and a task bar."""
WINDOWLESS = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
"""What VTK falls back on where the display does not answer: it would draw, nobody would see it, and all would seem well."""
LOOK = 500
"""Between two looks for the process that asked for the window [ms]."""


def draw(view: View, off_screen: bool) -> Any:
    """The plotter with everything in it.

    A screenshot of one panel shows it from a second side where the first hides a gauge; in a window one turns it.
    """
    import pyvista as pv

    layout, triangle = view.layout, triangles(view.layout.faces)
    position, normal = layout.places
    corners = views(layout.points, triangle, position, normal)
    if not off_screen or len(view.panels) > 1:
        corners = corners[:1]
    cells = [(panel, corner, corner is corners[0]) for panel in view.panels for corner in corners]
    rows, columns = _grid(len(cells), layout.points)
    # Light from the eye alone: a colour is never brighter than that of the scalar bar.
    plotter: Any = pv.Plotter(
        off_screen=off_screen, window_size=list(view.size), shape=(rows, columns), border=False, lighting="none"
    )
    width, height = view.size
    if not off_screen:
        width, height = fitting(plotter.render_window.GetScreenSize(), view.size)
        plotter.window_size = [width, height]
    plotter.set_background("white")
    plotter.add_light(pv.Light(light_type="headlight", intensity=1.0))  # this adds it to every panel
    plotter.enable_anti_aliasing("msaa", multi_samples=8)
    for place, (panel, corner, first) in enumerate(cells):
        plotter.subplot(*divmod(place, columns))
        # What one sees is found on the structure as it is: a place on the displaced one may lie under its facets.
        seen = seen_from(layout.points, triangle, position, normal, corner) if off_screen else np.ones(len(position))
        moved = carried(layout, panel)
        add_panel(plotter, view, moved, panel, triangle, place if first and view.bar else None)
        add_names(plotter, moved, seen.astype(bool), through=off_screen)
        size = width // columns, height // rows
        _add_title(plotter, view.title if place == 0 else "", panel.title if first else "", size)
        plotter.add_axes(color=INK, line_width=2, viewport=(0, 0, 0.14, 0.14 * width / height * rows / columns))
        _aim(plotter, moved, corner, size)
    if not off_screen and len(cells) > 1:
        plotter.link_views()
    return plotter


def fitting(screen: tuple[int, int], size: tuple[int, int]) -> tuple[int, int]:
    """Width and height of a window of this size [px] or, so that all of it is on the screen (width, height; zero: not known),
    smaller."""
    shares = [OF_A_SCREEN * there / wanted for there, wanted in zip(screen, size, strict=True) if there > 0]
    share = min(1.0, *shares) if shares else 1.0
    return int(share * size[0]), int(share * size[1])


def _add_title(plotter: Any, title: str, below: str, size: tuple[int, int]) -> None:
    """One or two lines in the upper left corner, in letters of the same size whatever the panel's (width, height)."""
    lines = [(text, points) for text, points in ((title, 11), (below, 10)) if text]
    for i, (text, points) in enumerate(lines, start=1):
        words = shorten(text, size[0] // (points + 1), placeholder=" …")
        at = (8 / size[0], 1 - (4 + 24 * i) / size[1])
        plotter.add_text(plain(words), position=at, viewport=True, font_size=points, color=INK, font_file=font())


def _grid(count: int, points: FloatArray) -> tuple[int, int]:
    """Rows and columns: a slender structure is wide, its pictures go one over the other."""
    extent = np.sort(np.ptp(points, axis=0))
    if count <= 2:
        return (count, 1) if extent[2] > 1.6 * extent[1] else (1, count)
    columns = 2 if count <= 4 or extent[2] > 1.6 * extent[1] else 3
    return -(-count // columns), columns


def _aim(plotter: Any, layout: Layout, corner: FloatArray, size: tuple[int, int]) -> None:
    """Parallel view from a corner, z up, everything inside between title and scalar bar; size: pixels of the panel."""
    ends = [free_end(load, layout) for load in layout.loads]
    shown = np.concatenate([layout.points, np.array(ends, dtype=float).reshape(-1, 3)])
    axes = across(corner)
    spread = shown @ axes
    wide, high = np.ptp(spread, axis=0)
    top, bottom = 64 / size[1], 0.13 + 27 / size[1]
    # The whole panel is 2 × scale high, what is left between title and bar less.
    scale = 0.5 * max(1.06 * high / (1 - top - bottom), 1.14 * wide * size[1] / size[0])
    centre = (spread.min(axis=0) + spread.max(axis=0)) / 2
    middle = axes @ (centre + np.array([0.0, scale * (top - bottom)])) + (shown.mean(axis=0) @ corner) * corner
    aim(plotter, middle, corner, float(np.linalg.norm(np.ptp(shown, axis=0))), scale)


def show(plotter: Any, title: str, parent: int) -> None:
    """Show it until its window is closed, Ctrl-C is pressed or the process that asked for it (its number) is gone."""
    # VTK waits for events in C: Python's own handler would have its turn after the window is closed.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if plotter.render_window.GetClassName() in WINDOWLESS:
        sys.exit(NO_DISPLAY)

    def look(*_: object) -> None:
        if os.getppid() != parent:
            os._exit(0)

    plotter.iren.initialize()
    plotter.iren.add_observer("TimerEvent", look)
    plotter.iren.create_timer(LOOK, repeating=True)
    plotter.show(title=title)


def drawn(views: Sequence[View]) -> list[bytes]:
    """A picture of every view."""
    pictures = []
    for view in views:
        plotter = draw(view, off_screen=True)
        content = BytesIO()
        plotter.screenshot(content)
        plotter.close()
        pictures.append(content.getvalue())
    return pictures


def main(asked: str = "") -> None:
    """Show the view that comes by stdin until its window is closed, or draw it off-screen."""
    if asked == OFF_SCREEN:
        answer(drawn)
        return
    parent = os.getppid()
    view: View = pickle.load(sys.stdin.buffer)
    show(draw(view, off_screen=False), f"strainsight: {view.title}", parent)


if __name__ == "__main__":
    main(*sys.argv[1:])

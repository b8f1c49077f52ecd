"""What `strainsight view` shows, as a PNG or in a window: either way drawn with PyVista by a child process, this module."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strainsight.errors import StrainsightError, UserError
from strainsight.imports import FOLDER
from strainsight.pages.arrays import FloatArray, IntArray, round_factor
from strainsight.pages.chart.drawing import INK, VERMILION, gauge_colour, ink_on
from strainsight.pages.picture import geometry, scene
from strainsight.pages.picture.geometry import views
from strainsight.pages.picture.layout import Gauge, PictureLayout
from strainsight.processes import inherited, python
from strainsight.text import short

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


def exaggerated(points: FloatArray, shift: FloatArray) -> float:
    """By what a displacement (n, 3) [m] is to be multiplied to be seen: a round factor with which the largest is about 6 % of the
    structure; 1 where it is larger by itself or nothing moves."""
    largest = float(np.linalg.norm(shift, axis=1).max(initial=0.0))
    factor = 0.06 * float(np.linalg.norm(np.ptp(points, axis=0))) / largest if largest > 0 else 1.0
    return round_factor(max(factor, 1.0))


CHILD = "strainsight.pages.view.viewing"
TIME_LIMIT = 300.0
"""For a screenshot [s]."""


def screenshots(views: Sequence[View]) -> list[bytes]:
    """PNG of each view on white, by one child process. Raises StrainsightError that names the Debian packages where nothing can
    render."""
    return scene.draw_apart(CHILD, [replace(view, layout=scene.thinned(view.layout)) for view in views], TIME_LIMIT)


def window(view: View) -> None:
    """Show the view until its window is closed. Raises UserError without a display, StrainsightError if the window crashes."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise _no_display("there is no display to open a window on")
    # By stdin and not by a file: nothing is left behind where this process is interrupted.
    shown = pickle.dumps(replace(view, layout=scene.thinned(view.layout)))
    done = subprocess.run(python(CHILD), env=inherited(), cwd=FOLDER, input=shown, stderr=subprocess.PIPE, check=False)
    if done.returncode == NO_DISPLAY:
        raise _no_display("the display does not answer")
    if done.returncode:
        text = scene.last_words(done.stderr.decode(errors="replace"))
        raise StrainsightError(
            f"the window broke off (exit code {done.returncode}{text})",
            remedy="draw it into a file instead: --screenshot FILE.png",
        )


def _no_display(what: str) -> UserError:
    return UserError(what, remedy="draw it into a file: --screenshot FILE.png")


BAR = {
    "color": INK, "vertical": False, "position_x": 0.28, "position_y": 0.02, "width": 0.6, "height": 0.1,
    "title_font_size": 16, "label_font_size": 14, "n_labels": 4, "fmt": "%.3g",
}  # fmt: skip
"""Of a scalar bar."""
LINES, POOL = "#5d6a79", "#7b8794"
LENGTH = 0.07
"""Of a gauge's arrow, over the size of the structure."""


def carried(layout: PictureLayout, panel: Panel) -> PictureLayout:
    """The layout with its points displaced; gauges and loads go with the points nearest to them."""
    if not len(panel.shift):
        return layout
    from scipy.spatial import cKDTree

    tree = cKDTree(layout.points)

    def along(position: FloatArray) -> FloatArray:
        return np.asarray(position + panel.shift[tree.query(position)[1]])

    return replace(
        layout,
        points=layout.points + panel.shift,
        gauges=tuple(
            replace(
                gauge,
                position=along(gauge.position),
                arms=tuple(replace(arm, position=along(arm.position)) for arm in gauge.arms),
            )
            for gauge in layout.gauges
        ),
        loads=tuple(replace(load, point=along(load.point)) for load in layout.loads),
    )


def add_panel(
    plotter: Any, view: View, layout: PictureLayout, panel: Panel, triangle: IntArray, bar: int | None
) -> None:
    """Structure, dots, gauges and loads of one panel; bar: number of its scalar bar, None: without one."""
    import pyvista as pv

    points = layout.points
    size = layout.size
    coloured = _colours(view, panel, bar) if len(panel.values) else None
    if len(triangle):
        surface = geometry.surface_mesh(points, triangle)
        if coloured is None or view.on == DOTS:
            shown = plotter.add_mesh(surface, color=scene.STEEL, ambient=0.45, diffuse=0.55)
        elif view.on == POINTS:
            shown = plotter.add_mesh(surface, scalars=panel.values, preference="point", **coloured)
        else:
            values = panel.values[geometry.facet_of_triangle(layout.faces)]
            shown = plotter.add_mesh(surface, scalars=values, preference="cell", **coloured)
        # Lines and dots lie in the surface: it is drawn a little behind them.
        shown.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        shown.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)
        if len(layout.faces) <= scene.DRAWN_FACETS:
            wires = geometry.line_mesh(points, geometry.mesh_lines(layout.faces))
            plotter.add_mesh(wires, color=LINES, line_width=1, opacity=0.5, lighting=False)
    if len(layout.bars):
        plotter.add_mesh(geometry.line_mesh(points, layout.bars), color=scene.CREASES, line_width=3, lighting=False)
    for shape, colour, width in ((layout.loose, LINES, 9), (layout.pool, POOL, 5), (layout.fixed, scene.CLAMP, 8)):
        if len(shape):
            plotter.add_mesh(pv.PolyData(shape), color=colour, point_size=width, lighting=False)
    if view.on == DOTS and coloured is not None and len(view.dots):
        round_ones = coloured | {"ambient": 1.0, "diffuse": 0.0}
        plotter.add_mesh(
            pv.PolyData(view.dots), scalars=panel.values, point_size=10, render_points_as_spheres=True, **round_ones
        )
    for i, gauge in enumerate(layout.gauges):
        for shape in gauge_arrows(gauge, LENGTH * size):
            plotter.add_mesh(shape, color=gauge_colour(i), ambient=0.5)
    for load in layout.loads:
        plotter.add_mesh(geometry.arrow_mesh(load, layout), color=VERMILION, ambient=0.4)


def _colours(view: View, panel: Panel, bar: int | None) -> dict[str, Any]:
    """How values are coloured, about zero where they have both signs, with a scalar bar of their own; on facets a peak lies
    beyond its ends, and the title says how large it is."""
    area = geometry.areas(view.layout.points, view.layout.faces) if view.on == FACETS else None
    scale = geometry.scale_of(view.quantity, view.unit, panel.values, area)
    # VTK keeps one bar a title: spaces, which nobody sees, distinguish the panels' bars. The line feed keeps the title off
    # the numbers.
    ends = np.array([np.nanmin(panel.values), np.nanmax(panel.values)])[[scale.below, scale.above]]
    beyond = f", beyond its ends {' and '.join(f'{end:.3g}' for end in ends)}" if len(ends) else ""
    title = f"{view.quantity} [{view.unit}]{beyond}{' ' * (bar or 0)}\n"
    return {
        "cmap": scale.name,
        "clim": (scale.low, scale.high),
        "nan_color": scene.STEEL,
        "ambient": 0.6,
        "diffuse": 0.4,
        "show_scalar_bar": bar is not None,
        "scalar_bar_args": {"title": plain(title)} | BAR,
    }


def gauge_arrows(gauge: Gauge, length: float) -> list[Any]:
    """An arrow through the place along everything that the sensor reads, of a bridge one at each arm, lifted off the surface by
    its own thickness."""
    import pyvista as pv

    form: dict[str, Any] = {"scale": length, "shaft_radius": 0.05, "tip_radius": 0.13, "tip_length": 0.32}
    bases = [(position + 0.06 * length * normal, direction) for position, direction, normal in gauge.grids]
    arrows = [
        pv.Arrow(start=base - 0.5 * length * direction, direction=direction, **form)
        for base, direction in bases
        if np.any(direction)
    ]
    return arrows or [pv.Sphere(radius=0.15 * length, center=bases[0][0])]


def add_names(plotter: Any, layout: PictureLayout, seen: NDArray[np.bool_], through: bool = True) -> None:
    """Ids of the gauges that are seen, and names of loads; through: ids are drawn over what stands before them."""
    size = layout.size
    position, normal = layout.places
    for i in map(int, np.flatnonzero(seen)):
        gauge = layout.gauges[i]
        mark = f"{short(gauge.label)}{' (bonded)' if gauge.bonded else ''}"
        at = position[i] + size * (0.6 * LENGTH * gauge.channels[0] + 0.02 * normal[i])
        _name(plotter, at, mark, gauge_colour(i), through)
    for load in layout.loads:
        _name(plotter, geometry.free_end(load, layout), short(load.name), VERMILION)


def _name(plotter: Any, point: FloatArray, text: str, colour: str, through: bool = True) -> None:
    plotter.add_point_labels(
        np.asarray(point, dtype=float)[None],
        [plain(text)],
        font_size=17,
        bold=False,
        text_color=ink_on(colour),
        shape="rounded_rect",
        shape_color=colour,
        shape_opacity=1.0,
        margin=4,
        show_points=False,
        always_visible=through,
        font_file=font(),
    )


def plain(text: str) -> str:
    """A text of a config as VTK shows it: two dollar signs would start a formula."""
    return text.replace("$", "＄").replace("|", "¦") if text.count("$") > 1 or "|" in text else text


def font() -> str:
    """A font with Greek and most other letters, which VTK's own lacks."""
    import matplotlib as mpl

    return str(Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"))


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

    layout, triangle = view.layout, geometry.triangles(view.layout.faces)
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
        seen = (
            geometry.seen_from(layout.points, triangle, position, normal, corner)
            if off_screen
            else np.ones(len(position))
        )
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
    shares = [OF_A_SCREEN * room / wanted for room, wanted in zip(screen, size, strict=True) if room > 0]
    share = min(1.0, *shares) if shares else 1.0
    return int(share * size[0]), int(share * size[1])


def _add_title(plotter: Any, title: str, below: str, size: tuple[int, int]) -> None:
    """One or two lines in the upper left corner, in letters of the same size whatever the panel's (width, height)."""
    for i, (text, points) in enumerate(filter(lambda line: line[0], ((title, 11), (below, 10))), start=1):
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


def _aim(plotter: Any, layout: PictureLayout, corner: FloatArray, size: tuple[int, int]) -> None:
    """Parallel view from a corner, z up, everything inside between title and scalar bar; size: pixels of the panel."""
    ends = [geometry.free_end(load, layout) for load in layout.loads]
    shown = np.concatenate([layout.points, np.array(ends, dtype=float).reshape(-1, 3)])
    axes = scene.across(corner)
    spread = shown @ axes
    wide, high = np.ptp(spread, axis=0)
    top, bottom = 64 / size[1], 0.13 + 27 / size[1]
    # The whole panel is 2 × scale high, what is left between title and bar less.
    scale = 0.5 * max(1.06 * high / (1 - top - bottom), 1.14 * wide * size[1] / size[0])
    centre = (spread.min(axis=0) + spread.max(axis=0)) / 2
    middle = axes @ (centre + np.array([0.0, scale * (top - bottom)])) + (shown.mean(axis=0) @ corner) * corner
    scene.aim(plotter, middle, corner, float(np.linalg.norm(np.ptp(shown, axis=0))), scale)


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
    pictures = [BytesIO() for _ in views]
    for view, picture in zip(views, pictures, strict=True):
        plotter = draw(view, off_screen=True)
        plotter.screenshot(picture)
        plotter.close()
    return [picture.getvalue() for picture in pictures]


def main(asked: str = "") -> None:
    """Show the view that comes by stdin until its window is closed, or draw it off-screen."""
    if asked == scene.OFF_SCREEN:
        scene.answer(drawn)
        return
    parent = os.getppid()
    view: View = pickle.load(sys.stdin.buffer)
    show(draw(view, off_screen=False), f"strainsight: {view.title}", parent)


if __name__ == "__main__":
    main(*sys.argv[1:])

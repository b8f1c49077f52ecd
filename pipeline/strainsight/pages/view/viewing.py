"""Pictures and windows of `strainsight view`, drawn with PyVista by a child process that runs this module."""

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
"""Locations of the values of a panel."""
NO_DISPLAY = 3
"""Exit code of the child process if the display cannot open a window."""


@dataclass(frozen=True)
class Panel:
    """One picture of the structure: title; values (n,), (f,) or (d,) at the locations of the view, or empty; shift (n, 3) [m] of
    the points, or empty."""

    title: str = ""
    values: FloatArray = field(default_factory=lambda: np.empty(0))
    shift: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True)
class View:
    """Structure in one or more panels.

    layout: structure, gauges, loads, grey dots (its pool); panels: with equal numbers of values; quantity, unit: of the scalar
    bar; on: "points", "facets" or "dots"; dots (d, 3) [m]: coloured dots, if values are on dots; size: width and height of the
    picture [px]; bar: whether it includes the scalar bar."""

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
"""Time limit of a screenshot [s]."""


def screenshots(views: Sequence[View]) -> list[bytes]:
    """PNG of each view on white, from one child process. Raises StrainsightError with the required Debian packages if rendering
    is impossible."""
    return scene.draw_apart(CHILD, [replace(view, layout=scene.thinned(view.layout)) for view in views], TIME_LIMIT)


def window(view: View) -> None:
    """Show the view in a window until it is closed. Raises UserError without a display, StrainsightError after a crash."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise _no_display("no display is available, so no window can be opened")
    # By stdin, not by a file: an interrupted process leaves no file.
    shown = pickle.dumps(replace(view, layout=scene.thinned(view.layout)))
    done = subprocess.run(python(CHILD), env=inherited(), cwd=FOLDER, input=shown, stderr=subprocess.PIPE, check=False)
    if done.returncode == NO_DISPLAY:
        raise _no_display("the display does not respond, so no window can be opened")
    if done.returncode:
        text = scene.last_words(done.stderr.decode(errors="replace"))
        raise StrainsightError(
            f"the window crashed (exit code {done.returncode}{text})",
            remedy="Save a picture instead: --screenshot FILE.png.",
        )


def _no_display(what: str) -> UserError:
    return UserError(what, remedy="Save a picture instead: --screenshot FILE.png.")


BAR = {
    "color": INK, "vertical": False, "position_x": 0.28, "position_y": 0.02, "width": 0.6, "height": 0.1,
    "title_font_size": 16, "label_font_size": 14, "n_labels": 4, "fmt": "%.3g",
}  # fmt: skip
"""Options of the scalar bar."""
LINES, POOL = "#5d6a79", "#7b8794"
LENGTH = 0.07
"""Length of a gauge arrow relative to the size of the structure."""


def carried(layout: PictureLayout, panel: Panel) -> PictureLayout:
    """Layout with displaced points; gauges and loads move with the nearest points."""
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
    """Add structure, dots, gauges and loads of one panel; bar: number of its scalar bar or None."""
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
        # Lines and dots are on the surface: it is drawn slightly behind them.
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
    """Colour options of values, symmetric about zero if both signs occur, and scalar bar; peaks on facets may exceed the scale,
    and are then in the title."""
    area = geometry.areas(view.layout.points, view.layout.faces) if view.on == FACETS else None
    scale = geometry.scale_of(view.quantity, view.unit, panel.values, area)
    # VTK has one bar per title: trailing spaces distinguish the bars of the panels. The line feed separates the title from
    # the numbers.
    ends = np.array([np.nanmin(panel.values), np.nanmax(panel.values)])[[scale.below, scale.above]]
    extremes = f", extremes {' and '.join(f'{end:.3g}' for end in ends)}" if len(ends) else ""
    title = f"{view.quantity} [{view.unit}]{extremes}{' ' * (bar or 0)}\n"
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
    """Arrows through the position along all measuring directions, for a bridge one at each arm, slightly above the surface."""
    import pyvista as pv

    form: dict[str, Any] = {"scale": length, "shaft_radius": 0.05, "tip_radius": 0.13, "tip_length": 0.32}
    bases = [(position + 0.06 * length * normal, direction) for position, direction, normal in gauge.grids]
    arrows = [
        pv.Arrow(start=base - 0.5 * length * direction, direction=direction, **form)
        for base, direction in bases
        if np.any(direction)
    ]
    return arrows or [pv.Sphere(radius=0.15 * length, center=bases[0][0])]


def add_names(plotter: Any, layout: PictureLayout, visible: NDArray[np.bool_], through: bool = True) -> None:
    """Add labels of visible gauges and names of loads; through: whether labels are drawn over objects in front of them."""
    size = layout.size
    position, normal = layout.places
    for i in map(int, np.flatnonzero(visible)):
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
    """Text of a config for VTK, which would interpret two dollar signs as a formula."""
    return text.replace("$", "＄").replace("|", "¦") if text.count("$") > 1 or "|" in text else text


def font() -> str:
    """Font with Greek and most other letters, missing from the font of VTK."""
    import matplotlib as mpl

    return str(Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"))


OF_A_SCREEN = 0.9
"""Share of the screen for a window, without its frame and a task bar."""
WINDOWLESS = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
"""Fallback classes of VTK without a display: they draw an invisible window without an error."""
LOOK = 500
"""Interval of checks for the parent process [ms]."""


def draw(view: View, off_screen: bool) -> Any:
    """Plotter with all panels.

    A screenshot of one panel has a second view if a gauge is hidden in the first."""
    import pyvista as pv

    layout, triangle = view.layout, geometry.triangles(view.layout.faces)
    position, normal = layout.places
    corners = views(layout.points, triangle, position, normal)
    if not off_screen or len(view.panels) > 1:
        corners = corners[:1]
    cells = [(panel, corner, corner is corners[0]) for panel in view.panels for corner in corners]
    rows, columns = _grid(len(cells), layout.points)
    # Light from the viewer only: colours are never brighter than in the scalar bar.
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
        # Visibility is computed on the undeformed structure: displaced positions may be below the facets.
        visible = (
            geometry.seen_from(layout.points, triangle, position, normal, corner)
            if off_screen
            else np.ones(len(position))
        )
        moved = carried(layout, panel)
        add_panel(plotter, view, moved, panel, triangle, place if first and view.bar else None)
        add_names(plotter, moved, visible.astype(bool), through=off_screen)
        size = width // columns, height // rows
        _add_title(plotter, view.title if place == 0 else "", panel.title if first else "", size)
        plotter.add_axes(color=INK, line_width=2, viewport=(0, 0, 0.14, 0.14 * width / height * rows / columns))
        _aim(plotter, moved, corner, size)
    if not off_screen and len(cells) > 1:
        plotter.link_views()
    return plotter


def fitting(screen: tuple[int, int], size: tuple[int, int]) -> tuple[int, int]:
    """Width and height [px] of a window, reduced to fit the screen (width, height; zero: unknown)."""
    shares = [OF_A_SCREEN * room / wanted for room, wanted in zip(screen, size, strict=True) if room > 0]
    share = min(1.0, *shares) if shares else 1.0
    return int(share * size[0]), int(share * size[1])


def _add_title(plotter: Any, title: str, below: str, size: tuple[int, int]) -> None:
    """Add one or two lines in the upper left corner, with a font size independent of the panel size (width, height)."""
    for i, (text, points) in enumerate(filter(lambda line: line[0], ((title, 11), (below, 10))), start=1):
        words = shorten(text, size[0] // (points + 1), placeholder=" …")
        at = (8 / size[0], 1 - (4 + 24 * i) / size[1])
        plotter.add_text(plain(words), position=at, viewport=True, font_size=points, color=INK, font_file=font())


def _grid(count: int, points: FloatArray) -> tuple[int, int]:
    """Rows and columns of the panels; those of a slender structure are stacked."""
    extent = np.sort(np.ptp(points, axis=0))
    if count <= 2:
        return (count, 1) if extent[2] > 1.6 * extent[1] else (1, count)
    columns = 2 if count <= 4 or extent[2] > 1.6 * extent[1] else 3
    return -(-count // columns), columns


def _aim(plotter: Any, layout: PictureLayout, corner: FloatArray, size: tuple[int, int]) -> None:
    """Set a parallel view from a corner, z up, with the structure between title and scalar bar; size: of the panel [px]."""
    ends = [geometry.free_end(load, layout) for load in layout.loads]
    shown = np.concatenate([layout.points, np.array(ends, dtype=float).reshape(-1, 3)])
    axes = scene.across(corner)
    spread = shown @ axes
    wide, high = np.ptp(spread, axis=0)
    top, bottom = 64 / size[1], 0.13 + 27 / size[1]
    # The panel has a height of 2 × scale, the space between title and bar is smaller.
    scale = 0.5 * max(1.06 * high / (1 - top - bottom), 1.14 * wide * size[1] / size[0])
    centre = (spread.min(axis=0) + spread.max(axis=0)) / 2
    middle = axes @ (centre + np.array([0.0, scale * (top - bottom)])) + (shown.mean(axis=0) @ corner) * corner
    scene.aim(plotter, middle, corner, float(np.linalg.norm(np.ptp(shown, axis=0))), scale)


def show(plotter: Any, title: str, parent: int) -> None:
    """Show the window until it is closed, Ctrl-C is pressed or the parent process (its number) has ended."""
    # VTK waits for events in C: the Python handler would run only after the window is closed.
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


def draw_views(views: Sequence[View]) -> list[bytes]:
    """Pictures of all views."""
    pictures = [BytesIO() for _ in views]
    for view, picture in zip(views, pictures, strict=True):
        plotter = draw(view, off_screen=True)
        plotter.screenshot(picture)
        plotter.close()
    return [picture.getvalue() for picture in pictures]


def main(mode: str = "") -> None:
    """Show the view from stdin in a window until it is closed, or draw it off-screen."""
    if mode == scene.OFF_SCREEN:
        scene.answer(draw_views)
        return
    parent = os.getppid()
    view: View = pickle.load(sys.stdin.buffer)
    show(draw(view, off_screen=False), f"strainsight: {view.title}", parent)


if __name__ == "__main__":
    main(*sys.argv[1:])

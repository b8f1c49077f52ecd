"""Picture of the structure with its gauges, rendered off-screen in a child process, which may crash.

Without OpenGL, VTK ends its process with a segmentation fault (VTK 9.7 without EGL, X and OSMesa). In a child process only the
picture is lost, not the run. Scenes are sent by stdin and pictures returned by stdout, both pickled. So no file remains if a
process is interrupted or killed."""

from __future__ import annotations

import itertools
import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from hashlib import sha256
from typing import Any, TypeVar

import numpy as np

from strainsight.errors import StrainsightError
from strainsight.imports import FOLDER
from strainsight.pages.arrays import FloatArray
from strainsight.pages.chart.drawing import VERMILION, gauge_colour, ink_on, saved, styled
from strainsight.pages.picture import geometry
from strainsight.pages.picture.layout import PictureLayout
from strainsight.processes import end_with_parent, inherited, python
from strainsight.text import short

Pictures = TypeVar("Pictures")
OFF_SCREEN = "off-screen"
"""The argument of the child process."""
DEBIAN_PACKAGES = "libegl1 libegl-mesa0 libgl1-mesa-dri libgl1"


def draw_apart(module: str, what: Any, limit: float) -> list[bytes]:
    """Run `python -m module off-screen`, which draws `what` by `answer`: the pictures; limit [s].

    Raises StrainsightError that names the Debian packages where nothing can render."""
    output, environments = "no output", [inherited()]
    if sys.platform.startswith("linux"):
        # off-screen first, whatever DISPLAY says; then as VTK itself would choose (an X display, OSMesa)
        egl = {name: value for name, value in inherited().items() if name != "DISPLAY"}
        environments.insert(0, {**egl, "VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"})
    for environment in environments:
        command, data = [*python(module), OFF_SCREEN], pickle.dumps(what)
        try:
            done = subprocess.run(
                command, env=environment, cwd=FOLDER, input=data, capture_output=True, timeout=limit, check=False
            )
        except subprocess.TimeoutExpired:
            output = f"not finished after {limit:.0f} s"
            continue
        if done.returncode == 0 and done.stdout:
            pictures: list[bytes] = pickle.loads(done.stdout)
            return pictures
        output = f"exit code {done.returncode}" + last_words(done.stderr.decode(errors="replace"))
    raise StrainsightError(
        f"the 3D picture could not be rendered off-screen ({output})",
        remedy=f"install an OpenGL library for off-screen rendering; on Debian and Ubuntu: apt-get install {DEBIAN_PACKAGES}",
    )


def draw_or_explain(draw: Callable[[], Pictures]) -> tuple[Pictures | None, str]:
    """Pictures of `draw`, or None and the reason."""
    try:
        return draw(), ""
    except StrainsightError as error:
        return None, f"{error.what}: {error.remedy}"


def answer(draw: Callable[[Any], Sequence[bytes]]) -> None:
    """Child process: read from stdin, draw, and write pictures to stdout; library output goes to stderr."""
    end_with_parent()
    out = os.dup(1)
    os.dup2(2, 1)
    pictures = draw(pickle.load(sys.stdin.buffer))
    with os.fdopen(out, "wb") as stream:
        pickle.dump(list(pictures), stream)


def last_words(stderr: str) -> str:
    """Last line of VTK output, without colours, time stamp and place."""
    lines = re.sub(r"\x1b\[[0-9;]*m", "", stderr).strip().splitlines()
    return f", {lines[-1].rpartition('|')[2].strip()}" if lines else ""


WIDTH, HEIGHT = 640, 420
"""Size on the page [px]; the PNG has FINER times as many pixels in each direction."""
TIME_LIMIT = 120.0
"""Time limit of the first picture [s]."""
TIME_A_PICTURE = 20.0
"""Time limit of every further picture [s]."""
DOTS = 4000
"""Most dots of one kind."""


def render(layout: PictureLayout) -> bytes:
    """PNG of 1280 × 840 pixels with transparent background.

    Shows facets with edges, candidates as dots, labelled sensors (`geometry.marker`), loads as arrows, supported nodes as
    squares; two views if one does not show every gauge. Raises StrainsightError with the required Debian packages if rendering
    fails."""
    return render_all([layout])[0]


def render_all(layouts: Sequence[PictureLayout]) -> list[bytes]:
    """Pictures of several layouts as in `render`, in one child process."""
    limit = TIME_LIMIT + TIME_A_PICTURE * (len(layouts) - 1)
    return draw_apart("strainsight.pages.picture.scene", [thinned(layout) for layout in layouts], limit)


def thinned(layout: PictureLayout) -> PictureLayout:
    """Reduce the dots of each kind to at most DOTS."""

    def some(points: FloatArray) -> FloatArray:
        return points[:: max(1, -(-len(points) // DOTS))]

    return replace(layout, pool=some(layout.pool), fixed=some(layout.fixed), loose=some(layout.loose))


def look(layout: PictureLayout) -> str:
    """Digest of the picture, equal for layouts that look the same."""
    words = [(g.label, g.kind, g.bonded) for g in layout.gauges], [load.name for load in layout.loads]
    places = [array for gauge in layout.gauges for grid in gauge.grids for array in grid]
    arrows = [array for load in layout.loads for array in (load.point, load.direction)]
    digest = sha256(repr(words).encode())
    for array in (layout.points, layout.faces, layout.pool, layout.fixed, layout.loose, layout.bars, *places, *arrows):
        digest.update(f"{np.shape(array)}".encode() + np.asarray(array, dtype=float).tobytes())
    return digest.hexdigest()


STEEL, LINES, CREASES = "#c3ccd6", "#8693a3", "#3f4b59"
POOL, CLAMP = "#33475c", "#8a4fb5"
FINER = 2
"""Pixels of the picture per pixel of the page, for high resolution."""
DRAWN_FACETS = 20_000
"""Most facets with outlines."""
CAPTION = "#7b8794"
FONT = 10.0
"""Size of labels [pt], at 100 pixels per inch."""
CENTRED: dict[str, Any] = {"fontsize": FONT, "ha": "center", "va": "center"}
WIDE, HIGH, MARGIN = 4.6, 12.5, 7.5
"""Half size of a label [px]: width MARGIN + WIDE per letter, height HIGH."""


def draw(layout: PictureLayout) -> bytes:
    """PNG bytes for WIDTH × HEIGHT pixels: the layout from one corner, or from two if a gauge is hidden."""
    triangle = geometry.triangles(layout.faces)
    position, normal = layout.places
    corners = geometry.views(layout.points, triangle, position, normal)
    extent = np.sort(np.ptp(layout.points, axis=0))
    slender = extent[2] > 1.6 * extent[1]
    rows, columns = (len(corners), 1) if slender else (1, len(corners))
    size = WIDTH // columns, HEIGHT // rows
    # label an arrow in the views that show its free end, else in the first
    ends = np.array([geometry.free_end(load, layout) for load in layout.loads]).reshape(-1, 3)
    facing = np.array(
        [geometry.seen_from(layout.points, triangle, ends, np.tile(eye, (len(ends), 1)), eye) for eye in corners]
    )
    facing[0] |= facing.sum(axis=0) == 0
    panels = []
    for corner, named in zip(corners, facing.astype(bool), strict=True):
        visible = geometry.seen_from(layout.points, triangle, position, normal, corner).astype(bool)
        panels.append((*_geometry(layout, triangle, corner, size), visible, named, corner))
    return labelled(layout, panels, rows, columns, size)


def _geometry(layout: PictureLayout, triangle, corner: FloatArray, size: tuple[int, int]) -> tuple[Any, Any]:  # type: ignore[no-untyped-def]
    """RGBA image of one view, and the function points (k, 3) → pixels of the page (k, 2)."""
    import pyvista as pv

    diagonal = layout.size
    plotter = pv.Plotter(off_screen=True, window_size=[FINER * length for length in size], lighting="none")
    for direction, strength in (((0.3, 0.5, 1.0), 0.75), ((-0.6, 0.1, 0.5), 0.3), ((0.2, -0.9, 0.2), 0.2)):
        light = pv.Light(light_type="camera light", intensity=strength)
        light.position = direction
        plotter.add_light(light)
    # lift lines slightly above the surface to avoid artefacts
    lift = 4e-4 * diagonal * corner
    if len(triangle):
        _add_surface(plotter, layout, triangle, lift)
    if len(layout.bars):
        plotter.add_mesh(geometry.line_mesh(layout.points, layout.bars), color=CREASES, line_width=4.0, lighting=False)
    for points, rise, colour, width, spheres in (
        (layout.loose, lift, LINES, 13, False),
        (layout.pool, 2 * lift, POOL, 5, True),
        (layout.fixed, 2 * lift, CLAMP, 9, False),
    ):
        if len(points):
            dots = pv.PolyData(points + rise)
            plotter.add_mesh(dots, color=colour, point_size=width, render_points_as_spheres=spheres, lighting=False)
    for i, gauge in enumerate(layout.gauges):
        for mesh in geometry.marker(gauge, 0.034 * diagonal):
            plotter.add_mesh(mesh, color=geometry.EMPTY if gauge.bonded else gauge_colour(i), ambient=0.5)
            edges = mesh.extract_feature_edges(30.0) if gauge.bonded else mesh
            if gauge.bonded and edges.n_points:
                plotter.add_mesh(edges.translate(lift), color=gauge_colour(i), line_width=3.5, lighting=False)
    for load in layout.loads:
        plotter.add_mesh(geometry.arrow_mesh(load, layout), color=VERMILION, ambient=0.4)
    bounds = np.array(plotter.bounds).reshape(3, 2)  # everything inside, with room for labels
    box = np.array([[x, y, z] for x in bounds[0] for y in bounds[1] for z in bounds[2]])
    spread = np.ptp(box @ across(corner), axis=0)
    scale = 0.5 * max(spread[1] * 1.28, spread[0] * 1.1 * size[1] / size[0])
    aim(plotter, box.mean(axis=0), corner, float(np.linalg.norm(np.ptp(box, axis=0))), scale)
    plotter.enable_anti_aliasing("ssaa")
    image = np.asarray(plotter.screenshot(None, transparent_background=True, return_img=True))
    matrix = pv.array_from_vtkmatrix(plotter.camera.GetCompositeProjectionTransformMatrix(size[0] / size[1], -1, 1))
    plotter.close()

    def pixels(points: FloatArray) -> FloatArray:
        clip = np.column_stack([points, np.ones(len(points))]) @ matrix.T
        clip = clip[:, :2] / clip[:, 3:]
        return (clip * [1, -1] + 1) / 2 * size

    return image, pixels


def _add_surface(plotter: Any, layout: PictureLayout, triangle, lift: FloatArray) -> None:  # type: ignore[no-untyped-def]
    """Add shaded facets, their outlines and sharp edges."""
    surface = geometry.surface_mesh(layout.points, triangle)
    shaded = surface.compute_normals(
        split_vertices=True, feature_angle=30.0, consistent_normals=False, auto_orient_normals=False
    )
    plotter.add_mesh(shaded, color=STEEL, smooth_shading=True, ambient=0.32, diffuse=0.8, specular=0.05)
    if len(layout.faces) <= DRAWN_FACETS:
        wires = geometry.line_mesh(layout.points + lift, geometry.mesh_lines(layout.faces))
        plotter.add_mesh(wires, color=LINES, line_width=1.0, lighting=False)
    creases = surface.clean().extract_feature_edges(30.0, manifold_edges=False, non_manifold_edges=False)
    if creases.n_points:
        plotter.add_mesh(creases.translate(lift), color=CREASES, line_width=1.6, lighting=False)


def across(corner: FloatArray) -> FloatArray:
    """Unit vectors (3, 2) to the right and up in the view from a corner, z up."""
    right = np.cross([0.0, 0.0, 1.0], corner)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(corner, right)])


def aim(plotter: Any, middle: FloatArray, corner: FloatArray, reach: float, scale: float) -> None:
    """Set a parallel view from a corner at `middle`; reach [m]: size of the scene; scale [m]: half the height of the view."""
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point = middle
    camera.position = middle + 2 * reach * corner
    camera.up = across(corner)[:, 1]
    camera.parallel_scale = scale
    plotter.reset_camera_clipping_range()


@styled({})
def labelled(layout: PictureLayout, panels: list[Any], rows: int, columns: int, size: tuple[int, int]) -> bytes:
    """Arrange the views with labels, axes and view direction."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = size[0] * columns, size[1] * rows
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    FigureCanvasAgg(figure)
    figure.patch.set_alpha(0)
    middle = layout.points.mean(axis=0)
    diagonal = layout.size
    for place, (image, pixels, visible, named, corner) in enumerate(panels):
        row, column = divmod(place, columns)
        axes = figure.add_axes((column / columns, 1 - (row + 1) / rows, 1 / columns, 1 / rows))
        axes.imshow(image, extent=(0, size[0], size[1], 0), interpolation="none", aspect="auto")
        axes.set_axis_off()
        centre = pixels(middle[None])[0]
        labels: list[tuple[FloatArray, FloatArray, str, str, bool]] = []
        for i in np.flatnonzero(visible).tolist():
            gauge, anchor = layout.gauges[i], pixels(layout.gauges[i].position[None])[0]
            up = np.array([0.0, -1.0 if anchor[1] <= centre[1] else 1.0])
            labels.append((anchor, up, short(gauge.label), gauge_colour(i), gauge.bonded))
        for load in itertools.compress(layout.loads, named):
            fixed, free = pixels(np.array([load.point, geometry.free_end(load, layout)]))
            ahead = (free - fixed) / max(float(np.linalg.norm(free - fixed)), 1.0)
            labels.append((free, ahead, short(load.name), VERMILION, False))
        anchors, away = (np.array([label[k] for label in labels]).reshape(-1, 2) for k in (0, 1))
        places = spread_labels(anchors, away, [name for _, _, name, _, _ in labels], size)
        for place_of, (anchor, _, name, colour, hollow) in zip(places, labels, strict=True):
            ground, edge, thick = (geometry.EMPTY, colour, 2.2) if hollow else (colour, "white", 0.8)
            style: dict[str, Any] = {
                "bbox": {"boxstyle": "round,pad=0.32", "fc": ground, "ec": edge, "lw": thick},
                "arrowprops": {"arrowstyle": "-", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 2},
                "fontweight": "bold",
                "parse_math": False,
            }
            axes.annotate(name, tuple(anchor), tuple(place_of), color=ink_on(ground), **CENTRED, **style)
        _triad(axes, pixels, middle, diagonal, size)
        side = "above" if corner[2] > 0 else "below"
        axes.text(8, 13, f"seen from {side}", color=CAPTION, fontsize=FONT, va="center")
    return saved(figure, format="png", dpi=100 * FINER, transparent=True, metadata={"Software": None})


def spread_labels(anchors: FloatArray, away: FloatArray, names: list[str], size: tuple[int, int]) -> FloatArray:
    """Positions (k, 2) of labels near their anchors, inside the picture and without overlap.

    anchors (k, 2) [pixel]; away (k, 2): preferred directions. Each label in turn takes the first free position on rings of
    increasing distance."""
    half = np.array([[MARGIN + WIDE * len(name), HIGH] for name in names]).reshape(-1, 2)
    places: list[FloatArray] = []

    def is_free(option: FloatArray, i: int) -> bool:
        others = [(place, half[k] + 4) for k, place in enumerate(places)]
        others += [(anchor, np.full(2, 7.0)) for k, anchor in enumerate(anchors) if k != i]
        return not any(np.all(np.abs(option - place) < half[i] + room) for place, room in others)

    for i, (anchor, ahead) in enumerate(zip(anchors, away, strict=True)):
        aside = np.array([-ahead[1], ahead[0]])
        options = [
            np.clip(
                anchor + radius * (np.cos(turn) * ahead + np.sin(turn) * aside),
                half[i] + 4,
                np.array(size) - half[i] - 4,
            )
            for radius in (28, 38, 50, 64, 82, 104, 130)
            for turn in np.radians([0, 25, -25, 50, -50, 75, -75, 105, -105, 130, -130, 180])
        ]
        places.append(next((option for option in options if is_free(option, i)), options[0]))
    return np.array(places).reshape(-1, 2)


def _triad(axes: Any, pixels: Any, middle: FloatArray, diagonal: float, size: tuple[int, int]) -> None:
    """Draw the global axes in the lower left corner."""
    base = np.array([40.0, size[1] - 38.0])
    step = 1e-3 * diagonal
    shift = pixels(middle + step * np.eye(3)) - pixels(middle[None])
    shift *= 26 / np.linalg.norm(shift, axis=1).max()
    line = {"arrowstyle": "-|>", "color": CAPTION, "lw": 1.3, "shrinkA": 0, "shrinkB": 0}
    for name, arrow in zip("xyz", shift, strict=True):
        axes.annotate("", base + arrow, base, arrowprops=line)
        reach = float(np.linalg.norm(arrow))
        axes.text(*(base + arrow * (1 + 9 / max(reach, 6.0))), name, color=CAPTION, **CENTRED)


if __name__ == "__main__":
    answer(lambda layouts: list(map(draw, layouts)))

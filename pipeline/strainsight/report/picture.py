"""The picture itself, drawn in the child process of scene.py: geometry by PyVista, labels over it by matplotlib."""

from __future__ import annotations

import io
import warnings
from typing import Any

import numpy as np

from strainsight.report.data import FloatArray, Layout, Load
from strainsight.report.drawing import VERMILION, gauge_colour, ink_on
from strainsight.report.geometry import mesh_lines, seen_from, triangles, views
from strainsight.report.text import short

STEEL, LINES, CREASES = "#c3ccd6", "#8693a3", "#3f4b59"
POOL, CLAMP, CAPTION = "#33475c", "#8a4fb5", "#7b8794"
# More lines than this would turn the surface black.
DRAWN_FACETS = 20_000


def draw(layout: Layout, width: int, height: int) -> bytes:
    """PNG bytes (width × height) of the layout, seen from one corner or, where that hides a gauge, from two."""
    triangle = triangles(layout.faces)
    position = np.array([gauge.position for gauge in layout.gauges]).reshape(-1, 3)
    normal = np.array([gauge.normal for gauge in layout.gauges]).reshape(-1, 3)
    corners = views(layout.points, triangle, position, normal)
    extent = np.sort(np.ptp(layout.points, axis=0))
    slender = extent[2] > 1.6 * extent[1]
    rows, columns = (len(corners), 1) if slender else (1, len(corners))
    size = width // columns, height // rows
    # An arrow is named in the views that show its free end, and where none does, in the first.
    ends = np.array([_free_end(load, layout) for load in layout.loads]).reshape(-1, 3)
    facing = np.array([seen_from(layout.points, triangle, ends, np.tile(eye, (len(ends), 1)), eye) for eye in corners])
    facing[0] |= facing.sum(axis=0) == 0
    panels = []
    for corner, named in zip(corners, facing.astype(bool), strict=True):
        seen = seen_from(layout.points, triangle, position, normal, corner).astype(bool)
        panels.append((*_geometry(layout, triangle, corner, size), seen, named, corner))
    return _labelled(layout, panels, rows, columns, size)


def _geometry(layout: Layout, triangle, corner: FloatArray, size: tuple[int, int]) -> tuple[Any, Any]:  # type: ignore[no-untyped-def]
    """RGBA image (height, width, 4) of one view, and the function points (k, 3) → pixels (k, 2) from the upper left."""
    import pyvista as pv

    diagonal = float(np.linalg.norm(np.ptp(layout.points, axis=0)))
    plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    for direction, strength in (((0.3, 0.5, 1.0), 0.75), ((-0.6, 0.1, 0.5), 0.3), ((0.2, -0.9, 0.2), 0.2)):
        light = pv.Light(light_type="camera light", intensity=strength)
        light.position = direction
        plotter.add_light(light)
    # Lines lie in the surface: lift them towards the eye by less than a pixel's worth, so that they do not flicker.
    lift = 4e-4 * diagonal * corner
    if len(triangle):
        _add_surface(plotter, layout, triangle, lift)
    if len(layout.loose):
        plotter.add_mesh(pv.PolyData(layout.loose + lift), color=LINES, point_size=13, lighting=False)
    if len(layout.pool):
        plotter.add_mesh(
            pv.PolyData(layout.pool + 2 * lift), color=POOL, point_size=5, render_points_as_spheres=True, lighting=False
        )
    if len(layout.fixed):
        plotter.add_mesh(pv.PolyData(layout.fixed + 2 * lift), color=CLAMP, point_size=9, lighting=False)
    for i, gauge in enumerate(layout.gauges):
        plotter.add_mesh(
            _bar(gauge.position, gauge.direction, gauge.normal, 0.034 * diagonal), color=gauge_colour(i), ambient=0.5
        )
    for load in layout.loads:
        start, step = _arrow(load, layout)
        arrow = pv.Arrow(
            start=start,
            direction=step,
            scale=float(np.linalg.norm(step)),
            shaft_radius=0.022,
            tip_radius=0.065,
            tip_length=0.28,
        )
        plotter.add_mesh(arrow, color=VERMILION, ambient=0.4)
    _aim(plotter, corner, size)
    plotter.enable_anti_aliasing("ssaa")
    image = np.asarray(plotter.screenshot(None, transparent_background=True, return_img=True))
    matrix = pv.array_from_vtkmatrix(plotter.camera.GetCompositeProjectionTransformMatrix(size[0] / size[1], -1, 1))
    plotter.close()

    def pixels(points: FloatArray) -> FloatArray:
        clip = np.column_stack([points, np.ones(len(points))]) @ matrix.T
        clip = clip[:, :2] / clip[:, 3:]
        return (clip * [1, -1] + 1) / 2 * size

    return image, pixels


def _add_surface(plotter: Any, layout: Layout, triangle, lift: FloatArray) -> None:  # type: ignore[no-untyped-def]
    """Shaded facets with their outlines and the sharp edges of the body."""
    import pyvista as pv

    surface = pv.PolyData(layout.points, np.column_stack([np.full(len(triangle), 3), triangle]).ravel())
    shaded = surface.compute_normals(
        split_vertices=True, feature_angle=30.0, consistent_normals=False, auto_orient_normals=False
    )
    plotter.add_mesh(shaded, color=STEEL, smooth_shading=True, ambient=0.32, diffuse=0.8, specular=0.05)
    if len(layout.faces) <= DRAWN_FACETS:
        _add_lines(plotter, layout.points + lift, mesh_lines(layout.faces), LINES, 1.0)
    creases = surface.clean().extract_feature_edges(30.0, manifold_edges=False, non_manifold_edges=False)
    if creases.n_points:
        plotter.add_mesh(creases.translate(lift), color=CREASES, line_width=1.6, lighting=False)


def _add_lines(plotter: Any, points: FloatArray, lines: Any, colour: str, width: float) -> None:
    import pyvista as pv

    wires = pv.PolyData()
    wires.points = points
    wires.lines = np.column_stack([np.full(len(lines), 2), lines]).ravel()
    plotter.add_mesh(wires, color=colour, line_width=width, lighting=False)


def _bar(position: FloatArray, direction: FloatArray, normal: FloatArray, length: float) -> Any:
    """A gauge as a flat bar of this length along its direction, a third as wide, just proud of the surface.

    Without a direction (3,) it is a ball; without a normal the bar lies as flat as it can.
    """
    import pyvista as pv

    if not np.any(direction):
        return pv.Sphere(radius=0.25 * length, center=position)
    if not np.any(normal):
        upright = np.eye(3)[2 if abs(direction[2]) < 0.9 else 0]
        normal = upright - (upright @ direction) * direction
        normal = normal / np.linalg.norm(normal)
    across = np.cross(normal, direction)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([direction, across, normal])
    frame[:3, 3] = position
    bar = pv.Box(bounds=np.array([-0.5, 0.5, -0.17, 0.17, -0.02, 0.05]) * length)
    return bar.transform(frame, inplace=False)


def _arrow(load: Load, layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Start (3,) and step (3,) of a load's arrow: from the loaded point if that leads out of the body, else to it."""
    low, high = layout.points.min(axis=0), layout.points.max(axis=0)

    def outside(end: FloatArray) -> float:
        return float(np.linalg.norm(end - np.clip(end, low, high)))

    step = 0.14 * float(np.linalg.norm(high - low)) * load.direction / np.linalg.norm(load.direction)
    inward = outside(load.point + step) < outside(load.point - step)
    return (load.point - step if inward else load.point), step


def _free_end(load: Load, layout: Layout) -> FloatArray:
    """The end (3,) of a load's arrow that is not the loaded point: where its name goes."""
    start, step = _arrow(load, layout)
    return start if start is not load.point else start + step


def _aim(plotter: Any, corner: FloatArray, size: tuple[int, int]) -> None:
    """Parallel view from a corner, z up, everything inside with room for labels."""
    bounds = np.array(plotter.bounds).reshape(3, 2)
    box = np.array([[x, y, z] for x in bounds[0] for y in bounds[1] for z in bounds[2]])
    middle = box.mean(axis=0)
    right = np.cross([0.0, 0.0, 1.0], corner)
    right /= np.linalg.norm(right)
    up = np.cross(corner, right)
    spread = np.ptp(box @ np.column_stack([right, up]), axis=0)
    camera = plotter.camera
    camera.parallel_projection = True
    camera.focal_point = middle
    camera.position = middle + corner * float(np.linalg.norm(np.ptp(box, axis=0))) * 2
    camera.up = up
    camera.parallel_scale = 0.5 * max(spread[1] * 1.28, spread[0] * 1.1 * size[1] / size[0])
    plotter.reset_camera_clipping_range()


def _labelled(layout: Layout, panels: list[Any], rows: int, columns: int, size: tuple[int, int]) -> bytes:
    """The views side by side or one above the other, with names, axes and a word on where one looks from."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = size[0] * columns, size[1] * rows
    figure = Figure(figsize=(width / 100, height / 100), dpi=100)
    FigureCanvasAgg(figure)
    figure.patch.set_alpha(0)
    middle = layout.points.mean(axis=0)
    diagonal = float(np.linalg.norm(np.ptp(layout.points, axis=0)))
    for place, (image, pixels, seen, named, corner) in enumerate(panels):
        row, column = divmod(place, columns)
        axes = figure.add_axes((column / columns, 1 - (row + 1) / rows, 1 / columns, 1 / rows))
        axes.imshow(image, extent=(0, size[0], size[1], 0), interpolation="none", aspect="auto")
        axes.set_axis_off()
        centre = pixels(middle[None])[0]
        anchors, names, colours, away = [], [], [], []
        for i, gauge in enumerate(layout.gauges):
            if seen[i]:
                anchors.append(pixels(gauge.position[None])[0])
                names.append(short(gauge.label))
                colours.append(gauge_colour(i))
                away.append(np.array([0.0, -1.0 if anchors[-1][1] <= centre[1] else 1.0]))
        for load, shown in zip(layout.loads, named, strict=True):
            if not shown:
                continue
            fixed, free = pixels(np.array([load.point, _free_end(load, layout)]))
            anchors.append(free)
            away.append((free - fixed) / max(float(np.linalg.norm(free - fixed)), 1.0))
            names.append(short(load.name))
            colours.append(VERMILION)
        places = spread_labels(np.array(anchors).reshape(-1, 2), np.array(away).reshape(-1, 2), names, size)
        for anchor, spot, name, colour in zip(anchors, places, names, colours, strict=True):
            axes.annotate(
                name,
                xy=anchor,
                xytext=spot,
                ha="center",
                va="center",
                fontsize=14,
                fontweight="bold",
                color=ink_on(colour),
                parse_math=False,
                bbox={"boxstyle": "round,pad=0.32", "fc": colour, "ec": "white", "lw": 0.8},
                arrowprops={"arrowstyle": "-", "color": colour, "lw": 1.4, "shrinkA": 0, "shrinkB": 2},
            )
        _triad(axes, pixels, middle, diagonal, size)
        side = "above" if corner[2] > 0 else "below"
        axes.text(14, 22, f"seen from {side}", color=CAPTION, fontsize=13.5, va="center")
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(buffer, format="png", dpi=100, transparent=True, metadata={"Software": None})
    return buffer.getvalue()


def spread_labels(anchors: FloatArray, away: FloatArray, names: list[str], size: tuple[int, int]) -> FloatArray:
    """Where labels go: off their anchors, inside the picture, and none on another.

    anchors (k, 2) [pixel], away (k, 2) the direction each would go by itself; returns (k, 2). Labels are taken in turn;
    each tries rings of growing distance, turning from its own direction, and takes the first place that is free.
    """
    half = np.array([[10.0 + 6.2 * len(name), 17.0] for name in names]).reshape(-1, 2)
    places: list[FloatArray] = []
    for i, (anchor, ahead) in enumerate(zip(anchors, away, strict=True)):
        aside = np.array([-ahead[1], ahead[0]])
        options = [
            np.clip(
                anchor + radius * (np.cos(turn) * ahead + np.sin(turn) * aside),
                half[i] + 4,
                np.array(size) - half[i] - 4,
            )
            for radius in (40, 54, 70, 90, 115, 145, 180)
            for turn in np.radians([0, 25, -25, 50, -50, 75, -75, 105, -105, 130, -130, 180])
        ]
        free = (option for option in options if _is_free(option, half[i], places, half, anchors, i))
        places.append(next(free, options[0]))
    return np.array(places).reshape(-1, 2)


def _is_free(
    option: FloatArray, half: FloatArray, places: list[FloatArray], halves: FloatArray, anchors: FloatArray, own: int
) -> bool:
    for other, place in enumerate(places):
        if np.all(np.abs(option - place) < half + halves[other] + 4):
            return False
    others = np.delete(anchors, own, axis=0)
    return not np.any(np.all(np.abs(others - option) < half + 10, axis=1))


def _triad(axes: Any, pixels: Any, middle: FloatArray, diagonal: float, size: tuple[int, int]) -> None:
    """The global axes in the lower left corner."""
    base = np.array([58.0, size[1] - 56.0])
    step = 1e-3 * diagonal
    shift = pixels(middle + step * np.eye(3)) - pixels(middle[None])
    shift *= 40 / np.linalg.norm(shift, axis=1).max()
    for name, arrow in zip("xyz", shift, strict=True):
        axes.annotate(
            "",
            base + arrow,
            base,
            arrowprops={"arrowstyle": "-|>", "color": CAPTION, "lw": 1.3, "shrinkA": 0, "shrinkB": 0},
        )
        reach = float(np.linalg.norm(arrow))
        axes.text(
            *(base + arrow * (1 + 13 / max(reach, 8.0))), name, color=CAPTION, fontsize=13.5, ha="center", va="center"
        )

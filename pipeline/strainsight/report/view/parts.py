"""What is drawn in one panel of a view: structure, dots, gauges as arrows, loads, names, a scalar bar with its unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strainsight.report.arrays import FloatArray, IntArray
from strainsight.report.chart.drawing import VERMILION, gauge_colour, ink_on
from strainsight.report.picture.colours import scale_of
from strainsight.report.picture.geometry import areas, facet_of_triangle, mesh_lines
from strainsight.report.picture.layout import Gauge, Layout
from strainsight.report.picture.markers import arrow_mesh, free_end, line_mesh, surface_mesh
from strainsight.report.picture.picture import CREASES, DRAWN_FACETS
from strainsight.report.text import short
from strainsight.report.view.viewed import DOTS, FACETS, POINTS, Panel, View

STEEL, LINES, POOL, CLAMP, INK = "#c3ccd6", "#5d6a79", "#7b8794", "#8a4fb5", "#1c2430"
LENGTH = 0.07
"""Of a gauge's arrow, over the size of the structure."""


def carried(layout: Layout, panel: Panel) -> Layout:
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


def add_panel(plotter: Any, view: View, layout: Layout, panel: Panel, triangle: IntArray, bar: int | None) -> None:
    """Structure, dots, gauges and loads of one panel; bar: number of its scalar bar, None: without one."""
    import pyvista as pv

    points = layout.points
    size = float(np.linalg.norm(np.ptp(layout.points, axis=0)))
    coloured = _colours(view, panel, bar) if len(panel.values) else None
    if len(triangle):
        surface = surface_mesh(points, triangle)
        if coloured is None or view.on == DOTS:
            shown = plotter.add_mesh(surface, color=STEEL, ambient=0.45, diffuse=0.55)
        elif view.on == POINTS:
            shown = plotter.add_mesh(surface, scalars=panel.values, preference="point", **coloured)
        else:
            values = panel.values[facet_of_triangle(layout.faces)]
            shown = plotter.add_mesh(surface, scalars=values, preference="cell", **coloured)
        # Lines and dots lie in the surface: it is drawn a little behind them.
        shown.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        shown.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(2.0, 2.0)
        if len(layout.faces) <= DRAWN_FACETS:
            wires = line_mesh(points, mesh_lines(layout.faces))
            plotter.add_mesh(wires, color=LINES, line_width=1, opacity=0.5, lighting=False)
    if len(layout.bars):
        plotter.add_mesh(line_mesh(points, layout.bars), color=CREASES, line_width=3, lighting=False)
    for own, colour, width in ((layout.loose, LINES, 9), (layout.pool, POOL, 5), (layout.fixed, CLAMP, 8)):
        if len(own):
            plotter.add_mesh(pv.PolyData(own), color=colour, point_size=width, lighting=False)
    if view.on == DOTS and coloured is not None and len(view.dots):
        round_ones = coloured | {"ambient": 1.0, "diffuse": 0.0}
        plotter.add_mesh(
            pv.PolyData(view.dots), scalars=panel.values, point_size=10, render_points_as_spheres=True, **round_ones
        )
    for i, gauge in enumerate(layout.gauges):
        for own in gauge_arrows(gauge, LENGTH * size):
            plotter.add_mesh(own, color=gauge_colour(i), ambient=0.5)
    for load in layout.loads:
        plotter.add_mesh(arrow_mesh(load, layout), color=VERMILION, ambient=0.4)


def _colours(view: View, panel: Panel, bar: int | None) -> dict[str, Any]:
    """How values are coloured, about zero where they have both signs, with a scalar bar of their own; on facets a peak lies
    beyond its ends, and the title says how large it is."""
    area = areas(view.layout.points, view.layout.faces) if view.on == FACETS else None
    scale = scale_of(view.quantity, view.unit, panel.values, area)
    # VTK keeps one bar a title: spaces, which nobody sees, distinguish the panels' bars. The line feed keeps the title off
    # the numbers.
    ends = np.array([np.nanmin(panel.values), np.nanmax(panel.values)])[[scale.below, scale.above]]
    beyond = f", beyond its ends {' and '.join(f'{end:.3g}' for end in ends)}" if len(ends) else ""
    title = f"{view.quantity} [{view.unit}]{beyond}{' ' * (bar or 0)}\n"
    return {
        "cmap": scale.name,
        "clim": (scale.low, scale.high),
        "nan_color": STEEL,
        "ambient": 0.6,
        "diffuse": 0.4,
        "show_scalar_bar": bar is not None,
        "scalar_bar_args": {
            "title": plain(title),
            "color": INK,
            "vertical": False,
            "position_x": 0.28,
            "position_y": 0.02,
            "width": 0.6,
            "height": 0.1,
            "title_font_size": 16,
            "label_font_size": 14,
            "n_labels": 4,
            "fmt": "%.3g",
        },
    }


def gauge_arrows(gauge: Gauge, length: float) -> list[Any]:
    """An arrow through the place along everything that the sensor reads, of a bridge one at each arm, lifted off the surface by
    its own thickness."""
    import pyvista as pv

    arrows = []
    base = np.asarray(gauge.position, dtype=float) + 0.06 * length * np.asarray(gauge.normal, dtype=float)
    arms = [(arm.position + 0.06 * length * arm.normal, arm.direction) for arm in gauge.arms]
    for start, direction in arms or [(base, direction) for direction in gauge.channels]:
        if np.any(direction):
            arrows.append(
                pv.Arrow(
                    start=start - 0.5 * length * direction,
                    direction=direction,
                    scale=length,
                    shaft_radius=0.05,
                    tip_radius=0.13,
                    tip_length=0.32,
                )
            )
    return arrows or [pv.Sphere(radius=0.15 * length, center=base)]


def add_names(plotter: Any, layout: Layout, seen: NDArray[np.bool_], through: bool = True) -> None:
    """Ids of the gauges that are seen, and names of loads; through: ids are drawn over what stands before them."""
    size = float(np.linalg.norm(np.ptp(layout.points, axis=0)))
    position, normal = layout.places
    for i in map(int, np.flatnonzero(seen)):
        gauge = layout.gauges[i]
        mark = f"{short(gauge.label)}{' (bonded)' if gauge.bonded else ''}"
        at = position[i] + size * (0.6 * LENGTH * gauge.channels[0] + 0.02 * normal[i])
        _name(plotter, at, mark, gauge_colour(i), through)
    for load in layout.loads:
        _name(plotter, free_end(load, layout), short(load.name), VERMILION)


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

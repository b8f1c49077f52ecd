"""A layout line by line: every channel, of a bridge every arm, with the edges that it is measured from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.pages.datum import Frame
from strainsight.sensors.edge_dimensions import EdgeDimensions, edge_dimensions, facet_keys, no_edges


@dataclass(frozen=True)
class GaugeLine:
    """A channel, or an arm of a bridge with its sign in words: number of its gauge in the layout; ids; position [m]; normal and
    direction unit; angle [deg] from the projected axis; length [m] of the grid, 0: not stated; peak [unit of the channel]."""

    gauge: int
    element: int
    facet: int
    position: np.ndarray
    normal: np.ndarray
    direction: np.ndarray
    angle: float
    length: float
    peak: float
    sign: str = ""


def gauge_lines(listed: GaugeList) -> list[GaugeLine]:
    """All of them in the order of the layout."""
    return [line for i in range(len(listed.labels)) for line in _lines(listed, i)]


def _lines(listed: GaugeList, i: int) -> list[GaugeLine]:
    arms, peaks = listed.arms[i], listed.peaks[i]
    if arms is not None:
        g, peak = arms.grid, peaks[0]
        columns = zip(g.element, g.facet, g.position, g.normal, g.direction, g.angle, g.length, arms.sign, strict=True)
        return [
            GaugeLine(i, e, f, x, n, d, angle, length, peak, f"{s:g}") for e, f, x, n, d, angle, length, s in columns
        ]
    element, facet, position, normal = (getattr(listed, c)[i] for c in ("element", "facet", "position", "normal"))
    each = zip(listed.directions[i], listed.angles[i], peaks, strict=True)
    return [GaugeLine(i, element, facet, position, normal, d, angle, listed.length[i], peak) for d, angle, peak in each]


def line_edges(lines: Sequence[GaugeLine], mesh: Mesh) -> EdgeDimensions:
    """Of every line the nearest edges of its face; none of what lies on no facet."""
    if not any(line.facet for line in lines):
        return no_edges(len(lines))
    columns = (np.array([getattr(line, name) for line in lines]) for name in ("element", "facet"))
    position, direction, normal = (
        np.array([getattr(line, name) for line in lines]).reshape(-1, 3) for name in ("position", "direction", "normal")
    )
    return edge_dimensions(mesh.position, exterior_facets(mesh), facet_keys(*columns), position, direction, normal)


def measured_columns(frame: Frame) -> list[str]:
    """Heads of what `measured_cells` gives."""
    u = frame.unit
    return [f"x_{u}", f"y_{u}", f"z_{u}", f"edge_{u}", "edge_deg", f"edge2_{u}", "edge2_deg"]


def measured_cells(lines: Sequence[GaugeLine], edges: EdgeDimensions, frame: Frame) -> list[list[str]]:
    """Of every line its place in the frame, and distance and angle to both edges; empty where there is none."""
    rows = []
    for line, distance, angle in zip(lines, frame.length(edges.distance), edges.angle, strict=True):
        pairs = [value for pair in zip(distance, angle, strict=True) for value in pair]
        rows.append([cell(x) for x in (*frame.place(line.position), *pairs)])
    return rows


def cell(value: float) -> str:
    """Nine digits, what is rounding of zero as 0; empty for what is not there."""
    return "" if np.isnan(value) else f"{round(value, 9) + 0.0:.9g}"

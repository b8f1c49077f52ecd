"""What a workshop gets of a layout: places and dimensions in its own axes and the deck's unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from strainsight.config.gauge_types import GaugeType, Typed, gauge_type
from strainsight.csv_cells import csv_bytes
from strainsight.experiment.layout.gauge_lines import (
    GaugeLine,
    cell,
    gauge_lines,
    line_edges,
    measured_cells,
    measured_columns,
)
from strainsight.experiment.layout.gauge_list import GaugeList, marked_places
from strainsight.mesh.model import Mesh
from strainsight.pages.datum import Frame
from strainsight.sensors.clearance import carrier
from strainsight.sensors.edge_dimensions import EdgeDimensions
from strainsight.sensors.export import uff_text


@dataclass(frozen=True)
class Workshop:
    """A layout line by line, the edges that every line is measured from, and the axes that places are given in."""

    listed: GaugeList
    lines: Sequence[GaugeLine]
    edges: EdgeDimensions
    frame: Frame

    def lines_of(self, gauge: int) -> list[int]:
        """Indices of the lines of a gauge, by its number in the layout."""
        return [i for i, line in enumerate(self.lines) if line.gauge == gauge]


@dataclass(frozen=True)
class Foil:
    """What a gauge is bonded by: length along its grid and width of its carrier [m]; type, None: assumed for its grid."""

    length: float
    width: float
    type: GaugeType | None


def foil_at(gauges: Typed, shop: Workshop, line: int) -> Foil:
    """Of the grid of this line. What is bonded already may be of another type than the config names."""
    own = shop.lines[line]
    bonded_on = shop.listed.unit[own.gauge] == "strain" and not shop.listed.bonded[own.gauge]
    kind = gauge_type(gauges) if bonded_on else None
    size = carrier(own.length) if kind is None else (kind.carrier_length, kind.carrier_width)
    return Foil(*size, kind)


def workshop_of(listed: GaugeList, mesh: Mesh, frame: Frame) -> Workshop:
    """The layout on this mesh, as measured in a frame."""
    lines = gauge_lines(listed)
    return Workshop(listed, lines, line_edges(lines, mesh), frame)


def workshop_csv(shop: Workshop) -> bytes:
    """workshop.csv: a line a channel, of a bridge an arm; places, directions and normals in the frame, its unit in the heads."""
    listed, frame, bridged = shop.listed, shop.frame, any(shop.listed.arms)
    axes = [f"{vector}_{axis}" for vector in ("direction", "normal") for axis in "xyz"]
    head = ["gauge", "kind", "glued", "element", "facet", *measured_columns(frame)]
    head += [*axes, "angle_deg", f"grid_length_{frame.unit}"] + ["sign"] * bridged
    rows = [head]
    for own, measured in zip(shop.lines, measured_cells(shop.lines, shop.edges, frame), strict=True):
        i = own.gauge
        words = [
            listed.labels[i],
            listed.kind[i],
            "yes" if listed.bonded[i] else "no",
            str(own.element),
            str(own.facet),
        ]
        turned = [cell(x) for x in (*frame.turn(own.direction), *frame.turn(own.normal))]
        sizes = [cell(own.angle), cell(float(frame.length(own.length)))]
        rows.append([*words, *measured, *turned, *sizes, *[own.sign] * bridged])
    return csv_bytes(rows)


def workshop_unv(shop: Workshop) -> bytes:
    """workshop.unv: as gauges.unv, in the frame and its unit."""
    frame = shop.frame
    position, direction, normal, labels = marked_places(shop.listed)
    moved = frame.place(position), frame.turn(direction), frame.turn(normal)
    return uff_text(*moved, labels, unit=frame.unit, metres=frame.metres).encode()

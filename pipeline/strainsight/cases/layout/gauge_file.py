"""gauges.csv: the layout for whoever bonds it, and for the config of the next run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.cases.layout.gauge_lines import gauge_lines, line_edges, measured_cells, measured_columns
from strainsight.cases.layout.gauge_list import GaugeList
from strainsight.csv_cells import csv_bytes
from strainsight.mesh.model import Mesh
from strainsight.report.datum import Frame


def gauge_csv(listed: GaugeList, without: Mapping[str, np.ndarray], mesh: Mesh, frame: Frame) -> bytes:
    """A line a channel, of a bridge an arm with its sign, lengths in m, the largest training reading in the unit of the channel,
    σ of every unknown without the gauge relative to its scale; then places and distances to the edges in the deck's unit, and
    what is to be looked at where it is bonded, where there is something."""
    bridged, noted = any(listed.arms), any(listed.notes)
    axes = [f"{vector}_{axis}" for vector in ("position", "normal", "direction") for axis in "xyz"]
    head = ["gauge", "kind", "sensors", "glued", "element", "facet", *axes, "angle_deg", "grid_length", "peak", "unit"]
    head += ["sign"] * bridged
    rows = [[*head, *(f"std_{name}_without" for name in without), *measured_columns(frame), *["notes"] * noted]]
    lines = gauge_lines(listed)
    for own, measured in zip(lines, measured_cells(lines, line_edges(lines, mesh), frame), strict=True):
        i = own.gauge
        numbers = [*np.round([*own.position, *own.normal, *own.direction], 12) + 0.0, own.angle, own.length, own.peak]
        bonded = "yes" if listed.bonded[i] else "no"
        words = [listed.labels[i], listed.kind[i], listed.family[i], bonded, str(own.element), str(own.facet)]
        missing = [f"{values[i]:.9g}" for values in without.values()]
        tail = [listed.unit[i], *[own.sign] * bridged, *missing, *measured, *listed.notes[i : i + noted]]
        rows.append([*words, *(f"{x:.9g}" for x in numbers), *tail])
    return csv_bytes(rows)

"""Files for gauge installation and measurement programs: positions, dimensions, channel lists, element sets."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.config.gauge_types import GaugeType, gauge_type
from strainsight.config.gauges import Gauges
from strainsight.config.placement import Report
from strainsight.experiment.layout.gauge_list import (
    GaugeList,
    cell,
    channel_labels,
    marked_places,
    measured_cells,
    measured_columns,
)
from strainsight.positions import PositionAxes
from strainsight.sensors.edges import EdgeDimensions, carrier
from strainsight.sensors.export import uff_text
from strainsight.text import csv_bytes


@dataclass(frozen=True)
class Workshop:
    """Gauges of a layout, the reference edges of every line, and the coordinate axes."""

    listed: GaugeList
    edges: EdgeDimensions
    frame: PositionAxes


@dataclass(frozen=True)
class Foil:
    """Carrier of a gauge: length and width [m]; type: None if assumed from the grid length."""

    length: float
    width: float
    type: GaugeType | None


def foil_at(gauges: Gauges, shop: Workshop, line: int) -> Foil:
    """Carrier at a line; bonded gauges may have another type than the config."""
    listed, length = shop.listed, shop.listed.grids.length[line]
    gauge = listed.gauge[line]
    bonded_on = listed.unit[gauge] == "strain" and not listed.bonded[gauge]
    kind = gauge_type(gauges) if bonded_on else None
    size = carrier(length) if kind is None else (kind.carrier_length, kind.carrier_width)
    return Foil(*size, kind)


def workshop_csv(shop: Workshop) -> bytes:
    """workshop.csv: one line per channel or bridge arm, with position, direction and normal in the frame."""
    listed, frame, grids = shop.listed, shop.frame, shop.listed.grids
    bridged = any(listed.signs)
    axes = [f"{vector}_{axis}" for vector in ("direction", "normal") for axis in "xyz"]
    head = ["gauge", "kind", "glued", "element", "facet", *measured_columns(frame)]
    head += [*axes, "angle_deg", f"grid_length_{frame.unit}"] + ["sign"] * bridged
    rows = [head]
    for line, measured in enumerate(measured_cells(grids, shop.edges, frame)):
        i = listed.gauge[line]
        words = [listed.labels[i], listed.kind[i], "yes" if listed.bonded[i] else "no"]
        words += [str(grids.element[line]), str(grids.facet[line])]
        turned = [cell(x) for x in (*frame.turn(grids.direction[line]), *frame.turn(grids.normal[line]))]
        sizes = [cell(grids.angle[line]), cell(float(frame.length(grids.length[line])))]
        rows.append([*words, *measured, *turned, *sizes, *[listed.signs[line]] * bridged])
    return csv_bytes(rows)


def workshop_unv(shop: Workshop) -> bytes:
    """workshop.unv: gauges.unv in the frame and its unit."""
    frame, (grids, labels) = shop.frame, marked_places(shop.listed)
    moved = frame.place(grids.position), frame.turn(grids.direction), frame.turn(grids.normal)
    return uff_text(*moved, labels, unit=frame.unit, metres=frame.metres).encode()


UNIT = {"strain": "um/m"}
"""Unit of the instrument if it differs from that of the readings."""
BRIDGES = {1: "quarter", 2: "half", 4: "full"}
HALVES = {True: "half, arms 1 and 2", False: "half, arms 1 and 3"}


@dataclass(frozen=True)
class _Row:
    """One channel; bridge, factor, resistance: in words, empty if unknown or not a strain gauge; arms: number of bridge arms."""

    name: str
    kind: str
    unit: str
    bridge: str
    arms: int
    factor: str
    resistance: str


def catman_table(listed: GaugeList, report: Report) -> bytes:
    """Tab-separated, one row per channel: number, name, sensor, bridge, gauge factor, resistance, µm/m per mV/V, unit.

    ε [µm/m] = 4000/GF · r [mV/V]     for one gauge, and for the signed sum ε_B of bridge arms
    """
    head = ["Channel", "Name", "Sensor", "Bridge", "Gauge factor", "Resistance [ohm]", "um/m per mV/V", "Unit"]
    rows: list[list[str]] = []
    for number, row in enumerate(_rows(listed, report), start=1):
        slope = f"{4000 / report.gauge_factor:.9g}" if report.gauge_factor and row.arms else ""
        rows.append([str(number), row.name, row.kind, row.bridge, row.factor, row.resistance, slope, row.unit])
    return _table(head, rows)


def labview_table(listed: GaugeList, report: Report) -> bytes:
    """Tab-separated, one row per channel in NI-DAQmx terms: single gauges as "Quarter Bridge I" strain channels, bridges as
    Bridge (V/V) channels with a linear scale:

        ε_B [m/m] = 4/GF · r [V/V]
    """
    head = ["Name", "Measurement type", "Strain configuration", "Gauge factor", "Nominal gauge resistance [ohm]"]
    head += ["Scale slope", "Scaled unit"]
    rows: list[list[str]] = []
    for row in _rows(listed, report):
        kind, configuration, slope, unit = row.kind, "", "", row.unit
        if row.arms == 1:
            kind, configuration, unit = "Strain", "Quarter Bridge I", "strain"
        elif row.arms:
            slope = f"{4 / report.gauge_factor:.9g}" if report.gauge_factor else ""
            kind, unit = "Bridge (V/V)", "strain"
        rows.append([row.name, kind, configuration, row.factor, row.resistance, slope, unit])
    return _table(head, rows)


def _rows(listed: GaugeList, report: Report) -> list[_Row]:
    rows, channels = [], listed.channels
    wired = ["" if value is None else f"{value:.9g}" for value in (report.gauge_factor, report.resistance)]
    for label, i in zip(channel_labels(listed), channels.gauge.tolist(), strict=True):
        strain, signs = listed.unit[i] == "strain", [listed.signs[line] for line in listed.lines_of(i)]
        bridged = listed.kind[i] == "bridge"
        count = len(signs) if bridged else int(strain)
        bridge = BRIDGES.get(count, f"{count} arms") if count else ""
        if bridged and count == 2:
            bridge = HALVES[signs[0] != signs[1]]
        unit = UNIT.get(listed.unit[i], listed.unit[i])
        rows.append(_Row(label, listed.kind[i], unit, bridge, count, *(wired if count else ("", ""))))
    return rows


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> bytes:
    lines = ["\t".join(" ".join(cell.split()) for cell in row) for row in (head, *rows)]
    return ("\r\n".join(lines) + "\r\n").encode()


ALL = "GAUGES"
FIRST_SET = 9001
"""Number of the Nastran set of all gauges; sets of single gauges follow."""
WIDTH = 72
A_LINE = 16
"""Most numbers in a data line of Abaqus."""
LONGEST = 80


def elements_of(shop: Workshop) -> dict[str, list[int]]:
    """Gauge label → ids of the elements below its grids or arms, ascending; gauges not on facets are omitted."""
    below, grids = {}, shop.listed.grids
    for i, label in enumerate(shop.listed.labels):
        lines = shop.listed.lines_of(i)
        if ids := np.unique(grids.element[lines][grids.facet[lines] > 0]).tolist():
            below[label] = ids
    return below


def nastran_sets(elements: Mapping[str, Sequence[int]], run: str) -> bytes:
    """SET cards for the case control section: all gauges, then each gauge, with a comment."""
    lines = [
        f"$ Run {_ascii(run)}: elements below the gauges.",
        "$ INCLUDE this file in the case control section.",
    ]
    for number, (name, ids) in enumerate(_with_all(elements), start=FIRST_SET):
        lines += [f"$ {_ascii(name)}", *_wrapped(f"SET {number} = ", ids)]
    return ("\n".join(lines) + "\n").encode("ascii")


def abaqus_sets(elements: Mapping[str, Sequence[int]], run: str) -> bytes:
    """*ELSET of all gauges, then GAUGE_name for each gauge; in a deck with parts they belong to the part."""
    lines = [
        f"** Run {_ascii(run)}: elements below the gauges. *INCLUDE this file in the model data after the elements."
    ]
    used: set[str] = set()
    for name, ids in _with_all(elements):
        set_name = name if name == ALL else _set_name(f"GAUGE_{name}", used)
        used.add(set_name.upper())
        lines.append(f"*ELSET, ELSET={set_name}")
        lines += [", ".join(map(str, ids[i : i + A_LINE])) for i in range(0, len(ids), A_LINE)]
    return ("\n".join(lines) + "\n").encode("ascii")


def _with_all(elements: Mapping[str, Sequence[int]]) -> list[tuple[str, list[int]]]:
    every = sorted({i for ids in elements.values() for i in ids})
    return [(ALL, every), *((name, list(ids)) for name, ids in elements.items())]


def _wrapped(head: str, ids: Sequence[int]) -> list[str]:
    """Wrap to lines of at most 72 characters that end with a comma, except the last."""
    lines = [head]
    for i, number in enumerate(ids):
        word = f"{number}{',' if i + 1 < len(ids) else ''}"
        if len(lines[-1]) + len(word) > WIDTH:
            lines.append(" " * 8)
        lines[-1] += word
    return lines


def _set_name(name: str, used: set[str]) -> str:
    """Valid set name (letters, digits, _ and -), unique ignoring case."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:LONGEST]
    free, count = plain, 2
    while free.upper() in used:
        free, count = f"{plain}-{count}", count + 1
    return free


def _ascii(text: str) -> str:
    return " ".join(text.encode("ascii", "replace").decode().split())[:60]

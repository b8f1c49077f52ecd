"""The channels of a layout as tables that are set up by hand in catman and LabVIEW."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from strainsight.experiment.layout.gauge_list import GaugeList, channel_labels

UNIT = {"strain": "um/m"}
"""Unit of an instrument, where it is another than that of the readings."""
BRIDGES = {1: "quarter", 2: "half", 4: "full"}
HALVES = {True: "half, arms 1 and 2", False: "half, arms 1 and 3"}


@dataclass(frozen=True)
class Wiring:
    """What a config says of all strain gauges alike: gauge factor [-] and resistance [ohm], None where it does not."""

    gauge_factor: float | None = None
    resistance: float | None = None


@dataclass(frozen=True)
class _Row:
    """A channel: name; kind of its gauge; unit; bridge, "" of what is no strain; arms."""

    name: str
    kind: str
    unit: str
    bridge: str
    arms: int


def catman_table(listed: GaugeList, wiring: Wiring) -> bytes:
    """A row a channel, cells apart by tabs: number, name, sensor, bridge, gauge factor, resistance, µm/m a mV/V, unit.

    ε [µm/m] = 4000/GF · r [mV/V]     of one gauge, and of a bridge the signed sum ε_B of its arms
    """
    head = ["Channel", "Name", "Sensor", "Bridge", "Gauge factor", "Resistance [ohm]", "um/m per mV/V", "Unit"]
    rows: list[list[str]] = []
    for number, row in enumerate(_rows(listed), start=1):
        factor, resistance = _wired(row, wiring)
        slope = f"{4000 / wiring.gauge_factor:.9g}" if wiring.gauge_factor and row.arms else ""
        rows.append([str(number), row.name, row.kind, row.bridge, factor, resistance, slope, row.unit])
    return _table(head, rows)


def labview_table(listed: GaugeList, wiring: Wiring) -> bytes:
    """A row a channel, cells apart by tabs, in the words of NI-DAQmx: a single gauge is a strain channel, "Quarter Bridge I"; a
    bridge, whose ε_B is the sum of its arms and no strain that NI knows, a Bridge (V/V) channel, with the slope of its scale.

        ε_B [m/m] = 4/GF · r [V/V]
    """
    head = ["Name", "Measurement type", "Strain configuration", "Gauge factor", "Nominal gauge resistance [ohm]"]
    head += ["Scale slope", "Scaled unit"]
    rows: list[list[str]] = []
    for row in _rows(listed):
        factor, resistance = _wired(row, wiring)
        kind, configuration, slope, unit = row.kind, "", "", row.unit
        if row.arms == 1:
            kind, configuration, unit = "Strain", "Quarter Bridge I", "strain"
        elif row.arms:
            slope = f"{4 / wiring.gauge_factor:.9g}" if wiring.gauge_factor else ""
            kind, unit = "Bridge (V/V)", "strain"
        rows.append([row.name, kind, configuration, factor, resistance, slope, unit])
    return _table(head, rows)


def _rows(listed: GaugeList) -> list[_Row]:
    labels = channel_labels(listed)
    rows: list[_Row] = []
    for i, kind in enumerate(listed.kind):
        arms = listed.arms[i]
        strain = listed.unit[i] == "strain"
        count = 0 if not strain else 1 if arms is None else len(arms.sign)
        bridge = BRIDGES.get(count, f"{count} arms") if count else ""
        if arms is not None and count == 2:
            bridge = HALVES[bool(arms.sign[0] * arms.sign[1] < 0)]
        unit = UNIT.get(listed.unit[i], listed.unit[i])
        rows += [_Row(labels[len(rows) + k], kind, unit, bridge, count) for k in range(len(listed.directions[i]))]
    return rows


def _wired(row: _Row, wiring: Wiring) -> tuple[str, str]:
    """Gauge factor and resistance, empty of what is no strain or where they are not known."""
    values = (wiring.gauge_factor, wiring.resistance)
    factor, resistance = ("" if value is None or not row.arms else f"{value:.9g}" for value in values)
    return factor, resistance


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> bytes:
    lines = ["\t".join(" ".join(cell.split()) for cell in row) for row in (head, *rows)]
    return ("\r\n".join(lines) + "\r\n").encode()

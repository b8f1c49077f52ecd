"""The gauges of a layout for people: a table, a CSV file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.cases.layout.names import layout_labels
from strainsight.gauges.candidates import ACCELERATION, STRAIN, UNITS, Candidates
from strainsight.workflow.output import Table


@dataclass(frozen=True)
class GaugeList:
    """The gauges of a layout, k of them in its order.

    labels as of `layout_labels`; kind: in words; unit of its readings; element, facet ids, of given gauges their number and
    0; position, normal (k, 3); directions: of each (c, 3) of all its channels; angles: of each (c,) [deg]; length (k,) [m] of
    its grid; bonded (k,); family: "gauges", or the name among the motion sensors; peak (k,): largest training reading, peaks:
    that of each channel; range (k,): what it can measure, NaN where not stated.
    """

    labels: tuple[str, ...]
    kind: tuple[str, ...]
    unit: tuple[str, ...]
    element: np.ndarray
    facet: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    directions: tuple[np.ndarray, ...]
    angles: tuple[np.ndarray, ...]
    length: np.ndarray
    bonded: np.ndarray
    family: tuple[str, ...]
    peak: np.ndarray
    peaks: tuple[np.ndarray, ...]
    range: np.ndarray


def gauge_list(
    candidates: Candidates,
    names: Sequence[str],
    gauges: np.ndarray,
    families: Sequence[str],
    peak: np.ndarray,
    limit: np.ndarray,
) -> GaugeList:
    """Gauges (k,) by their numbers, as a layout lists them.

    names: of every candidate gauge, empty where it has none; families: names of the arrays of the candidates; peak (m,): largest
    reading of every channel; limit (m,): what it can measure, infinite where that is not stated.
    """
    own = [candidates.channels(gauges[i : i + 1]) for i in range(len(gauges))]
    first = candidates.first[gauges]
    stated = np.array([limit[c].min() for c in own])
    return GaugeList(
        labels=layout_labels(names, gauges),
        kind=tuple(_kind(int(candidates.quantity[c[0]]), len(c)) for c in own),
        unit=tuple(UNITS[int(candidates.quantity[c])] for c in first),
        element=candidates.element[first],
        facet=candidates.facet[first],
        position=candidates.position[first],
        normal=candidates.normal[first],
        directions=tuple(candidates.direction[c] for c in own),
        angles=tuple(candidates.angle[c] for c in own),
        length=candidates.length[first],
        bonded=candidates.bonded[first],
        family=tuple(families[int(candidates.array[c])] for c in first),
        peak=np.array([peak[c].max() for c in own]),
        peaks=tuple(peak[c] for c in own),
        range=np.where(np.isfinite(stated), stated, np.nan),
    )


def channel_labels(listed: GaugeList) -> tuple[str, ...]:
    """A label for every channel: that of its gauge, with the angle or axis where it has several."""
    said = []
    for label, kind, angles, directions in zip(
        listed.labels, listed.kind, listed.angles, listed.directions, strict=True
    ):
        if len(angles) == 1:
            said.append(label)
        elif kind == "rosette":
            said += [f"{label} {angle:g}°" for angle in angles]
        else:
            said += [f"{label} axis {i + 1}" for i in range(len(directions))]
    return tuple(said)


def _kind(quantity: int, channels: int) -> str:
    if quantity == STRAIN:
        return "strain gauge" if channels == 1 else "rosette"
    return "accelerometer" if quantity == ACCELERATION else "displacement sensor"


def gauge_table(listed: GaugeList, without: Mapping[str, np.ndarray], relative: bool) -> Table:
    """Where every gauge goes, and what each unknown would be known to without it."""
    kinds, given = listed.bonded.any() or set(listed.kind) != {"strain gauge"}, not listed.facet.any()
    rows = tuple(
        (
            listed.labels[i],
            *([listed.kind[i] + ", bonded" * bool(listed.bonded[i])] if kinds else []),
            *([] if given else [str(listed.element[i]), str(listed.facet[i])]),
            " ".join(f"{x:.4f}" for x in listed.position[i]),
            " ".join(f"{round(x, 3) + 0.0:g}" for x in listed.directions[i][0]),
            " ".join(f"{angle:g}°" for angle in listed.angles[i])
            if listed.kind[i] in ("strain gauge", "rosette")
            else "",
            *(f"{100 * v[i]:.3g} %" if relative else f"{v[i]:.4g}" for v in without.values()),
        )
        for i in range(len(listed.labels))
    )
    columns = (
        "gauge",
        *(["kind"] if kinds else []),
        *([] if given else ["element", "facet"]),
        "x y z [m]",
        "direction",
        "angle",
        *(f"σ({name}) without it" for name in without),
    )
    return Table("gauges", columns, rows)


def gauge_csv(listed: GaugeList, without: Mapping[str, np.ndarray]) -> bytes:
    """The layout for whoever bonds it: a line a channel, lengths in m, σ of every unknown without the gauge relative to its
    scale, the largest training reading in the unit of the channel."""
    axes = [f"{vector}_{axis}" for vector in ("position", "normal", "direction") for axis in "xyz"]
    head = ["gauge", "kind", "sensors", "glued", "element", "facet", *axes, "angle_deg", "grid_length", "peak", "unit"]
    lines = [",".join([*head, *(f"std_{name}_without" for name in without)])]
    for i, label in enumerate(listed.labels):
        for direction, angle, peak in zip(listed.directions[i], listed.angles[i], listed.peaks[i], strict=True):
            vectors = np.round([*listed.position[i], *listed.normal[i], *direction], 12) + 0.0
            numbers = [*vectors, angle, listed.length[i], peak]
            bonded = "yes" if listed.bonded[i] else "no"
            words = [label, listed.kind[i], listed.family[i], bonded, str(listed.element[i]), str(listed.facet[i])]
            missing = [f"{values[i]:.9g}" for values in without.values()]
            lines.append(",".join([*words, *(f"{x:.9g}" for x in numbers), listed.unit[i], *missing]))
    return ("\n".join(lines) + "\n").encode()

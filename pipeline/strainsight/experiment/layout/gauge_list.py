"""The gauges of a layout for people: a list, a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.experiment.layout.names import layout_labels
from strainsight.runner.output import Table
from strainsight.sensors.candidates import ACCELERATION, STRAIN, UNITS, Candidates


@dataclass(frozen=True)
class BridgeArms:
    """All arms of one bridge, the first of which has its place: grid, a of them, and their signs (a,)."""

    grid: Candidates
    sign: np.ndarray

    def labels(self, label: str) -> list[str]:
        """Of each of them, by that of the bridge."""
        return [f"{label} arm {k + 1}" for k in range(len(self.sign))]


@dataclass(frozen=True)
class GaugeList:
    """The gauges of a layout, k of them in its order.

    labels as of `layout_labels`; kind: in words; unit of its readings; element, facet ids, of given gauges their number and
    0; position, normal (k, 3); directions: of each (c, 3) of all its channels; angles: of each (c,) [deg]; length (k,) [m] of
    its grid; bonded (k,); family: "gauges", or the name among the motion sensors; peak (k,): largest training reading, peaks:
    that of each channel; most (k,): that of any grid, of a bridge of any arm; range (k,): what a grid can measure, NaN where not
    stated; arms of each that is a bridge, else None; notes: what is to be looked at of each where it is bonded, empty where there
    is nothing, and without any where that was not asked.
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
    most: np.ndarray
    range: np.ndarray
    arms: tuple[BridgeArms | None, ...]
    notes: tuple[str, ...] = ()


def gauge_list(
    candidates: Candidates,
    names: Sequence[str],
    gauges: np.ndarray,
    families: Sequence[str],
    peak: np.ndarray,
    limit: np.ndarray,
    most: np.ndarray | None = None,
) -> GaugeList:
    """Gauges (k,) by their numbers, as a layout lists them.

    names: of every candidate gauge, empty where it has none; families: names of the arrays of the candidates; peak (m,): largest
    reading of every channel; limit (m,): what it can measure, infinite where that is not stated; most (m,): largest reading of
    any of its grids, None: `peak`.
    """
    own = [candidates.channels(gauges[i : i + 1]) for i in range(len(gauges))]
    first = candidates.first[gauges]
    stated = np.array([limit[c].min() for c in own])
    return GaugeList(
        labels=layout_labels(names, gauges),
        kind=tuple(_kind(int(candidates.quantity[c[0]]), len(c), bool(candidates.bridged[c[0]])) for c in own),
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
        most=np.array([(peak if most is None else most)[c].max() for c in own]),
        range=np.where(np.isfinite(stated), stated, np.nan),
        arms=tuple(_arms(candidates.take(c)) for c in own),
    )


def _arms(own: Candidates) -> BridgeArms | None:
    return None if own.arms is None else BridgeArms(own.grids, own.sign_of_grid)


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


def _kind(quantity: int, channels: int, bridge: bool) -> str:
    if bridge:
        return "bridge"
    if quantity == STRAIN:
        return "strain gauge" if channels == 1 else "rosette"
    return "accelerometer" if quantity == ACCELERATION else "displacement sensor"


def gauge_table(listed: GaugeList, without: Mapping[str, np.ndarray], relative: bool) -> Table:
    """Where every gauge goes, and what each unknown would be known to without it."""
    kinds, given = listed.bonded.any() or set(listed.kind) != {"strain gauge"}, not listed.facet.any()

    def place(position: np.ndarray, direction: np.ndarray) -> tuple[str, str]:
        return " ".join(f"{x:.4f}" for x in position), " ".join(f"{round(x, 3) + 0.0:g}" for x in direction)

    rows: list[tuple[str, ...]] = []
    for i in range(len(listed.labels)):
        rows.append(
            (
                listed.labels[i],
                *([listed.kind[i] + ", bonded" * bool(listed.bonded[i])] if kinds else []),
                *([] if given else [str(listed.element[i]), str(listed.facet[i])]),
                *place(listed.position[i], listed.directions[i][0]),
                " ".join(f"{angle:g}°" for angle in listed.angles[i])
                if listed.kind[i] in ("strain gauge", "rosette", "bridge")
                else "",
                *(f"{100 * v[i]:.3g} %" if relative else f"{v[i]:.4g}" for v in without.values()),
            )
        )
        if (arms := listed.arms[i]) is None:
            continue
        rows += [
            (
                "",
                f"arm {k + 1}, {'+' if arms.sign[k] > 0 else '−'}",
                str(arms.grid.element[k]),
                str(arms.grid.facet[k]),
                *place(arms.grid.position[k], arms.grid.direction[k]),
                f"{arms.grid.angle[k]:g}°",
                *[""] * len(without),
            )
            for k in range(1, len(arms.sign))
        ]
    columns = (
        "gauge",
        *(["kind"] if kinds else []),
        *([] if given else ["element", "facet"]),
        "x y z [m]",
        "direction",
        "angle",
        *(f"σ({name}) without it" for name in without),
    )
    return Table("gauges", columns, tuple(rows))


def marked_places(listed: GaugeList) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Position, first direction and normal (p, 3) of every gauge, of a bridge those of its arms, and a label for each."""
    rows: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    labels: list[str] = []
    for i, label in enumerate(listed.labels):
        arms = listed.arms[i]
        if arms is None:
            rows.append((listed.position[i], listed.directions[i][0], listed.normal[i]))
            labels.append(label)
        else:
            rows += zip(arms.grid.position, arms.grid.direction, arms.grid.normal, strict=True)
            labels += arms.labels(label)
    position, direction, normal = (np.array(column).reshape(-1, 3) for column in zip(*rows, strict=True))
    return position, direction, normal, tuple(labels)

"""The gauges of a layout for people: their names, a list, a table, a line for each channel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TypedDict

import numpy as np

from strainsight.config import layout as stated
from strainsight.config.gauges import AxisDirection, PrincipalDirection, SensorSites
from strainsight.config.placement import Datum
from strainsight.mesh.facets import LOWER, UPPER, Facets, exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.units import length_factor
from strainsight.positions import PositionAxes
from strainsight.runner.output import Table
from strainsight.sensors.candidates import (
    ACCELERATION,
    ROSETTE,
    STRAIN,
    UNITS,
    Candidates,
    candidates,
    principal_angles,
)
from strainsight.sensors.edges import EdgeDimensions, edge_dimensions, facet_keys, no_edges
from strainsight.sensors.rows import channel_rows
from strainsight.sensors.zones import Box, Cylinder, NearEdges, NearSet, NormalCone, On, OnElements, ShellFace, Zone


def layout_labels(names: Sequence[str], gauges: np.ndarray) -> tuple[str, ...]:
    """The name that the config gives a gauge, else G1, G2, … in the order of the layout, without those that it gives.

    names: of every candidate, empty where it has none; gauges (k,): numbers of those of the layout.
    """
    taken = {name for name in names if name}
    free = (label for label in (f"G{i}" for i in count(1)) if label not in taken)
    return tuple(names[gauge] or next(free) for gauge in gauges)


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
    pool: Candidates,
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
    channels = [pool.channels(gauges[i : i + 1]) for i in range(len(gauges))]
    first = pool.first[gauges]
    stated = np.array([limit[c].min() for c in channels])
    return GaugeList(
        labels=layout_labels(names, gauges),
        kind=tuple(_kind(int(pool.quantity[c[0]]), len(c), bool(pool.bridged[c[0]])) for c in channels),
        unit=tuple(UNITS[int(pool.quantity[c])] for c in first),
        element=pool.element[first],
        facet=pool.facet[first],
        position=pool.position[first],
        normal=pool.normal[first],
        directions=tuple(pool.direction[c] for c in channels),
        angles=tuple(pool.angle[c] for c in channels),
        length=pool.length[first],
        bonded=pool.bonded[first],
        family=tuple(families[int(pool.array[c])] for c in first),
        peak=np.array([peak[c].max() for c in channels]),
        peaks=tuple(peak[c] for c in channels),
        most=np.array([(peak if most is None else most)[c].max() for c in channels]),
        range=np.where(np.isfinite(stated), stated, np.nan),
        arms=tuple(_arms(pool.take(c)) for c in channels),
    )


def _arms(gauge: Candidates) -> BridgeArms | None:
    return None if gauge.arms is None else BridgeArms(gauge.grids, gauge.sign_of_grid)


def channel_labels(listed: GaugeList) -> tuple[str, ...]:
    """A label for every channel: that of its gauge, with the angle or axis where it has several."""
    labels = []
    for label, kind, angles, directions in zip(
        listed.labels, listed.kind, listed.angles, listed.directions, strict=True
    ):
        if len(angles) == 1:
            labels.append(label)
        elif kind == "rosette":
            labels += [f"{label} {angle:g}°" for angle in angles]
        else:
            labels += [f"{label} axis {i + 1}" for i in range(len(directions))]
    return tuple(labels)


def _kind(quantity: int, channels: int, bridge: bool) -> str:
    if bridge:
        return "bridge"
    if quantity == STRAIN:
        return "strain gauge" if channels == 1 else "rosette"
    return "accelerometer" if quantity == ACCELERATION else "displacement sensor"


def gauge_table(listed: GaugeList, without: Mapping[str, np.ndarray], relative: bool) -> Table:
    """Where every gauge goes, and what each unknown would be known to without it."""
    kinds, without_surface = listed.bonded.any() or set(listed.kind) != {"strain gauge"}, not listed.facet.any()

    def place(position: np.ndarray, direction: np.ndarray) -> tuple[str, str]:
        return " ".join(f"{x:.4f}" for x in position), " ".join(f"{round(x, 3) + 0.0:g}" for x in direction)

    rows: list[tuple[str, ...]] = []
    for i in range(len(listed.labels)):
        rows.append(
            (
                listed.labels[i],
                *([listed.kind[i] + ", bonded" * bool(listed.bonded[i])] if kinds else []),
                *([] if without_surface else [str(listed.element[i]), str(listed.facet[i])]),
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
        *([] if without_surface else ["element", "facet"]),
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


def measured_columns(frame: PositionAxes) -> list[str]:
    """Heads of what `measured_cells` gives."""
    u = frame.unit
    return [f"x_{u}", f"y_{u}", f"z_{u}", f"edge_{u}", "edge_deg", f"edge2_{u}", "edge2_deg"]


def measured_cells(lines: Sequence[GaugeLine], edges: EdgeDimensions, frame: PositionAxes) -> list[list[str]]:
    """Of every line its place in the frame, and distance and angle to both edges; empty where there is none."""
    rows = []
    for line, distance, angle in zip(lines, frame.length(edges.distance), edges.angle, strict=True):
        pairs = [value for pair in zip(distance, angle, strict=True) for value in pair]
        rows.append([cell(x) for x in (*frame.place(line.position), *pairs)])
    return rows


def cell(value: float) -> str:
    """Nine digits, what is rounding of zero as 0; empty for what is not there."""
    return "" if np.isnan(value) else f"{round(value, 9) + 0.0:.9g}"


def deck_frame(unit: str) -> PositionAxes:
    """The deck's own coordinates, in its unit."""
    return PositionAxes(unit, length_factor(unit), np.zeros(3), np.eye(3))


def frame_of(unit: str, datum: Datum) -> PositionAxes:
    """Right-handed axes at the origin of the datum: x along its x, z along x × y, y = z × x."""
    x = np.array(datum.x) / np.linalg.norm(datum.x)
    z = np.cross(x, datum.y)
    z /= np.linalg.norm(z)
    return PositionAxes(unit, length_factor(unit), np.array(datum.origin), np.array([x, np.cross(z, x), z]))


class Sites(TypedDict):
    """Where sensors may go: a surface, and zones to include and to exclude."""

    surface: str
    include: list[Zone]
    exclude: list[Zone]


def sites_of(config: SensorSites) -> Sites:
    """The sites of a config, as functions of candidates take them."""
    include, exclude = ([zone_of(entry) for entry in zones] for zones in (config.include, config.exclude))
    return Sites(surface=config.surface, include=include, exclude=exclude)


def strain_candidates(
    mesh: Mesh,
    facets: Facets,
    sites: SensorSites,
    direction: AxisDirection | PrincipalDirection,
    basis: np.ndarray,
    moment: Callable[[np.ndarray], np.ndarray],
    key: str,
    rosette: bool = False,
    length: float = 0.0,
) -> Candidates:
    """Strain gauges on the facets that the sites of `key` admit, along an axis or the principal directions of a moment (r, r)
    of the coordinates of the basis (3 nodes, r); moment: of rows (3 f, r) of gauges at 0°, 45° and 90° on the f facets."""
    axis, turn = direction.axis if isinstance(direction, AxisDirection) else None, None
    zoned = partial(candidates, mesh, facets, axis, **sites_of(sites), key=key)
    if axis is None:
        rows = channel_rows(mesh.position, zoned(angles=ROSETTE, rosette=True), basis, facets=facets)
        turn = principal_angles(rows.reshape(-1, len(ROSETTE), basis.shape[1]), moment(rows))
    return zoned(angles=direction.angles, rosette=rosette, length=length, turn=turn)


def zone_of(entry: stated.Zone) -> Zone:
    """A zone of a config."""
    match entry:
        case stated.BoxZone(box=(low, high)):
            return Box(low, high)
        case stated.InCylinder(cylinder=cylinder):
            return Cylinder(cylinder.point, cylinder.axis, cylinder.radius)
        case stated.FacingZone(normal_cone=cone):
            return NormalCone(cone.axis, cone.angle)
        case stated.NearSetZone(near_set=near):
            return NearSet(near.set, near.distance)
        case stated.NearEdgesZone(near_edges=distance):
            return NearEdges(distance)
        case stated.ShellFaceZone(shell_face=face):
            return ShellFace(UPPER if face == "upper" else LOWER)
        case stated.OnElementsZone(on_elements=kind):
            return OnElements(kind)
    return On(entry)

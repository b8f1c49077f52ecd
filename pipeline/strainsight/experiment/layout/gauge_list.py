"""Names, list and tables of the gauges of a layout."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import count
from typing import Any

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
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.zones import Box, Cylinder, NearEdges, NearSet, NormalCone, On, OnElements, ShellFace, Zone


def layout_labels(names: Sequence[str], gauges: np.ndarray) -> tuple[str, ...]:
    """Configured names, else G1, G2, … in the order of the layout, without duplicates.

    names: of every candidate, may be empty; gauges (k,): numbers of the layout."""
    used = {name for name in names if name}
    free = (label for label in (f"G{i}" for i in count(1)) if label not in used)
    return tuple(names[gauge] or next(free) for gauge in gauges)


@dataclass(frozen=True)
class GaugeList:
    """The k gauges of a layout with m channels.

    labels: see `layout_labels`; family: "gauges", or the name of the motion sensors, of each gauge; peaks (m,): largest training
    reading of every channel; strained (m,): of any of its grids; limit (m,): measuring range, infinite if not set; notes: on the
    installation of each gauge, may be empty."""

    labels: tuple[str, ...]
    channels: Candidates
    family: tuple[str, ...]
    peaks: np.ndarray
    strained: np.ndarray
    limit: np.ndarray
    notes: tuple[str, ...] = ()

    @cached_property
    def kind(self) -> tuple[str, ...]:
        """Kind of every gauge, in words."""
        c, (first, count) = self.channels, np.unique(self.channels.gauge, return_index=True, return_counts=True)[1:]
        return tuple(_kind(int(c.quantity[i]), n, bool(c.bridged[i])) for i, n in zip(first, count, strict=True))

    @property
    def unit(self) -> tuple[str, ...]:
        """Unit of the readings of every gauge."""
        return tuple(UNITS[int(quantity)] for quantity in self.channels.quantity[self.channels.first])

    @property
    def bonded(self) -> np.ndarray:
        """Whether each gauge (k,) is already bonded."""
        return self.channels.bonded[self.channels.first]

    @property
    def position(self) -> np.ndarray:
        """Position of every gauge (k, 3) [m]."""
        return self.channels.position[self.channels.first]

    @property
    def peak(self) -> np.ndarray:
        """Largest training reading of every gauge (k,)."""
        return np.asarray(np.maximum.reduceat(self.peaks, self.channels.first))

    @property
    def most(self) -> np.ndarray:
        """Largest training reading of any grid or bridge arm of every gauge (k,)."""
        return np.asarray(np.maximum.reduceat(self.strained, self.channels.first))

    @property
    def range(self) -> np.ndarray:
        """Measuring range of every gauge (k,), NaN if not set."""
        limit = np.minimum.reduceat(self.limit, self.channels.first)
        return np.where(np.isfinite(limit), limit, np.nan)

    @cached_property
    def _order(self) -> np.ndarray:
        return np.argsort(self.channels.channel_of_grid, kind="stable")

    @cached_property
    def grids(self) -> Candidates:
        """All grids of the list, gauge by gauge; the arms of a bridge are separate."""
        return self.channels.grids.take(self._order)

    @property
    def channel(self) -> np.ndarray:
        """Channel of every line (g,)."""
        return self.channels.channel_of_grid[self._order]

    @cached_property
    def gauge(self) -> np.ndarray:
        """Index in the layout of the gauge of every line (g,)."""
        return self.channels.gauge[self.channel]

    @cached_property
    def signs(self) -> tuple[str, ...]:
        """Sign of every line in words, empty unless it is a bridge arm."""
        arm, sign = self.channels.bridged[self.channel], self.channels.sign_of_grid[self._order]
        return tuple(f"{s:g}" * bool(of_bridge) for s, of_bridge in zip(sign, arm, strict=True))

    def lines_of(self, gauge: int) -> np.ndarray:
        """Line indices of a gauge, by its index in the layout."""
        return np.flatnonzero(self.gauge == gauge)

    def places(self) -> list[tuple[str, np.ndarray]]:
        """Name and lines of every bonding place: a gauge with its grids, or a single bridge arm."""
        places = []
        for i, label in enumerate(self.labels):
            lines = self.lines_of(i)
            if self.kind[i] == "bridge":
                places += [(f"{label} arm {k + 1}", lines[k : k + 1]) for k in range(len(lines))]
            else:
                places.append((label, lines))
        return places


def gauge_list(
    pool: Candidates,
    names: Sequence[str],
    gauges: np.ndarray,
    families: Sequence[str],
    peak: np.ndarray,
    limit: np.ndarray,
    strained: np.ndarray | None = None,
) -> GaugeList:
    """Build the list of gauges (k,).

    names: of every candidate gauge, may be empty; families: names of the candidate arrays; peak, strained, limit (m,): of every
    channel, see `GaugeList`; strained None: `peak`."""
    used = pool.channels(gauges)
    channels = pool.take(used)
    return GaugeList(
        layout_labels(names, gauges),
        channels,
        tuple(families[int(array)] for array in channels.array[channels.first]),
        peak[used],
        (peak if strained is None else strained)[used],
        limit[used],
    )


def channel_labels(listed: GaugeList) -> tuple[str, ...]:
    """Label of every channel: gauge label, with angle or axis if it has several channels."""
    labels: list[str] = []
    for i, label in enumerate(listed.labels):
        angles = listed.channels.angle[listed.channels.gauge == i]
        if len(angles) == 1:
            labels.append(label)
        elif listed.kind[i] == "rosette":
            labels += [f"{label} {angle:g}°" for angle in angles]
        else:
            labels += [f"{label} axis {axis + 1}" for axis in range(len(angles))]
    return tuple(labels)


def _kind(quantity: int, channels: int, bridge: bool) -> str:
    if bridge:
        return "bridge"
    if quantity == STRAIN:
        return "strain gauge" if channels == 1 else "rosette"
    return "accelerometer" if quantity == ACCELERATION else "displacement sensor"


def gauge_table(listed: GaugeList, mesh: Mesh, without: Mapping[str, np.ndarray], units: Mapping[str, str]) -> Table:
    """Table of gauge positions [mm] and of σ of each unknown without the gauge; bridge arms have separate lines.

    units: of the unknowns, empty for relative σ."""
    grids, kinds = listed.grids, listed.bonded.any() or set(listed.kind) != {"strain gauge"}
    edge = 1e3 * line_edges(grids, mesh).distance[:, 0]
    edged = bool(np.isfinite(edge).any())
    on_surface, rows = bool(grids.facet.any()), []
    for i, label in enumerate(listed.labels):
        lines, kind = listed.lines_of(i), listed.kind[i] + ", bonded" * bool(listed.bonded[i])
        values = [f"{v[i]:.4g} {units[name]}" if units else f"{100 * v[i]:.3g} %" for name, v in without.items()]
        bridge = listed.kind[i] == "bridge"
        for number, line in enumerate(lines if bridge else lines[:1]):
            if number:
                label, values = "", [""] * len(values)
                kind = f"arm {number + 1}, {'−' if listed.signs[line] == '-1' else '+'}"
            angles = grids.angle[[line] if bridge else lines] if listed.unit[i] == "strain" else grids.angle[:0]
            rows.append(
                (
                    label,
                    *([kind] if kinds else []),
                    *([str(grids.element[line]), str(grids.facet[line])] if on_surface else []),
                    " ".join(f"{round(1e3 * x, 1) + 0.0:.1f}" for x in grids.position[line]),
                    *([f"{edge[line]:.1f}" if np.isfinite(edge[line]) else ""] if edged else []),
                    " ".join(f"{round(x, 3) + 0.0:g}" for x in grids.direction[line]),
                    " ".join(f"{angle:g}°" for angle in angles),
                    *values,
                )
            )
    columns = (
        "gauge",
        *(["kind"] if kinds else []),
        *(["element", "facet"] if on_surface else []),
        "x y z [mm]",
        *(["nearest edge [mm]"] if edged else []),
        *("direction", "angle"),
        *(f"σ({name}) without gauge" for name in without),
    )
    return Table("gauges", columns, tuple(rows), answer=True)


def marked_places(listed: GaugeList) -> tuple[Candidates, tuple[str, ...]]:
    """First grid of every gauge or bridge arm, and its label."""
    places = listed.places()
    return listed.grids.take(np.array([lines[0] for _, lines in places])), tuple(label for label, _ in places)


def line_edges(grids: Candidates, mesh: Mesh) -> EdgeDimensions:
    """Dimensions from every grid to the nearest edges of its face, empty for grids not on facets."""
    if not grids.facet.any():
        return no_edges(len(grids))
    on = facet_keys(grids.element, grids.facet)
    return edge_dimensions(mesh.position, exterior_facets(mesh), on, grids.position, grids.direction, grids.normal)


def measured_columns(frame: PositionAxes) -> list[str]:
    """Column headings of `measured_cells`."""
    u = frame.unit
    return [f"x_{u}", f"y_{u}", f"z_{u}", f"edge_{u}", "edge_deg", f"edge2_{u}", "edge2_deg"]


def measured_cells(grids: Candidates, edges: EdgeDimensions, frame: PositionAxes) -> list[list[str]]:
    """Position in the frame, distance and angle to both edges of every grid; empty without an edge."""
    pairs = np.stack([frame.length(edges.distance), edges.angle], axis=2).reshape(len(grids), -1)
    return [
        [cell(x) for x in (*frame.place(position), *of)] for position, of in zip(grids.position, pairs, strict=True)
    ]


def cell(value: float) -> str:
    """Format with nine digits, rounding errors as 0, NaN as empty."""
    return "" if np.isnan(value) else f"{round(value, 9) + 0.0:.9g}"


def deck_frame(unit: str) -> PositionAxes:
    """Coordinates of the deck, in its unit."""
    return PositionAxes(unit, length_factor(unit), np.zeros(3), np.eye(3))


def frame_of(unit: str, datum: Datum) -> PositionAxes:
    """Right-handed axes of a datum: x along its x, z along x × y, y = z × x."""
    x = np.array(datum.x) / np.linalg.norm(datum.x)
    z = np.cross(x, datum.y)
    z /= np.linalg.norm(z)
    return PositionAxes(unit, length_factor(unit), np.array(datum.origin), np.array([x, np.cross(z, x), z]))


def sites_of(config: SensorSites) -> dict[str, Any]:
    """Surface, and zones to include and exclude, of the sensor sites of a config."""
    include, exclude = ([zone_of(entry) for entry in zones] for zones in (config.include, config.exclude))
    return {"surface": config.surface, "include": include, "exclude": exclude}


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
    """Candidate strain gauges on admissible facets, along an axis or the principal directions.

    basis (3 nodes, r); moment: returns the second moment (r, r) of the coordinates for rows (3 f, r) of 0°/45°/90° gauges on the
    f facets; key: of the sites in the config."""
    axis, turn = direction.axis if isinstance(direction, AxisDirection) else None, None
    zoned = partial(candidates, mesh, facets, axis, **sites_of(sites), key=key)
    if axis is None:
        rows = channel_rows(mesh.position, zoned(angles=ROSETTE, rosette=True), basis, facets=facets)
        turn = principal_angles(rows.reshape(-1, len(ROSETTE), basis.shape[1]), moment(rows))
    return zoned(angles=direction.angles, rosette=rosette, length=length, turn=turn)


def zone_of(entry: stated.Zone) -> Zone:
    """Convert a zone of the config."""
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

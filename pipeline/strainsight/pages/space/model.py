"""Geometry of the interactive 3D view: list of vertices, and triangles, lines and dots between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from strainsight.pages.arrays import FloatArray, IntArray
from strainsight.pages.chart.drawing import VERMILION, gauge_colour
from strainsight.pages.picture import geometry
from strainsight.pages.picture.layout import Gauge, PictureLayout
from strainsight.pages.picture.scene import CLAMP, CREASES, LINES, POOL, STEEL, thinned

LENGTH = 0.034
"""Length of a gauge marker relative to the size of the structure."""
ROUNDING = 1e-9
"""Share of the largest value of a contour below which a value is zero, without a sign."""
LARGEST = 20_000
"""Most triangles: more would enlarge the page without visible benefit."""
MOST_LINES = 30_000
"""Most mesh lines: more would blacken the surface."""
CREASE = 30.0
"""Angle [deg] between facets from which the surface has an edge."""
CORNERS = {3: 3, 4: 4, 6: 3, 8: 4}


@dataclass(frozen=True)
class Contour:
    """Colours of the surface: values (n,) at the layout's points, NaN without a value; scale; least, largest: extremes of the
    facets."""

    values: FloatArray
    scale: geometry.Scale
    least: float
    largest: float


@dataclass(frozen=True)
class ShownState:
    """State of the structure in the view: caption; shift (n, 3) [m] of the layout's points, as displayed, or empty;
    contour or None; group: heading in the selection."""

    caption: str
    shift: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    contour: Contour | None = None
    group: str = "Mode shapes"


@dataclass(frozen=True)
class Drawn:
    """One kind of primitive: index (k, 3), (k, 2) or (k,) of vertices; colour "#rrggbb", "": of the vertices; size of a dot [px];
    group: number of its layout, −1: all; when: "seen" for enlarged gauges, "scale" for gauges at true scale, "plain" without a
    contour, "" always."""

    primitive: Literal["triangles", "lines", "points"]
    index: IntArray
    colour: str = ""
    size: float = 1.0
    group: int = -1
    when: Literal["", "seen", "scale", "plain"] = ""


@dataclass(frozen=True)
class Space:
    """Content of the view.

    position (v, 3) [m]; normal (v, 3), zero for vertices without shading; colour (v, 3) 0 to 255; source (v,): point of the
    structure that a vertex moves with; surface: number of vertices of the surface, which are first; parts: in drawing order;
    anchor: a vertex of every gauge of every layout; eye (3,): direction of the first view; thinned: as in `DrawnSurface`."""

    position: FloatArray
    normal: FloatArray
    colour: NDArray[np.uint8]
    source: IntArray
    surface: int
    parts: tuple[Drawn, ...]
    anchor: tuple[int, ...]
    eye: FloatArray
    thinned: bool


def space(layouts: Sequence[PictureLayout]) -> Space:
    """View of a structure with loads and clamps, and gauges and candidates of one or more layouts.

    Common content is from the first layout."""
    layouts = [thinned(layout) for layout in layouts]
    shared = layouts[0]
    body = surface(shared.points, shared.faces)
    size = shared.size or 1.0
    gathered = _Gathered(shared.points)

    def solid(mesh: Any, colour: str, anchor: FloatArray) -> IntArray:
        shaded = mesh.triangulate().compute_normals(cell_normals=False, split_vertices=True, feature_angle=CREASE)
        first = gathered.add(shaded.points, shaded.point_data["Normals"], colour, gathered.nearest(anchor))
        return np.asarray(shaded.faces.reshape(-1, 4)[:, 1:] + first, dtype=np.int64)

    def marked(gauge: Gauge, meshes: list[Any], colour: str) -> list[IntArray]:
        anchors = [arm.position for arm in gauge.arms] or [gauge.position] * len(meshes)
        return [solid(mesh, colour, at) for mesh, at in zip(meshes, anchors, strict=bool(meshes))]

    def dots(points: FloatArray, colour: str, width: float, group: int = -1) -> list[Drawn]:
        if not len(points):
            return []
        first = gathered.add(points, np.zeros_like(points), colour, gathered.nearest(points))
        when: Literal["", "plain"] = "plain" if colour == POOL else ""
        return [Drawn("points", np.arange(first, first + len(points)), colour, width, group, when)]

    first = gathered.add(body.position, body.normal, STEEL, body.source)
    loads = [solid(geometry.arrow_mesh(load, shared), VERMILION, load.point) for load in shared.loads]
    solids = np.concatenate([body.triangle + first, *loads])
    parts = [Drawn("triangles", solids)] * bool(len(solids))
    parts += [Drawn("lines", body.line, LINES, when="plain")] * bool(len(body.line))
    parts += [Drawn("lines", body.crease, CREASES)] * bool(len(body.crease))
    if len(shared.bars):
        ends = shared.points[shared.bars].reshape(-1, 3)
        first = gathered.add(ends, np.zeros_like(ends), CREASES, gathered.nearest(ends))
        parts.append(Drawn("lines", first + np.arange(len(ends)).reshape(-1, 2), CREASES))
    parts += dots(shared.loose, LINES, 9.0) + dots(shared.fixed, CLAMP, 7.0)
    anchor: list[int] = []
    for group, layout in enumerate(layouts):
        mark, true = [], []
        for i, gauge in enumerate(layout.gauges):
            anchor.append(gathered.count)
            parts_of = marked(gauge, geometry.marker(gauge, LENGTH * size), gauge_colour(i))
            mark += parts_of
            # Sensors without foil look equal at both scales.
            true += marked(gauge, geometry.foil(gauge), gauge_colour(i)) or parts_of
        either = any(gauge.foil[0] for gauge in layout.gauges)
        parts += [Drawn("triangles", np.concatenate(mark), group=group, when="seen" if either else "")] if mark else []
        parts += [Drawn("triangles", np.concatenate(true), group=group, when="scale")] if either else []
        parts += dots(layout.pool, POOL, 5.0, group)
    position, normal = map(np.concatenate, zip(*(layout.places for layout in layouts), strict=True))
    eye = geometry.views(shared.points, geometry.triangles(shared.faces), position, normal)[0]
    return Space(*gathered.arrays(), len(body.position), tuple(parts), tuple(anchor), eye, body.thinned)


def contour_of(values: FloatArray, layout: PictureLayout, quantity: str, unit: str) -> Contour:
    """Colours of values (f,) [unit] on the layout's facets, on a scale without isolated peaks."""
    values = np.where(np.abs(values) > ROUNDING * np.abs(values).max(initial=0.0), values, 0.0)
    shown = geometry.at_points(values, layout.faces, len(layout.points))
    scale = geometry.scale_of(quantity, unit, values, geometry.areas(layout.points, layout.faces))
    return Contour(shown, scale, float(values.min()), float(values.max()))


def vertex_shift(space: Space, shape: ShownState) -> FloatArray:
    """Shift (v, 3) [m] of every vertex, equal to that of its source point."""
    return np.asarray(shape.shift[space.source])


class _Gathered:
    """Vertices of all parts in sequence."""

    def __init__(self, points: FloatArray) -> None:
        from scipy.spatial import cKDTree

        self._tree = cKDTree(points)
        self._parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self.count = 0

    def nearest(self, wanted: FloatArray) -> Any:
        """Indices of the nearest points of the layout."""
        return self._tree.query(wanted)[1]

    def add(self, position: Any, normal: Any, colour: str, source: Any) -> int:
        """Add vertices of one colour; return the index of the first."""
        first, many = self.count, len(position)
        rgb = np.tile(np.frombuffer(bytes.fromhex(colour[1:]), np.uint8), (many, 1))
        self._parts.append((np.asarray(position, float), np.asarray(normal, float), rgb, np.broadcast_to(source, many)))
        self.count += many
        return first

    def arrays(self) -> tuple[FloatArray, FloatArray, NDArray[np.uint8], IntArray]:
        position, normal, colour, source = (np.concatenate(arrays) for arrays in zip(*self._parts, strict=True))
        return position, normal, colour, source.astype(np.int64)


@dataclass(frozen=True)
class DrawnSurface:
    """Displayed surface: position (v, 3) [m], normal (v, 3) unit vectors; triangle (t, 3), line (l, 2), crease (c, 2): vertex
    indices; source (v,): source point of a vertex; thinned: whether triangles were merged."""

    position: FloatArray
    normal: FloatArray
    triangle: IntArray
    line: IntArray
    crease: IntArray
    source: IntArray
    thinned: bool


def surface(points: FloatArray, faces: IntArray, largest: int = LARGEST) -> DrawnSurface:
    """Displayed surface of points (n, 3) [m] and faces (f, 8), padded with −1, with at most about `largest` triangles.

    For more, mid-side nodes are removed, then triangles are merged by quadric errors (Garland and Heckbert, 1997)."""
    triangle = geometry.triangles(faces)
    if not len(triangle):
        nothing, none = np.empty((0, 3)), np.empty((0, 2), dtype=np.int64)
        return DrawnSurface(nothing, nothing, triangle, none, none, np.empty(0, dtype=np.int64), False)
    lines = geometry.mesh_lines(faces)
    if len(triangle) > largest:
        faces = straight(faces)
        triangle, lines = geometry.triangles(faces), geometry.mesh_lines(faces)
    used, local = np.unique(triangle, return_inverse=True)
    body = geometry.surface_mesh(points[used], local.reshape(triangle.shape))
    body.point_data["source"] = used  # source of every point
    thinned = len(triangle) > largest
    if thinned:
        body = body.decimate(1 - largest / len(triangle))
        body.point_data["source"] = _nearest(points[used], used, body.points)
    shaded = body.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=CREASE, consistent_normals=False,
        auto_orient_normals=False,
    )  # fmt: skip
    source = np.asarray(shaded.point_data["source"], dtype=np.int64)
    position = np.asarray(shaded.points, dtype=float)
    if thinned or len(lines) > MOST_LINES:
        lines = np.empty((0, 2), int)
    known, first = np.unique(source, return_index=True)  # the first of several vertices at a point
    edges = body.extract_feature_edges(CREASE, manifold_edges=False, non_manifold_edges=False)
    return DrawnSurface(
        position,
        np.asarray(shaded.point_data["Normals"], dtype=float),
        shaded.faces.reshape(-1, 4)[:, 1:],
        first[np.searchsorted(known, lines)],
        _nearest(position, np.arange(len(position)), edges.points)[edges.lines.reshape(-1, 3)[:, 1:]],
        source,
        thinned,
    )


def straight(faces: IntArray) -> IntArray:
    """Facets (f, 8) without mid-side nodes."""
    corners = np.array([CORNERS.get(k, k) for k in range(9)])[np.sum(faces >= 0, axis=1)]
    return np.where(np.arange(faces.shape[1]) < corners[:, None], faces, -1)


def _nearest(points: FloatArray, numbers: IntArray, wanted: FloatArray) -> IntArray:
    """Number of the nearest point to each wanted point."""
    from scipy.spatial import cKDTree

    if not len(wanted):
        return np.empty(0, dtype=np.int64)
    return np.asarray(numbers[cKDTree(points).query(wanted)[1]], dtype=np.int64)

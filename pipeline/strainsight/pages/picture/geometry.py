"""Geometry of pictures: triangles, mesh lines, view directions, colours and markers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strainsight.pages.arrays import FloatArray, IntArray
from strainsight.pages.chart.drawing import matplotlib
from strainsight.pages.picture.layout import Gauge, LoadArrow, PictureLayout
from strainsight.text import number

# local node triples by number of facet nodes, in VTK order; facets with mid-side nodes are divided at these
TRIANGLES = {
    3: ((0, 1, 2),),
    4: ((0, 1, 2), (0, 2, 3)),
    6: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
    8: ((0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 6), (4, 6, 7)),
}
OUTLINE = {3: (0, 1, 2), 4: (0, 1, 2, 3), 6: (0, 3, 1, 4, 2, 5), 8: (0, 4, 1, 5, 2, 6, 3, 7)}


def triangles(faces: IntArray) -> IntArray:
    """Triangles (t, 3) of facets (f, 8) padded with −1, with the orientation of the facets."""
    count = np.sum(faces >= 0, axis=1)
    parts = [faces[count == k][:, np.array(local)].reshape(-1, 3) for k, local in TRIANGLES.items()]
    return np.concatenate(parts)


def facet_of_triangle(faces: IntArray) -> IntArray:
    """Facet (t,) of each of these triangles."""
    count = np.sum(faces >= 0, axis=1)
    return np.concatenate([np.repeat(np.flatnonzero(count == k), len(local)) for k, local in TRIANGLES.items()])


def areas(points: FloatArray, faces: IntArray) -> FloatArray:
    """Area (f,) [m²] of each facet from its triangles."""
    a, b, c = (points[column] for column in triangles(faces).T)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.asarray(np.bincount(facet_of_triangle(faces), weights=area, minlength=len(faces)), dtype=float)


def mesh_lines(faces: IntArray) -> IntArray:
    """Outlines of the facets (l, 2) through mid-side nodes, each line once."""
    count = np.sum(faces >= 0, axis=1)
    parts = []
    for k, local in OUTLINE.items():
        ring = faces[count == k][:, np.array(local)]
        parts.append(np.stack([ring, np.roll(ring, -1, axis=1)], axis=2).reshape(-1, 2))
    low, high = np.sort(np.concatenate(parts), axis=1).T
    span = int(faces.max(initial=0)) + 1
    return np.column_stack(np.divmod(np.unique(low * span + high), span))


def hit_by_ray(points: FloatArray, triangle: IntArray, origin: FloatArray, direction: FloatArray) -> bool:
    """Whether the ray origin + s·direction, s > 0, intersects any triangle (Möller and Trumbore, 1997)."""
    a, b, c = points[triangle[:, 0]], points[triangle[:, 1]], points[triangle[:, 2]]
    p = np.cross(direction, c - a)
    det = np.einsum("ij,ij->i", b - a, p)
    crossing = np.abs(det) > 1e-14 * np.abs(det).max(initial=1e-300)
    inverse = 1.0 / np.where(crossing, det, 1.0)
    t = origin - a
    u = np.einsum("ij,ij->i", t, p) * inverse
    q = np.cross(t, b - a)
    v = q @ direction * inverse
    s = np.einsum("ij,ij->i", c - a, q) * inverse
    return bool(np.any(crossing & (u >= 0) & (v >= 0) & (u + v <= 1) & (s > 0)))


def seen_from(
    points: FloatArray, triangle: IntArray, position: FloatArray, normal: FloatArray, view: FloatArray
) -> IntArray:
    """Visibility (g,) 0 or 1 of gauges from direction `view` (3,): facing it and not hidden.

    position, normal (g, 3); a zero normal faces every direction."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    visible = (normal @ view > 0.12) | ~np.any(normal, axis=1)
    if not visible.any():
        return visible.astype(int)
    # only triangles whose projection contains the gauge can hide it
    plane = np.linalg.svd(view[None])[2][1:].T
    shadow = points @ plane
    a, b, c = (shadow[triangle[:, k]] for k in range(3))
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    for i in np.flatnonzero(visible):
        origin = position[i] + 1e-4 * size * (normal[i] if np.any(normal[i]) else view)
        near = ((low <= origin @ plane) & (origin @ plane <= high)).all(axis=1)
        visible[i] = not hit_by_ray(points, triangle[near], origin, view)
    return visible.astype(int)


def views(points: FloatArray, triangle: IntArray, position: FloatArray, normal: FloatArray) -> tuple[FloatArray, ...]:
    """One or two view directions: the corner that shows most gauges, and another one for hidden gauges.

    Corners above the structure are preferred."""
    extent = np.ptp(points, axis=0)
    long = int(np.argmax(extent))
    # view slender structures from the side
    weight = np.array([1.0, 1.0, 0.8])
    if extent[long] > 2.5 * np.sort(extent)[1]:
        weight[long] = 0.25
    corners = [np.array([x, y, z]) * weight for z in (1, -1) for x, y in ((1, -1), (-1, -1), (1, 1), (-1, 1))]
    corners = [corner / np.linalg.norm(corner) for corner in corners]
    visible = np.array([seen_from(points, triangle, position, normal, corner) for corner in corners])
    first = int(np.argmax(visible.sum(axis=1)))
    missed = visible[first] == 0
    if not missed.any() or not visible[:, missed].any():
        return (corners[first],)
    return corners[first], corners[int(np.argmax(visible[:, missed].sum(axis=1)))]


def paper_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Right and up (3,) of the view along a normal (3,): z upward, or x to the right if the normal is along z."""
    n = np.asarray(normal, dtype=float)
    if abs(n[2]) > 0.9:
        right = np.array([1.0, 0.0, 0.0]) - n[0] * n
        right /= np.linalg.norm(right)
        return right, np.cross(n, right)
    up = np.array([0.0, 0.0, 1.0]) - n[2] * n
    up /= np.linalg.norm(up)
    return np.cross(up, n), up


def at_points(values: FloatArray, faces: IntArray, points: int) -> FloatArray:
    """Mean value at every point (n,) of the adjacent facets with values (f,); faces (f, 8) padded with −1; NaN without facets."""
    facet, column = np.nonzero(faces >= 0)
    node = faces[facet, column]
    many = np.bincount(node, minlength=points)
    total = np.bincount(node, weights=values[facet], minlength=points)
    return np.where(many > 0, total / np.maximum(many, 1), np.nan)


MAP, DIVERGING = "viridis", "coolwarm"
"""Colour maps for values of one sign, and for values of both signs."""
STEPS = 9
"""Colours of a scale bar."""
TAIL = 0.01
"""Share of the surface that may exceed the scale, so that a peak does not dominate it."""
WORTH = 0.8
"""Share of the largest value above which the scale is extended to it."""


@dataclass(frozen=True)
class Scale:
    """Colour scale: quantity, unit; low, high: values at its ends; name: of the colour map; below, above: whether values exceed
    an end."""

    quantity: str
    unit: str
    low: float
    high: float
    name: str
    below: bool = False
    above: bool = False

    def share(self, values: FloatArray) -> FloatArray:
        """Position of values on the scale, 0 to 1."""
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)


def limits(values: FloatArray) -> tuple[float, float]:
    """Range of the finite values, symmetric about zero if both signs occur."""
    finite = values[np.isfinite(values)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    if low < 0 < high:
        low, high = -max(-low, high), max(-low, high)
    return low, high if high > low else low + 1.0


def scale_of(quantity: str, unit: str, values: FloatArray, area: FloatArray | None = None) -> Scale:
    """Colour scale of values; area (f,) [m²]: of the facets, to exclude peaks."""
    low, high = limits(values)
    whole = Scale(quantity, unit, low, high, DIVERGING if low < 0 < high else MAP)
    if area is None or not np.isfinite(values).any():
        return whole
    known = np.isfinite(values)
    values, area = values[known], area[known]
    # limit the ends to the values on all but TAIL of the area
    order = np.argsort(np.abs(values))
    size, covered = np.abs(values)[order], np.cumsum(area[order])
    end = float(size[np.searchsorted(covered, (1 - TAIL) * covered[-1])])
    low, high = max(low, -end), min(high, end)
    if end > WORTH * size[-1] or not low < high:
        return whole
    return replace(whole, low=low, high=high, below=bool(values.min() < low), above=bool(values.max() > high))


def stops(scale: Scale) -> NDArray[np.uint8]:
    """Equidistant colours (STEPS, 3) from 0 to 255 of the scale, for linear interpolation."""
    share = scale.share(np.linspace(scale.low, scale.high, STEPS))
    rgb = np.asarray(matplotlib().colormaps[scale.name](share), dtype=float)[..., :3]
    return np.round(255 * rgb).astype(np.uint8)


def scale_bar(scale: Scale) -> str:
    """Scale bar with values and alternative text."""
    low, middle, high = (number(value, 3) for value in (scale.low, (scale.low + scale.high) / 2, scale.high))
    low, high = "≤\u00a0" * scale.below + low, "≥\u00a0" * scale.above + high
    ramp = ", ".join(f"#{bytes(rgb.tolist()).hex()}" for rgb in stops(scale))
    label = escape(f"{scale.quantity} from {low} to {high} {scale.unit}")
    return (
        f'<div class="scale" role="img" aria-label="{label}"><p>{escape(scale.quantity)} [{escape(scale.unit)}]</p>'
        f'<i style="background:linear-gradient(to right, {ramp})"></i><p class="ends"><span>{low}</span><span>{middle}</span>'
        f"<span>{high}</span></p></div>"
    )


EMPTY = "#ffffff"
"""Fill colour of bonded gauges."""


def shape(kind: str) -> str:
    """Marker shape of a kind of sensor: "bar", "star", "block" or "cone"."""
    return {"rosette": "star", "accelerometer": "block", "displacement sensor": "cone"}.get(kind, "bar")


def marker(gauge: Gauge, length: float) -> list[Any]:
    """Meshes of one sensor: bars for strain gauges, rosettes and bridge arms, a block with rods for accelerometers, cones for
    displacement sensors; a ball for an unknown direction. length [m]: of a bar."""
    import pyvista as pv

    known = [grid for grid in gauge.grids if gauge.arms or np.any(grid[1])]
    position, _, normal = gauge.grids[0]
    if (form := shape(gauge.kind)) == "block":
        return _block(position, [direction for _, direction, _ in known], normal, 0.42 * length)
    if form == "cone":
        height, cones = 0.8 * length, []
        for at, direction, upward in known or [(position, np.array([0.0, 0.0, 1.0]), normal)]:
            outward = _outward(direction, upward)
            size: dict[str, Any] = {"height": height, "radius": 0.3 * height, "resolution": 24}
            cones.append(pv.Cone(center=at + 0.5 * height * outward, direction=-outward, **size))
        return cones
    if not known:
        return [pv.Sphere(radius=0.25 * length, center=position)]
    width = 0.17 if gauge.arms or len(known) == 1 else 0.06
    return [_bar(*grid, length, width) for grid in known]


def foil(gauge: Gauge) -> list[Any]:
    """Meshes of the carrier of a gauge, or of each bridge arm, at true scale; empty if the size is unknown."""
    long, wide = gauge.foil
    grids = gauge.grids if gauge.arms else gauge.grids[:1]
    return [_bar(*grid, long, 0.5 * wide / long) for grid in grids if long and np.any(grid[1])]


def _bar(position: FloatArray, direction: FloatArray, normal: FloatArray, length: float, width: float) -> Any:
    """Flat bar along a direction, with half width `width` · length, slightly above the surface."""
    import pyvista as pv

    bar = pv.Box(bounds=np.array([-0.5, 0.5, -width, width, -0.02, 0.05]) * length)
    return bar.transform(_frame(position, direction, normal), inplace=False)


def _block(position: FloatArray, directions: list[FloatArray], normal: FloatArray, side: float) -> list[Any]:
    """Cube on the surface with a rod along every measuring direction."""
    import pyvista as pv

    half = 0.5 * side
    frame = _frame(position, directions[0] if directions else np.eye(3)[0], normal)
    centre = position + half * normal
    frame[:3, 3] = centre
    cube = pv.Box(bounds=np.array([-half, half] * 3)).transform(frame, inplace=False)
    rods = [
        pv.Cylinder(center=centre + 0.8 * side * along, direction=along, radius=0.13 * side, height=1.6 * side)
        for along in (_outward(direction, normal) for direction in directions)
    ]
    return [cube, *rods]


def _outward(direction: FloatArray, normal: FloatArray) -> FloatArray:
    """Direction, reversed if it points into the body."""
    return -direction if direction @ normal < 0 else direction


def _frame(position: FloatArray, direction: FloatArray, normal: FloatArray) -> FloatArray:
    """Transformation (4, 4) with axes along the direction, transverse, and along the normal (or z if undefined)."""
    upright = normal - (normal @ direction) * direction
    if np.linalg.norm(upright) < 1e-6:
        upright = np.eye(3)[2 if abs(direction[2]) < 0.9 else 0]
        upright = upright - (upright @ direction) * direction
    upright = upright / np.linalg.norm(upright)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([direction, np.cross(upright, direction), upright])
    frame[:3, 3] = position
    return frame


def arrow(load: LoadArrow, layout: PictureLayout) -> tuple[FloatArray, FloatArray]:
    """Start (3,) and vector (3,) of a load arrow: from the loaded point if it leads out of the body, else to it."""
    low, high = layout.points.min(axis=0), layout.points.max(axis=0)

    def outside(end: FloatArray) -> float:
        return float(np.linalg.norm(end - np.clip(end, low, high)))

    step = 0.14 * float(np.linalg.norm(high - low)) * load.direction / np.linalg.norm(load.direction)
    inward = outside(load.point + step) < outside(load.point - step)
    return (load.point - step if inward else load.point), step


def free_end(load: LoadArrow, layout: PictureLayout) -> FloatArray:
    """Free end (3,) of a load arrow, for its label."""
    start, step = arrow(load, layout)
    return start if start is not load.point else start + step


def arrow_mesh(load: LoadArrow, layout: PictureLayout) -> Any:
    """Mesh of a load arrow."""
    import pyvista as pv

    start, step = arrow(load, layout)
    scale = float(np.linalg.norm(step))
    return pv.Arrow(start=start, direction=step, scale=scale, shaft_radius=0.022, tip_radius=0.065, tip_length=0.28)


def surface_mesh(points: FloatArray, triangle: IntArray) -> Any:
    """Surface mesh of triangles (t, 3) between points (n, 3)."""
    import pyvista as pv

    return pv.PolyData(points, np.column_stack([np.full(len(triangle), 3), triangle]).ravel())


def line_mesh(points: FloatArray, lines: IntArray) -> Any:
    """Lines (l, 2) between points (n, 3)."""
    import pyvista as pv

    wires = pv.PolyData()
    wires.points, wires.lines = points, np.column_stack([np.full(len(lines), 2), lines]).ravel()
    return wires

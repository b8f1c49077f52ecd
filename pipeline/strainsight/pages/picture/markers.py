"""Meshes of pictures. What stands for a sensor or a load: one shape for each kind, hollow where it was bonded already."""

from __future__ import annotations

from typing import Any

import numpy as np

from strainsight.pages.arrays import FloatArray, IntArray
from strainsight.pages.picture.layout import Gauge, Layout, Load

EMPTY = "#ffffff"
"""The ground of what was bonded already: its colour is left to the outline."""


def shape(kind: str) -> str:
    """The shape that stands for a kind of sensor: "bar", "star", "block" or "cone"."""
    return {"rosette": "star", "accelerometer": "block", "displacement sensor": "cone"}.get(kind, "bar")


def marker(gauge: Gauge, length: float) -> list[Any]:
    """Meshes of one sensor: bars along what a strain gauge, a rosette or each arm of a bridge reads, a block with rods along
    what an accelerometer reads, cones whose tip touches the point that a displacement sensor reads.

    length [m] of a bar. A direction of zero is unknown: then a ball stands for a strain gauge.
    """
    if gauge.arms:
        return [_bar(arm.position, arm.direction, arm.normal, length, 0.17) for arm in gauge.arms]
    known = [direction for direction in gauge.channels if np.any(direction)]
    position, normal = np.asarray(gauge.position, dtype=float), np.asarray(gauge.normal, dtype=float)
    if (form := shape(gauge.kind)) == "block":
        return _block(position, known, normal, 0.42 * length)
    if form == "cone":
        return [_cone(position, direction, normal, 0.8 * length) for direction in known or [np.array([0.0, 0.0, 1.0])]]
    if not known:
        import pyvista as pv

        return [pv.Sphere(radius=0.25 * length, center=position)]
    width = 0.17 if len(known) == 1 else 0.06
    return [_bar(position, direction, normal, length, width) for direction in known]


def foil(gauge: Gauge) -> list[Any]:
    """Meshes of the foil of a gauge as large as it is, of a bridge that of each arm; none where its size is not known."""
    long, wide = gauge.foil
    if not long:
        return []
    places = [(arm.position, arm.direction, arm.normal) for arm in gauge.arms] or [
        (
            np.asarray(gauge.position, dtype=float),
            np.asarray(gauge.direction, dtype=float),
            np.asarray(gauge.normal, float),
        )
    ]
    return [_bar(*place, long, 0.5 * wide / long) for place in places if np.any(place[1])]


def _bar(position: FloatArray, direction: FloatArray, normal: FloatArray, length: float, width: float) -> Any:
    """A flat bar of this length along a direction, `width` of it to either side, just proud of the surface."""
    import pyvista as pv

    bar = pv.Box(bounds=np.array([-0.5, 0.5, -width, width, -0.02, 0.05]) * length)
    return bar.transform(_frame(position, direction, normal), inplace=False)


def _block(position: FloatArray, directions: list[FloatArray], normal: FloatArray, side: float) -> list[Any]:
    """A cube that sits on the surface, and a rod out of it along every direction that it reads."""
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


def _cone(position: FloatArray, direction: FloatArray, normal: FloatArray, height: float) -> Any:
    """A cone that points from outside at what is read, along the direction."""
    import pyvista as pv

    outward = _outward(direction, normal)
    return pv.Cone(
        center=position + 0.5 * height * outward, direction=-outward, height=height, radius=0.3 * height, resolution=24
    )


def _outward(direction: FloatArray, normal: FloatArray) -> FloatArray:
    """The direction, turned round where it leads into the body."""
    return -direction if direction @ normal < 0 else direction


def _frame(position: FloatArray, direction: FloatArray, normal: FloatArray) -> FloatArray:
    """Axes along the direction, across it and upright, at the position (4, 4).

    Without a normal, or with one along the direction, upright is as near to z as it can be.
    """
    upright = normal - (normal @ direction) * direction
    if np.linalg.norm(upright) < 1e-6:
        upright = np.eye(3)[2 if abs(direction[2]) < 0.9 else 0]
        upright = upright - (upright @ direction) * direction
    upright = upright / np.linalg.norm(upright)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack([direction, np.cross(upright, direction), upright])
    frame[:3, 3] = position
    return frame


def arrow(load: Load, layout: Layout) -> tuple[FloatArray, FloatArray]:
    """Start (3,) and step (3,) of a load's arrow: from the loaded point if that leads out of the body, else to it."""
    low, high = layout.points.min(axis=0), layout.points.max(axis=0)

    def outside(end: FloatArray) -> float:
        return float(np.linalg.norm(end - np.clip(end, low, high)))

    step = 0.14 * float(np.linalg.norm(high - low)) * load.direction / np.linalg.norm(load.direction)
    inward = outside(load.point + step) < outside(load.point - step)
    return (load.point - step if inward else load.point), step


def free_end(load: Load, layout: Layout) -> FloatArray:
    """The end (3,) of a load's arrow that is not the loaded point: where its name goes."""
    start, step = arrow(load, layout)
    return start if start is not load.point else start + step


def arrow_mesh(load: Load, layout: Layout) -> Any:
    """The arrow of a load."""
    import pyvista as pv

    start, step = arrow(load, layout)
    scale = float(np.linalg.norm(step))
    return pv.Arrow(start=start, direction=step, scale=scale, shaft_radius=0.022, tip_radius=0.065, tip_length=0.28)


def surface_mesh(points: FloatArray, triangle: IntArray) -> Any:
    """Triangles (t, 3) between points (n, 3)."""
    import pyvista as pv

    return pv.PolyData(points, np.column_stack([np.full(len(triangle), 3), triangle]).ravel())


def line_mesh(points: FloatArray, lines: IntArray) -> Any:
    """Lines (l, 2) between points (n, 3)."""
    import pyvista as pv

    wires = pv.PolyData()
    wires.points, wires.lines = points, np.column_stack([np.full(len(lines), 2), lines]).ravel()
    return wires

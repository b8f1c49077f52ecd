"""The structure and the sensors on it as pages show them, and the axes and unit of their positions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from strainsight.pages.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class PositionAxes:
    """x' = R (x/L − o): unit of length by name, L [m] of one; origin o (3,) [unit]; axes R (3, 3), rows x, y, z, unit vectors."""

    unit: str
    metres: float
    origin: FloatArray
    axes: FloatArray

    def place(self, x: FloatArray) -> FloatArray:
        """Points (..., 3) [m] → [unit]."""
        return np.asarray((np.asarray(x, dtype=float) / self.metres - self.origin) @ self.axes.T)

    def turn(self, d: FloatArray) -> FloatArray:
        """Directions (..., 3)."""
        return np.asarray(np.asarray(d, dtype=float) @ self.axes.T)

    def length(self, size: FloatArray | float) -> FloatArray:
        """Lengths [m] → [unit]."""
        return np.asarray(np.asarray(size, dtype=float) / self.metres)

    @property
    def heads(self) -> tuple[str, str, str]:
        """Heads of the columns of a place."""
        return f"x [{self.unit}]", f"y [{self.unit}]", f"z [{self.unit}]"

    @property
    def of_the_deck(self) -> bool:
        """Whether its axes are the deck's own."""
        return not self.origin.any() and np.array_equal(self.axes, np.eye(3))

    def in_words(self) -> str:
        """Where it is, in the deck's coordinates."""
        if self.of_the_deck:
            return "the deck's coordinates"
        origin, x, y = (" ".join(f"{round(v, 6) + 0.0:g}" for v in row) for row in (self.origin, *self.axes[:2]))
        return f"the datum at ({origin}) {self.unit} of the deck, x along ({x}), y along ({y})"


METRES = PositionAxes("m", 1.0, np.zeros(3), np.eye(3))
"""The deck's coordinates in metres."""


@dataclass(frozen=True)
class Arm:
    """One arm of a bridge: position (3,) [m], direction and normal (3,) unit, sign 1 or −1 of its strain, element and facet."""

    position: FloatArray
    direction: FloatArray
    normal: FloatArray
    sign: int
    element: int
    facet: int


@dataclass(frozen=True)
class Gauge:
    """One gauge of the chosen set.

    label ("G1"); element, facet ids of the file, of a given gauge its number and 0;
    position (3,) [m]; direction, normal (3,) unit vectors;
    angle [deg] from the projected axis; nodes: ids of the facet's nodes;
    without: unknown's name → relative standard deviation expected when this gauge is left out (inf: not observable);
    kind ("strain gauge", "rosette", "bridge", "accelerometer", "displacement sensor"); directions (c, 3) of all its channels, the
    first is `direction`; bonded: it was there already; peak: largest training reading of its channels [unit]; most: of
    a bridge that of any arm, None of others; range: what it, or an arm, can measure [unit], None where not stated; unit of its
    readings;
    mirror: label of its mirror image, where the two were placed as one; refined, spread: change of its strain over its RMS
    when the mesh around it is refined, when forces on nodes there are spread, None where not tested; hot: beyond its share;
    arms: of a bridge all of them, the first of which is where the rest of this says; none of others; edges (1 or arms, 2, 2): of
    its place, or that of every arm, distance [m] and angle [deg] to the nearest edge of the face and to the nearest across it,
    NaN where there is none, empty where not measured; notes: what is to be looked at where it is bonded, "; " between them;
    foil: length along its direction and width of what is bonded [m], zero where not known or not bonded.
    """

    label: str
    element: int
    facet: int
    position: FloatArray
    direction: FloatArray
    normal: FloatArray
    angle: float
    without: Mapping[str, float] = field(default_factory=dict)
    nodes: tuple[int, ...] = ()
    kind: str = "strain gauge"
    directions: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    bonded: bool = False
    peak: float | None = None
    most: float | None = None
    range: float | None = None
    unit: str = "strain"
    mirror: str = ""
    refined: float | None = None
    spread: float | None = None
    hot: bool = False
    arms: tuple[Arm, ...] = ()
    edges: FloatArray = field(default_factory=lambda: np.empty((0, 2, 2)))
    notes: str = ""
    foil: tuple[float, float] = (0.0, 0.0)

    @property
    def grids(self) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
        """Position, direction and normal of all that it reads: of every arm of a bridge, else of every channel at its place."""
        if self.arms:
            return [(arm.position, arm.direction, arm.normal) for arm in self.arms]
        position, normal = np.asarray(self.position, dtype=float), np.asarray(self.normal, dtype=float)
        return [(position, direction, normal) for direction in self.channels]

    @property
    def channels(self) -> FloatArray:
        """Directions of all that it reads (c, 3), one where no more are stated."""
        return self.directions if len(self.directions) else np.asarray(self.direction, dtype=float).reshape(1, 3)


@dataclass(frozen=True)
class LoadArrow:
    """A point load to draw: name, point (3,) [m], direction (3,), and whether its history is known to the filter."""

    name: str
    point: FloatArray
    direction: FloatArray
    known: bool = True


@dataclass(frozen=True)
class PictureLayout:
    """The structure and what sits on it.

    points (n, 3) [m]; faces (f, 8) indices into points, padded with −1: exterior facets tri3, quad4, tri6 or quad8
    (by 3, 4, 6 or 8 valid entries), VTK order, outward; pool (m, 3) [m] the candidates that the
    gauges were chosen from; fixed (k, 3) [m] clamped nodes; loose (l, 3) [m] nodes of a structure that is no solid; bars (b, 2)
    points at the ends of what has no facets, rods and pinned beams; frame: how places are given to people.
    """

    points: FloatArray
    faces: IntArray
    pool: FloatArray
    gauges: tuple[Gauge, ...]
    loads: tuple[LoadArrow, ...] = ()
    fixed: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    loose: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    bars: IntArray = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    frame: PositionAxes = METRES

    @property
    def size(self) -> float:
        """The diagonal of the box around the structure [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def places(self) -> tuple[FloatArray, FloatArray]:
        """Positions and normals (g, 3) of all gauges."""
        position = np.array([gauge.position for gauge in self.gauges], dtype=float).reshape(-1, 3)
        return position, np.array([gauge.normal for gauge in self.gauges], dtype=float).reshape(-1, 3)

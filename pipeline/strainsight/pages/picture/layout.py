"""Structure and sensors for pictures and pages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from strainsight.pages.arrays import FloatArray, IntArray
from strainsight.positions import METRES, PositionAxes


@dataclass(frozen=True)
class Arm:
    """One bridge arm: position (3,) [m], direction and normal (3,) unit vectors, sign 1 or −1, element and facet."""

    position: FloatArray
    direction: FloatArray
    normal: FloatArray
    sign: int
    element: int
    facet: int


@dataclass(frozen=True)
class Gauge:
    """One gauge of the layout.

    label ("G1"); element, facet: ids of the file, for imported gauges number and 0; position (3,) [m]; direction, normal (3,):
    unit vectors; angle [deg]: from the projected axis; nodes: ids of the facet's nodes;
    without: unknown → expected relative σ without this gauge (inf: unobservable); kind: "strain gauge", "rosette", "bridge",
    "accelerometer" or "displacement sensor"; directions (c, 3): of all channels, the first is `direction`; bonded: already
    bonded; peak: largest training reading [unit]; most: largest of any bridge arm, else None; range: measuring range [unit],
    None if not set; unit: of its readings; mirror: label of its mirror image in a mirrored pair;
    refined, spread: relative change of its strain with a refined mesh, and with distributed nodal forces, None if not tested;
    hot: whether it is a hot spot; arms: of a bridge, the first at `position`; edges (1 or arms, 2, 2): distance [m] and angle
    [deg] to the nearest edge and to the nearest transverse edge, NaN without an edge, empty if not measured; notes: on
    installation, separated by "; "; foil: length and width of the carrier [m], zero if unknown."""

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
        """Position, direction and normal of every bridge arm, else of every channel."""
        if self.arms:
            return [(arm.position, arm.direction, arm.normal) for arm in self.arms]
        position, normal = np.asarray(self.position, dtype=float), np.asarray(self.normal, dtype=float)
        return [(position, direction, normal) for direction in self.channels]

    @property
    def channels(self) -> FloatArray:
        """Directions of all channels (c, 3)."""
        return self.directions if len(self.directions) else np.asarray(self.direction, dtype=float).reshape(1, 3)


@dataclass(frozen=True)
class LoadArrow:
    """A load arrow: name, point (3,) [m], direction (3,), and whether the load is known."""

    name: str
    point: FloatArray
    direction: FloatArray
    known: bool = True


@dataclass(frozen=True)
class PictureLayout:
    """Structure with gauges and loads.

    points (n, 3) [m]; faces (f, 8): indices into points, padded with −1: exterior facets tri3, quad4, tri6 or quad8 by number of
    valid entries, VTK order, outward; pool (m, 3) [m]: candidates; fixed (k, 3) [m]: supported nodes; loose (l, 3) [m]: nodes
    without solids; bars (b, 2): end points of rods and pinned beams; frame: coordinate axes for positions."""

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
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def places(self) -> tuple[FloatArray, FloatArray]:
        """Positions and normals (g, 3) of all gauges."""
        position = np.array([gauge.position for gauge in self.gauges], dtype=float).reshape(-1, 3)
        return position, np.array([gauge.normal for gauge in self.gauges], dtype=float).reshape(-1, 3)

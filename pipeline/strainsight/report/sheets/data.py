"""What a drawing sheet shows of one gauge; lengths and axes are those of the datum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.datum import Frame


@dataclass(frozen=True)
class Projection:
    """A view of the part: right and up (3,) unit vectors of the paper; seen, hidden (s, 2, 3) segments [unit]."""

    right: FloatArray
    up: FloatArray
    seen: FloatArray
    hidden: FloatArray

    def flat(self, x: FloatArray) -> FloatArray:
        """Points (..., 3) → (..., 2) on the paper, not yet to scale."""
        return np.asarray(np.asarray(x) @ np.array([self.right, self.up]).T)


@dataclass(frozen=True)
class Sheet:
    """One gauge, or one arm of a bridge.

    name ("G1", "G3 arm 2"); kind; run; deck: name of its file; layout: what tells this layout from another; frame: the datum;
    position, normal (3,); directions (c, 3) of its grids; strain: whether it is bonded on; grid [unit], 0: not stated; grid_width
    [unit], 0: not known; carrier: length and width of the foil [unit]; carrier_of: type of gauge that it is of, or "assumed";
    distance (2,), angle (2,) [deg], foot (2, 3), along (2, 3) of the edges, NaN where there is none; element and facet, 0: on
    none; front: seen along the normal from outside; side: seen across, with the normal upward.
    """

    name: str
    kind: str
    run: str
    deck: str
    layout: str
    frame: Frame
    position: FloatArray
    normal: FloatArray
    directions: FloatArray
    strain: bool
    grid: float
    grid_width: float
    carrier: tuple[float, float]
    carrier_of: str
    distance: FloatArray
    angle: FloatArray
    foot: FloatArray
    along: FloatArray
    element: int
    facet: int
    front: Projection
    side: Projection


def paper_axes(normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Right and up (3,) of the view along a normal (3,): z upward; of a surface that faces along z x to the right."""
    n = np.asarray(normal, dtype=float)
    if abs(n[2]) > 0.9:
        right = np.array([1.0, 0.0, 0.0]) - n[0] * n
        right /= np.linalg.norm(right)
        return right, np.cross(n, right)
    up = np.array([0.0, 0.0, 1.0]) - n[2] * n
    up /= np.linalg.norm(up)
    return np.cross(up, n), up

"""Frames of reference by the deck's unit of length and what a config says of its datum."""

from __future__ import annotations

import numpy as np

from strainsight.config.placement import Datum
from strainsight.mesh.units import length_factor
from strainsight.pages.datum import Frame


def deck_frame(unit: str) -> Frame:
    """The deck's own coordinates, in its unit."""
    return Frame(unit, length_factor(unit), np.zeros(3), np.eye(3))


def frame_of(unit: str, datum: Datum) -> Frame:
    """Right-handed axes at the origin of the datum: x along its x, z along x × y, y = z × x."""
    x = np.array(datum.x) / np.linalg.norm(datum.x)
    z = np.cross(x, datum.y)
    z /= np.linalg.norm(z)
    return Frame(unit, length_factor(unit), np.array(datum.origin), np.array([x, np.cross(z, x), z]))

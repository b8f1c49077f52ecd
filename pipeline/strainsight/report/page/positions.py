"""Positions in tables and texts."""

from __future__ import annotations

import math

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.datum import METRES, Frame
from strainsight.report.page.markup import data

AXES = METRES.heads


def decimals(points: FloatArray, frame: Frame = METRES) -> int:
    """Decimals that show a position in the frame's unit to about a ten-thousandth of the structure's size; points (n, 3) [m]."""
    size = float(np.linalg.norm(np.ptp(points, axis=0))) / frame.metres
    return min(max(4 - math.floor(math.log10(size)), 0), 9) if size > 0 else 4


def coordinates(position: FloatArray, places: int) -> str:
    """Coordinates with that many decimals."""
    return " ".join(f"{round(float(value), places) + 0.0:.{places}f}".replace("-", "−") for value in position)


def axes(position: FloatArray, places: int, frame: Frame = METRES) -> list[str]:
    """x, y and z of a position (3,) [m] as cells in the frame, with that many decimals."""
    own = frame.place(position)
    return [data(float(value), coordinates(own[i : i + 1], places)) for i, value in enumerate(own)]

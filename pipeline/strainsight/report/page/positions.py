"""Positions in tables and texts."""

from __future__ import annotations

import math

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.page.markup import data

AXES = ("x [m]", "y [m]", "z [m]")


def decimals(points: FloatArray) -> int:
    """Decimals that show a position to about a ten-thousandth of the structure's size."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    return min(max(4 - math.floor(math.log10(size)), 0), 9) if size > 0 else 4


def coordinates(position: FloatArray, places: int) -> str:
    """Position (3,) [m] with that many decimals."""
    return " ".join(f"{round(float(value), places) + 0.0:.{places}f}".replace("-", "−") for value in position)


def axes(position: FloatArray, places: int) -> list[str]:
    """x, y and z (3,) [m] as cells, with that many decimals."""
    return [data(float(value), coordinates(position[i : i + 1], places)) for i, value in enumerate(position)]

"""The axes in which a workshop measures: an origin and directions in the deck's coordinates, in the deck's unit of length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.mesh.units import length_factor


@dataclass(frozen=True)
class Frame:
    """x_workshop = R (x/L − o): unit of length by name, L [m] of one; origin o (3,) [unit]; axes R (3, 3) rows x, y, z, unit."""

    unit: str
    metres: float
    origin: np.ndarray
    axes: np.ndarray

    def place(self, x: np.ndarray) -> np.ndarray:
        """Points (..., 3) [m] → [unit]."""
        return np.asarray((x / self.metres - self.origin) @ self.axes.T)

    def turn(self, d: np.ndarray) -> np.ndarray:
        """Directions (..., 3)."""
        return np.asarray(d @ self.axes.T)

    def length(self, size: np.ndarray) -> np.ndarray:
        """Lengths [m] → [unit]."""
        return np.asarray(size / self.metres)


def deck_frame(unit: str) -> Frame:
    """The deck's own coordinates."""
    return Frame(unit, length_factor(unit), np.zeros(3), np.eye(3))


def frame_at(unit: str, origin: tuple[float, ...], x: tuple[float, ...], y: tuple[float, ...]) -> Frame:
    """Right-handed axes at an origin [unit]: x along the first, z along x × y; x and y not parallel."""
    first = np.array(x) / np.linalg.norm(x)
    z = np.cross(first, y)
    z /= np.linalg.norm(z)
    return Frame(unit, length_factor(unit), np.array(origin, dtype=float), np.array([first, np.cross(z, first), z]))

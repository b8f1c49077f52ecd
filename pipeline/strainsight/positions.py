"""Coordinate system and unit of positions for the workshop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class PositionAxes:
    """x' = R (x/L − o): unit of length by name, L [m] of one; origin o (3,) [unit]; axes R (3, 3), rows x, y, z, unit vectors."""

    unit: str
    metres: float
    origin: np.ndarray
    axes: np.ndarray

    def place(self, x: np.ndarray) -> np.ndarray:
        """Points (..., 3) [m] → [unit]."""
        return np.asarray((np.asarray(x, dtype=float) / self.metres - self.origin) @ self.axes.T)

    def turn(self, d: np.ndarray) -> np.ndarray:
        """Directions (..., 3)."""
        return np.asarray(np.asarray(d, dtype=float) @ self.axes.T)

    def length(self, size: np.ndarray | float) -> np.ndarray:
        """Lengths [m] → [unit]."""
        return np.asarray(np.asarray(size, dtype=float) / self.metres)

    @property
    def heads(self) -> tuple[str, str, str]:
        """Column headings of a position."""
        return f"x [{self.unit}]", f"y [{self.unit}]", f"z [{self.unit}]"

    @property
    def is_deck_system(self) -> bool:
        """Whether the axes are those of the deck."""
        return not self.origin.any() and np.array_equal(self.axes, np.eye(3))

    def in_words(self) -> str:
        """The coordinate system in words."""
        if self.is_deck_system:
            return "deck coordinates"
        origin, x, y = (" ".join(f"{round(v, 6) + 0.0:g}" for v in row) for row in (self.origin, *self.axes[:2]))
        return f"datum coordinates: origin ({origin}) {self.unit}, x axis ({x}), y axis ({y}) in deck coordinates"


METRES = PositionAxes("m", 1.0, np.zeros(3), np.eye(3))
"""Deck coordinates in metres."""

"""The axes and the unit in which people read positions."""

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

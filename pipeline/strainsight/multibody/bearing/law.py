"""The bearing as the force law of a system (thesis figure 1.8)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.multibody.bearing.balls import KEPT, ring_law
from strainsight.multibody.bearing.element import bearing_load
from strainsight.multibody.bearing.geometry import PARAMETERS, Bearing
from strainsight.multibody.compiled.keep import compiled_law
from strainsight.multibody.forces import Load


class BearingLaw:
    """F(ρ, θ) of a bearing, ρ its five displacements, whatever their rates; θ: those of its parameters that are free, by
    name, in order."""

    def __init__(self, bearing: Bearing, free: Sequence[str] = ()):
        self._places = [PARAMETERS.index(name) for name in free]
        self._bearing = self._at = bearing

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        """F (5,), ∂F/∂ρ (5, 5), ∂F/∂θ (5, number of free parameters). Raises the errors of `bearing_load` and `Bearing`."""
        self._move(theta)
        found = bearing_load(self._at, rho, slopes=bool(self._places))
        return Load(found.force, found.tangent, None, found.slopes[:, self._places])

    def _move(self, theta: np.ndarray) -> None:
        if self._places and not np.array_equal(self._at.parameters[self._places], theta):
            values = self._bearing.parameters
            values[self._places] = theta
            self._at = self._bearing.with_parameters(values)

    @property
    def address(self) -> int:
        return int(compiled_law(ring_law).address)

    @property
    def memory(self) -> int:
        """What is kept of every ball, from which it is followed."""
        return 6 + KEPT * self._bearing.balls

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """As `ring_law` takes them."""
        self._move(theta)
        own = self._at
        sizes = [own.pitch_diameter / 2, own.ball_diameter, own.balls]
        parts = own.contacts.table.ravel(), own.contacts.centrifugal, sizes, own.turns.ravel(), self._places
        return np.concatenate([np.asarray(part, dtype=float) for part in parts])

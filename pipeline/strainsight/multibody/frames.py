"""Points and axes that bodies carry."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.errors import InfeasibleError

TURNED = {"x": (1, 2, 0), "y": (2, 0, 1), "z": (0, 1, 2)}
"""Axes in the cyclic order that ends with the one meant."""


@dataclass(frozen=True)
class Carried:
    """A vector that a body carries: b = t r + R(c + C η), bilinear in (R, η), so of constant second derivative.

    body: its name, None for the ground (b = c); t [-]; c (3,); C (3, n). A clamped body has r = 0, R = I.
    """

    body: str | None
    t: float
    c: np.ndarray
    C: np.ndarray

    def __neg__(self) -> Carried:
        return Carried(self.body, -self.t, -self.c, -self.C)


def constant(vector: np.ndarray) -> Carried:
    """A vector fixed in space (3,)."""
    return Carried(None, 0.0, np.asarray(vector, dtype=float), np.zeros((3, 0)))


@dataclass(frozen=True)
class Frame:
    """A right-handed frame on a body: origin p = r + R(o + Φη), axes a_k = R(I + [Ψη]×)A₀e_k.

    body: its name, None for the ground; origin o (3,) [m] and axes A₀ (3, 3), its columns, in body axes; displacement
    Φ (3, n) [m] and rotation Ψ (3, n) [rad] of the interface node where the body is flexible (small rotation).
    """

    name: str
    body: str | None = None
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    displacement: np.ndarray | None = None
    rotation: np.ndarray | None = None

    def __post_init__(self) -> None:
        axes = np.asarray(self.axes, dtype=float)
        if axes.shape != (3, 3) or np.abs(axes.T @ axes - np.eye(3)).max() > 1e-9 or np.linalg.det(axes) < 0:
            raise InfeasibleError(f"frame {self.name}: its axes are not three right-handed orthonormal columns")

    @property
    def point(self) -> Carried:
        """p."""
        return Carried(
            self.body, float(self.body is not None), np.asarray(self.origin, dtype=float), _shapes(self.displacement)
        )

    def axis(self, k: int) -> Carried:
        """a_k."""
        a = np.asarray(self.axes, dtype=float)[:, k]
        return Carried(self.body, 0.0, a, -cross_matrix(a) @ _shapes(self.rotation))

    def turned(self, axis: str) -> Frame:
        """The same frame with its axis x, y or z as z."""
        return replace(self, axes=np.asarray(self.axes, dtype=float)[:, TURNED[axis]])


def cross_matrix(a: np.ndarray) -> np.ndarray:
    """[a]× (3, 3): [a]× b = a × b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def _shapes(X: np.ndarray | None) -> np.ndarray:
    return np.zeros((3, 0)) if X is None else np.asarray(X, dtype=float)

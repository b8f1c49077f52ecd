"""What the filter needs to know of a model: a step, a measurement, their Jacobians and their noise."""

from __future__ import annotations

from typing import Protocol

import numpy as np


class StepModel(Protocol):
    """xₖ₊₁ = f(xₖ + w⁻) + w,   w⁻ ~ N(0, before), w ~ N(0, process);     yₖ₊₁ = h(xₖ₊₁) + v,   v ~ N(0, noise)

    for steps k = 0, 1, … of length h [s]; yₖ₊₁ stands at the end of step k. The reduced parametric model is one
    (`estimation/reduced.py`). An implicit step with constraints is another: its x holds a generalised force that f sets
    to zero and `before` draws anew, so that a disturbed state still fulfils the constraints.

    size n; channels m; h [s]; sets: how many covariances the model asks for by itself (1, or B where channels or noise
    differ from run to run); linear: A and J are the same at every x and in every step, so that runs share one covariance;
    position: indices of the states whose joint covariance is recorded; loss: what it means that a run has diverged, in words.
    """

    @property
    def size(self) -> int: ...
    @property
    def channels(self) -> int: ...
    @property
    def h(self) -> float: ...
    @property
    def sets(self) -> int: ...
    @property
    def linear(self) -> bool: ...
    @property
    def position(self) -> np.ndarray: ...
    @property
    def loss(self) -> str: ...

    def begin(self, x: np.ndarray, k: int) -> None:
        """Step k begins at x (B, n): what a model makes of that holds for all trials and for the noise of this step."""
        ...

    def step(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """f(x) and A = ∂f/∂x in step k: x (B, n) → (B, n) and (B or 1, n, n). A step that fails leaves NaN in its run."""
        ...

    def measure(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """h(x) and J = ∂h/∂x at the end of step k: x (B, n) → (B, m) and (B or 1, m, n)."""
        ...

    def process(self, k: int) -> np.ndarray:
        """Covariance (n, n) or (B, n, n) that is added after step k."""
        ...

    def before(self, k: int) -> np.ndarray | None:
        """Covariance (n, n) or (B, n, n) that is added before step k; None for none."""
        ...

    def noise(self, k: int) -> np.ndarray:
        """Variances (m,) or (B, m) of the measurement at the end of step k."""
        ...

    def lost(self, x: np.ndarray) -> np.ndarray:
        """Which runs (B,) have left what the model holds for, x (B, n)."""
        ...

"""Step of the reduced model as a function of its parameters, by Chebyshev interpolation."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, reduce

import numpy as np

from strainsight.estimation.conditional import theta_at
from strainsight.estimation.model import FilterModel
from strainsight.rom.modal_step import modal_step
from strainsight.rom.model import modal_basis

MOST = 2
"""Most parameters; the number of nodes is NODES to their power."""
NODES = 12
"""Nodes along each parameter."""
TURN = 0.25
"""Most radians by which the phase of the fastest mode differs within a cell about the guess. Elsewhere, and for a thickness, it
differs by up to four times that. The error 2 (TURN/INSIDE)^NODES / NODES! is then below rounding."""
WIDEST = 0.25
"""Widest cell in ln θ: other functions than the phase are as smooth."""
INSIDE = 0.9
"""Share of the interval of the nodes that a cell covers: derivatives are less accurate at its ends."""
KEPT = 200
"""Cells in memory."""


@dataclass(frozen=True)
class InterpolatedStep:
    """[A, B](p) of a step [q, q̇]⁺ = A(p)[q, q̇] + Σⱼ Bⱼ(p) uⱼ, and its derivatives, p = ln(θ/guess).

    On each cell of a lattice of p the matrices are polynomials through NODES Chebyshev nodes along each parameter. Cells are
    half as wide each time that |p| can have doubled a frequency. A filter, whose p changes in every step, remains in few cells.
    cells: coefficients by level of the width and place. Source: Trefethen, Approximation Theory and Approximation Practice
    (2013), chapters 7 and 8."""

    model: FilterModel
    cells: dict[tuple[int, ...], np.ndarray] = field(default_factory=dict)

    def at(self, p: np.ndarray) -> np.ndarray:
        """Matrices and their derivatives ∂/∂pᵢ (B, 1 + k, 2n, 2n + HOLD n_u) at p (B, k)."""
        level = np.floor(np.abs(p).max(axis=1, keepdims=True) / np.log(4.0))
        place = p / (self.width * 0.5**level)
        cell = np.rint(place)
        # θ ∈ (0, π) of Tₙ = cos nθ, dTₙ/dt = n sin nθ / sin θ
        angle, order = np.arccos(2 * INSIDE * (place - cell))[..., None], np.arange(NODES)
        value, scale = np.cos(order * angle), 2 * INSIDE / (self.width * 0.5 ** level[..., None] * np.sin(angle))
        slope = scale * order * np.sin(order * angle)
        k = p.shape[1]
        basis = np.empty((len(p), 1 + k, NODES**k))
        for i in range(1 + k):
            basis[:, i] = reduce(_outer, (slope[:, j] if j == i - 1 else value[:, j] for j in range(k)))
        rows, n = 2 * self.model.model.size, len(p)
        keys = np.hstack([level, cell]).astype(int).tolist()
        each = [one @ self._coefficients(tuple(key)) for one, key in zip(basis, keys, strict=True)]
        return np.reshape(each, (n, 1 + k, rows, -1))

    @cached_property
    def width(self) -> float:
        """Width of a cell: the frequency of a mode is as the square root of a parameter."""
        model = self.model
        guess = theta_at(model, np.zeros((1, len(model.unknowns.parameters))))
        fastest = float(np.sqrt(modal_basis(model.model, guess)[0].max()))
        return min(WIDEST, 2 * TURN / (fastest * model.h * len(model.unknowns.parameters)))

    def _coefficients(self, key: tuple[int, ...]) -> np.ndarray:
        """Chebyshev coefficients (NODES^k, 2n (2n + HOLD n_u)) of a cell, from its level and place."""
        if key not in self.cells:
            if len(self.cells) == KEPT:
                self.cells.clear()
            level, *cell = key
            angle, k = np.pi * (np.arange(NODES) + 0.5) / NODES, len(cell)
            nodes = np.stack(np.meshgrid(*[np.cos(angle)] * k, indexing="ij"), axis=-1).reshape(-1, k)
            p = self.width * 0.5**level * (np.array(cell) + nodes / (2 * INSIDE))
            modal = modal_step(self.model.model, theta_at(self.model, p), self.model.h, self.model.scheme)
            A = np.broadcast_to(modal.transition, (len(p), *modal.transition.shape[-2:]))
            B = np.broadcast_to(modal.input, (len(p), *modal.input.shape[-3:])).reshape(*A.shape[:2], -1)
            inverse = np.cos(np.arange(NODES)[:, None] * angle) * (2 / NODES)
            inverse[0] /= 2
            matrices = np.concatenate([A, B], axis=2).reshape(*[NODES] * k, -1)
            for _ in range(k):  # the axis of the first nodes becomes the last of the coefficients
                matrices = np.moveaxis(np.tensordot(inverse, matrices, 1), 0, k - 1)
            self.cells[key] = matrices.reshape(NODES**k, -1)
        return self.cells[key]


def _outer(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Products (B, a·b) of (B, a) and (B, b)."""
    return (first[:, :, None] * second[:, None]).reshape(len(first), -1)

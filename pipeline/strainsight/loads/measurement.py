"""Rows of the measurement on the augmented state, for strain, displacement and acceleration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.fem.affine import NO_CHANGE, AffineOperator
from strainsight.loads.unknowns import Unknowns
from strainsight.rom.model import ReducedModel, accelerations
from strainsight.sensors.candidates import ACCELERATION


@dataclass(frozen=True)
class Sensed:
    """rows (m, n): strain or displacement of a channel per coordinate, of an accelerometer displacement along its axis, at the
    references; quantity (m,); change (m, n): what θ adds to the rows."""

    rows: np.ndarray
    quantity: np.ndarray
    change: AffineOperator = NO_CHANGE

    def linearised(
        self,
        model: ReducedModel,
        unknowns: Unknowns,
        theta: Mapping[str, float],
        x: np.ndarray,
        u: np.ndarray,
        F: np.ndarray,
    ) -> np.ndarray:
        """H* (s, m, n*) of `measurement_rows` at given instants of a known motion, and in the column of a parameter that the rows
        depend on

            strain, displacement   θᵢ ∂row/∂θᵢ q,     acceleration   θᵢ ∂row/∂θᵢ q̈

        arguments, and F (s, n*, n*), of `linearise`.
        """
        H = measurement_rows(np.asarray(self.rows + self.change.at(theta)), self.quantity, F)
        moving, first = np.asarray(self.quantity) == ACCELERATION, unknowns.size(model) - len(unknowns.parameters)
        for i, name in enumerate(unknowns.parameters):
            if name in self.change.parameters:
                slope = theta[name] * np.asarray(self.change.derivative(name, theta))
                read = x[:, : model.size] @ slope.T
                if moving.any():
                    read[:, moving] = accelerations(model, theta, x, u) @ slope[moving].T
                H[..., first + i] += read
        return H


def measurement_rows(rows: np.ndarray, quantity: np.ndarray, F: np.ndarray) -> np.ndarray:
    """H* of the linearised measurement y = H* x*:

        strain, displacement   [row, 0, 0, 0]
        acceleration           row · F*[n:2n, :]     q̈ of the linearised system: inputs and parameters enter directly

    rows (m, n), quantity (m,) as of `Sensed`, at θ; F (n*, n*) or (s, n*, n*) [1/s] from `linearise`. Returns (m, n*) or
    (s, m, n*).
    """
    n, n_star = rows.shape[1], F.shape[-1]
    H = np.zeros((*F.shape[:-2], len(rows), n_star))
    H[..., :n] = rows
    moving = np.asarray(quantity) == ACCELERATION
    H[..., moving, :] = rows[moving] @ F[..., n : 2 * n, :]
    return H

"""Rows of the measurement on the augmented state, for strain, displacement and acceleration."""

from __future__ import annotations

import numpy as np

from strainsight.gauges.candidates import ACCELERATION


def measurement_rows(rows: np.ndarray, quantity: np.ndarray, F: np.ndarray) -> np.ndarray:
    """H* of the linearised measurement y = H* x*:

        strain, displacement   [row, 0, 0, 0]
        acceleration           row · F*[n:2n, :]     q̈ of the linearised system: inputs and parameters enter directly

    rows (m, n): strain or displacement of a channel per coordinate; of an accelerometer, displacement along its axis.
    quantity (m,); F (n*, n*) or (s, n*, n*) [1/s] from `linearise`. Returns (m, n*) or (s, m, n*).
    """
    n, n_star = rows.shape[1], F.shape[-1]
    H = np.zeros((*F.shape[:-2], len(rows), n_star))
    H[..., :n] = rows
    moving = np.asarray(quantity) == ACCELERATION
    H[..., moving, :] = rows[moving] @ F[..., n : 2 * n, :]
    return H

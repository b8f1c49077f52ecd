"""The standard deviation that the filter will claim along a known motion, without any measurement."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.model import FilterModel, theta_of
from strainsight.estimation.motion import augmented_jacobian, measured_jacobian
from strainsight.estimation.update import joseph, predict, standard_deviation
from strainsight.rom.modal_step import acceleration_map, modal_step

CHUNK = 256
"""Steps whose Jacobians are held at once."""


def covariance_recursion(
    model: FilterModel, trajectory: np.ndarray, u: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """Standard deviation of x* that the filter will claim along a given motion, for B sets of sensors at once.

    The covariance recursion of `run_filter`, which needs no measurement, with A* and the rows at the motion and θ = guess
    (p = 0). trajectory (T + 1, 2n) [q, q̇]; u (T, HOLD, n_u) hold coefficients of all inputs of the model [N], unknown
    ones too; covariance (n*, n*) or (B, n*, n*) of x* at t = 0. Returns std (T + 1, B, n*); B = 1 for one set.
    """
    b = max(model.sets, len(covariance) if covariance.ndim == 3 else 1)
    P = np.broadcast_to(covariance, (b, model.size, model.size)).astype(float)
    R = np.broadcast_to(model.noise, (*model.noise.shape[:-2], b, model.H.shape[-2]))
    theta = theta_of(model, np.zeros(model.size))
    modal = modal_step(model.model, theta, model.h, model.scheme)
    sensed = None if model.accelerometers is None else acceleration_map(model.model, theta)
    std = np.empty((len(u) + 1, b, model.size))
    std[0] = standard_deviation(P)
    for first in range(0, len(u), CHUNK):
        span = slice(first, min(first + CHUNK, len(u)))
        A = augmented_jacobian(model, modal, theta, trajectory[span], u[span])
        ends = trajectory[1:][span, None], u[span].sum(axis=1)[:, None, None]
        H = measured_jacobian(model, sensed, theta, *ends)
        for k in range(span.start, span.stop):
            P = predict(P, A[(k - first) % len(A)], model.process)
            if (k + 1) % model.every == 0:
                # rows vary along the motion where accelerometers feel an estimated parameter
                rows, noise = (H[k - first] if H.ndim == 4 else H), (R[k] if R.ndim == 3 else R)
                P, _, _ = joseph(P, *few(rows, noise), (k + 1) * model.h)
            std[k + 1] = standard_deviation(P)
    return std


def few(H: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As few rows of unit noise as states that say the same, HᵀR⁻¹H = CᵀC, where there are more channels than that.

    H (m, n) or (b, m, n); R (b, m). Without measurements the channels matter by that product only.
    """
    if H.shape[-2] <= 2 * H.shape[-1]:
        return H, R
    whitened = H / np.sqrt(R)[..., None]
    C = np.asarray(np.linalg.qr(whitened, mode="r"))
    return C, np.ones(C.shape[:-1])

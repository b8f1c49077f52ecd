"""The standard deviation that a filter will claim along a known motion, without any measurement, and what it is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.along import steps_along
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.model import FilterModel
from strainsight.estimation.update import corrected, gain, predict, standard_deviation, transposed

NOISE, PROCESS, START = "noise", "process noise", "start"
"""Sources of what the filter knows to be uncertain; those of what it takes as exact are named by its nuisances."""
WHITE = (NOISE, PROCESS, START)


@dataclass(frozen=True)
class Claim:
    """std (T + 1, B, n*) of x* for B sets of sensors; budget: source → its part (T + 1, n*) of the variance of the first set, the
    sum of which over the sources is that variance."""

    std: np.ndarray
    budget: Mapping[str, np.ndarray]


def covariance_recursion(
    model: FilterModel,
    trajectory: np.ndarray,
    u: np.ndarray,
    covariance: np.ndarray,
    nuisances: Nuisances | None = None,
) -> Claim:
    """Standard deviation of x* that the extended filter will claim along a given motion, for B sets of sensors at once.

    The covariance recursion of `run_filter`, which needs no measurement, with A* and the rows at the motion and θ = guess
    (p = 0); beside it, with the same gains, the error that one of every nuisance ν makes, as `parallel_filters.advance`, and
    the parts of P, each the same recursion of one source alone:

        V⁻ = A* V − (A_ν x + G_ν w),   V = V⁻ + K(D x + E w₁ + o − H* V⁻),   σ² = diag P + Σₖ Vₖ²
        P = P_R + P_Q + P_0,           P_s⁺ = (I − KH)(A* P_s A*ᵀ + Q_s)(I − KH)ᵀ + K R_s Kᵀ

    trajectory (T + 1, 2n) [q, q̇]; u (T, HOLD, n_u) hold coefficients of all inputs of the model [N], unknown ones too;
    covariance (n*, n*) or (B, n*, n*) of x* at t = 0; nuisances of a model the sets of which differ by their noise alone: a
    channel of infinite noise has none.
    Sources: Schmidt, Advances in Control Systems 3 (1966); JCGM 100:2008 (GUM), section 5.1 (parts of a variance).
    """
    source = () if nuisances is None else nuisances.sources(model.model.size)
    P, parts, Q = starts(model, covariance)
    V = np.zeros((len(P), len(source), model.size))
    variance, part = np.empty((len(u) + 1, *P.shape[:2])), np.empty((len(u) + 1, *parts.shape[:2]))
    shift = np.zeros((len(u) + 1, *V.shape[1:]))
    variance[0], part[0] = standard_deviation(P) ** 2, standard_deviation(parts) ** 2
    for k, step in enumerate(steps_along(model, trajectory, u, nuisances, len(P)), start=1):
        P, parts = predict(P, step.A, model.process), predict(parts, step.A, Q)
        V = V @ step.A.T - step.pushed
        if step.sampled:
            rows, noise = (step.H, step.variance) if source else few(step.H, step.variance)
            K, _ = gain(P, rows, noise, step.instant)
            P = corrected(P, K, rows, noise)
            parts = corrected(parts, K[:1], rows[:1], by_sensors(noise))
            if source:
                V = V + (step.read - V @ transposed(rows)) @ transposed(K)
        variance[k] = standard_deviation(P) ** 2 + np.sum(V**2, axis=1)
        part[k], shift[k] = standard_deviation(parts) ** 2, V[0]
    budget = {name: part[:, i] for i, name in enumerate(WHITE)}
    return Claim(np.sqrt(variance), budget | by_source(source, shift))


def starts(model: FilterModel, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P (B, n*, n*) at t = 0; its parts (3, n*, n*) by source in the first set, and what every step adds to each of them."""
    b = max(model.sets, len(covariance) if covariance.ndim == 3 else 1)
    P = np.broadcast_to(covariance, (b, model.size, model.size)).astype(float)
    parts, Q = np.zeros((2, len(WHITE), model.size, model.size))
    parts[WHITE.index(START)] = P[0]
    Q[WHITE.index(PROCESS)] = model.process if model.process.ndim == 2 else model.process[0]
    return P, parts, Q


def by_sensors(noise: np.ndarray) -> np.ndarray:
    """Variances (3, m) of the samples by source, of the first of (b, m)."""
    return noise[0] * np.eye(len(WHITE))[:, [WHITE.index(NOISE)]]


def by_source(source: tuple[str, ...], shift: np.ndarray) -> dict[str, np.ndarray]:
    """Variance (T, n*) that the nuisances of every source add together; source (d,), shift (T, d, n*) of one of each."""
    named = np.array(source)
    return {name: np.sum(shift[:, named == name] ** 2, axis=1) for name in dict.fromkeys(source)}


def few(H: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As few rows of unit noise as states that say the same, HᵀR⁻¹H = CᵀC, where there are more channels than that.

    H (m, n) or (b, m, n); R (b, m). Without measurements the channels matter by that product only.
    """
    if H.shape[-2] <= 2 * H.shape[-1]:
        return H, R
    whitened = H / np.sqrt(R)[..., None]
    C = np.asarray(np.linalg.qr(whitened, mode="r"))
    return C, np.ones(C.shape[:-1])

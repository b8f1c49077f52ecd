"""Errors of a smoother, drawn as whole histories: what every instant is off by together with all others."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.core import StepModel
from strainsight.estimation.run import FilterRun
from strainsight.estimation.update import apply, covariance_factor, gain, predict


def smoother_errors(
    model: StepModel, run: FilterRun, count: int, rng: np.random.Generator, states: slice = slice(None)
) -> np.ndarray:
    """Draws (count, T + 1, n) of x − x̂ˢ for `smooth` of a kept run: of mean zero, of its covariance at every instant, and of the
    covariance between instants that it has.

    Start, process and noise are drawn; the innovations ν of the filter are then, and the smoother makes of them:

        e⁻ = A e + w,   ν = H e⁻ + v,   e = e⁻ − K ν;      λ⁻ = (I − KH)ᵀλ − HᵀS⁻¹ν,   λ ← Aᵀλ⁻;      x − x̂ˢ = e + P λ

    It is the simulation smoother by mean correction, whose samples cancel: an error of a linear smoother does not depend on them.
    Added to x̂ˢ it is a draw of the posterior of a linear model with normal noises. A nonlinear model is as linear as `smooth`
    takes it for. run: of one run, kept with keep="all"; states: which are wanted. Raises ValueError otherwise.
    Source: Durbin and Koopman, Biometrika 89 (2002).
    """
    if run.covariance is None or run.jacobian is None or run.rows is None or run.adjusted is None:
        raise ValueError("errors of the smoother need a run kept with keep='all'")
    if run.adjusted.shape[1] != 1:
        raise ValueError(f"errors of the smoother are of one run, not of {run.adjusted.shape[1]}")
    steps, _, m = run.adjusted.shape
    n = run.covariance.shape[-1]
    factors, missing = _Factors(), np.isnan(run.adjusted[:, 0])
    e, said = np.empty((steps + 1, count, n)), np.zeros((steps, count, m))
    e[0] = _drawn(covariance_factor(run.covariance[0, 0]), count, rng)
    gains: list[tuple[np.ndarray, np.ndarray] | None] = []
    for k in range(steps):
        before, A = model.before(k), run.jacobian[k, 0]
        process = _one(model.process(k) if run.process is None else run.process[k])
        start = e[k] if before is None else e[k] + _drawn(factors.of("before", _one(before)), count, rng)
        ahead = start @ A.T + _drawn(factors.of("process", process), count, rng)
        there = ~missing[k]
        if not there.any():
            e[k + 1] = ahead
            gains.append(None)
            continue
        H, R = run.rows[k, 0][there], _noise(model, run, k)[np.ix_(there, there)]
        P = run.covariance[k] if before is None else run.covariance[k] + before
        K, L = gain(predict(P, A, process), H, R[None], instant=run.time[k + 1])
        innovation = ahead @ H.T + _drawn(factors.of("noise", R), count, rng)
        e[k + 1] = ahead - apply(K, innovation)
        gains.append((np.eye(n) - K[0] @ H, np.linalg.solve(L[0], H)))
        said[k][:, there] = np.linalg.solve(L[0], innovation.T).T
    adjoint = np.zeros((count, n))
    found = np.empty((count, steps + 1, len(range(n)[states])))
    for k in range(steps, -1, -1):
        found[:, k] = (e[k] + adjoint @ run.covariance[k, 0])[:, states]
        if k == 0:
            break
        if (own := gains[k - 1]) is not None:
            left, rows = own
            adjoint = adjoint @ left - said[k - 1][:, ~missing[k - 1]] @ rows
        adjoint = adjoint @ run.jacobian[k - 1, 0]
    return found


def _drawn(factor: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    return np.asarray(rng.standard_normal((count, factor.shape[1])) @ factor.T)


def _one(matrix: np.ndarray) -> np.ndarray:
    return matrix if matrix.ndim == 2 else matrix[0]


def _noise(model: StepModel, run: FilterRun, k: int) -> np.ndarray:
    """R (m, m) of step k."""
    if run.noise is not None:
        return np.asarray(run.noise[k, 0])
    R = np.asarray(model.noise(k))
    return np.diag(R if R.ndim == 1 else R[0])


class _Factors:
    """Factors of covariances, found anew only where they change."""

    def __init__(self) -> None:
        self._kept: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def of(self, name: str, covariance: np.ndarray) -> np.ndarray:
        kept = self._kept.get(name)
        if kept is None or kept[0].shape != covariance.shape or not np.array_equal(kept[0], covariance):
            kept = self._kept[name] = (covariance.copy(), covariance_factor(covariance))
        return kept[1]

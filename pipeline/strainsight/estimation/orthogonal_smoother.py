"""The fixed-interval smoother by orthogonal steps alone, where σ by all samples is digits smaller than it was before them."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_triangular

from strainsight.estimation.core import StepModel
from strainsight.estimation.filter import FilterRun
from strainsight.estimation.smoothed import Smoothed
from strainsight.estimation.update import covariance_factor, predict_factor, update_factor


def smooth_first(model: StepModel, run: FilterRun) -> Smoothed:
    """The Rauch-Tung-Striebel estimate of the first run, as filter and what the samples ahead say, put together. With
    d = x − x̂ at every instant, F Fᵀ = P and M d ≈ z the samples ahead as rows of unit noise,

        d = F e:    min ‖e‖² + ‖M F e − z‖²,      Pˢ = F (1 + FᵀMᵀM F)⁻¹ Fᵀ
        N = (M, R^(−½)H),   s = (z, R^½ S⁻¹ν)
        min over b, w:  ‖b‖² + ‖w‖² + ‖N (A (d + B½ b) + Q½ w − Kν) − s‖²  =  ‖M⁻d − z⁻‖² + what no d changes

    backwards from no rows at the last instant; B: `before`, Q: `process`. x is the state in front of what `before` adds to it.
    Information is only ever added: `smooth`, which takes P Λ P off P, has lost σ where that is all but P. No covariance is
    inverted; P and P⁻ may be singular.

    run: `filter_runs(..., keep="first" or "all")` of the same model by any update; a nonlinear one is smoothed along the
    Jacobians that its filter used. Raises ValueError where the run was not kept.
    Source: Bierman, Factorization methods for discrete sequential estimation (1977), chapter X.
    """
    if run.covariance is None or run.jacobian is None or run.rows is None or run.adjusted is None:
        raise ValueError("the smoother needs a run kept with keep='first' or 'all'")
    steps, n = len(run.jacobian), run.mean.shape[2]
    M, z = np.zeros((0, n)), np.zeros(0)
    mean, std = np.empty((steps + 1, 1, n)), np.empty((steps + 1, 1, n))
    for k in range(steps, -1, -1):
        F = covariance_factor(run.covariance[k, 0])
        if k < steps:
            M, z = _back(model, run, k, F, M, z)
        e, unit = _eliminated(np.vstack([M @ F, np.eye(F.shape[1])]), np.concatenate([z, np.zeros(F.shape[1])]))
        mean[k, 0] = run.mean[k, 0] + F @ solve_triangular(unit, e)
        std[k, 0] = np.linalg.norm(solve_triangular(unit, F.T, trans="T"), axis=0)
    return Smoothed(run.time, mean, std, None)


def _back(
    model: StepModel, run: FilterRun, k: int, F: np.ndarray, M: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """M, z at the start of step k from those at its end, F (n, r) the factor of P at its start."""
    assert run.jacobian is not None
    assert run.rows is not None
    assert run.adjusted is not None
    A, H = run.jacobian[k, 0], run.rows[k, 0]
    there = np.isfinite(run.adjusted[k, 0])
    H, whitened = np.where(there[:, None], H, 0.0), np.nan_to_num(run.adjusted[k, 0])
    before = model.before(k)
    drawn = np.zeros((len(A), 0)) if before is None else covariance_factor(_one(before))
    added = covariance_factor(_one(model.process(k)) if run.process is None else run.process[k, 0])
    R = np.broadcast_to(_one(model.noise(k), 1), len(H)) if run.noise is None else np.diag(run.noise[k, 0])
    prior = predict_factor(np.hstack([F, drawn])[None], A, added[None])
    _, G, L = update_factor(prior, H, R[None], float(run.time[k + 1]))
    moved = G[0] @ whitened
    N = np.vstack([M, H / np.sqrt(R)[:, None]])
    s = np.concatenate([z, np.sqrt(R) * solve_triangular(L[0], whitened, lower=True, trans="T")]) + N @ moved
    noise = np.hstack([A @ drawn, added])
    r = noise.shape[1]
    # large rows first: what orthogonal steps lose is small beside the first ones
    rows = np.vstack([np.hstack([N @ noise, N @ A]), np.eye(r, r + len(A))])
    rotated, triangle = _eliminated(rows, np.concatenate([s, np.zeros(r)]))
    return triangle[r:, r:], rotated[r:]


def _eliminated(rows: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Qᵀ right and the triangle of rows = Q × triangle, at most as many rows as columns."""
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows, right]), mode="r"))[: rows.shape[1]]
    return triangle[:, -1], triangle[:, :-1]


def _one(X: np.ndarray, dimensions: int = 2) -> np.ndarray:
    """Of the first run."""
    return X if X.ndim == dimensions else X[0]

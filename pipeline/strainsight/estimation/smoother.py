"""The fixed-interval smoother: mean and covariance of the states at every instant given all samples, and draws of its errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import isqrt

import numpy as np
from scipy.linalg import solve_triangular

from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import DrivenModel, StepModel
from strainsight.estimation.run import FilterRun
from strainsight.estimation.update import (
    apply,
    covariance_factor,
    gain,
    output_std,
    predict,
    predict_factor,
    standard_deviation,
    symmetric,
    transpose,
    update_factor,
)
from strainsight.rom.modal_step import HOLD


@dataclass(frozen=True)
class WantedCovariances:
    """Covariances to be stored by a smoother. rows (r, n*), or (T + 1, r, n*) if they change: σ at each instant; states (k,):
    joint covariance at each instant; instants (i,): full covariance."""

    rows: np.ndarray
    states: np.ndarray
    instants: np.ndarray


@dataclass(frozen=True)
class SelectedCovariances:
    """Stored covariances: std (T + 1, r), covariance (T + 1, k, k) and then (i, n*, n*)."""

    wanted: WantedCovariances
    std: np.ndarray
    covariance: np.ndarray
    then: np.ndarray

    @classmethod
    def of(cls, wanted: WantedCovariances, instants: int, n: int) -> SelectedCovariances:
        """Empty arrays for so many instants of n* states."""
        r, k, i = wanted.rows.shape[-2], len(wanted.states), len(wanted.instants)
        return cls(wanted, np.zeros((instants, r)), np.zeros((instants, k, k)), np.zeros((i, n, n)))

    def take(self, at: slice, covariance: np.ndarray) -> None:
        """Store the covariance (L, n*, n*) of a piece."""
        rows, states, instants = self.wanted.rows, self.wanted.states, self.wanted.instants
        self.std[at] = output_std(rows[at] if rows.ndim > 2 else rows, covariance)
        self.covariance[at] = covariance[:, states[:, None], states]
        here = np.flatnonzero((at.start <= instants) & (instants < at.stop))
        self.then[here] = covariance[instants[here] - at.start]


@dataclass(frozen=True)
class Smoothed:
    """mean, std (T + 1, B, n*) of x* given all measurements; covariance (T + 1, b, n*, n*) if complete, else selected; time
    [s]."""

    time: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    covariance: np.ndarray | None
    selected: SelectedCovariances | None = None

    def std_of(self, rows: np.ndarray) -> np.ndarray:
        """σ (T + 1, r) of rows (r, n*) or (T + 1, r, n*) of x* in the first run. Raises ValueError if it was not stored."""
        if self.covariance is not None:
            return output_std(rows, self.covariance[:, 0])
        selected = self._require_selected()
        if selected.wanted.rows.ndim == 2:
            return selected.std[:, _places(rows, selected.wanted.rows)]
        if not np.array_equal(rows, selected.wanted.rows):
            raise ValueError(
                "the smoother did not store σ of the requested outputs: call `smooth` with covariance=True"
            )
        return selected.std

    def covariance_of(self, states: np.ndarray) -> np.ndarray:
        """Covariance (T + 1, k, k) of some states (k,) in the first run. Raises ValueError if it was not stored."""
        if self.covariance is not None:
            return self.covariance[:, 0][:, states[:, None], states]
        selected = self._require_selected()
        at = _places(states, selected.wanted.states)
        return selected.covariance[:, at[:, None], at]

    def covariance_at(self, k: int) -> np.ndarray:
        """Covariance of x* (n*, n*) at instant k in the first run. Raises ValueError if it was not stored."""
        if self.covariance is not None:
            return np.asarray(self.covariance[k, 0])
        selected = self._require_selected()
        return np.asarray(selected.then[_places(np.array([k]), selected.wanted.instants)[0]])

    def without_sigma(self) -> Smoothed:
        """The same with NaN for σ and covariance, which propagates to all results."""
        return self.with_sigma_times(np.nan)

    def with_sigma_times(self, factor: float) -> Smoothed:
        """The same with σ multiplied by a factor, and covariances by its square."""
        selected, whole, square = self.selected, self.covariance, factor**2
        if selected is not None:
            std, covariance, then = factor * selected.std, square * selected.covariance, square * selected.then
            selected = replace(selected, std=std, covariance=covariance, then=then)
        every = None if whole is None else square * whole
        return replace(self, std=factor * self.std, covariance=every, selected=selected)

    def _require_selected(self) -> SelectedCovariances:
        if self.selected is None:
            raise ValueError("the smoother did not store covariances: call `smooth` with covariance=True")
        return self.selected


def _places(wanted: np.ndarray, available: np.ndarray) -> np.ndarray:
    """Indices (k,) of wanted entries (k, ...) among the available ones. Raises ValueError if one is missing."""
    at = [np.flatnonzero((available == one).reshape(len(available), -1).all(axis=1)) for one in wanted]
    if not all(map(len, at)):
        raise ValueError("the smoother did not store the requested covariances: call `smooth` with covariance=True")
    return np.array([each[0] for each in at], dtype=int)


def smooth(model: FilterModel | StepModel, run: FilterRun, covariance: bool = False) -> Smoothed:
    """The Rauch-Tung-Striebel estimate in the adjoint form of Bryson and Frazier, which inverts neither P nor P⁻:

        x̂ˢ = x̂ − P λ,      λ⁻ = (I − KH)ᵀλ − HᵀS⁻¹ν,             λ ← Aᵀλ⁻
        Pˢ = P − P Λ P,     Λ⁻ = (I − KH)ᵀΛ(I − KH) + HᵀS⁻¹H,      Λ ← AᵀΛ⁻A

    backwards from λ = 0, Λ = 0 at the last instant.

    run: `run_filter(..., keep="all")` of the same model, in any form and by any update. A singular
    P⁻ (states without process noise) needs no care.
    A nonlinear model is smoothed along the Jacobians, or the regressions, that its filter used.
    Raises ValueError where the run was not kept, or the first one alone of several.
    Source: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973)."""
    covariances, jacobian, all_rows, adjusted = map(
        _require_kept, (run.covariance, run.jacobian, run.rows, run.adjusted)
    )
    if covariances.shape[1] != run.unknown_covariance.shape[1]:
        raise ValueError("the filter stored the covariance of its first run only, so its other runs cannot be smoothed")
    core = DrivenModel(model, np.zeros((0, HOLD, 0))) if isinstance(model, FilterModel) else model
    steps, runs, channels = run.innovation.shape
    b, size = covariances.shape[1:3]
    missing = np.isnan(adjusted) if b > 1 else np.isnan(adjusted).all(axis=1, keepdims=True)
    whitened = np.nan_to_num(adjusted)
    adjoint, information = np.zeros((runs, size)), np.zeros((b, size, size))
    mean, std = np.empty_like(run.mean), np.empty((steps + 1, b, size))
    smoothed = np.empty_like(covariances) if covariance else None
    for k in range(steps, -1, -1):
        P = covariances[k]
        PInformation = P @ information
        mean[k] = run.mean[k] - apply(P, adjoint)
        std[k] = np.sqrt(np.maximum(standard_deviation(P) ** 2 - np.sum(PInformation * P, axis=-1), 0.0))
        if smoothed is not None:
            smoothed[k] = symmetric(P - PInformation @ P)
        if k == 0:
            break
        A = jacobian[k - 1]
        if not missing[k - 1].all():
            H, before = all_rows[k - 1], core.before(k - 1)
            H = np.where(missing[k - 1][..., None], 0.0, H) if missing[k - 1].any() else H
            P = covariances[k - 1] if before is None else covariances[k - 1] + before
            R = np.broadcast_to(core.noise(k - 1), (b, channels)) if run.noise is None else run.noise[k - 1]
            process = core.process(k - 1) if run.process is None else run.process[k - 1]
            K, L = gain(predict(P, A, process), H, R, instant=run.time[k])
            whitened_rows = np.linalg.solve(L, np.broadcast_to(H, (b, channels, size)))
            left = np.eye(size) - K @ H
            adjoint = apply(transpose(left), adjoint) - apply(transpose(whitened_rows), whitened[k - 1])
            information = transpose(left) @ information @ left + transpose(whitened_rows) @ whitened_rows
        adjoint = apply(transpose(A), adjoint)
        information = symmetric(transpose(A) @ information @ A)
    return Smoothed(run.time, mean, np.broadcast_to(std, mean.shape), smoothed)


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
    Source: Bierman, Factorization methods for discrete sequential estimation (1977), chapter X."""
    steps, n = len(_require_kept(run.jacobian)), run.mean.shape[2]
    M, z = np.zeros((0, n)), np.zeros(0)
    mean, std = np.empty((steps + 1, 1, n)), np.empty((steps + 1, 1, n))
    for k in range(steps, -1, -1):
        F = covariance_factor(_require_kept(run.covariance)[k, 0])
        if k < steps:
            M, z = _back(model, run, k, F, M, z)
        e, unit = _eliminate(np.vstack([M @ F, np.eye(F.shape[1])]), np.concatenate([z, np.zeros(F.shape[1])]))
        mean[k, 0] = run.mean[k, 0] + F @ solve_triangular(unit, e)
        std[k, 0] = np.linalg.norm(solve_triangular(unit, F.T, trans="T"), axis=0)
    return Smoothed(run.time, mean, std, None)


def _back(
    model: StepModel, run: FilterRun, k: int, F: np.ndarray, M: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """M, z at the start of step k from those at its end, F (n, r) the factor of P at its start."""
    A, H, before, process, R = _first_of(model, run, k)
    measured, whitened = (
        np.isfinite(_require_kept(run.adjusted)[k, 0]),
        np.nan_to_num(_require_kept(run.adjusted)[k, 0]),
    )
    H, R = np.where(measured[:, None], H, 0.0), np.diag(R)
    disturbance = np.zeros((len(A), 0)) if before is None else covariance_factor(before)
    added = covariance_factor(process)
    prior = predict_factor(np.hstack([F, disturbance])[None], A, added[None])
    _, G, L = update_factor(prior, H, R[None], float(run.time[k + 1]))
    moved = G[0] @ whitened
    N = np.vstack([M, H / np.sqrt(R)[:, None]])
    s = np.concatenate([z, np.sqrt(R) * solve_triangular(L[0], whitened, lower=True, trans="T")]) + N @ moved
    noise = np.hstack([A @ disturbance, added])
    r = noise.shape[1]
    # large rows first, as the rounding of orthogonal steps is relative to them
    rows = np.vstack([np.hstack([N @ noise, N @ A]), np.eye(r, r + len(A))])
    rotated, triangle = _eliminate(rows, np.concatenate([s, np.zeros(r)]))
    return triangle[r:, r:], rotated[r:]


def _eliminate(rows: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Qᵀ right and the triangle of rows = Q × triangle, at most as many rows as columns."""
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows, right]), mode="r"))[: rows.shape[1]]
    return triangle[:, -1], triangle[:, :-1]


def _require_kept(array: np.ndarray | None) -> np.ndarray:
    """An array of a run that the filter stored for the smoother. Raises ValueError if it is missing."""
    if array is None:
        raise ValueError("the smoother needs a run kept with keep='all', or 'first' for the first run alone")
    return array


def _first_of(
    model: StepModel, run: FilterRun, k: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, np.ndarray, np.ndarray]:
    """A (n, n), H (m, n), `before` (n, n), `process` (n, n) and R (m, m) of step k in the first run."""

    def one(X: np.ndarray, dimensions: int = 2) -> np.ndarray:
        return X if X.ndim == dimensions else X[0]

    before = model.before(k)
    process = one(model.process(k) if run.process is None else run.process[k])
    H, R = _require_kept(run.rows)[k, 0], np.diag(one(model.noise(k), 1)) if run.noise is None else run.noise[k, 0]
    return _require_kept(run.jacobian)[k, 0], H, None if before is None else one(before), process, R


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
    Source: Durbin and Koopman, Biometrika 89 (2002)."""
    adjusted, covariance = _require_kept(run.adjusted), _require_kept(run.covariance)
    if adjusted.shape[1] != 1:
        raise ValueError(f"smoother errors can be sampled for one run only, not for {adjusted.shape[1]} runs together")
    steps, _, m = adjusted.shape
    n = covariance.shape[-1]
    measured = np.isfinite(adjusted[:, 0])
    e, white = np.empty((steps + 1, count, n)), np.zeros((steps, count, m))

    @lru_cache(maxsize=4)
    def factor_of(numbers: bytes) -> np.ndarray:
        return covariance_factor(np.frombuffer(numbers).reshape(isqrt(len(numbers) // 8), -1))

    def sample(P: np.ndarray) -> np.ndarray:
        factor = factor_of(P.tobytes())
        return np.asarray(rng.standard_normal((count, factor.shape[1])) @ factor.T)

    e[0] = sample(covariance[0, 0])
    back: list[tuple[np.ndarray, np.ndarray] | None] = []
    for k in range(steps):
        A, H, before, process, R = _first_of(model, run, k)
        start = e[k] if before is None else e[k] + sample(before)
        ahead = start @ A.T + sample(process)
        channels = measured[k]
        if not channels.any():
            e[k + 1] = ahead
            back.append(None)
            continue
        H, R = H[channels], R[np.ix_(channels, channels)]
        P = covariance[k] if before is None else covariance[k] + before
        K, L = gain(predict(P, A, process), H, R[None], instant=run.time[k + 1])
        innovation = ahead @ H.T + sample(R)
        e[k + 1] = ahead - apply(K, innovation)
        back.append((np.eye(n) - K[0] @ H, np.linalg.solve(L[0], H)))
        white[k][:, channels] = np.linalg.solve(L[0], innovation.T).T
    adjoint = np.zeros((count, n))
    error = np.empty((count, steps + 1, len(range(n)[states])))
    for k in range(steps, -1, -1):
        error[:, k] = (e[k] + adjoint @ covariance[k, 0])[:, states]
        if k == 0:
            break
        if (update := back[k - 1]) is not None:
            left, rows = update
            adjoint = adjoint @ left - white[k - 1][:, measured[k - 1]] @ rows
        adjoint = adjoint @ _require_kept(run.jacobian)[k - 1, 0]
    return error

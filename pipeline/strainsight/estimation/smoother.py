"""The fixed-interval smoother: what all strains, also the later ones, say about every instant."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_triangular

from strainsight.estimation.filter import FilterRun
from strainsight.estimation.model import FilterModel, StepModel
from strainsight.estimation.reduced import Driven
from strainsight.estimation.update import (
    apply,
    covariance_factor,
    gain,
    output_std,
    predict,
    predict_factor,
    standard_deviation,
    symmetric,
    transposed,
    update_factor,
)
from strainsight.rom.modal_step import HOLD


@dataclass(frozen=True)
class Wanted:
    """Covariances that are kept of a smoother: rows (r, n*), or (T + 1, r, n*) where they change, of which σ is wanted at every
    instant; states (k,), their
    covariance with one another at every instant; instants (i,), all of it there."""

    rows: np.ndarray
    states: np.ndarray
    instants: np.ndarray


@dataclass(frozen=True)
class Kept:
    """What was wanted: std (T + 1, r), covariance (T + 1, k, k) and then (i, n*, n*)."""

    wanted: Wanted
    std: np.ndarray
    covariance: np.ndarray
    then: np.ndarray


@dataclass(frozen=True)
class Smoothed:
    """mean, std (T + 1, B, n*) of x* given all measurements; covariance (T + 1, b, n*, n*) where all of it was asked for, kept
    where some was; time [s]."""

    time: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    covariance: np.ndarray | None
    kept: Kept | None = None

    def std_of(self, rows: np.ndarray) -> np.ndarray:
        """σ (T + 1, r) of rows (r, n*) or (T + 1, r, n*) of x* in the first run. Raises ValueError where it was not kept."""
        if self.covariance is not None:
            return output_std(rows, self.covariance[:, 0])
        own = self._kept()
        if own.wanted.rows.ndim > 2:
            if not np.array_equal(rows, own.wanted.rows):
                raise ValueError("the smoother has not kept the variance of these rows")
            return own.std
        at = [np.flatnonzero((own.wanted.rows == row).all(axis=1)) for row in rows]
        if not all(len(found) for found in at):
            raise ValueError("the smoother has not kept the variance of this row")
        return own.std[:, [found[0] for found in at]]

    def covariance_of(self, states: np.ndarray) -> np.ndarray:
        """Of some states (k,) in the first run: (T + 1, k, k). Raises ValueError where it was not kept."""
        if self.covariance is not None:
            return self.covariance[:, 0][:, states[:, None], states]
        own = self._kept()
        at = _places(states, own.wanted.states)
        return own.covariance[:, at[:, None], at]

    def covariance_at(self, k: int) -> np.ndarray:
        """Of x* (n*, n*) at instant k in the first run. Raises ValueError where it was not kept."""
        if self.covariance is not None:
            return np.asarray(self.covariance[k, 0])
        own = self._kept()
        return np.asarray(own.then[_places(np.array([k]), own.wanted.instants)[0]])

    def without_sigma(self) -> Smoothed:
        """NaN for σ and covariance, so that whatever is computed from them is NaN too."""
        none = np.nan
        kept, whole = self.kept, self.covariance
        if kept is not None:
            kept = replace(kept, std=none * kept.std, covariance=none * kept.covariance, then=none * kept.then)
        return replace(self, std=none * self.std, covariance=None if whole is None else none * whole, kept=kept)

    def _kept(self) -> Kept:
        if self.kept is None:
            raise ValueError("the smoother has kept no covariance")
        return self.kept


def _places(wanted: np.ndarray, there: np.ndarray) -> np.ndarray:
    at = [np.flatnonzero(there == one) for one in wanted]
    if not all(len(found) for found in at):
        raise ValueError("the smoother has not kept this covariance")
    return np.array([found[0] for found in at], dtype=int)


class Keeping:
    """The arrays of the covariances that are kept while a smoother runs over T + 1 instants of n* states."""

    def __init__(self, wanted: Wanted | None, instants: int, n: int):
        self.covariance = np.zeros((instants, 1, n, n)) if wanted is None else None
        self.kept: Kept | None = None
        if wanted is not None:
            r, k, i = wanted.rows.shape[-2], len(wanted.states), len(wanted.instants)
            self.kept = Kept(wanted, np.zeros((instants, r)), np.zeros((instants, k, k)), np.zeros((i, n, n)))

    def take(self, at: slice, covariance: np.ndarray) -> None:
        """covariance (L, n*, n*) of a piece."""
        if self.covariance is not None:
            self.covariance[at, 0] = covariance
        if (own := self.kept) is not None:
            states, instants = own.wanted.states, own.wanted.instants
            rows = own.wanted.rows
            own.std[at] = output_std(rows[at] if rows.ndim > 2 else rows, covariance)
            own.covariance[at] = covariance[:, states[:, None], states]
            here = np.flatnonzero((at.start <= instants) & (instants < at.stop))
            own.then[here] = covariance[instants[here] - at.start]


def smooth(model: FilterModel | StepModel, run: FilterRun, covariance: bool = False) -> Smoothed:
    """The Rauch-Tung-Striebel estimate in the adjoint form of Bryson and Frazier, which inverts neither P nor P⁻:

        x̂ˢ = x̂ − P λ,      λ⁻ = (I − KH)ᵀλ − HᵀS⁻¹ν,             λ ← Aᵀλ⁻
        Pˢ = P − P Λ P,     Λ⁻ = (I − KH)ᵀΛ(I − KH) + HᵀS⁻¹H,      Λ ← AᵀΛ⁻A

    backwards from λ = 0, Λ = 0 at the last instant.

    run: `run_filter(..., keep="all")` or `run_sigma_points` of the same model, in any form and by any update. A singular
    P⁻ (states without process noise) needs no care.
    A nonlinear model is smoothed along the Jacobians, or the regressions, that its filter used.
    Raises ValueError where the run was not kept, or the first one alone of several.
    Source: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973).
    """
    if run.covariance is None or run.jacobian is None or run.rows is None or run.adjusted is None:
        raise ValueError("the smoother needs a run kept with keep='all'")
    if run.covariance.shape[1] != run.unknown_covariance.shape[1]:
        raise ValueError("only the first run was kept")
    core = Driven(model, np.zeros((0, HOLD, 0))) if isinstance(model, FilterModel) else model
    steps, runs, channels = run.innovation.shape
    b, size = run.covariance.shape[1:3]
    missing = np.isnan(run.adjusted) if b > 1 else np.isnan(run.adjusted).all(axis=1, keepdims=True)
    whitened = np.nan_to_num(run.adjusted)
    adjoint, information = np.zeros((runs, size)), np.zeros((b, size, size))
    mean, std = np.empty_like(run.mean), np.empty((steps + 1, b, size))
    kept = np.empty_like(run.covariance) if covariance else None
    for k in range(steps, -1, -1):
        P = run.covariance[k]
        PInformation = P @ information
        mean[k] = run.mean[k] - apply(P, adjoint)
        std[k] = np.sqrt(np.maximum(standard_deviation(P) ** 2 - np.sum(PInformation * P, axis=-1), 0.0))
        if kept is not None:
            kept[k] = symmetric(P - PInformation @ P)
        if k == 0:
            break
        A = run.jacobian[k - 1]
        if not missing[k - 1].all():
            H, before = run.rows[k - 1], core.before(k - 1)
            H = np.where(missing[k - 1][..., None], 0.0, H) if missing[k - 1].any() else H
            P = run.covariance[k - 1] if before is None else run.covariance[k - 1] + before
            R = np.broadcast_to(core.noise(k - 1), (b, channels)) if run.noise is None else run.noise[k - 1]
            process = core.process(k - 1) if run.process is None else run.process[k - 1]
            K, L = gain(predict(P, A, process), H, R, instant=run.time[k])
            whitened_rows = np.linalg.solve(L, np.broadcast_to(H, (b, channels, size)))
            left = np.eye(size) - K @ H
            adjoint = apply(transposed(left), adjoint) - apply(transposed(whitened_rows), whitened[k - 1])
            information = transposed(left) @ information @ left + transposed(whitened_rows) @ whitened_rows
        adjoint = apply(transposed(A), adjoint)
        information = symmetric(transposed(A) @ information @ A)
    return Smoothed(run.time, mean, np.broadcast_to(std, mean.shape), kept)


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

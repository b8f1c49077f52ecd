"""The augmented extended Kalman filter (1.53-1.60) for a batch of runs of any model with a step and a measurement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import StepModel, driven_with_offsets
from strainsight.estimation.run import FilterRun, Keep, RunArrays
from strainsight.estimation.sigma_point import SigmaPoints, sigma_points
from strainsight.estimation.update import Form, Transition, apply, belief_of, transpose, whiten

HALVINGS = 12
"""Most halvings of an increment that fails or increases the cost."""
SETTLED = 1e-6
"""The iteration ends when the next increment is shorter than this many standard deviations."""

SHORT = 1e-3
"""A shorter increment in standard deviations is accepted regardless of the cost, whose change may be less than its rounding."""
LAST, IDLE = 3.0, 10.0
"""Multiples of SETTLED. An increment shorter than LAST that has decreased to a tenth is accepted to first order without another
step, at an error below 1e-11 of a standard deviation. One shorter than IDLE that no longer decreases is rounding. If x is
projected on constraints, an increment shorter than SHORT is accepted if the next one is expected to be shorter than LAST."""


@dataclass(frozen=True)
class RefinedState:
    """Result of the iteration: x (B, n) after the step; A, H (b, n, n), (b, m, n) there; innovation (B, m) of the linear model,
    y − h(x) − H(x̂⁻ − x) with x̂⁻ = f(ξ) + A(x̂ − ξ); iterations (B,)."""

    x: np.ndarray
    A: np.ndarray
    H: np.ndarray
    innovation: np.ndarray
    iterations: np.ndarray


def refine(
    model: StepModel,
    k: int,
    x: np.ndarray,
    prior: np.ndarray,
    process: np.ndarray | None,
    R: np.ndarray,
    measured: np.ndarray,
    most: int,
    damped: bool = True,
    restored: bool = False,
) -> RefinedState:
    """The most probable start ξ and disturbance w of a step, given its measurement, by damped Gauss-Newton:

        min ½(ξ − x̂)ᵀ prior⁻¹(ξ − x̂) + ½wᵀ process⁻¹ w + ½(y − h(f(ξ) + w))ᵀR⁻¹(y − h(f(ξ) + w))

    The iterates are kept as ξ = x̂ + prior μ, w = process ν, so that neither covariance is inverted and both may be
    singular; an increment that raises the cost or whose step fails is halved, for each run alone. Without process noise
    the corrected state is an outcome of f, on whatever constraints f keeps to.

    x (B, n), prior (b, n, n) [with `before`] before the step k, process (b, n, n) or (n, n) after it; process None: x and
    prior stand behind the step, f is the identity, and this is the iterated extended Kalman filter;
    R (b, m); measured y (B, m), NaN where missing; most: iterations; damped False: every increment is taken as it is, and
    a step that fails leaves NaN in its run; restored: whether x is put back on constraints behind this, so that it may leave them
    to second order in an increment of SHORT.
    Source: Bell and Cathey, IEEE Trans. Automatic Control 38 (1993); García-Fernández et al., Signal Processing 2021."""
    sampled, y = np.isfinite(measured), np.nan_to_num(measured)
    stays = process is None
    identity = np.eye(model.size)[None]
    Q = 0 * identity if process is None else process if process.ndim == 3 else process[None]

    def evaluate(mu: np.ndarray, nu: np.ndarray) -> tuple[np.ndarray, ...]:
        xi, w = x + apply(prior, mu), apply(Q, nu)
        forward, A = (xi, identity) if stays else model.step(xi, k)
        after = forward + w
        read, H = model.measure(after, k)
        residual = np.where(sampled, y - read, 0.0)
        H = np.where(sampled[..., None], H, 0.0)
        cost = np.sum(mu * apply(prior, mu), axis=-1) + np.sum(nu * apply(Q, nu), axis=-1)
        cost = cost + np.sum(residual**2 / R, axis=-1)
        return after, A, H, residual + apply(H, apply(A, xi - x) + w), np.where(np.isfinite(cost), cost, np.inf)

    mu, nu = np.zeros_like(x), np.zeros_like(x)
    after, A, H, effective, cost = evaluate(mu, nu)
    iterations, going = np.zeros(len(x), dtype=int), np.ones(len(x), dtype=bool)
    before = np.full(len(x), np.inf)
    for _ in range(most):
        towards_mu, towards_nu = _duals(A, H, prior, Q, R, effective)
        d_mu, d_nu = towards_mu - mu, towards_nu - nu
        length = np.sum(d_mu * apply(prior, d_mu), axis=-1) + np.sum(d_nu * apply(Q, d_nu), axis=-1)
        going &= length > SETTLED**2
        going &= (length > (IDLE * SETTLED) ** 2) | (length < 0.01 * before)
        quick = restored & np.isfinite(before) & (length < SHORT**2) & (length**2 < (LAST * SETTLED) ** 2 * before)
        last = going & (quick | (length < (LAST * SETTLED) ** 2))
        if last.any():
            moved = apply(A, apply(prior, d_mu)) + apply(Q, d_nu)
            after, iterations, going = np.where(last[:, None], after + moved, after), iterations + last, going & ~last
        before = np.where(going, length, before)
        share = np.where(going, 1.0, 0.0)
        for _ in range(HALVINGS if damped else 1):
            if not share.any():
                break
            trial_mu, trial_nu = mu + share[:, None] * d_mu, nu + share[:, None] * d_nu
            try:
                trial = evaluate(trial_mu, trial_nu)
            except NumericalError:  # of the step itself, for the whole batch
                if not damped:
                    raise
                share *= 0.5
                continue
            better = (trial[4] <= cost * (1 + 1e-12)) | ((length < SHORT**2) & np.isfinite(trial[4])) | (not damped)
            better &= share > 0
            iterations += better
            mu, nu = np.where(better[:, None], trial_mu, mu), np.where(better[:, None], trial_nu, nu)
            after, A, H, effective, cost = (
                _select(better, new, old) for new, old in zip(trial, (after, A, H, effective, cost), strict=True)
            )
            share = np.where(better, 0.0, 0.5 * share)
        going &= share == 0
        if not going.any():
            break
    return RefinedState(after, A, H, effective, iterations)


def _duals(
    A: np.ndarray, H: np.ndarray, prior: np.ndarray, Q: np.ndarray, R: np.ndarray, effective: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(HA)ᵀλ and Hᵀλ with λ = S⁻¹ × the effective innovation, S = HA prior (HA)ᵀ + H Q Hᵀ + R."""
    HA = H @ A
    S = HA @ prior @ transpose(HA) + H @ Q @ transpose(H)
    diagonal = range(R.shape[-1])
    S[..., diagonal, diagonal] += R
    try:
        multiplier = np.linalg.solve(S, effective[..., None])
    except np.linalg.LinAlgError as error:
        raise NumericalError(
            "the innovation covariance is singular",
            remedy="remove sensors that measure the same, or increase the sensor noise above the rounding error of the readings",
        ) from error
    return (transpose(HA) @ multiplier)[..., 0], (transpose(H) @ multiplier)[..., 0]


def _select(better: np.ndarray, new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """`new` for the runs that improved, `old` for the others; shared arrays (1, …) are new if any run improved."""
    if len(new) != len(better):
        return new if better.any() else old
    return np.where(better.reshape(-1, *(1,) * (new.ndim - 1)), new, old)


UNMOVED, CALM = 2e-15, 20
"""A shared covariance is steady after CALM steps in which no entry moved by more than UNMOVED of its standard deviations."""


def run_filter(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    keep: Keep = "mean",
    *,
    biased: np.ndarray | None = None,
    by_points: bool = False,
    **options: Any,
) -> FilterRun:
    """`filter_runs` of the reduced model under known loads, with its options. known (T, HOLD, n_known) hold coefficients [N];
    measurement (T/every, m) or (T/every, B, m), one row a sample; biased (b,): channels with an unknown offset, behind x* in
    mean, covariance and all that is estimated; by_points: the sigma-point filter. Raises ValueError where the known loads end
    before the samples."""
    core, samples = driven_with_offsets(model, known, biased), model.by_step(measurement)
    if len(known) < len(samples):
        raise ValueError(
            f"the known loads cover {len(known)} time steps, but the measurements cover {len(samples)} time steps"
        )
    points = sigma_points(model, core, known, biased) if by_points else None
    return filter_runs(core, mean, covariance, samples, keep, points=points, **options)


def filter_runs(
    model: StepModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    measurement: np.ndarray,
    keep: Keep = "mean",
    *,
    form: Form = "joseph",
    points: SigmaPoints | None = None,
    iterations: int = 1,
    through_step: bool = False,
    damped: bool = True,
    project: Callable[[np.ndarray, int], np.ndarray] | None = None,
    progress: Callable[[int], None] | None = None,
    watch: Callable[[int, np.ndarray, np.ndarray], None] | None = None,
    refuse: bool = True,
) -> FilterRun:
    """Predict with the step, update with the measurement, T times, for B runs at once:

        x̂⁻ = f(x̂),   P⁻ = A (P + before) Aᵀ + process     (1.57),   then the update (1.58-1.60)

    mean (n,) or (B, n) and covariance (n, n) or (B, n, n) of x at t = 0, which may be singular;
    measurement (T, m) or (T, B, m) at h, 2h, … (NaN: missing; a step without any costs no update);
    keep "all" stores what the smoother needs (2 T b n² numbers, 3 where the model finds its process noise on the way), "first"
    that of the first run.
    form: "joseph", or "square_root", which carries a factor of P and serves noise so small that P spans more digits than
    a number has. points: regressions in place of Jacobians, without iterations. iterations: 1 is the extended Kalman filter,
    more make the update a damped Gauss-Newton iteration, through_step with the step inside (`refine`); a linear model has
    nothing to iterate. damped: whether an increment that raises the cost or fails is halved. project: puts x (B, n) at
    instant k back on constraints after every update, its covariance is left as it is. progress: called with every step that
    begins; watch: with every instant k, x (B, n) and P (b, n, n) after the update, the start (k = 0) first.
    A covariance that no run changes (linear, one set of sensors, the same samples missing in all) is computed once for all runs,
    and not again once it is steady, as long as no sample is missing and the noise is the same.
    Raises NumericalError where every run diverges and `refuse`, or where HPHᵀ + R is not positive definite."""
    y = measurement if measurement.ndim == 3 else measurement[:, None, :]
    measured = np.isfinite(y)
    sets = max(model.sets, len(covariance) if covariance.ndim == 3 else 1)
    runs = max(y.shape[1], sets, mean.size // model.size)
    b = 1 if sets == 1 and model.linear and np.all(measured == measured[:, :1]) else runs
    measured = measured[:, :1] if b == 1 else np.broadcast_to(measured, (len(y), runs, y.shape[2]))
    iterating = (iterations > 1 or through_step) and not model.linear

    x = np.broadcast_to(mean, (runs, model.size)).astype(float)
    P = np.broadcast_to(covariance, (b, model.size, model.size)).astype(float)
    start, belief = (x.copy(), P.copy()), belief_of(form, P)
    # a model of one set of noises that has one for every run has found them on the way, and `process` will not tell later
    each = model.sets == 1 and model.process(0).ndim == 3
    record = RunArrays(model, len(y), runs, b, keep, iterating, regressed=points is not None, each=each)
    record.state(0, x, P)
    if watch is not None:
        watch(0, x, P)
    prior, G, L, calm = belief, P, P, 0
    same: tuple[np.ndarray | None, ...] = (None, None, None)
    for k in range(len(y)):
        if progress is not None:
            progress(k)
        model.begin(x, k)
        instant, noise = (k + 1) * model.h, (model.before(k), model.process(k), model.noise(k))
        before, process, R = *noise[:2], np.broadcast_to(noise[2], (b, y.shape[2]))
        calm = calm if all(new is old for new, old in zip(noise, same, strict=True)) and measured[k].all() else 0
        same = noise
        if points is None:
            ahead, A = model.step(x, k)
        else:
            ahead, A, process = points.step(x, P, k)
        A = _where_it_failed(ahead, A, np.eye(model.size))
        H: np.ndarray | None = None
        adjusted = None
        step = Transition(A, process, before)
        if not measured[k].any():
            x, belief = ahead, belief.predicted(step)
        else:
            at_once = calm < CALM and not (through_step and iterating)
            prior = belief.predicted(step) if at_once else prior
            if points is None:
                expected, H = model.measure(ahead, k)
            else:
                expected, H, R = points.measure(ahead, prior.covariance, R, measured[k], k)
            record.innovation[k] = y[k] - expected
            innovation, H = record.innovation[k], _where_it_failed(ahead, H, 0.0)
            if not measured[k].all():
                H, innovation = np.where(measured[k][..., None], H, 0.0), np.nan_to_num(innovation)
            if through_step and iterating:
                L = belief.expected(step, H, R, instant)
            elif at_once:
                after, G, L = prior.updated(H, R, instant)
            adjusted = whiten(L, innovation)
            record.whitened[k], record.spread[k] = adjusted, np.diagonal(L, axis1=-2, axis2=-1)
            if not iterating:
                x, belief = ahead + apply(G, adjusted), after
            else:
                if through_step:
                    full = belief.covariance if before is None else belief.covariance + before
                    refined = refine(model, k, x, full, process, R, y[k], iterations, damped, project is not None)
                    A = _where_it_failed(refined.x, refined.A, np.eye(model.size))
                    prior = belief.predicted(Transition(A, process, before))
                else:
                    refined = refine(model, k, ahead, prior.covariance, None, R, y[k], iterations, damped)
                x, H = refined.x, _where_it_failed(refined.x, refined.H, 0.0)
                belief, _, L = prior.updated(H, R, instant)
                adjusted = whiten(L, refined.innovation)
                record.spread[k] = np.diagonal(L, axis1=-2, axis2=-1)
            if project is not None:
                x = project(x, k + 1)
        astray = record.astray(k, x, refuse)
        if astray.any():
            x = np.where(astray[:, None], start[0], x)
            belief = belief if b == 1 else belief.reset(astray, start[1])
        latest = None
        if calm < CALM:
            last, latest = P, belief.covariance
            P = latest
            calm = (
                calm + 1 if b == 1 and model.linear and H is not None and _is_steady(last, P, prior.covariance) else 0
            )
        record.state(k + 1, x, latest)
        record.readings(k, *model.measure(x, k), latest)
        record.linearised(k, A, H, adjusted, process, R)
        if watch is not None:
            watch(k + 1, x, P)
    return record.finished(P, measured)


def _where_it_failed(x: np.ndarray, X: np.ndarray, instead: np.ndarray | float) -> np.ndarray:
    """X (b, ., .) with `instead` in the runs with non-finite x (B, n), which diverged and must not affect the others."""
    failed = ~np.isfinite(x.sum(axis=1))
    return np.where(failed[:, None, None], instead, X) if failed.any() and len(X) == len(failed) else X


def _is_steady(last: np.ndarray, P: np.ndarray, prior: np.ndarray) -> bool:
    """Whether P (1, n, n) is unchanged, up to the rounding of the prior covariance."""
    size = np.sqrt(np.diagonal(prior[0]))
    return bool(np.all(np.abs(P[0] - last[0]) <= UNMOVED * size[:, None] * size))

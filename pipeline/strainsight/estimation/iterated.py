"""The iterated update: Gauss-Newton on the most probable state, with the measurement or the whole step inside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.core import StepModel
from strainsight.estimation.update import apply, transposed

HALVINGS = 12
"""How often an increment that fails or raises the cost is halved before it is given up."""
SETTLED = 1e-6
"""The iteration ends when the next increment is shorter than this many standard deviations."""

SHORT = 1e-3
"""An increment of fewer standard deviations is taken whatever the cost says: the 1e-6 it is worth may be less than the
rounding of the cost where the noise is small."""
LAST, IDLE = 3.0, 10.0
"""Times SETTLED: an increment shorter than LAST that has shrunk to a tenth is taken to first order, without another step,
which leaves out less than 1e-11 of a standard deviation; one shorter than IDLE that shrinks no more is rounding. Where x is put
back on constraints one shorter than SHORT is taken so, too, if the next, shrunk as much again, would be shorter than LAST: what
the first order leaves out is no larger than that."""


@dataclass(frozen=True)
class Refined:
    """Where the iteration ended: x (B, n) after the step; A, H (b, n, n), (b, m, n) there; innovation (B, m) of the
    linear model along them, y − h(x) − H(x̂⁻ − x) with x̂⁻ = f(ξ) + A(x̂ − ξ); iterations (B,) taken."""

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
) -> Refined:
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
    Source: Bell and Cathey, IEEE Trans. Automatic Control 38 (1993); García-Fernández et al., Signal Processing 2021.
    """
    there = np.isfinite(measured)
    y = np.nan_to_num(measured)
    stays = process is None
    identity = np.eye(model.size)[None]
    Q = 0 * identity if process is None else process if process.ndim == 3 else process[None]

    def evaluate(mu: np.ndarray, nu: np.ndarray) -> tuple[np.ndarray, ...]:
        xi, w = x + apply(prior, mu), apply(Q, nu)
        forward, A = (xi, identity) if stays else model.step(xi, k)
        after = forward + w
        read, H = model.measure(after, k)
        residual = np.where(there, y - read, 0.0)
        H = np.where(there[..., None], H, 0.0)
        cost = np.sum(mu * apply(prior, mu), axis=-1) + np.sum(nu * apply(Q, nu), axis=-1)
        cost = cost + np.sum(residual**2 / R, axis=-1)
        return after, A, H, residual + apply(H, apply(A, xi - x) + w), np.where(np.isfinite(cost), cost, np.inf)

    mu, nu = np.zeros_like(x), np.zeros_like(x)
    after, A, H, effective, cost = evaluate(mu, nu)
    taken, going = np.zeros(len(x), dtype=int), np.ones(len(x), dtype=bool)
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
            after, taken, going = np.where(last[:, None], after + moved, after), taken + last, going & ~last
        before = np.where(going, length, before)
        share = np.where(going, 1.0, 0.0)
        for _ in range(HALVINGS if damped else 1):
            if not share.any():
                break
            trial_mu, trial_nu = mu + share[:, None] * d_mu, nu + share[:, None] * d_nu
            try:
                found = evaluate(trial_mu, trial_nu)
            except NumericalError:  # of the step itself, for the whole batch
                if not damped:
                    raise
                share *= 0.5
                continue
            better = (found[4] <= cost * (1 + 1e-12)) | ((length < SHORT**2) & np.isfinite(found[4])) | (not damped)
            better &= share > 0
            taken += better
            mu, nu = np.where(better[:, None], trial_mu, mu), np.where(better[:, None], trial_nu, nu)
            after, A, H, effective, cost = (
                _chosen(better, new, old) for new, old in zip(found, (after, A, H, effective, cost), strict=True)
            )
            share = np.where(better, 0.0, 0.5 * share)
        going &= share == 0
        if not going.any():
            break
    return Refined(after, A, H, effective, taken)


def _duals(
    A: np.ndarray, H: np.ndarray, prior: np.ndarray, Q: np.ndarray, R: np.ndarray, effective: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(HA)ᵀλ and Hᵀλ with λ = S⁻¹ × the effective innovation, S = HA prior (HA)ᵀ + H Q Hᵀ + R."""
    HA = H @ A
    S = HA @ prior @ transposed(HA) + H @ Q @ transposed(H)
    diagonal = range(R.shape[-1])
    S[..., diagonal, diagonal] += R
    try:
        multiplier = np.linalg.solve(S, effective[..., None])
    except np.linalg.LinAlgError as error:
        raise NumericalError(
            "the innovation covariance is singular",
            remedy="two sensors may be the same, or the noise stated is below what a number resolves",
        ) from error
    return (transposed(HA) @ multiplier)[..., 0], (transposed(H) @ multiplier)[..., 0]


def _chosen(better: np.ndarray, new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """`new` for the runs that are better, `old` for the others; what all runs share (1, …) is new where any is better."""
    if len(new) != len(better):
        return new if better.any() else old
    return np.where(better.reshape(-1, *(1,) * (new.ndim - 1)), new, old)

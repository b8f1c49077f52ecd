"""Errors of a smoother, drawn as whole histories: what every instant is off by together with all others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.bank import BankRun
from strainsight.estimation.bank_smoother import AtPoints, kept_at, points_of, smoothed_at_points
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.consider_smoother import consider_errors
from strainsight.estimation.mixture import KERNEL
from strainsight.estimation.model import FilterModel, StepModel
from strainsight.estimation.reduced import Settled
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


AT_ONCE = 20_000_000
"""Numbers of the histories that are drawn at a time."""


@dataclass(frozen=True)
class Paths:
    """N draws: parameter (N, k) p = ln(θ/guess), which is constant; state (N, T + 1, n + f) of what was asked for, behind it z of
    `Beyond`."""

    parameter: np.ndarray
    state: np.ndarray


def bank_paths(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    nuisances: Nuisances,
    bank: BankRun,
    count: int,
    seed: int,
    biased: np.ndarray | None = None,
    settled: Settled | None = None,
    states: slice = slice(None),
    record: int = 0,
) -> Iterator[Paths]:
    """`count` draws in parts; arguments as of `smooth_bank`; states: which of [q, q̇, ζ, offsets].

    record: number of the record among those of `bank`: draws of one seed have the constants of all records in common, and the
    rest of each record for itself.

        x = x̂ˢ(p) − w − V(ν − ν̂),     x̂ˢ(p) = x̂ˢ(p̄) + Σᵢ zᵢ sᵢ + ½ zᵢ² cᵢ,     p = p̄ + L z,   L Lᵀ the covariance of p

    p and ν are drawn together from the points of the bank with normal kernels (`marginal`), w with the gains at each of the 2k
    points θⱼ of `smooth_bank` in turn (`consider_errors`, `smoother_errors`). First and second differences s and c over
    x̂ˢ(θⱼ) carry the mean to p. So mean and covariance of the draws are those that `smooth_bank` claims at every instant, but for
    products of curvatures c, which its rule of degree three does not see; and instants belong together as the smoother's errors
    do. A part depends on seed, its number and its size. Source: Durbin and Koopman, Biometrika 89 (2002).
    """
    found = points_of(model, mean, covariance, known, measurement, nuisances, bank, biased, settled)
    x, V = smoothed_at_points(found, mean, covariance, known, biased, settled)
    rng = np.random.default_rng(seed)
    p, nu = _constants(found, bank, count, rng)
    rng = np.random.default_rng((seed, record)) if record else rng
    beyond = found.beyond
    steps, sizes = len(known), found.models.H.shape[-1] + len(beyond.own)
    points, k = len(found.points), len(found.centre)
    part = max(points, AT_ONCE // ((steps + 1) * sizes) // points * points)
    z = np.linalg.solve(np.linalg.cholesky(found.spread), (p - found.centre).T).T
    middle, slope, bend = _carried(x, k)
    load, nu_of_loads = beyond.load(x[:points].mean(axis=0)), (nu + found.corrected)[:, beyond.own]
    for start in range(0, count, part):
        own = slice(start, min(start + part, count))
        each = -(-(own.stop - own.start) // points)
        error = _errors(found, known, biased, each, rng, states)[: own.stop - own.start]
        error += middle[None, :, states]
        for i in range(k):
            here = z[own, i, None, None]
            error += here * slope[i, :, states] + 0.5 * (here**2 - 1) * bend[i, :, states]
        error -= np.einsum("nd,tda->nta", nu[own], V[:, :, states], optimize=True)
        yield Paths(p[own], np.concatenate([error, nu_of_loads[own, None] * load], axis=2))


def _constants(found: AtPoints, bank: BankRun, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """p (N, k) and ν − ν̂ (N, d), together."""
    k, d = len(found.centre), len(found.nu)
    joint = np.hstack([bank.point, bank.nu])
    centre = np.concatenate([found.centre, bank.weight @ bank.nu])
    off = joint - centre
    covariance = (off * bank.weight[:, None]).T @ off
    std = np.sqrt(np.diag(covariance)[:k])
    # one share of the covariance is the kernels', the rest that of their centres drawn together
    share = float(np.minimum(1.0, (KERNEL * bank.step / std) ** 2).max(initial=0.0)) if k else 0.0
    # one draw in every N-th part of the weight
    place = (rng.permutation(count) + rng.random(count)) / count
    which = np.minimum(np.searchsorted(np.cumsum(bank.weight), place), len(bank.weight) - 1)
    factor = covariance_factor(covariance)
    kernel = rng.standard_normal((count, factor.shape[1])) @ factor.T
    drawn = np.sqrt(1 - share) * off[which] + np.sqrt(share) * kernel
    left = covariance_factor(found.left - covariance[k:, k:]) if d else np.zeros((0, 0))
    return found.centre + drawn[:, :k], drawn[:, k:] + rng.standard_normal((count, left.shape[1])) @ left.T


def _carried(x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of x̂ˢ (2k + 1, T + 1, n) at the points and the centre: mean (T + 1, n) over the points, first and second derivatives
    (k, T + 1, n) in z."""
    if k == 0:
        nothing = np.zeros((0, *x.shape[1:]))
        return x[0], nothing, nothing
    ahead, behind, centre = x[:k], x[k : 2 * k], x[-1]
    return x[:-1].mean(axis=0), (ahead - behind) / (2 * np.sqrt(k)), (ahead + behind - 2 * centre) / k


def _errors(
    found: AtPoints,
    known: np.ndarray,
    biased: np.ndarray | None,
    each: int,
    rng: np.random.Generator,
    states: slice,
) -> np.ndarray:
    """−w (each · points, T + 1, n), the points one after the other."""
    points = len(found.points)
    if found.considered:
        error = consider_errors(
            found.models.of(slice(points)),
            (found.start[0][:points], found.start[1], found.start[2][:points]),
            *found.record,
            each,
            rng,
        )[..., states]
    else:
        offsets = np.zeros(0, dtype=int) if biased is None else biased
        parts = []
        for point, x0 in zip(found.points, found.start[0], strict=False):
            core, run = kept_at(
                found.model, point, x0, found.start[1], known, found.samples[:, None], offsets, found.nuisances
            )
            parts.append(smoother_errors(core, run, each, rng, states))
        error = np.stack(parts)
    return np.swapaxes(error, 0, 1).reshape(each * points, *error.shape[2:])

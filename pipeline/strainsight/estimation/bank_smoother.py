"""The smoother of a bank: all samples on every instant, over the posterior of the parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.bank import BankRun
from strainsight.estimation.biased import Biased
from strainsight.estimation.conditional import (
    Nuisances,
    conditional_states,
    discrepancy,
    known_ends,
    linear_models,
    theta_at,
)
from strainsight.estimation.consider_smoother import consider_smoothed
from strainsight.estimation.core import StepModel
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.mixture import removed_of
from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import LinearModels
from strainsight.estimation.reduced import Driven
from strainsight.estimation.run import FilterRun
from strainsight.estimation.settled import Settled, beginning
from strainsight.estimation.smoother import Smoothed, smooth
from strainsight.estimation.update import standard_deviation


def smooth_bank(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    nuisances: Nuisances,
    bank: BankRun,
    biased: np.ndarray | None = None,
    settled: Settled | None = None,
) -> Smoothed:
    """Smoothed x* with its covariance, tolerances in it; arguments as of `filter_bank`, which found `bank`.

        x̂ˢ = Σ wⱼ x̂ˢ(θⱼ),   Pˢ = Σ wⱼ (Pˢ(θⱼ) + (x̂ˢ(θⱼ) − x̂ˢ)(…)ᵀ) + Σₖ vₖvₖᵀ

    with the 2k points θⱼ of the cubature rule of degree three on the posterior of k parameters, which a motion that is smooth
    in them needs no more of; `bank_paths` draws histories of this mean and covariance. Where ν is learned, v is what the
    smoother, linear in its samples, makes of those that one of a nuisance causes, less the motion that it causes; otherwise that
    of gains that consider ν (`consider_smoothed`).
    Source: Arasaratnam and Haykin, IEEE Trans. Automatic Control 54 (2009).
    """
    found = at_points(model, mean, covariance, known, measurement, nuisances, bank, biased, settled)
    x, P, V, nu, left = found.x, found.P, found.V, found.nu, found.left
    points, centre, spread = found.points, found.centre, found.spread
    at, steps, k = conditional_states(model, 0 if biased is None else len(biased)), len(known), len(centre)
    middle = x.mean(axis=0)
    off = x - middle
    # regression of the motion on the parameters over the points, for what a nuisance does by way of them
    cross = np.einsum("bta,bi->tai", off, points - centre) / len(points)
    slope = cross @ np.linalg.inv(spread) if k else cross
    n = len(mean)
    parameters = np.arange(n)[model.parameter_states]
    whole, cov = np.zeros((steps + 1, n)), np.zeros((steps + 1, n, n))
    whole[:, at], whole[:, parameters] = middle, centre
    cov[:, at[:, None], at] = P.mean(axis=0) + np.einsum("bta,btc->tac", off, off, optimize=True) / len(points)
    cov[:, at[:, None], parameters], cov[:, parameters[:, None], at] = cross, np.swapaxes(cross, 1, 2)
    cov[:, parameters[:, None], parameters] = spread
    # ν has a covariance with itself and with the parameters that the samples leave
    off_nu, off_p = bank.nu - nu, bank.point - centre
    with_p = (off_p * bank.weight[:, None]).T @ off_nu
    joint = np.einsum("tai,id,tdc->tac", slope, with_p, V, optimize=True)
    cov[:, at[:, None], at] += np.einsum("tda,dk,tkc->tac", V, left, V, optimize=True)
    cov[:, at[:, None], at] -= joint + np.swapaxes(joint, 1, 2)
    by_p = np.einsum("tda,id->tai", V, with_p)
    cov[:, at[:, None], parameters] -= by_p
    cov[:, parameters[:, None], at] -= np.swapaxes(by_p, 1, 2)
    return Smoothed(bank.run.time, whole[:, None], standard_deviation(cov)[:, None], cov[:, None])


@dataclass(frozen=True)
class AtPoints:
    """The smoother at b points (b, k) of the parameters: x (b, T + 1, n) of the states but the parameters, P (b, T + 1, n, n) of
    what no nuisance explains of its error; V (T + 1, d, n), what one of each adds to x̂ˢ − x; nu (d,) and left (d, d): mean and
    covariance of ν that σ holds.

    centre (k,), spread (k, k): the posterior; points: its cubature rule, the k ends ahead and those behind. model: with the
    discrepancy in its noise; models: linear at the points and behind them at the centre, with start (x₀, P₀, V₀); samples (T, m)
    of every step; centred (T + 1, n): x at the centre, where gains consider ν.
    """

    points: np.ndarray
    centre: np.ndarray
    spread: np.ndarray
    x: np.ndarray
    P: np.ndarray
    V: np.ndarray
    nu: np.ndarray
    left: np.ndarray
    model: FilterModel
    models: LinearModels
    start: tuple[np.ndarray, np.ndarray, np.ndarray]
    samples: np.ndarray
    considered: bool
    centred: np.ndarray | None = None

    @property
    def noise(self) -> np.ndarray:
        """Variances (T, m) of the samples."""
        own = self.model.noise
        return own[:, 0] if own.ndim == 3 else np.broadcast_to(own, self.samples.shape)


def at_points(
    model: FilterModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    measurement: np.ndarray,
    nuisances: Nuisances,
    bank: BankRun,
    biased: np.ndarray | None,
    settled: Settled | None,
) -> AtPoints:
    """Arguments as of `smooth_bank`."""
    offsets = np.zeros(0, dtype=int) if biased is None else biased
    at = conditional_states(model, len(offsets))
    every, steps, m = model.every, len(known), model.H.shape[-2]
    samples = np.full((steps, m), np.nan)
    samples[every - 1 :: every] = measurement
    centre, spread = bank.posterior
    k = len(centre)
    ends = np.sqrt(k) * np.linalg.cholesky(spread).T
    points = np.concatenate([centre + ends, centre - ends]) if k else centre[None]
    model = replace(model, r=model.r + every * model.h * discrepancy(model, nuisances, measurement))
    nu, left = bank.nuisances
    models = linear_models(model, np.concatenate([points, centre[None]]), nuisances, offsets)
    start = beginning(model, models, mean[at], covariance[np.ix_(at, at)], settled)
    considered = bool(len(nu)) and not nuisances.learned
    nothing = np.zeros(0)
    empty = AtPoints(
        points, centre, spread, nothing, nothing, nothing, nu, left, model, models, start, samples, considered
    )
    if considered:
        ends = known_ends(known, nuisances)
        by = consider_smoothed(models, start, known.reshape(steps, -1), ends, samples, empty.noise)
        # what the samples say of ν is neither in the motion nor in its σ
        return replace(empty, x=by.x[:-1], P=by.P[:-1], V=by.V[-1], left=left + removed_of(left), centred=by.x[-1])
    before = covariance[np.ix_(at, at)]
    x, P, V = _corrected(model, points, centre, mean[at], before, known, samples, nuisances, nu, offsets, settled)
    return replace(empty, x=x, P=P, V=V)


def smoothed_at_centre(
    found: AtPoints,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    nuisances: Nuisances,
    biased: np.ndarray | None,
    settled: Settled | None,
) -> np.ndarray:
    """x (T + 1, n) at the centre; arguments as of `at_points`, which found the others."""
    if found.centred is not None:
        return found.centred
    offsets = np.zeros(0, dtype=int) if biased is None else biased
    at, centre, nu = conditional_states(found.model, len(offsets)), found.centre, found.nu
    before = covariance[np.ix_(at, at)]
    return _corrected(
        found.model, centre[None], centre, mean[at], before, known, found.samples, nuisances, nu, offsets, settled
    )[0][0]


def _corrected(
    model: FilterModel,
    points: np.ndarray,
    centre: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    samples: np.ndarray,
    nuisances: Nuisances,
    nu: np.ndarray,
    biased: np.ndarray,
    settled: Settled | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x (b, T + 1, n) at points (b, k), without what the mean of ν (d,) makes of samples and motion; P; V (T + 1, d, n) at the
    centre (k,)."""
    start, P0, _ = beginning(model, linear_models(model, points, nuisances, biased), mean, covariance, settled)

    def at_points(values: np.ndarray) -> list[Smoothed]:
        return [
            smoothed_at(model, point, x0, P0, known, values[:, None], biased)
            for point, x0 in zip(points, start, strict=True)
        ]

    middle = np.mean([own.mean[:, 0] for own in at_points(samples)], axis=0)
    caused, own, V = _effects(model, centre, covariance, known, middle, nuisances, biased, settled)
    found = at_points(samples - caused @ nu)
    x = np.stack([each.mean[:, 0] for each in found]) + np.einsum("tda,d->ta", own, nu)
    return x, np.stack([_covariance(each) for each in found]), V


def smoothed_at(
    model: FilterModel,
    point: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    samples: np.ndarray,
    biased: np.ndarray,
) -> Smoothed:
    """At parameters p (k,), for runs of samples (T, B, m); mean (n,), covariance (n, n) of the states but the parameters."""
    core, run = kept_at(model, point, mean, covariance, known, samples, biased)
    return smooth(core, run, covariance=True)


def kept_at(
    model: FilterModel,
    point: np.ndarray,
    mean: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    samples: np.ndarray,
    biased: np.ndarray,
) -> tuple[StepModel, FilterRun]:
    """The filter of `smoothed_at`, with its model."""
    states = model.parameter_states.start
    theta = {name: float(value[0]) for name, value in theta_at(model, point[None]).items()}
    inner = replace(
        model,
        unknowns=replace(model.unknowns, parameters=()),
        fixed=theta,
        H=model.H[:, :states],
        Q=model.Q[:states, :states],
    )
    core: StepModel = Driven(inner, known)
    if len(biased):
        core = Biased(core, biased)
    return core, filter_runs(core, mean, covariance, samples, keep="all")


def _effects(
    model: FilterModel,
    point: np.ndarray,
    covariance: np.ndarray,
    known: np.ndarray,
    motion: np.ndarray,
    nuisances: Nuisances,
    biased: np.ndarray,
    settled: Settled | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Along a motion (T + 1, n), what one of every nuisance adds to the samples (T, m, d), to the motion (T + 1, d, n), and to
    the error of the smoothed states (T + 1, d, n)."""
    one = linear_models(model, point[None], nuisances, biased)
    steps, d, n = len(known), one.nuisances, one.A.shape[1]
    if d == 0:
        nothing = np.zeros((steps + 1, 0, n))
        return np.zeros((steps, model.H.shape[-2], 0)), nothing, nothing
    own, e = np.zeros((steps + 1, d, n)), one.A_nu.shape[1]
    _, P0, V = beginning(model, one, np.zeros(n), covariance, settled)
    own[0] = -V[0]
    w = known.reshape(steps, known.shape[1] * known.shape[2])
    pushed = np.einsum("eab,tb->tea", one.A_nu[0], motion[:-1]) + np.einsum("eap,tp->tea", one.G_nu[0], w)
    for t in range(steps):
        own[t + 1, :e] = own[t, :e] @ one.A[0].T + pushed[t]
    caused = np.einsum("dmn,tn->tdm", one.D, motion[1:])
    caused += np.einsum("dmp,tp->tdm", one.E, known_ends(known, nuisances))
    caused += one.offset + own[1:] @ one.H[0].T
    seen = np.where((np.arange(1, steps + 1) % model.every == 0)[:, None, None], caused, np.nan)
    found = smoothed_at(model, point, np.zeros(n), P0, np.zeros_like(known), seen, biased)
    return np.swapaxes(caused, 1, 2), own, found.mean - own


def _covariance(own: Smoothed) -> np.ndarray:
    assert own.covariance is not None
    return own.covariance[:, 0]

"""The smoother of the grid filter: all samples on every instant, over the posterior of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.conditional import conditional_states, damped, discrepancy, linear_models, on_loads, tuned
from strainsight.estimation.consider_smoother import Start, consider_errors, consider_smoothed, smoothed_pieces
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.grid_filter import GridRun
from strainsight.estimation.mixture import KERNEL, removed_of
from strainsight.estimation.parallel_filters import Data, LinearModels
from strainsight.estimation.record import GridRecord
from strainsight.estimation.reduced import StepModel, driven_with_offsets
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import Kept, Smoothed, WantedCovariances, smooth, smoother_errors
from strainsight.estimation.update import covariance_factor, standard_deviation
from strainsight.loads.histories import instant_values


def smooth_on_grid(
    record: GridRecord,
    grid_run: GridRun,
    wanted: WantedCovariances | None = None,
    progress: Callable[[float], None] | None = None,
) -> Smoothed:
    """Smoothed x* of a record with its covariance, tolerances in it, by the grid filter that filtered it.

        x̂ˢ = Σ wⱼ x̂ˢ(θⱼ),   Pˢ = Σ wⱼ (Pˢ(θⱼ) + (x̂ˢ(θⱼ) − x̂ˢ)(…)ᵀ) + Σₖ vₖvₖᵀ

    with the 2k points θⱼ of the cubature rule of degree three on the posterior of k parameters, which a motion that is smooth
    in them needs no more of; `sample_paths` draws histories of this mean and covariance. Where ν is learned, v is what the
    smoother, linear in its samples, makes of those that one of a nuisance causes, less the motion that it causes; otherwise that
    of gains that consider ν (`consider_smoothed`). Behind x* and the offsets stands z of `Beyond`.
    wanted: covariances to keep, None: all of every instant, for which memory holds no long record; progress: called with the
    share of the record that is done.
    Source: Arasaratnam and Haykin, IEEE Trans. Automatic Control 54 (2009).
    """
    smoother = points_of(record, grid_run)
    offsets, instants, beyond = len(record.biased), record.steps + 1, smoother.beyond
    states, model = len(record.mean), record.model
    n = states + len(beyond.at)
    behind = np.arange(states, n)
    order = np.concatenate([conditional_states(model, offsets), behind, np.arange(n)[model.parameter_states]])
    whole, std = np.zeros((2, instants, n))
    kept = None if wanted is None else Kept.of(wanted, instants, n)
    covariance = np.zeros((instants, 1, n, n)) if wanted is None else None
    for at, x, P, V in _pieces(smoother):
        mean, spread = np.zeros((len(V), n)), np.zeros((len(V), n, n))
        wider = beyond.behind(at, x, P, V, smoother.corrected)
        mean[:, order], spread[:, order[:, None], order] = _mixed(smoother, grid_run, *wider)
        whole[at], std[at] = mean, standard_deviation(spread)
        if kept is not None:
            kept.take(at, spread)
        if covariance is not None:
            covariance[at, 0] = spread
        if progress is not None:
            progress(1 - at.start / instants)
    return Smoothed(grid_run.run.time, whole[:, None], std[:, None], covariance, kept)


def _mixed(
    smoother: AtPoints, grid_run: GridRun, x: np.ndarray, P: np.ndarray, V: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (L, n + k) and covariance over the posterior, of x (b, L, n), P (b, L, n, n) at its points and V (L, d, n)."""
    (points, L, n), k = x.shape, len(smoother.centre)
    middle = x.mean(axis=0)
    off = x - middle
    # regression of the motion on the parameters over the points, for what a nuisance does by way of them
    cross = np.einsum("bta,bi->tai", off, smoother.points - smoother.centre) / points
    slope = cross @ np.linalg.inv(smoother.spread) if k else cross
    cov = np.zeros((L, n + k, n + k))
    cov[:, :n, :n] = P.mean(axis=0) + np.einsum("bta,btc->tac", off, off, optimize=True) / points
    # ν has a covariance with itself and with the parameters that the samples leave
    off_nu, off_p = grid_run.nu - grid_run.nu_moments[0], grid_run.point - smoother.centre
    with_p = (off_p * grid_run.weight[:, None]).T @ off_nu
    joint = np.einsum("tai,id,tdc->tac", slope, with_p, V, optimize=True)
    cov[:, :n, :n] += np.swapaxes(V, 1, 2) @ (smoother.left @ V) - joint - np.swapaxes(joint, 1, 2)
    cov[:, :n, n:] = cross - np.einsum("tda,id->tai", V, with_p)
    cov[:, n:, :n] = np.swapaxes(cov[:, :n, n:], 1, 2)
    cov[:, n:, n:] = smoother.spread
    return np.concatenate([middle, np.broadcast_to(smoother.centre, (L, k))], axis=1), cov


@dataclass(frozen=True)
class AtPoints:
    """What a smoother at b points (b, k) of the parameters goes by.

    centre (k,), spread (k, k): the posterior; points: its cubature rule, the k ends ahead and those behind. nu (d,) and left
    (d, d): mean and covariance of ν that σ holds. record: its nuisances linear about the frequencies about which the grid
    filter is, its model with the discrepancy in its noise, and the damping from which ν is counted where it is learned; models:
    linear at the points and behind them at the centre, with start (x₀, P₀, V₀); beyond: what stands behind the states.
    """

    record: GridRecord
    points: np.ndarray
    centre: np.ndarray
    spread: np.ndarray
    nu: np.ndarray
    left: np.ndarray
    models: LinearModels
    start: Start
    beyond: Beyond

    @property
    def considers_nu(self) -> bool:
        """Whether by gains that consider ν."""
        return not self.record.considered.learned

    @property
    def corrected(self) -> np.ndarray:
        """The mean of ν (d,) that is in the motion."""
        return 0 * self.nu if self.considers_nu else self.nu

    @property
    def data(self) -> Data:
        """The noise has the discrepancy in it."""
        return replace(self.record.data, discrepancy=np.zeros(self.record.samples.shape[1]))


def points_of(record: GridRecord, grid_run: GridRun) -> AtPoints:
    """Of a record, by the grid filter that filtered it."""
    model, considered, (centre, spread) = (
        record.model,
        replace(record.considered, centre=grid_run.centre),
        grid_run.posterior,
    )
    k, (nu, left) = len(centre), grid_run.nu_moments
    ends = np.sqrt(k) * np.linalg.cholesky(spread).T
    points = np.concatenate([centre + ends, centre - ends]) if k else centre[None]
    model = replace(model, r=model.r + model.every * model.h * discrepancy(model, considered, record.samples))
    if not considered.learned:
        # what the samples say of ν is neither in the motion nor in its σ
        left = left + removed_of(left)
    else:
        # exact in damping and frequencies about which the grid filter is linear, linear about zero in the rest of ν
        of_modes = considered.of_modes(model.model.size)
        about = np.where(np.arange(len(nu)) < of_modes, grid_run.about, 0.0)
        model, nu = damped(model, replace(considered, about=about)), nu - about
        about[: of_modes - len(considered.frequency)] = 0.0
        considered = replace(considered, about=about[:of_modes])
    record = replace(record, model=model, considered=considered)
    models = linear_models(model, np.concatenate([points, centre[None]]) if k else points, considered, record.biased)
    return AtPoints(record, points, centre, spread, nu, left, models, record.begun(models), beyond_of(record))


def _pieces(smoother: AtPoints) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
    """Instants of a piece of the record, x (b, L, n) at the points, P (b, L, n, n) of what no nuisance explains of its error, and
    V (L, d, n), what one of each adds to x̂ˢ − x; where ν is learned the record is one piece."""
    if not smoother.considers_nu:
        yield slice(0, smoother.record.steps + 1), *_corrected(smoother, smoother.points)
        return
    points = len(smoother.points)
    for at, states, _ in smoothed_pieces(smoother.models, smoother.start, smoother.data):
        yield at, states.x[:points], states.P[:points], states.V[-1]


def smoothed_at_points(smoother: AtPoints) -> tuple[np.ndarray, np.ndarray]:
    """x (b + 1, T + 1, n) at the points and behind them at the centre, and V (T + 1, d, n)."""
    if smoother.considers_nu:
        states = consider_smoothed(smoother.models, smoother.start, smoother.data)
        return np.concatenate([states.x[: len(smoother.points)], states.x[-1:]]), states.V[-1]
    x, _, V = _corrected(smoother, smoother.points)
    return np.concatenate([x, _corrected(smoother, smoother.centre[None])[0] if len(smoother.centre) else x]), V


def _corrected(smoother: AtPoints, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x (b, T + 1, n) at points (b, k), without what the mean of ν (d,) makes of samples and motion; P; V (T + 1, d, n) at the
    centre (k,)."""
    record, nu, samples = smoother.record, smoother.nu, smoother.data.samples
    start, P0, _ = record.begun(linear_models(record.model, points, record.considered, record.biased))

    def at_points(values: np.ndarray) -> list[Smoothed]:
        runs = (kept_at(record, *at, P0, values[:, None]) for at in zip(points, start, strict=True))
        return [smooth(core, run, covariance=True) for core, run in runs]

    middle = np.mean([each.mean[:, 0] for each in at_points(samples)], axis=0)
    caused, moved, V = _effects(smoother, middle)
    each = at_points(samples - caused @ nu)
    x = np.stack([one.mean[:, 0] for one in each]) + np.einsum("tda,d->ta", moved, nu)
    return x, np.stack([one.covariance_of(np.arange(x.shape[-1])) for one in each]), V


def kept_at(
    record: GridRecord, point: np.ndarray, mean: np.ndarray, covariance: np.ndarray, samples: np.ndarray
) -> tuple[StepModel, FilterRun]:
    """The filter at parameters p (k,), behind its model, for runs of samples (T, B, m); mean (n,), covariance (n, n) of its
    states."""
    model, _ = tuned(record.model, record.considered, point[None])
    if model.model.frequency_factors is not None:
        model = replace(model, model=replace(model.model, frequency_factors=model.model.frequency_factors[0]))
    inner = replace(record, model=model).known_at(point).model
    core = driven_with_offsets(inner, record.known, record.biased)
    return core, filter_runs(core, mean, covariance, samples, keep="all")


def _effects(smoother: AtPoints, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Along a motion (T + 1, n), at the centre, what one of every nuisance adds to the samples (T, m, d), to the motion
    (T + 1, d, n), and to the error (T + 1, d, n) of states smoothed by those samples that are not missing; beyond the coordinates
    loads displace what the mean of ν makes of them."""
    record, data = smoother.record, smoother.data
    one = linear_models(record.model, smoother.centre[None], record.considered, record.biased)
    steps, d, n = record.steps, one.considered_count, one.H.shape[-1]
    if d == 0:
        nothing = np.zeros((steps + 1, 0, n))
        return np.zeros((steps, data.samples.shape[1], 0)), nothing, nothing
    moved, e = np.zeros((steps + 1, d, n)), one.moving
    _, P0, V = record.begun(one)
    moved[0] = -V[0]
    pushed = np.einsum("eab,tb->tea", one.A_nu[0], motion[:-1]) + np.einsum("eap,tp->tea", one.G_nu[0], data.known)
    for t in range(steps):
        moved[t + 1, :e] = moved[t, :e] @ one.A[0].T + pushed[t]
    caused = np.einsum("dmn,tn->tdm", one.D, motion[1:])
    beyond = smoother.nu[e - len(one.U) : e] * (motion[1:] @ one.U.T + data.known_end @ one.W.T)
    caused += np.einsum("dmp,tp->tdm", one.E, data.known_end) + np.einsum("dmf,tf->tdm", one.B, beyond)
    caused += one.offset + moved[1:] @ one.H[0].T
    samples = np.where(np.isfinite(data.samples)[:, None], caused, np.nan)
    silent = replace(record, known=np.zeros_like(record.known))
    smoothed = smooth(*kept_at(silent, smoother.centre, np.zeros(n), P0, samples))
    return np.swapaxes(caused, 1, 2), moved, smoothed.mean - moved


@dataclass(frozen=True)
class Beyond:
    """z = ν u of f constants: at (f,) where these stand among all ν; rows (f, n) of u [N] on the states [q, q̇, ζ, offsets],
    and what known loads are of it (T + 1, f)."""

    at: np.ndarray
    rows: np.ndarray
    fed: np.ndarray

    def load(self, x: np.ndarray, at: slice = slice(None)) -> np.ndarray:
        """u (L, f) of states x (L, n) at some instants."""
        return x @ self.rows.T + self.fed[at]

    def behind(
        self, at: slice, x: np.ndarray, P: np.ndarray, V: np.ndarray, nu: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States x (b, L, n), their covariance P (b, L, n, n) and V (L, d, n) at L instants, with z behind them:

            ẑ = ν̂ û,     ẑ − z = −(ν − ν̂) û     to first order, so that V has −û there, and P nothing

        û at the mean over the points; nu ν̂ (d,) that is in the motion.
        """
        f = len(self.at)
        if f == 0:
            return x, P, V
        load = self.load(x.mean(axis=0), at)
        error = np.zeros((*V.shape[:2], f))
        error[:, self.at, np.arange(f)] = -load
        z = np.broadcast_to(nu[self.at] * load, (*x.shape[:2], f))
        wider = np.pad(P, [(0, 0), (0, 0), (0, f), (0, f)])
        return np.concatenate([x, z], axis=2), wider, np.concatenate([V, error], axis=2)


def beyond_of(record: GridRecord) -> Beyond:
    """Of the loads that `ConsideredParameters.load` names, where they are to stand `behind` the states."""
    model, considered = record.model, record.considered
    named = considered.load if considered.behind else considered.load[:0]
    ahead = len(considered.sources(model.model.size)) - len(considered.source)
    rows, fed = on_loads(model, np.eye(len(model.model.inputs))[named])
    wider = np.pad(rows, [(0, 0), (0, len(record.biased))])
    return Beyond(ahead + np.arange(len(named)), wider, instant_values(record.known) @ fed.T)


AT_ONCE = 20_000_000
"""Numbers of the histories that are drawn at a time."""


@dataclass(frozen=True)
class Paths:
    """N draws: parameter (N, k) p = ln(θ/guess), which is constant; state (N, T + 1, n + f) of what was asked for, behind it z of
    `Beyond`."""

    parameter: np.ndarray
    state: np.ndarray


def sample_paths(
    record: GridRecord, grid_run: GridRun, count: int, seed: int, states: slice = slice(None), number: int = 0
) -> Iterator[Paths]:
    """`count` draws in parts, as of `smooth_on_grid`; states: which of [q, q̇, ζ, offsets].

    number: of the record among those of `grid_run`: draws of one seed have the constants of all records in common, and the rest
    of each record for itself.

        x = x̂ˢ(p) − w − V(ν − ν̂),     x̂ˢ(p) = x̂ˢ(p̄) + Σᵢ zᵢ sᵢ + ½ zᵢ² cᵢ,     p = p̄ + L z,   L Lᵀ the covariance of p

    p and ν are drawn together from the points of the grid filter with normal kernels (`marginal`), w with the gains at each of
    the 2k points θⱼ of `smooth_on_grid` in turn (`consider_errors`, `smoother_errors`). First and second differences s and c over
    x̂ˢ(θⱼ) carry the mean to p. So mean and covariance of the draws are those that `smooth_on_grid` claims at every instant,
    but for products of curvatures c, which its rule of degree three does not see; and instants belong together as the
    smoother's errors do. A part depends on seed, its number and its size. Source: Durbin and Koopman, Biometrika 89 (2002).
    """
    smoother = points_of(record, grid_run)
    x, V = smoothed_at_points(smoother)
    rng = np.random.default_rng(seed)
    p, nu = _constants(smoother, grid_run, count, rng)
    rng = np.random.default_rng((seed, number)) if number else rng
    beyond = smoother.beyond
    points, k, sizes = len(smoother.points), len(smoother.centre), smoother.models.H.shape[-1] + len(beyond.at)
    part = max(points, AT_ONCE // ((record.steps + 1) * sizes) // points * points)
    z = np.linalg.solve(np.linalg.cholesky(smoother.spread), (p - smoother.centre).T).T
    middle, slope, bend = _carried(x, k)
    load, nu_of_loads = beyond.load(x[:points].mean(axis=0)), (nu + smoother.corrected)[:, beyond.at]
    for start in range(0, count, part):
        span = slice(start, min(start + part, count))
        each = -(-(span.stop - span.start) // points)
        error = _errors(smoother, each, rng, states)[: span.stop - span.start]
        error += middle[None, :, states]
        for i in range(k):
            here = z[span, i, None, None]
            error += here * slope[i, :, states] + 0.5 * (here**2 - 1) * bend[i, :, states]
        error -= np.einsum("nd,tda->nta", nu[span], V[:, :, states], optimize=True)
        yield Paths(p[span], np.concatenate([error, nu_of_loads[span, None] * load], axis=2))


def _constants(
    smoother: AtPoints, grid_run: GridRun, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """p (N, k) and ν − ν̂ (N, d), together."""
    k, d = len(smoother.centre), len(smoother.nu)
    joint = np.hstack([grid_run.point, grid_run.nu])
    centre = np.concatenate([smoother.centre, grid_run.weight @ grid_run.nu])
    off = joint - centre
    covariance = (off * grid_run.weight[:, None]).T @ off
    std = np.sqrt(np.diag(covariance)[:k])
    # one share of the covariance is the kernels', the rest that of their centres drawn together
    share = float(np.minimum(1.0, (KERNEL * grid_run.step / std) ** 2).max(initial=0.0)) if k else 0.0
    # one draw in every N-th part of the weight
    place = (rng.permutation(count) + rng.random(count)) / count
    which = np.minimum(np.searchsorted(np.cumsum(grid_run.weight), place), len(grid_run.weight) - 1)
    factor = covariance_factor(covariance)
    kernel = rng.standard_normal((count, factor.shape[1])) @ factor.T
    drawn = np.sqrt(1 - share) * off[which] + np.sqrt(share) * kernel
    left = covariance_factor(smoother.left - covariance[k:, k:]) if d else np.zeros((0, 0))
    return smoother.centre + drawn[:, :k], drawn[:, k:] + rng.standard_normal((count, left.shape[1])) @ left.T


def _carried(x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of x̂ˢ (2k + 1, T + 1, n) at the points and the centre: mean (T + 1, n) over the points, first and second derivatives
    (k, T + 1, n) in z."""
    if k == 0:
        nothing = np.zeros((0, *x.shape[1:]))
        return x[0], nothing, nothing
    ahead, behind, centre = x[:k], x[k : 2 * k], x[-1]
    return x[:-1].mean(axis=0), (ahead - behind) / (2 * np.sqrt(k)), (ahead + behind - 2 * centre) / k


def _errors(smoother: AtPoints, each: int, rng: np.random.Generator, states: slice) -> np.ndarray:
    """−w (each · points, T + 1, n), the points one after the other."""
    (x, P, V), record, points = smoother.start, smoother.record, len(smoother.points)
    if smoother.considers_nu:
        models = smoother.models.of(slice(points))
        error = consider_errors(models, (x[:points], P, V[:points]), smoother.data, each, rng)[..., states]
    else:
        samples = smoother.data.samples[:, None]
        runs = (kept_at(record, *at, P, samples) for at in zip(smoother.points, x, strict=False))
        error = np.stack([smoother_errors(core, run, each, rng, states) for core, run in runs])
    return np.swapaxes(error, 0, 1).reshape(each * points, *error.shape[2:])

"""Smoother of the grid filter: states at each instant given all samples, over the posterior of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.conditional import (
    apply_damping,
    conditional_states,
    discrepancy,
    inertia_std,
    linear_models,
    load_rows,
    tune_frequencies,
)
from strainsight.estimation.consider_smoother import Start, consider_errors, consider_smoothed, smoothed_pieces
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.grid_filter import GridRun
from strainsight.estimation.mixture import KERNEL, removed_of
from strainsight.estimation.parallel_filters import Data, LinearModels
from strainsight.estimation.record import GridRecord
from strainsight.estimation.reduced import StepModel, driven_with_offsets
from strainsight.estimation.run import FilterRun
from strainsight.estimation.smoother import SelectedCovariances, Smoothed, WantedCovariances, smooth, smoother_errors
from strainsight.estimation.update import covariance_factor, standard_deviation
from strainsight.loads.histories import instant_values


def smooth_on_grid(
    record: GridRecord,
    grid_run: GridRun,
    wanted: WantedCovariances | None = None,
    progress: Callable[[float], None] | None = None,
) -> Smoothed:
    """Smoothed x* of a record with its covariance, tolerances included.

        x̂ˢ = Σ wⱼ x̂ˢ(θⱼ),   Pˢ = Σ wⱼ (Pˢ(θⱼ) + (x̂ˢ(θⱼ) − x̂ˢ)(…)ᵀ) + Σₖ vₖvₖᵀ

    with the 2k points θⱼ of the cubature rule of degree three on the posterior of k parameters. `sample_paths` draws
    histories with this mean and covariance. If ν is learned, v is the smoothed effect of a unit ν on the samples, minus the
    motion that it causes. Otherwise it is that of gains that consider ν (`consider_smoothed`). z of `Truncation` follows x*
    and the offsets. wanted: covariances to store, None: all at each instant, too large for long records; progress: called
    with the fraction done. Source: Arasaratnam and Haykin, IEEE Trans. Automatic Control 54 (2009)."""
    smoother = build_smoother(record, grid_run)
    offsets, instants, truncation = len(record.biased), record.steps + 1, smoother.truncation
    states, model = len(record.mean), record.model
    n = states + len(truncation.at)
    behind = np.arange(states, n)
    order = np.concatenate([conditional_states(model, offsets), behind, np.arange(n)[model.parameter_states]])
    whole, std = np.zeros((2, instants, n))
    selected = None if wanted is None else SelectedCovariances.of(wanted, instants, n)
    covariance = np.zeros((instants, 1, n, n)) if wanted is None else None
    for at, x, P, V in _pieces(smoother):
        mean, spread = np.zeros((len(V), n)), np.zeros((len(V), n, n))
        wider = truncation.behind(at, x, P, V, smoother.corrected)
        mean[:, order], spread[:, order[:, None], order] = _mix(smoother, grid_run, *wider)
        whole[at], std[at] = mean, standard_deviation(spread)
        if selected is not None:
            selected.take(at, spread)
        if covariance is not None:
            covariance[at, 0] = spread
        if progress is not None:
            progress(1 - at.start / instants)
    inertia = inertia_std(model, record.considered, whole, record.known_at_instants)
    return Smoothed(grid_run.run.time, whole[:, None], np.hypot(std, inertia)[:, None], covariance, selected)


def _mix(
    smoother: AtPoints, grid_run: GridRun, x: np.ndarray, P: np.ndarray, V: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (L, n + k) and covariance over the posterior, from x (b, L, n), P (b, L, n, n) at its points and V (L, d, n)."""
    (points, L, n), k = x.shape, len(smoother.centre)
    middle = x.mean(axis=0)
    off = x - middle
    # regression of the motion on the parameters over the points, for the effect of ν through them
    cross = np.einsum("bta,bi->tai", off, smoother.points - smoother.centre) / points
    slope = cross @ np.linalg.inv(smoother.spread) if k else cross
    cov = np.zeros((L, n + k, n + k))
    cov[:, :n, :n] = P.mean(axis=0) + np.einsum("bta,btc->tac", off, off, optimize=True) / points
    # ν has a covariance with itself and with the parameters that the samples leave
    off_nu, off_p = grid_run.nu - grid_run.nu_moments[0], grid_run.point - smoother.centre
    with_p = (off_p * grid_run.weight[:, None]).T @ off_nu
    joint = np.einsum("tai,id,tdc->tac", slope, with_p, V, optimize=True)
    # without parameters gains that consider ν leave its prior covariance, which is one
    by_nu = smoother.left @ V if k or not smoother.considers_nu else V
    cov[:, :n, :n] += np.swapaxes(V, 1, 2) @ by_nu - joint - np.swapaxes(joint, 1, 2)
    cov[:, :n, n:] = cross - np.einsum("tda,id->tai", V, with_p)
    cov[:, n:, :n] = np.swapaxes(cov[:, :n, n:], 1, 2)
    cov[:, n:, n:] = smoother.spread
    return np.concatenate([middle, np.broadcast_to(smoother.centre, (L, k))], axis=1), cov


@dataclass(frozen=True)
class AtPoints:
    """Inputs of a smoother at b points (b, k) of the parameters. centre (k,), spread (k, k): the posterior; points: its
    cubature rule, k points ahead and k behind; nu (d,), left (d, d): mean and covariance of ν in σ; record: linearised as in
    the grid filter, with the discrepancy in its noise; models: at the points, and at the centre behind them; start (x₀, P₀,
    V₀); truncation: what follows the states."""

    record: GridRecord
    points: np.ndarray
    centre: np.ndarray
    spread: np.ndarray
    nu: np.ndarray
    left: np.ndarray
    models: LinearModels
    start: Start
    truncation: Truncation

    @property
    def considers_nu(self) -> bool:
        """Whether the gains consider ν."""
        return not self.record.considered.learned

    @property
    def corrected(self) -> np.ndarray:
        """Mean of ν (d,) contained in the motion."""
        return 0 * self.nu if self.considers_nu else self.nu

    @property
    def data(self) -> Data:
        """Data of the record; the discrepancy is part of the noise."""
        return replace(self.record.data, discrepancy=np.zeros(self.record.samples.shape[1]))


def build_smoother(record: GridRecord, grid_run: GridRun) -> AtPoints:
    """Smoother inputs of a record, from the run of the grid filter."""
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
        # the estimate of ν is neither in the motion nor in its σ
        left = left + removed_of(left)
    else:
        # exact in damping and frequencies about which the grid filter is linear, linear about zero in the rest of ν
        of_modes = considered.of_modes(model.model.size)
        about = np.where(np.arange(len(nu)) < of_modes, grid_run.about, 0.0)
        model, nu = apply_damping(model, replace(considered, about=about)), nu - about
        about[: of_modes - len(considered.frequency)] = 0.0
        considered = replace(considered, about=about[:of_modes])
    record = replace(record, model=model, considered=considered)
    models = linear_models(model, np.concatenate([points, centre[None]]) if k else points, considered, record.biased)
    return AtPoints(record, points, centre, spread, nu, left, models, record.begun(models), build_truncation(record))


def _pieces(smoother: AtPoints) -> Iterator[tuple[slice, np.ndarray, np.ndarray, np.ndarray]]:
    """Instants of a piece of the record, with x (b, L, n) and P (b, L, n, n) at the points, and V (L, d, n), the error per unit
    ν.
    P excludes the considered parameters. If ν is learned the record is one piece."""
    if not smoother.considers_nu:
        yield slice(0, smoother.record.steps + 1), *_smooth_corrected(smoother, smoother.points)
        return
    points = len(smoother.points)
    for at, states, _ in smoothed_pieces(smoother.models, smoother.start, smoother.data):
        yield at, states.x[:points], states.P[:points], states.V[-1]


def smooth_points(smoother: AtPoints) -> tuple[np.ndarray, np.ndarray]:
    """x (b + 1, T + 1, n) at the points and at the centre behind them, and V (T + 1, d, n)."""
    if smoother.considers_nu:
        states = consider_smoothed(smoother.models, smoother.start, smoother.data)
        return np.concatenate([states.x[: len(smoother.points)], states.x[-1:]]), states.V[-1]
    x, _, V = _smooth_corrected(smoother, smoother.points)
    return np.concatenate([x, _smooth_corrected(smoother, smoother.centre[None])[0] if len(smoother.centre) else x]), V


def _smooth_corrected(smoother: AtPoints, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x (b, T + 1, n) at points (b, k), corrected for the effect of the mean of ν (d,) on samples and motion; P; V (T + 1, d, n)
    at the centre."""
    record, nu, samples = smoother.record, smoother.nu, smoother.data.samples
    start, P0, _ = record.begun(linear_models(record.model, points, record.considered, record.biased))

    def at_points(values: np.ndarray) -> list[Smoothed]:
        runs = (filter_at_point(record, *at, P0, values[:, None]) for at in zip(points, start, strict=True))
        return [smooth(core, run, covariance=True) for core, run in runs]

    middle = np.mean([each.mean[:, 0] for each in at_points(samples)], axis=0)
    caused, moved, V = _effects(smoother, middle)
    each = at_points(samples - caused @ nu)
    x = np.stack([one.mean[:, 0] for one in each]) + np.einsum("tda,d->ta", moved, nu)
    return x, np.stack([one.covariance_of(np.arange(x.shape[-1])) for one in each]), V


def filter_at_point(
    record: GridRecord, point: np.ndarray, mean: np.ndarray, covariance: np.ndarray, samples: np.ndarray
) -> tuple[StepModel, FilterRun]:
    """Model and filter at parameters p (k,) for runs of samples (T, B, m); mean (n,), covariance (n, n) of its states."""
    model, _ = tune_frequencies(record.model, record.considered, point[None])
    if model.model.frequency_factors is not None:
        model = replace(model, model=replace(model.model, frequency_factors=model.model.frequency_factors[0]))
    inner = replace(record, model=model).known_at(point).model
    core = driven_with_offsets(inner, record.known, record.biased)
    return core, filter_runs(core, mean, covariance, samples, keep="all")


def _effects(smoother: AtPoints, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Effects of a unit ν along a motion (T + 1, n) at the centre. Returns those on the samples (T, m, d), on the motion (T +
    1, d, n) and on the smoothing error (T + 1, d, n). Truncated displacements use the mean of ν."""
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
    truncation = smoother.nu[e - len(one.U) : e] * (motion[1:] @ one.U.T + data.known_end @ one.W.T)
    caused += np.einsum("dmp,tp->tdm", one.E, data.known_end) + np.einsum("dmf,tf->tdm", one.B, truncation)
    caused += one.offset + moved[1:] @ one.H[0].T
    samples = np.where(np.isfinite(data.samples)[:, None], caused, np.nan)
    silent = replace(record, known=np.zeros_like(record.known))
    smoothed = smooth(*filter_at_point(silent, smoother.centre, np.zeros(n), P0, samples))
    return np.swapaxes(caused, 1, 2), moved, smoothed.mean - moved


@dataclass(frozen=True)
class Truncation:
    """Displacement z = ν u that the reduced coordinates truncate, for f constants. at (f,): their indices in ν; rows (f, n):
    u [N] from the states [q, q̇, ζ, offsets]; fed (T + 1, f): contribution of the known loads."""

    at: np.ndarray
    rows: np.ndarray
    fed: np.ndarray

    def load(self, x: np.ndarray, at: slice = slice(None)) -> np.ndarray:
        """Loads u (L, f) from states x (L, n)."""
        return x @ self.rows.T + self.fed[at]

    def behind(
        self, at: slice, x: np.ndarray, P: np.ndarray, V: np.ndarray, nu: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States x (b, L, n), P (b, L, n, n) and V (L, d, n) with z appended:

            ẑ = ν̂ û,     ẑ − z = −(ν − ν̂) û     to first order, so V contains −û and P is zero

        û is the mean over the points; nu ν̂ (d,): part of the motion."""
        f = len(self.at)
        if f == 0:
            return x, P, V
        load = self.load(x.mean(axis=0), at)
        error = np.zeros((*V.shape[:2], f))
        error[:, self.at, np.arange(f)] = -load
        z = np.broadcast_to(nu[self.at] * load, (*x.shape[:2], f))
        wider = np.pad(P, [(0, 0), (0, 0), (0, f), (0, f)])
        return np.concatenate([x, z], axis=2), wider, np.concatenate([V, error], axis=2)


def build_truncation(record: GridRecord) -> Truncation:
    """Truncated displacements of the loads in `ConsideredParameters.load`, if they are `behind` the states."""
    model, considered = record.model, record.considered
    named = considered.load if considered.behind else considered.load[:0]
    ahead = len(considered.sources(model.model.size)) - len(considered.source)
    rows, fed = load_rows(model, np.eye(len(model.model.inputs))[named])
    wider = np.pad(rows, [(0, 0), (0, len(record.biased))])
    return Truncation(ahead + np.arange(len(named)), wider, instant_values(record.known) @ fed.T)


AT_ONCE = 20_000_000
"""Values of the sampled histories held in memory at once."""


@dataclass(frozen=True)
class Paths:
    """N draws: parameter (N, k) p = ln(θ/guess), constant; state (N, T + 1, n + f): the requested states, followed by z of
    `Truncation`."""

    parameter: np.ndarray
    state: np.ndarray


def sample_paths(
    record: GridRecord, grid_run: GridRun, count: int, seed: int, states: slice = slice(None), number: int = 0
) -> Iterator[Paths]:
    """Sample `count` histories in parts, consistent with `smooth_on_grid`; states: selection of [q, q̇, ζ, offsets].

    number: index of the record in `grid_run`. Draws with the same seed share the constants of all records, and nothing else.

        x = x̂ˢ(p) − w − V(ν − ν̂),     x̂ˢ(p) = x̂ˢ(p̄) + Σᵢ zᵢ sᵢ + ½ zᵢ² cᵢ,     p = p̄ + L z,   L Lᵀ the covariance of p

    p and ν are sampled jointly from the grid points with normal kernels (`marginal`), w with the gains at each of the 2k
    points θⱼ in turn (`consider_errors`, `smoother_errors`). s and c are first and second differences over x̂ˢ(θⱼ). Mean and
    covariance of the draws agree with `smooth_on_grid`, up to products of the curvatures c. Correlations in time are those of
    the smoother errors. A part depends on seed, its index and its size. Source: Durbin and Koopman, Biometrika 89 (2002)."""
    smoother = build_smoother(record, grid_run)
    x, V = smooth_points(smoother)
    rng = np.random.default_rng(seed)
    p, nu = _constants(smoother, grid_run, count, rng)
    rng = np.random.default_rng((seed, number)) if number else rng
    truncation = smoother.truncation
    points, k, sizes = len(smoother.points), len(smoother.centre), smoother.models.H.shape[-1] + len(truncation.at)
    part = max(points, AT_ONCE // ((record.steps + 1) * sizes) // points * points)
    z = np.linalg.solve(np.linalg.cholesky(smoother.spread), (p - smoother.centre).T).T
    middle, slope, bend = _difference_points(x, k)
    load, nu_of_loads = truncation.load(x[:points].mean(axis=0)), (nu + smoother.corrected)[:, truncation.at]
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
    """Joint draws of p (N, k) and ν − ν̂ (N, d)."""
    k, d = len(smoother.centre), len(smoother.nu)
    joint = np.hstack([grid_run.point, grid_run.nu])
    off = joint - np.concatenate([smoother.centre, grid_run.weight @ grid_run.nu])
    covariance = (off * grid_run.weight[:, None]).T @ off
    std = np.sqrt(np.diag(covariance)[:k])
    # one share of the covariance is the kernels', the rest that of their centres drawn together
    share = float(np.minimum(1.0, (KERNEL * grid_run.step / std) ** 2).max(initial=0.0)) if k else 0.0
    # one draw in every N-th part of the weight
    place = (rng.permutation(count) + rng.random(count)) / count
    which = np.minimum(np.searchsorted(np.cumsum(grid_run.weight), place), len(grid_run.weight) - 1)
    factor = covariance_factor(covariance)
    kernel = rng.standard_normal((count, factor.shape[1])) @ factor.T
    sample = np.sqrt(1 - share) * off[which] + np.sqrt(share) * kernel
    left = covariance_factor(smoother.left - covariance[k:, k:]) if d else np.zeros((0, 0))
    return smoother.centre + sample[:, :k], sample[:, k:] + rng.standard_normal((count, left.shape[1])) @ left.T


def _difference_points(x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (T + 1, n) of x̂ˢ (2k + 1, T + 1, n) over the points, and first and second derivatives (k, T + 1, n) in z."""
    if k == 0:
        nothing = np.zeros((0, *x.shape[1:]))
        return x[0], nothing, nothing
    ahead, behind, centre = x[:k], x[k : 2 * k], x[-1]
    return x[:-1].mean(axis=0), (ahead - behind) / (2 * np.sqrt(k)), (ahead + behind - 2 * centre) / k


def _errors(smoother: AtPoints, each: int, rng: np.random.Generator, states: slice) -> np.ndarray:
    """−w (each · points, T + 1, n), point by point."""
    (x, P, V), record, points = smoother.start, smoother.record, len(smoother.points)
    if smoother.considers_nu:
        models = smoother.models.of(slice(points))
        error = consider_errors(models, (x[:points], P, V[:points]), smoother.data, each, rng)[..., states]
    else:
        samples = smoother.data.samples[:, None]
        runs = (filter_at_point(record, *at, P, samples) for at in zip(smoother.points, x, strict=False))
        error = np.stack([smoother_errors(core, run, each, rng, states) for core, run in runs])
    return np.swapaxes(error, 0, 1).reshape(each * points, *error.shape[2:])

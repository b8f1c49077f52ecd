"""Filters of a bench: extended filter over loads and parameters, or parameter grid filter; ball loads with σ."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import ConfigError, NumericalError, UserError
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.reduced import StepModel
from strainsight.estimation.run import FilterRun, Keep
from strainsight.estimation.smoother import smooth_first
from strainsight.estimation.step_grid_filter import StepGridProblem, StepGridRun, filter_constants
from strainsight.estimation.update import covariance_factor
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.trial import BenchTrial
from strainsight.experiment.filters_compared import filters_compared
from strainsight.multibody.bearing.element import BallLoads, ball_loads
from strainsight.multibody.bearing.geometry import PARAMETERS
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.relations import relation_rows
from strainsight.ordering import index_of_largest
from strainsight.records.bench import BallsThen, RingEstimate
from strainsight.records.estimated import EXTENDED, GRID_FILTER, Compared
from strainsight.records.record import record_from

LARGEST = 1e9
"""Largest memory for smoothing [bytes]."""


@dataclass(frozen=True)
class SmoothedLoads:
    """Smoothed unknown loads of the first run: mean, std (T + 1, nu) [N, N m], std NaN if withheld."""

    mean: np.ndarray
    std: np.ndarray


def keep_for(model: AugmentedStep, steps: int) -> tuple[Keep, tuple[str, ...]]:
    """Data to keep for `smoothed_loads`, and a note if they are too large."""
    if not len(model.inputs):
        return "mean", ()
    # covariance, Jacobian, process noise and measurement rows
    size = 8.0 * steps * model.size * (3 * model.size + model.channels)
    if size <= LARGEST:
        return "first", ()
    return "mean", (
        f"loads.csv contains filtered, not smoothed loads. Smoothing of {steps} steps with {model.size} states needs "
        f"{size / 1e9:.3g} GB; the limit is {LARGEST / 1e9:.3g} GB. To smooth, reduce estimate.duration or increase "
        "estimate.time_step",
    )


def smoothed_loads(model: AugmentedStep, whole: StepModel, run: FilterRun) -> SmoothedLoads | None:
    """Smoothed loads, None without stored data or if the first run diverged; whole: model of the run with offsets.

    σ of smooth loads is withheld if the filter estimates the step error, as it assumes independent step errors; real errors were
    up to twice σ."""
    if run.covariance is None or run.jacobian is None or run.lost[0] >= 0:
        return None
    if not (np.isfinite(run.covariance).all() and np.isfinite(run.jacobian).all()):
        return None
    smoothed = smooth_first(whole, run)
    std = smoothed.std[:, 0, model.u]
    if model.corrected:
        # smooth load models have several states
        std[:, np.diff(np.append(model.loads.first, model.loads.size)) > 1] = np.nan
    return SmoothedLoads(smoothed.mean[:, 0, model.u], std)


Progress = Callable[[float], None]
"""Called with the finished share."""


@dataclass(frozen=True)
class FilteredRuns:
    """Filtered runs.

    mean, std (T + 1, B, size): of [x, offsets], NaN after divergence; joint (T + 1, b, k, k): covariance of loads and parameters;
    nis (T, B): per channel; lost (B,): step of divergence, −1 for none; compared: parameters of the first run by both filters;
    smoothed: loads of the first run of an extended filter; notes: sentences."""

    mean: np.ndarray
    std: np.ndarray
    joint: np.ndarray
    nis: np.ndarray
    lost: np.ndarray
    compared: Compared | None = None
    smoothed: SmoothedLoads | None = None
    notes: tuple[str, ...] = ()


def per_channel(nis: np.ndarray, y: np.ndarray) -> np.ndarray:
    """NIS divided by the number of measured channels of y (T, B, m)."""
    return np.asarray(nis / np.maximum(np.isfinite(y).sum(axis=2), 1))


Watch = Callable[[int, np.ndarray, np.ndarray], None]
"""Callback of `filter_runs`: step, x (B, N) and P (B, N, N)."""


def by_extended(trial: BenchTrial, y: np.ndarray, progress: Progress, watch: Watch | None = None) -> FilteredRuns:
    """Run the extended filter on all runs y (T, B, m); other forms of the update may diverge without an error."""
    keep, notes = keep_for(trial.model, len(y))
    D, o = trial.installed
    if errors := D.shape[1]:
        keep = "all"
        _refuse_large(trial, y)
    refuse = trial.problem.estimate.method.update == "iterated"
    run = _filter(trial, y, refuse=refuse, progress=lambda k: progress(k / len(y)), watch=watch, keep=keep)
    smoothed = smoothed_loads(trial.model, trial.offsets.model(trial.model), run)
    std, joint = run.std, run.unknown_covariance
    if errors:
        S = considered(run, y, trial.model.R, D, o)
        std, of_unknowns = np.sqrt(std**2 + np.sum(S**2, axis=3)), S[:, :, trial.model.position]
        joint = joint + of_unknowns @ np.swapaxes(of_unknowns, 2, 3)
        # later samples have the same constant error
        smoothed = None if smoothed is None else replace(smoothed, std=np.full_like(smoothed.std, np.nan))
    return FilteredRuns(run.mean, std, joint, per_channel(run.nis, y), run.lost, smoothed=smoothed, notes=notes)


def considered(run: FilterRun, y: np.ndarray, R: np.ndarray, D: np.ndarray, o: np.ndarray) -> np.ndarray:
    """S (T + 1, B, N, k): error of the estimate per σ of considered constant reading errors (D x + o) ν (Schmidt-Kalman):

        Sₖ₊₁ = (1 − K H) A Sₖ + K (D x̂ + o),     K = P Hᵀ R⁻¹,     σ² = diag(P + S Sᵀ)

    run: with all data kept; y (T, B, m), NaN if missing; R (m,); D (m, k, n): on the first n states; o (m, k).
    Source: Schmidt; Gelb, Applied Optimal Estimation (1974), section 7.2."""
    assert run.covariance is not None
    assert run.jacobian is not None
    assert run.rows is not None
    steps, runs, size = len(y), y.shape[1], run.mean.shape[2]
    S = np.zeros((steps + 1, runs, size, D.shape[1]))
    for t in range(steps):
        H = np.where(np.isfinite(y[t])[..., None], run.rows[t], 0.0)
        G = np.einsum("mkn,bn->bmk", D, np.nan_to_num(run.mean[t + 1, :, : D.shape[2]])) + o
        G = np.where(np.isfinite(y[t])[..., None], G, 0.0)
        K = run.covariance[t + 1] @ np.swapaxes(H, 1, 2) / R
        ahead = run.jacobian[t] @ S[t]
        S[t + 1] = ahead - K @ (H @ ahead) + K @ G
    return S


def predicted(trial: BenchTrial, y: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predict readings (T, B, k) of channels (k,) from all others of y (T, B, m); returns mean, σ including noise, and diverged
    runs (B,)."""
    D, o = trial.installed
    others = y.copy()
    others[:, :, part] = np.nan
    if errors := D.shape[1]:
        _refuse_large(trial, y)
    run = _filter(trial, others, keep="all" if errors else "mean", refuse=False)
    variance = run.gauge_std[:, :, part] ** 2 + trial.noise[part] ** 2
    if errors:
        S, model = considered(run, others, trial.model.R, D, o), trial.offsets.model(trial.model)
        of_part = np.einsum("mkn,tbn->tbmk", D[part], run.mean[1:, :, : D.shape[2]]) + o[part]
        for k in range(len(y)):
            # the run has no rows of missing channels
            x = np.where(np.isfinite(run.mean[k + 1]), run.mean[k + 1], run.mean[0])
            H = model.measure(x, k)[1][:, part]
            variance[k] += np.sum((H @ S[k + 1] - of_part[k]) ** 2, axis=2)
    return run.gauge_mean[:, :, part], np.sqrt(variance), run.lost >= 0


def _refuse_large(trial: BenchTrial, y: np.ndarray) -> None:
    """Check the memory for gauge errors, which needs the covariances of all runs."""
    steps, runs, size = len(y), y.shape[1], trial.model.size + len(trial.offsets.at)
    needed = 8.0 * steps * runs * size * (3 * size + y.shape[2] + trial.installed[0].shape[1])
    if needed > LARGEST:
        raise ConfigError(
            f"including gauge errors in {runs} filter runs of {steps} steps with {size} states needs "
            f"{needed / 1e9:.3g} GB of memory; the limit is {LARGEST / 1e9:.3g} GB",
            key="estimate.tolerances",
            remedy="Reduce estimate.runs or estimate.duration, or remove estimate.tolerances.",
        )


def by_grid(trial: BenchTrial, y: np.ndarray, progress: Progress) -> FilteredRuns:
    """Run the parameter grid filter on each run of y (T, B, m), and the extended filter on the first run for comparison."""
    runs = y.shape[1]

    def progress_of(run: int) -> Progress:
        return lambda share: progress((run + share) / runs)

    grid_runs = [_run_grid(trial.of_runs(slice(run, run + 1)), y[:, run], progress_of(run)) for run in range(runs)]
    mean, std, joint, nis = (
        np.stack([getattr(grid_run, key) for grid_run in grid_runs], axis=1) for key in ("mean", "std", "joint", "nis")
    )
    for k, states in enumerate(mean[1:], start=1):
        # a mean of admissible states violates the constraints in second order
        states[:] = trial.offsets.projected(trial.model)(states, k)
    nis, lost = per_channel(nis, y), np.full(runs, -1)
    notes: tuple[str, ...] = ()
    if without := sum(grid_run.without for grid_run in grid_runs):
        tried = sum(len(grid_run.weight) for grid_run in grid_runs)
        notes = (
            f"points of the parameter grid with zero posterior weight: {without} of {tried}. Their filters diverged, or found "
            "no equilibrium at the start",
        )
    return FilteredRuns(mean, std, joint, nis, lost, _compared(trial, y, grid_runs[0]), notes=notes)


def _filter(
    trial: BenchTrial,
    y: np.ndarray,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    refuse: bool,
    progress: Callable[[int], None] | None = None,
    watch: Watch | None = None,
    keep: Keep = "mean",
) -> FilterRun:
    """Run the extended filter; start: x and P, by default of the trial."""
    offsets, method = trial.offsets, trial.problem.estimate.method
    once = method.update in ("one_shot", "as_printed")
    return filter_runs(
        offsets.model(trial.model),
        *(start or (trial.start, trial.covariance)),
        y,
        keep,
        form="square_root",  # the Joseph form may lose definiteness of P at small noise
        iterations=1 if once else method.iterations,
        through_step=not once,
        damped=method.update != "undamped",
        project=None if method.update == "as_printed" else offsets.projected(trial.model),
        progress=progress,
        watch=watch,
        refuse=refuse,
    )


def _run_grid(trial: BenchTrial, y: np.ndarray, progress: Progress) -> StepGridRun:
    """Run the parameter grid filter on samples y (T, m) of one run."""

    def filters(x: np.ndarray, P: np.ndarray, samples: np.ndarray) -> FilterRun:
        return _filter(trial, np.repeat(samples[:, None], len(x), axis=1), (x, P), refuse=False)

    model = trial.model
    grid_problem = StepGridProblem(trial.start[0], trial.covariance[0], model.xi, model.position, trial.begin, filters)
    return filter_constants(grid_problem, y, progress=lambda k: progress(k / len(y)))


def _compared(trial: BenchTrial, y: np.ndarray, grid_run: StepGridRun) -> Compared:
    """Compare the final parameters of the first run; NaN if the extended filter diverged."""
    unknowns, at, model = trial.problem.unknowns, trial.model.xi, trial.model
    p, k = model.coordinates.size, len(unknowns.inputs)
    try:
        extended = _filter(trial.of_runs(slice(1)), y[:, :1], refuse=True)
        moments = extended.mean[-1, 0, at], extended.last[0, at, at]
    except NumericalError:
        moments = np.full(p, np.nan), np.full((p, p), np.nan)
    both = (grid_run.mean[-1, at], grid_run.joint[-1, k:, k:]), moments
    value, std = np.full((2, len(both), p), np.nan)
    for i, (xi, P) in enumerate(both):
        if np.isfinite(xi).all():
            value[i], std[i] = model.coordinates.with_std(xi, P)
    ends = np.array([(xi, np.sqrt(np.diagonal(P))) for xi, P in both])
    return filters_compared((GRID_FILTER, EXTENDED), unknowns.free, ends, value, std)


INSTANTS = 100
"""Number of instants at which ball loads are evaluated."""

Carried = Callable[[np.ndarray], BallLoads]
"""(d, ξ) (5 + p,), displacements of the inner ring and parameters → ball loads."""


@dataclass(frozen=True)
class RingWatch:
    """Record displacements d = ρ(q) of every bearing and parameters ξ in the first run, with covariance J P Jᵀ, J = [∇ρ on q, 1
    on ξ].

    By force name: rows; mean (T + 1, 5 + p), covariance (T + 1, 5 + p, 5 + p)."""

    model: AugmentedStep
    rows: Mapping[str, slice]
    mean: Mapping[str, np.ndarray]
    covariance: Mapping[str, np.ndarray]

    def __call__(self, k: int, x: np.ndarray, P: np.ndarray) -> None:
        model, p, x, P = self.model, self.model.coordinates.size, x[0], P[0]
        if not np.isfinite(x).all():
            return
        rho, G, *_ = relation_rows(model.system.products, x[model.q], x[model.v])
        for name, rows in self.rows.items():
            J = np.zeros((5 + p, len(x)))
            # drag relations beyond the five displacements are not needed
            J[:5, model.q], J[5:, model.xi] = G[rows][:5], np.eye(p)
            self.mean[name][k] = np.concatenate([rho[rows][:5], x[model.xi]])
            self.covariance[name][k] = J @ P @ J.T


def ring_watch(bench: Bench, model: AugmentedStep, steps: int) -> RingWatch:
    """Recorder for all bearings of the bench over `steps` steps."""
    k, rows = 5 + model.coordinates.size, {name: element.rows for name, (element, _) in bench.rings.items()}
    mean = {name: np.full((steps + 1, k), np.nan) for name in rows}
    return RingWatch(model, rows, mean, {name: np.full((steps + 1, k, k), np.nan) for name in rows})


def rings_estimated(bench: Bench, watch: RingWatch) -> dict[str, RingEstimate]:
    """Bearing loads from the estimated states; bearings of diverged runs are omitted."""
    coordinates, h = watch.model.coordinates, watch.model.h
    return {
        name: _ring(h * np.arange(len(mean)), mean, watch.covariance[name], _carried(bench, coordinates, name))
        for name, mean in watch.mean.items()
        if np.isfinite(mean).all()
    }


def _ring(time: np.ndarray, mean: np.ndarray, covariance: np.ndarray, carried: Carried) -> RingEstimate:
    at = np.unique(np.linspace(0, len(time) - 1, min(INSTANTS, len(time))).round().astype(int))
    balls = [carried(mean[k]) for k in at]
    spreads = [spread(mean[k], covariance[k], carried) for k in at]
    pressure = np.array([ball.pressure.max() for ball in balls])
    pressure_std = [std.flat[np.argmax(ball.pressure)] for ball, (_, std) in zip(balls, spreads, strict=True)]
    worst = index_of_largest(pressure)
    then = {"force_std": spreads[worst][0], "pressure_std": spreads[worst][1], "station": balls[worst].angle}
    return RingEstimate(
        displacement=mean[:, :5],
        std=np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2)[:, :5], 0.0)),
        instants=time[at],
        pressure=pressure,
        pressure_std=np.array(pressure_std),
        worst=record_from(BallsThen, balls[worst], time=float(time[at[worst]]), **then),
    )


def spread(mean: np.ndarray, covariance: np.ndarray, carried: Carried) -> tuple[np.ndarray, np.ndarray]:
    """σ (z, 4) of force [N] and pressure [Pa] of every contact,

        σ² = Σ_k ¼ (g(m + s_k) − g(m − s_k))²,     Σ_k s_k s_kᵀ = P

    by differences over one σ of d and ξ, to include contacts that open. mean (5 + p,), covariance P (5 + p, 5 + p). NaN if a
    displaced bearing is infeasible."""
    force, pressure = 0.0, 0.0
    for s in covariance_factor(covariance).T:
        try:
            ahead, back = carried(mean + s), carried(mean - s)
        except UserError:
            nothing = np.full_like(carried(mean).force, np.nan)
            return nothing, nothing
        force = force + 0.25 * (ahead.force - back.force) ** 2
        pressure = pressure + 0.25 * (ahead.pressure - back.pressure) ** 2
    return np.sqrt(force), np.sqrt(pressure)


def _carried(bench: Bench, coordinates: ParameterCoordinates, name: str) -> Carried:
    """Ball-load function of one bearing with its estimated parameters."""
    element, bearing = bench.rings[name]
    properties = [bench.system.parameters[at].split(".")[-1] for at in element.parameters]
    places = [PARAMETERS.index(key) for key in properties]

    def carried(z: np.ndarray) -> BallLoads:
        values = bearing.parameters
        values[places] = coordinates.theta(z[5:])[0][element.parameters]
        return ball_loads(bearing.with_parameters(values) if places else bearing, z[:5])

    return carried

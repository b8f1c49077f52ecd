"""The filter of a bench: an extended one over loads and parameters, or a bank of them over the parameters; what the balls of its
bearings carry by the estimate, with σ.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.config.bench.connections import BearingForce
from strainsight.errors import ConfigError, NumericalError, UserError
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.model import StepModel
from strainsight.estimation.run import FilterRun, Keep
from strainsight.estimation.smoother import smooth_first
from strainsight.estimation.step_bank import StepBank, StepBankRun, filter_constants
from strainsight.estimation.update import covariance_factor
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.trial import BenchTrial
from strainsight.experiment.filters_compared import filters_compared
from strainsight.multibody.bearing.element import BallLoads, ball_loads
from strainsight.multibody.bearing.geometry import PARAMETERS, Bearing
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.relations import relation_rows
from strainsight.ordering import first_of_largest
from strainsight.records.bench import BallsThen, RingEstimate
from strainsight.records.estimated import BANK, EXTENDED, Compared

LARGEST = 1e9
"""Bytes that a smoother may keep of a filter."""


@dataclass(frozen=True)
class SmoothedLoads:
    """mean, std (T + 1, nu) of the unknown loads of the first run, by all samples [N, N m]; std NaN where it is withheld."""

    mean: np.ndarray
    std: np.ndarray


def keep_for(model: AugmentedStep, steps: int) -> tuple[Keep, tuple[str, ...]]:
    """What a filter of so many steps has to keep for `smoothed_loads`, and a note where that is too much."""
    if not len(model.inputs):
        return "mean", ()
    # covariance, Jacobian and process noise, and the rows of the measurement
    size = 8.0 * steps * model.size * (3 * model.size + model.channels)
    if size <= LARGEST:
        return "first", ()
    return "mean", (
        f"loads are not smoothed: {steps} steps of {model.size} states take {size / 1e9:.3g} GB, at most {LARGEST / 1e9:.3g}; "
        "loads.csv has the filter's; a shorter estimate.duration or a longer estimate.time_step has them smoothed",
    )


def smoothed_loads(model: AugmentedStep, whole: StepModel, run: FilterRun) -> SmoothedLoads | None:
    """None where nothing was kept, or the first run diverged; whole: the model of the run, with offsets behind its states.

    σ is withheld of loads that are smooth where the filter allows for what its step leaves out: of that it takes every step's
    share for new, and the smoother of a smooth load averages what comes again and again as if it went out. Against another
    integrator errors were up to twice σ.
    """
    if run.covariance is None or run.jacobian is None or run.lost[0] >= 0:
        return None
    if not (np.isfinite(run.covariance).all() and np.isfinite(run.jacobian).all()):
        return None
    smoothed = smooth_first(whole, run)
    std = smoothed.std[:, 0, model.u]
    if model.corrected:
        std[:, has_rates(model)] = np.nan
    return SmoothedLoads(smoothed.mean[:, 0, model.u], std)


def has_rates(model: AugmentedStep) -> np.ndarray:
    """Which unknown loads (nu,) are smooth: those with more states than the load itself."""
    ends = np.append(model.loads.first, model.loads.size)
    return np.asarray(np.diff(ends) > 1)


Progress = Callable[[float], None]
"""Called with the share that is done."""


@dataclass(frozen=True)
class FilteredRuns:
    """mean, std (T + 1, B, size) of x, behind it the offsets, NaN in diverged runs; joint (T + 1, b, k, k) covariance of loads
    and parameters; nis (T, B) over the number of channels; lost (B,): the step that lost each run, −1 for none; compared: the
    parameters of the first run by the bank and by the extended filter; smoothed: loads of the first run, of an extended filter;
    notes in words."""

    mean: np.ndarray
    std: np.ndarray
    joint: np.ndarray
    nis: np.ndarray
    lost: np.ndarray
    compared: Compared | None = None
    smoothed: SmoothedLoads | None = None
    notes: tuple[str, ...] = ()


def per_channel(nis: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Over the number of channels (T, B) that were measured, of y (T, B, m)."""
    return np.asarray(nis / np.maximum(np.isfinite(y).sum(axis=2), 1))


def by_extended(
    trial: BenchTrial,
    y: np.ndarray,
    progress: Progress,
    watch: Callable[[int, np.ndarray, np.ndarray], None] | None = None,
) -> FilteredRuns:
    """All runs at once on y (T, B, m); that other forms of the update diverge is a result, too. watch as of `filter_runs`."""
    keep, notes = keep_for(trial.model, len(y))
    D, o = trial.installed
    if errors := D.shape[1]:
        keep = "all"
        _refuse_large(trial, y)
    size = trial.model.size

    def watched(k: int, x: np.ndarray, P: np.ndarray) -> None:
        assert watch is not None
        watch(k, x[:, :size], P[:, :size, :size])

    run = _filter(
        trial,
        y,
        progress=lambda k: progress(k / len(y)),
        watch=None if watch is None else watched,
        keep=keep,
        refuse=trial.problem.estimate.method.update == "iterated",
    )
    smoothed = smoothed_loads(trial.model, trial.offsets.model(trial.model), run)
    std, joint = run.std, run.unknown_covariance
    if errors:
        S = considered(run, y, trial.model.R, D, o)
        std, of_unknowns = np.sqrt(std**2 + np.sum(S**2, axis=3)), S[:, :, trial.model.position]
        joint = joint + of_unknowns @ np.swapaxes(of_unknowns, 2, 3)
        # what later samples say does not undo an error that all of them have
        smoothed = None if smoothed is None else replace(smoothed, std=np.full_like(smoothed.std, np.nan))
    return FilteredRuns(run.mean, std, joint, per_channel(run.nis, y), run.lost, smoothed=smoothed, notes=notes)


def considered(run: FilterRun, y: np.ndarray, R: np.ndarray, D: np.ndarray, o: np.ndarray) -> np.ndarray:
    """S (T + 1, B, N, k): what σ of every constant error of the readings, (D x + o) ν, leaves the estimate off by, where the gain
    knows nothing of it:

        Sₖ₊₁ = (1 − K H) A Sₖ + K (D x̂ + o),     K = P Hᵀ R⁻¹,     σ² = diag(P + S Sᵀ)

    run: kept for all runs; y (T, B, m) with NaN where missing, R (m,); D (m, k, n) on the first n states, o (m, k).
    Source: Schmidt; Gelb, Applied Optimal Estimation (1974), section 7.2.
    """
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
    """Readings (T, B, k) of some channels (k,) by all others of y (T, B, m), their σ with the noise of a sample, and which runs
    (B,) diverge."""
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
            # the run keeps no row of a channel that is missing
            x = np.where(np.isfinite(run.mean[k + 1]), run.mean[k + 1], run.mean[0])
            H = model.measure(x, k)[1][:, part]
            variance[k] += np.sum((H @ S[k + 1] - of_part[k]) ** 2, axis=2)
    return run.gauge_mean[:, :, part], np.sqrt(variance), run.lost >= 0


def _refuse_large(trial: BenchTrial, y: np.ndarray) -> None:
    """What errors of gauges leave is found from the covariances of all runs."""
    steps, runs, size = len(y), y.shape[1], trial.model.size + len(trial.offsets.at)
    needed = 8.0 * steps * runs * size * (3 * size + y.shape[2] + trial.installed[0].shape[1])
    if needed > LARGEST:
        raise ConfigError(
            f"{steps} steps of {runs} runs with {size} states take {needed / 1e9:.3g} GB, at most {LARGEST / 1e9:.3g}",
            key="estimate.tolerances",
            remedy="take fewer runs, a shorter estimate.duration, or leave tolerances out",
        )


def by_bank(trial: BenchTrial, y: np.ndarray, progress: Progress) -> FilteredRuns:
    """One run after the other on y (T, B, m), and the extended filter on the first one's samples beside it."""
    runs = y.shape[1]

    def progress_of(run: int) -> Progress:
        return lambda share: progress((run + share) / runs)

    banks = [_bank(trial, run, y[:, run], progress_of(run)) for run in range(runs)]
    mean, std, joint, nis = (
        np.stack([getattr(bank, key) for bank in banks], axis=1) for key in ("mean", "std", "joint", "nis")
    )
    for k, states in enumerate(mean[1:], start=1):
        # a mean of states that the joints allow is none itself, by the square of what they differ
        states[:] = trial.offsets.projected(trial.model)(states, k)
    nis, lost = per_channel(nis, y), np.full(runs, -1)
    return FilteredRuns(mean, std, joint, nis, lost, _compared(trial, y, banks[0]), notes=_notes(banks))


def _filter(
    trial: BenchTrial,
    y: np.ndarray,
    model: AugmentedStep | None = None,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    progress: Callable[[int], None] | None = None,
    watch: Callable[[int, np.ndarray, np.ndarray], None] | None = None,
    keep: Keep = "mean",
    *,
    refuse: bool,
) -> FilterRun:
    """model and start x, P: by default those of the trial."""
    offsets, method, model = trial.offsets, trial.problem.estimate.method, trial.model if model is None else model
    x, P = start or (trial.start, trial.covariance)
    once = method.update in ("one_shot", "as_printed")
    stays = method.update == "as_printed"
    return filter_runs(
        offsets.model(model),
        x,
        P,
        y,
        keep,
        form="square_root",  # Joseph's loses digits where noise is small, and with them the sign of P
        iterations=1 if once else method.iterations,
        through_step=not once,
        damped=method.update != "undamped",
        project=None if stays else offsets.projected(model),
        progress=progress,
        watch=watch,
        refuse=refuse,
    )


def _of_run(model: AugmentedStep, run: int) -> AugmentedStep:
    """With the offsets of one run alone, and nothing that was remembered."""
    return replace(model, offset=model.offset[run : run + 1])


def _bank(trial: BenchTrial, run: int, y: np.ndarray, progress: Progress) -> StepBankRun:
    """On the samples y (T, m) of one run."""

    def filters(x: np.ndarray, P: np.ndarray, samples: np.ndarray) -> FilterRun:
        each = np.repeat(samples[:, None], len(x), axis=1)
        return _filter(trial, each, _of_run(trial.model, run), (x, P), refuse=False)

    model = trial.model
    bank = StepBank(trial.start[run], trial.covariance[run], model.xi, model.position, trial.begin, filters)
    return filter_constants(bank, y, progress=lambda k: progress(k / len(y)))


def _compared(trial: BenchTrial, y: np.ndarray, bank: StepBankRun) -> Compared:
    """Every parameter at the end of the first run; NaN of an extended filter that diverges."""
    unknowns, at, model = trial.problem.unknowns, trial.model.xi, _of_run(trial.model, 0)
    p, k = model.coordinates.size, len(unknowns.inputs)
    try:
        extended = _filter(trial, y[:, :1], model, (trial.start[:1], trial.covariance[:1]), refuse=True)
        moments = extended.mean[-1, 0, at], extended.last[0, at, at]
    except NumericalError:
        moments = np.full(p, np.nan), np.full((p, p), np.nan)
    both = (bank.mean[-1, at], bank.joint[-1, k:, k:]), moments
    places = [model.system.parameters.index(unknowns.parameters[name]) for name in unknowns.free]
    value, std = np.full((2, len(both), len(places)), np.nan)
    for i, (xi, P) in enumerate(both):
        if np.isfinite(xi).all():
            theta, slopes = model.coordinates.theta(xi)
            value[i], std[i] = theta[places], np.sqrt(np.einsum("ij,jk,ik->i", slopes[places], P, slopes[places]))
    ends = np.array([(xi, np.sqrt(np.diagonal(P))) for xi, P in both])
    return filters_compared((BANK, EXTENDED), unknowns.free, ends, value, std)


def _notes(banks: list[StepBankRun]) -> tuple[str, ...]:
    without, points = (sum(each) for each in zip(*((bank.without, len(bank.weight)) for bank in banks), strict=True))
    if not without:
        return ()
    return (f"{without} of {points} points of the parameters have no weight: filters there diverged or found no start",)


INSTANTS = 100
"""Instants, evenly from start to end, at which balls are looked at."""

Carried = Callable[[np.ndarray], BallLoads]
"""(d, ξ) (5 + p,), five displacements of the inner ring and the parameters → what the balls carry."""


@dataclass(eq=False)
class RingWatch:
    """Gathers, of the first run of a filter, the displacements d = ρ(q) of every bearing with the parameters ξ, and their
    covariance J P Jᵀ, J = [∇ρ on q, 1 on ξ].

    mean (T + 1, 5 + p), covariance (T + 1, 5 + p, 5 + p) by the name of the force.
    """

    model: AugmentedStep
    rows: Mapping[str, slice]
    steps: int
    mean: dict[str, np.ndarray] = field(default_factory=dict)
    covariance: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        k = 5 + self.model.coordinates.size
        for name in self.rows:
            self.mean[name] = np.full((self.steps + 1, k), np.nan)
            self.covariance[name] = np.full((self.steps + 1, k, k), np.nan)

    def __call__(self, k: int, x: np.ndarray, P: np.ndarray) -> None:
        first = x[0]
        if not np.isfinite(first).all():
            return
        model, p = self.model, self.model.coordinates.size
        rho, G, *_ = relation_rows(model.system.products, first[model.q], first[model.v])
        for name, rows in self.rows.items():
            J = np.zeros((5 + p, model.size))
            # one that takes from motion feels its turn, too
            J[:5, model.q], J[5:, model.xi] = G[rows][:5], np.eye(p)
            self.mean[name][k] = np.concatenate([rho[rows][:5], first[model.xi]])
            self.covariance[name][k] = J @ P[0] @ J.T


def ring_watch(bench: Bench, model: AugmentedStep, steps: int) -> RingWatch:
    """Of all bearings of the bench."""
    elements = bench.system.elements
    rows = {e.force.name: e.rows for e in elements if isinstance(bench.config.forces[e.force.name], BearingForce)}
    return RingWatch(model, rows, steps)


def rings_estimated(bench: Bench, watch: RingWatch) -> dict[str, RingEstimate]:
    """Every bearing by the estimate; none of one whose run diverged."""
    time = watch.model.h * np.arange(watch.steps + 1)
    rings = {}
    for name, mean in watch.mean.items():
        if np.isfinite(mean).all():
            carried = _carried(bench, watch.model.coordinates, name)
            rings[name] = _ring(time, mean, watch.covariance[name], carried)
    return rings


def _ring(time: np.ndarray, mean: np.ndarray, covariance: np.ndarray, carried: Carried) -> RingEstimate:
    at = np.unique(np.linspace(0, len(time) - 1, min(INSTANTS, len(time))).round().astype(int))
    balls = [carried(mean[k]) for k in at]
    pressure = np.array([ball.pressure.max() for ball in balls])
    std = np.empty(len(at))
    for i, k in enumerate(at):
        where = np.unravel_index(np.argmax(balls[i].pressure), balls[i].pressure.shape)
        std[i] = spread(mean[k], covariance[k], carried)[1][where]
    worst = first_of_largest(pressure)
    force_std, pressure_std = spread(mean[at[worst]], covariance[at[worst]], carried)
    return RingEstimate(
        displacement=mean[:, :5],
        std=np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2)[:, :5], 0.0)),
        instants=time[at],
        pressure=pressure,
        pressure_std=std,
        worst=BallsThen(
            time=float(time[at[worst]]),
            station=balls[worst].angle,
            force=balls[worst].force,
            force_std=force_std,
            pressure=balls[worst].pressure,
            pressure_std=pressure_std,
        ),
    )


def spread(mean: np.ndarray, covariance: np.ndarray, carried: Carried) -> tuple[np.ndarray, np.ndarray]:
    """σ (z, 4) of force [N] and pressure [Pa] of every contact,

        σ² = Σ_k ¼ (g(m + s_k) − g(m − s_k))²,     Σ_k s_k s_kᵀ = P

    exact where g is straight; by differences as long as the σ of d and ξ, so that a contact that opens within them counts.
    mean (5 + p,), covariance P (5 + p, 5 + p). NaN where a displaced bearing cannot be.
    """
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
    """Of one bearing, with the parameters of it that are free."""
    stated = bench.config.forces[name]
    assert isinstance(stated, BearingForce)
    bearing: Bearing = bench.bearings[stated.bearing]
    element = next(e for e in bench.system.elements if e.force.name == name)
    properties = [bench.system.parameters[at].split(".")[-1] for at in element.parameters]
    places = [PARAMETERS.index(key) for key in properties]

    def carried(z: np.ndarray) -> BallLoads:
        values = bearing.parameters
        values[places] = coordinates.theta(z[5:])[0][element.parameters]
        return ball_loads(bearing.with_parameters(values) if places else bearing, z[:5])

    return carried

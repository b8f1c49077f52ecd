"""The augmented extended Kalman filter (1.53-1.60) for a batch of runs of any model with a step and a measurement."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.belief import belief_of
from strainsight.estimation.biased import driven_with_offsets
from strainsight.estimation.core import StepModel
from strainsight.estimation.iterated import refine
from strainsight.estimation.model import FilterModel
from strainsight.estimation.run import FilterRun, Keep, Record
from strainsight.estimation.update import Form, apply, output_std, predict, update, whiten

__all__ = [
    "FilterRun",
    "all_lost",
    "apply",
    "filter_runs",
    "output_std",
    "predict",
    "run_filter",
    "update",
]

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
    form: Form = "joseph",
    iterations: int = 1,
    through_step: bool = False,
    biased: np.ndarray | None = None,
    refuse: bool = True,
) -> FilterRun:
    """`filter_runs` of the reduced model under known loads.

    known (T, HOLD, n_known) hold coefficients [N]; measurement (T/every, m) or (T/every, B, m), one row a sample;
    biased (b,): channels with an unknown offset, behind x* in mean, covariance and all that is found.
    Raises ValueError where the known loads end before the samples.
    """
    return filter_runs(
        driven_with_offsets(model, known, biased),
        mean,
        covariance,
        samples_by_step(model, known, measurement),
        keep,
        form=form,
        iterations=iterations,
        through_step=through_step,
        refuse=refuse,
    )


def samples_by_step(model: FilterModel, known: np.ndarray, measurement: np.ndarray) -> np.ndarray:
    """Samples (T, …, m) of every step, NaN where none is taken, of a measurement (T/every, …, m).

    Raises ValueError where the known loads (T, HOLD, n_known) end before the samples.
    """
    samples = np.asarray(measurement, dtype=float)
    if model.every > 1:
        spread = np.full((len(samples) * model.every, *samples.shape[1:]), np.nan)
        spread[model.every - 1 :: model.every] = samples
        samples = spread
    if len(known) < len(samples):
        raise ValueError(f"known loads for {len(known)} steps, samples for {len(samples)}")
    return samples


def filter_runs(
    model: StepModel,
    mean: np.ndarray,
    covariance: np.ndarray,
    measurement: np.ndarray,
    keep: Keep = "mean",
    *,
    form: Form = "joseph",
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
    a number has. iterations: 1 is the extended Kalman filter, more make the update a damped Gauss-Newton iteration,
    through_step with the step inside (`refine`); a linear model has nothing to iterate. damped: whether an increment that
    raises the cost or fails is halved. project: puts x (B, n) at instant k back on constraints after every update, its
    covariance is left as it is; a step with the constraints inside and an update through it need none, but save a step with it.
    progress: called with
    every step that begins; watch: with every instant k, x (B, n) and P (b, n, n) after the update, the start (k = 0) first.
    No scaling of the states: products and factors commute with a diagonal scaling, and P is never inverted. A covariance
    that no run changes (linear, one set of sensors, the same samples missing in all) is computed once for all runs, and
    not again once it is steady, as long as no sample is missing and the noise is the same.
    Raises NumericalError where every run diverges and `refuse`, or where HPHᵀ + R is not positive definite.
    """
    y = measurement if measurement.ndim == 3 else measurement[:, None, :]
    there = np.isfinite(y)
    sets = max(model.sets, len(covariance) if covariance.ndim == 3 else 1)
    runs = max(y.shape[1], sets, mean.size // model.size)
    b = 1 if sets == 1 and model.linear and np.all(there == there[:, :1]) else runs
    there = there[:, :1] if b == 1 else np.broadcast_to(there, (len(y), runs, y.shape[2]))
    iterating = (iterations > 1 or through_step) and not model.linear

    x = np.broadcast_to(mean, (runs, model.size)).astype(float)
    P = np.broadcast_to(covariance, (b, model.size, model.size)).astype(float)
    start = x.copy(), P.copy()
    belief = belief_of(form, P)
    # a model of one set of noises that has one for every run has found them on the way, and `process` will not tell later
    each = model.sets == 1 and model.process(0).ndim == 3
    record = Record(model, len(y), runs, b, keep, iterating, found=each)
    record.state(0, x, P)
    if watch is not None:
        watch(0, x, P)
    G, L, calm = P, P, 0
    same: tuple[np.ndarray | None, ...] = (None, None, None)
    for k in range(len(y)):
        if progress is not None:
            progress(k)
        model.begin(x, k)
        instant, noise = (k + 1) * model.h, (model.before(k), model.process(k), model.noise(k))
        before, process, R = noise
        calm = calm if all(new is old for new, old in zip(noise, same, strict=True)) and there[k].all() else 0
        same = noise
        ahead, A = model.step(x, k)
        A = _where_it_failed(ahead, A, np.eye(model.size))
        H: np.ndarray | None = None
        adjusted = None
        if not there[k].any():
            x, belief = ahead, belief.predicted(A, process, before)
        else:
            expected, H = model.measure(ahead, k)
            record.innovation[k] = y[k] - expected
            innovation, H = record.innovation[k], _where_it_failed(ahead, H, 0.0)
            if not there[k].all():
                H, innovation = np.where(there[k][..., None], H, 0.0), np.nan_to_num(innovation)
            if through_step and iterating:
                R = np.broadcast_to(R, (b, y.shape[2]))
                L = belief.expected(A, process, before, H, R, instant)
            elif calm < CALM:
                prior, R = belief.predicted(A, process, before), np.broadcast_to(R, (b, y.shape[2]))
                after, G, L = prior.updated(H, R, instant)
            adjusted = whiten(L, innovation)
            record.whitened[k], record.spread[k] = adjusted, np.diagonal(L, axis1=-2, axis2=-1)
            if not iterating:
                x, belief = ahead + apply(G, adjusted), after
            else:
                if through_step:
                    full = belief.covariance if before is None else belief.covariance + before
                    found = refine(model, k, x, full, process, R, y[k], iterations, damped, project is not None)
                    A = _where_it_failed(found.x, found.A, np.eye(model.size))
                    prior = belief.predicted(A, process, before)
                else:
                    found = refine(model, k, ahead, prior.covariance, None, R, y[k], iterations, damped)
                x, H = found.x, _where_it_failed(found.x, found.H, 0.0)
                belief, _, L = prior.updated(H, R, instant)
                adjusted = whiten(L, found.innovation)
                record.spread[k] = np.diagonal(L, axis1=-2, axis2=-1)
            if project is not None:
                x = project(x, k + 1)
        astray = model.lost(x)
        if astray.any():
            record.lost[astray & (record.lost < 0)] = k + 1
            if refuse and np.all(record.lost >= 0):
                raise all_lost(model, record.lost)
            x = np.where(astray[:, None], start[0], x)
            belief = belief if b == 1 else belief.reset(astray, start[1])
        if calm < CALM:
            last, P = P, belief.covariance
            calm = calm + 1 if b == 1 and model.linear and H is not None and _unmoved(last, P, prior.covariance) else 0
            record.state(k + 1, x, P)
            record.readings(k, *model.measure(x, k), P)
        else:
            record.state(k + 1, x, None)
            record.readings(k, *model.measure(x, k), None)
        record.linearised(k, A, H, adjusted)
        record.noises(k, process, R)
        if watch is not None:
            watch(k + 1, x, P)
    return record.finished(P, there)


def _where_it_failed(x: np.ndarray, X: np.ndarray, instead: np.ndarray | float) -> np.ndarray:
    """X (b, ., .) with `instead` in the runs whose x (B, n) is not finite: they are lost, and must not spoil the others."""
    failed = ~np.isfinite(x.sum(axis=1))
    return np.where(failed[:, None, None], instead, X) if failed.any() and len(X) == len(failed) else X


def _unmoved(last: np.ndarray, P: np.ndarray, prior: np.ndarray) -> bool:
    """Whether P (1, n, n) is what it was, to the rounding of the covariance it was updated from."""
    size = np.sqrt(np.diagonal(prior[0]))
    return bool(np.all(np.abs(P[0] - last[0]) <= UNMOVED * size[:, None] * size))


def all_lost(model: StepModel, lost: np.ndarray) -> NumericalError:
    """What to say where every run diverges; lost (B,): the steps that lost them."""
    return NumericalError(
        f"the filter diverged: {model.loss} in all of {len(lost)} runs, first at {lost.min() * model.h:g} s",
        remedy="choose a guess nearer to the truth, a smaller initial standard deviation or a smaller time step",
    )

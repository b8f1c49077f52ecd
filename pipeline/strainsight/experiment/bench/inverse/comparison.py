"""An estimate of a bench beside what is true: histories as they are written, and how good they are in numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.config.bench.estimate import FromRun
from strainsight.estimation.consistency import settling_time
from strainsight.estimation.decision import Claim, claim_in_time, claim_of, not_identified
from strainsight.experiment.bench.inverse.estimation import BenchEstimation
from strainsight.records.bench import (
    BenchEstimated,
    LoadHistory,
    LoadRuns,
    ParameterHistory,
    ParameterRuns,
    SensorMatch,
)

Numbers = dict[str, float | bool]
"""Of a summary, by name."""
NONE = 1e-9
"""Share of σ below which the true load is none at all."""
SETTLING = 0.1
"""Share of the record, from its start, that fits and quotients leave out: there the first guess is forgotten."""
RELATIVE = 5
"""Components of a relative motion."""
STILL = 0.01
"""Share of the largest component of its unit below which one hardly moves."""
LARGE = 0.3
"""Share of its largest value above which a load is divided by another: near zero a quotient says nothing."""


def load_numbers(name: str, true: np.ndarray, estimate: np.ndarray, std: np.ndarray) -> Numbers:
    """slope and offset [N, N m] of the fit estimate = slope · true + offset, settled; the rms error and the mean σ over the
    second half, and the largest error, over the largest |true|. true, estimate, std (T,) after the start."""
    slope, offset = _fit(*_settled(true, estimate))
    largest = float(np.abs(true).max())
    off = estimate - true
    fit: Numbers = {f"slope.{name}": slope, f"offset.{name}": offset}
    if largest <= NONE * float(std.max()):
        return fit  # errors of a load that is none are no share of it
    return fit | {
        f"error.{name}": float(np.sqrt(np.mean(off[len(off) // 2 :] ** 2))) / largest,
        f"largest_error.{name}": float(np.abs(off).max()) / largest,
        f"std.{name}": float(std[len(std) // 2 :].mean()) / largest,
    }


def smoothed_name(name: str) -> str:
    """What a load is called in claims once it is smoothed."""
    return f"smoothed.{name}"


def smoothed_numbers(name: str, true: np.ndarray, estimate: np.ndarray, std: np.ndarray) -> Numbers:
    """The rms error and the mean σ of a smoothed load over the second half, over the largest |true|: the same as of the filter's
    estimate. true, estimate, std (T,) after the start."""
    numbers = load_numbers(name, true, estimate, std)
    return {
        f"smoothed_{key}.{name}": numbers[f"{key}.{name}"] for key in ("error", "std") if f"{key}.{name}" in numbers
    }


def history_numbers(name: str, estimate: np.ndarray, std: np.ndarray) -> Numbers:
    """Of a load that nobody knows: RMS and largest size of its estimate, and RMS of σ [N, N m], settled. (T,) each."""
    estimate, std = _settled(estimate, std)
    return {
        f"rms.{name}": float(np.sqrt(np.mean(estimate**2))),
        f"largest.{name}": float(np.abs(estimate).max()),
        f"rms_std.{name}": float(np.sqrt(np.mean(std**2))),
    }


def ratio_numbers(name: str, elsewhere: np.ndarray, estimate: np.ndarray) -> Numbers:
    """A load here over the one of the other bench: RMS over RMS, second half; settled, an affine fit, and the quotient where the
    other is large. (T,) each."""
    here, other = (float(np.linalg.norm(load[len(load) // 2 :])) for load in (estimate, elsewhere))
    elsewhere, estimate = _settled(elsewhere, estimate)
    slope, offset = _fit(elsewhere, estimate)
    large = np.abs(elsewhere) > LARGE * np.abs(elsewhere).max(initial=0.0)
    quotient = estimate[large] / elsewhere[large] if large.any() else np.array([np.nan])
    return {
        f"ratio_slope.{name}": slope,
        f"ratio_offset.{name}": offset,
        f"ratio_rms.{name}": here / other if other > 0 else float("nan"),
        f"ratio_mean.{name}": float(quotient.mean()),
        f"ratio_low.{name}": float(quotient.min()),
        f"ratio_high.{name}": float(quotient.max()),
    }


def parameter_numbers(name: str, true: np.ndarray, last: np.ndarray, std: np.ndarray) -> Numbers:
    """Error and σ at the end of the first run, relative to the truth; rms of error/σ over all runs.

    true, last, std (runs,)."""
    size = abs(float(true[0]))
    size = size if size > 0 else 1.0
    numbers: Numbers = {
        f"error.{name}": abs(float(last[0] - true[0])) / size,
        f"std.{name}": float(std[0]) / size,
    }
    if len(last) > 1:
        numbers[f"ratio.{name}"] = float(np.sqrt(np.mean(((last - true) / std) ** 2)))
        numbers[f"largest_error.{name}"] = float(np.abs(last - true).max()) / size
    return numbers


def mismatch_numbers(name: str, measured: np.ndarray, expected: np.ndarray) -> Numbers:
    """rms of measured − expected over that of measured, of every component (T, components) and of the worst; a component that
    hardly moves counts beside the largest of its unit (of a pair of metres and radians: x, y, z, then tilts)."""
    known = np.isfinite(measured)
    if not known.any():
        return {}
    count = np.maximum(known.sum(axis=0), 1)
    off, whole = (
        np.sqrt(np.sum(np.where(known, x, 0.0) ** 2, axis=0) / count) for x in (measured - expected, measured)
    )
    off[~known.any(axis=0)] = np.nan
    for kind in (slice(3), slice(3, None)) if whole.size == RELATIVE else (slice(None),):
        whole[kind] = np.where(whole[kind] < STILL * whole[kind].max(), whole[kind].max(), whole[kind])
    share = np.divide(off, whole, out=np.full_like(off, np.nan), where=whole > 0)
    if not np.isfinite(share).any():
        return {}
    numbers: Numbers = {f"mismatch.{name}": float(np.nanmax(share))}
    if len(share) > 1:
        numbers |= {
            f"mismatch.{name}.{i}": float(value) for i, value in enumerate(share, start=1) if np.isfinite(value)
        }
    return numbers


def size_numbers(name: str, elsewhere: np.ndarray, expected: np.ndarray) -> Numbers:
    """rms of what each component of a sensor reads here over that of what it reads on the other bench (T, components)."""
    known = np.isfinite(elsewhere) & np.isfinite(expected)
    here, other = (np.sqrt(np.sum(np.where(known, x, 0.0) ** 2, axis=0)) for x in (expected, elsewhere))
    share = np.divide(here, other, out=np.full_like(here, np.nan), where=other > 0)
    return {f"size.{name}.{i}": float(value) for i, value in enumerate(share, start=1) if np.isfinite(value)}


def _settled(*histories: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(history[int(SETTLING * len(history)) :] for history in histories)


def _fit(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """slope, offset of y over x; a constant x has the slope of their means and no offset."""
    size = float(np.abs(x).max(initial=0.0)) or 1.0  # of a load of 1e-200 N the square is none
    x = x / size
    spread = x - x.mean()
    if not np.any(np.abs(spread) > 1e-9):
        return (float(y.mean() / x.mean() / size) if x.mean() else float("nan")), 0.0
    slope = float(spread @ y / (spread @ spread))
    return slope / size, float(y.mean() - slope * x.mean())


SETTLING_TIME = "settling_time"
"""Of a parameter; infinite where it never settles."""
SETTLED = 1e-3
"""Share of the truth that a parameter stays within once it has settled: a bearing's geometry is known to a per cent before."""
LEARNED = 0.5
"""Share of its first σ below which a parameter counts as learned."""


@dataclass(frozen=True)
class BenchComparison:
    """record: what is written; numbers: of every load, parameter and sensor, those that are finite; claims: whether the
    estimate of every unknown keeps to its σ, where the truth is known."""

    record: BenchEstimated
    numbers: Numbers
    claims: dict[str, Claim]


def compared(result: BenchEstimation) -> BenchComparison:
    """Histories of the first run, ends of all runs; where σ is withheld, NaN, no number of it, and no claim."""
    problem, filtered = result.problem, result.filtered
    numbers: Numbers = {}
    claims: dict[str, Claim | None] = {}
    inputs: dict[str, LoadHistory] = {}
    input_runs: dict[str, LoadRuns] = {}
    for i, name in enumerate(problem.estimate.inputs):
        inputs[name], error, claims[name], more = _load(result, name, i)
        numbers |= more
        claims[smoothed_name(name)], more = _smoothed(result, name, i)
        numbers |= more
        if error is not None:
            input_runs[name] = LoadRuns(error=error)
    parameters: dict[str, ParameterHistory] = {}
    parameter_runs: dict[str, ParameterRuns] = {}
    for i, name in enumerate(problem.unknowns.free):
        parameters[name], ends, claims[name], more = _parameter(result, name, i)
        numbers |= more
        if len(ends.estimate) > 1:
            parameter_runs[name] = ends
    sensors: dict[str, SensorMatch] = {}
    for name in problem.sensors.channels:
        match = sensors[name] = _sensor(result, name)
        if match.measured is not None:
            numbers |= mismatch_numbers(name, match.measured, match.expected)
            if isinstance(problem.estimate.measured, FromRun) and not match.used:
                numbers |= size_numbers(name, match.measured, match.expected)
    record = BenchEstimated(
        time=problem.time,
        q=filtered.mean[:, 0, result.trial.model.q],
        violation=np.array([_violation(result, k) for k in range(len(problem.time))]),
        nis=filtered.nis[:, 0],
        lost=filtered.lost,
        inputs=inputs,
        parameters=parameters,
        sensors=sensors,
        input_runs=input_runs,
        parameter_runs=parameter_runs,
        seeds=numbers_of_seeds(result),
        bearings=result.rings,
        compared=filtered.compared,
    )
    judged = {name: claim for name, claim in claims.items() if claim is not None}
    kept = {key: value for key, value in numbers.items() if np.isfinite(value) or key.startswith(SETTLING_TIME)}
    return BenchComparison(record, kept, judged)


def _load(result: BenchEstimation, name: str, i: int) -> tuple[LoadHistory, np.ndarray | None, Claim | None, Numbers]:
    """The history of an unknown load, the errors (runs,) of several runs, whether they keep to σ, and its numbers."""
    at = result.trial.model.u[i]
    mean = result.filtered.mean[:, :, at]
    std = np.where(np.isfinite(mean), result.filtered.std[:, :, at], np.nan)
    true = result.true_load(name)
    known, elsewhere = bool(np.isfinite(true).all()), result.reality.elsewhere.get(name)
    numbers: Numbers = {}
    error = claim = None
    if known:
        numbers |= load_numbers(name, true[1:, 0], mean[1:, 0], std[1:, 0])
        late = slice(len(mean) // 2, None)
        off = (mean - true)[late]
        if f"error.{name}" in numbers:
            claim = claim_in_time(off, std[late], starts=result.starts)
        if mean.shape[1] > 1:
            error = np.sqrt(np.mean(off**2, axis=0))
            if np.isfinite(std[late]).any():
                numbers[f"ratio.{name}"] = float(np.sqrt(np.nanmean((off / std[late]) ** 2)))
    elif elsewhere is None:
        numbers |= history_numbers(name, mean[1:, 0], std[1:, 0])
    if elsewhere is not None:
        numbers |= ratio_numbers(name, elsewhere[1:], mean[1:, 0])
    smoothed = result.filtered.smoothed
    history = LoadHistory(
        estimate=mean[:, 0],
        std=std[:, 0],
        smoothed=None if smoothed is None else smoothed.mean[:, i],
        smoothed_std=None if smoothed is None or np.isnan(smoothed.std[:, i]).all() else smoothed.std[:, i],
        true=true[:, 0] if known else None,
        there=elsewhere,
    )
    return history, error, claim, numbers


def _smoothed(result: BenchEstimation, name: str, i: int) -> tuple[Claim | None, Numbers]:
    """Whether a load of the first run keeps to σ once it is smoothed, and its numbers, where the truth is known."""
    true = result.true_load(name)[:, 0]
    if result.filtered.smoothed is None or not np.isfinite(true).all():
        return None, {}
    mean, std = result.filtered.smoothed.mean[:, i], result.filtered.smoothed.std[:, i]
    numbers = smoothed_numbers(name, true[1:], mean[1:], std[1:])
    if not numbers:
        return None, {}
    late = slice(len(mean) // 2, None)
    return claim_in_time((mean - true)[late], std[late], of="smoothed"), numbers


def _parameter(
    result: BenchEstimation, name: str, i: int
) -> tuple[ParameterHistory, ParameterRuns, Claim | None, Numbers]:
    """The history of a parameter, where all runs start and end, whether they end within their σ, and its numbers."""
    theta, std = in_theta(result, result.place(name))
    true, starts = result.true_parameter(name), result.starts
    known = bool(np.isfinite(true).all())
    apart = starts > 1 and bool(not_identified(theta[-1, :starts], std[-1, :starts]))
    learned = bool(np.all(std[-1, :starts] < LEARNED * result.problem.unknowns.std[i]))
    claim = claim_of(theta[-1] - true, std[-1], alike=starts)  # starts within a seed are one draw
    wrong = claim is not None and claim.overconfident
    withheld = bool(np.isfinite(theta[-1]).any() and not np.isfinite(std[-1]).any())
    numbers: Numbers = {}
    if not withheld:
        numbers[f"identified.{name}"] = learned and not apart and not (starts > 1 and wrong)
    if known:
        numbers |= parameter_numbers(name, true, theta[-1], std[-1])
        numbers[f"{SETTLING_TIME}.{name}"] = settling_time(result.problem.time, theta[:, 0], float(true[0]), SETTLED)
    else:
        numbers |= {f"estimate.{name}": float(theta[-1, 0]), f"rms_std.{name}": float(std[-1, 0])}
    history = ParameterHistory(estimate=theta[:, 0], std=std[:, 0], true=float(true[0]) if known else None)
    error = theta[-1] - true if known else None
    return history, ParameterRuns(start=theta[0], estimate=theta[-1], std=std[-1], error=error), claim, numbers


def in_theta(result: BenchEstimation, column: int) -> tuple[np.ndarray, np.ndarray]:
    """A parameter and its σ, √(s P_ξξ sᵀ) with s = ∂θ/∂ξ (T + 1, runs)."""
    xi, P = result.filtered.mean[:, :, result.trial.model.xi], result.xi_covariance
    theta, std = np.full(xi.shape[:2], np.nan), np.full(xi.shape[:2], np.nan)
    for at in np.ndindex(xi.shape[:2]):
        if np.isfinite(xi[at]).all():
            theta[at], std[at] = _theta_at(result, column, xi[at], P[at[0], min(at[1], P.shape[1] - 1)])
    return theta, std


def _theta_at(result: BenchEstimation, column: int, xi: np.ndarray, P: np.ndarray) -> tuple[float, float]:
    values, slopes = result.problem.unknowns.coordinates.theta(xi)
    s = slopes[column]
    return float(values[column]), float(np.sqrt(max(float(s @ P @ s), 0.0)))


def _sensor(result: BenchEstimation, name: str) -> SensorMatch:
    used, part = name in result.problem.used.channels, result.problem.sensors.channels[name]
    measured = (
        result.measured[:, 0, result.problem.used.channels[name]] if used else result.reality.readings[:, 0, part]
    )
    known = bool(np.isfinite(measured).any())
    bias = bias_std = None
    offset, channels = result.trial.offsets.at, result.problem.used.channels.get(name, slice(0, 0))
    which = np.flatnonzero((offset >= channels.start) & (offset < channels.stop))
    if len(which):
        bias, bias_std = np.zeros((2, part.stop - part.start))
        at, size = offset[which] - channels.start, result.trial.model.size
        bias[at], bias_std[at] = (
            result.filtered.mean[-1, 0, size + which],
            result.filtered.std[-1, 0, size + which],
        )
    without = result.without if used else None
    return SensorMatch(
        used=used,
        expected=result.reading[1:, 0, part],
        measured=measured if known else None,
        predicted=None if without is None else without.predicted[:, 0, channels],
        predicted_std=None if without is None else without.std[:, 0, channels],
        left_in=None if without is None else without.left_in[channels],
        bias=bias,
        bias_std=bias_std,
    )


def _violation(result: BenchEstimation, k: int) -> float:
    x = result.filtered.mean[k, :1]
    return float(result.trial.model.violation(x, k)[0]) if np.isfinite(x).all() else float("nan")


def numbers_of_seeds(result: BenchEstimation) -> dict[str, np.ndarray]:
    """Name → the number of every seed (seeds,) by its first start, NaN of a seed that diverged: of loads, parameters, innovations
    and sensors, as in the summary. None of a single seed."""
    runs = range(0, result.measured.shape[1], result.starts)
    if len(runs) < 2:
        return {}
    each = [_numbers(result, seed, run) if result.filtered.lost[run] < 0 else {} for seed, run in enumerate(runs)]
    names = dict.fromkeys(name for numbers in each for name in numbers)
    return {name: np.array([float(numbers.get(name, np.nan)) for numbers in each]) for name in names}


def _numbers(result: BenchEstimation, seed: int, run: int) -> Numbers:
    """Of one seed."""
    problem, mean, std, nis = (
        result.problem,
        result.filtered.mean,
        result.filtered.std,
        result.filtered.nis,
    )
    numbers: Numbers = {"nis": float(np.nanmean(nis[len(nis) // 2 :, run]))}
    for name, at in zip(problem.estimate.inputs, result.trial.model.u, strict=True):
        load = result.true_load(name)[1:, run]
        if np.isfinite(load).all():
            numbers |= load_numbers(name, load, mean[1:, run, at], std[1:, run, at])
    for name in problem.unknowns.free:
        true = result.true_parameter(name)[run : run + 1]
        P = result.xi_covariance[-1, min(run, result.xi_covariance.shape[1] - 1)]
        last, size = _theta_at(result, result.place(name), mean[-1, run, result.trial.model.xi], P)
        if np.isfinite(true):
            numbers |= parameter_numbers(name, true, np.array([last]), np.array([size]))
    for name, part in problem.sensors.channels.items():
        used, of_seed = problem.used.channels.get(name), min(seed, result.reality.readings.shape[1] - 1)
        measured = result.reality.readings[:, of_seed, part] if used is None else result.measured[:, run, used]
        numbers |= mismatch_numbers(name, measured, result.reading[1:, seed, part])
    return numbers

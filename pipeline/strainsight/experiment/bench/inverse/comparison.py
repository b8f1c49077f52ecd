"""Comparison of a bench estimate with the truth: histories and error numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
"""Summary numbers by name."""
NONE = 1e-9
"""Load relative to σ below which the true load is zero."""
SETTLING = 0.1
"""Initial share of the record that fits and quotients omit."""
RELATIVE = 5
"""Components of a relative motion."""
STILL = 0.01
"""Share of the largest component of its unit below which a component is nearly at rest."""
LARGE = 0.3
"""Share of its largest value from which a load is used as divisor."""


def load_numbers(name: str, true: np.ndarray, estimate: np.ndarray, std: np.ndarray) -> Numbers:
    """Numbers of a load: fit estimate = slope · true + offset [N, N m]; RMS error, mean σ (second half) and largest error,
    relative to the largest |true|. true, estimate, std (T,)."""
    slope, offset = _fit(*_settled(true, estimate))
    largest = float(np.abs(true).max())
    off = estimate - true
    fit: Numbers = {f"slope.{name}": slope, f"offset.{name}": offset}
    if largest <= NONE * float(std.max()):
        return fit  # no relative errors of a zero load
    return fit | {
        f"error.{name}": float(np.sqrt(np.mean(off[len(off) // 2 :] ** 2))) / largest,
        f"largest_error.{name}": float(np.abs(off).max()) / largest,
        f"std.{name}": float(std[len(std) // 2 :].mean()) / largest,
    }


def smoothed_name(name: str) -> str:
    """Name of a smoothed load in claims."""
    return f"smoothed.{name}"


def history_numbers(name: str, estimate: np.ndarray, std: np.ndarray) -> Numbers:
    """Numbers of a load without known truth: RMS and largest value of the estimate, RMS of σ [N, N m]; (T,) each."""
    estimate, std = _settled(estimate, std)
    return {
        f"rms.{name}": float(np.sqrt(np.mean(estimate**2))),
        f"largest.{name}": float(np.abs(estimate).max()),
        f"rms_std.{name}": float(np.sqrt(np.mean(std**2))),
    }


def ratio_numbers(name: str, elsewhere: np.ndarray, estimate: np.ndarray) -> Numbers:
    """Ratio of a load to that of the other bench: RMS ratio (second half), affine fit, and quotient where the other is large;
    (T,) each."""
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


def mismatch_numbers(name: str, measured: np.ndarray, expected: np.ndarray) -> Numbers:
    """RMS of measured − expected relative to RMS of measured, of every component (T, components) and of the worst; components
    nearly at rest are relative to the largest of their unit."""
    known = np.isfinite(measured)
    off, whole = _rms(measured - expected, known), _rms(measured, known)
    for kind in (slice(3), slice(3, None)) if whole.size == RELATIVE else (slice(None),):
        whole[kind] = np.where(whole[kind] < STILL * whole[kind].max(), whole[kind].max(), whole[kind])
    share = np.where(known.any(axis=0), _shares(off, whole), np.nan)
    if not np.isfinite(share).any():
        return {}
    return {f"mismatch.{name}": float(np.nanmax(share))} | (
        _by_component(f"mismatch.{name}", share) if len(share) > 1 else {}
    )


def size_numbers(name: str, elsewhere: np.ndarray, expected: np.ndarray) -> Numbers:
    """RMS ratio of the readings of each component (T, components) to those on the other bench."""
    known = np.isfinite(elsewhere) & np.isfinite(expected)
    return _by_component(f"size.{name}", _shares(_rms(expected, known), _rms(elsewhere, known)))


def _rms(x: np.ndarray, known: np.ndarray) -> np.ndarray:
    """RMS of every component of x (T, components) over known samples."""
    return np.asarray(np.sqrt(np.sum(np.where(known, x, 0.0) ** 2, axis=0) / np.maximum(known.sum(axis=0), 1)))


def _shares(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.full_like(part, np.nan), where=whole > 0)


def _by_component(key: str, values: np.ndarray) -> Numbers:
    return {f"{key}.{i}": float(value) for i, value in enumerate(values, start=1) if np.isfinite(value)}


def _settled(*histories: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(history[int(SETTLING * len(history)) :] for history in histories)


def _fit(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope and offset of y over x; for constant x the ratio of the means and no offset."""
    size = float(np.abs(x).max(initial=0.0)) or 1.0  # avoids underflow of squares
    x = x / size
    spread = x - x.mean()
    if not np.any(np.abs(spread) > 1e-9):
        return (float(y.mean() / x.mean() / size) if x.mean() else float("nan")), 0.0
    slope = float(spread @ y / (spread @ spread))
    return slope / size, float(y.mean() - slope * x.mean())


SETTLING_TIME = "settling_time"
"""Settling time of a parameter, infinite if it never settles."""
SETTLED = 1e-3
"""Relative error within which a parameter counts as settled."""
LEARNED = 0.5
"""Ratio of final to initial σ below which a parameter counts as identified."""


@dataclass(frozen=True)
class BenchComparison:
    """record: datasets; numbers: finite summary numbers of loads, parameters and sensors; claims: calibration of σ of unknowns
    with known truth."""

    record: BenchEstimated
    numbers: Numbers
    claims: dict[str, Claim]


def compare(result: BenchEstimation) -> BenchComparison:
    """Compare the first run in time and the final values of all runs; without numbers and claims of a withheld σ."""
    problem, filtered = result.problem, result.filtered
    loads, parameters = list(problem.estimate.inputs), problem.unknowns.free
    numbers = run_numbers(result, 0)
    for name in loads:
        numbers |= _load_numbers(result, name)
    claims = _claims(result, numbers)
    for name in parameters:
        numbers |= _parameter_numbers(result, name, claims.get(name))
    sensors = {name: _sensor(result, name) for name in problem.sensors.channels}
    if isinstance(problem.estimate.measured, FromRun):
        for name, match in sensors.items():
            if match.measured is not None and not match.used:
                numbers |= size_numbers(name, match.measured, match.expected)
    several = result.measured.shape[1] > 1
    errors = result.errors.items() if several else ()
    record = BenchEstimated(
        time=problem.time,
        q=filtered.mean[:, 0, result.trial.model.q],
        violation=np.array([_violation(result, k) for k in range(len(problem.time))]),
        nis=filtered.nis[:, 0],
        lost=filtered.lost,
        inputs={name: _load_history(result, name) for name in loads},
        parameters={name: _parameter_history(result, name) for name in parameters},
        sensors=sensors,
        input_runs={
            name: LoadRuns(error=np.sqrt(np.mean(_late(off) ** 2, axis=0))) for name, off in errors if name in loads
        },
        parameter_runs={name: _ends(result, name) for name in parameters if several},
        seeds=numbers_of_seeds(result),
        bearings=result.rings,
        compared=filtered.compared,
    )
    finite = {key: value for key, value in numbers.items() if np.isfinite(value) or key.startswith(SETTLING_TIME)}
    return BenchComparison(record, finite, claims)


def run_numbers(result: BenchEstimation, run: int) -> Numbers:
    """Errors of unknowns with known truth, and mismatches of sensors, in the first run of a seed."""
    problem, seed, numbers = result.problem, run // result.starts, Numbers()
    for name, (estimate, std) in result.values.items():
        if name not in result.truths:
            continue
        true, mean, sigma = result.truths[name][:, run], estimate[:, run], std[:, run]
        if name in problem.estimate.inputs:
            numbers |= load_numbers(name, true[1:], mean[1:], sigma[1:])
        else:
            size = abs(float(true[-1])) or 1.0
            numbers[f"error.{name}"] = abs(float(mean[-1] - true[-1])) / size
            numbers[f"std.{name}"] = float(sigma[-1]) / size
    for name, part in problem.sensors.channels.items():
        numbers |= mismatch_numbers(name, _measured(result, name, seed), result.reading[1:, seed, part])
    return numbers


def numbers_of_seeds(result: BenchEstimation) -> dict[str, np.ndarray]:
    """Summary number → values of every seed (seeds,) at its first start, NaN if diverged; empty for a single seed."""
    nis, each = result.filtered.nis[len(result.filtered.nis) // 2 :], []
    for run in range(0, result.measured.shape[1], result.starts):
        lost = result.filtered.lost[run] >= 0
        each.append({} if lost else {"nis": float(np.nanmean(nis[:, run]))} | run_numbers(result, run))
    names = dict.fromkeys(name for numbers in each for name in numbers) if len(each) > 1 else {}
    return {name: np.array([float(numbers.get(name, np.nan)) for numbers in each]) for name in names}


def _late(values: np.ndarray) -> np.ndarray:
    """Second half of a history (T + 1, ...)."""
    return values[len(values) // 2 :]


def _load_numbers(result: BenchEstimation, name: str) -> Numbers:
    """Numbers of an unknown load: over all runs, smoothed, relative to the other bench, or without a reference."""
    (estimate, std), true = result.values[name], result.truths.get(name)
    numbers, elsewhere = Numbers(), result.reality.elsewhere.get(name)
    if true is not None:
        if estimate.shape[1] > 1 and np.isfinite(_late(std)).any():
            numbers[f"ratio.{name}"] = float(np.sqrt(np.nanmean(_late(result.errors[name] / std) ** 2)))
        if name in result.smoothed:
            later = load_numbers(name, true[1:, 0], *(values[1:] for values in result.smoothed[name]))
            numbers |= {f"smoothed_{key}": later[key] for key in (f"error.{name}", f"std.{name}") if key in later}
    elif elsewhere is None:
        numbers |= history_numbers(name, estimate[1:, 0], std[1:, 0])
    if elsewhere is not None:
        numbers |= ratio_numbers(name, elsewhere[1:], estimate[1:, 0])
    return numbers


def _claims(result: BenchEstimation, numbers: Numbers) -> dict[str, Claim]:
    """Calibration of σ of every unknown with known truth, except zero loads."""
    claims: dict[str, Claim | None] = {}
    for name, off in result.errors.items():
        std = result.values[name][1]
        if name in result.problem.unknowns.free:
            claims[name] = claim_of(
                off[-1], std[-1], samples_per_draw=result.starts
            )  # starts of a seed count as one sample
            continue
        if f"error.{name}" in numbers:
            claims[name] = claim_in_time(_late(off), _late(std), starts=result.starts)
        if f"smoothed_error.{name}" in numbers:
            mean, std = result.smoothed[name]
            off = mean - result.truths[name][:, 0]
            claims[smoothed_name(name)] = claim_in_time(_late(off), _late(std), of="smoothed")
    return {name: claim for name, claim in claims.items() if claim is not None}


def _parameter_numbers(result: BenchEstimation, name: str, claim: Claim | None) -> Numbers:
    """Numbers of a parameter: whether it is identified, and statistics over all runs."""
    (estimate, std), starts, numbers = result.values[name], result.starts, Numbers()
    last, sigma, unknowns = estimate[-1], std[-1], result.problem.unknowns
    spread = starts > 1 and bool(not_identified(last[:starts], sigma[:starts]))
    learned = bool(np.all(sigma[:starts] < LEARNED * unknowns.std[unknowns.free.index(name)]))
    wrong = starts > 1 and claim is not None and claim.overconfident
    withheld = np.isfinite(last).any() and not np.isfinite(sigma).any()
    if not withheld:
        numbers[f"identified.{name}"] = learned and not spread and not wrong
    if name not in result.truths:
        return numbers | {f"estimate.{name}": float(last[0]), f"rms_std.{name}": float(sigma[0])}
    off, true = result.errors[name][-1], float(result.truths[name][-1, 0])
    if len(last) > 1:
        numbers[f"ratio.{name}"] = float(np.sqrt(np.mean((off / sigma) ** 2)))
        numbers[f"largest_error.{name}"] = float(np.abs(off).max()) / (abs(true) or 1.0)
    return numbers | {f"{SETTLING_TIME}.{name}": settling_time(result.problem.time, estimate[:, 0], true, SETTLED)}


def _load_history(result: BenchEstimation, name: str) -> LoadHistory:
    (estimate, std), true = result.values[name], result.truths.get(name)
    smoothed, smoothed_std = result.smoothed.get(name, (None, None))
    return LoadHistory(
        estimate=estimate[:, 0],
        std=std[:, 0],
        smoothed=smoothed,
        smoothed_std=None if smoothed_std is None or np.isnan(smoothed_std).all() else smoothed_std,
        true=None if true is None else true[:, 0],
        unscaled=result.reality.elsewhere.get(name),
    )


def _parameter_history(result: BenchEstimation, name: str) -> ParameterHistory:
    (estimate, std), true = result.values[name], result.truths.get(name)
    return ParameterHistory(estimate=estimate[:, 0], std=std[:, 0], true=None if true is None else float(true[0, 0]))


def _ends(result: BenchEstimation, name: str) -> ParameterRuns:
    """Start and end of all runs of a parameter."""
    (estimate, std), off = result.values[name], result.errors.get(name)
    error = None if off is None else off[-1]
    return ParameterRuns(start=estimate[0], estimate=estimate[-1], std=std[-1], error=error)


def _measured(result: BenchEstimation, name: str, seed: int) -> np.ndarray:
    """Readings (T, components) of a sensor in the first run of a seed, without noise if the filter does not use it."""
    if (used := result.problem.used.channels.get(name)) is not None:
        return result.measured[:, seed * result.starts, used]
    readings = result.reality.readings[:, :, result.problem.sensors.channels[name]]
    return readings[:, min(seed, readings.shape[1] - 1)]


def _sensor(result: BenchEstimation, name: str) -> SensorMatch:
    part, channels = result.problem.sensors.channels[name], result.problem.used.channels.get(name)
    measured, offset = _measured(result, name, 0), result.trial.offsets.at
    match = SensorMatch(
        used=channels is not None,
        expected=result.reading[1:, 0, part],
        measured=measured if np.isfinite(measured).any() else None,
    )
    if channels is None:
        return match
    which = np.flatnonzero((offset >= channels.start) & (offset < channels.stop))
    if len(which):
        bias = np.zeros((2, part.stop - part.start))
        behind = result.trial.model.size + which
        bias[:, offset[which] - channels.start] = [
            values[-1, 0, behind] for values in (result.filtered.mean, result.filtered.std)
        ]
        match = replace(match, bias=bias[0], bias_std=bias[1])
    if (without := result.without) is None:
        return match
    return replace(
        match,
        predicted=without.predicted[:, 0, channels],
        predicted_std=without.std[:, 0, channels],
        left_in=without.left_in[channels],
    )


def _violation(result: BenchEstimation, k: int) -> float:
    x = result.filtered.mean[k, :1]
    return float(result.trial.model.violation(x, k)[0]) if np.isfinite(x).all() else float("nan")

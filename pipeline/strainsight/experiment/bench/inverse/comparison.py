"""An estimate of a bench beside what is true: histories as they are written, and how good they are in numbers."""

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


def mismatch_numbers(name: str, measured: np.ndarray, expected: np.ndarray) -> Numbers:
    """rms of measured − expected over that of measured, of every component (T, components) and of the worst; a component that
    hardly moves counts beside the largest of its unit (of a pair of metres and radians: x, y, z, then tilts)."""
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
    """rms of what each component of a sensor reads here over that of what it reads on the other bench (T, components)."""
    known = np.isfinite(elsewhere) & np.isfinite(expected)
    return _by_component(f"size.{name}", _shares(_rms(expected, known), _rms(elsewhere, known)))


def _rms(x: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Of every component of x (T, components), where it is known."""
    return np.asarray(np.sqrt(np.sum(np.where(known, x, 0.0) ** 2, axis=0) / np.maximum(known.sum(axis=0), 1)))


def _shares(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.full_like(part, np.nan), where=whole > 0)


def _by_component(key: str, values: np.ndarray) -> Numbers:
    return {f"{key}.{i}": float(value) for i, value in enumerate(values, start=1) if np.isfinite(value)}


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


def compare(result: BenchEstimation) -> BenchComparison:
    """Histories of the first run, ends of all runs; where σ is withheld, NaN, no number of it, and no claim."""
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
    """Errors of loads and parameters whose truth is known, and mismatches of sensors, in one run, a seed's first."""
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
    """Name → the number of every seed (seeds,) by its first start, NaN of a seed that diverged: of loads, parameters, innovations
    and sensors, as in the summary. None of a single seed."""
    nis, each = result.filtered.nis[len(result.filtered.nis) // 2 :], []
    for run in range(0, result.measured.shape[1], result.starts):
        lost = result.filtered.lost[run] >= 0
        each.append({} if lost else {"nis": float(np.nanmean(nis[:, run]))} | run_numbers(result, run))
    names = dict.fromkeys(name for numbers in each for name in numbers) if len(each) > 1 else {}
    return {name: np.array([float(numbers.get(name, np.nan)) for numbers in each]) for name in names}


def _late(values: np.ndarray) -> np.ndarray:
    """The second half of a history (T + 1, ...)."""
    return values[len(values) // 2 :]


def _load_numbers(result: BenchEstimation, name: str) -> Numbers:
    """Of an unknown load: over all runs, smoothed, beside the other bench, or by itself where nobody knows it."""
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
    """Whether the estimate of every unknown whose truth is known keeps to its σ, of a load that is none no claim."""
    claims: dict[str, Claim | None] = {}
    for name, off in result.errors.items():
        std = result.values[name][1]
        if name in result.problem.unknowns.free:
            claims[name] = claim_of(
                off[-1], std[-1], samples_per_draw=result.starts
            )  # starts within a seed are one draw
            continue
        if f"error.{name}" in numbers:
            claims[name] = claim_in_time(_late(off), _late(std), starts=result.starts)
        if f"smoothed_error.{name}" in numbers:
            mean, std = result.smoothed[name]
            off = mean - result.truths[name][:, 0]
            claims[smoothed_name(name)] = claim_in_time(_late(off), _late(std), of="smoothed")
    return {name: claim for name, claim in claims.items() if claim is not None}


def _parameter_numbers(result: BenchEstimation, name: str, claim: Claim | None) -> Numbers:
    """Of a parameter: whether it is identified, and over all runs."""
    (estimate, std), starts, numbers = result.values[name], result.starts, Numbers()
    last, sigma, unknowns = estimate[-1], std[-1], result.problem.unknowns
    apart = starts > 1 and bool(not_identified(last[:starts], sigma[:starts]))
    learned = bool(np.all(sigma[:starts] < LEARNED * unknowns.std[unknowns.free.index(name)]))
    wrong = starts > 1 and claim is not None and claim.overconfident
    withheld = np.isfinite(last).any() and not np.isfinite(sigma).any()
    if not withheld:
        numbers[f"identified.{name}"] = learned and not apart and not wrong
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
        there=result.reality.elsewhere.get(name),
    )


def _parameter_history(result: BenchEstimation, name: str) -> ParameterHistory:
    (estimate, std), true = result.values[name], result.truths.get(name)
    return ParameterHistory(estimate=estimate[:, 0], std=std[:, 0], true=None if true is None else float(true[0, 0]))


def _ends(result: BenchEstimation, name: str) -> ParameterRuns:
    """Where all runs of a parameter start and end."""
    (estimate, std), off = result.values[name], result.errors.get(name)
    error = None if off is None else off[-1]
    return ParameterRuns(start=estimate[0], estimate=estimate[-1], std=std[-1], error=error)


def _measured(result: BenchEstimation, name: str, seed: int) -> np.ndarray:
    """What a sensor of the filter read in the first start of a seed, or another one without noise (T, components)."""
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

"""Evidence of a record with and without a fault, whether its innovations are plausible, and its parts with large readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.conditional import ConsideredParameters
from strainsight.estimation.decision import check_ratio
from strainsight.estimation.faults import (
    BELIEVABLE,
    FORESEEN,
    Explained,
    Fault,
    dead_density,
    outlier_density,
    undo_fault,
)
from strainsight.estimation.grid_filter import GridRun, filter_on_grid
from strainsight.estimation.load_faults import undo_load_fault
from strainsight.estimation.model import FilterModel
from strainsight.estimation.model_errors import add_constant, apply_model_error
from strainsight.estimation.peak import find_peak
from strainsight.estimation.record import GridRecord

IMPOSSIBLE = -1e200
"""ln evidence below which a record is outside the floating-point range."""
STRETCHED = 4.5
"""Plausible limit of a tolerance in σ: one of fifty normal numbers exceeds it in 3 of 10 000 records."""
LEARNED = 0.1
"""Least share of the variance of a frequency that counts as determined by the measurements."""
BROAD = np.sqrt(3.0)
"""Prior σ of an offset, or of a drift at the end of the record, over the RMS of the channel."""


@dataclass(frozen=True, kw_only=True)
class CheckRecord(GridRecord):
    """A record to be checked for faults of its channels and known loads. turned_rows (m, angles, n*): rows of each channel
    rotated by each of ANGLES, NaN if impossible; turned: channel and degrees → model and considered parameters with it
    rotated; load (n_known,): load of each column of `known`; moving (n*, n*): covariance for unknown motion, None: the same;
    begin: samples of the record before these; span: first moving sample, and the one after the last."""

    turned_rows: np.ndarray
    turned: Callable[[int, float], tuple[FilterModel, ConsideredParameters]]
    load: np.ndarray
    moving: np.ndarray | None = None
    begin: int = 0
    span: tuple[int, int] | None = None

    @property
    def noise(self) -> np.ndarray:
        """σ (m,) of a sample."""
        return np.sqrt(self.model.noise[0, 0] if self.model.noise.ndim == 3 else np.ravel(self.model.noise))


@dataclass(frozen=True)
class ShiftedMode:
    """A mode whose natural frequency fits best at `factor` times that of the model, `size` σ of its tolerance away."""

    mode: int
    factor: float
    size: float


def explain_record(
    record: CheckRecord, fault: Fault | None, least: float = -np.inf
) -> tuple[Explained, GridRun | None]:
    """Evidence of a record (T, m) under a fault, and the run of the grid filter, None if it fails:

        ln p(y | fault) = ln p(T y) + ln |det T|,    y in units of the noise of a sample

    p(T y): everything integrated out; innovations are those at the most likely parameters. Offset and drift are an additional
    considered parameter of σ BROAD times the RMS of the channel. A dead channel has the density of a constant and white
    noise. least: evidence up to which a fault does not matter; its innovations are not computed, and their ratio is
    infinite."""
    corrected, change, unit = record, 0.0, 0.0
    if fault is not None and fault.of_model:
        corrected = apply_model_error(record, fault, record.begin / (record.begin + len(record.samples)))
    elif fault is not None and fault.of_load:
        corrected = undo_load_fault(record, record.load, fault)
    elif fault is not None:
        samples, change = undo_fault(fault, record.samples)
        corrected = replace(record, samples=samples)
    if fault is not None and fault.kind == "angle":
        model, considered = record.turned(fault.channel, fault.amount)
        corrected = replace(corrected, model=model, considered=considered)
    # likelihood and innovations are the same whether states follow what is learned of ν, which is the quicker
    considered = replace(corrected.considered, learned=True)
    if fault is not None and fault.kind in ("offset", "drift"):
        unit = BROAD * float(np.sqrt(np.nanmean(corrected.samples[:, fault.channel] ** 2)))
        considered = _with_zero(considered, fault, unit, record)
    measured = np.isfinite(corrected.samples)
    missing = np.isfinite(record.samples).sum(axis=0) - measured.sum(axis=0)
    if fault is not None:
        change += outlier_density(fault, record.samples, record.noise)
    if fault is not None and fault.kind == "dead":
        change += dead_density(record.samples[:, fault.channel], record.noise[fault.channel])
        missing[fault.channel] = 0
    change += float(measured.sum(axis=0) @ np.log(record.noise)) + FORESEEN * float(missing.sum())
    amount, std = 0.0 if fault is None else fault.amount, 0.0
    none = Explained(fault, -np.inf, np.inf), None
    try:
        # parameters explain frequencies that are off, and are no result here
        tuned = bool(corrected.model.unknowns.parameters)
        exact = replace(considered, frequency=0 * considered.frequency) if tuned else considered
        point, density = np.zeros(0), None
        if tuned or least > -np.inf:
            peak = find_peak(replace(corrected, considered=exact))
            point, density = peak.point, peak.evidence
            if density < IMPOSSIBLE:
                return none
            if density + change <= least:
                return Explained(fault, density + change, np.inf, amount, point=tuple(point)), None
            if peak.about is not None:
                considered = replace(considered, about=peak.about)
        grid_run = filter_on_grid(replace(corrected, considered=considered).known_at(point), "readings")
    except NumericalError:
        return none
    evidence = change + (float(grid_run.run.log_likelihood[0]) if density is None else density)
    if not evidence >= IMPOSSIBLE:
        return none
    if unit:
        nu, left = grid_run.nu_moments
        amount, std = unit * float(nu[-1]), unit * float(np.sqrt(left[-1, -1]))
    return Explained(fault, evidence, innovation_ratio(grid_run, _steps(record)), amount, std, tuple(point)), grid_run


def _steps(record: CheckRecord) -> slice:
    """Steps in which the structure moves."""
    every = record.model.every
    return slice(None) if record.span is None else slice(record.span[0] * every, record.span[1] * every)


def _with_zero(
    considered: ConsideredParameters, fault: Fault, unit: float, record: CheckRecord
) -> ConsideredParameters:
    """Add one constant: the offset of a channel, or its drift from the start of the record to the end of these samples."""
    row, drifts = np.zeros(considered.offset.shape[1]), fault.kind == "drift"
    before = record.begin / (record.begin + len(record.samples)) if drifts else 1.0
    row[fault.channel] = unit
    drift = (1 - before) * row if drifts else None
    return add_constant(considered, fault.kind, record.known, offset=before * row, drift=drift)


def innovation_ratio(grid_run: GridRun, part: slice = slice(None)) -> float:
    """RMS of innovations over their claim, of all steps or of a part, whichever is larger; NaN without samples."""
    squares = grid_run.run.whitened**2
    parts = [each[np.isfinite(each)] for each in (squares, squares[part])]
    ratios = [np.sqrt(np.mean(each)) for each in parts if each.size]
    return float(max(ratios)) if ratios else np.nan


def relative_innovation(grid_run: GridRun | None) -> float:
    """Largest RMS innovation of a channel over its RMS reading, infinite if the filter failed."""
    if grid_run is None:
        return np.inf
    read = grid_run.run.innovation[:, 0]
    foreseen = grid_run.run.gauge_mean[:, 0]
    finite = np.isfinite(read)
    of = np.where(finite, read, 0.0), np.where(finite, foreseen, 0.0)
    missed, whole = (np.sqrt(np.sum(each**2, axis=0)) for each in (of[0], np.hypot(*of)))
    return float(np.max(missed / np.maximum(whole, np.finfo(float).tiny), initial=0.0))


def too_large(fit: Explained, grid_run: GridRun | None) -> bool:
    """Whether the innovations exceed the band of `decision.check_ratio`."""
    if grid_run is None or not fit.ratio <= BELIEVABLE:
        return True
    return check_ratio(fit.ratio, int(np.isfinite(grid_run.run.whitened).sum())).overconfident


def needs_fault_search(as_it_is: Explained, grid_run: GridRun | None) -> bool:
    """Whether to search for faults: innovations are too large, or a tolerance exceeds STRETCHED prior σ."""
    return grid_run is None or too_large(as_it_is, grid_run) or bool(np.any(np.abs(grid_run.nu_moments[0]) > STRETCHED))


def shifted_mode(
    model: FilterModel, considered: ConsideredParameters, grid_run: GridRun | None, limit: float = STRETCHED
) -> ShiftedMode | None:
    """The mode with the largest frequency shift over what its tolerance predicts; None within `limit`:

        zⱼ = Fⱼᵀν̂ / √(Fⱼᵀ(I − P)Fⱼ)  ~  N(0, 1)

    ν̂, P: estimate of the considered frequencies and its covariance; Fⱼ: their effect on ln ωⱼ."""
    rows = considered.frequency
    if grid_run is None or not len(rows):
        return None
    (mean, covariance), behind = grid_run.nu_moments, considered.of_modes(model.model.size)
    at = slice(behind - len(rows), behind)
    change = mean[at] @ rows
    predicted = np.einsum("kj,kl,lj->j", rows, np.eye(len(rows)) - covariance[at, at], rows)
    size = np.abs(change) / np.sqrt(np.maximum(predicted, LEARNED * np.sum(rows**2, axis=0)))
    j = int(np.argmax(size))
    return ShiftedMode(j, float(np.exp(change[j])), float(size[j])) if size[j] > limit else None


LONGEST = 4000
"""Most samples of a stretch."""
MOST = 3
"""Most stretches of a record that are checked."""
FAINT_READING = 3.0
"""Multiple of the sample noise below which a reading counts as rest."""
TAIL, FEWEST = 0.01, 20
"""Share of the signal energy outside the moving part at either end, and its fewest samples."""
LEAD = 0.25
"""Share of a stretch before the instant for which it was selected, and of rest around the moving part."""


def select_stretches(record: CheckRecord) -> tuple[tuple[int, int], ...]:
    """Up to MOST stretches (first sample, end): that with the largest readings, then those of channels with less than half of
    their energy in the stretches before. The whole record if it is shorter than one."""
    energy = _energy(record)
    count = len(energy)
    if count <= LONGEST:
        return ((0, count),)
    stretches = [_loudest(_second_largest(energy))]
    of_channels = [(_loudest(of_channel), of_channel) for of_channel in energy.T]
    for stretch, of_channel in sorted(of_channels, key=lambda one: one[0]):
        covered = max(float(of_channel[slice(*each)].sum()) for each in stretches)
        if len(stretches) < MOST and covered < 0.5 * float(of_channel[slice(*stretch)].sum()):
            stretches.append(stretch)
    return tuple(stretches)


def stretch_about(record: CheckRecord, sample: int) -> tuple[int, int]:
    """The stretch about a sample, a quarter of it before the sample."""
    first = max(0, min(sample - int(LEAD * LONGEST), len(record.samples) - LONGEST))
    return first, min(first + LONGEST, len(record.samples))


def is_at_rest(part: CheckRecord) -> bool:
    """Whether at most a few samples of a stretch exceed the noise in two channels at once."""
    return bool(np.count_nonzero(_second_largest(_energy(part))) < FEWEST)


def largest_channel(part: CheckRecord) -> int:
    """The channel with the largest readings over its noise."""
    return int(np.argmax(_energy(part).sum(axis=0)))


def scale_intensity(part: CheckRecord, factor: float) -> CheckRecord:
    """The stretch with Q of the unknown loads and the covariance of the motion multiplied by a factor."""
    n = part.model.parameter_states.start

    def scaled(model: FilterModel) -> FilterModel:
        Q = model.Q.copy()
        Q[..., :n, :n] *= factor
        return replace(model, Q=Q)

    def turned(channel: int, angle: float) -> tuple[FilterModel, ConsideredParameters]:
        model, considered = part.turned(channel, angle)
        return scaled(model), considered

    covariance = _wider_motion(part.covariance, n, np.sqrt(factor))
    return replace(part, model=scaled(part.model), covariance=covariance, turned=turned)


def installation_share(record: CheckRecord, grid_run: GridRun) -> np.ndarray:
    """σ (m,) of the reading of each channel by the tolerances of its gauge, over its RMS reading."""
    D = record.considered.D[len(record.considered.shape) :]
    states = grid_run.run.mean[1:, 0][record.sampled, : D.shape[2]]
    variance = np.einsum("kmi,ij,kmj->m", D, states.T @ states / len(states), D)
    power = np.mean(grid_run.run.gauge_mean[record.sampled, 0] ** 2, axis=0)
    return np.sqrt(variance / np.maximum(power, np.finfo(float).tiny))


def widen_tolerances(part: CheckRecord, factor: float) -> CheckRecord:
    """The stretch with all tolerances multiplied by a factor."""
    considered = part.considered
    wider = {
        name: factor * value
        for name in ("D", "E", "offset", "B", "shape", "load_std", "damping", "frequency", "stiffness", "inertia")
        if (value := getattr(considered, name)) is not None
    }
    return replace(part, considered=replace(considered, **wider))


def _wider_motion(covariance: np.ndarray, n: int, factor: float) -> np.ndarray:
    """The covariance with σ of the first n states multiplied by a factor."""
    P = covariance.copy()
    P[:n] *= factor
    P[:, :n] *= factor
    return P


def extract_moving_part(part: CheckRecord) -> CheckRecord:
    """The moving part of a stretch with a quarter before and after it; the whole stretch if more than half of it moves."""
    if part.span is None:
        return part
    first, behind = part.span
    more = int(LEAD * (behind - first))
    begin = max(0, first - more)
    return replace(
        extract_part(part, begin, min(len(part.samples), behind + more)), span=(first - begin, behind - begin)
    )


def extract_part(record: CheckRecord, begin: int, end: int) -> CheckRecord:
    """Samples from begin to end (exclusive), with their moving part. A stretch that does not start the record starts with an
    unknown motion, as wide as its readings require; a periodic motion and a drift, t/T of the record, continue."""
    every, whole = record.model.every, len(record.samples)
    samples = record.samples[begin:end]
    part = replace(
        record,
        samples=samples,
        known=record.known[begin * every : end * every],
        begin=record.begin + begin,
        span=_moving_part(_second_largest(_energy(record)[begin:end])),
    )
    if (begin, end) == (0, whole):
        return part
    loads = record.known.shape[-1]

    def within(considered: ConsideredParameters) -> ConsideredParameters:
        if considered.E.shape[-1] == loads:
            return considered
        E, drift = considered.E.copy(), considered.E[..., -1]
        E[..., -1] = drift * (end - begin) / whole
        return replace(considered, E=E, offset=considered.offset + drift * begin / whole)

    def turned(channel: int, angle: float) -> tuple[FilterModel, ConsideredParameters]:
        model, considered = record.turned(channel, angle)
        return model, within(considered)

    settled = record.settled
    if settled is not None:
        phase = np.exp(1j * settled.frequency * begin * every * record.model.h)
        settled = replace(settled, hold=settled.hold * phase[:, None, None])
    return replace(
        part,
        covariance=record.covariance if begin == 0 else _unknown_motion(record, samples),
        considered=within(record.considered),
        settled=settled,
        turned=turned,
    )


def _energy(record: CheckRecord) -> np.ndarray:
    """Squares (T, m) of the readings over their noise, minus rest; single samples are ignored."""
    y = record.samples
    if len(record.biased):
        y = y.copy()
        known = np.isfinite(y[:, record.biased]).any(axis=0)
        at = record.biased[known]
        y[:, at] -= np.nanmedian(y[:, at], axis=0)
    size = np.abs(np.nan_to_num(y)) / record.noise
    if len(size) > 2:
        size[1:-1] = np.sort([size[:-2], size[1:-1], size[2:]], axis=0)[1]
    return np.asarray(np.maximum(size**2 - FAINT_READING**2, 0.0))


def _second_largest(energy: np.ndarray) -> np.ndarray:
    """Second largest energy of the channels (T,), so that a single wrong channel has no effect."""
    return np.asarray(np.sort(energy, axis=1)[:, -min(2, energy.shape[1])])


def _loudest(energy: np.ndarray) -> tuple[int, int]:
    """The stretch of LONGEST samples with the largest energy (T,)."""
    whole = np.concatenate([[0.0], np.cumsum(energy)])
    first = int(np.argmax(whole[LONGEST:] - whole[:-LONGEST]))
    return first, first + LONGEST


def _moving_part(energy: np.ndarray) -> tuple[int, int] | None:
    """Shortest part with all energy (T,) but TAIL at either end; None if it is more than half of all samples."""
    whole = np.cumsum(energy)
    if not len(energy) or not whole[-1] > 0:
        return None
    first, last = np.searchsorted(whole, np.array([TAIL, 1 - TAIL]) * whole[-1])
    return (int(first), int(last) + 1) if FEWEST <= last + 1 - first <= 0.5 * len(energy) else None


def _unknown_motion(record: CheckRecord, samples: np.ndarray) -> np.ndarray:
    """Covariance of an unknown motion, widened where the channels (T, m) read more than it predicts."""
    covariance = record.covariance if record.moving is None else record.moving
    model, n = record.model, record.model.parameter_states.start
    rows = model.H[..., :n]
    foreseen = np.sqrt(np.einsum("mi,ij,mj->m", rows, covariance[:n, :n], rows))
    largest = np.nanmax(np.abs(np.nan_to_num(samples)), axis=0)
    use = foreseen > 0
    if model.accelerometers is not None:
        use &= ~model.accelerometers
    wider = max(1.0, float(np.median(largest[use] / foreseen[use]))) if use.any() else 1.0
    return _wider_motion(covariance, n, wider)

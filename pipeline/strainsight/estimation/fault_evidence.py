"""Evidence of a record with and without a fault, whether its innovations are plausible, and its parts with large readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.conditional import ConsideredParameters
from strainsight.estimation.decision import check_ratio
from strainsight.estimation.faults import BELIEVABLE, FORESEEN, Explained, Fault, dead_density, of_any_size, undone
from strainsight.estimation.grid_filter import GridRun, filter_on_grid
from strainsight.estimation.load_faults import without_load_fault
from strainsight.estimation.model import FilterModel
from strainsight.estimation.peak import peak_of
from strainsight.estimation.record import GridRecord

IMPOSSIBLE = -1e200
"""ln evidence below which a record is beyond what numbers can hold."""
STRETCHED = 4.5
"""Of its σ, up to which any tolerance is believed: one of fifty normal numbers is beyond in 3 of 10 000 records."""
BROAD = np.sqrt(3.0)
"""σ of an offset, or of a drift by the end of the record, before the samples, over the RMS of the channel."""


@dataclass(frozen=True, kw_only=True)
class CheckRecord(GridRecord):
    """A record whose channels and known loads may be wrong, and the grid filter that it is check_ratio by.

    turned_rows (m, angles, n*): what a channel would read turned by each of ANGLES, NaN where it cannot be; turned: channel and
    degrees → model and nuisances with it turned. load (n_known,): number of the load that each column of `known` belongs to.
    moving (n*, n*): the covariance where nothing is known of the motion, None: the same. begin: samples of the record before
    these; span: the first sample that moves, and the one behind the last.
    """

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
    """A mode whose natural frequency fits a record best `factor` times that of the model, `size` σ of its tolerance away."""

    mode: int
    factor: float
    size: float


def explained(suspect: CheckRecord, fault: Fault | None) -> tuple[Explained, GridRun | None]:
    """Evidence of a record (T, m) under a fault, and what the grid filter found, None where it fails:

        ln p(y | fault) = ln p(T y) + ln |det T|,    y in units of the noise of a sample

    p(T y): all integrated out; innovations are those at the most likely parameters. Offset and drift are one more of its
    constants ν, of σ BROAD times the RMS of the channel. A dead channel has the density of a constant and white noise.
    """
    record, change, unit = suspect, 0.0, 0.0
    if fault is not None and fault.of_load:
        record = without_load_fault(suspect, suspect.load, fault)
    elif fault is not None:
        samples, change = undone(fault, suspect.samples)
        record = replace(suspect, samples=samples)
    if fault is not None and fault.kind == "angle":
        model, considered = suspect.turned(fault.channel, fault.amount)
        record = replace(record, model=model, considered=considered)
    # likelihood and innovations are the same whether states follow what is learned of ν, which is the quicker
    considered = replace(record.considered, learned=True)
    if fault is not None and fault.kind in ("offset", "drift"):
        unit = BROAD * float(np.sqrt(np.nanmean(record.samples[:, fault.channel] ** 2)))
        considered = _with_zero(considered, fault, unit, suspect)
    measured = np.isfinite(record.samples)
    missing = np.isfinite(suspect.samples).sum(axis=0) - measured.sum(axis=0)
    if fault is not None:
        change += of_any_size(fault, suspect.samples, suspect.noise)
    if fault is not None and fault.kind == "dead":
        change += dead_density(suspect.samples[:, fault.channel], suspect.noise[fault.channel])
        missing[fault.channel] = 0
    try:
        # parameters explain frequencies that are off, and are no result here
        tuned = bool(record.model.unknowns.parameters)
        exact = replace(considered, frequency=0 * considered.frequency) if tuned else considered
        peak = peak_of(replace(record, considered=exact))
        if peak.evidence < IMPOSSIBLE:
            return Explained(fault, -np.inf, np.inf), None
        if peak.about is not None:
            considered = replace(considered, about=peak.about)
        grid_run = filter_on_grid(replace(record, considered=considered).known_at(peak.point))
    except NumericalError:
        return Explained(fault, -np.inf, np.inf), None
    evidence = peak.evidence + change + float(measured.sum(axis=0) @ np.log(suspect.noise))
    evidence += FORESEEN * float(missing.sum())
    amount, std = 0.0 if fault is None else fault.amount, 0.0
    if unit:
        nu, left = grid_run.nu_moments
        amount, std = unit * float(nu[-1]), unit * float(np.sqrt(left[-1, -1]))
    return Explained(fault, evidence, ratio_of(grid_run, _steps(suspect)), amount, std, tuple(peak.point)), grid_run


def _steps(suspect: CheckRecord) -> slice:
    """The steps in which the structure moves."""
    every = suspect.model.every
    return slice(None) if suspect.span is None else slice(suspect.span[0] * every, suspect.span[1] * every)


def _with_zero(
    considered: ConsideredParameters, fault: Fault, unit: float, suspect: CheckRecord
) -> ConsideredParameters:
    """One constant more: the offset of a channel, or its drift since the beginning of the record by the end of these samples."""
    (_, m, n), width = considered.D.shape, considered.E.shape[-1]
    row, drifts = np.zeros((1, m)), fault.kind == "drift"
    E = np.pad(considered.E, [(0, 1), (0, 0), (0, int(drifts and width == suspect.known.shape[-1]))])
    before = suspect.begin / (suspect.begin + len(suspect.samples)) if drifts else 1.0
    row[0, fault.channel] = unit * before
    if drifts:
        E[-1, fault.channel, -1] = unit * (1 - before)
    return replace(
        considered,
        source=(*considered.source, fault.kind),
        D=np.concatenate([considered.D, np.zeros((1, m, n))]),
        E=E,
        offset=np.concatenate([considered.offset, row]),
        B=None if considered.B is None else np.pad(considered.B, [(0, 1), (0, 0), (0, 0)]),
    )


def ratio_of(grid_run: GridRun, part: slice = slice(None)) -> float:
    """Innovations over their claim, RMS, of all steps or of a part of them, the larger; NaN where nothing was measured."""
    squares = grid_run.run.whitened**2
    parts = [each[np.isfinite(each)] for each in (squares, squares[part])]
    ratios = [np.sqrt(np.mean(each)) for each in parts if each.size]
    return float(max(ratios)) if ratios else np.nan


def missed_of(grid_run: GridRun | None) -> float:
    """The largest RMS innovation of a channel over its RMS reading, infinite where the grid filter failed."""
    if grid_run is None:
        return np.inf
    read = grid_run.run.innovation[:, 0]
    foreseen = grid_run.run.gauge_mean[:, 0]
    finite = np.isfinite(read)
    of = np.where(finite, read, 0.0), np.where(finite, foreseen, 0.0)
    missed, whole = (np.sqrt(np.sum(each**2, axis=0)) for each in (of[0], np.hypot(*of)))
    return float(np.max(missed / np.maximum(whole, np.finfo(float).tiny), initial=0.0))


def too_large(fit: Explained, grid_run: GridRun | None) -> bool:
    """Whether the innovations of a record are larger than claimed, beyond the band of `decision.check_ratio`."""
    if grid_run is None or not fit.ratio <= BELIEVABLE:
        return True
    return check_ratio(fit.ratio, int(np.isfinite(grid_run.run.whitened).sum())).overconfident


def suspected(as_it_is: Explained, grid_run: GridRun | None) -> bool:
    """Whether the faults of a record are to be looked for: its innovations are too large, or a tolerance is stretched beyond
    STRETCHED of its σ before the samples to explain it."""
    return grid_run is None or too_large(as_it_is, grid_run) or bool(np.any(np.abs(grid_run.nu_moments[0]) > STRETCHED))


def shifted_mode(suspect: CheckRecord, grid_run: GridRun | None) -> ShiftedMode | None:
    """The mode whose frequency is farthest from the model over its tolerance; None where that is within STRETCHED."""
    rows, modes = suspect.considered.frequency, suspect.model.model.size
    if grid_run is None or not len(rows):
        return None
    behind = suspect.considered.of_modes(modes)
    change = grid_run.nu_moments[0][behind - len(rows) : behind] @ rows
    size = np.abs(change) / np.sqrt(np.sum(rows**2, axis=0))
    j = int(np.argmax(size))
    return ShiftedMode(j, float(np.exp(change[j])), float(size[j])) if size[j] > STRETCHED else None


LONGEST = 4000
"""Samples of a stretch at most."""
MOST = 3
"""Stretches of a record at most that are checked."""
FAINT_READING = 3.0
"""Of the noise of a sample, up to which a reading counts as rest."""
TAIL, FEWEST = 0.01, 20
"""Share of the energy of the readings that may lie before the moving part, and behind it; fewest samples of such a part."""
LEAD = 0.25
"""Share of a stretch that lies before the instant for which it was chosen; of rest beside the part that moves."""


def loudest_stretches(suspect: CheckRecord) -> tuple[tuple[int, int], ...]:
    """First sample of a stretch and the one behind its last, MOST of them at most: where the channels read most, then where
    those read most that read less than half of that in the stretches before. The whole record where it is no longer than one."""
    energy = _energy(suspect)
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


def stretch_at(suspect: CheckRecord, sample: int) -> tuple[int, int]:
    """The stretch about a sample, a quarter of it before that."""
    first = max(0, min(sample - int(LEAD * LONGEST), len(suspect.samples) - LONGEST))
    return first, min(first + LONGEST, len(suspect.samples))


def at_rest(part: CheckRecord) -> bool:
    """Whether no two channels of a stretch read more than noise together, but for a few samples."""
    return bool(np.count_nonzero(_second_largest(_energy(part))) < FEWEST)


def loudest_channel(part: CheckRecord) -> int:
    """The channel that reads most over its noise."""
    return int(np.argmax(_energy(part).sum(axis=0)))


def with_intensity(part: CheckRecord, factor: float) -> CheckRecord:
    """A stretch whose unknown loads are less intense by a factor: Q and the covariance of the motion are multiplied by it."""
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


def _wider_motion(covariance: np.ndarray, n: int, factor: float) -> np.ndarray:
    """With σ of the first n states times a factor."""
    P = covariance.copy()
    P[:n] *= factor
    P[:, :n] *= factor
    return P


def moving_part_of(part: CheckRecord) -> CheckRecord:
    """Where a stretch moves, with a quarter of that before and behind it; all of it where more than half does."""
    if part.span is None:
        return part
    first, behind = part.span
    more = int(LEAD * (behind - first))
    begin = max(0, first - more)
    return replace(part_of(part, begin, min(len(part.samples), behind + more)), span=(first - begin, behind - begin))


def part_of(suspect: CheckRecord, begin: int, end: int) -> CheckRecord:
    """Samples from begin to before end, with the part of them that moves.

    A stretch that is not the beginning of its record begins in an unknown motion, as wide as its readings ask for; a periodic
    motion and a drift, t/T of the record, go on.
    """
    every, whole = suspect.model.every, len(suspect.samples)
    samples = suspect.samples[begin:end]
    part = replace(
        suspect,
        samples=samples,
        known=suspect.known[begin * every : end * every],
        begin=suspect.begin + begin,
        span=_moving_part(_second_largest(_energy(suspect)[begin:end])),
    )
    if (begin, end) == (0, whole):
        return part
    loads = suspect.known.shape[-1]

    def within(considered: ConsideredParameters) -> ConsideredParameters:
        if considered.E.shape[-1] == loads:
            return considered
        E, drift = considered.E.copy(), considered.E[..., -1]
        E[..., -1] = drift * (end - begin) / whole
        return replace(considered, E=E, offset=considered.offset + drift * begin / whole)

    def turned(channel: int, angle: float) -> tuple[FilterModel, ConsideredParameters]:
        model, considered = suspect.turned(channel, angle)
        return model, within(considered)

    settled = suspect.settled
    if settled is not None:
        phase = np.exp(1j * settled.frequency * begin * every * suspect.model.h)
        settled = replace(settled, hold=settled.hold * phase[:, None, None])
    return replace(
        part,
        covariance=suspect.covariance if begin == 0 else _unknown_motion(suspect, samples),
        considered=within(suspect.considered),
        settled=settled,
        turned=turned,
    )


def _energy(suspect: CheckRecord) -> np.ndarray:
    """Squares (T, m) of the readings over their noise, less what is rest; those of single samples count for nothing."""
    y = suspect.samples
    if len(suspect.biased):
        y = y.copy()
        known = np.isfinite(y[:, suspect.biased]).any(axis=0)
        at = suspect.biased[known]
        y[:, at] -= np.nanmedian(y[:, at], axis=0)
    size = np.abs(np.nan_to_num(y)) / suspect.noise
    if len(size) > 2:
        size[1:-1] = np.sort([size[:-2], size[1:-1], size[2:]], axis=0)[1]
    return np.asarray(np.maximum(size**2 - FAINT_READING**2, 0.0))


def _second_largest(energy: np.ndarray) -> np.ndarray:
    """Of the channels at every instant (T,): no single wrong channel decides on it."""
    return np.asarray(np.sort(energy, axis=1)[:, -min(2, energy.shape[1])])


def _loudest(energy: np.ndarray) -> tuple[int, int]:
    """The stretch of LONGEST samples with the most energy (T,), the first of equal ones."""
    whole = np.concatenate([[0.0], np.cumsum(energy)])
    first = int(np.argmax(whole[LONGEST:] - whole[:-LONGEST]))
    return first, first + LONGEST


def _moving_part(energy: np.ndarray) -> tuple[int, int] | None:
    """The shortest part with all of the energy (T,) but TAIL at either end; None where it is more than half of all samples."""
    whole = np.cumsum(energy)
    if not len(energy) or not whole[-1] > 0:
        return None
    first, last = np.searchsorted(whole, np.array([TAIL, 1 - TAIL]) * whole[-1])
    return (int(first), int(last) + 1) if FEWEST <= last + 1 - first <= 0.5 * len(energy) else None


def _unknown_motion(suspect: CheckRecord, samples: np.ndarray) -> np.ndarray:
    """The covariance of a motion that nothing is known of, widened where the channels (T, m) read more than it foresees."""
    covariance = suspect.covariance if suspect.moving is None else suspect.moving
    model, n = suspect.model, suspect.model.parameter_states.start
    rows = model.H[..., :n]
    foreseen = np.sqrt(np.einsum("mi,ij,mj->m", rows, covariance[:n, :n], rows))
    largest = np.nanmax(np.abs(np.nan_to_num(samples)), axis=0)
    use = foreseen > 0
    if model.accelerometers is not None:
        use &= ~model.accelerometers
    wider = max(1.0, float(np.median(largest[use] / foreseen[use]))) if use.any() else 1.0
    return _wider_motion(covariance, n, wider)

"""Whether a record of any length agrees with its model: faults are looked for in the stretches where its channels read most,
innovations are looked at from its beginning to its end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.decision import check_ratio
from strainsight.estimation.fault_evidence import (
    LONGEST,
    CheckRecord,
    at_rest,
    explained,
    loudest_channel,
    loudest_stretches,
    missed_of,
    moving_part_of,
    part_of,
    ratio_of,
    stretch_at,
    suspected,
    too_large,
    with_intensity,
)
from strainsight.estimation.fault_search import Diagnosis, checked_by_others, examined
from strainsight.estimation.faults import APART, BELIEVABLE, MARGIN, Explained, Fault, chosen
from strainsight.estimation.grid_filter import GridRun, filter_on_grid
from strainsight.estimation.load_faults import ResidualPattern, residual_pattern

INTENSITIES = (1.0, 1e-2, 1e-4, 1e-6, 1e-8, 0.0)
"""Factors on the intensity of unknown loads, the most likely of which a stretch at rest is checked with."""

FASTER = (3.0, 10.0, 30.0, 100.0)
"""Factors on the intensity of unknown loads, which explain a pattern of residuals where their process noise is too small."""

SPIKE = 8.0
"""Of its σ, from which an innovation is no noise."""
ROUNDS = 12
"""Most samples of one disturbance that are marked one after the other."""
BETWEEN = 10
"""Samples between two disturbances: within it the filter still follows the first."""
MOST_SHARE, ALWAYS, MOST_ROWS = 0.01, 5, 50
"""Share of the readings that may be marked, and the number of them that may be in any record; instants of large innovations, as
many as which are no spikes."""
SILENT = 3
"""Instants one after the other without any reading, which explain whatever comes behind them."""

SUDDEN = 1e6
"""Factor on the intensity of unknown loads, with which they may change from one sample to the next."""

Fit = tuple[Explained, GridRun | None]
"""How a record fits, and what its grid filter estimated, None where that fails."""
Progress = Callable[[float], None]


@dataclass(frozen=True)
class RecordCheck:
    """What was found in the stretch that shows most; worst: sample of the record and channel of the largest innovation, and its
    size over σ; part: the samples of the record that the check of channels is of, the first and the one behind the last."""

    finding: Diagnosis
    stretch: CheckRecord
    worst: tuple[int, int, float]
    part: tuple[int, int]


def check_record(
    suspect: CheckRecord, discrepancy: float = 0.0, progress: Progress = lambda share: None
) -> RecordCheck:
    """Check a record against its model, as `examined` does a stretch.

    A record that agrees where its channels read most is filtered as a whole, with the parameters that are most likely there:
    the innovations of any LONGEST samples contradict the model where they are BELIEVABLE times as large as claimed, and faults
    are looked for where they are largest.
    """
    stretches, checks = loudest_stretches(suspect), []
    for i, (begin, end) in enumerate(stretches):

        def going(share: float, i: int = i) -> None:
            progress((i + share) / (len(stretches) + 1))

        whole = part_of(suspect, begin, end)
        check = _check_stretch(moving_part_of(whole), whole, discrepancy, going)
        checks.append(check)
        if check.finding.inconsistent:
            break
    all_of_it = len(check.stretch.samples) == len(suspect.samples)
    if all_of_it or (check.finding.inconsistent and not _has_spikes(check.finding)):
        return check
    return _check_all(suspect, checks, discrepancy, progress)


def _check_stretch(part: CheckRecord, whole: CheckRecord, discrepancy: float, progress: Progress) -> RecordCheck:
    """Faults are looked for in a part of a stretch; what is as good as another one there is weighed by all of it."""
    as_it_is = explained(part, None)
    worst = _worst_of(part, as_it_is[1])
    if at_rest(part) and not _agrees(part, as_it_is):
        factor = _intensity_at_rest(part)
        part, whole = with_intensity(part, factor), with_intensity(whole, factor)
        as_it_is = explained(part, None)
        worst = _worst_of(part, as_it_is[1])
    if worst[2] > SPIKE and (spikes := spikes_of(part)) is not None:
        without, best = spikes
        check, ratios = checked_by_others(without, progress)
        finding = Diagnosis(True, as_it_is[0], check, ratios, (best,), best, (best,))
        return RecordCheck(finding, part, worst, _moving(part))
    finding = examined(part, discrepancy, progress, as_it_is)
    if finding.searched and (pattern := _unmodelled_load(part, as_it_is, finding)) is not None:
        finding = replace(finding, inconsistent=True, named=None, candidates=(), shifted=None, pattern=pattern)
    stretch = part
    if len(part.samples) < len(whole.samples) and len(finding.candidates) > 1:
        later = part.begin - whole.begin
        faults = [one.fault.later(later) for one in finding.candidates if one.fault is not None]
        tried = [explained(whole, fault)[0] for fault in faults]
        named, candidates = chosen(explained(whole, None)[0].evidence, tried)
        if candidates:
            finding, stretch = replace(finding, named=named, candidates=candidates), whole
    return RecordCheck(finding, stretch, worst, _moving(part))


def _unmodelled_load(part: CheckRecord, fit: Fit, finding: Diagnosis) -> ResidualPattern | None:
    """The pattern of a load that the model does not have.

    None where a fault leaves innovations as large as claimed, where a fault or loads of the model that change faster than stated
    explain the measurements as well, and where channels are too few to tell a pattern.
    """
    as_it_is, grid_run = fit
    inputs = part.model.unknowns.inputs
    samples = int(np.isfinite(part.samples).sum())
    explains = any(not check_ratio(one.ratio, samples).overconfident for one in finding.candidates)
    if grid_run is None or explains or part.samples.shape[1] < len(inputs) + 2:
        return None
    white, innovation = grid_run.run.whitened[part.sampled, 0], grid_run.run.innovation[part.sampled, 0]
    pattern = residual_pattern(white, innovation, part.noise, BELIEVABLE)
    if pattern is None:
        return None
    others = [one.evidence for one in finding.candidates]
    others += [explained(with_intensity(part, factor), None)[0].evidence for factor in FASTER if inputs]
    evidence = as_it_is.evidence + pattern.gain
    return pattern if evidence > max([as_it_is.evidence + MARGIN, *(other + APART for other in others)]) else None


def _agrees(part: CheckRecord, fit: Fit) -> bool:
    return not suspected(*fit) and _worst_of(part, fit[1])[2] <= SPIKE


def _intensity_at_rest(part: CheckRecord) -> float:
    """Factor on the intensity of unknown loads that is most likely in a stretch at rest.

    Loads as intense as in a motion would be an error of the model there: whatever makes channels read less of them, as a dead
    channel does, would explain the rest better. Where the stretch does not agree even so, one channel may read what no load
    causes: the factor is then that of the other channels.
    """
    fits = [(factor, explained(with_intensity(part, factor), None)) for factor in INTENSITIES]
    factor, fit = max(fits, key=lambda one: one[1][0].evidence)
    if _agrees(part, fit) or part.samples.shape[1] < 2:
        return factor
    samples = part.samples.copy()
    samples[:, loudest_channel(part)] = np.nan
    others = replace(part, samples=samples)
    return max(INTENSITIES, key=lambda each: explained(with_intensity(others, each), None)[0].evidence)


def _moving(part: CheckRecord) -> tuple[int, int]:
    first, behind = part.span or (0, len(part.samples))
    return part.begin + first, part.begin + behind


def _check_all(
    suspect: CheckRecord, checks: Sequence[RecordCheck], discrepancy: float, progress: Progress
) -> RecordCheck:
    """All samples of a record, whose checked stretches agree with the model, or the last of them does but for spikes."""
    check = checks[-1]
    named = check.finding.named if _has_spikes(check.finding) else None
    point = np.array((named or check.finding.as_it_is).point)

    def fit(record: CheckRecord) -> Fit:
        return _filtered_at(record, point)

    whole = fit(suspect)
    worst = _worst_of(suspect, whole[1])
    # tolerances that are stretched do not count: a long rest stretches those that make channels read less of the loads
    if not too_large(*whole) and worst[2] <= SPIKE:
        return check
    if worst[2] > SPIKE and (spikes := spikes_of(suspect, fit)) is not None:
        named = spikes[1]
        finding = Diagnosis(True, whole[0], check.finding.check, tried=(named,), named=named, candidates=(named,))
        return RecordCheck(finding, suspect, worst, check.part)
    if named is not None:
        return check
    if whole[1] is None:
        bounds = stretch_at(suspect, worst[0])
    elif (elsewhere := _stretch_elsewhere(suspect, whole[1], checks)) is not None:
        bounds = elsewhere
    elif too_large(*whole):
        begin = _loudest_innovations(suspect, whole[1])
        bounds = begin, begin + LONGEST
    else:
        return check
    stretch = part_of(suspect, *bounds)
    local = _check_stretch(stretch, stretch, discrepancy, progress)
    if not local.finding.inconsistent and not whole[0].ratio <= BELIEVABLE and missed_of(whole[1]) > discrepancy:
        return replace(
            check, finding=replace(local.finding, inconsistent=True, as_it_is=whole[0]), worst=worst, part=local.part
        )
    return local if local.finding.inconsistent else check


def _stretch_elsewhere(
    suspect: CheckRecord, grid_run: GridRun, checks: Sequence[RecordCheck]
) -> tuple[int, int] | None:
    """The stretch about the largest innovation outside the checked ones, up to them; None where that is within SPIKE.

    What is large in a stretch that agrees is a load that changes at once.
    """
    size, _ = sizes_of(suspect, grid_run)
    checked = [(one.stretch.begin, one.stretch.begin + len(one.stretch.samples)) for one in checks]
    for first, behind in checked:
        size[first:behind] = 0.0
    k = int(np.argmax(size))
    if size[k] <= SPIKE:
        return None
    begin, end = stretch_at(suspect, k)
    return max([begin, *(b for _, b in checked if b <= k)]), min([end, *(a for a, _ in checked if a > k)])


def _filtered_at(suspect: CheckRecord, point: np.ndarray) -> Fit:
    """How a record fits with its parameters known: ratio of innovations over the LONGEST samples where it is largest."""
    record = replace(suspect, considered=replace(suspect.considered, learned=True)).known_at(point)
    try:
        grid_run = filter_on_grid(record, "mean")
    except NumericalError:
        return Explained(None, -np.inf, np.inf, point=tuple(point)), None
    begin, every = _loudest_innovations(suspect, grid_run), suspect.model.every
    ratio = ratio_of(grid_run, slice(begin * every, (begin + LONGEST) * every))
    return Explained(None, float(grid_run.run.log_likelihood[0]), ratio, point=tuple(point)), grid_run


def _loudest_innovations(suspect: CheckRecord, grid_run: GridRun) -> int:
    """First of the LONGEST samples whose innovations are largest over their σ, the first such."""
    whole = np.concatenate([[0.0], np.cumsum(np.nansum(grid_run.run.whitened[suspect.sampled, 0] ** 2, axis=1))])
    length = min(LONGEST, len(whole) - 1)
    return int(np.argmax(whole[length:] - whole[:-length]))


def _worst_of(suspect: CheckRecord, grid_run: GridRun | None) -> tuple[int, int, float]:
    """Sample of the record and channel of the largest innovation, and its size over σ."""
    if grid_run is None:
        return 0, 0, 0.0
    size, each = sizes_of(suspect, grid_run)
    k = int(np.argmax(size))
    return suspect.begin + k, int(np.argmax(each[k])), float(size[k])


def _has_spikes(finding: Diagnosis) -> bool:
    fault = None if finding.named is None else finding.named.fault
    return fault is not None and fault.kind == "spikes"


def sizes_of(suspect: CheckRecord, grid_run: GridRun) -> tuple[np.ndarray, np.ndarray]:
    """Size (T,) of the innovations of all channels together over their σ; and every one (T, m) over what is usual of its
    channel."""
    size = np.sqrt(np.nansum(grid_run.run.whitened[suspect.sampled, 0] ** 2, axis=1))
    innovation = np.abs(np.nan_to_num(grid_run.run.innovation[suspect.sampled, 0]))
    usual = np.maximum(suspect.noise, 1.5 * np.median(innovation, axis=0))
    return size, innovation / usual


def spikes_of(
    suspect: CheckRecord, fit: Callable[[CheckRecord], Fit] = lambda record: explained(record, None)
) -> tuple[CheckRecord, Explained] | None:
    """The record without few samples, without which it agrees with its model, and how it fits with that fault; None where it does
    not come to agree. fit: how a record does.

    They are sought beside unknown loads that may change at once, which channels then show together. The first sample of every
    disturbance is that of the channel whose innovation is largest; what follows it is what the filter made of it.
    """
    marked: list[tuple[int, int]] = []
    model, Q, samples = suspect.model, suspect.model.Q.copy(), suspect.samples.copy()
    Q[..., model.input_states, model.input_states] *= SUDDEN
    free = replace(suspect, model=replace(model, Q=Q))
    fitted = fit(free)
    most = max(ALWAYS, int(MOST_SHARE * samples.size))
    for _ in range(ROUNDS):
        if fitted[1] is None:
            return None
        size, each = sizes_of(suspect, fitted[1])
        rows = np.flatnonzero(size > max(SPIKE, 0.1 * size.max()))
        if not len(rows):
            break
        if len(rows) > max(MOST_ROWS, MOST_SHARE * len(samples)):
            return None
        rows = rows[np.diff(rows, prepend=-BETWEEN - 1) > BETWEEN]
        marked += [(int(np.argmax(each[k])), int(k)) for k in rows]
        if len(marked) > most:
            return None
        samples[tuple(np.transpose(marked)[::-1])] = np.nan
        fitted = fit(replace(free, samples=samples))
    else:
        return None
    without = replace(suspect, samples=samples)
    silent = np.isnan(samples).all(axis=1) & np.isfinite(suspect.samples).any(axis=1)
    if not marked or any(silent[k : k + SILENT].sum() == SILENT for k in np.flatnonzero(silent)):
        return None
    as_stated = fit(without)
    if suspected(*as_stated):
        return None
    spans = _joined(marked)
    return without, replace(as_stated[0], fault=Fault("spikes", spans[0][0], 0.0, spans=spans))


def _joined(marked: list[tuple[int, int]]) -> tuple[tuple[int, int, int], ...]:
    """Spans of samples that follow one another, by channel and time."""
    spans: list[tuple[int, int, int]] = []
    for channel, k in sorted(marked):
        if spans and spans[-1][0] == channel and spans[-1][2] == k:
            spans[-1] = (channel, spans[-1][1], k + 1)
        else:
            spans.append((channel, k, k + 1))
    return tuple(spans)

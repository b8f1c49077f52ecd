"""Consistency of a record of any length with its model. Faults are searched where the readings are largest; innovations are
checked over the whole record."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.decision import check_ratio
from strainsight.estimation.fault_evidence import (
    LONGEST,
    CheckRecord,
    explain_record,
    extract_moving_part,
    extract_part,
    innovation_ratio,
    is_at_rest,
    largest_channel,
    needs_fault_search,
    relative_innovation,
    scale_intensity,
    select_stretches,
    stretch_about,
    too_large,
)
from strainsight.estimation.fault_search import Diagnosis, check_by_others, examine_record
from strainsight.estimation.faults import APART, BELIEVABLE, MARGIN, Explained, Fault, choose_fault, relieves
from strainsight.estimation.grid_filter import GridRun, filter_on_grid
from strainsight.estimation.load_faults import ResidualPattern, residual_pattern

INTENSITIES = (1.0, 1e-2, 1e-4, 1e-6, 1e-8, 0.0)
"""Factors on the intensity of unknown loads for a stretch at rest; the most likely one is used."""

SPIKE = 8.0
"""Size of an innovation in σ that cannot be noise."""
ROUNDS = 12
"""Most successive samples of one disturbance that are marked."""
BETWEEN = 10
"""Samples between two disturbances, within which the filter still follows the first."""
MOST_SHARE, ALWAYS, MOST_ROWS = 0.01, 5, 50
"""Limits of marked readings: share, number always allowed, and instants of large innovations."""
SILENT = 3
"""Successive instants without readings, which explain any later deviation."""

LOAD_PATTERN = 1.6
"""Largest innovations over the claim that unknown loads leave in a combination of channels because they are not quite as their
process noise: 1.54 in sound records with multisine loads."""
SUDDEN = 1e6
"""Factor on the intensity of unknown loads that permits sudden changes."""

Fit = tuple[Explained, GridRun | None]
"""Fit of a record, and the run of its grid filter, None if it failed."""
Progress = Callable[[float], None]


@dataclass(frozen=True)
class RecordCheck:
    """Result of the decisive stretch; worst: sample, channel and size in σ of the largest innovation; part: first sample and end
    of the channel check."""

    finding: Diagnosis
    stretch: CheckRecord
    worst: tuple[int, int, float]
    part: tuple[int, int]


def check_record(record: CheckRecord, discrepancy: float = 0.0, progress: Progress = lambda share: None) -> RecordCheck:
    """Check a record against its model, as `examine_record` does for a stretch. A record that is consistent where its
    readings are largest is filtered as a whole, with the most likely parameters of that part. It is inconsistent if the
    innovations of any LONGEST samples are BELIEVABLE times larger than claimed; faults are then searched there."""
    stretches, checks = select_stretches(record), []
    for i, (begin, end) in enumerate(stretches):

        def going(share: float, i: int = i) -> None:
            progress((i + share) / (len(stretches) + 1))

        whole = extract_part(record, begin, end)
        check = _check_stretch(extract_moving_part(whole), whole, discrepancy, going)
        checks.append(check)
        if check.finding.inconsistent:
            break
    all_of_it = len(check.stretch.samples) == len(record.samples)
    if all_of_it or (check.finding.inconsistent and not _has_spikes(check.finding)):
        return check
    return _check_whole(record, checks, discrepancy, progress)


def _check_stretch(part: CheckRecord, whole: CheckRecord, discrepancy: float, progress: Progress) -> RecordCheck:
    """Search faults in the moving part of a stretch; equivalent candidates are compared on the whole stretch."""
    as_it_is = explain_record(part, None)
    worst = _worst_of(part, as_it_is[1])
    if is_at_rest(part) and not _agrees(part, as_it_is):
        factor = _intensity_at_rest(part)
        part, whole = scale_intensity(part, factor), scale_intensity(whole, factor)
        as_it_is = explain_record(part, None)
        worst = _worst_of(part, as_it_is[1])
    if worst[2] > SPIKE and (spikes := find_spikes(part)) is not None:
        without, best = spikes
        check = check_by_others(without, progress)
        finding = Diagnosis(True, as_it_is[0], check, tried=(best,), named=best, candidates=(best,))
        return RecordCheck(finding, part, worst, _moving(part))
    finding = examine_record(part, discrepancy, progress, as_it_is)
    if finding.searched and (pattern := _unmodelled_load(part, as_it_is, finding)) is not None:
        finding = replace(finding, inconsistent=True, named=None, candidates=(), shifted=None, pattern=pattern)
    stretch = part
    of_model = any(one.fault is not None and one.fault.of_model for one in finding.candidates)
    if len(part.samples) < len(whole.samples) and len(finding.candidates) > 1 and not of_model:
        later = part.begin - whole.begin
        faults = [one.fault.later(later) for one in finding.candidates if one.fault is not None]
        tried = [explain_record(whole, fault)[0] for fault in faults]
        named, candidates = choose_fault(explain_record(whole, None)[0].evidence, tried)
        if candidates:
            finding, stretch = replace(finding, named=named, candidates=candidates), whole
    return RecordCheck(finding, stretch, worst, _moving(part))


def _unmodelled_load(part: CheckRecord, fit: Fit, finding: Diagnosis) -> ResidualPattern | None:
    """The residual pattern of an unmodelled load. None if a fault brings the innovations to the claim, if a fault or faster
    loads explain the measurements as well, or if there are too few channels."""
    as_it_is, grid_run = fit
    inputs = part.model.unknowns.inputs
    samples = int(np.isfinite(part.samples).sum())
    of_model = any(one.fault is not None and one.fault.of_model for one in finding.candidates)
    explains = of_model or any(
        not check_ratio(one.ratio, samples).overconfident or relieves(one.ratio, as_it_is.ratio)
        for one in finding.candidates
    )
    if grid_run is None or explains or part.samples.shape[1] < len(inputs) + 2:
        return None
    white, innovation = grid_run.run.whitened[part.sampled, 0], grid_run.run.innovation[part.sampled, 0]
    pattern = residual_pattern(white, innovation, part.noise, LOAD_PATTERN if inputs else BELIEVABLE)
    if pattern is None:
        return None
    faster = [finding.reference + MARGIN - APART] * (finding.reference_ratio <= BELIEVABLE)
    others = [*faster, *(one.evidence for one in finding.candidates)]
    evidence = as_it_is.evidence + pattern.gain
    return pattern if evidence > max([as_it_is.evidence + MARGIN, *(other + APART for other in others)]) else None


def _agrees(part: CheckRecord, fit: Fit) -> bool:
    return not needs_fault_search(*fit) and _worst_of(part, fit[1])[2] <= SPIKE


def _intensity_at_rest(part: CheckRecord) -> float:
    """Most likely factor on the intensity of unknown loads in a stretch at rest. The full intensity would be a model error
    there, which for example a dead channel would reduce. If the stretch remains inconsistent, one channel may be wrong, and
    the factor is that of the others."""
    fits = [(factor, explain_record(scale_intensity(part, factor), None)) for factor in INTENSITIES]
    factor, fit = max(fits, key=lambda one: one[1][0].evidence)
    if _agrees(part, fit) or part.samples.shape[1] < 2:
        return factor
    samples = part.samples.copy()
    samples[:, largest_channel(part)] = np.nan
    others = replace(part, samples=samples)
    return max(INTENSITIES, key=lambda each: explain_record(scale_intensity(others, each), None)[0].evidence)


def _moving(part: CheckRecord) -> tuple[int, int]:
    first, behind = part.span or (0, len(part.samples))
    return part.begin + first, part.begin + behind


def _check_whole(
    record: CheckRecord, checks: Sequence[RecordCheck], discrepancy: float, progress: Progress
) -> RecordCheck:
    """Check all samples of a record whose stretches are consistent, apart from spikes."""
    check = checks[-1]
    named = check.finding.named if _has_spikes(check.finding) else None
    point = np.array((named or check.finding.as_it_is).point)

    def fit(record: CheckRecord) -> Fit:
        return _filter_at(record, point)

    whole = fit(record)
    worst = _worst_of(record, whole[1])
    # tolerances that are stretched do not count: a long rest stretches those that make channels read less of the loads
    if not too_large(*whole) and worst[2] <= SPIKE:
        return check
    if worst[2] > SPIKE and (spikes := find_spikes(record, fit)) is not None:
        named = spikes[1]
        finding = Diagnosis(True, whole[0], check.finding.check, tried=(named,), named=named, candidates=(named,))
        return RecordCheck(finding, record, worst, check.part)
    if named is not None:
        return check
    if whole[1] is None:
        bounds = stretch_about(record, worst[0])
    elif (elsewhere := _stretch_elsewhere(record, whole[1], checks)) is not None:
        bounds = elsewhere
    elif too_large(*whole):
        begin = _loudest_innovations(record, whole[1])
        bounds = begin, begin + LONGEST
    else:
        return check
    stretch = extract_part(record, *bounds)
    local = _check_stretch(stretch, stretch, discrepancy, progress)
    if (
        not local.finding.inconsistent
        and not whole[0].ratio <= BELIEVABLE
        and relative_innovation(whole[1]) > discrepancy
    ):
        return replace(
            check, finding=replace(local.finding, inconsistent=True, as_it_is=whole[0]), worst=worst, part=local.part
        )
    return local if local.finding.inconsistent else check


def _stretch_elsewhere(record: CheckRecord, grid_run: GridRun, checks: Sequence[RecordCheck]) -> tuple[int, int] | None:
    """The stretch about the largest innovation outside the checked ones; None if that is within SPIKE. Large innovations
    inside a consistent stretch are sudden load changes."""
    size, _ = innovation_sizes(record, grid_run)
    checked = [(one.stretch.begin, one.stretch.begin + len(one.stretch.samples)) for one in checks]
    for first, behind in checked:
        size[first:behind] = 0.0
    k = int(np.argmax(size))
    if size[k] <= SPIKE:
        return None
    begin, end = stretch_about(record, k)
    return max([begin, *(b for _, b in checked if b <= k)]), min([end, *(a for a, _ in checked if a > k)])


def _filter_at(record: CheckRecord, point: np.ndarray) -> Fit:
    """Fit of a record with known parameters: ratio of innovations over the worst LONGEST samples."""
    fixed = replace(record, considered=replace(record.considered, learned=True)).known_at(point)
    try:
        grid_run = filter_on_grid(fixed, "readings")
    except NumericalError:
        return Explained(None, -np.inf, np.inf, point=tuple(point)), None
    begin, every = _loudest_innovations(record, grid_run), record.model.every
    ratio = innovation_ratio(grid_run, slice(begin * every, (begin + LONGEST) * every))
    return Explained(None, float(grid_run.run.log_likelihood[0]), ratio, point=tuple(point)), grid_run


def _loudest_innovations(record: CheckRecord, grid_run: GridRun) -> int:
    """First of the LONGEST samples with the largest normalised innovations."""
    whole = np.concatenate([[0.0], np.cumsum(np.nansum(grid_run.run.whitened[record.sampled, 0] ** 2, axis=1))])
    length = min(LONGEST, len(whole) - 1)
    return int(np.argmax(whole[length:] - whole[:-length]))


def _worst_of(record: CheckRecord, grid_run: GridRun | None) -> tuple[int, int, float]:
    """Sample, channel and size in σ of the largest innovation."""
    if grid_run is None:
        return 0, 0, 0.0
    size, each = innovation_sizes(record, grid_run)
    k = int(np.argmax(size))
    return record.begin + k, int(np.argmax(each[k])), float(size[k])


def _has_spikes(finding: Diagnosis) -> bool:
    fault = None if finding.named is None else finding.named.fault
    return fault is not None and fault.kind == "spikes"


def innovation_sizes(record: CheckRecord, grid_run: GridRun) -> tuple[np.ndarray, np.ndarray]:
    """Size (T,) of the innovations of all channels over their σ, and each (T, m) over the usual size of its channel."""
    size = np.sqrt(np.nansum(grid_run.run.whitened[record.sampled, 0] ** 2, axis=1))
    size[0] = 0.0  # no earlier reading predicts the first sample
    innovation = np.abs(np.nan_to_num(grid_run.run.innovation[record.sampled, 0]))
    usual = np.maximum(record.noise, 1.5 * np.median(innovation, axis=0))
    return size, innovation / usual


def find_spikes(
    record: CheckRecord, fit: Callable[[CheckRecord], Fit] = lambda record: explain_record(record, None)
) -> tuple[CheckRecord, Explained] | None:
    """The record without the few samples that make it inconsistent, and its fit; None if it remains inconsistent. fit: fits a
    record.

    Spikes are searched with unknown loads that may change suddenly, which affects several channels at once. The first sample
    of each disturbance belongs to the channel with the largest innovation; later ones are the response of the filter."""
    marked: list[tuple[int, int]] = []
    model, Q, samples = record.model, record.model.Q.copy(), record.samples.copy()
    Q[..., model.input_states, model.input_states] *= SUDDEN
    free = replace(record, model=replace(model, Q=Q))
    fitted = fit(free)
    most = max(ALWAYS, int(MOST_SHARE * samples.size))
    for _ in range(ROUNDS):
        if fitted[1] is None:
            return None
        size, each = innovation_sizes(record, fitted[1])
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
    without = replace(record, samples=samples)
    silent = np.isnan(samples).all(axis=1) & np.isfinite(record.samples).any(axis=1)
    if not marked or any(silent[k : k + SILENT].sum() == SILENT for k in np.flatnonzero(silent)):
        return None
    as_stated = fit(without)
    if needs_fault_search(*as_stated) and not relieves(as_stated[0].ratio, fit(record)[0].ratio):
        return None
    spans = _merge_spans(marked)
    return without, replace(as_stated[0], fault=Fault("spikes", spans[0][0], 0.0, spans=spans))


def _merge_spans(marked: list[tuple[int, int]]) -> tuple[tuple[int, int, int], ...]:
    """Spans of successive samples, by channel and time."""
    spans: list[tuple[int, int, int]] = []
    for channel, k in sorted(marked):
        if spans and spans[-1][0] == channel and spans[-1][2] == k:
            spans[-1] = (channel, spans[-1][1], k + 1)
        else:
            spans.append((channel, k, k + 1))
    return tuple(spans)

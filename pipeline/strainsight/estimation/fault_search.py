"""Search for the fault of a channel or a known load that explains inconsistent measurements. Faults are compared by the
evidence of the grid filter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from strainsight.estimation.decision import SLACK
from strainsight.estimation.fault_evidence import (
    STRETCHED,
    CheckRecord,
    ShiftedMode,
    explain_record,
    installation_share,
    needs_fault_search,
    relative_innovation,
    scale_intensity,
    shifted_mode,
    too_large,
    widen_tolerances,
)
from strainsight.estimation.faults import (
    ANGLES,
    BELIEVABLE,
    MARGIN,
    MOST_LATE,
    SCALES,
    ChannelCheck,
    Explained,
    Fault,
    approximate_density,
    as_factor,
    at_limit,
    check_channels,
    choose_fault,
    dead_density,
    find_delay,
    find_factor,
    find_temporary_faults,
)
from strainsight.estimation.grid_filter import GridRun
from strainsight.estimation.hum import explain_hum
from strainsight.estimation.load_faults import Innovations, ResidualPattern, compute_innovations, select_load_faults
from strainsight.estimation.model_errors import between, further, model_errors

TURNS = 3
"""Angles of a channel, the best by the prediction of the others, that are ranked among its faults."""
CLOSELY, EACH = 6, 3
"""Faults evaluated with all tolerances: the best overall, and the best kinds of each channel that may be wrong."""
REFINED, FACTOR_STEPS = 3, (0.06, 0.02)
"""Channels whose fitted factor is refined, and steps in its logarithm."""
PAIRS = 5
"""Number of channels of which all pairs are tried as swapped."""
MOST_SIZES, HALVED = 6, 2
"""Most sizes of a model error that are tried one after another, and how often the interval about the best is halved."""
FASTER = (3.0, 10.0, 30.0, 100.0)
"""Factors on the intensity of unknown loads; if their process noise is too small, this is no fault of the record."""
UNRESOLVED = 0.1
"""Share of the gain in evidence by faster loads that the model of the loads does not resolve: it adds to MARGIN if these loads
explain the record."""
WIDER = 2.0
"""Factor on all tolerances of a sound record: installation and loads may be worse than configured, to second order as well."""
FAINT, QUIET = 0.2, 2.0
"""A channel may be dead below this share of its prediction, and below this multiple of its noise."""
FEWEST = 3
"""Number of affected channels from which a load fault cannot be explained by faults of one or two channels."""


@dataclass(frozen=True)
class Diagnosis:
    """Whether a record is inconsistent with its model, and why. as_it_is: the record without a fault; reference: its evidence
    with the most likely intensity of the unknown loads, and what their model does not resolve; reference_ratio: RMS of those
    innovations over the claim; check: each channel
    against the prediction by all others, or one step ahead if no fault was searched or a load is wrong (`by_others`); tried:
    evaluated faults; named: the fault that explains the record, None if none or several do; candidates: all that do, best
    first; shifted: mode too far from the model, if no fault explains the record; pattern: of an unmodelled load; searched:
    whether a fault was searched."""

    inconsistent: bool
    as_it_is: Explained
    check: ChannelCheck
    tried: tuple[Explained, ...] = ()
    named: Explained | None = None
    candidates: tuple[Explained, ...] = ()
    shifted: ShiftedMode | None = None
    pattern: ResidualPattern | None = None
    reference: float = -np.inf
    reference_ratio: float = np.inf
    searched: bool = True

    def best_of(self, channel: int) -> Explained | None:
        """The best fault of one channel; None if none makes the innovations plausible or improves the evidence."""
        if any(one.fault is not None and one.fault.of_model for one in self.candidates):
            return None
        tried = (one for one in self.tried if one.fault is not None and channel in one.fault.channels)
        believable = [one for one in tried if one.ratio <= BELIEVABLE]
        best = max(believable, key=lambda one: one.evidence, default=None)
        return best if best is not None and best.evidence > self.without_fault else None

    @property
    def without_fault(self) -> float:
        """ln evidence of the record without a fault."""
        return max(self.as_it_is.evidence, self.reference)


def examine_record(
    record: CheckRecord,
    discrepancy: float = 0.0,
    progress: Callable[[float], None] = lambda share: None,
    first: tuple[Explained, GridRun | None] | None = None,
) -> Diagnosis:
    """Check a record against its model, and search for faults if necessary; first: the result without a fault, if known. A
    record is inconsistent if a fault explains it far better than none (`choose_fault`). It is also inconsistent if its
    innovations are BELIEVABLE times larger than claimed and exceed `discrepancy`, a share of the reading. The same holds if a
    mode is further from the model than STRETCHED of its tolerance (`shifted_mode`)."""
    as_it_is, grid_run = first or explain_record(record, None)
    if grid_run is not None and not needs_fault_search(as_it_is, grid_run):
        return Diagnosis(False, as_it_is, _check_ahead(record, grid_run), searched=False)
    finding = search_faults(record, progress, (as_it_is, grid_run))
    too_large = not as_it_is.ratio <= BELIEVABLE and relative_innovation(grid_run) > discrepancy
    shifted = None if finding.inconsistent or too_large else finding.shifted
    return replace(finding, inconsistent=finding.inconsistent or too_large or shifted is not None, shifted=shifted)


def _check_ahead(record: CheckRecord, grid_run: GridRun) -> ChannelCheck:
    """Each channel against its one-step prediction, in the moving part."""
    span = slice(*record.span or (None,))
    samples, whitened = record.samples[span], grid_run.run.whitened[record.sampled, 0][span]
    foreseen = samples - grid_run.run.innovation[record.sampled, 0][span]
    residual = np.sqrt(np.nansum(whitened**2, axis=0) / np.maximum(np.isfinite(whitened).sum(axis=0), 1))
    return replace(check_channels(samples, foreseen, np.ones_like(foreseen), by_others=False), residual=residual)


def search_faults(
    record: CheckRecord,
    progress: Callable[[float], None] = lambda share: None,
    first: tuple[Explained, GridRun | None] | None = None,
) -> Diagnosis:
    """Try all faults of known loads and channels on a record; first: the result without a fault. Load faults are ranked by
    filters without tolerances (`load_faults`). Faults of a channel without which the innovations are plausible are ranked by
    the prediction of the other channels (`approximate_density`). The best are evaluated with all tolerances
    (`explain_record`), as are swaps of the worst channels. Innovations are computed only of faults that are more likely than
    none. A load fault that affects FEWEST channels is not a channel fault. Without more channels than unknown loads no fault is
    named."""
    m = record.samples.shape[1]
    as_it_is, grid_run = explain_record(record, None) if first is None else first
    tried: list[Explained] = []
    innovations: Innovations | None = None
    if m > len(record.model.unknowns.inputs):
        tried, innovations = _try_load_faults(record, as_it_is.evidence)
    named, candidates = choose_fault(as_it_is.evidence, tried)
    if grid_run is not None and innovations is not None and _is_load_fault_only(innovations, candidates):
        check = _check_ahead(record, grid_run)
        return Diagnosis(bool(candidates), as_it_is, check, tried=tuple(tried), named=named, candidates=candidates)
    left_out = _predict_each_channel(record, lambda share: progress(0.4 * share))
    check, without = _compare_channels(record, left_out), np.array([one.ratio for one in left_out])
    order = np.argsort(np.where(np.isfinite(without), without, np.inf), kind="stable")
    alone = np.flatnonzero(without <= BELIEVABLE)
    if m <= len(record.model.unknowns.inputs):
        # any reading can be caused by some load: only the configured loads could exclude it
        return Diagnosis(False, as_it_is, check)
    if m == 1:
        # a single channel cannot distinguish a channel fault from a load fault
        wanted = [
            _as_channel_fault(one.fault) for one in candidates if one.fault is not None and one.fault.kind != "swapped"
        ]
    else:
        wanted = _select_faults(record, left_out, alone if len(alone) else order[:2])
    worst = sorted(int(j) for j in order[:PAIRS])
    quantity = record.model.quantity
    pairs = ((i, j) for i, j in combinations(worst, 2) if quantity is None or quantity[i] == quantity[j])
    wanted += [Fault("swapped", i, j) for i, j in pairs]
    for k, fault in enumerate(wanted):
        tried.append(explain_record(record, fault, as_it_is.evidence)[0])
        progress(0.4 + 0.6 * (k + 1) / len(wanted))
    tried += _extend_delays(record, wanted, tried, as_it_is.evidence)
    tried += _refine_factors(record, tried, as_it_is.evidence)
    scaled, (reference, run) = _with_likely_intensity(record, (as_it_is, grid_run))
    if scaled is not record:
        best = sorted(tried, key=lambda one: -one.evidence)[:CLOSELY]
        tried += [explain_record(scaled, one.fault, reference.evidence)[0] for one in best]
    # an unknown load that its model describes badly makes other frequencies and damping more likely
    large = not as_it_is.ratio <= BELIEVABLE if record.model.unknowns.inputs else too_large(as_it_is, grid_run)
    if large or _convincing(choose_fault(reference.evidence, tried)[1], scaled, reference, run):
        tried += _try_model_errors(scaled, reference.evidence)
        hum = None if run is None else explain_hum(scaled, reference, run)
        tried += [] if hum is None else [hum]
    explains = reference.ratio <= BELIEVABLE and np.isfinite(as_it_is.evidence)
    unresolved = UNRESOLVED * (reference.evidence - as_it_is.evidence) if explains else 0.0
    _, candidates = choose_fault(reference.evidence, tried, MARGIN + unresolved, as_it_is.ratio)
    candidates = _convincing(candidates, scaled, reference, run)
    named = candidates[0] if len(candidates) == 1 else None
    finding = Diagnosis(bool(candidates), as_it_is, check, tuple(tried), named, candidates)
    shifted = shifted_mode(record.model, record.considered, run)
    evidence, ratio = reference.evidence + unresolved, reference.ratio
    return replace(finding, shifted=shifted, reference=evidence, reference_ratio=ratio)


def _convincing(
    candidates: Sequence[Explained], record: CheckRecord, reference: Explained, grid_run: GridRun | None
) -> tuple[Explained, ...]:
    """Candidates without channel faults that an imperfect installation shows as well. In a record whose innovations are plausible
    without a fault, that of a channel has to bring them to the claim, and to be better by MARGIN than tolerances WIDER times as
    large. A fitted factor has to exceed STRETCHED σ of the installation of its gauge; if it does not, less likely faults of
    this channel are not convincing either."""
    if grid_run is None or not reference.ratio <= BELIEVABLE or not any(one.of_channel for one in candidates):
        return tuple(candidates)
    wider = explain_record(widen_tolerances(record, WIDER), None, reference.evidence)[0]
    least, share = max(reference.evidence, wider.evidence) + MARGIN, installation_share(record, grid_run)
    within = {
        one.fault.channel: one.evidence
        for one in candidates
        if one.fault is not None
        and one.fault.fitted
        and abs(np.log(one.fault.amount)) <= STRETCHED * share[one.fault.channel]
    }

    def convincing(one: Explained) -> bool:
        if one.fault is None or not one.of_channel:
            return True
        more = all(one.evidence > within.get(channel, -np.inf) for channel in one.fault.channels)
        return one.evidence >= least and one.ratio <= 1 + SLACK and more

    return tuple(one for one in candidates if convincing(one))


def _with_likely_intensity(
    record: CheckRecord, first: tuple[Explained, GridRun | None]
) -> tuple[CheckRecord, tuple[Explained, GridRun | None]]:
    """The record with the most likely intensity of the unknown loads, and its fit."""
    fits = [(record, first)]
    for factor in FASTER if record.model.unknowns.inputs else ():
        scaled = scale_intensity(record, factor)
        fits.append((scaled, explain_record(scaled, None, fits[-1][1][0].evidence)))
        if fits[-1][1][0].evidence < fits[-2][1][0].evidence:
            break
    return max(fits, key=lambda fit: fit[1][0].evidence)


def _try_model_errors(record: CheckRecord, as_it_is: float) -> list[Explained]:
    """Evaluated errors of the model: their sizes grow as long as the evidence does, from as_it_is on, and the interval about the
    best is halved HALVED times. All sizes of a mass are tried, as the evidence may have several peaks."""
    tried: list[Explained] = []
    for first in model_errors(record.model, record.considered):
        sizes, highest, fault = {first: explain_record(record, first, as_it_is)[0]}, as_it_is, first
        while len(sizes) < MOST_SIZES and (ahead := further(fault)) is not None:
            if first.kind != "mass" and not sizes[fault].evidence > highest:
                break
            highest, fault = sizes[fault].evidence, ahead
            sizes[fault] = explain_record(record, fault, as_it_is)[0]
        for _ in range(HALVED * (len(sizes) > 1)):
            ordered = sorted(sizes, key=lambda one: one.amount)
            best = max(range(len(ordered)), key=lambda k: sizes[ordered[k]].evidence)
            for k in (best - 1, best + 1):
                if 0 <= k < len(ordered):
                    middle = between(ordered[best], ordered[k])
                    sizes[middle] = explain_record(record, middle, as_it_is)[0]
        tried += sizes.values()
    return tried


def _try_load_faults(record: CheckRecord, as_it_is: float) -> tuple[list[Explained], Innovations | None]:
    """Evaluated load faults, and the innovations by which they were ranked; empty without known loads."""
    if not record.known.shape[-1]:
        return [], None
    innovations = compute_innovations(record, record.load)
    wanted = select_load_faults(innovations)
    tried = [explain_record(record, fault, as_it_is)[0] for fault in wanted]
    return tried + _extend_delays(record, wanted, tried, as_it_is), innovations


def _is_load_fault_only(innovations: Innovations, candidates: Sequence[Explained]) -> bool:
    """Whether no channel fault can explain the effect of a load fault."""
    faults = [one.fault for one in candidates if one.fault is not None]
    return bool(faults) and all(innovations.speaking(fault) >= FEWEST for fault in faults)


def _as_channel_fault(fault: Fault) -> Fault:
    """The fault of the only channel that is equivalent to a load fault."""
    amount = {"scale": 1 / fault.amount if fault.amount else 0.0, "late": -fault.amount}.get(fault.kind, 0.0)
    return Fault(fault.kind, 0, amount)


def check_by_others(record: CheckRecord, progress: Callable[[float], None]) -> ChannelCheck:
    """Each channel against the prediction by all others."""
    return _compare_channels(record, _predict_each_channel(record, progress))


def _predict_each_channel(record: CheckRecord, progress: Callable[[float], None]) -> list[PredictedChannel]:
    left_out, m = [], record.samples.shape[1]
    for j in range(m):
        left_out.append(_predict_channel(record, j))
        progress((j + 1) / m)
    return left_out


def _compare_channels(record: CheckRecord, left_out: Sequence[PredictedChannel]) -> ChannelCheck:
    span = slice(*record.span or (None,))
    predicted = np.column_stack([one.predicted for one in left_out])[span]
    std = np.hypot(np.column_stack([one.std for one in left_out]), record.noise)[span]
    return check_channels(record.samples[span], predicted, std)


@dataclass(frozen=True)
class PredictedChannel:
    """A channel predicted by all others: predicted, std (T,) [unit], turned (T, angles); ratio and evidence of the other
    innovations."""

    predicted: np.ndarray
    std: np.ndarray
    turned: np.ndarray
    ratio: float
    evidence: float


def _predict_channel(record: CheckRecord, j: int) -> PredictedChannel:
    without, grid_run = explain_record(record, Fault("dead", j))
    if grid_run is None:
        none = np.full(len(record.samples), np.nan)
        return PredictedChannel(none, none, np.full((len(none), len(ANGLES)), np.nan), np.inf, -np.inf)
    n, sampled = record.model.parameter_states.start, record.sampled
    states = grid_run.run.mean[1:, 0][sampled, :n]
    predicted, std = grid_run.run.gauge_mean[sampled, 0, j], grid_run.run.gauge_std[sampled, 0, j]
    others = without.evidence - dead_density(record.samples[:, j], float(record.noise[j]))
    return PredictedChannel(predicted, std, states @ record.turned_rows[j, :, :n].T, without.ratio, others)


def _select_faults(record: CheckRecord, left_out: Sequence[PredictedChannel], channels: np.ndarray) -> list[Fault]:
    """Faults of some channels to be evaluated."""
    ranked: list[tuple[float, Fault]] = []
    for j in channels:
        ranked += _rank_faults(record, left_out[j], int(j))
    ranked.sort(key=lambda one: -one[0])
    wanted = [fault for _, fault in ranked[:CLOSELY]]
    for j in channels:
        kinds: dict[str, Fault] = {}
        for _, fault in ranked:
            if fault.channel == j:
                kinds.setdefault(fault.kind, fault)
        wanted += list(kinds.values())[:EACH]
    return list(dict.fromkeys(wanted + [other for fault in wanted for other in fault.neighbours]))


def _extend_delays(
    record: CheckRecord, wanted: Sequence[Fault], tried: Sequence[Explained], as_it_is: float
) -> list[Explained]:
    """Further delays of each channel or load, as long as the last one is the best; as_it_is: evidence without a fault."""
    more: list[Explained] = []
    for family in dict.fromkeys(fault.family for fault in wanted if fault.kind == "late"):
        known = {one.fault.amount: one for one in tried if one.fault and one.fault.family == family}
        first = next(fault for fault in wanted if fault.family == family)
        for _ in range(MOST_LATE):
            best = max(known, key=lambda n: known[n].evidence)
            neighbours = [n for n in (best - 1, best + 1) if n and n not in known and abs(n) <= 2 * MOST_LATE]
            if not neighbours or not np.isfinite(known[best].evidence):
                break
            known[neighbours[0]] = explain_record(record, replace(first, amount=neighbours[0]), as_it_is)[0]
            more.append(known[neighbours[0]])
    return more


def _refine_factors(record: CheckRecord, tried: Sequence[Explained], as_it_is: float) -> list[Explained]:
    """Factors at the maximum of the evidence, by a parabola through three factors; as_it_is: evidence without a fault."""
    fitted = [one for one in tried if one.fault is not None and one.fault.fitted and not one.fault.of_load]
    more: list[Explained] = []
    for best in sorted(fitted, key=lambda one: -one.evidence)[:REFINED]:
        for step in FACTOR_STEPS:
            assert best.fault is not None
            channel, amount = best.fault.channel, best.fault.amount
            sides = [
                explain_record(record, replace(best.fault, amount=amount * np.exp(way * step)), as_it_is)[0]
                for way in (-1, 1)
            ]
            low, high = (one.evidence - best.evidence for one in sides)
            bend = low + high
            if not np.isfinite(bend):
                break
            ahead = step * (low - high) / (2 * bend) if bend < 0 else step * float(np.sign(high - low))
            fault = as_factor(channel, amount * float(np.exp(np.clip(ahead, -3 * step, 3 * step))))
            if fault is None:
                break
            best = max([best, explain_record(record, fault, as_it_is)[0]], key=lambda one: one.evidence)
            more.append(best)
    return more


def _rank_faults(record: CheckRecord, others: PredictedChannel, j: int) -> list[tuple[float, Fault]]:
    """Faults of a channel with their log-density, by the prediction of the others."""
    y, noise = record.samples[:, j], float(record.noise[j])
    if not np.isfinite(others.predicted).all() or not np.isfinite(y).any():
        return []
    faults = [Fault("sign", 0), *(Fault("scale", 0, s) for s in SCALES), Fault("offset", 0), Fault("drift", 0)]
    factor = find_factor(y, others.predicted, others.std, noise)
    faults += [] if factor is None else [factor]
    late = find_delay(y, others.predicted, others.std, noise)
    faults += [] if late is None else [late]
    faults += [Fault("clipped", 0)] if at_limit(y).any() else []
    faults += find_temporary_faults(y, others.predicted, others.std, noise)
    if np.nanstd(y) <= max(FAINT * np.sqrt(np.mean(others.predicted**2)), QUIET * noise):
        faults.append(Fault("dead", 0))

    def density(fault: Fault, predicted: np.ndarray, begin: int) -> float:
        return others.evidence + approximate_density(fault, y, predicted, others.std, noise, begin)

    ranked = [(density(fault, others.predicted, record.begin), fault.of_channel(j)) for fault in faults]
    turns = [
        (density(Fault("angle", 0, angle), others.turned[:, k], 0), Fault("angle", j, angle))
        for k, angle in enumerate(ANGLES)
        # noise alone is a dead channel: some angle at which there is no strain would explain it as well
        if np.isfinite(others.turned[:, k]).all() and np.nanstd(y) > QUIET * noise
    ]
    return ranked + sorted(turns, key=lambda one: -one[0])[:TURNS]

"""Which fault of a channel or of a known load explains measurements that are inconsistent with the model: the evidence of every
fault, by the grid filter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from strainsight.estimation.fault_evidence import (
    CheckRecord,
    ShiftedMode,
    explained,
    missed_of,
    shifted_mode,
    suspected,
)
from strainsight.estimation.faults import (
    ANGLES,
    BELIEVABLE,
    MOST_LATE,
    SCALES,
    ChannelCheck,
    Explained,
    Fault,
    at_limit,
    channel_check,
    chosen,
    dead_density,
    delay,
    faults_for_a_time,
    roughly,
)
from strainsight.estimation.grid_filter import GridRun
from strainsight.estimation.load_faults import Innovations, ResidualPattern, innovations_of, tried_of_loads

TURNS = 3
"""Angles of a channel, the best by what the others foresee, that are ranked among its faults."""
CLOSELY, EACH = 6, 2
"""Faults that are looked at with all tolerances: the best of all, and of every channel that may be the wrong one."""
PAIRS = 5
"""Channels of which all pairs are tried as swapped."""
FAINT, QUIET = 0.2, 2.0
"""Share of what the others foresee of a channel, and multiple of its noise, up to which it may be dead."""
FEWEST = 3
"""Channels that speak of a fault of a load, from which no fault of a channel, or of two, explains the same."""


@dataclass(frozen=True)
class Diagnosis:
    """Whether a record contradicts its model, and why.

    as_it_is: the record without a fault; check: every channel against what all others foresee of it, or one step ahead by all
    channels where no fault was searched, or a load is to blame; without (m,): ratio of innovations to their claim of the record
    without that channel, none (0,) there; tried: every fault that was looked at closely; named: the one that explains the
    record, None where none or several do; candidates: all that do, best first; shifted: the mode that is too far from the
    model, where innovations are believable and no fault explains them; pattern: of a load that the model does not have, where
    neither does; searched: whether there was a reason to look for a fault.
    """

    inconsistent: bool
    as_it_is: Explained
    check: ChannelCheck
    without: np.ndarray = field(default_factory=lambda: np.zeros(0))
    tried: tuple[Explained, ...] = ()
    named: Explained | None = None
    candidates: tuple[Explained, ...] = ()
    shifted: ShiftedMode | None = None
    pattern: ResidualPattern | None = None
    searched: bool = True

    def best_of(self, channel: int) -> Explained | None:
        """What explains the record best among the faults of one channel, None where none makes it believable, or none is better
        than no fault."""
        tried = (one for one in self.tried if one.fault is not None and channel in one.fault.channels)
        believable = [one for one in tried if one.ratio <= BELIEVABLE]
        best = max(believable, key=lambda one: one.evidence, default=None)
        return best if best is not None and best.evidence > self.as_it_is.evidence else None


def examined(
    suspect: CheckRecord,
    discrepancy: float = 0.0,
    progress: Callable[[float], None] = lambda share: None,
    first: tuple[Explained, GridRun | None] | None = None,
) -> Diagnosis:
    """Whether a record contradicts its model, and which faults explain it, looked for where `suspected`; first: the record
    without a fault, where that is known already.

    It does where one fault or several explain it far better than none (`faults.chosen`), where its innovations are
    BELIEVABLE times as large as claimed and larger than `discrepancy`, the share of a reading that may be missed, and where
    the frequency of a mode has to be further from the model than STRETCHED of its tolerance (`shifted_mode`).
    """
    as_it_is, grid_run = first or explained(suspect, None)
    if grid_run is not None and not suspected(as_it_is, grid_run):
        return Diagnosis(False, as_it_is, _check_ahead(suspect, grid_run), searched=False)
    finding = diagnosed(suspect, progress, (as_it_is, grid_run))
    too_large = not as_it_is.ratio <= BELIEVABLE and missed_of(grid_run) > discrepancy
    more_channels = suspect.samples.shape[1] > len(suspect.model.unknowns.inputs)
    shifted = shifted_mode(suspect, grid_run) if more_channels and not (finding.inconsistent or too_large) else None
    return replace(finding, inconsistent=finding.inconsistent or too_large or shifted is not None, shifted=shifted)


def _check_ahead(suspect: CheckRecord, grid_run: GridRun) -> ChannelCheck:
    """Every channel against its prediction one step ahead, where it moves."""
    span = slice(*suspect.span or (None,))
    samples, whitened = suspect.samples[span], grid_run.run.whitened[suspect.sampled, 0][span]
    foreseen = samples - grid_run.run.innovation[suspect.sampled, 0][span]
    residual = np.sqrt(np.nansum(whitened**2, axis=0) / np.maximum(np.isfinite(whitened).sum(axis=0), 1))
    return replace(channel_check(samples, foreseen, np.ones_like(foreseen)), residual=residual)


def diagnosed(
    suspect: CheckRecord,
    progress: Callable[[float], None] = lambda share: None,
    first: tuple[Explained, GridRun | None] | None = None,
) -> Diagnosis:
    """Try every fault of a known load and of a channel on a record; first: what it is without a fault.

    Faults of loads are ranked by filters that take everything else for exact (`load_faults`), those of a channel without which
    the record is believable by what the other channels foresee of it (`roughly`); the best are weighed with all tolerances
    (`explained`), with swaps of those channels that are best left out. A fault of a load that FEWEST channels speak of is none
    of a channel. None is named or a candidate where there are no more channels than unknown loads.
    """
    m = suspect.samples.shape[1]
    as_it_is, grid_run = explained(suspect, None) if first is None else first
    tried: list[Explained] = []
    innovations: Innovations | None = None
    if m > len(suspect.model.unknowns.inputs):
        tried, innovations = _loads_tried(suspect)
    named, candidates = chosen(as_it_is.evidence, tried)
    if grid_run is not None and innovations is not None and _of_loads_alone(innovations, candidates):
        check = _check_ahead(suspect, grid_run)
        return Diagnosis(bool(candidates), as_it_is, check, tried=tuple(tried), named=named, candidates=candidates)
    left_out = _each_left_out(suspect, lambda share: progress(0.4 * share))
    check, without = _by_others(suspect, left_out)
    order = np.argsort(np.where(np.isfinite(without), without, np.inf), kind="stable")
    alone = np.flatnonzero(without <= BELIEVABLE)
    if m <= len(suspect.model.unknowns.inputs):
        # any reading is some load's: only what is stated of loads speaks against it
        return Diagnosis(False, as_it_is, check, without)
    if m == 1:
        # nothing else says whether it is the channel or the load
        wanted = [_of_channel(one.fault) for one in candidates if one.fault is not None and one.fault.kind != "swapped"]
    else:
        wanted = _worth_it(suspect, left_out, alone if len(alone) else order[:2])
    worst = sorted(int(j) for j in order[:PAIRS])
    quantity = suspect.model.quantity
    pairs = ((i, j) for i, j in combinations(worst, 2) if quantity is None or quantity[i] == quantity[j])
    wanted += [Fault("swapped", i, j) for i, j in pairs]
    for k, fault in enumerate(wanted):
        tried.append(explained(suspect, fault)[0])
        progress(0.4 + 0.6 * (k + 1) / len(wanted))
    tried += _later_of_all(suspect, wanted, tried)
    named, candidates = chosen(as_it_is.evidence, tried)
    return Diagnosis(bool(candidates), as_it_is, check, without, tuple(tried), named, candidates)


def _loads_tried(suspect: CheckRecord) -> tuple[list[Explained], Innovations | None]:
    """Faults of known loads that are worth a closer look, and what they were ranked by; none without known loads."""
    if not suspect.known.shape[-1]:
        return [], None
    innovations = innovations_of(suspect, suspect.load)
    wanted = tried_of_loads(innovations)
    tried = [explained(suspect, fault)[0] for fault in wanted]
    return tried + _later_of_all(suspect, wanted, tried), innovations


def _of_loads_alone(innovations: Innovations, candidates: Sequence[Explained]) -> bool:
    """Whether no fault of channels can explain what a fault of a load does."""
    faults = [one.fault for one in candidates if one.fault is not None]
    return bool(faults) and all(innovations.speaking(fault) >= FEWEST for fault in faults)


def _of_channel(fault: Fault) -> Fault:
    """The fault of the only channel that looks the same as one of a load."""
    amount = {"scale": 1 / fault.amount if fault.amount else 0.0, "late": -fault.amount}.get(fault.kind, 0.0)
    return Fault(fault.kind, 0, amount)


def checked_by_others(suspect: CheckRecord, progress: Callable[[float], None]) -> tuple[ChannelCheck, np.ndarray]:
    """Every channel against what all others foresee of it, and the ratio (m,) of innovations of the record without it."""
    return _by_others(suspect, _each_left_out(suspect, progress))


def _each_left_out(suspect: CheckRecord, progress: Callable[[float], None]) -> list[PredictedChannel]:
    left_out, m = [], suspect.samples.shape[1]
    for j in range(m):
        left_out.append(_left_out(suspect, j))
        progress((j + 1) / m)
    return left_out


def _by_others(suspect: CheckRecord, left_out: Sequence[PredictedChannel]) -> tuple[ChannelCheck, np.ndarray]:
    span = slice(*suspect.span or (None,))
    predicted = np.column_stack([one.predicted for one in left_out])[span]
    std = np.hypot(np.column_stack([one.std for one in left_out]), suspect.noise)[span]
    return channel_check(suspect.samples[span], predicted, std), np.array([one.ratio for one in left_out])


@dataclass(frozen=True)
class PredictedChannel:
    """A channel as all others foresee it: predicted, std (T,) [unit], turned (T, angles); ratio and evidence of the others'
    innovations."""

    predicted: np.ndarray
    std: np.ndarray
    turned: np.ndarray
    ratio: float
    evidence: float


def _left_out(suspect: CheckRecord, j: int) -> PredictedChannel:
    without, grid_run = explained(suspect, Fault("dead", j))
    if grid_run is None:
        none = np.full(len(suspect.samples), np.nan)
        return PredictedChannel(none, none, np.full((len(none), len(ANGLES)), np.nan), np.inf, -np.inf)
    n, sampled = suspect.model.parameter_states.start, suspect.sampled
    states = grid_run.run.mean[1:, 0][sampled, :n]
    predicted, std = grid_run.run.gauge_mean[sampled, 0, j], grid_run.run.gauge_std[sampled, 0, j]
    others = without.evidence - dead_density(suspect.samples[:, j], float(suspect.noise[j]))
    return PredictedChannel(predicted, std, states @ suspect.turned_rows[j, :, :n].T, without.ratio, others)


def _worth_it(suspect: CheckRecord, left_out: Sequence[PredictedChannel], channels: np.ndarray) -> list[Fault]:
    """Faults of some channels that are worth a closer look."""
    ranked: list[tuple[float, Fault]] = []
    for j in channels:
        ranked += _ranked(suspect, left_out[j], int(j))
    ranked.sort(key=lambda one: -one[0])
    wanted = [fault for _, fault in ranked[:CLOSELY]]
    for j in channels:
        wanted += [fault for _, fault in ranked if fault.channel == j][:EACH]
    return list(dict.fromkeys(wanted + [other for fault in wanted for other in fault.neighbours]))


def _later_of_all(suspect: CheckRecord, wanted: Sequence[Fault], tried: Sequence[Explained]) -> list[Explained]:
    """Delays beyond those that were tried of each channel or load, as long as the last one is the best."""
    more: list[Explained] = []
    for family in dict.fromkeys(fault.family for fault in wanted if fault.kind == "late"):
        known = {one.fault.amount: one for one in tried if one.fault and one.fault.family == family}
        first = next(fault for fault in wanted if fault.family == family)
        for _ in range(MOST_LATE):
            best = max(known, key=lambda n: known[n].evidence)
            neighbours = [n for n in (best - 1, best + 1) if n and n not in known and abs(n) <= 2 * MOST_LATE]
            if not neighbours or not np.isfinite(known[best].evidence):
                break
            known[neighbours[0]] = explained(suspect, replace(first, amount=neighbours[0]))[0]
            more.append(known[neighbours[0]])
    return more


def _ranked(suspect: CheckRecord, others: PredictedChannel, j: int) -> list[tuple[float, Fault]]:
    """Faults of a channel, with ln of their density, by what the others foresee of it."""
    y, noise = suspect.samples[:, j], float(suspect.noise[j])
    if not np.isfinite(others.predicted).all() or not np.isfinite(y).any():
        return []
    faults = [Fault("sign", 0), *(Fault("scale", 0, s) for s in SCALES), Fault("offset", 0), Fault("drift", 0)]
    late = delay(y, others.predicted, others.std, noise)
    faults += [] if late is None else [late]
    faults += [Fault("clipped", 0)] if at_limit(y).any() else []
    faults += faults_for_a_time(y, others.predicted, others.std, noise)
    if np.nanstd(y) <= max(FAINT * np.sqrt(np.mean(others.predicted**2)), QUIET * noise):
        faults.append(Fault("dead", 0))

    def density(fault: Fault, predicted: np.ndarray, begin: int) -> float:
        return others.evidence + roughly(fault, y, predicted, others.std, noise, begin)

    ranked = [(density(fault, others.predicted, suspect.begin), fault.of_channel(j)) for fault in faults]
    turns = [
        (density(Fault("angle", 0, angle), others.turned[:, k], 0), Fault("angle", j, angle))
        for k, angle in enumerate(ANGLES)
        # noise alone is a dead channel: some angle at which there is no strain would explain it as well
        if np.isfinite(others.turned[:, k]).all() and np.nanstd(y) > QUIET * noise
    ]
    return ranked + sorted(turns, key=lambda one: -one[0])[:TURNS]

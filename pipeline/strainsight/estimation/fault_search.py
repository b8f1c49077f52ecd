"""Which fault of a channel or of a known load explains measurements that are inconsistent with the model: the evidence of every
fault, by the bank."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.bank import BankRun, filter_bank
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.decision import judged
from strainsight.estimation.faults import (
    ANGLES,
    FORESEEN,
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
    of_any_size,
    roughly,
    undone,
)
from strainsight.estimation.load_faults import Innovations, KnownLoads, innovations_of, tried_of_loads
from strainsight.estimation.model import FilterModel
from strainsight.estimation.peak import known_at, peak_of
from strainsight.estimation.settled import Settled
from strainsight.estimation.unmodelled_load import ResidualPattern

BELIEVABLE = 1.5
"""Innovations, RMS over the claimed size, up to which a record does not contradict its model."""
MARGIN, APART = 20.0, 10.0
"""Of ln evidence, by which a fault has to beat the record as it is, odds of 5·10⁸, and the one that is named any other, of
2·10⁴: far beyond the number of faults that are tried."""
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
IMPOSSIBLE = -1e200
"""ln evidence below which a record is beyond what numbers can hold."""
STRETCHED = 4.5
"""Of its σ, up to which any tolerance is believed: one of fifty normal numbers is beyond in 3 of 10 000 records."""
BROAD = np.sqrt(3.0)
"""σ of an offset, or of a drift by the end of the record, before the samples, over the RMS of the channel."""


@dataclass(frozen=True)
class Suspect:
    """A record and the filter it is judged by.

    model, without drift of its parameters; mean (n*,), covariance (n*, n*) at t = 0; known (T, HOLD, n_known) [N]; samples
    (T/every, m), NaN where missing; nuisances; biased (b,): channels with an unknown offset; settled: as of `filter_bank`.
    turned_rows (m, angles, n*): what a channel would read turned by each of ANGLES, NaN where it cannot be; turned: channel and
    degrees → model and nuisances with it turned. load (n_known,): number of the load that each column of `known` belongs to,
    None: each is one. moving (n*, n*): the covariance where nothing is known of the motion, None: the same. begin: samples of
    the record before these; span: the first sample that moves, and the one behind the last.
    """

    model: FilterModel
    mean: np.ndarray
    covariance: np.ndarray
    known: np.ndarray
    samples: np.ndarray
    nuisances: Nuisances
    biased: np.ndarray
    settled: Settled | None
    turned_rows: np.ndarray
    turned: Callable[[int, float], tuple[FilterModel, Nuisances]]
    load: np.ndarray | None = None
    moving: np.ndarray | None = None
    begin: int = 0
    span: tuple[int, int] | None = None

    @property
    def loads(self) -> KnownLoads:
        load = np.arange(self.known.shape[-1]) if self.load is None else self.load
        return KnownLoads(self.known, load, self.settled, self.samples)

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


@dataclass(frozen=True)
class Finding:
    """Whether a record contradicts its model, and why.

    as_it_is: the record without a fault; check: every channel against what all others foresee of it, or one step ahead by all
    channels where no fault was searched, or a load is to blame; without (m,): ratio of innovations to their claim of the record
    without that channel, none (0,) there; tried: every fault that was looked at closely; named: the one that explains the
    record, None where none or several do; candidates: all that do, best first; shifted: the mode that is too far from the
    model, where innovations are believable and no fault explains them; pattern: of a load that the model does not have, where
    neither does; searched: whether there was a reason to look for a fault.
    """

    contradicts: bool
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
        own = [one for one in tried if one.ratio <= BELIEVABLE]
        best = max(own, key=lambda one: one.evidence, default=None)
        return best if best is not None and best.evidence > self.as_it_is.evidence else None


def explained(suspect: Suspect, fault: Fault | None) -> tuple[Explained, BankRun | None]:
    """Evidence of a record (T, m) under a fault, and what the bank found, None where it fails:

        ln p(y | fault) = ln p(T y) + ln |det T|,    y in units of the noise of a sample

    p(T y): parameters, motion, loads and all tolerances integrated out; innovations are those at the most likely parameters.
    Offset and drift are one more of its constants ν, whose σ is BROAD times the RMS of the channel, so that a fault with a free
    size pays for it. A dead channel has the density of a constant and white noise.
    """
    # likelihood and innovations are the same whether states follow what is learned of ν, which is the quicker
    model, nuisances, unit = suspect.model, replace(suspect.nuisances, learned=True), 0.0
    loads, samples, change = suspect.loads, suspect.samples, 0.0
    if fault is not None and fault.of_load:
        loads = loads.without(fault, model)
        samples = loads.samples
    elif fault is not None:
        samples, change = undone(fault, samples)
    if fault is not None and fault.kind == "angle":
        model, nuisances = suspect.turned(fault.channel, fault.amount)
        nuisances = replace(nuisances, learned=True)
    if fault is not None and fault.kind in ("offset", "drift"):
        unit = BROAD * float(np.sqrt(np.nanmean(samples[:, fault.channel] ** 2)))
        nuisances = _with_zero(nuisances, fault, unit, suspect)
    kept = np.isfinite(samples)
    missing = np.isfinite(suspect.samples).sum(axis=0) - kept.sum(axis=0)
    if fault is not None:
        change += of_any_size(fault, suspect.samples, suspect.noise)
    if fault is not None and fault.kind == "dead":
        change += dead_density(suspect.samples[:, fault.channel], suspect.noise[fault.channel])
        missing[fault.channel] = 0
    mean, covariance, known, settled = suspect.mean, suspect.covariance, loads.held, loads.settled
    try:
        # parameters explain frequencies that are off, and are no result here
        exact = nuisances.exactly_tuned if model.unknowns.parameters else nuisances
        peak = peak_of(model, mean, covariance, known, samples, exact, suspect.biased, settled)
        if peak.evidence < IMPOSSIBLE:
            return Explained(fault, -np.inf, np.inf), None
        if peak.about is not None:
            nuisances = replace(nuisances, about=peak.about)
        there, mean, covariance = known_at(model, peak.point, mean, covariance)
        bank = filter_bank(there, mean, covariance, known, samples, nuisances, biased=suspect.biased, settled=settled)
    except NumericalError:
        return Explained(fault, -np.inf, np.inf), None
    evidence = peak.evidence + change + float(kept.sum(axis=0) @ np.log(suspect.noise))
    evidence += FORESEEN * float(missing.sum())
    amount, std = 0.0 if fault is None else fault.amount, 0.0
    if unit:
        nu, left = bank.nuisances
        amount, std = unit * float(nu[-1]), unit * float(np.sqrt(left[-1, -1]))
    return Explained(fault, evidence, ratio_of(bank, _steps(suspect)), amount, std, tuple(peak.point)), bank


def _steps(suspect: Suspect) -> slice:
    """The steps in which the structure moves."""
    every = suspect.model.every
    return slice(None) if suspect.span is None else slice(suspect.span[0] * every, suspect.span[1] * every)


def ratio_of(bank: BankRun, part: slice = slice(None)) -> float:
    """Innovations over their claim, RMS, of all steps or of a part of them, the larger; NaN where nothing was measured."""
    squares = bank.run.whitened**2
    found = [np.sqrt(np.mean(own[np.isfinite(own)])) for own in (squares, squares[part]) if np.isfinite(own).any()]
    return float(max(found)) if found else np.nan


def missed_of(bank: BankRun | None) -> float:
    """The largest RMS innovation of a channel over its RMS reading, infinite where the bank failed."""
    if bank is None:
        return np.inf
    read = bank.run.innovation[:, 0]
    foreseen = bank.run.gauge_mean[:, 0]
    there = np.isfinite(read)
    of = np.where(there, read, 0.0), np.where(there, foreseen, 0.0)
    missed, whole = (np.sqrt(np.sum(own**2, axis=0)) for own in (of[0], np.hypot(*of)))
    return float(np.max(missed / np.maximum(whole, np.finfo(float).tiny), initial=0.0))


def surprise_of(bank: BankRun) -> float:
    """The largest of ν̂ over its σ before the samples, 0 where there is none: how far a tolerance is stretched."""
    return float(np.abs(bank.nuisances[0]).max(initial=0.0))


def too_large(fit: Explained, bank: BankRun | None) -> bool:
    """Whether the innovations of a record are larger than claimed, beyond the band of `decision.judged`."""
    if bank is None or not fit.ratio <= BELIEVABLE:
        return True
    return judged(fit.ratio, int(np.isfinite(bank.run.whitened).sum())).overconfident


def suspected(as_it_is: Explained, bank: BankRun | None) -> bool:
    """Whether the faults of a record are to be looked for: its innovations are too large, or a tolerance is stretched beyond
    STRETCHED of its σ to explain it."""
    return bank is None or too_large(as_it_is, bank) or surprise_of(bank) > STRETCHED


def shifted_mode(suspect: Suspect, bank: BankRun | None) -> ShiftedMode | None:
    """The mode whose frequency is farthest from the model over its tolerance; None where that is within STRETCHED."""
    rows, modes = suspect.nuisances.frequency, suspect.model.model.size
    if bank is None or not len(rows):
        return None
    behind = suspect.nuisances.of_modes(modes)
    change = bank.nuisances[0][behind - len(rows) : behind] @ rows
    size = np.abs(change) / np.sqrt(np.sum(rows**2, axis=0))
    j = int(np.argmax(size))
    return ShiftedMode(j, float(np.exp(change[j])), float(size[j])) if size[j] > STRETCHED else None


def examined(
    suspect: Suspect,
    discrepancy: float = 0.0,
    progress: Callable[[float], None] = lambda share: None,
    first: tuple[Explained, BankRun | None] | None = None,
) -> Finding:
    """Whether a record contradicts its model, and which faults explain it, looked for where `suspected`; first: the record
    without a fault, where that is known already.

    It does where one fault or several explain it far better than none (`faults.chosen`), where its innovations are
    BELIEVABLE times as large as claimed and larger than `discrepancy`, the share of a reading that may be missed, and where
    the frequency of a mode has to be further from the model than STRETCHED of its tolerance (`shifted_mode`).
    """
    as_it_is, bank = first or explained(suspect, None)
    if bank is not None and not suspected(as_it_is, bank):
        return Finding(False, as_it_is, _check_ahead(suspect, bank), searched=False)
    found = diagnosed(suspect, progress, (as_it_is, bank))
    beyond = not as_it_is.ratio <= BELIEVABLE and missed_of(bank) > discrepancy
    more_channels = suspect.samples.shape[1] > len(suspect.model.unknowns.inputs)
    shifted = shifted_mode(suspect, bank) if more_channels and not (found.contradicts or beyond) else None
    return replace(found, contradicts=found.contradicts or beyond or shifted is not None, shifted=shifted)


def _check_ahead(suspect: Suspect, bank: BankRun) -> ChannelCheck:
    """Every channel against its prediction one step ahead, where it moves."""
    every, span = suspect.model.every, slice(*suspect.span or (None,))
    sampled = slice(every - 1, None, every)
    samples, whitened = suspect.samples[span], bank.run.whitened[sampled, 0][span]
    foreseen = samples - bank.run.innovation[sampled, 0][span]
    residual = np.sqrt(np.nansum(whitened**2, axis=0) / np.maximum(np.isfinite(whitened).sum(axis=0), 1))
    return replace(channel_check(samples, foreseen, np.ones_like(foreseen)), residual=residual)


def diagnosed(
    suspect: Suspect,
    progress: Callable[[float], None] = lambda share: None,
    first: tuple[Explained, BankRun | None] | None = None,
) -> Finding:
    """Try every fault of a known load and of a channel on a record; first: what it is without a fault.

    Faults of loads are ranked by filters that take everything else for exact (`load_faults`), and the best are weighed with all
    tolerances (`explained`). One that makes the record believable, and that FEWEST channels speak of, explains it: no fault of
    a channel does what it does to all of them.
    A channel is wrong alone only if the record without it is believable: its faults are ranked by what the other channels
    foresee of it (`roughly`), and the best are weighed likewise, with swaps of those channels that are
    best left out. None is named or a candidate where there are no more channels than unknown loads.
    """
    m = suspect.samples.shape[1]
    as_it_is, bank = explained(suspect, None) if first is None else first
    tried: list[Explained] = []
    innovations: Innovations | None = None
    if m > len(suspect.model.unknowns.inputs):
        tried, innovations = _loads_tried(suspect)
    named, candidates = chosen(as_it_is.evidence, tried, BELIEVABLE, MARGIN, APART)
    if bank is not None and innovations is not None and _of_loads_alone(innovations, candidates):
        check = _check_ahead(suspect, bank)
        return Finding(bool(candidates), as_it_is, check, tried=tuple(tried), named=named, candidates=candidates)
    left_out = _each_left_out(suspect, lambda share: progress(0.4 * share))
    check, without = _by_others(suspect, left_out)
    order = np.argsort(np.where(np.isfinite(without), without, np.inf), kind="stable")
    alone = np.flatnonzero(without <= BELIEVABLE)
    if m <= len(suspect.model.unknowns.inputs):
        # any reading is some load's: only what is stated of loads speaks against it
        return Finding(False, as_it_is, check, without)
    if m == 1:
        # nothing else says whether it is the channel or the load
        wanted = [_of_channel(one.fault) for one in candidates if one.fault is not None and one.fault.kind != "swapped"]
    else:
        wanted = _worth_it(suspect, left_out, alone if len(alone) else order[:2])
    worst = sorted(int(j) for j in order[:PAIRS])
    wanted += [Fault("swapped", i, j) for a, i in enumerate(worst) for j in worst[a + 1 :] if _alike(suspect, i, j)]
    for k, fault in enumerate(wanted):
        tried.append(explained(suspect, fault)[0])
        progress(0.4 + 0.6 * (k + 1) / len(wanted))
    tried += _later_of_all(suspect, wanted, tried)
    named, candidates = chosen(as_it_is.evidence, tried, BELIEVABLE, MARGIN, APART)
    return Finding(bool(candidates), as_it_is, check, without, tuple(tried), named, candidates)


def _loads_tried(suspect: Suspect) -> tuple[list[Explained], Innovations | None]:
    """Faults of known loads that are worth a closer look, and what they were ranked by; none without known loads."""
    if not suspect.known.shape[-1]:
        return [], None
    innovations = innovations_of(suspect.model, suspect.mean, suspect.covariance, suspect.loads, suspect.biased)
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


def checked_by_others(suspect: Suspect, progress: Callable[[float], None]) -> tuple[ChannelCheck, np.ndarray]:
    """Every channel against what all others foresee of it, and the ratio (m,) of innovations of the record without it."""
    return _by_others(suspect, _each_left_out(suspect, progress))


def _each_left_out(suspect: Suspect, progress: Callable[[float], None]) -> list[LeftOut]:
    left_out = []
    for j in range(suspect.samples.shape[1]):
        left_out.append(_left_out(suspect, j))
        progress((j + 1) / suspect.samples.shape[1])
    return left_out


def _by_others(suspect: Suspect, left_out: Sequence[LeftOut]) -> tuple[ChannelCheck, np.ndarray]:
    span = slice(*suspect.span or (None,))
    check = channel_check(
        suspect.samples[span],
        np.column_stack([own.predicted for own in left_out])[span],
        np.column_stack([np.hypot(own.std, suspect.noise[j]) for j, own in enumerate(left_out)])[span],
    )
    return check, np.array([own.ratio for own in left_out])


@dataclass(frozen=True)
class LeftOut:
    """A channel as all others foresee it: predicted, std (T,) [unit], turned (T, angles); ratio and evidence of the others'
    innovations."""

    predicted: np.ndarray
    std: np.ndarray
    turned: np.ndarray
    ratio: float
    evidence: float


def _left_out(suspect: Suspect, j: int) -> LeftOut:
    own, bank = explained(suspect, Fault("dead", j))
    if bank is None:
        none = np.full(len(suspect.samples), np.nan)
        return LeftOut(none, none, np.full((len(none), len(ANGLES)), np.nan), np.inf, -np.inf)
    every, n = suspect.model.every, suspect.model.parameter_states.start
    sampled = slice(every - 1, None, every)
    states = bank.run.mean[1:, 0][sampled, :n]
    predicted, std = bank.run.gauge_mean[sampled, 0, j], bank.run.gauge_std[sampled, 0, j]
    others = own.evidence - dead_density(suspect.samples[:, j], float(suspect.noise[j]))
    return LeftOut(predicted, std, states @ suspect.turned_rows[j, :, :n].T, own.ratio, others)


def _worth_it(suspect: Suspect, left_out: Sequence[LeftOut], channels: np.ndarray) -> list[Fault]:
    """Faults of some channels that are worth a closer look."""
    ranked: list[tuple[float, Fault]] = []
    for j in channels:
        ranked += _ranked(suspect, left_out[j], int(j))
    ranked.sort(key=lambda own: -own[0])
    wanted = [fault for _, fault in ranked[:CLOSELY]]
    for j in channels:
        wanted += [fault for _, fault in ranked if fault.channel == j][:EACH]
    for fault in list(wanted):
        if fault.kind == "late":
            wanted += [replace(fault, amount=fault.amount + k) for k in (-1, 1) if fault.amount + k]
    return list(dict.fromkeys(wanted))


def _later_of_all(suspect: Suspect, wanted: Sequence[Fault], tried: Sequence[Explained]) -> list[Explained]:
    """Delays beyond those that were tried of each channel or load, as long as the last one is the best."""
    more = []
    for family in dict.fromkeys(fault.family for fault in wanted if fault.kind == "late"):
        more += _later(suspect, [own for own in tried if own.fault and own.fault.family == family])
    return more


def _later(suspect: Suspect, tried: Sequence[Explained]) -> list[Explained]:
    """Delays of one channel or load beyond those that were tried, as long as the last one is the best."""
    known = {own.fault.amount: own for own in tried if own.fault is not None}
    first = next(own.fault for own in tried if own.fault is not None)
    more: list[Explained] = []
    while len(more) < MOST_LATE:
        best = max(known, key=lambda n: known[n].evidence)
        beside = [n for n in (best - 1, best + 1) if n and n not in known and abs(n) <= 2 * MOST_LATE]
        if not beside or not np.isfinite(known[best].evidence):
            break
        known[beside[0]] = explained(suspect, replace(first, amount=beside[0]))[0]
        more.append(known[beside[0]])
    return more


def _ranked(suspect: Suspect, own: LeftOut, j: int) -> list[tuple[float, Fault]]:
    y, noise = suspect.samples[:, j], float(suspect.noise[j])
    if not np.isfinite(own.predicted).all() or not np.isfinite(y).any():
        return []
    faults = [Fault("sign", j), *(Fault("scale", j, s) for s in SCALES), Fault("offset", j), Fault("drift", j)]
    late = delay(y, own.predicted, own.std, noise)
    faults += [] if late is None else [replace(late, channel=j)]
    faults += [Fault("clipped", j)] if at_limit(y).any() else []
    faults += [
        replace(fault, channel=j, spans=tuple((j, *span[1:]) for span in fault.spans))
        for fault in faults_for_a_time(y, own.predicted, own.std, noise)
    ]
    if np.nanstd(y) <= max(FAINT * np.sqrt(np.mean(own.predicted**2)), QUIET * noise):
        faults.append(Fault("dead", j))
    found = []
    for fault in faults:
        alone = replace(fault, channel=0, spans=tuple((0, *span[1:]) for span in fault.spans))
        found.append((own.evidence + roughly(alone, y, own.predicted, own.std, noise, suspect.begin), fault))
    turns = [
        (
            own.evidence + roughly(Fault("angle", 0, angle), y, own.turned[:, k], own.std, noise),
            Fault("angle", j, angle),
        )
        for k, angle in enumerate(ANGLES)
        # noise alone is a dead channel: some angle at which there is no strain would explain it as well
        if np.isfinite(own.turned[:, k]).all() and np.nanstd(y) > QUIET * noise
    ]
    return found + sorted(turns, key=lambda one: -one[0])[:TURNS]


def _alike(suspect: Suspect, i: int, j: int) -> bool:
    """Whether two channels measure one quantity."""
    quantity = suspect.model.quantity
    return quantity is None or bool(quantity[i] == quantity[j])


def _with_zero(nuisances: Nuisances, fault: Fault, unit: float, suspect: Suspect) -> Nuisances:
    """One constant more: the offset of a channel, or its drift since the beginning of the record by the end of these samples."""
    (_, m, n), width = nuisances.D.shape, nuisances.E.shape[-1]
    row, drifts = np.zeros((1, m)), fault.kind == "drift"
    E = np.pad(nuisances.E, [(0, 1), (0, 0), (0, int(drifts and width == suspect.known.shape[-1]))])
    before = suspect.begin / (suspect.begin + len(suspect.samples)) if drifts else 1.0
    row[0, fault.channel] = unit * before
    if drifts:
        E[-1, fault.channel, -1] = unit * (1 - before)
    return replace(
        nuisances,
        source=(*nuisances.source, fault.kind),
        D=np.concatenate([nuisances.D, np.zeros((1, m, n))]),
        E=E,
        offset=np.concatenate([nuisances.offset, row]),
        B=None if nuisances.B is None else np.pad(nuisances.B, [(0, 1), (0, 0), (0, 0)]),
    )

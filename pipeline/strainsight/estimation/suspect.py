"""A record and the filter it is judged by: the evidence of its samples under one fault or none, and whether it is believable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError
from strainsight.estimation.bank import BankRun, filter_bank
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.decision import judged
from strainsight.estimation.faults import BELIEVABLE, FORESEEN, Explained, Fault, dead_density, of_any_size, undone
from strainsight.estimation.load_faults import KnownLoads
from strainsight.estimation.model import FilterModel
from strainsight.estimation.peak import known_at, peak_of
from strainsight.estimation.reduced import Settled

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


def too_large(fit: Explained, bank: BankRun | None) -> bool:
    """Whether the innovations of a record are larger than claimed, beyond the band of `decision.judged`."""
    if bank is None or not fit.ratio <= BELIEVABLE:
        return True
    return judged(fit.ratio, int(np.isfinite(bank.run.whitened).sum())).overconfident


def suspected(as_it_is: Explained, bank: BankRun | None) -> bool:
    """Whether the faults of a record are to be looked for: its innovations are too large, or a tolerance is stretched beyond
    STRETCHED of its σ before the samples to explain it."""
    return bank is None or too_large(as_it_is, bank) or bool(np.any(np.abs(bank.nuisances[0]) > STRETCHED))


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

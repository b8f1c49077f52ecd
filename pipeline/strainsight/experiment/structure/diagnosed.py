"""Whether measurements are consistent with the model; which fault of a channel or a known load explains those that are not, and
the key that undoes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.estimate import Channel, DelayInSeconds
from strainsight.estimation.decision import INCONSISTENT
from strainsight.estimation.faults import MARGIN, Explained, Fault, at_limit
from strainsight.estimation.load_faults import ResidualPattern
from strainsight.estimation.peak import peak_of_records
from strainsight.estimation.record import BankRecord
from strainsight.estimation.record_check import RecordCheck, check_record
from strainsight.estimation.suspect import ShiftedMode, Suspect
from strainsight.experiment.recorded import delay_in_seconds
from strainsight.experiment.structure.filtered_test import Filtering
from strainsight.experiment.structure.measured import Measured, RecordSettings
from strainsight.experiment.structure.problem import Problem
from strainsight.measurements.records import required_unit
from strainsight.records.estimated import ChannelsChecked
from strainsight.rom.model import modal_basis
from strainsight.sensors.candidates import STRAIN, UNITS

MOST_TIMES = 20
"""Spans of a fault that are named one by one."""
LEAST_SHARE = 0.1
"""Of a channel in the pattern of an additional load, to be named."""
OTHER_STEP = 100.0
"""Factor between the sampling interval of a record and `train.time_step`, from which the unit of its time is asked about."""


@dataclass(frozen=True)
class Judgement:
    """words: why the record is inconsistent with the model, else empty; named: the fault that explains it, with the key that
    undoes it, empty where none or several do; check: by channel; apart: it is not the model but other records that it
    contradicts; birge_ratio: RMS of the innovations over their claim, 1 of a consistent record, and where no filter runs."""

    words: str
    named: str
    check: ChannelsChecked
    apart: bool = False
    birge_ratio: float = 1.0

    @property
    def trusted(self) -> bool:
        return not self.words


def judgement_of(
    own: RecordSettings,
    test: Measured,
    problem: Problem,
    suspect: Suspect,
    discrepancy: float,
    progress: Callable[[float], None],
) -> Judgement:
    """Of a record and the bank that judges it, as `check_record` does; discrepancy: share of a reading that may be missed."""
    found = check_record(suspect, discrepancy, progress)
    finding, words = found.finding, FaultInWords(own, test, found.stretch, problem.known)
    named = "" if finding.named is None else f"{words.fault(finding.named)}: {words.remedy(finding.named)}"
    # which of several it is has to be checked on the structure: the key of another one would hide it
    candidates = (named,) if named else tuple(words.fault(one) for one in finding.candidates)
    # what explains a consistent record a little better than no fault is chance, and no explanation
    best = [finding.best_of(j) if finding.contradicts else None for j in range(len(test.labels))]
    gain = [0.0 if one is None else one.evidence - finding.as_it_is.evidence for one in best]
    check = ChannelsChecked(
        by_others=bool(len(finding.without)),
        begin=_time_of(test, found.part[0]),
        end=_time_of(test, found.part[1] - 1),
        measured=finding.check.measured,
        predicted=finding.check.predicted,
        residual=finding.check.residual,
        correlation=finding.check.correlation,
        fault=tuple("" if one is None else words.fault(one) for one in best),
        gain=np.minimum(gain, np.finfo(float).max),
        candidate=candidates,
    )
    if not finding.contradicts:
        return Judgement("", "", check)
    ratio, alone = finding.as_it_is.ratio, "no single fault of a channel or a known load explains it"
    if named:
        text = f": {named}"
    elif candidates:
        text = (
            f", and which of these explains it stays open: {'; '.join(candidates[:4])}{' …' * (len(candidates) > 4)}; check on "
            f"the structure which of them it is ({own.channels})"
        )
    elif finding.shifted is not None:
        text = f", and {alone}: {_shift_in_words(problem, finding.shifted)}"
    elif finding.pattern is not None:
        text = f", and {alone}: {_pattern_in_words(finding.pattern, test.labels)}"
    else:
        size = f"{ratio:.3g} times as large as claimed" if np.isfinite(ratio) else "beyond all bounds"
        text = (
            f": innovations are {size}{_worst_in_words(found, test)}, and {alone}: check {own.channels}, loads, estimate.start "
            f"and the model{_step_in_words(problem, test)}"
        )
    return Judgement(INCONSISTENT + text, named, check, birge_ratio=max(1.0, ratio) if np.isfinite(ratio) else 1.0)


def _worst_in_words(found: RecordCheck, test: Measured) -> str:
    sample, channel, size = found.worst
    if not size > 0:
        return ""
    return f", the largest {size:.3g} σ at {_time_of(test, sample):.6g} s ({test.labels[channel]})"


def _time_of(test: Measured, sample: int) -> float:
    """Of a sample behind the first [s]."""
    return float(test.time[1 + sample])


def clock_in_words(test: Measured, step: float) -> str:
    """That the clock of a record is another one than that of the config, step [s]; empty where they are alike."""
    dt = test.h * test.every
    if max(dt / step, step / dt) < OTHER_STEP:
        return ""
    return f"the record has a sample every {dt:.3g} s, train.time_step is {step:.3g} s: check estimate.time.unit"


@dataclass(frozen=True)
class FaultInWords:
    """Faults of a record, and what undoes them, with keys of the config; stretch: the samples that they were found in."""

    own: RecordSettings
    test: Measured
    stretch: Suspect
    known: Sequence[str] = ()

    def fault(self, found: Explained) -> str:
        """What is wrong."""
        fault = found.fault
        assert fault is not None
        names = self.known if fault.of_load else self.test.labels
        name = names[fault.channel]
        if fault.kind == "sign":
            return f"{name} fits with sign −1"
        if fault.kind == "scale":
            return f"{name} reads {fault.amount:g} times what fits"
        if fault.kind == "swapped":
            return f"{name} and {names[int(fault.amount)]} fit swapped"
        if fault.kind == "offset":
            return f"{name} fits with an offset of {self._size(fault, found.amount, found.std)}"
        if fault.kind == "drift":
            return f"{name} fits with a drift of {self._size(fault, found.amount, found.std)} in {self._drifted:.3g} s"
        if fault.kind == "late":
            n = int(fault.amount)
            samples = f"{abs(n)} sample{'s' * (abs(n) > 1)}"
            return f"{name} is {samples} ({abs(n) * self._step:.3g} s) {'late' if n > 0 else 'early'}"
        if fault.kind == "angle":
            return f"{name} fits turned by {abs(fault.amount):g}°"
        if fault.kind == "dead":
            return f"{name} reads noise alone, it is dead"
        if fault.kind == "clipped":
            return (
                f"{name} is clipped, in {int(at_limit(self.stretch.samples[:, fault.channel]).sum())} samples at least"
            )
        if fault.kind == "spikes":
            return f"samples fit no motion: {'; '.join(self._spikes(fault, channel) for channel in fault.channels)}"
        return self._for_a_time(fault)

    def remedy(self, found: Explained) -> str:
        """What to check, and the key that undoes it."""
        fault = found.fault
        assert fault is not None
        section, stated = self.own.section, self.own.inputs if fault.of_load else self.own.channels
        words = self._remedy(fault, found)
        if section == "estimate" or stated.startswith(section):
            return words
        return (
            f"{words} (state {section}.{stated.split('.')[-1]}, a copy of {stated}, for what this record alone needs)"
        )

    def _remedy(self, fault: Fault, found: Explained) -> str:
        entry, key = self._entry(fault, fault.channel)
        raw = 1 / (entry.sign * entry.scale * required_unit(entry.unit).factor)
        if fault.kind == "sign":
            what = f"its direction (loads.{self.known[fault.channel]})" if fault.of_load else "the wiring"
            return f"check {what}, or set {key}.sign: {-entry.sign}"
        if fault.kind == "scale":
            gauge = 0.1 < fault.amount < 10 and not fault.of_load
            check = "bridge and gauge factor" if gauge else f"{key}.unit (now {entry.unit})"
            return f"check {check}, or set {key}.scale: {entry.scale / fault.amount:.9g}"
        if fault.kind == "swapped":
            return f"exchange {key}.channel and {self._entry(fault, int(fault.amount))[1]}.channel"
        if fault.kind == "offset":
            value = "" if entry.bridge is not None else f": {entry.offset + found.amount * raw:.6g}"
            return f"set {key}.offset{value}, or {key}.zero or {key}.bias"
        if fault.kind == "drift":
            value = "" if entry.bridge is not None else f": {entry.drift + found.amount * raw / self._drifted:.6g}"
            return f"set {key}.drift{value}"
        if fault.kind == "late":
            n = int(fault.amount)
            moving = " and estimate.start: moving" * (fault.of_load and n < 0 and self.own.settings.start == "rest")
            return f"set {key}.delay: {_delay_in_words(entry, n, abs(n) * self._step)}{moving}"
        if fault.kind == "angle":
            return f"check its direction, and {key}.gauge and {key}.grid"
        if fault.kind == "dead":
            return f"leave {key} out"
        if fault.kind == "clipped":
            return f"set {key}.missing to where it is, or leave {key} out"
        return "set " + " and ".join(self._missing(fault, channel) for channel in fault.channels)

    def _entry(self, fault: Fault, number: int) -> tuple[Channel, str]:
        """What the config states of a channel or a known load, and its key."""
        if fault.of_load:
            name = self.known[number]
            return self.own.settings.inputs[name], f"{self.own.section}.inputs.{name}"
        return self.own.settings.channels[number], f"{self.own.section}.channels.{number}"

    @property
    def _step(self) -> float:
        """Between samples [s]."""
        return self.stretch.model.h * self.stretch.model.every

    @property
    def _drifted(self) -> float:
        """From the beginning of the record to the end of the stretch [s]."""
        return (self.stretch.begin + len(self.stretch.samples)) * self._step

    def _size(self, fault: Fault, amount: float, std: float | None = None) -> str:
        quantity = self.stretch.model.quantity
        kind = STRAIN if quantity is None else int(quantity[fault.channel])
        factor, unit = (1e6, "µm/m") if kind == STRAIN else (1.0, UNITS[kind])
        return f"{factor * amount:.3g} {'' if std is None else f'± {factor * std:.2g} '}{unit}"

    def _for_a_time(self, fault: Fault) -> str:
        """From when on a channel is wrong, and how."""
        ((channel, first, behind),), name = fault.spans, self.test.labels[fault.channel]
        ends = self.stretch.begin + behind >= len(self.test.time) - 1
        since = f"from {self._time(first)} s on" if ends else f"from {self._time(first)} to {self._time(behind - 1)} s"
        if fault.kind == "shift":
            return f"{name} {since}: its zero shifts by {self._size(fault, fault.amount)}"
        return f"{name} is stuck at {self._size(fault, float(self.stretch.samples[first, channel]))} {since}"

    def _spikes(self, fault: Fault, channel: int) -> str:
        spans = [span[1:] for span in fault.spans if span[0] == channel]
        times = [self._time(a) if b - a == 1 else f"{self._time(a)} to {self._time(b - 1)}" for a, b in spans]
        if (more := len(times) - MOST_TIMES) > 0:
            return f"{self.test.labels[channel]} at {', '.join(times[:MOST_TIMES])} s and at {more} other times"
        last = times.pop()
        return f"{self.test.labels[channel]} at {', '.join(times) + ' and ' if times else ''}{last} s"

    def _time(self, sample: int) -> str:
        """Of a sample of the stretch, to the digits of the step between samples."""
        return f"{_time_of(self.test, self.stretch.begin + sample):.{max(0, int(np.ceil(-np.log10(self._step))))}f}"

    def _missing(self, fault: Fault, channel: int) -> str:
        """The key that leaves out what is wrong for a time, half a sample beyond its ends, on the clock of the file."""
        entry, key = self._entry(fault, channel)
        late = delay_in_seconds(entry.delay, self._step)
        spans = [list(span) for span in entry.missing]
        for at, first, behind in fault.spans:
            if at == channel:
                ends = self.stretch.begin + first, self.stretch.begin + behind - 1
                times = (_time_of(self.test, k) + late for k in ends)
                spans.append(
                    [float(f"{t + 0.5 * way * self._step:.9g}") for t, way in zip(times, (-1, 1), strict=True)]
                )
        return f"{key}.missing: {spans}"


def _delay_in_words(entry: Channel, n: int, seconds: float) -> str:
    """A delay by n samples more than the config has, in the unit that it has."""
    if isinstance(entry.delay, DelayInSeconds):
        return f"{{seconds: {entry.delay.seconds + np.sign(n) * seconds:.9g}}}"
    return f"{{samples: {n + (0 if entry.delay is None else entry.delay.samples)}}}"


def _shift_in_words(problem: Problem, shifted: ShiftedMode) -> str:
    """How far the frequency of a mode is from the model, and what to check."""
    lam, _ = modal_basis(problem.model, problem.model.reference)
    modelled = float(np.sqrt(lam[shifted.mode])) / (2 * np.pi)
    return (
        f"mode {shifted.mode + 1} fits best at {shifted.factor * modelled:.4g} Hz, the model has {modelled:.4g} Hz, "
        f"{shifted.size:.2g} σ of tolerances.frequency apart; check masses, supports and joints, or measure that frequency and "
        "correct the model"
    )


def _pattern_in_words(pattern: ResidualPattern, labels: Sequence[str]) -> str:
    """An additional load: the channels that show it, how much, and what to check."""
    order = np.argsort(-pattern.share, kind="stable")
    most = [f"{labels[j]} ({pattern.share[j]:.0%})" for j in order if pattern.share[j] >= LEAST_SHARE]
    return (
        f"an additional load, or another disturbance of {', '.join(most)}: mostly along one pattern of channels, "
        f"innovations are {pattern.size:.3g} times as large as claimed and slow (correlation {pattern.correlation:.2f}); "
        "add the missing load (loads), or check temperature, cables and supports"
    )


def _step_in_words(problem: Problem, test: Measured) -> str:
    lam, _ = modal_basis(problem.model, problem.model.reference)
    period, dt = 2 * np.pi / float(np.sqrt(lam[0])), test.h * test.every
    if dt < 0.5 * period:
        return ""
    return f" (its step is {dt:.3g} s, the first mode has a period of {period:.3g} s: check estimate.time.unit)"


@dataclass(frozen=True)
class Together:
    """alone: parameter → its most likely value [SI] by each record alone (R,); shared: by all records; gain: ln of how much more
    likely all records are with one set of parameters and bonded gauges than each with its own; words: that they contradict each
    other, empty where they do not."""

    alone: dict[str, np.ndarray]
    shared: dict[str, float]
    gain: float
    words: str


def together_of(each: Sequence[Filtering], suspects: Sequence[Suspect], names: Sequence[str]) -> Together:
    """Records and the banks that judge them one by one.

        ln p(y₁ … y_R) − Σᵣ ln p(yᵣ)

    Of records of one test it is large, as parameters and constants that fit one fit all; records of other parameters, or of
    gauges that were bonded anew in between, have one below −MARGIN. Both as of `peak_of`, which gives up on what no parameters
    explain before a bank would.
    """
    records: list[BankRecord] = []
    alone: list[BankRecord] = []
    for given, own in zip(each, suspects, strict=True):
        for nuisances, found in ((own.nuisances, alone), (given.nuisances, records)):
            learned = replace(nuisances, learned=True)
            start = suspects[0].mean, suspects[0].covariance
            found.append(
                BankRecord(own.model, *start, own.known, own.samples, learned, suspects[0].biased, own.settled)
            )
    peaks = [peak_of_records([own]) for own in alone]
    of_all = peak_of_records([records[i] for i in np.argsort([given.record for given in each])])
    unknowns = each[0].problem.unknowns
    values = {
        name: unknowns.guess[name] * np.exp([peak.point[i] for peak in peaks])
        for i, name in enumerate(unknowns.parameters)
    }
    gain = of_all.evidence - sum(peak.evidence for peak in peaks)
    words = ""
    if gain < -MARGIN:
        said = [
            f"{name} {', '.join(f'{value:.4g} ({of})' for value, of in zip(own, names, strict=True))}"
            for name, own in values.items()
        ]
        words = f"the records contradict each other: each alone says {'; '.join(said) or 'other errors of the gauges'}"
    shared = {name: float(unknowns.guess[name] * np.exp(of_all.point[i])) for i, name in enumerate(unknowns.parameters)}
    return Together(values, shared, float(gain), words)

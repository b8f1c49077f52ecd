"""Whether measurements are consistent with the model; which fault of a channel or a known load explains those that are not, and
the key that undoes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.recorded_channels import ACCEPT
from strainsight.cases.structure.measured import Measured
from strainsight.cases.structure.problem import Problem
from strainsight.cases.structure.records_of_test import RecordSettings
from strainsight.config.estimate import Channel, DelayInSeconds, GaugeChannel
from strainsight.estimation.fault_search import Suspect, examined
from strainsight.estimation.faults import ChannelCheck, Explained, Fault, at_limit
from strainsight.gauges.candidates import STRAIN, UNITS
from strainsight.records.estimated import ChannelsChecked
from strainsight.rom.model import modal_basis

LONGEST = 4000
"""Samples of a record, from its beginning, by which channels are checked."""
OTHER_STEP = 100.0
"""Factor between the sampling interval of a record and `train.time_step`, from which the unit of its time is asked about."""


@dataclass(frozen=True)
class Judgement:
    """trusted: whether the record agrees with the model; named: the fault that explains it, in words with the key that undoes
    it, empty where none or several do; words: all that there is to say, empty of a record that agrees; check: by channel; apart:
    it is not the model but other records that it contradicts."""

    trusted: bool
    named: str
    words: str
    check: ChannelsChecked
    apart: bool = False


def judgement_of(
    own: RecordSettings,
    test: Measured,
    problem: Problem,
    suspect: Suspect,
    discrepancy: float,
    progress: Callable[[float], None],
) -> Judgement:
    """Of a record and the bank that judges it, as `examined` does; discrepancy: share of a reading that may be missed."""
    found = examined(_beginning(suspect), discrepancy, progress)
    diagnosis, as_it_is = found.diagnosis, found.as_it_is
    label, entries, section = test.labels, own.settings.channels, own.section
    if diagnosis is None:
        return Judgement(True, "", "", _checked(found.check, False))
    if not found.contradicts:
        # what explains it a little better than no fault is chance, and no explanation
        return Judgement(True, "", "", _checked(found.check, bool(len(diagnosis.without))))

    def in_words(one: Explained) -> str:
        if one.fault is not None and one.fault.of_load:
            return load_fault_in_words(one.fault, problem.known, own, test.h * test.every)
        copied = "" if section == "estimate" or own.channels.startswith(section) else _copied(section, own.channels)
        return f"{fault_in_words(one, label, entries, suspect, section)}{copied}"

    named = "" if diagnosis.named is None else in_words(diagnosis.named)
    candidates = tuple(in_words(one) for one in diagnosis.candidates)
    best = [diagnosis.best_of(j) for j in range(len(label))]
    checked = _checked(
        found.check,
        bool(len(diagnosis.without)),
        tuple("" if one is None else fault_in_words(one, label, entries, suspect, section) for one in best),
        np.array([0.0 if one is None else _finite(one.evidence - as_it_is.evidence) for one in best]),
        candidates,
    )
    if named:
        words = f"the record contradicts the model: {named}, {ACCEPT}"
    elif candidates:
        words = (
            "the record contradicts the model, and which of these explains it stays open: "
            f"{'; '.join(candidates[:4])}{' …' * (len(candidates) > 4)}; {ACCEPT}"
        )
    else:
        size = f"{as_it_is.ratio:.3g} times as large as claimed" if np.isfinite(as_it_is.ratio) else "beyond all bounds"
        words = (
            f"the record contradicts the model: innovations are {size}, and no single fault of a channel or a known "
            f"load explains it: check {own.channels}, loads and the model{_step_in_words(problem, test)}, {ACCEPT}"
        )
    return Judgement(False, named, words, checked)


def clock_in_words(test: Measured, step: float) -> str:
    """That the clock of a record is another one than that of the config, step [s]; empty where they are alike."""
    dt = test.h * test.every
    if max(dt / step, step / dt) < OTHER_STEP:
        return ""
    return f"the record has a sample every {dt:.3g} s, train.time_step is {step:.3g} s: check estimate.time.unit"


def fault_in_words(
    found: Explained,
    label: Sequence[str],
    entries: Sequence[GaugeChannel],
    suspect: Suspect,
    section: str = "estimate",
) -> str:
    """A fault with the key of the config, below `section`, that undoes it."""
    fault = found.fault
    assert fault is not None
    j = fault.channel
    name, key, entry = label[j], f"{section}.channels.{j}", entries[j]
    if fault.kind == "sign":
        return f"{name} fits with sign −1: check the wiring, or set {key}.sign: {-entry.sign}"
    if fault.kind == "scale":
        check = "bridge and gauge factor" if 0.1 < fault.amount < 10 else f"{key}.unit (now {entry.unit})"
        return f"{name} reads {fault.amount:g} times what fits: check {check}, or set {key}.scale: {entry.scale / fault.amount:g}"
    if fault.kind == "swapped":
        other = int(fault.amount)
        return f"{name} and {label[other]} fit swapped: exchange {key}.channel and {section}.channels.{other}.channel"
    if fault.kind == "offset":
        return f"{name} fits with an offset of {_size(found, suspect)}: set {key}.zero or {key}.offset, or {key}.bias"
    if fault.kind == "drift":
        seconds = min(len(suspect.samples), LONGEST) * suspect.model.h * suspect.model.every
        return f"{name} fits with a drift of {_size(found, suspect)} in {seconds:.3g} s: set {key}.drift"
    if fault.kind == "late":
        n = int(fault.amount)
        dt = suspect.model.h * suspect.model.every
        return f"{_late_in_words(name, n, dt)}: set {key}.delay: {_delay_in_words(entry, n, abs(n) * dt)}"
    if fault.kind == "angle":
        turn = f"{abs(fault.amount):g}°"
        return f"{name} fits turned by {turn}: check its direction, and {key}.gauge and {key}.grid"
    if fault.kind == "dead":
        return f"{name} reads noise alone, it is dead: leave {key} out"
    count = int(at_limit(suspect.samples[:, j]).sum())
    return f"{name} is clipped, in {count} samples at least: mark them as missing, or leave {key} out"


def load_fault_in_words(fault: Fault, known: Sequence[str], own: RecordSettings, dt: float) -> str:
    """A fault of a known load with the key that undoes it; dt [s] between samples."""
    name = known[fault.channel]
    entry, inputs = own.settings.inputs[name], f"{own.section}.inputs"
    key = f"{inputs}.{name}"
    copied = "" if own.section == "estimate" or own.inputs.startswith(own.section) else _copied(own.section, own.inputs)
    if fault.kind == "sign":
        words = f"{name} fits with sign −1: check its direction (loads.{name}), or set {key}.sign: {-entry.sign}"
    elif fault.kind == "scale":
        words = (
            f"{name} reads {fault.amount:g} times what fits: check {key}.unit (now {entry.unit}), or set {key}.scale: "
            f"{entry.scale / fault.amount:.9g}"
        )
    elif fault.kind == "swapped":
        other = known[int(fault.amount)]
        words = f"{name} and {other} fit swapped: exchange {key}.channel and {inputs}.{other}.channel"
    else:
        n = int(fault.amount)
        words = f"{_late_in_words(name, n, dt)}: set {key}.delay: {_delay_in_words(entry, n, abs(n) * dt)}"
        if n < 0 and own.settings.start == "rest":
            words += " and estimate.start: moving"
    return f"{words}{copied}"


def _copied(section: str, key: str) -> str:
    return f" (state {section}.{key.split('.')[-1]}, a copy of {key}, for what this record alone needs)"


def _late_in_words(name: str, n: int, dt: float) -> str:
    return f"{name} is {abs(n)} sample{'s' * (abs(n) > 1)} ({abs(n) * dt:.3g} s) {'late' if n > 0 else 'early'}"


def _delay_in_words(entry: Channel, n: int, seconds: float) -> str:
    """A delay by n samples more than the config has, in the unit that it has."""
    if isinstance(entry.delay, DelayInSeconds):
        return f"{{seconds: {entry.delay.seconds + np.sign(n) * seconds:.9g}}}"
    return f"{{samples: {n + (0 if entry.delay is None else entry.delay.samples)}}}"


def _size(found: Explained, suspect: Suspect) -> str:
    assert found.fault is not None
    quantity = suspect.model.quantity
    kind = STRAIN if quantity is None else int(quantity[found.fault.channel])
    factor, unit = (1e6, "µm/m") if kind == STRAIN else (1.0, UNITS[kind])
    return f"{factor * found.amount:.3g} ± {factor * found.std:.2g} {unit}"


def _step_in_words(problem: Problem, test: Measured) -> str:
    lam, _ = modal_basis(problem.model, problem.model.reference)
    period, dt = 2 * np.pi / float(np.sqrt(lam[0])), test.h * test.every
    if dt < 0.5 * period:
        return ""
    return f" (its step is {dt:.3g} s, the first mode has a period of {period:.3g} s: check estimate.time.unit)"


def _beginning(suspect: Suspect) -> Suspect:
    return replace(suspect, samples=suspect.samples[:LONGEST], known=suspect.known[: LONGEST * suspect.model.every])


def _checked(
    check: ChannelCheck,
    by_others: bool,
    fault: tuple[str, ...] = (),
    gain: np.ndarray | None = None,
    candidate: tuple[str, ...] = (),
) -> ChannelsChecked:
    m = len(check.measured)
    return ChannelsChecked(
        by_others=by_others,
        measured=check.measured,
        predicted=check.predicted,
        residual=check.residual,
        correlation=check.correlation,
        fault=fault or ("",) * m,
        gain=np.zeros(m) if gain is None else gain,
        candidate=candidate,
    )


def _finite(gain: float) -> float:
    return float(min(gain, np.finfo(float).max))

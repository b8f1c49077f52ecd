"""Consistency of measurements with the model and with each other, and the fault of a channel or known load that explains a
discrepancy, with the config key that corrects it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.estimate import Channel, DelayInSeconds
from strainsight.estimation.conditional import ConsideredParameters
from strainsight.estimation.decision import INCONSISTENT
from strainsight.estimation.fault_evidence import CheckRecord
from strainsight.estimation.faults import ANGLES, MARGIN, Explained, Fault, at_limit
from strainsight.estimation.load_faults import ResidualPattern
from strainsight.estimation.model import FilterModel
from strainsight.estimation.peak import find_common_peak
from strainsight.estimation.record_check import RecordCheck, check_record
from strainsight.experiment.recorded import delay_in_seconds
from strainsight.experiment.structure.considered import build_considered, on_average, tolerated
from strainsight.experiment.structure.measured import Measured
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.record_filter import RecordFilter
from strainsight.experiment.structure.structure import Structure
from strainsight.measurements.records import required_unit
from strainsight.records.estimated import ChannelsChecked
from strainsight.records.record import record_from
from strainsight.rom.model import modal_basis
from strainsight.sensors.candidates import STRAIN, UNITS, Candidates
from strainsight.sensors.strain_operator import channel_rows, fits
from strainsight.sensors.surface import turned

MOST_TIMES = 20
"""Largest number of time intervals of a fault that are listed."""
LEAST_SHARE = 0.1
"""Smallest share of a channel in the pattern of an additional load that is listed."""
OTHER_STEP = 100.0
"""Ratio of sampling interval and `train.time_step` that suggests a wrong unit of time."""


@dataclass(frozen=True)
class Turning:
    """Strain operators of gauges rotated on the surface by ANGLES; NaN where a channel cannot be rotated.

    rows (m, angles, n): per reduced coordinate; missed (m, angles, n_u, misalignments): of misaligned loads."""

    rows: np.ndarray
    missed: np.ndarray


def turning_of(structure: Structure, channels: np.ndarray) -> Turning:
    """Rotate channels (m,) of train.h5. Only strain gauges on the mesh whose rotated grid stays on the surface can be rotated;
    bridges cannot."""
    training, missed = structure.training, structure.reduced.misaligned.missed
    n = training.rows.shape[1]
    rows = np.full((len(channels), len(ANGLES), n), np.nan)
    more = np.zeros((*rows.shape[:2], *missed.shape[1:]))
    pool, position = structure.pool, structure.mesh.position
    single = np.flatnonzero(
        (pool.quantity == STRAIN)[channels] & ~pool.bridged[channels] & (training.strain_operator is None)
    )
    if len(single):
        for k, angle in enumerate(ANGLES):
            # every channel as a gauge of one grid
            part = replace(_turned(pool.take(channels[single]), angle), gauge=np.arange(len(single)))
            well = np.flatnonzero(fits(position, part, structure.skin.facets))
            lying = part.take(well)
            read = channel_rows(position, lying, structure.field, facets=structure.skin, thickness=structure.thickness)
            rows[single[well], k], more[single[well], k] = read[:, :n], read[:, n:].reshape(-1, *missed.shape[1:])
    return Turning(rows, more)


def _turned(pool: Candidates, angle: float | np.ndarray) -> Candidates:
    each = np.broadcast_to(np.asarray(angle, dtype=float), (len(pool),))
    return replace(pool, direction=turned(pool.direction, pool.normal, each))


def build_check_record(structure: Structure, record: RecordFilter, turning: Turning) -> CheckRecord:
    """Set up the fault search with the parameter grid filter, the only one that includes the tolerances."""
    model, test, channels, training = record.model, record.test, record.test.channels, structure.training
    Q, at = np.array(model.Q), model.parameter_states
    Q[..., at, :], Q[..., :, at] = 0.0, 0.0
    constant = replace(model, Q=Q)
    wide = np.full((*turning.rows.shape[:2], model.size), 0.0)
    wide[..., : turning.rows.shape[-1]] = turning.rows
    moving, motion = np.array(record.covariance), model.motion
    moving[motion, motion] = np.diag(np.abs(record.problem.x).max(axis=0) ** 2)

    def with_turned(j: int, angle: float) -> tuple[FilterModel, ConsideredParameters]:
        k, channel = ANGLES.index(angle), channels[j]
        H = np.array(constant.H)
        H[j] = wide[j, k]
        # rows of the guess: how they change with a thickness is known of the channel as it was meant
        change = constant.change.of_terms(lambda X: np.where((np.arange(len(X)) == j)[:, None], 0.0, X))
        one = np.zeros(len(training.candidates))
        one[channel] = angle
        rows, missed = np.array(training.rows), np.array(training.missed)
        rows[channel], missed[channel] = turning.rows[j, k], turning.missed[j, k]
        as_turned = replace(training, candidates=_turned(training.candidates, one), rows=rows, missed=missed)
        tolerances = tolerated(replace(structure, training=as_turned), channels)
        # the others have what they read on average over their installations already
        H[j] = on_average(tolerances, replace(constant, H=H), channels).H[j]
        changed = replace(constant, H=H, change=change)
        return changed, build_considered(tolerances, changed, channels)

    return CheckRecord(
        model=constant,
        mean=np.zeros(len(record.covariance)),
        covariance=record.covariance,
        known=test.known,
        samples=test.values,
        considered=build_considered(record.tolerances, constant, channels),
        biased=record.biased,
        settled=record.settled,
        turned_rows=wide,
        turned=with_turned,
        load=np.tile(np.arange(len(record.problem.known)), 2)[: test.known.shape[-1]],
        moving=moving,
    )


@dataclass(frozen=True)
class ConsistencyResult:
    """Result of the consistency check of one record.

    words: why the record is inconsistent with the model, else empty; named: the only fault that explains it, with the key that
    corrects it, else empty; check: by channel; disagrees: the record is inconsistent with other records, not with the model;
    birge_ratio: RMS of the innovations over the predicted value, 1 for a consistent record and where no filter runs."""

    words: str
    named: str
    check: ChannelsChecked
    disagrees: bool = False
    birge_ratio: float = 1.0

    @property
    def trusted(self) -> bool:
        return not self.words


def check_consistency(
    test: Measured, problem: Problem, checked_record: CheckRecord, discrepancy: float, progress: Callable[[float], None]
) -> ConsistencyResult:
    """Check a record by `check_record`; discrepancy: allowed model error as a share of a reading."""
    check = check_record(checked_record, discrepancy, progress)
    finding, words, channels = check.finding, FaultInWords(test, check.stretch, problem.known), test.record.channels
    named = "" if finding.named is None else ": ".join(words.of(finding.named))
    # with several explanations no key is proposed: a wrong one would hide the fault
    candidates = (named,) if named else tuple(words.of(one)[0] for one in finding.candidates)
    # in a consistent record a fault that fits slightly better is chance
    best = [finding.best_of(j) if finding.inconsistent else None for j in range(len(test.labels))]
    gain = [0.0 if one is None else one.evidence - finding.as_it_is.evidence for one in best]
    by_channel = record_from(
        ChannelsChecked,
        finding.check,
        by_others=bool(len(finding.without)),
        begin=_time_of(test, check.part[0]),
        end=_time_of(test, check.part[1] - 1),
        fault=tuple("" if one is None else words.of(one)[0] for one in best),
        gain=np.minimum(gain, np.finfo(float).max),
        candidate=candidates,
    )
    if not finding.inconsistent:
        return ConsistencyResult("", "", by_channel)
    ratio, alone = (
        finding.as_it_is.ratio,
        "no single fault of a channel, a known load or the model explains the inconsistency",
    )
    if named:
        text = f": {named}"
    elif candidates:
        text = (
            f". Several causes explain this equally well: {'; '.join(candidates[:4])}{' …' * (len(candidates) > 4)}. Inspect the "
            f"gauges on the structure to find the actual cause ({channels})"
        )
    elif finding.shifted is not None:
        mode, lam = finding.shifted.mode, modal_basis(problem.model, problem.model.reference)[0]
        shift = _shift_in_words(mode, float(np.sqrt(lam[mode])) / (2 * np.pi), finding.shifted.factor)
        size = f"a difference of {finding.shifted.size:.2g} σ of tolerances.frequency"
        text = f"; {alone}: {shift}, {size}. {CHECK_MODE.capitalize()}"
    elif finding.pattern is not None:
        text = f"; {alone}: {_pattern_in_words(finding.pattern, test.labels)}"
    else:
        size = f"{ratio:.3g} times as large as predicted" if np.isfinite(ratio) else "unbounded"
        text = (
            f": innovations are {size}{_worst_in_words(check, test)}; {alone}. Check {channels}, loads, estimate.start "
            f"and the model{_step_in_words(problem, test)}"
        )
    return ConsistencyResult(
        INCONSISTENT + text, named, by_channel, birge_ratio=max(1.0, ratio) if np.isfinite(ratio) else 1.0
    )


def _worst_in_words(check: RecordCheck, test: Measured) -> str:
    sample, channel, size = check.worst
    if not size > 0:
        return ""
    return f", the largest innovation is {size:.3g} σ at {_time_of(test, sample):.6g} s ({test.labels[channel]})"


def _time_of(test: Measured, sample: int) -> float:
    """Time of a sample, counted from the second [s]."""
    return float(test.time[1 + sample])


def clock_in_words(test: Measured, step: float) -> str:
    """Warning if the sampling interval of a record differs widely from the time step of the config [s], else empty."""
    if max(test.step / step, step / test.step) < OTHER_STEP:
        return ""
    return (
        f"the sampling interval of the record is {test.step:.3g} s, but train.time_step is {step:.3g} s: check "
        "estimate.time.unit"
    )


@dataclass(frozen=True)
class FaultInWords:
    """Describe faults of a record and the config keys that correct them; stretch: the samples that show them."""

    test: Measured
    stretch: CheckRecord
    known: Sequence[str] = ()

    def of(self, explanation: Explained) -> tuple[str, str]:
        """Return the fault, and what to check with the key that corrects it."""
        fault, record = explanation.fault, self.test.record
        assert fault is not None
        if fault.of_model:
            return self._of_model(fault)
        what, remedy = self._of_kind(fault, explanation.amount, explanation.std)
        source = record.inputs if fault.of_load else record.channels
        if record.section != "estimate" and not source.startswith(record.section):
            key = f"{record.section}.{source.split('.')[-1]}"
            remedy += f" (to correct only this record, copy the config section {source} to {key} and change the copy)"
        return what, remedy

    def _of_model(self, fault: Fault) -> tuple[str, str]:
        """Return an error of the model, and what to check."""
        rom = self.stretch.model.model
        if fault.kind == "frequency":
            modelled = float(np.sqrt(modal_basis(rom, rom.reference)[0][fault.channel])) / (2 * np.pi)
            return _shift_in_words(fault.channel, modelled, fault.amount), CHECK_MODE
        if fault.kind == "mass":
            name = rom.inputs[fault.channel]
            what = f"a mass of {fault.amount:.2g} kg at the load {name} is missing in the model"
            return what, "add the masses of sensors and fixtures to the mesh file"
        if fault.kind == "damping":
            what = f"the damping ratios are about {fault.amount:.2g} times those of the model"
            return what, "correct `damping`, or increase tolerances.damping"
        if fault.kind == "direction":
            what = "a load has another direction or point of application than in the model"
            return what, "check direction and point of the loads on the structure, or increase tolerances.load_angle"
        if fault.kind == "warming":
            what = "all strain gauges drift together"
            return what, "compensate the temperature, or set tolerances.temperature"
        what = "all strain gauges have a common gain error"
        return what, "check bridge supply and gauge factor of the amplifier, and set `scale` of all channels"

    def _of_kind(self, fault: Fault, estimate: float, std: float) -> tuple[str, str]:
        """Return fault and remedy; estimate and std: of an offset or drift."""
        names, amount = self.known if fault.of_load else self.test.labels, fault.amount
        name, (entry, key) = names[fault.channel], self._entry(fault, fault.channel)
        raw = estimate / (entry.sign * entry.scale * required_unit(entry.unit).factor)
        if fault.kind == "sign":
            check = f"the direction of the load (loads.{name})" if fault.of_load else "the wiring"
            return f"{name} has the opposite sign", f"check {check}, or set {key}.sign: {-entry.sign}"
        if fault.kind == "scale":
            gauge = 0.1 < amount < 10 and not fault.of_load
            check = "bridge and gauge factor" if gauge else f"{key}.unit (now {entry.unit})"
            remedy = f"check {check}, or set {key}.scale: {entry.scale / amount:.9g}"
            return f"the readings of {name} are {amount:g} times as large as expected", remedy
        if fault.kind == "swapped":
            other = self._entry(fault, int(amount))[1]
            return f"{name} and {names[int(amount)]} are swapped", f"exchange {key}.channel and {other}.channel"
        if fault.kind == "offset":
            value = "" if entry.bridge is not None else f": {entry.offset + raw:.6g}"
            remedy = f"set {key}.offset{value}, set {key}.zero to an unloaded interval, or set {key}.bias to estimate the offset"
            return f"{name} has an offset of {self._size(fault, estimate, std)}", remedy
        if fault.kind == "drift":
            value = "" if entry.bridge is not None else f": {entry.drift + raw / self._drifted:.6g}"
            what = f"{name} drifts by {self._size(fault, estimate, std)} in {self._drifted:.3g} s"
            return what, f"set {key}.drift{value}"
        if fault.kind == "late":
            n, at_rest = abs(int(amount)), self.test.record.settings.start == "rest"
            moving = " and estimate.start: moving" * (fault.of_load and amount < 0 and at_rest)
            late = "late" if amount > 0 else "early"
            what = f"{name} is {n} sample{'s' * (n > 1)} ({n * self._step:.3g} s) {late}"
            return what, f"set {key}.delay: {_delay_in_words(entry, int(amount), n * self._step)}{moving}"
        if fault.kind == "angle":
            return (
                f"{name} is rotated by {abs(amount):g}°",
                f"check the direction of the gauge, {key}.gauge and {key}.grid",
            )
        if fault.kind == "dead":
            return f"{name} contains only noise, so the gauge or its cable is broken", f"remove {key}"
        if fault.kind == "clipped":
            count = int(at_limit(self.stretch.samples[:, fault.channel]).sum())
            what = f"{name} is clipped (samples at the limit: at least {count})"
            return what, f"set {key}.missing to the clipped intervals, or remove {key}"
        spikes = "; ".join(self._spikes(fault, channel) for channel in fault.channels)
        what = f"spikes: {spikes}" if fault.kind == "spikes" else self._for_a_time(fault)
        return what, "set " + " and ".join(self._missing(fault, channel) for channel in fault.channels)

    def _entry(self, fault: Fault, number: int) -> tuple[Channel, str]:
        """Return the config section of a channel or a known load, and its key."""
        record = self.test.record
        if fault.of_load:
            name = self.known[number]
            return record.settings.inputs[name], f"{record.section}.inputs.{name}"
        return record.settings.channels[number], f"{record.section}.channels.{number}"

    @property
    def _step(self) -> float:
        """Sampling interval [s]."""
        return self.stretch.model.h * self.stretch.model.every

    @property
    def _drifted(self) -> float:
        """Time from the beginning of the record to the end of the stretch [s]."""
        return (self.stretch.begin + len(self.stretch.samples)) * self._step

    def _size(self, fault: Fault, amount: float, std: float | None = None) -> str:
        quantity = self.stretch.model.quantity
        kind = STRAIN if quantity is None else int(quantity[fault.channel])
        factor, unit = (1e6, "µm/m") if kind == STRAIN else (1.0, UNITS[kind])
        return f"{factor * amount:.3g} {'' if std is None else f'± {factor * std:.2g} '}{unit}"

    def _for_a_time(self, fault: Fault) -> str:
        """Describe a fault that begins or ends during the record."""
        ((channel, first, behind),), name = fault.spans, self.test.labels[fault.channel]
        ends = self.stretch.begin + behind >= len(self.test.time) - 1
        since = f"after {self._time(first)} s" if ends else f"from {self._time(first)} to {self._time(behind - 1)} s"
        if fault.kind == "shift":
            return f"the zero of {name} shifts by {self._size(fault, fault.amount)} {since}"
        return f"{name} is stuck at {self._size(fault, float(self.stretch.samples[first, channel]))} {since}"

    def _spikes(self, fault: Fault, channel: int) -> str:
        spans = [span[1:] for span in fault.spans if span[0] == channel]
        times = [self._time(a) if b - a == 1 else f"{self._time(a)} to {self._time(b - 1)}" for a, b in spans]
        if (more := len(times) - MOST_TIMES) > 0:
            return f"{self.test.labels[channel]} at {', '.join(times[:MOST_TIMES])} s (further times: {more})"
        last = times.pop()
        return f"{self.test.labels[channel]} at {', '.join(times) + ' and ' if times else ''}{last} s"

    def _time(self, sample: int) -> str:
        """Time of a sample of the stretch, with the decimals of the sampling interval."""
        return f"{_time_of(self.test, self.stretch.begin + sample):.{max(0, int(np.ceil(-np.log10(self._step))))}f}"

    def _missing(self, fault: Fault, channel: int) -> str:
        """Key that marks the faulty intervals as missing, extended by half a sample, in the time of the file."""
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
    """Configured delay increased by n samples, in its unit."""
    if isinstance(entry.delay, DelayInSeconds):
        return f"{{seconds: {entry.delay.seconds + np.sign(n) * seconds:.9g}}}"
    return f"{{samples: {n + (0 if entry.delay is None else entry.delay.samples)}}}"


CHECK_MODE = "check masses, supports and joints, or measure the frequency and correct the model"


def _shift_in_words(mode: int, modelled: float, factor: float) -> str:
    """Describe a mode whose measured frequency differs from the model [Hz]."""
    return f"mode {mode + 1} is measured at {factor * modelled:.4g} Hz and modelled at {modelled:.4g} Hz"


def _pattern_in_words(pattern: ResidualPattern, labels: Sequence[str]) -> str:
    """Describe an unmodelled load: its channels, size and remedy."""
    order = np.argsort(-pattern.share, kind="stable")
    most = [f"{labels[j]} ({pattern.share[j]:.0%})" for j in order if pattern.share[j] >= LEAST_SHARE]
    return (
        f"an unmodelled load or other disturbance acts on {', '.join(most)}. In a combination of these channels the innovations "
        f"are {pattern.size:.3g} times as large as predicted and change slowly (correlation {pattern.correlation:.2f}). "
        "Add the missing load to `loads`, or check temperature, cables and supports"
    )


def _step_in_words(problem: Problem, test: Measured) -> str:
    lam, _ = modal_basis(problem.model, problem.model.reference)
    period = 2 * np.pi / float(np.sqrt(lam[0]))
    if test.step < 0.5 * period:
        return ""
    return f" (sampling interval {test.step:.3g} s, period of the first mode {period:.3g} s: check estimate.time.unit)"


@dataclass(frozen=True)
class Together:
    """Joint estimate of R records.

    alone: parameter → most likely value [SI] from each record (R,); shared: from all records; gain: ln likelihood ratio of common
    against separate parameters and gauges; words: that the records are inconsistent with each other, else empty."""

    alone: dict[str, np.ndarray]
    shared: dict[str, float]
    gain: float
    words: str


def together_of(filters: Sequence[RecordFilter], check_records: Sequence[CheckRecord]) -> Together:
    """Compare the joint evidence of the records with their separate evidence.

        ln p(y₁ … y_R) − Σᵣ ln p(yᵣ)

    It is large for records of one test, and below −MARGIN for records with different parameters or re-bonded gauges. Both terms
    are computed by `peak_of`."""
    unknowns = filters[0].problem.unknowns

    def learning(checked_record: CheckRecord, considered: ConsideredParameters) -> CheckRecord:
        return replace(checked_record, considered=replace(considered, learned=True))

    peaks = [
        find_common_peak([learning(checked_record, checked_record.considered)]) for checked_record in check_records
    ]
    order = np.argsort([record.record for record in filters])
    of_all = find_common_peak([learning(check_records[i], filters[i].considered) for i in order])
    values = {
        name: unknowns.guess[name] * np.exp([peak.point[i] for peak in (*peaks, of_all)])
        for i, name in enumerate(unknowns.parameters)
    }
    gain = float(of_all.evidence - sum(peak.evidence for peak in peaks))
    words, names = "", [record.test.record.name for record in filters]
    if gain < -MARGIN:
        each = [
            f"{name} {', '.join(f'{value:.4g} ({of})' for value, of in zip(row[:-1], names, strict=True))}"
            for name, row in values.items()
        ]
        differing = "; ".join(each) or "gauge errors that differ between the records"
        words = f"the records are inconsistent with each other. Separate estimates: {differing}"
    alone, shared = (
        {name: row[:-1] for name, row in values.items()},
        {name: float(row[-1]) for name, row in values.items()},
    )
    return Together(alone, shared, gain, words)

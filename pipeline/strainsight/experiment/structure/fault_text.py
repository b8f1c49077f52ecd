"""Faults of a record and errors of the model in words, with the config key that corrects them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.config.estimate import Channel, DelayInSeconds
from strainsight.estimation.fault_evidence import CheckRecord
from strainsight.estimation.faults import Explained, Fault, at_limit
from strainsight.estimation.load_faults import ResidualPattern
from strainsight.experiment.recorded import delay_in_seconds
from strainsight.experiment.structure.measured import Measured
from strainsight.measurements.records import required_unit
from strainsight.rom.model import modal_basis
from strainsight.sensors.candidates import STRAIN, UNITS
from strainsight.text import listed

MOST_TIMES = 20
"""Largest number of time intervals of a fault that are listed."""
LEAST_SHARE = 0.1
"""Smallest share of a channel in the pattern of an additional load that is listed."""


def time_of(test: Measured, sample: int) -> float:
    """Time of a sample, counted from the second [s]."""
    return float(test.time[1 + sample])


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
            return self._of_model(fault, explanation.point)
        what, remedy = self._of_kind(fault, explanation.amount, explanation.std)
        source = record.inputs if fault.of_load else record.channels
        if record.section != "estimate" and not source.startswith(record.section):
            key = f"{record.section}.{source.split('.')[-1]}"
            remedy += f" (to correct only this record, copy the config section {source} to {key} and change the copy)"
        return what, remedy

    def _of_model(self, fault: Fault, point: Sequence[float]) -> tuple[str, str]:
        """Return an error of the model, and what to check; point: ln θ/guess of the parameters."""
        rom, unknowns = self.stretch.model.model, self.stretch.model.unknowns
        if fault.kind == "frequency":
            values = zip(unknowns.parameters, point, strict=True)
            theta = {**rom.reference, **{name: unknowns.guess[name] * np.exp(value) for name, value in values}}
            modelled = float(np.sqrt(modal_basis(rom, theta)[0][fault.channel])) / (2 * np.pi)
            return shift_in_words(fault.channel, modelled, fault.amount), CHECK_MODE
        if fault.kind == "mass":
            name = rom.inputs[fault.channel]
            what = f"a mass of {fault.amount:.2g} kg at the load {name} is missing in the model"
            return what, "add the masses of sensors and fixtures to mesh.point_masses"
        if fault.kind == "damping":
            what = f"the damping ratios are about {fault.amount:.2g} times those of the model"
            return what, "correct `damping`, or increase tolerances.damping"
        if fault.kind == "direction":
            what = "a load has another direction or point of application than in the model"
            return what, "check direction and point of the loads on the structure, or increase tolerances.load_angle"
        if fault.kind == "hum":
            return (
                f"all channels contain a common sine of {fault.amount:g} Hz",
                "remove the mains hum: check shields and earth",
            )
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
        if fault.fitted:
            what = f"the readings of {name} are {amount:.3g} times as large as expected"
            # no key: the factor contains the installation errors of the gauge
            return what, f"check bridge and gauge factor of {key}, and position and direction of the gauge"
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
        return f"{time_of(self.test, self.stretch.begin + sample):.{max(0, int(np.ceil(-np.log10(self._step))))}f}"

    def _missing(self, fault: Fault, channel: int) -> str:
        """Key that marks the faulty intervals as missing, extended by half a sample, in the time of the file."""
        entry, key = self._entry(fault, channel)
        late = delay_in_seconds(entry.delay, self._step)
        spans = [list(span) for span in entry.missing]
        for at, first, behind in fault.spans:
            if at == channel:
                ends = self.stretch.begin + first, self.stretch.begin + behind - 1
                times = (time_of(self.test, k) + late for k in ends)
                spans.append(
                    [float(f"{t + 0.5 * way * self._step:.9g}") for t, way in zip(times, (-1, 1), strict=True)]
                )
        return f"{key}.missing: {spans}"


def _delay_in_words(entry: Channel, n: int, seconds: float) -> str:
    """Configured delay increased by n samples, in its unit."""
    if isinstance(entry.delay, DelayInSeconds):
        return f"{{seconds: {entry.delay.seconds + np.sign(n) * seconds:.9g}}}"
    return f"{{samples: {n + (0 if entry.delay is None else entry.delay.samples)}}}"


COMMON = ("warming", "gain", "hum")
"""Errors of the model that all channels have in common, and that an inspection of the measuring chain shows."""
CHECK_MODE = (
    "check masses (mesh.point_masses), joints, and whether a support is elastic (`stiffness` in mesh.supports); or measure the "
    "frequency and correct the model"
)


def inspection_in_words(faults: Sequence[Fault], channels: str) -> str:
    """What to inspect if several faults explain a record; channels: config section of the channels."""
    of_gauges = any(not one.of_load and (not one.of_model or one.kind in COMMON) for one in faults)
    of_model = any(one.of_model and one.kind not in COMMON for one in faults)
    places = (
        f"the gauges on the structure ({channels})" * of_gauges,
        "the measurement of the known loads" * any(one.of_load for one in faults),
        "masses, supports, damping and loads of the model" * of_model,
    )
    return f"Inspect {listed([place for place in places if place])}"


def shift_in_words(mode: int, modelled: float, factor: float) -> str:
    """Describe a mode whose measured frequency differs from the model [Hz]."""
    return f"mode {mode + 1} is measured at {factor * modelled:.4g} Hz and modelled at {modelled:.4g} Hz"


def pattern_in_words(pattern: ResidualPattern, labels: Sequence[str]) -> str:
    """Describe an unmodelled load: its channels, size and remedy."""
    order = np.argsort(-pattern.share, kind="stable")
    most = [f"{labels[j]} ({pattern.share[j]:.0%})" for j in order if pattern.share[j] >= LEAST_SHARE]
    return (
        f"an unmodelled load, inertia force or other disturbance acts on {', '.join(most)}. In a combination of these channels "
        f"the innovations are {pattern.size:.3g} times as large as predicted, and the correlation of successive innovations is "
        f"{pattern.correlation:.2f}. Add a missing load to `loads` or a missing mass to mesh.point_masses, or check temperature, "
        "cables and supports"
    )

"""From what a channel reads to SI: unit, bridge, offset, drift, zeroing, sign."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.bridges import Bridge, strain_of
from strainsight.measurements.delay import NO_DELAY, Delay
from strainsight.measurements.marks import check_marks
from strainsight.measurements.records import Recording
from strainsight.measurements.units import SI, known_unit, required_unit, spelling

LARGE_STRAIN = 0.05
"""Beyond it a metal foil gauge is torn: more likely the unit is wrong. Said, not refused."""
LARGEST = 1e30
"""Readings beyond it are no measurement in any unit."""


@dataclass(frozen=True)
class ChannelSettings:
    """What a channel reads, stated by the user.

    unit       of the readings; it has to agree with the one in the file, unless override
    bridge     for mV/V, uV/V, V/V, and only there
    offset     [unit] subtracted from the readings
    drift      [unit/s] times the time since the first sample, subtracted from the readings
    zero       (from, to) [s] on the file's clock: the mean of the readings there is subtracted, before the bridge formula,
               so that a bridge out of balance is balanced
    scale > 0  times the calibrated signal: lead wires, another gauge factor in the instrument, [unit] per volt
    sign       1 or −1, before the bridge formula: a bridge wired the other way round gives −r
    override   the unit in the file is wrong: take `unit`
    delay      that it is written late by
    missing    (from, to) [s] on the file's clock, each: samples that are none
    """

    unit: str
    bridge: Bridge | None = None
    offset: float = 0.0
    drift: float = 0.0
    zero: tuple[float, float] | None = None
    scale: float = 1.0
    sign: int = 1
    override: bool = False
    delay: Delay = NO_DELAY
    missing: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        quantity = required_unit(self.unit).quantity
        if quantity == "bridge" and self.bridge is None:
            raise UserError(
                f"a channel in {self.unit} without bridge and gauge factor",
                remedy="state the bridge and the gauge factor; for a load cell state its unit, its scale and override",
            )
        if quantity != "bridge" and self.bridge is not None:
            raise UserError(
                f"a channel in {self.unit} with a {self.bridge.arrangement} bridge",
                remedy="drop bridge and gauge factor, or state the unit mV/V",
            )
        if self.sign not in (1, -1):
            raise UserError(f"a sign of {self.sign}", remedy="give 1 or -1")
        if not 0 < self.scale < np.inf:
            raise UserError(f"a scale of {self.scale:g}", remedy="give a positive scale; the sign has its own setting")
        if not np.isfinite([self.offset, self.drift]).all():
            raise UserError(
                f"an offset of {self.offset:g}, a drift of {self.drift:g} a second", remedy="give finite numbers"
            )
        if not np.isfinite(self.delay.seconds):
            raise UserError(f"a delay of {self.delay.seconds:g} s", remedy="give a finite number of seconds")
        if self.zero is not None and not (np.isfinite(self.zero).all() and self.zero[0] < self.zero[1]):
            raise UserError(
                f"a zeroing window from {self.zero[0]:g} to {self.zero[1]:g} s", remedy="give its start and its end"
            )

        for first, last in self.missing:
            if not (np.isfinite([first, last]).all() and first <= last):
                raise UserError(
                    f"samples are missing from {first:g} to {last:g} s", remedy="give start and end of each span"
                )

    @property
    def quantity(self) -> str:
        """What the calibrated channel is: strain, acceleration, displacement, force, moment or pressure."""
        found = required_unit(self.unit).quantity
        return "strain" if found == "bridge" else found


def calibrate(recording: Recording, name: str, settings: ChannelSettings) -> tuple[np.ndarray, tuple[str, ...]]:
    """Channel `name` in SI units, (T,), and what was done to it in sentences:

        v(t) = sign · factor · (y(t) − offset − drift (t − t₀) − mean over the zeroing window)
        s(t) = scale · v(t),   for a bridge scale · ε(v(t))

    Raises UserError where the unit in the file is another one, the zeroing window holds no sample, or a reading is beyond
    what the bridge can give.
    """
    factor = required_unit(settings.unit).factor
    notes = list(_check_unit(recording, name, settings))
    values = np.array(recording.channels[name], dtype=float)
    notes.extend(_mark_missing(recording, name, settings, values))
    _check_size(recording, name, settings, values)
    check_marks(replace(recording, channels={name: values}), name, settings.unit)
    if settings.offset:
        values -= settings.offset
        notes.append(f"{name}: {settings.offset:g} {settings.unit} were subtracted")
    if settings.drift:
        values -= settings.drift * (recording.time - recording.time[0])
        notes.append(f"{name}: a drift of {settings.drift:g} {settings.unit} a second was subtracted")
    if settings.zero is not None:
        notes.append(_zeroed(recording, name, settings, values))
    values *= settings.sign * factor
    if settings.sign < 0:
        notes.append(f"{name}: its sign was turned")
    if settings.bridge is not None:
        values = _strain(recording, name, settings.bridge, values)
        notes.append(
            f"{name}: {settings.unit} became strain, {settings.bridge.arrangement} bridge, "
            f"gauge factor {settings.bridge.gauge_factor:g}"
        )
    elif factor != 1:
        notes.append(f"{name}: {settings.unit} became {SI[settings.quantity]}")
    if settings.scale != 1:
        values *= settings.scale
        notes.append(f"{name}: times {settings.scale:g}")
    notes.extend(_large(name, settings, values))
    return values, tuple(notes)


def _mark_missing(recording: Recording, name: str, settings: ChannelSettings, values: np.ndarray) -> tuple[str, ...]:
    """Set samples in the spans that settings name to NaN, in place. Raises UserError for a span without a sample."""
    marked = np.zeros(len(values), dtype=bool)
    for first, last in settings.missing:
        within = (recording.time >= first) & (recording.time <= last)
        if not within.any():
            raise UserError(
                f"no sample from {first:g} to {last:g} s, the record runs from {recording.time[0]:g} to "
                f"{recording.time[-1]:g} s",
                where=recording.source,
                remedy="take times of the file in `missing`, in seconds",
            )
        marked |= within
    values[marked] = np.nan
    return (f"{name}: {marked.sum()} samples were marked as missing",) if marked.any() else ()


def _check_unit(recording: Recording, name: str, settings: ChannelSettings) -> tuple[str, ...]:
    found = recording.units.get(name)
    if found is None or spelling(found) == spelling(settings.unit) or known_unit(found) == known_unit(settings.unit):
        return ()
    if settings.override:
        return (f"{name}: the file says {found}, taken as {settings.unit} as the settings say",)
    raise UserError(
        f"{name!r} is stated in {settings.unit}, the file has it in {found}",
        where=recording.source,
        remedy="correct the stated unit, or state `override: true` where the file is wrong",
    )


def _check_size(recording: Recording, name: str, settings: ChannelSettings, values: np.ndarray) -> None:
    beyond = np.flatnonzero(np.abs(values) > LARGEST)
    if beyond.size:
        sample = int(beyond[0])
        raise UserError(
            f"{name!r} reads {values[sample]:g} {settings.unit}",
            where=recording.place(sample),
            remedy="leave the cell empty where the sample is missing; a number that stands for missing has to be named",
        )


def _zeroed(recording: Recording, name: str, settings: ChannelSettings, values: np.ndarray) -> str:
    assert settings.zero is not None
    start, end = settings.zero
    if np.isnan(values).all():
        return f"{name}: no sample at all, so nothing was zeroed"
    within = values[(recording.time >= start) & (recording.time <= end)]
    within = within[np.isfinite(within)]
    if not within.size:
        raise UserError(
            f"{name!r} has no sample from {start:g} to {end:g} s, the record runs from {recording.time[0]:g} to "
            f"{recording.time[-1]:g} s",
            where=recording.source,
            remedy="zero where the part is unloaded and the channel has samples",
        )
    mean = float(np.mean(within))
    values -= mean
    return f"{name}: {mean:g} {settings.unit}, the mean of {within.size} samples from {start:g} to {end:g} s, were subtracted"


def _strain(recording: Recording, name: str, bridge: Bridge, r: np.ndarray) -> np.ndarray:
    strain = strain_of(bridge, r)
    beyond = np.flatnonzero(np.isnan(strain) & ~np.isnan(r))
    if beyond.size:
        sample = int(beyond[0])
        raise UserError(
            f"{name!r} reads {1e3 * r[sample]:g} mV/V, more than a {bridge.arrangement} bridge of gauge factor "
            f"{bridge.gauge_factor:g} can give",
            where=recording.place(sample),
            remedy="check the unit, or leave the cell empty where the channel was torn off or overdriven",
        )
    return strain


def _large(name: str, settings: ChannelSettings, values: np.ndarray) -> tuple[str, ...]:
    if settings.quantity != "strain" or np.isnan(values).all():
        return ()
    largest = float(np.nanmax(np.abs(values)))
    return (f"{name}: strains up to {1e2 * largest:.3g} %: is the unit right?",) if largest > LARGE_STRAIN else ()

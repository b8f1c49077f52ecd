"""From what a channel reads to SI: unit, bridge, offset, drift, zeroing, sign."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.clock import NO_DELAY, Delay
from strainsight.measurements.csv_rows import check_marks
from strainsight.measurements.records import SI, Recording, known_unit, required_unit, spelling

ARRANGEMENTS: Mapping[str, Callable[[float], tuple[float, float, float, float]]] = {
    "quarter": lambda nu: (1.0, 0.0, 0.0, 0.0),  # one gauge
    "half": lambda nu: (1.0, -1.0, 0.0, 0.0),  # tension and compression side of a beam: bending
    "half-opposite": lambda nu: (1.0, 0.0, 1.0, 0.0),  # both sides of a beam: axial
    "half-poisson": lambda nu: (1.0, -nu, 0.0, 0.0),  # one along, one across
    "full": lambda nu: (1.0, -1.0, 1.0, -1.0),  # bending, or torsion at ±45°
    "full-bending-poisson": lambda nu: (1.0, -1.0, nu, -nu),  # both sides, along and across: bending
    "full-poisson": lambda nu: (1.0, -nu, 1.0, -nu),  # both sides, along and across: axial
    "sum": lambda nu: (0.25, -0.25, 0.25, -0.25),  # ε is the signed sum of the arms, wherever they sit
}
"""Arrangement → ν → strains of arms 1 to 4 in parts of the strain under gauge 1."""
SUM = "sum"
"""The arrangement of a bridge that is one measurement (`Candidates.arms`); all others are of one gauge."""
NEEDS_RATIO = ("half-poisson", "full-bending-poisson", "full-poisson")


@dataclass(frozen=True)
class Bridge:
    """How the gauges of one channel sit in its bridge; arrangement: of ARRANGEMENTS; gauge factor GF > 0; Poisson's ratio ν,
    −1 < ν < ½, where gauges lie across.

    Arms 1 and 3 raise the output, 2 and 4 lower it.
    sum: ε_B = ε₁ − ε₂ + ε₃ − ε₄ = 4 r/GF, linear in r, which alone does not say what each arm reads. Of any arms it is

        r = (x₁ − x₂)/(2(2 + x₁ + x₂)) + (x₃ − x₄)/(2(2 + x₃ + x₄)),     x = GF ε

    so that it is exact where the strains of the arms of either leg, 1 and 2, 3 and 4, add up to zero. Otherwise each leg's share
    of ε_B comes out (x₁ + x₂)/2 and (x₃ + x₄)/2 of itself too small, to first order.
    """

    arrangement: str
    gauge_factor: float
    poisson_ratio: float | None = None

    def __post_init__(self) -> None:
        needed = self.arrangement in NEEDS_RATIO
        if needed and self.poisson_ratio is None:
            raise UserError(
                f"the bridge {self.arrangement!r} has gauges across and no Poisson's ratio",
                remedy="give Poisson's ratio of the part",
            )
        if not needed and self.poisson_ratio is not None:
            raise UserError(
                f"the bridge {self.arrangement!r} has no gauge across, but Poisson's ratio is given",
                remedy=f"drop it, or take one of {', '.join(NEEDS_RATIO)}",
            )


def strain_of(bridge: Bridge, r: np.ndarray) -> np.ndarray:
    """Strain ε under gauge 1 from the output over the excitation r (T,) [V/V] of a bridge that was balanced at ε = 0:

        r = [(1+a₁x)(1+a₃x) − (1+a₂x)(1+a₄x)] / [(2+(a₁+a₂)x)(2+(a₃+a₄)x)],   x = GF ε
        ε = 4 r / (GF (N − 2 c r))        small r: ε = 4 r / (GF N)

    exactly, with N = a₁ − a₂ + a₃ − a₄ and c = a₁ + a₂ of every arrangement here; quarter bridge: ε = 4r/(GF (1 − 2r)).
    Tension under gauge 1 gives r > 0. Vishay Tech Note TN-507 has the same r(ε); NI writes these formulas for the opposite
    sign of r, −4V_r/(GF(1 + 2V_r)): an instrument wired that way has sign −1. NaN stays NaN, and so becomes what such a
    bridge cannot give: a gauge without resistance, or with an endless one.
    """
    arms = ARRANGEMENTS[bridge.arrangement](bridge.poisson_ratio or 0.0)
    N, c = arms[0] - arms[1] + arms[2] - arms[3], arms[0] + arms[1]
    below = N - 2.0 * c * r
    x = 4.0 * r / np.where(below > 0, below, np.nan)
    possible = np.all([1.0 + arm * x > 0 for arm in arms], axis=0)
    return np.where(possible, x, np.nan) / bridge.gauge_factor


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
        if self.zero is not None and not self.zero[0] < self.zero[1]:
            raise UserError(
                f"a zeroing window from {self.zero[0]:g} to {self.zero[1]:g} s", remedy="give its start and its end"
            )
        for first, last in self.missing:
            if not first <= last:
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

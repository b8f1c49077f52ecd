"""Calibration of a channel to SI: unit, bridge, offset, drift, zeroing, sign."""

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
    "half-poisson": lambda nu: (1.0, -nu, 0.0, 0.0),  # one longitudinal, one transverse
    "full": lambda nu: (1.0, -1.0, 1.0, -1.0),  # bending, or torsion at ±45°
    "full-bending-poisson": lambda nu: (1.0, -1.0, nu, -nu),  # both sides, longitudinal and transverse: bending
    "full-poisson": lambda nu: (1.0, -nu, 1.0, -nu),  # both sides, longitudinal and transverse: axial
    "sum": lambda nu: (0.25, -0.25, 0.25, -0.25),  # ε is the signed sum of the arms at any position
}
"""Arrangement → ν → strains of arms 1 to 4 relative to the strain of gauge 1."""
SUM = "sum"
"""Arrangement of a bridge with one measurement (`Candidates.arms`); all others are of one gauge."""
NEEDS_RATIO = ("half-poisson", "full-bending-poisson", "full-poisson")


@dataclass(frozen=True)
class Bridge:
    """Bridge of one channel; arrangement: of ARRANGEMENTS; gauge factor GF > 0; Poisson's ratio ν, −1 < ν < ½, for
    transverse gauges.

    Arms 1 and 3 raise the output, 2 and 4 lower it. sum: ε_B = ε₁ − ε₂ + ε₃ − ε₄ = 4 r/GF, linear in r, because r
    does not determine the strain of each arm. In general

        r = (x₁ − x₂)/(2(2 + x₁ + x₂)) + (x₃ − x₄)/(2(2 + x₃ + x₄)),     x = GF ε

    so that the sum is exact if the strains of both arms of each leg (1 and 2, 3 and 4) add up to zero. Otherwise the
    share of each leg in ε_B is too small by the relative error (x₁ + x₂)/2 or (x₃ + x₄)/2, to first order."""

    arrangement: str
    gauge_factor: float
    poisson_ratio: float | None = None

    def __post_init__(self) -> None:
        needed = self.arrangement in NEEDS_RATIO
        if needed and self.poisson_ratio is None:
            raise UserError(
                f"the bridge {self.arrangement!r} has transverse gauges, but no Poisson's ratio",
                remedy="set `bridge.poisson_ratio` to Poisson's ratio of the part",
            )
        if not needed and self.poisson_ratio is not None:
            raise UserError(
                f"the bridge {self.arrangement!r} has no transverse gauge, but a Poisson's ratio",
                remedy=f"remove `bridge.poisson_ratio`, or set `bridge.arrangement` to one of {', '.join(NEEDS_RATIO)}",
            )


def strain_of(bridge: Bridge, r: np.ndarray) -> np.ndarray:
    """Strain ε of gauge 1 from the output over the excitation r (T,) [V/V] of a bridge that is balanced at ε = 0:

        r = [(1+a₁x)(1+a₃x) − (1+a₂x)(1+a₄x)] / [(2+(a₁+a₂)x)(2+(a₃+a₄)x)],   x = GF ε
        ε = 4 r / (GF (N − 2 c r))        small r: ε = 4 r / (GF N)

    exactly, with N = a₁ − a₂ + a₃ − a₄ and c = a₁ + a₂ for every arrangement; quarter bridge: ε = 4r/(GF (1 − 2r)).
    Tension of gauge 1 causes r > 0. Vishay Tech Note TN-507 has the same r(ε); NI uses the opposite sign of r,
    −4V_r/(GF(1 + 2V_r)), which corresponds to sign −1. NaN stays NaN. Impossible outputs, which require a gauge with
    zero or infinite resistance, become NaN too."""
    arms = ARRANGEMENTS[bridge.arrangement](bridge.poisson_ratio or 0.0)
    N, c = arms[0] - arms[1] + arms[2] - arms[3], arms[0] + arms[1]
    below = N - 2.0 * c * r
    x = 4.0 * r / np.where(below > 0, below, np.nan)
    possible = np.all([1.0 + arm * x > 0 for arm in arms], axis=0)
    return np.where(possible, x, np.nan) / bridge.gauge_factor


LARGE_STRAIN = 0.05
"""Strain above which a metal foil gauge fails, so that the unit is probably wrong. Causes a note."""
LARGEST = 1e30
"""Values above it are not valid in any unit."""


@dataclass(frozen=True)
class ChannelSettings:
    """Settings of a channel.

    unit       of the readings; must agree with the file, unless override
    bridge     only for mV/V, uV/V, V/V
    offset     [unit] subtracted from the readings
    drift      [unit/s] times the time since the first sample, subtracted from the readings
    zero       (from, to) [s] on the file's clock: the mean of these readings is subtracted, before the bridge
    formula, so that the
               bridge is balanced
    scale > 0  factor of the calibrated signal: lead wires, another gauge factor in the instrument, [unit] per volt
    sign       1 or −1, before the bridge formula: an inversely wired bridge measures −r
    override   use `unit` because the unit in the file is wrong
    delay      of the channel in the file
    missing    (from, to) [s] on the file's clock, each: samples to ignore
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
                f"a channel in {self.unit} requires a bridge and a gauge factor",
                remedy="set `bridge.arrangement` and `bridge.gauge_factor`; for a load cell, set `unit` to a unit of force, "
                f"`scale` to the force per {self.unit}, and `override: true`",
            )
        if quantity != "bridge" and self.bridge is not None:
            raise UserError(
                f"a channel in {self.unit} cannot have a {self.bridge.arrangement} bridge",
                remedy="remove `bridge`, or set `unit: mV/V`",
            )
        if self.zero is not None and not self.zero[0] < self.zero[1]:
            raise UserError(
                f"the zero interval from {self.zero[0]:g} to {self.zero[1]:g} s is empty",
                remedy="set `zero: [from, to]` with the smaller time first",
            )
        for first, last in self.missing:
            if not first <= last:
                raise UserError(
                    f"the interval of missing samples from {first:g} to {last:g} s is empty",
                    remedy="set every interval [from, to] of `missing` with the smaller time first",
                )

    @property
    def quantity(self) -> str:
        """Quantity of the calibrated channel: strain, acceleration, displacement, force, moment or pressure."""
        quantity = required_unit(self.unit).quantity
        return "strain" if quantity == "bridge" else quantity


def calibrate(recording: Recording, name: str, settings: ChannelSettings) -> tuple[np.ndarray, tuple[str, ...]]:
    """Channel `name` in SI units, (T,), and notes on the conversion:

        v(t) = sign · factor · (y(t) − offset − drift (t − t₀) − mean over the zeroing window)
        s(t) = scale · v(t),   for a bridge scale · ε(v(t))

    Raises UserError for a different unit in the file, a zeroing window without sample, and a reading outside the
    range of the bridge."""
    factor = required_unit(settings.unit).factor
    notes = list(_check_unit(recording, name, settings))
    values = np.array(recording.channels[name], dtype=float)
    notes.extend(_mark_missing(recording, name, settings, values))
    _check_size(recording, name, settings, values)
    check_marks(replace(recording, channels={name: values}), name, settings.unit)
    if settings.offset:
        values -= settings.offset
        notes.append(f"{name}: an offset of {settings.offset:g} {settings.unit} was subtracted")
    if settings.drift:
        values -= settings.drift * (recording.time - recording.time[0])
        notes.append(f"{name}: a drift of {settings.drift:g} {settings.unit} per second was subtracted")
    if settings.zero is not None:
        notes.append(_subtract_zero(recording, name, settings, values))
    values *= settings.sign * factor
    if settings.sign < 0:
        notes.append(f"{name}: all samples were multiplied by −1, as set by `sign: -1`")
    if settings.bridge is not None:
        values = _strain(recording, name, settings.bridge, values)
        notes.append(
            f"{name}: converted from {settings.unit} to strain with a {settings.bridge.arrangement} bridge and "
            f"gauge factor {settings.bridge.gauge_factor:g}"
        )
    elif factor != 1:
        notes.append(f"{name}: converted from {settings.unit} to {SI[settings.quantity]}")
    if settings.scale != 1:
        values *= settings.scale
        notes.append(f"{name}: all samples were multiplied by {settings.scale:g}, the factor `scale` in the config")
    notes.extend(_note_large_strain(name, settings, values))
    return values, tuple(notes)


def _mark_missing(recording: Recording, name: str, settings: ChannelSettings, values: np.ndarray) -> tuple[str, ...]:
    """Set samples in the spans of the settings to NaN, in place. Raises UserError for a span without a sample."""
    marked = np.zeros(len(values), dtype=bool)
    for first, last in settings.missing:
        if not (within := (recording.time >= first) & (recording.time <= last)).any():
            raise UserError(
                f"the interval of missing samples from {first:g} to {last:g} s contains no sample; the record runs from "
                f"{recording.time[0]:g} to {recording.time[-1]:g} s",
                where=recording.source,
                remedy="set the intervals of `missing` in seconds on the time axis of the file",
            )
        marked |= within
    values[marked] = np.nan
    return (f"{name}: samples were marked as missing ({marked.sum()} of {values.size})",) if marked.any() else ()


def _check_unit(recording: Recording, name: str, settings: ChannelSettings) -> tuple[str, ...]:
    unit_in_file = recording.units.get(name)
    if (
        unit_in_file is None
        or spelling(unit_in_file) == spelling(settings.unit)
        or known_unit(unit_in_file) == known_unit(settings.unit)
    ):
        return ()
    if settings.override:
        return (f"{name}: the unit is {unit_in_file} in the file, but {settings.unit} is used as set in the config",)
    raise UserError(
        f"the unit of channel {name!r} is {settings.unit} in the config, but {unit_in_file} in the file",
        where=recording.source,
        remedy="correct the unit in the config, or set `override: true` for this channel if the file is wrong",
    )


def _check_size(recording: Recording, name: str, settings: ChannelSettings, values: np.ndarray) -> None:
    if (too_large := np.flatnonzero(np.abs(values) > LARGEST)).size:
        sample = int(too_large[0])
        raise UserError(
            f"channel {name!r} has the value {values[sample]:g} {settings.unit}; magnitudes above {LARGEST:g} are not valid",
            where=recording.place(sample),
            remedy="leave the cell empty for missing samples, or set `text: {missing: [NUMBER]}` to the number that marks them",
        )


def _subtract_zero(recording: Recording, name: str, settings: ChannelSettings, values: np.ndarray) -> str:
    assert settings.zero is not None
    start, end = settings.zero
    if np.isnan(values).all():
        return f"{name}: the channel has no samples, so no mean over the interval `zero` was subtracted"
    within = values[(recording.time >= start) & (recording.time <= end)]
    within = within[np.isfinite(within)]
    if not within.size:
        raise UserError(
            f"channel {name!r} has no sample in the zero interval from {start:g} to {end:g} s; the record runs from "
            f"{recording.time[0]:g} to {recording.time[-1]:g} s",
            where=recording.source,
            remedy="set `zero` to an interval in which the part is unloaded and the channel has samples",
        )
    mean = float(np.mean(within))
    values -= mean
    return f"{name}: the mean of {within.size} samples from {start:g} to {end:g} s was subtracted, {mean:g} {settings.unit}"


def _strain(recording: Recording, name: str, bridge: Bridge, r: np.ndarray) -> np.ndarray:
    strain = strain_of(bridge, r)
    if (impossible := np.flatnonzero(np.isnan(strain) & ~np.isnan(r))).size:
        sample = int(impossible[0])
        raise UserError(
            f"channel {name!r} has the value {1e3 * r[sample]:g} mV/V, which a {bridge.arrangement} bridge "
            "cannot produce at any strain",
            where=recording.place(sample),
            remedy="correct `unit`, or leave the cell empty if the gauge failed or was overloaded",
        )
    return strain


def _note_large_strain(name: str, settings: ChannelSettings, values: np.ndarray) -> tuple[str, ...]:
    if settings.quantity != "strain" or np.isnan(values).all():
        return ()
    largest = float(np.nanmax(np.abs(values)))
    return (f"{name}: strains up to {1e2 * largest:.3g} %; check the unit",) if largest > LARGE_STRAIN else ()

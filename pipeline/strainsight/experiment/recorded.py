"""Read test files and load histories, damping and regions of a config, for structures and benches."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from strainsight.config.base import Section
from strainsight.config.estimate import Channel, DelayInSamples, DelayInSeconds, RecordedFile
from strainsight.config.loads import RecordedSection
from strainsight.config.mesh import RegionKey
from strainsight.config.parameters import ModalDamping, RayleighDamping
from strainsight.errors import ConfigError, UserError, blame
from strainsight.loads.histories import Constant, FromSamples, MultiSine, Ramp, Signal, Sine, Sweep
from strainsight.measurements.assemble import Signals, assemble
from strainsight.measurements.calibration import Bridge, ChannelSettings
from strainsight.measurements.clock import NO_DELAY, Delay
from strainsight.measurements.csv_file import read_csv
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.csv_rows import check_marks
from strainsight.measurements.reader import read_recording
from strainsight.measurements.records import Recording, required_unit, suggest_unit
from strainsight.rom.model import Damping

LOADS = ("force", "moment", "pressure", "acceleration", "ratio", "angular velocity squared")

QUANTITY = {
    "N": "force",
    "N m": "moment",
    "Pa": "pressure",
    "1": "ratio",
    "m/s²": "acceleration",
    "rad²/s²": "angular velocity squared",
}
"""Unit of a load → quantity in a file."""
NO_UNIT = ("-", "–")
NO_GAPS = "A load history must not have gaps. Enter the value, or delete this line of the file."


def recorded(key: str, config: RecordedSection, path: Path, of: Sequence[str] = LOADS) -> FromSamples:
    """Read a load history from a text table; key: of the signal; of: allowed quantities.

    Time in s, values in the SI unit of the load or in the unit after the column name, as in "F [kN]". Raises UserError with
    file:line for an invalid table, a missing sample, and a time that does not increase."""
    column = config.value_column
    with blame(key):
        try:
            recording = _read(path, config.time_column, column)
        except UserError as error:
            if error.key in (config.time_column, column):
                error.key = f"{key}.{'value' if error.key == column else 'time'}_column"
            raise
        values = recording.channels[column]
        missing = np.flatnonzero(np.isnan(values))
        if missing.size:
            raise UserError(
                f"missing value in column {column!r}", where=recording.place(int(missing[0])), remedy=NO_GAPS
            )
        check_marks(recording, column, recording.units[column] or "", NO_GAPS, negative=True)
        back = np.flatnonzero(np.diff(recording.time) <= 0)
        if back.size:
            i = int(back[0])
            raise UserError(
                f"the time does not increase from {recording.time[i]:.9g} s to {recording.time[i + 1]:.9g} s",
                where=recording.place(i + 1),
                remedy="Sort the lines of the file by time, and delete lines with repeated times.",
            )
        return FromSamples(recording.time, values * _factor(column, recording, path, of))


def _read(path: Path, time: str, column: str) -> Recording:
    """Read two columns with decimal points or commas, and the time in s or in the unit of the file."""
    first: UserError | None = None
    for form, unit in product((TextFormat(), TextFormat(decimal=",")), ("s", None)):
        try:
            return read_csv(path, [column], time=time, time_unit=unit, form=form)
        except UserError as error:
            first = first or error
    assert first is not None
    raise first


def _factor(column: str, recording: Recording, path: Path, of: Sequence[str]) -> float:
    """Conversion factor from the unit of the file to SI, 1 without a unit. Raises ConfigError for an unknown unit or another
    quantity."""
    name = recording.units[column] or _in_round_brackets(column)
    if name is None or name in NO_UNIT:
        return 1.0
    try:
        unit = required_unit(name, of)
    except UserError as error:
        raise ConfigError(f"unknown unit {name} of column {column!r} in {path.name}", remedy=error.remedy) from None
    if unit.quantity not in of:
        of_load = set(of) <= set(LOADS)
        what = ("a load" if len(of) > 1 else of[0]) if of_load else " or ".join(of)
        raise ConfigError(
            f"column {column!r} in {path.name} has the unit {name}, which is not a unit of {what}",
            remedy=f"Set value_column to the column of {'the load' if of_load else what}.",
        )
    return unit.factor


def _in_round_brackets(column: str) -> str | None:
    """Unknown unit in round brackets after a name, as in "F (KN)"; known units are removed by the reader."""
    inside = column.rstrip().removesuffix(")").rpartition("(")[2].strip() if column.rstrip().endswith(")") else ""
    return inside if inside and suggest_unit(inside) else None


def signals_of(
    settings: RecordedFile, section: str, path: Path, wanted: Mapping[str, Channel], step: float | None = None
) -> Signals:
    """Channels in the order of `wanted` (config key → settings), in SI units, at the sampling of the file or at `step` [s].

    section: of `settings` in the config. Raises ConfigError for a channel that is used twice, and UserError, with the key of the
    channel, if the file does not match the config."""
    text = settings.text
    names = [entry.channel for entry in wanted.values()]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise ConfigError(
                f"two entries of the config use channel {name!r} of the file",
                key=f"{list(wanted)[i]}.channel",
                remedy="Assign another channel to one of the two entries.",
            )
    with blame(f"{section}.text"):
        form = TextFormat(
            text.delimiter, text.decimal, text.comment, text.header_line, tuple(text.missing), f"{section}.text"
        )
    with blame(f"{section}.file"):
        keys = {entry.channel: key for key, entry in wanted.items()}
        try:
            recording = read_recording(
                path,
                names,
                time=settings.time.channel,
                time_unit=settings.time.unit if settings.time.channel is not None else None,
                rate=settings.time.hertz,
                format=settings.format,
                form=form,
            )
        except UserError as error:  # a missing column
            if error.key is not None and error.key == settings.time.channel:
                error.key = f"{section}.time.channel"
            elif error.key in keys:
                error.key = f"{keys[error.key]}.channel"
            raise
        calibrations = {}
        for key, entry in wanted.items():
            with blame(key):
                calibrations[entry.channel] = _calibration(entry)
        try:
            return assemble(recording, calibrations, step)
        except UserError as error:
            error.key = keys.get(error.key or "", error.key)
            raise


def _calibration(entry: Channel) -> ChannelSettings:
    bridge = entry.bridge
    common = ("unit", "offset", "drift", "zero", "scale", "sign", "override", "missing")
    return ChannelSettings(
        bridge=None if bridge is None else Bridge(bridge.arrangement, bridge.gauge_factor, bridge.poisson_ratio),
        delay=_delay(entry.delay),
        **{name: getattr(entry, name) for name in common},
    )


def _delay(setting: DelayInSamples | DelayInSeconds | None) -> Delay:
    if setting is None:
        return NO_DELAY
    return Delay(samples=setting.samples) if isinstance(setting, DelayInSamples) else Delay(seconds=setting.seconds)


def delay_in_seconds(setting: DelayInSamples | DelayInSeconds | None, step: float) -> float:
    """Delay [s] of a channel with sampling interval `step` [s], negative if early."""
    delay = _delay(setting)
    return delay.samples * step + delay.seconds


SIGNALS: dict[str, Callable[..., Signal]] = {
    "constant": Constant,
    "sine": Sine,
    "sweep": Sweep,
    "multisine": MultiSine,
    "ramp": Ramp,
}
"""Signal type in a config → class, whose fields have the names of the config keys, except FREQUENCIES."""
FREQUENCIES = {"start_frequency": "start", "end_frequency": "stop"}
"""Config key of a sweep → field."""


def signal_of(name: str, config: Section, files: Mapping[str, Path], section: str = "loads") -> Signal:
    """Load history of the entry `name` of a config section."""
    return signal_at(f"{section}.{name}.signal", config, files)


def signal_at(key: str, config: Section, files: Mapping[str, Path], of: Sequence[str] = LOADS) -> Signal:
    """Load history at a config key; of: quantities allowed in a file."""
    if isinstance(config, RecordedSection):
        return recorded(key, config, files[f"{key}.file"], of)
    fields = dict(config)
    kind = SIGNALS[fields.pop("type")]
    return kind(**{FREQUENCIES.get(name, name): value for name, value in fields.items()})


def damping_of(config: ModalDamping | RayleighDamping) -> Damping:
    """Damping law of the config."""
    if config.type == "modal":
        return Damping("modal", ratio=config.ratio)
    return Damping("rayleigh", alpha=config.alpha, beta=config.beta)


def named_regions(region: RegionKey | tuple[RegionKey, ...] | None) -> tuple[RegionKey, ...]:
    """Regions of a config entry as a tuple."""
    if region is None:
        return ()
    return region if isinstance(region, tuple) else (region,)

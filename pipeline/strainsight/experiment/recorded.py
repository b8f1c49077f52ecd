"""What both a structure and a bench read of a config: files of tests and load histories, damping, regions by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from strainsight.config.base import Section
from strainsight.config.estimate import Channel, DelayInSamples, DelayInSeconds, RecordedFile
from strainsight.config.loads import RecordedSection
from strainsight.config.mesh import RegionKey
from strainsight.config.placement import ModalDamping, RayleighDamping
from strainsight.errors import ConfigError, UserError, blame
from strainsight.loads.histories import Constant, FromSamples, MultiSine, Ramp, Signal, Sine, Sweep
from strainsight.measurements.assemble import Signals, assemble
from strainsight.measurements.calibration import Bridge, ChannelSettings
from strainsight.measurements.clock import NO_DELAY, Delay
from strainsight.measurements.csv_file import read_csv
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.csv_rows import check_marks
from strainsight.measurements.reader import read_recording
from strainsight.measurements.records import Recording, meant_by, required_unit
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
"""Unit of a load → what a file may hold of it."""
NO_UNIT = ("-", "–")
NO_GAPS = "a load history has no gaps: give the value, or drop the line"


def recorded(key: str, config: RecordedSection, path: Path, of: Sequence[str] = LOADS) -> FromSamples:
    """The history that the text table at `path` holds in the columns that the config names; key: of the signal; of: the
    quantities that it may be of.

    Time in s, values in the SI unit of the load, or in the unit that stands behind the name of the column, as in "F [kN]".
    Raises UserError with file:line for what is no table, a sample that is missing, and a time that does not increase.
    """
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
            raise UserError(f"no sample under {column!r}", where=recording.place(int(missing[0])), remedy=NO_GAPS)
        check_marks(recording, column, recording.units[column] or "", NO_GAPS, negative=True)
        back = np.flatnonzero(np.diff(recording.time) <= 0)
        if back.size:
            i = int(back[0])
            raise UserError(
                f"the time does not increase from {recording.time[i]:.9g} s to {recording.time[i + 1]:.9g} s",
                where=recording.place(i + 1),
                remedy="sort the record and drop repeated times",
            )
        return FromSamples(recording.time, values * _factor(column, recording, path, of))


def _read(path: Path, time: str, column: str) -> Recording:
    """The two columns: with decimal points or else commas, the time in s or else in the unit that the file states."""
    first: UserError | None = None
    for form, unit in product((TextFormat(), TextFormat(decimal=",")), ("s", None)):
        try:
            return read_csv(path, [column], time=time, time_unit=unit, form=form)
        except UserError as error:
            first = first or error
    assert first is not None
    raise first


def _factor(column: str, recording: Recording, path: Path, of: Sequence[str]) -> float:
    """SI units in one of the unit that the file states, 1 where it states none. Raises ConfigError for one that is not known, or
    of another quantity."""
    stated = recording.units[column] or _in_round_brackets(column)
    if stated is None or stated in NO_UNIT:
        return 1.0
    try:
        unit = required_unit(stated, of)
    except UserError as error:
        raise ConfigError(
            f"{column!r} is in {stated}, {path.name} says: no unit that is known", remedy=error.remedy
        ) from None
    if unit.quantity not in of:
        of_load = set(of) <= set(LOADS)
        what = ("a load" if len(of) > 1 else f"a load that is a {of[0]}") if of_load else " or ".join(of)
        raise ConfigError(
            f"{column!r} is in {stated}, {path.name} says: no unit of {what}",
            remedy=f"name the column of {'the load' if of_load else 'what the history is of'}",
        )
    return unit.factor


def _in_round_brackets(column: str) -> str | None:
    """What stands behind a name, as in "F (KN)", where it is almost a unit: a known one was taken off by the reader."""
    inside = column.rstrip().removesuffix(")").rpartition("(")[2].strip() if column.rstrip().endswith(")") else ""
    return inside if inside and meant_by(inside) else None


def signals_of(
    settings: RecordedFile, section: str, path: Path, wanted: Mapping[str, Channel], step: float | None = None
) -> Signals:
    """The channels in the order of `wanted` (config key → settings), in SI units, on the clock of the file or one of `step` [s].

    section of the config that `settings` are. Raises ConfigError for a channel that is used twice, and UserError for what the
    file contradicts, with the key of the channel.
    """
    text = settings.text
    names = [entry.channel for entry in wanted.values()]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise ConfigError(
                f"channel {name!r} of the file is used twice", key=f"{list(wanted)[i]}.channel", remedy="check both"
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
        except UserError as error:  # of a column that is not there
            if error.key is not None and error.key == settings.time.channel:
                error.key = f"{section}.time.channel"
            elif error.key in keys:
                error.key = f"{keys[error.key]}.channel"
            raise
        stated = {}
        for key, entry in wanted.items():
            with blame(key):
                stated[entry.channel] = _calibration(entry)
        try:
            return assemble(recording, stated, step)
        except UserError as error:
            error.key = keys.get(error.key or "", error.key)
            raise


def _calibration(entry: Channel) -> ChannelSettings:
    bridge = entry.bridge
    alike = ("unit", "offset", "drift", "zero", "scale", "sign", "override", "missing")
    return ChannelSettings(
        bridge=None if bridge is None else Bridge(bridge.arrangement, bridge.gauge_factor, bridge.poisson_ratio),
        delay=_delay(entry.delay),
        **{name: getattr(entry, name) for name in alike},
    )


def _delay(stated: DelayInSamples | DelayInSeconds | None) -> Delay:
    if stated is None:
        return NO_DELAY
    return Delay(samples=stated.samples) if isinstance(stated, DelayInSamples) else Delay(seconds=stated.seconds)


def delay_in_seconds(stated: DelayInSamples | DelayInSeconds | None, step: float) -> float:
    """Of a channel that has a sample every `step` [s]; negative: early."""
    delay = _delay(stated)
    return delay.samples * step + delay.seconds


SIGNALS: dict[str, Callable[..., Signal]] = {
    "constant": Constant,
    "sine": Sine,
    "sweep": Sweep,
    "multisine": MultiSine,
    "ramp": Ramp,
}
"""Type of a signal in a config → the history, whose fields have the names of the config's, but for FREQUENCIES."""
FREQUENCIES = {"start_frequency": "start", "end_frequency": "stop"}
"""Of a sweep: key of the config → field."""


def signal_of(name: str, config: Section, files: Mapping[str, Path], section: str = "loads") -> Signal:
    """A load history, of the entry `name` of a section of the config."""
    return signal_at(f"{section}.{name}.signal", config, files)


def signal_at(key: str, config: Section, files: Mapping[str, Path], of: Sequence[str] = LOADS) -> Signal:
    """The history that stands at a key of the config; of: the quantities that a file may hold of it."""
    if isinstance(config, RecordedSection):
        return recorded(key, config, files[f"{key}.file"], of)
    stated = dict(config)
    kind = SIGNALS[stated.pop("type")]
    return kind(**{FREQUENCIES.get(name, name): value for name, value in stated.items()})


def damping_of(config: ModalDamping | RayleighDamping) -> Damping:
    """The damping law."""
    if config.type == "modal":
        return Damping("modal", ratio=config.ratio)
    return Damping("rayleigh", alpha=config.alpha, beta=config.beta)


def named_regions(region: RegionKey | tuple[RegionKey, ...] | None) -> tuple[RegionKey, ...]:
    """The regions that a config names, which may be one."""
    if region is None:
        return ()
    return region if isinstance(region, tuple) else (region,)

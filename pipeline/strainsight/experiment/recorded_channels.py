"""Channels of a test's file, as a config names and calibrates them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from strainsight.config.estimate import Channel, DelayInSamples, DelayInSeconds, RecordedFile
from strainsight.errors import ConfigError, UserError, blame
from strainsight.measurements.assemble import Signals, assemble
from strainsight.measurements.bridges import Bridge
from strainsight.measurements.calibration import ChannelSettings
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.delay import NO_DELAY, Delay
from strainsight.measurements.reader import read_recording


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
    return ChannelSettings(
        unit=entry.unit,
        bridge=None if bridge is None else Bridge(bridge.arrangement, bridge.gauge_factor, bridge.poisson_ratio),
        offset=entry.offset,
        drift=entry.drift,
        zero=entry.zero,
        scale=entry.scale,
        sign=entry.sign,
        override=entry.override,
        delay=_delay(entry.delay),
        missing=entry.missing,
    )


def _delay(stated: DelayInSamples | DelayInSeconds | None) -> Delay:
    if stated is None:
        return NO_DELAY
    return Delay(samples=stated.samples) if isinstance(stated, DelayInSamples) else Delay(seconds=stated.seconds)


def delay_in_seconds(stated: DelayInSamples | DelayInSeconds | None, step: float) -> float:
    """Of a channel that has a sample every `step` [s]; negative: early."""
    own = _delay(stated)
    return own.samples * step + own.seconds

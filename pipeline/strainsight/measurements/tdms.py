"""Channels of a TDMS file, scaled and with the clock of their waveform. Runs in a child process, see reader.py."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.assemble import Place, check_one_clock, find_channel, numbers
from strainsight.measurements.records import DAMAGED, Signals, one_unit, quote

_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit", "units")
"""Properties with a unit: of DAQmx, DIAdem, and common names."""
_SCALE_TYPE = re.compile(r"NI_Scale\[\d+\]_Scale_Type")
_SCALES = (
    *("Add", "AdvancedAPI", "Linear", "Polynomial", "RTD", "Strain", "Subtract", "Table", "Thermistor"),
    *("Thermocouple",),
)
"""Scales that npTDMS applies."""


def signals(path: Path, names: Sequence[str | None]) -> Signals:
    """Time (T,), and scaled values (T,) with NaN as in the file, of every name after the first, and units.

    names: a time channel, or None for the time of the waveform, then "channel" or "group/channel". Sample k of a
    waveform was measured at wf_start_offset + k wf_increment [s] after wf_start_time, if channels differ in it. Raises
    UserError for channels that are missing, truncated, not numeric, or on several clocks."""
    from nptdms import TdmsFile

    with path.open("rb") as stream, TdmsFile.open(stream) as file:  # with an open file, no separate index file is used
        listed_channels = [
            (g, group.name, channel) for g, group in enumerate(file.groups()) for channel in group.channels()
        ]
        places = [Place(group, channel.name, g) for g, group, channel in listed_channels]
        time, *channels = names
        wanted = {name: listed_channels[find_channel(name, places, path)][2] for name in channels if name is not None}
        _check_complete(file, path)
        if time is None:
            clocks = _waveform_clocks(wanted, places, path)
            check_one_clock(clocks, path)
            yield next(iter(clocks.values())), "s"
        else:
            yield _time_channel(_chosen_time(listed_channels, places, time, wanted, path), time, path)
        for name, channel in wanted.items():
            for item in (channel, file[channel.group_name], file):
                _check_scales(item.properties, name, path)
            values, unit = _values(channel, name, path)
            yield numbers(values, name, str(path)), unit


def _check_complete(file: Any, path: Path) -> None:
    """Raise UserError if writing stopped in the middle, so that channels have different lengths."""
    status = file.file_status
    if status.incomplete_final_segment:
        short = [
            f"{name} {channel_status.read_length} of {channel_status.expected_length}"
            for name, channel_status in (status.channel_statuses or {}).items()
            if channel_status.read_length < channel_status.expected_length
        ]
        raise UserError(
            "the last segment of the file is incomplete"
            + (f"; samples per channel: {', '.join(short[:5])}" if short else ""),
            where=str(path),
            remedy="copy the file again; if the measurement stopped there, save the file again with DIAdem or another "
            "TDMS program",
        )


def _check_scales(properties: Mapping[str, Any], name: str, path: Path) -> None:
    """Raise UserError for a scale that npTDMS would ignore, returning raw values."""
    for key, kind in properties.items():
        unscaled = properties.get("NI_Scaling_Status", "unscaled") != "scaled"
        if _SCALE_TYPE.fullmatch(key) and kind not in _SCALES and unscaled:
            raise UserError(
                f"channel {name!r} has a scale of type {quote(str(kind))}, which is not supported",
                where=str(path),
                remedy="save scaled values instead of raw values, for example with DIAdem",
            )


def _waveform_clocks(wanted: dict[str, Any], places: Sequence[Place], path: Path) -> dict[str, np.ndarray]:
    """Name → times (T,) [s] from the properties of its waveform."""
    clocks: dict[str, np.ndarray] = {}
    first = None
    for name, channel in wanted.items():
        step = channel.properties.get("wf_increment")
        if not isinstance(step, float | int) or not 0 < step < np.inf:
            times = [place.names[1] for place in places if any(word in place.name.lower() for word in ("time", "zeit"))]
            raise UserError(
                f"channel {name!r} has no wf_increment (sampling interval)"
                if step is None
                else f"channel {name!r} has the invalid wf_increment {step!r} (sampling interval)",
                where=str(path),
                remedy="specify the time channel in estimate.time.channel"
                + (
                    f", for example {' or '.join(map(quote, times[:5]))}"
                    if times
                    else "; without a time channel, record the data as waveforms"
                ),
            )
        start = channel.properties.get("wf_start_time")
        first = start if first is None else first
        behind = 0.0 if start is None or first is None else (start - first) / np.timedelta64(1, "s")
        offset = float(channel.properties.get("wf_start_offset", 0.0)) + behind
        clocks[name] = offset + float(step) * np.arange(len(channel))
    return clocks


def _chosen_time(
    listed_channels: Sequence[tuple[int, str, Any]],
    places: Sequence[Place],
    time: str,
    wanted: dict[str, Any],
    path: Path,
) -> Any:
    try:
        return listed_channels[find_channel(time, places, path)][2]
    except UserError as error:
        if wanted and all("wf_increment" in channel.properties for channel in wanted.values()):
            error.remedy = (
                "remove estimate.time.channel, or set it to null, because the waveforms define their time; "
                f"{error.remedy}"
            )
        raise


def _time_channel(channel: Any, name: str, path: Path) -> tuple[np.ndarray, str | None]:
    """Times of a channel: numbers, or time stamps, which are counted from the first one."""
    values, unit = _values(channel, name, path)
    if values.dtype.kind == "M" and values.size:
        return (values - values[0]) / np.timedelta64(1, "s"), "s"
    return numbers(values, name, str(path)), unit


def _values(channel: Any, name: str, path: Path) -> tuple[np.ndarray, str | None]:
    if len(channel) > path.stat().st_size:
        raise UserError(
            f"channel {name!r} has {len(channel)} samples according to the file, which has only {path.stat().st_size} bytes",
            where=str(path),
            remedy=DAMAGED,
        )
    unit = one_unit([str(channel.properties.get(word, "")) for word in _UNITS], name, str(path))
    return np.asarray(channel[:]), unit

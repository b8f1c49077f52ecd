"""Channels of a TDMS file: found, scaled, on the clock of their waveform. Read in a child process, see reader.py."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.assemble import Place, check_one_clock, chosen, numbers
from strainsight.measurements.records import DAMAGED, Signals, one_unit, plain

_UNITS = ("unit_string", "NI_UnitDescription", "unit", "Unit", "units")
"""Properties that hold a unit: of DAQmx and DIAdem, and what people write."""
_SCALE_TYPE = re.compile(r"NI_Scale\[\d+\]_Scale_Type")
_SCALES = (
    *("Add", "AdvancedAPI", "Linear", "Polynomial", "RTD", "Strain", "Subtract", "Table", "Thermistor"),
    *("Thermocouple",),
)
"""Those that npTDMS applies."""


def signals(path: Path, names: Sequence[str | None]) -> Signals:
    """Time (T,) and values (T,) of every name behind the first, scaled, NaN as the file has it, and units.

    names: that of a time channel, or None for the waveform's own time, then "channel" or "group/channel". Waveform: sample
    k was taken at wf_start_offset + k wf_increment [s], behind wf_start_time where channels differ in that.
    Raises UserError for channels that are missing, cut short, no numbers, or of several clocks.
    """
    from nptdms import TdmsFile

    with path.open("rb") as opened, TdmsFile.open(opened) as file:  # of an open file no index beside it is taken
        held = [(g, group.name, channel) for g, group in enumerate(file.groups()) for channel in group.channels()]
        places = [Place(group, channel.name, g) for g, group, channel in held]
        time, *channels = names
        wanted = {name: held[chosen(name, places, path)][2] for name in channels if name is not None}
        _check_complete(file, path)
        if time is None:
            clocks = _waveform_clocks(wanted, places, path)
            check_one_clock(clocks, path)
            yield next(iter(clocks.values())), "s"
        else:
            yield _time_channel(_chosen_time(held, places, time, wanted, path), time, path)
        for name, channel in wanted.items():
            for item in (channel, file[channel.group_name], file):
                _check_scales(item.properties, name, path)
            values, unit = _values(channel, name, path)
            yield numbers(values, name, str(path)), unit


def _check_complete(file: Any, path: Path) -> None:
    """Raise UserError where the writing stopped in the middle: what a channel has left is then of different lengths."""
    status = file.file_status
    if status.incomplete_final_segment:
        short = [
            f"{name} {found.read_length} of {found.expected_length}"
            for name, found in (status.channel_statuses or {}).items()
            if found.read_length < found.expected_length
        ]
        raise UserError(
            "the file ends in the middle of its last segment"
            + (f", samples there: {', '.join(short[:5])}" if short else ""),
            where=str(path),
            remedy="copy it again; where the rig stopped there, save what there is anew, with DIAdem or another TDMS program",
        )


def _check_scales(properties: Mapping[str, Any], name: str, path: Path) -> None:
    """Raise UserError for a scale that npTDMS does not know: it would leave it out, and give raw values."""
    for key, kind in properties.items():
        unscaled = properties.get("NI_Scaling_Status", "unscaled") != "scaled"
        if _SCALE_TYPE.fullmatch(key) and kind not in _SCALES and unscaled:
            raise UserError(
                f"{name!r} has a scale of the type {plain(str(kind))}, which is not supported",
                where=str(path),
                remedy="save the channel scaled, as DIAdem does, or with a scale of another type",
            )


def _waveform_clocks(wanted: dict[str, Any], places: Sequence[Place], path: Path) -> dict[str, np.ndarray]:
    """Name → times (T,) [s] by the properties of its waveform."""
    found: dict[str, np.ndarray] = {}
    first = None
    for name, channel in wanted.items():
        step = channel.properties.get("wf_increment")
        if not isinstance(step, float | int) or not 0 < step < np.inf:
            times = [place.names[1] for place in places if any(word in place.name.lower() for word in ("time", "zeit"))]
            raise UserError(
                f"{name!r} has no wf_increment, the interval between its samples"
                if step is None
                else f"{name!r} has a wf_increment of {step!r}",
                where=str(path),
                remedy="name the channel of the time in estimate.time.channel"
                + (
                    f", as {' or '.join(map(plain, times[:5]))}"
                    if times
                    else "; where there is none, record it as a waveform"
                ),
            )
        start = channel.properties.get("wf_start_time")
        first = start if first is None else first
        behind = 0.0 if start is None or first is None else (start - first) / np.timedelta64(1, "s")
        offset = float(channel.properties.get("wf_start_offset", 0.0)) + behind
        found[name] = offset + float(step) * np.arange(len(channel))
    return found


def _chosen_time(
    held: Sequence[tuple[int, str, Any]], places: Sequence[Place], time: str, wanted: dict[str, Any], path: Path
) -> Any:
    try:
        return held[chosen(time, places, path)][2]
    except UserError as error:
        if wanted and all("wf_increment" in channel.properties for channel in wanted.values()):
            error.remedy = (
                f"leave estimate.time.channel out, or null: the waveforms have a time of their own; {error.remedy}"
            )
        raise


def _time_channel(channel: Any, name: str, path: Path) -> tuple[np.ndarray, str | None]:
    """Times of a channel: numbers, or time stamps, which then count from the first one."""
    values, unit = _values(channel, name, path)
    if values.dtype.kind == "M" and values.size:
        return (values - values[0]) / np.timedelta64(1, "s"), "s"
    return numbers(values, name, str(path)), unit


def _values(channel: Any, name: str, path: Path) -> tuple[np.ndarray, str | None]:
    if len(channel) > path.stat().st_size:
        raise UserError(
            f"{name!r} claims {len(channel)} samples in a file of {path.stat().st_size} bytes",
            where=str(path),
            remedy=DAMAGED,
        )
    unit = one_unit([str(channel.properties.get(word, "")) for word in _UNITS], name, str(path))
    return np.asarray(channel[:]), unit

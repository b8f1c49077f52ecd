"""Channels of an MDF file: found, scaled, their invalid samples taken out. Read in a child process, see daq_file.py."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.grouped import Place, check_one_clock, chosen, numbers
from strainsight.measurements.hdf5_datasets import MOST_SAMPLES
from strainsight.measurements.sandbox import Signals

_TIME = 1
"""Synchronisation type of a master channel that is a time."""
_OTHER = {2: "an angle", 3: "a distance", 4: "an index"}


def signals(path: Path, names: Sequence[str | None]) -> Signals:
    """Time (T,) and values (T,) of every name behind the first, physical, NaN where an invalidation bit is set, and units.

    names: that of a time channel, or None or its own name for the master channel, then "channel", or "group/channel" by the
    acquisition name of the group, or by its number from 0.
    Raises UserError for channels that are missing, no numbers, or of several clocks.
    """
    from asammdf import MDF

    with MDF(path) as file:
        places, at = _places(file)
        time, *channels = names
        wanted = {name: at[chosen(name, places, path)] for name in channels if name is not None}
        clock: np.ndarray
        unit: str | None
        if time is None or time in _master_names(file) - {place.name for place in places}:
            clock, unit = _master_clock(file, wanted, path)
        else:
            clock, unit = _time_channel(file, time, at[chosen(time, places, path)], wanted, path)
        yield clock, unit
        for name, (group, channel) in wanted.items():
            yield _values(file, name, group, channel, path)


def _places(file: Any) -> tuple[list[Place], list[tuple[int, int]]]:
    """The channels that are no master, and their group and channel numbers."""
    places, at = [], []
    for g, group in enumerate(file.groups):
        label = getattr(group.channel_group, "acq_name", "") or ""
        for c, channel in enumerate(group.channels):
            if file.masters_db.get(g) != c:
                places.append(Place(label, channel.name, g))
                at.append((g, c))
    return places, at


def _master_names(file: Any) -> set[str]:
    return {file.groups[group].channels[number].name for group, number in file.masters_db.items()}


def _master_group(file: Any, group: int) -> int:
    """The group that holds the master channel: another one where columns are stored by themselves, as MDF 4.2 may."""
    other = getattr(file.groups[group].channel_group, "cg_master_index", None)
    return group if other is None else int(other)


def _master_clock(file: Any, wanted: dict[str, tuple[int, int]], path: Path) -> tuple[np.ndarray, str]:
    """The one time of all groups that are wanted, and its unit."""
    clocks, unit = {}, "s"
    masters = {name: _master_group(file, group) for name, (group, _) in wanted.items()}
    for name, group in masters.items():
        if group in clocks:
            continue
        _check_size(file, group, name, path)
        if (number := file.masters_db.get(group)) is None:
            raise UserError(
                f"the group of {name!r} has no master channel, which would be its time",
                where=str(path),
                remedy="name the channel of the time in estimate.time.channel, or export with a time",
            )
        master = file.groups[group].channels[number]
        kind = getattr(master, "sync_type", _TIME)
        if kind in _OTHER:
            raise UserError(
                f"the master channel of {name!r}, {master.name!r}, is {_OTHER[kind]}, not a time",
                where=str(path),
                remedy="name the channel of the time in estimate.time.channel, or export over time",
            )
        unit = getattr(master, "unit", "") or "s"
        clocks[group] = np.asarray(file.get_master(group), dtype=float)
    by_name = {name: clocks[group] for name, group in masters.items()}
    check_one_clock(by_name, path)
    return next(iter(by_name.values())), unit


def _time_channel(
    file: Any, time: str, at: tuple[int, int], wanted: dict[str, tuple[int, int]], path: Path
) -> tuple[np.ndarray, str | None]:
    for name, (group, _) in wanted.items():
        if _master_group(file, group) != _master_group(file, at[0]):
            raise UserError(
                f"the time {time!r} and {name!r} are of different groups",
                where=str(path),
                remedy="leave estimate.time.channel out: every group has its master channel; or take channels of one group",
            )
    return _values(file, time, *at, path)


def _check_size(file: Any, group: int, name: str, path: Path) -> None:
    if (samples := file.groups[group].channel_group.cycles_nr) > MOST_SAMPLES:
        raise UserError(
            f"{name!r} claims {samples} samples",
            where=str(path),
            remedy=f"cut the record: the limit is {MOST_SAMPLES} samples",
        )


def _values(file: Any, name: str, group: int, channel: int, path: Path) -> tuple[np.ndarray, str | None]:
    _check_size(file, group, name, path)
    found = file.get(group=group, index=channel, ignore_invalidation_bits=True)
    values = numbers(np.asarray(found.samples), name, str(path))
    if found.invalidation_bits is not None:
        values[np.asarray(found.invalidation_bits, dtype=bool)] = np.nan
    return values, (found.unit or "").strip() or None

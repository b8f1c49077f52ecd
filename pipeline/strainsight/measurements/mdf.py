"""Physical channels of an MDF file without invalid samples. Runs in a child process, see reader.py.

asammdf reads only raw values, because it would pass conversion formulas, which are text of the file, to `eval`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import IO, Any
from unittest.mock import patch
from zipfile import ZipFile

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.assemble import Place, check_one_clock, find_channel, numbers
from strainsight.measurements.mdf_conversion import to_physical
from strainsight.measurements.records import DAMAGED, Signals, check_count

_TIME = 1
"""Synchronisation type of a time master channel."""
_OTHER = {2: "an angle", 3: "a distance", 4: "an index"}
PACKING = 100
"""Largest compression ratio of an archive."""
_ZIP = b"PK\3\4"
_ENDINGS = (".mf4", ".mdf", ".dat")
_HEAD, _UNFINALIZED = 64, slice(60, 64)
"""Size of the identification block, and its bytes that mark an unfinalized file."""
Rules = dict[tuple[int, int], Any]


def signals(path: Path, names: Sequence[str | None]) -> Signals:
    """Time (T,) and physical values (T,) of every name after the first, NaN for invalid samples, and units.

    names: a time channel, or None or the name of the master channel, then "channel", or "group/channel" with the acquisition
    name of the group, or its number from 0. Raises UserError for channels that are missing, not numeric, or on several clocks.
    """
    with _opened(path) as file:
        rules = _take_rules(file)
        places, at = _places(file)
        time, *channels = names
        wanted = {name: at[find_channel(name, places, path)] for name in channels if name is not None}
        clock: np.ndarray
        unit: str | None
        masters = {file.groups[group].channels[number].name for group, number in file.masters_db.items()}
        if time is None or time in masters - {place.name for place in places}:
            clock, unit = _master_clock(file, rules, wanted, path)
        else:
            clock, unit = _time_channel(file, rules, time, at[find_channel(time, places, path)], wanted, path)
        yield clock, unit
        for name, (group, channel) in wanted.items():
            yield _values(file, rules, name, group, channel, path)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """File of asammdf from a stream; it creates no files and does not process buses."""
    library = import_module("asammdf")
    with ExitStack() as stack:
        for version in (3, 4):
            # unsorted blocks would be written to a named file, which a killed process would leave behind
            stack.enter_context(patch(f"asammdf.blocks.mdf_v{version}.NamedTemporaryFile", lambda dir: BytesIO()))
        stream = stack.enter_context(_open_stream(path))
        yield stack.enter_context(library.MDF(stream, process_bus_logging=False))


def _open_stream(path: Path) -> IO[bytes]:
    """The file, or the member of an archive; an unfinalized file is copied into memory, because asammdf completes it in place."""
    file: IO[bytes] = path.open("rb")
    if file.read(len(_ZIP)) == _ZIP:
        with ZipFile(file) as archive:
            member = next((item for item in archive.infolist() if item.filename.lower().endswith(_ENDINGS)), None)
            if member is None:
                raise UserError(
                    f"the archive contains no file with the ending {' or '.join(_ENDINGS)}",
                    where=str(path),
                    remedy="unpack the archive and specify the measurement file",
                )
            size = path.stat().st_size
            if member.file_size > PACKING * size:
                raise UserError(
                    f"the archive of {size} bytes unpacks to {member.file_size} bytes, more than {PACKING} times its size",
                    where=str(path),
                    remedy="unpack the archive and specify the measurement file",
                )
            file = BytesIO(archive.read(member))
    file.seek(0)
    head = file.read(_HEAD)
    if head.startswith(b"UnFin") or any(head[_UNFINALIZED]):
        file.seek(0)
        file = BytesIO(file.read())
    file.seek(0)
    return file


def _take_rules(file: Any) -> Rules:
    """The conversion rules by group and channel, removed from asammdf so that it cannot apply them."""
    rules = {}
    for g, group in enumerate(file.groups):
        for c, channel in enumerate(group.channels):
            rules[g, c] = channel.conversion
            channel.conversion = None
    return rules


def _places(file: Any) -> tuple[list[Place], list[tuple[int, int]]]:
    """Channels that are not masters, with their group and channel numbers."""
    groups = list(enumerate(file.groups))
    at = [(g, c) for g, group in groups for c in range(len(group.channels)) if file.masters_db.get(g) != c]
    labels = [getattr(group.channel_group, "acq_name", "") or "" for _, group in groups]
    return [Place(labels[g], file.groups[g].channels[c].name, g) for g, c in at], at


def _master_group(file: Any, group: int) -> int:
    """Group of the master channel; another group if columns are stored separately (MDF 4.2)."""
    other = getattr(file.groups[group].channel_group, "cg_master_index", None)
    return group if other is None else int(other)


def _master_clock(file: Any, rules: Rules, wanted: dict[str, tuple[int, int]], path: Path) -> tuple[np.ndarray, str]:
    """The common time of all requested groups, and its unit."""
    clocks, unit = {}, "s"
    masters = {name: _master_group(file, group) for name, (group, _) in wanted.items()}
    for name, group in masters.items():
        if group in clocks:
            continue
        check_count(file.groups[group].channel_group.cycles_nr, name, str(path))
        if (number := file.masters_db.get(group)) is None:
            raise UserError(
                f"the channel group of {name!r} has no master channel that defines the time",
                where=str(path),
                remedy="specify the time channel in estimate.time.channel, or export the file with a time channel",
            )
        master = file.groups[group].channels[number]
        kind = getattr(master, "sync_type", _TIME)
        if kind in _OTHER:
            raise UserError(
                f"the master channel {master.name!r} of channel {name!r} is {_OTHER[kind]} instead of a time",
                where=str(path),
                remedy="specify the time channel in estimate.time.channel, or export the data with a time channel",
            )
        rule = _readable_rule(rules, (group, number), master, path)
        unit = _unit(master, rule) or "s"
        raw = np.asarray(file.get_master(group), dtype=float)
        clocks[group] = to_physical(raw, rule, _version(file), False, master.name, str(path))
    by_name = {name: clocks[group] for name, group in masters.items()}
    check_one_clock(by_name, path)
    return next(iter(by_name.values())), unit


def _time_channel(
    file: Any, rules: Rules, time: str, at: tuple[int, int], wanted: dict[str, tuple[int, int]], path: Path
) -> tuple[np.ndarray, str | None]:
    for name, (group, _) in wanted.items():
        if _master_group(file, group) != _master_group(file, at[0]):
            raise UserError(
                f"the time channel {time!r} and channel {name!r} belong to different channel groups",
                where=str(path),
                remedy="remove estimate.time.channel to use the master channel of each group, or use channels of one group",
            )
    return _values(file, rules, time, *at, path)


def _values(file: Any, rules: Rules, name: str, group: int, number: int, path: Path) -> tuple[np.ndarray, str | None]:
    check_count(file.groups[group].channel_group.cycles_nr, name, str(path))
    channel = file.groups[group].channels[number]
    samples, invalid = file.get(group=group, index=number, raw=True, samples_only=True, ignore_invalidation_bits=True)
    samples = np.asarray(samples)
    raw = numbers(samples, name, str(path))
    if invalid is not None:
        raw[np.asarray(invalid, dtype=bool)] = np.nan
    rule = _readable_rule(rules, (group, number), channel, path)
    values = to_physical(raw, rule, _version(file), samples.dtype.kind in "iu", name, str(path))
    return values, _unit(channel, rule)


def _version(file: Any) -> int:
    """Version 3 or 4; version 2 is treated as 3."""
    return max(3, int(str(file.version)[0]))


def _readable_rule(rules: Rules, at: tuple[int, int], channel: Any, path: Path) -> Any:
    """The rule of a channel. Raises UserError if the file has a rule that asammdf could not read."""
    if rules[at] is None and channel.conversion_addr:
        raise UserError(
            f"the conversion rule of channel {channel.name!r} cannot be read", where=str(path), remedy=DAMAGED
        )
    return rules[at]


def _unit(channel: Any, rule: Any) -> str | None:
    """Unit of the channel, or else of its rule."""
    return (getattr(channel, "unit", "") or getattr(rule, "unit", "") or "").strip() or None

"""Datasets of an HDF5 file: found, checked, read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.records import Signals, check_count, check_no_infinity, missing, one_unit, plain
from strainsight.memory import require_memory

LARGEST_CHUNK = 1 << 28
"""[bytes] that the library holds at once."""
PACKING = 1100
"""Bytes that one of the file may stand for: the most that deflate makes of it."""
AT_ONCE = 3
"""Copies of a channel that are there at once: as it stands, as numbers, and while it is sent."""
_HOPS = 16
_COLUMN = re.compile(r"(.*)\[(\d{1,9})\]")
_UNIT_NAMES = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
_PACKING = {"scale_factor": 1.0, "add_offset": 0.0}
INSTEAD = "write the samples into the file itself, one plain dataset a channel"


def signals(path: Path, names: Sequence[str]) -> Signals:
    """Values (T,) [unit of the file] of every name, NaN where missing, all as long as the first one, and their units.

    Raises UserError for links to other files, shapes, types and packed values that cannot be imported.
    """
    import h5py

    with h5py.File(path, "r") as file:
        samples: int | None = None
        for name in names:
            values, unit = _signal(file, name, path, samples)
            samples = values.size
            yield values, unit


def declared(path: Path, names: Sequence[str]) -> list[int]:
    """Bytes that each name unpacks to, its whole table where it is a column.

    Raises UserError as `signals` does before it reads a sample, and where memory does not hold all of them.
    """
    import h5py

    found, held = [], 0
    with h5py.File(path, "r") as file:
        samples: int | None = None
        for name in names:
            item, column = _checked(file, name, path, samples)
            samples = item.shape[0]
            found.append(int(item.nbytes))
            held = max(held, found[-1] if column is None else _held(item))
    require_memory(
        AT_ONCE * np.dtype(float).itemsize * (samples or 0) + held,
        f"{path}: a channel of {samples} samples",
        "cut the record, average samples, or take a larger machine",
    )
    return found


def _held(item: Any) -> int:
    """Bytes that are in memory while a column is read: its samples, and a row of the chunks that hold them, unpacked."""
    rows, columns = item.chunks or (0, 0)
    return int((item.shape[0] + rows * max(columns, item.shape[1])) * item.dtype.itemsize)


def _checked(file: Any, name: str, path: Path, samples: int | None) -> tuple[Any, int | None]:
    """The dataset of a name, and which column of it. Raises UserError where there is none that can be imported."""
    where = place_of(path, name)
    item, column = resolved(file, name, where), None
    if item is None and (found := _COLUMN.fullmatch(name)):
        item, column = resolved(file, found[1], where), int(found[2])
    if item is None:
        raise missing("dataset", name, datasets(file), str(path))
    _check(item, column, samples, path, where)
    return item, column


def _signal(file: Any, name: str, path: Path, samples: int | None) -> tuple[np.ndarray, str | None]:
    """Values (T,) of a dataset, or of a column of it, NaN where missing, and its unit."""
    where = place_of(path, name)
    item, column = _checked(file, name, path, samples)
    raw = item[...] if column is None else item[:, column]
    with np.errstate(over="ignore"):
        values = np.asarray(raw).reshape(-1).astype(float)
    for attribute in ("_FillValue", "missing_value"):
        if attribute in item.attrs:
            for word in np.atleast_1d(item.attrs[attribute]):
                values[np.asarray(raw).reshape(-1) == word] = np.nan
    check_no_infinity(values, name, where)
    return values, _unit(item, column, name, where)


def resolved(file: Any, name: str, where: str) -> Any:
    """The dataset, or None. Every link on the way is looked at first: one that leaves the file is never followed."""
    import h5py

    parts, group, hops = [part for part in name.split("/") if part], file, 0
    while parts:
        if not isinstance(group, h5py.Group) or (link := group.get(parts[0], getlink=True)) is None:
            return None
        if isinstance(link, h5py.ExternalLink):
            raise UserError(f"a link to another file, {plain(link.filename)}", where=where, remedy=INSTEAD)
        if isinstance(link, h5py.SoftLink):
            hops += 1
            if hops > _HOPS:
                raise UserError(f"more than {_HOPS} links behind each other", where=where, remedy=INSTEAD)
            group = file if link.path.startswith("/") else group
            parts = [part for part in link.path.split("/") if part and part != "."] + parts[1:]
            continue
        group, parts = group[parts[0]], parts[1:]
    return group if isinstance(group, h5py.Dataset) else None


def _check(item: Any, column: int | None, samples: int | None, path: Path, where: str) -> None:
    """Raise UserError unless the dataset holds numbers of its own, of a bearable size, in one column of `samples`."""
    shape, dtype = item.shape, item.dtype
    if item.is_virtual or item.external:
        raise UserError("takes its samples from another file", where=where, remedy=INSTEAD)
    if dtype.kind not in "iuf":
        raise UserError(f"holds {dtype}, not real numbers", where=where, remedy=INSTEAD)
    if shape is None or len(shape) not in (1, 2):
        raise UserError(f"has the shape {shape}", where=where, remedy=INSTEAD)
    if column is None and len(shape) == 2 and shape[1] != 1:
        raise UserError(
            f"has {shape[1]} columns", where=where, remedy=f"say which, from 0, as in '{item.name.strip('/')}[0]'"
        )
    if column is not None and (len(shape) != 2 or column >= shape[1]):
        raise UserError(
            f"has no column {column}: its shape is {shape}",
            where=where,
            remedy="columns count from 0, as in 'table[0]'",
        )
    check_count(shape[0], item.name, where)
    if samples is not None and shape[0] != samples:
        raise UserError(
            f"has {shape[0]} samples, the clock {samples}",
            where=where,
            remedy="give channels of one clock, or cut both",
        )
    check_stored(item, where, path.stat().st_size)
    for name, harmless in _PACKING.items():
        if name in item.attrs and np.any(item.attrs[name] != harmless):
            raise UserError(
                f"holds packed values: {name} is {item.attrs[name]}", where=where, remedy="write the values unpacked"
            )


def check_stored(item: Any, where: str, file_size: int) -> None:
    """Samples that were never written read as the fill value, mostly zero: they are no measurement."""
    if item.nbytes > PACKING * file_size:
        raise UserError(
            f"claims {item.nbytes} bytes in a file of {file_size}",
            where=where,
            remedy="cut the record where the writing stopped",
        )
    if item.chunks is not None:
        if np.prod([float(n) for n in item.chunks]) * item.dtype.itemsize > LARGEST_CHUNK:
            raise UserError(f"is stored in chunks of {item.chunks}", where=where, remedy="write it in smaller chunks")
        expected = int(np.prod([-(-n // c) for n, c in zip(item.shape, item.chunks, strict=True)]))
        written = item.id.get_num_chunks()
    else:
        expected, written = int(item.size > 0), int(item.id.get_storage_size() > 0)
    missing_says_nan = item.dtype.kind == "f" and np.isnan(item.fillvalue)
    if written < expected and not missing_says_nan:
        raise UserError(
            f"holds {written} of {expected} blocks of samples, the others were never written",
            where=where,
            remedy="cut the record where the writing stopped",
        )


def _unit(item: Any, column: int | None, name: str, where: str) -> str | None:
    stated = []
    for attribute in _UNIT_NAMES:
        if attribute not in item.attrs:
            continue
        value = np.atleast_1d(item.attrs[attribute])
        word = (
            value[column] if column is not None and len(value) == item.shape[1] else value[0] if len(value) == 1 else ""
        )
        stated.append(word.decode("utf-8", "replace") if isinstance(word, bytes) else str(word))
    return one_unit(stated, name, where)


def datasets(file: Any) -> list[str]:
    """Paths of the first thousand datasets."""
    import h5py

    found: list[str] = []

    def look(name: str, item: Any) -> bool | None:
        if isinstance(item, h5py.Dataset):
            found.append(name)
        return True if len(found) >= 1000 else None

    file.visititems(look)
    return found


def place_of(path: Path, name: str) -> str:
    return f"{path}:/{name.strip('/')}"

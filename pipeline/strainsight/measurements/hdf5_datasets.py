"""Datasets of an HDF5 file: search, check, read."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.records import Signals, check_count, check_no_infinity, missing_error, one_unit, quote
from strainsight.memory import require_memory

LARGEST_CHUNK = 1 << 28
"""Largest chunk [bytes], which the library reads at once."""
PACKING = 1100
"""Largest compression ratio of deflate."""
AT_ONCE = 3
"""Copies of a channel in memory at once: raw, as numbers, and while it is sent."""
_HOPS = 16
_COLUMN = re.compile(r"(.*)\[(\d{1,9})\]")
_UNIT_NAMES = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
_PACKING = {"scale_factor": 1.0, "add_offset": 0.0}
INSTEAD = "write the samples into the file itself, as one plain dataset per channel"
UNWRITTEN = "export the record again, only up to the last sample that was written"


def signals(path: Path, names: Sequence[str]) -> Signals:
    """Values (T,) [unit of the file] of every name, NaN where missing, with the length of the first, and their units. Raises
    UserError for links to other files, and unsupported shapes, types and packed values."""
    import h5py

    with h5py.File(path, "r") as file:
        samples: int | None = None
        for name in names:
            values, unit = _signal(file, name, path, samples)
            samples = values.size
            yield values, unit


def declared(path: Path, names: Sequence[str]) -> list[int]:
    """Unpacked size of each name, for a column that of its whole table. Raises UserError as `signals` does before it reads
    samples, and if they do not fit into memory."""
    import h5py

    sizes, largest = [], 0
    with h5py.File(path, "r") as file:
        samples: int | None = None
        for name in names:
            item, column = _checked_dataset(file, name, path, samples)
            samples = item.shape[0]
            sizes.append(int(item.nbytes))
            largest = max(largest, sizes[-1] if column is None else _read_size(item))
    require_memory(
        AT_ONCE * np.dtype(float).itemsize * (samples or 0) + largest,
        f"{path}: not enough memory for a channel of {samples} samples",
        "shorten the record, reduce its sampling rate, or use a computer with more memory",
    )
    return sizes


def _read_size(item: Any) -> int:
    """Memory for reading a column: its samples, and an unpacked row of the chunks."""
    rows, columns = item.chunks or (0, 0)
    return int((item.shape[0] + rows * max(columns, item.shape[1])) * item.dtype.itemsize)


def _checked_dataset(file: Any, name: str, path: Path, samples: int | None) -> tuple[Any, int | None]:
    """Dataset of a name, and its column. Raises UserError if it is missing or cannot be imported."""
    where = place_of(path, name)
    item, column = resolve(file, name, where), None
    if item is None and (match := _COLUMN.fullmatch(name)):
        item, column = resolve(file, match[1], where), int(match[2])
    if item is None:
        raise missing_error("dataset", name, datasets(file), str(path))
    _check(item, column, samples, path, where)
    return item, column


def _signal(file: Any, name: str, path: Path, samples: int | None) -> tuple[np.ndarray, str | None]:
    """Values (T,) of a dataset or of its column, NaN where missing, and its unit."""
    where = place_of(path, name)
    item, column = _checked_dataset(file, name, path, samples)
    raw = item[...] if column is None else item[:, column]
    with np.errstate(over="ignore"):
        values = np.asarray(raw).reshape(-1).astype(float)
    for attribute in ("_FillValue", "missing_value"):
        if attribute in item.attrs:
            for word in np.atleast_1d(item.attrs[attribute]):
                values[np.asarray(raw).reshape(-1) == word] = np.nan
    check_no_infinity(values, name, where)
    return values, _unit(item, column, name, where)


def resolve(file: Any, name: str, where: str) -> Any:
    """The dataset, or None. Every link on the way is checked first; a link to another file is never followed."""
    import h5py

    parts, group, hops = [part for part in name.split("/") if part], file, 0
    while parts:
        if not isinstance(group, h5py.Group) or (link := group.get(parts[0], getlink=True)) is None:
            return None
        if isinstance(link, h5py.ExternalLink):
            raise UserError(f"the dataset links to another file, {quote(link.filename)}", where=where, remedy=INSTEAD)
        if isinstance(link, h5py.SoftLink):
            hops += 1
            if hops > _HOPS:
                raise UserError(
                    f"the path contains more than {_HOPS} consecutive links",
                    where=where,
                    remedy="specify the path of the dataset without links",
                )
            group = file if link.path.startswith("/") else group
            parts = [part for part in link.path.split("/") if part and part != "."] + parts[1:]
            continue
        group, parts = group[parts[0]], parts[1:]
    return group if isinstance(group, h5py.Dataset) else None


def _check(item: Any, column: int | None, samples: int | None, path: Path, where: str) -> None:
    """Raise UserError unless the dataset contains numbers in this file, of acceptable size, in one column of `samples`."""
    shape, dtype = item.shape, item.dtype
    if item.is_virtual or item.external:
        raise UserError("the samples are in another file", where=where, remedy=INSTEAD)
    if dtype.kind not in "iuf":
        raise UserError(
            f"the dataset contains values of type {dtype} instead of real numbers",
            where=where,
            remedy="write the samples as real numbers",
        )
    if shape is None or len(shape) not in (1, 2):
        raise UserError(
            f"the dataset has the shape {shape}, not one or two dimensions",
            where=where,
            remedy="write one dataset with one dimension for every channel",
        )
    if column is None and len(shape) == 2 and shape[1] != 1:
        raise UserError(
            f"the dataset has {shape[1]} columns",
            where=where,
            remedy=f"select a column, numbered from 0, as in '{item.name.strip('/')}[0]'",
        )
    if column is not None and (len(shape) != 2 or column >= shape[1]):
        raise UserError(
            f"column {column} does not exist: the shape of the dataset is {shape}",
            where=where,
            remedy="columns are numbered from 0, as in 'table[0]'",
        )
    check_count(shape[0], item.name, where)
    if samples is not None and shape[0] != samples:
        raise UserError(
            f"the dataset has {shape[0]} samples, but the time axis has {samples}",
            where=where,
            remedy="use channels with the same sampling times, or cut all datasets to the same length",
        )
    check_stored(item, where, path.stat().st_size)
    for name, harmless in _PACKING.items():
        if name in item.attrs and np.any(item.attrs[name] != harmless):
            raise UserError(
                f"the dataset contains packed values: {name} is {item.attrs[name]}",
                where=where,
                remedy="write the physical values, without the attributes scale_factor and add_offset",
            )


def check_stored(item: Any, where: str, file_size: int) -> None:
    """Raise UserError for samples that were never written: they have the fill value, mostly zero."""
    if item.nbytes > PACKING * file_size:
        raise UserError(
            f"the dataset has {item.nbytes} bytes, but the file has only {file_size} bytes",
            where=where,
            remedy=UNWRITTEN,
        )
    if item.chunks is not None:
        if np.prod([float(n) for n in item.chunks]) * item.dtype.itemsize > LARGEST_CHUNK:
            raise UserError(
                f"the dataset is stored in chunks of {item.chunks} values, larger than {LARGEST_CHUNK >> 20} MiB",
                where=where,
                remedy="write the dataset with smaller chunks",
            )
        expected = int(np.prod([-(-n // c) for n, c in zip(item.shape, item.chunks, strict=True)]))
        written = item.id.get_num_chunks()
    else:
        expected, written = int(item.size > 0), int(item.id.get_storage_size() > 0)
    missing_says_nan = item.dtype.kind == "f" and np.isnan(item.fillvalue)
    if written < expected and not missing_says_nan:
        raise UserError(
            f"the dataset contains only {written} of {expected} blocks of samples; the other blocks were never written",
            where=where,
            remedy=UNWRITTEN,
        )


def _unit(item: Any, column: int | None, name: str, where: str) -> str | None:
    units = []
    for attribute in _UNIT_NAMES:
        if attribute not in item.attrs:
            continue
        value = np.atleast_1d(item.attrs[attribute])
        word = (
            value[column] if column is not None and len(value) == item.shape[1] else value[0] if len(value) == 1 else ""
        )
        units.append(word.decode("utf-8", "replace") if isinstance(word, bytes) else str(word))
    return one_unit(units, name, where)


def datasets(file: Any) -> list[str]:
    """Paths of the first thousand datasets."""
    import h5py

    paths: list[str] = []

    def look(name: str, item: Any) -> bool | None:
        if isinstance(item, h5py.Dataset):
            paths.append(name)
        return True if len(paths) >= 1000 else None

    file.visititems(look)
    return paths


def place_of(path: Path, name: str) -> str:
    return f"{path}:/{name.strip('/')}"

"""Variables of a MAT file: of version 4 to 7 by SciPy; of 7.3, an HDF5 file whose structs are groups and whose matrices are
stored transposed, by h5py. Read in a child process, see reader.py."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.assemble import numbers
from strainsight.measurements.hdf5_datasets import INSTEAD, check_stored, datasets, resolved
from strainsight.measurements.records import Signals, check_count, missing, one_unit, plain

UNITS = ("unit", "units", "Unit", "Units")
"""Fields that hold a unit: text for all vectors beside it, or a struct of texts by the names of the vectors."""
_PART = re.compile(r"(.*)\((?::,\s*(\d{1,9})|(\d{1,9}),\s*:)\)")


def parted(name: str) -> tuple[str, tuple[int, int] | None]:
    """ "a(:,2)" → "a", (1, 1): axis and index from 0 of the part; "a" → "a", None."""
    if not (found := _PART.fullmatch(name)):
        return name, None
    axis = 1 if found[2] else 0
    return found[1], (axis, int(found[2] or found[3]) - 1)


def one_line(values: np.ndarray, part: tuple[int, int] | None, name: str, where: str) -> np.ndarray:
    """The vector (T,) of a matrix, or its column or row. Raises UserError where it has no such, or the name gives none."""
    if part is not None:
        axis, index = part
        if values.ndim != 2 or not 0 <= index < values.shape[axis]:
            raise UserError(
                f"{name!r}: its size is {' × '.join(map(str, values.shape))}",
                where=where,
                remedy="columns and rows count from 1, as in a(:,1)",
            )
        return values.take(index, axis)
    if values.ndim > 2 or (values.ndim == 2 and min(values.shape) > 1):
        raise UserError(
            f"{name!r} is a matrix of {' × '.join(map(str, values.shape))}",
            where=where,
            remedy=f"say which column or row, as in '{name}(:,1)'" if values.ndim == 2 else "take a vector",
        )
    return values.reshape(-1)


_LONGEST = 100
"""Signs of a unit."""


def hdf5_signals(path: Path, names: Sequence[str]) -> Signals:
    """Values (T,) of every name and their units, as `mat.signals`. Raises UserError as that does, and for links to other
    files and blocks of samples that were never written."""
    import h5py

    with h5py.File(path, "r") as file:
        for name in names:
            plainly, part = parted(name)
            where = f"{path}, {plainly}"
            item = resolved(file, plainly.replace(".", "/"), where)
            if item is None:
                raise _hdf5_missing(file, plainly, path)
            _check_hdf5(item, plainly, path, where)
            values = one_line(np.asarray(item[...]).T, part, name, where)
            unit = (
                None if values.size == 1 else one_unit([_hdf5_unit(file, plainly, word) for word in UNITS], name, where)
            )
            yield numbers(values, name, where), unit


def _check_hdf5(item: Any, name: str, path: Path, where: str) -> None:
    """Raise UserError unless the dataset holds numbers of its own, of a bearable size."""
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
    if "MATLAB_object_decode" in item.attrs:
        raise UserError(
            f"{name!r} is a table or an object of MATLAB",
            where=str(path),
            remedy="save its columns as plain vectors of numbers",
        )
    if kind in ("char", "cell", "string") or item.dtype.kind not in "iuf" or item.shape is None:
        raise UserError(
            f"{name!r} holds {kind or item.dtype}, not real numbers",
            where=str(path),
            remedy="save it as a plain vector of numbers",
        )
    if "MATLAB_sparse" in item.attrs:
        raise UserError(f"{name!r} is a sparse matrix", where=str(path), remedy="save it as a plain vector of numbers")
    if item.is_virtual or item.external:
        raise UserError(f"{name!r} takes its samples from another file", where=str(path), remedy=INSTEAD)
    check_count(item.size, name, str(path))
    check_stored(item, where, path.stat().st_size)


def _hdf5_missing(file: Any, name: str, path: Path) -> UserError:
    known = [found.replace("/", ".") for found in datasets(file) if not found.startswith("#")]
    inside = [found for found in known if found.startswith(f"{name}.")]
    if inside:
        return UserError(
            f"{name!r} is a struct", where=str(path), remedy=f"name one of its fields, as in {plain(inside[0])}"
        )
    return missing("variable", name, known, str(path))


def _hdf5_unit(file: Any, name: str, word: str) -> str:
    """The unit that `word` beside a vector states, "" for none."""
    above, _, field = name.rpartition(".")
    stem = "/".join([*above.split("."), word]).lstrip("/")
    for path in (stem, f"{stem}/{field}"):
        item = resolved(file, path, name)
        if item is not None and (item.size or 0) <= _LONGEST:
            if item.attrs.get("MATLAB_class") in (b"char", "char") and item.dtype.kind == "u":
                return "".join(chr(sign) for sign in np.asarray(item[...]).reshape(-1, order="F"))
            if item.dtype.kind in "OS" and item.size == 1:
                text = item[()] if item.shape == () else item[...].reshape(-1)[0]
                return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
    return ""


def signals(path: Path, names: Sequence[str | None]) -> Signals:
    """Values (T,) of every name, and their units; the first may be one number, which is no sample but an interval or a rate.

    names: "a", "a.b" of a struct, "a(:,2)" and "a(2,:)" for a column and a row of a matrix, from 1 as in MATLAB.
    Raises UserError for variables that are missing, or no numbers.
    """
    import h5py

    asked = [name for name in names if name is not None]
    if h5py.is_hdf5(path):
        yield from hdf5_signals(path, asked)
        return
    import scipy.io

    tops = {name.split(".")[0].split("(")[0] for name in asked}
    held = scipy.io.loadmat(path, variable_names=[*tops, *UNITS], struct_as_record=False)
    for name in asked:
        plainly, part = parted(name)
        holder, found = _walked(held, plainly, path)
        values = one_line(np.asarray(found), part, name, str(path))
        unit = None if values.size == 1 else one_unit([_unit(holder, plainly, word) for word in UNITS], name, str(path))
        yield numbers(values, name, str(path)), unit


def _walked(held: dict[str, Any], name: str, path: Path) -> tuple[dict[str, Any], Any]:
    """What holds a value, by the names of its fields, and the value."""
    holder: dict[str, Any] = held
    found: Any = None
    for i, field in enumerate(name.split(".")):
        inside = _fields(found) if i else held
        if inside is None:
            raise UserError(
                f"{'.'.join(name.split('.')[:i])!r} {_said(found)}",
                where=str(path),
                remedy="name a vector, or a field of a single struct, as in a.b",
            )
        if field not in inside:
            raise _missing(name, inside, path)
        holder, found = inside, inside[field]
    if _fields(found) is not None or not isinstance(found, np.ndarray) or found.dtype.kind not in "iuf":
        raise UserError(
            f"{name!r} {_said(found)}",
            where=str(path),
            remedy=f"name one of its fields, as in {name}.{next(iter(fields))}"
            if (fields := _fields(found))
            else "save it as a plain vector of numbers",
        )
    return holder, found


def _missing(name: str, holder: dict[str, Any], path: Path) -> UserError:
    import scipy.io

    parents = name.split(".")[:-1]
    if not any(holder.get(field) is not None for field in holder if not field.startswith("__")) or not parents:
        known = [found for found, _, _ in scipy.io.whosmat(path)]
    else:
        known = [".".join([*parents, field]) for field in holder]
    return missing("variable", name, known, str(path))


def _fields(found: Any) -> dict[str, Any] | None:
    """The fields of a single struct, None for anything else."""
    if isinstance(found, np.ndarray) and found.dtype == object and found.size == 1:
        found = found.reshape(-1)[0]
    names = getattr(found, "_fieldnames", None)
    return None if names is None else {name: getattr(found, name) for name in names}


def _said(found: Any) -> str:
    if _fields(found) is not None:
        return "is a struct"
    if "Opaque" in type(found).__name__ or "Object" in type(found).__name__:
        return "is a table or an object of MATLAB"
    if not isinstance(found, np.ndarray):
        return "is a sparse matrix" if hasattr(found, "nnz") else "is no array of numbers"
    return {"O": f"is a struct array or cell array of {found.size}", "U": "is text", "c": "holds complex numbers"}.get(
        found.dtype.kind, "is no array of numbers"
    )


def _unit(holder: dict[str, Any], name: str, word: str) -> str:
    """The unit that `word` beside a vector states, "" for none."""
    found = holder.get(word)
    fields = _fields(found)
    if fields is not None:
        found = fields.get(name.split(".")[-1])
    text = np.asarray(found).reshape(-1) if found is not None else np.array([])
    return str(text[0]) if text.size == 1 and text.dtype.kind == "U" else ""

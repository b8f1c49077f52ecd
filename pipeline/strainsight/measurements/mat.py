"""Variables of a MAT file, version 4 to 7 with SciPy, version 7.3 (HDF5 with structs as groups and transposed
matrices) with h5py. Runs in a child process, see reader.py."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.assemble import numbers
from strainsight.measurements.hdf5_datasets import INSTEAD, check_stored, datasets, resolve
from strainsight.measurements.records import Signals, check_count, missing_error, one_unit, quote

UNITS = ("unit", "units", "Unit", "Units")
"""Fields with a unit: text for all vectors of a struct, or a struct of texts by vector name."""
_PART = re.compile(r"(.*)\((?::,\s*(\d{1,9})|(\d{1,9}),\s*:)\)")


def split_part(name: str) -> tuple[str, tuple[int, int] | None]:
    """ "a(:,2)" → "a", (1, 1): axis and index from 0 of the part; "a" → "a", None."""
    if not (match := _PART.fullmatch(name)):
        return name, None
    return match[1], (1 if match[2] else 0, int(match[2] or match[3]) - 1)


def one_line(values: np.ndarray, part: tuple[int, int] | None, name: str, where: str) -> np.ndarray:
    """Vector (T,) of a matrix, or one of its columns or rows. Raises UserError if it does not exist or is ambiguous."""
    if part is not None:
        axis, index = part
        if values.ndim != 2 or not 0 <= index < values.shape[axis]:
            raise UserError(
                f"{name!r} does not exist: the size of the matrix is {' × '.join(map(str, values.shape))}",
                where=where,
                remedy="columns and rows are numbered from 1, as in a(:,1)",
            )
        return values.take(index, axis)
    if values.ndim > 2 or (values.ndim == 2 and min(values.shape) > 1):
        raise UserError(
            f"variable {name!r} is a matrix of size {' × '.join(map(str, values.shape))}, not a vector",
            where=where,
            remedy=f"select a column or row, as in '{name}(:,1)'" if values.ndim == 2 else "specify a vector",
        )
    return values.reshape(-1)


_LONGEST = 100
"""Largest length of a unit [characters]."""


def hdf5_signals(path: Path, names: Sequence[str]) -> Signals:
    """Values (T,) of every name and their units, as `mat.signals`. Raises the same UserError, and one for links to
    other files and unwritten blocks."""
    import h5py

    with h5py.File(path, "r") as file:
        for name in names:
            plainly, part = split_part(name)
            where = f"{path}, {plainly}"
            if (item := resolve(file, plainly.replace(".", "/"), where)) is None:
                raise _hdf5_missing(file, plainly, path)
            _check_hdf5(item, plainly, path, where)
            values = one_line(np.asarray(item[...]).T, part, name, where)
            unit = (
                None if values.size == 1 else one_unit([_hdf5_unit(file, plainly, word) for word in UNITS], name, where)
            )
            yield numbers(values, name, where), unit


def _check_hdf5(item: Any, name: str, path: Path, where: str) -> None:
    """Raise UserError unless the dataset contains numbers in this file, of acceptable size."""
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode("ascii", "replace") if isinstance(kind, bytes) else str(kind)
    if "MATLAB_object_decode" in item.attrs:
        raise UserError(
            f"variable {name!r} is a MATLAB table or object",
            where=str(path),
            remedy="save its columns as plain vectors of numbers",
        )
    if kind in ("char", "cell", "string") or item.dtype.kind not in "iuf" or item.shape is None:
        raise UserError(
            f"variable {name!r} contains {kind or item.dtype} instead of real numbers",
            where=str(path),
            remedy="save it as a plain vector of numbers",
        )
    if "MATLAB_sparse" in item.attrs:
        raise UserError(
            f"variable {name!r} is a sparse matrix", where=str(path), remedy="save it as a plain vector of numbers"
        )
    if item.is_virtual or item.external:
        raise UserError(f"the samples of variable {name!r} are in another file", where=str(path), remedy=INSTEAD)
    check_count(item.size, name, str(path))
    check_stored(item, where, path.stat().st_size)


def _hdf5_missing(file: Any, name: str, path: Path) -> UserError:
    known = [dataset.replace("/", ".") for dataset in datasets(file) if not dataset.startswith("#")]
    if inside := [dataset for dataset in known if dataset.startswith(f"{name}.")]:
        return UserError(
            f"variable {name!r} is a struct", where=str(path), remedy=f"use a field, such as {quote(inside[0])}"
        )
    return missing_error("variable", name, known, str(path))


def _hdf5_unit(file: Any, name: str, word: str) -> str:
    """Unit in the field `word` of the same struct as a vector, "" if missing."""
    above, _, field = name.rpartition(".")
    stem = "/".join([*above.split("."), word]).lstrip("/")
    for path in (stem, f"{stem}/{field}"):
        item = resolve(file, path, name)
        if item is not None and (item.size or 0) <= _LONGEST:
            if item.attrs.get("MATLAB_class") in (b"char", "char") and item.dtype.kind == "u":
                return "".join(chr(sign) for sign in np.asarray(item[...]).reshape(-1, order="F"))
            if item.dtype.kind in "OS" and item.size == 1:
                text = item[()] if item.shape == () else item[...].reshape(-1)[0]
                return text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
    return ""


def signals(path: Path, names: Sequence[str | None]) -> Signals:
    """Values (T,) of every name, and their units; the first may be a single number, the sampling interval or rate.

    names: "a", "a.b" of a struct, "a(:,2)" and "a(2,:)" for a column and a row of a matrix, from 1 as in MATLAB.
    Raises UserError for variables that are missing or not numeric."""
    import h5py

    requested = [name for name in names if name is not None]
    if h5py.is_hdf5(path):
        yield from hdf5_signals(path, requested)
        return
    import scipy.io

    tops = {name.split(".")[0].split("(")[0] for name in requested}
    variables = scipy.io.loadmat(path, variable_names=[*tops, *UNITS], struct_as_record=False)
    for name in requested:
        plainly, part = split_part(name)
        holder, value = _find_variable(variables, plainly, path)
        values = one_line(np.asarray(value), part, name, str(path))
        unit = None if values.size == 1 else one_unit([_unit(holder, plainly, word) for word in UNITS], name, str(path))
        yield numbers(values, name, str(path)), unit


def _find_variable(variables: dict[str, Any], name: str, path: Path) -> tuple[dict[str, Any], Any]:
    """The dictionary that contains a value, by field names, and the value."""
    holder: dict[str, Any] = variables
    value: Any = None
    for i, field in enumerate(name.split(".")):
        inside = _fields(value) if i else variables
        if inside is None:
            raise UserError(
                _no_vector(".".join(name.split(".")[:i]), value),
                where=str(path),
                remedy="specify a vector, or a field of a single struct, as in a.b",
            )
        if field not in inside:
            raise _missing(name, inside, path)
        holder, value = inside, inside[field]
    if _fields(value) is not None or not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf":
        raise UserError(
            _no_vector(name, value),
            where=str(path),
            remedy=f"use a field, such as {name}.{next(iter(fields))}"
            if (fields := _fields(value))
            else "save it as a plain vector of numbers",
        )
    return holder, value


def _missing(name: str, holder: dict[str, Any], path: Path) -> UserError:
    import scipy.io

    parents = name.split(".")[:-1]
    if not any(holder.get(field) is not None for field in holder if not field.startswith("__")) or not parents:
        known = [known_name for known_name, _, _ in scipy.io.whosmat(path)]
    else:
        known = [".".join([*parents, field]) for field in holder]
    return missing_error("variable", name, known, str(path))


def _fields(value: Any) -> dict[str, Any] | None:
    """Fields of a single struct, None for anything else."""
    if isinstance(value, np.ndarray) and value.dtype == object and value.size == 1:
        value = value.reshape(-1)[0]
    names = getattr(value, "_fieldnames", None)
    return None if names is None else {name: getattr(value, name) for name in names}


def _no_vector(name: str, value: Any) -> str:
    """Message on a variable that is not an array of numbers."""
    if _fields(value) is not None:
        return f"variable {name!r} is a struct"
    if "Opaque" in type(value).__name__ or "Object" in type(value).__name__:
        return f"variable {name!r} is a MATLAB table or object"
    if hasattr(value, "nnz"):
        return f"variable {name!r} is a sparse matrix"
    kind = value.dtype.kind if isinstance(value, np.ndarray) else ""
    if kind == "O":
        return f"variable {name!r} is a struct array or cell array with {value.size} entries"
    other = "an array of complex numbers" if kind == "c" else "not an array of numbers"
    return f"variable {name!r} is {'text' if kind == 'U' else other}"


def _unit(holder: dict[str, Any], name: str, word: str) -> str:
    """Unit in the field `word` of the same struct as a vector, "" if missing."""
    unit = holder.get(word)
    if (fields := _fields(unit)) is not None:
        unit = fields.get(name.split(".")[-1])
    text = np.asarray(unit).reshape(-1) if unit is not None else np.array([])
    return str(text[0]) if text.size == 1 and text.dtype.kind == "U" else ""

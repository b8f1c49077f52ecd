"""Variables of a MAT file of version 4 to 7 by SciPy. Read in a child process, see reader.py; version 7.3: mat73.py."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError, did_you_mean
from strainsight.measurements import mat73
from strainsight.measurements.assemble import numbers, one_unit
from strainsight.measurements.mat_names import UNITS, one_line, parted
from strainsight.measurements.records import Signals, plain


def signals(path: Path, names: Sequence[str | None]) -> Signals:
    """Values (T,) of every name, and their units; the first may be one number, which is no sample but an interval or a rate.

    names: "a", "a.b" of a struct, "a(:,2)" and "a(2,:)" for a column and a row of a matrix, from 1 as in MATLAB.
    Raises UserError for variables that are missing, or no numbers.
    """
    import h5py

    asked = [name for name in names if name is not None]
    if h5py.is_hdf5(path):
        yield from mat73.signals(path, asked)
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
    said = ", ".join(map(plain, known[:20])) + (" …" if len(known) > 20 else "")
    return UserError(
        f"no variable {name!r}",
        where=str(path),
        remedy=did_you_mean(name, known, f"it has {said}" if known else "it has none"),
    )


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

"""Variables of a MAT file of version 7.3, which is an HDF5 file: structs are groups, matrices are stored transposed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import UserError, did_you_mean
from strainsight.measurements.assemble import numbers, one_unit
from strainsight.measurements.hdf5_datasets import INSTEAD, MOST_SAMPLES, check_stored, datasets, resolved
from strainsight.measurements.mat_names import UNITS, one_line, parted
from strainsight.measurements.records import Signals, plain

_LONGEST = 100
"""Signs of a unit."""


def signals(path: Path, names: Sequence[str]) -> Signals:
    """Values (T,) of every name and their units, as `mat.signals`. Raises UserError as that does, and for links to other
    files and blocks of samples that were never written."""
    import h5py

    with h5py.File(path, "r") as file:
        for name in names:
            plainly, part = parted(name)
            where = f"{path}, {plainly}"
            item = resolved(file, plainly.replace(".", "/"), where)
            if item is None:
                raise _missing(file, plainly, path)
            _check(item, plainly, path, where)
            values = one_line(np.asarray(item[...]).T, part, name, where)
            unit = None if values.size == 1 else one_unit([_unit(file, plainly, word) for word in UNITS], name, where)
            yield numbers(values, name, where), unit


def _check(item: Any, name: str, path: Path, where: str) -> None:
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
    if item.size > MOST_SAMPLES:
        raise UserError(
            f"{name!r} claims {item.size} samples",
            where=str(path),
            remedy=f"cut the record: the limit is {MOST_SAMPLES} samples",
        )
    check_stored(item, where, path.stat().st_size)


def _missing(file: Any, name: str, path: Path) -> UserError:
    known = [found.replace("/", ".") for found in datasets(file) if not found.startswith("#")]
    inside = [found for found in known if found.startswith(f"{name}.")]
    if inside:
        return UserError(
            f"{name!r} is a struct", where=str(path), remedy=f"name one of its fields, as in {plain(inside[0])}"
        )
    said = ", ".join(map(plain, known[:20])) + (" …" if len(known) > 20 else "")
    return UserError(
        f"no variable {name!r}",
        where=str(path),
        remedy=did_you_mean(name, known, f"it has {said}" if known else "it has none"),
    )


def _unit(file: Any, name: str, word: str) -> str:
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

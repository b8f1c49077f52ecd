"""How variables of a MAT file are named, and which vector of a matrix a name means."""

from __future__ import annotations

import re

import numpy as np

from strainsight.errors import UserError

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

"""Unit, axes and meaning of dataclass fields, declared with the field.
@dataclass(frozen=True)
class Ply:
    thickness: Annotated[float, Column("m", "", "thickness")]"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import Any, get_type_hints


@dataclass(frozen=True)
class Column:
    """unit: "m", "1"; axes: axis names, "node × 3", "" for a number; meaning: description in one line.
    name: name in a file, default that of the field; none: stored value for None; offset: in a file of many objects, the dataset
    with the start of each list, default `<name>_offset`."""

    unit: str
    axes: str
    meaning: str
    name: str = ""
    none: int = 0
    offset: str = ""


@cache
def columns_of(kind: type) -> dict[str, tuple[Any, Column | None]]:
    """Type and column of every field of a dataclass, by name; None for a field without column."""
    hints = get_type_hints(kind, include_extras=True)
    columns = {}
    for name in (field.name for field in fields(kind)):
        hint = hints[name]
        column = next((each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Column)), None)
        columns[name] = (hint.__origin__ if column else hint, column)
    return columns

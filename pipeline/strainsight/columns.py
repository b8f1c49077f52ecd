"""Unit, axes and meaning of the fields of a dataclass, where the field is defined.

@dataclass(frozen=True)
class Ply:
    thickness: Annotated[float, Column("m", "", "thickness")]
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from typing import Any, get_type_hints


@dataclass(frozen=True)
class Column:
    """unit: "m", "1"; axes: what each axis counts, "node × 3", "" of a number; meaning: one line for people.

    name: in a file, that of the field where empty; none: what stands in a file for None; offset: in a file of many objects, the
    dataset that says where the list of each begins, `<name>_offset` where empty.
    """

    unit: str
    axes: str
    meaning: str
    name: str = ""
    none: int = 0
    offset: str = ""


@cache
def columns_of(kind: type) -> dict[str, tuple[Any, Column | None]]:
    """Type and column of every field of a dataclass by name; None of a field without one."""
    hints = get_type_hints(kind, include_extras=True)
    columns = {}
    for name in (field.name for field in fields(kind)):
        hint = hints[name]
        column = next((each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Column)), None)
        columns[name] = (hint.__origin__ if column else hint, column)
    return columns

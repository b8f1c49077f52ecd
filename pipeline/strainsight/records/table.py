"""Dataclass objects as columns, one row per object: storage of a `tuple[Springs, ...]` or a `Mapping[int, Lamina]`.

A column is a field with a `Column`; other fields get their defaults on reading. A field that is a dataclass adds the columns of
that class. Lists of unequal length are concatenated with an array of offsets; so are columns of tuples of dataclasses (`plies:
tuple[Ply, ...]`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, make_dataclass, replace
from functools import cache, cached_property
from itertools import chain, pairwise
from types import NoneType
from typing import Any, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from strainsight.columns import Column, columns_of
from strainsight.records.record import FieldPlace, placed

ALL = "; the lists of all rows are concatenated"
OFFSET = "start of every list in the concatenated lists; list i has the entries offset[i] to offset[i + 1] − 1"


@dataclass(frozen=True)
class Key:
    """Key of the objects of a mapping, if it is not one of their fields; kind: int or str; several: a key may have several
    objects, stored as pairs (key, object)."""

    name: str
    kind: type
    meaning: str
    several: bool = False


def table(
    row: type, axis: str, key: Key | str = "", bare: bool = False, brief: Iterable[str] = (), **words: str
) -> Any:
    """The record (a `Form`) of objects of a dataclass; axis: name of the row axis.

    key: key field or `Key` of a mapping; empty for a tuple. bare: the value is stored instead of an object with this single
    field. brief: short descriptions of list columns. words: column → description in this table."""
    places = (
        {key.name: (key.kind, FieldPlace(f"/{key.name}", "1", (axis,), key.meaning))} if isinstance(key, Key) else {}
    )
    places |= _places(row, axis)
    for name, meaning in words.items():
        kind, place = places[name]
        places[name] = kind, replace(place, what=meaning + ALL * place.what.endswith(ALL))
    for name in brief:
        kind, place = places[name]
        places[name] = kind, replace(place, what=place.what.removesuffix(ALL))
    columns = [
        (name, tuple[str, ...] if kind is str else np.ndarray, placed(place)) for name, (kind, place) in places.items()
    ]
    members = {"row": row, "key": key, "bare": bare}
    return make_dataclass(
        f"{row.__name__}Table", columns, bases=(ColumnTable,), namespace=members, frozen=True, kw_only=True
    )


class ColumnTable:
    """Objects of `row` by columns."""

    row: Any
    key: Key | str
    bare: bool

    @classmethod
    def of(cls, objects: Any) -> Any:
        """Pairs (key, object) of a tuple, a mapping, or pairs."""
        pairs = list(objects.items() if isinstance(objects, Mapping) else objects if cls.key else enumerate(objects))
        columns = _columns(cls.row, [cls.row(value) if cls.bare else value for _, value in pairs])
        if isinstance(cls.key, Key):
            columns[cls.key.name] = _column([key for key, _ in pairs], cls.key.kind)
        return cls(**columns)

    def restore(self) -> Any:
        """The objects: a tuple, a mapping, or pairs."""
        objects = _objects(self.row, self)
        if self.bare:
            objects = [value for each in objects for value in vars(each).values()]
        if not self.key:
            return tuple(objects)
        keys = getattr(self, self.key.name if isinstance(self.key, Key) else self.key)
        pairs = list(zip(keys.tolist() if isinstance(keys, np.ndarray) else keys, objects, strict=True))
        return pairs if isinstance(self.key, Key) and self.key.several else dict(pairs)


@dataclass(frozen=True)
class _Field:
    """A field of a row.
    hint: type without None; part: dataclass that provides the columns, or None; axis: axis name of lists of unequal length, or
    empty; tail: lengths of the trailing axes; partner: field with lists of equal length, empty for the first field along an axis.
    """

    attribute: str
    column: Column
    hint: Any
    optional: bool
    part: Any
    axis: str
    tail: tuple[int, ...]
    partner: str

    @property
    def name(self) -> str:
        return self.column.name or self.attribute

    @property
    def offset(self) -> str:
        return self.column.offset or f"{self.name}_offset"

    @cached_property
    def components(self) -> bool:
        """Whether it is a tuple of components 0-5, stored as text, "123"."""
        return bool(self.hint == tuple[int, ...] and not self.axis)

    @cached_property
    def kind(self) -> type:
        """Type in a file: str, int (also for bool) or float."""
        if self.hint is str or self.components:
            return str
        arguments = get_args(self.hint)
        number = get_args(arguments[1])[0] if get_origin(self.hint) is np.ndarray else (arguments or (self.hint,))[0]
        return float if issubclass(number, float | np.floating) else int

    def stored(self, row: Any) -> Any:
        """Value of the field of an object, as stored in a file."""
        value = getattr(row, self.attribute)
        if value is None:
            length = (len(getattr(row, self.partner)) if self.partner else 0,) if self.axis else ()
            return np.full(length + self.tail, self.column.none)
        return "".join(str(c + 1) for c in value) if self.components else value

    def restore(self, entries: Any) -> list[Any]:
        """Values for all objects, from the stored columns."""
        if self.components:
            return [tuple(int(letter) - 1 for letter in text) for text in entries]
        if self.hint in (int, float, bool):
            return list(map(self.hint, entries.tolist()))
        if get_origin(self.hint) is tuple:
            return [tuple(entry if self.part else entry.tolist()) for entry in entries]
        if self.hint == NDArray[np.bool_]:
            entries = [entry.astype(bool) for entry in entries]
        if not self.optional or self.column.none:
            return list(entries)
        return [entry if (entry.any() if self.partner or not self.axis else len(entry)) else None for entry in entries]


@cache
def _fields(row: Any) -> tuple[_Field, ...]:
    """Fields of a dataclass that are columns, or contain columns."""
    fields: list[_Field] = []
    first: dict[str, str] = {}
    for attribute, (hint, column) in columns_of(row).items():
        optional = NoneType in get_args(hint)
        hint = get_args(hint)[0] if optional else hint
        part = next((kind for kind in (hint, *get_args(hint)) if is_dataclass(kind)), None)
        if column is None and (optional or part is not hint):
            continue
        axes = column.axes.split(" × ") if column and column.axes else []
        axis = axes.pop(0) if axes and not axes[0].isdigit() else ""
        partner = first.get(axis, "")
        first.setdefault(axis, attribute)
        definition = column or Column("", "", "")
        fields.append(_Field(attribute, definition, hint, optional, part, axis, tuple(map(int, axes)), partner))
    return tuple(fields)


def _places(row: Any, axis: str, suffix: str = "") -> dict[str, tuple[type, FieldPlace]]:
    """Columns in the file with their kind and place."""
    places: dict[str, tuple[type, FieldPlace]] = {}
    for field in _fields(row):
        if field.axis:
            places.setdefault(field.offset, (int, FieldPlace(f"/{field.offset}", "1", (f"{axis} + 1",), OFFSET)))
        along, more = (field.axis, ALL) if field.axis else (axis, suffix)
        if field.part:
            places |= _places(field.part, along, more)
        else:
            axes = (along, *map(str, field.tail))
            places[field.name] = (
                field.kind,
                FieldPlace(f"/{field.name}", field.column.unit, axes, field.column.meaning + more),
            )
    return places


def _columns(row: Any, objects: Sequence[Any]) -> dict[str, Any]:
    """Columns in the file by name."""
    columns: dict[str, Any] = {}
    for field in _fields(row):
        values = [field.stored(each) for each in objects]
        if field.axis:
            columns[field.offset] = np.cumsum([0, *map(len, values)], dtype=np.int64)
        if field.part:
            columns |= _columns(field.part, list(chain(*values)) if field.axis else values)
        elif field.axis:
            none = _column((), field.kind, field.tail)
            columns[field.name] = np.concatenate([none, *values]).astype(none.dtype)
        else:
            columns[field.name] = _column(values, field.kind, field.tail)
    return columns


def _column(values: Any, kind: type, tail: tuple[int, ...] = ()) -> Any:
    return tuple(values) if kind is str else np.asarray(values, np.int64 if kind is int else kind).reshape(-1, *tail)


def _objects(row: Any, columns: Any) -> list[Any]:
    """The objects, recreated from the columns."""
    values: dict[str, list[Any]] = {}
    for field in _fields(row):
        entries = _objects(field.part, columns) if field.part else getattr(columns, field.name)
        if field.axis:
            entries = [entries[first:last] for first, last in pairwise(getattr(columns, field.offset).tolist())]
        values[field.attribute] = field.restore(entries)
    return [row(**dict(zip(values, each, strict=True))) for each in zip(*values.values(), strict=True)]

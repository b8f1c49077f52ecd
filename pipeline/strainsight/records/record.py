"""Typed artefacts: frozen dataclasses whose fields declare their path, unit and axes in the file.

    @record
    class Train:
        time: np.ndarray = dataset("s", "/time", "time of the training simulation")
        strain: np.ndarray = dataset("strain", "/time × channel", "reading of every channel")

Writing (`written`), reading (`read`), shape checks and docs/artefacts.md (`listed`) use these declarations. A field may be an
array, a number, text (`str`, `tuple[str, ...]`) or a record in a group. It may also be a `dict` of these by name (`<name>` in
its path), or None if it is optional. A kernel dataclass is a record through the `Column` of its fields, and a `table` stores
many of them. A `Form` stores other objects."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import EllipsisType, UnionType
from typing import Any, Literal, Protocol, TypeVar, Union, dataclass_transform, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from strainsight.columns import columns_of
from strainsight.errors import ArtefactError
from strainsight.runner.output import Dataset

Record = TypeVar("Record")
NAME, UNIT_OF = "<name>", "unit of "


@dataclass(frozen=True)
class FieldPlace:
    """Location of a field in the file.

    path   relative to the group of its record; default: the name of the field. `<name>` is the key of a mapping
    unit   "m", "1"; "unit of <name>", "unit of input <name>", "unit of the channel" are resolved on writing, from
           "E", "input Fx", "the channel"
    axes   axis names; equal names have equal lengths ("step + 1": one more; "component of <name>": separate for each
           name). A path is the dataset that labels the axis, a number is its length
    what   description in one line
    """

    path: str
    unit: str = ""
    axes: tuple[str, ...] = ()
    what: str = ""


class Form(Protocol):
    """A record that stores a kernel object, and recreates it."""

    @classmethod
    def of(cls, value: Any) -> Any: ...
    def restore(self) -> Any: ...


class Source(Protocol):
    """Source of records: an artefact."""

    def __getitem__(self, path: str) -> np.ndarray: ...
    def __contains__(self, path: str) -> bool: ...
    def children(self, path: str) -> dict[str, np.ndarray]: ...
    def groups(self, path: str) -> tuple[str, ...]: ...
    def attributes(self, path: str) -> dict[str, Any]: ...


def dataset(unit: str, axes: str, what: str, *, path: str | None = None, default: EllipsisType | None = ...) -> Any:
    """A field with one dataset, or one for each name; axes: "/time × channel", "" for a number; default=None: optional."""
    return placed(FieldPlace("", unit, _split(axes), what), path, default)


def _split(axes: str) -> tuple[str, ...]:
    return tuple(axes.split(" × ")) if axes else ()


def group(
    through: Any = None,
    unit: str = "",
    what: str = "",
    *,
    path: str | None = None,
    by: str = "",
    default: EllipsisType | None = ...,
) -> Any:
    """A field with a record, or one for each name, in a group ("": the root); through: its `Form` in the file.

    A kernel dataclass with `Column` fields is a record that is read at once. unit and what replace `<unit>` and `<what>` in its
    fields and axes, so several groups can share a record; "unit of <name>" then refers to the name of the group. by: field with
    the group name, for tuples of records."""
    return placed(FieldPlace("", unit, what=what), path, default, through, by)


def placed(
    place: FieldPlace, path: str | None = None, default: EllipsisType | None = ..., through: Any = None, by: str = ""
) -> Any:
    """A field with a place; its default path is the field name without the prefix."""
    metadata = {"place": place, "path": path, "through": through, "by": by}
    if default is ...:
        return dataclasses.field(metadata=metadata)
    # A factory and no default: `read` is asked only for attributes that the class itself does not have.
    return dataclasses.field(metadata=metadata, default_factory=lambda: None)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(dataset, group))
def record(kind: type[Record]) -> type[Record]:
    """A frozen dataclass of such fields; its constructor takes keywords only."""
    return dataclass(frozen=True, kw_only=True)(kind)


def record_from(kind: type[Record], value: Any, **others: Any) -> Record:
    """A record from the attributes of a value with the same names; others replace or add fields."""
    names = [field.name for field in dataclasses.fields(kind) if field.name not in others]  # type: ignore[arg-type]
    return kind(**{name: getattr(value, name) for name in names}, **others)


@dataclass(frozen=True)
class _Kind:
    """Content of a field: leaf, its type; record: its record in the file (None for a dataset); named; optional; by: field of the
    leaf with its name."""

    leaf: Any
    record: Any
    named: bool
    optional: bool
    by: str = ""


_KNOWN: dict[Any, dict[str, tuple[FieldPlace, _Kind]]] = {}
_LAZY: dict[Any, Any] = {}


def _fields(kind: Any) -> dict[str, tuple[FieldPlace, _Kind]]:
    if kind not in _KNOWN:
        places = _places(kind)
        hints = get_type_hints(kind) if places else {}
        fields = {
            name: (FieldPlace(f"/{column.name or name}", column.unit, _split(column.axes), column.meaning), _kind(hint))
            for name, (hint, column) in columns_of(kind).items()
            if column
        }
        for name, data in places.items():
            known = _kind(hints[name], data["through"], data["by"])
            path = f"/{name}" + f"/{NAME}" * known.named
            fields[name] = replace(data["place"], path=path if data["path"] is None else data["path"]), known
        _KNOWN[kind] = fields
    return _KNOWN[kind]


def _places(kind: Any) -> dict[str, Mapping[str, Any]]:
    """Metadata of the fields of a `record`; empty for a kernel dataclass."""
    return {field.name: field.metadata for field in dataclasses.fields(kind) if "place" in field.metadata}


def _kind(hint: Any, through: Any = None, by: str = "") -> _Kind:
    optional = get_origin(hint) in (Union, UnionType)
    if optional:
        (hint,) = (part for part in get_args(hint) if part is not type(None))
    named = get_origin(hint) is dict or bool(by)
    leaf = get_args(hint)[0 if by else 1] if named else hint
    leaf = str if get_origin(leaf) is Literal else leaf
    return _Kind(leaf, through or (leaf if dataclasses.is_dataclass(leaf) else None), named, optional, by)


ROOT = FieldPlace("")


def written(instance: Any, units: Mapping[str, str] | None = None, at: FieldPlace = ROOT) -> dict[str, Dataset]:
    """Datasets of a record by path, with consistent shapes.

    units: units by owner, for fields with the unit of another quantity; at: group of the record. Raises ValueError for
    inconsistent lengths."""
    below = at.path
    lengths: dict[str, tuple[int, str]] = {}
    datasets: dict[str, Dataset] = {}
    fields = _fields(type(instance))
    for name, (place, kind) in fields.items():
        value = getattr(instance, name)
        if value is None and not kind.optional:
            raise ValueError(f"the dataset {below}{place.path} of {type(instance).__name__} is missing")
        for key, part in _parts(value, kind):
            path = below + place.path.replace(NAME, key)
            if kind.record is not None:
                form = part if kind.record is kind.leaf else kind.record.of(part)
                datasets |= written(form, units, replace(_named_as(key, _within(place, at), units), path=path))
                continue
            array, named = _array(part, kind), _named_as(key, _within(place, at), units)
            if wrong := _shape_fault(named, array, lengths, path):
                raise ValueError(wrong)
            scales = tuple(_label(axis, place, fields, below) for axis in named.axes)
            datasets[path] = Dataset(array, named.unit, named.what, scales if any(scales) else ())
    return datasets


def below(group: str, datasets: Mapping[str, Dataset]) -> dict[str, Dataset]:
    """Datasets of a record from another file, moved below a group, with the axes they refer to."""
    return {
        group + path: replace(dataset, scales=tuple(axis and group + axis for axis in dataset.scales))
        for path, dataset in datasets.items()
    }


def _label(axis: str, place: FieldPlace, fields: Mapping[str, tuple[FieldPlace, _Kind]], below: str) -> str:
    """The dataset that labels an axis, in the record or in the root; "" without label."""
    if not axis.startswith("/") or axis == place.path:
        return ""
    return below + axis if any(axis == other.path for other, _ in fields.values()) else axis


def _within(place: FieldPlace, at: FieldPlace) -> FieldPlace:
    """The place of a field with the words of its group inserted."""
    return replace(
        place,
        path=at.path + place.path,
        unit=place.unit.replace("<unit>", at.unit),
        axes=tuple(axis.replace("<what>", at.what) for axis in place.axes),
        what=place.what.replace("<what>", at.what),
    )


def _named_as(key: str, place: FieldPlace, units: Mapping[str, str] | None) -> FieldPlace:
    """The place for one name, with its unit."""
    unit = place.unit
    if unit.startswith(UNIT_OF):
        unit = (units or {})[unit.removeprefix(UNIT_OF).replace(NAME, key)]
    return replace(place, unit=unit, axes=_axes(place, key), what=place.what.replace(NAME, key))


def _axes(place: FieldPlace, key: str) -> tuple[str, ...]:
    return tuple(axis.replace(NAME, key) for axis in place.axes)


def _parts(value: Any, kind: _Kind) -> Iterator[tuple[str, Any]]:
    if kind.by:
        yield from ((getattr(part, kind.by), part) for part in value)
    elif kind.named:
        yield from (value or {}).items()
    elif value is not None:
        yield "", value


FLAGS = NDArray[np.bool_]
"""A flag of a kernel dataclass, 0 or 1 in the file."""


def _array(value: Any, kind: _Kind) -> np.ndarray:
    if kind.leaf == FLAGS:
        return np.asarray(value, dtype=np.int64)
    if isinstance(value, str) or (isinstance(value, tuple) and all(isinstance(entry, str) for entry in value)):
        return np.array(value, dtype=np.str_)
    return np.asarray(value)


def _shape_fault(place: FieldPlace, array: np.ndarray, lengths: dict[str, tuple[int, str]], path: str) -> str:
    """Message for a shape that differs from the axes, or an empty text."""
    if array.ndim != len(place.axes):
        return f"the dataset {path} has the shape {array.shape} instead of ({' × '.join(place.axes) or 'scalar'})"
    for axis, length in zip(place.axes, array.shape, strict=True):
        counted, more = (axis.removesuffix(" + 1"), 1) if axis.endswith(" + 1") else (axis, 0)
        expected, other = (
            (int(axis), "its definition") if axis.isdigit() else lengths.setdefault(counted, (length - more, path))
        )
        if length - more != expected:
            return f"the dataset {path} has length {length} along the axis '{axis}', but {other} has {expected + more}"
    return ""


def read(kind: type[Record], source: Source, below: str = "") -> Record:
    """The record of this kind in an artefact, or in one of its groups; fields are read on first access.

    Reading raises ArtefactError for a missing dataset, or for a shape that is inconsistent with those read before."""
    if kind not in _LAZY:
        # pickled and copied as what it is, with all fields read
        members = {"__getattr__": _load, "__reduce__": _whole, "__module__": kind.__module__}
        _LAZY[kind] = type(kind.__name__, (kind,), members)
    lazy: Record = object.__new__(_LAZY[kind])
    lazy.__dict__.update(_origin(kind, source, below))
    return lazy


def _origin(kind: Any, source: Source, below: str) -> dict[str, Any]:
    return {"_kind": kind, "_source": source, "_below": below, "_lengths": {}}


def unit_of(value: Any, field: str, name: str = "") -> str:
    """Unit of a dataset in the file of its record; name: key of a mapping."""
    place = _fields(value.__dict__["_kind"])[field][0]
    path = value.__dict__["_below"] + place.path.replace(NAME, name)
    return str(value.__dict__["_source"].attributes(path)["units"])


def _whole(lazy: Any) -> Any:
    kind = lazy.__dict__["_kind"]
    return partial(kind, **{name: getattr(lazy, name) for name in _fields(kind)}), ()


def _load(lazy: Any, name: str) -> Any:
    state = lazy.__dict__
    if "_kind" not in state or name not in _fields(state["_kind"]):
        raise AttributeError(f"{type(lazy).__name__} has no field '{name}'")
    state[name] = _loaded(state, name)
    return state[name]


def _loaded(state: Mapping[str, Any], name: str) -> Any:
    place, kind = _fields(state["_kind"])[name]
    return _named(state, place, kind) if kind.named else _single(state, place, kind, state["_below"] + place.path)


def _single(state: Mapping[str, Any], place: FieldPlace, kind: _Kind, path: str) -> Any:
    if kind.optional and path not in state["_source"]:
        return None
    if kind.record is not None:
        return _record(state, kind, path)
    return _value(state, place, kind, state["_source"][path], path)


def _named(state: Mapping[str, Any], place: FieldPlace, kind: _Kind) -> dict[str, Any] | tuple[Any, ...]:
    """Entries by name, except names that have a separate field."""
    source, parent = state["_source"], (state["_below"] + place.path).removesuffix(f"/{NAME}")
    if kind.record is not None:
        keys = source.groups(parent) if parent in source else ()
        records = {key: _record(state, kind, f"{parent}/{key}", key) for key in keys}
        return tuple(records.values()) if kind.by else records
    if parent not in source:
        return {}
    paths = {state["_below"] + other.path for other, _ in _fields(state["_kind"]).values()}
    arrays = {f"{parent}/{key}": array for key, array in source.children(parent).items()}
    names = {path: path.removeprefix(f"{parent}/") for path in arrays if path not in paths}
    return {
        name: _value(state, replace(place, axes=_axes(place, name)), kind, arrays[path], path)
        for path, name in names.items()
    }


def _record(state: Mapping[str, Any], kind: _Kind, path: str, key: str = "") -> Any:
    if kind.record is not kind.leaf:
        return read(kind.record, state["_source"], path).restore()
    if _places(kind.leaf):
        return read(kind.leaf, state["_source"], path)
    whole = _origin(kind.leaf, state["_source"], path)
    values = {name: _loaded(whole, name) for name in _fields(kind.leaf)}
    return kind.leaf(**values, **({kind.by: key} if kind.by else {}))


def _value(state: Mapping[str, Any], place: FieldPlace, kind: _Kind, array: np.ndarray, path: str) -> Any:
    if wrong := _shape_fault(place, array, state["_lengths"], path):
        raise ArtefactError(
            f"the datasets have inconsistent shapes: {wrong}", remedy="run the stage again with --force"
        )
    if kind.leaf == FLAGS:
        return array.astype(bool)
    if np.ndarray in (kind.leaf, get_origin(kind.leaf)):
        return array
    if get_origin(kind.leaf) is tuple:
        return tuple(str(entry) for entry in array)
    return kind.leaf(array[()])


def listed(kind: type, at: FieldPlace = ROOT) -> list[tuple[str, str, str, str]]:
    """All datasets of a record for docs/artefacts.md: path, axes, unit, description."""
    rows = []
    for place, field in _fields(kind).values():
        inner = _within(place, at)
        if field.record is not None:
            rows += listed(field.record, inner)
        else:
            axes = [axis.rpartition("/")[2] for axis in inner.axes]
            rows.append((inner.path, " × ".join(axes) or "scalar", inner.unit, inner.what))
    return rows

"""Markers in the annotations of a config's fields, and the values that they mark."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo


def mark_of(field: FieldInfo, kind: Any) -> Any:
    """The marker of a kind (a class or a union of classes) in a field's annotation, None where there is none."""
    return next((item for item in _parts(field.annotation, *field.metadata) if isinstance(item, kind)), None)


@dataclass(frozen=True)
class Marked:
    """A text or number in a config: the section and the dotted key of its field, its own key and value, and its marker."""

    section: BaseModel
    field: str
    key: str
    value: str | int | float
    mark: Any


def marked(section: BaseModel, kind: Any, above: str = "") -> Iterator[Marked]:
    """Every text and number that a marker of this kind marks, in a section and below; above: dotted key of the section."""
    for name, field in type(section).model_fields.items():
        mark, below = mark_of(field, kind), f"{above}.{field.alias or name}".removeprefix(".")
        for key, value in _leaves(below, getattr(section, name)):
            if isinstance(value, BaseModel):
                yield from marked(value, kind, key)
            elif mark is not None and isinstance(value, str | int | float) and not isinstance(value, bool):
                yield Marked(section, below, key, value, mark)


def _parts(*annotations: Any) -> Iterator[Any]:
    for item in annotations:
        yield item
        yield from _parts(*get_args(item))


def _leaves(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The values that mappings and lists hold, with their keys."""
    if not isinstance(value, dict | tuple):
        yield key, value
        return
    for place, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield from _leaves(f"{key}.{place}", item)

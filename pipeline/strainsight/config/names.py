"""Names by which one entry of a config means another: marked in the models, checked in one place."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, get_args

from pydantic import BaseModel

from strainsight.config.base import Text
from strainsight.config.problem import Problem, known


@dataclass(frozen=True)
class Names:
    """Marks a text as the name of an entry of a section: what that is called, its `type` if only one will do, and what may
    be named besides."""

    section: str
    what: str
    type: str | None = None
    besides: tuple[str, ...] = ()


GROUND = "ground"
BodyName = Annotated[Text, Names("bodies", "body", besides=(GROUND,))]
FlexibleName = Annotated[Text, Names("bodies", "flexible body", type="flexible")]
FrameName = Annotated[Text, Names("frames", "frame")]
JointName = Annotated[Text, Names("joints", "joint")]
BearingName = Annotated[Text, Names("bearings", "bearing")]


def names_in(section: BaseModel, key: str = "") -> Iterator[tuple[str, str, Names]]:
    """(key, name, what it names) of every marked text in a section and below it."""
    for name, field in type(section).model_fields.items():
        mark = _mark(field.annotation, *field.metadata)
        below = f"{key}.{field.alias or name}".removeprefix(".")
        for place, value in _leaves(below, getattr(section, name)):
            if isinstance(value, BaseModel):
                yield from names_in(value, place)
            elif mark is not None and isinstance(value, str):
                yield below, value, mark


def name_problems(config: BaseModel) -> Iterator[Problem]:
    """A problem for every name of what is not there."""
    for key, name, mark in names_in(config):
        entries = getattr(config, mark.section)
        there = [own for own, entry in entries.items() if mark.type is None or entry.type == mark.type]
        yield from known(key, name, [*there, *mark.besides], mark.what)


def _mark(*annotations: Any) -> Names | None:
    for item in annotations:
        found = item if isinstance(item, Names) else _mark(*get_args(item))
        if found is not None:
            return found
    return None


def _leaves(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The values that mappings and lists hold, with their keys."""
    if not isinstance(value, dict | tuple):
        yield key, value
        return
    for place, item in value.items() if isinstance(value, dict) else enumerate(value):
        yield from _leaves(f"{key}.{place}", item)

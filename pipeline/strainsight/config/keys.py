"""The models of a config along a path of keys: what may stand there, and which member of a union does."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, Discriminator, Tag


def path_in(model: type[BaseModel], data: Any, loc: Sequence[int | str]) -> tuple[str, ...]:
    """The keys of `loc` without the names of union members that pydantic puts in between.

    The name of a member may also be that of a key in it: {box: …} is the member box, with the key box.
    """
    path: list[str] = []
    annotations: list[Any] = [model]
    for i, part in enumerate(loc):
        if part == "[key]":
            continue
        if named := [member for annotation in annotations for tag, member in _tagged(annotation) if tag == part]:
            annotations = named
            continue
        if isinstance(data, Mapping) and part in data:
            data = data[part]
        elif isinstance(data, list) and isinstance(part, int):
            data = data[part] if part < len(data) else None
        elif i < len(loc) - 1 or not any(part in fields_of(own) for item in annotations for own in _members(item)):
            continue  # neither there nor missing
        annotations = [item for section in annotations for own in _members(section) for item in _below(own, str(part))]
        path.append(str(part))
    return tuple(path)


def keys_at(model: Any, path: Sequence[str], data: Any) -> list[str]:
    """Keys that the mapping at `path` may have; of a union's members, those of the one that the data names."""
    return list(dict.fromkeys(key for section in sections_at(model, path, data) for key in fields_of(section)))


def sections_at(model: type[BaseModel], path: Sequence[str], data: Any) -> list[Any]:
    """Types that the value at `path` may have; of a union's members the one that the data names, if it does."""
    sections: list[Any] = [model]
    for part in path:
        below = [item for section in sections for item in _below(section, part)]
        if isinstance(data, list):
            data = data[place] if (place := place_in(part, len(data))) is not None else None
        else:
            data = data.get(part) if isinstance(data, Mapping) else None
        listed = data.get("type", tuple(data)) if isinstance(data, Mapping) else ()
        names = listed if isinstance(listed, tuple) else (listed,)
        named = [member for item in below for tag, member in _tagged(item) if tag in names]
        sections = named or [member for item in below for member in _members(item)]
    return sections


def place_in(part: str, count: int) -> int | None:
    """The place, from 0, that a part of a dotted key names in a list of so many entries."""
    # isdigit alone is true of "²", and int refuses numbers of 5000 digits
    place = int(part) if part.isascii() and part.isdigit() and len(part) < 10 else count
    return place if place < count else None


def fields_of(annotation: Any) -> dict[str, Any]:
    """Key → field of a section; nothing of any other type."""
    if not (isinstance(annotation, type) and issubclass(annotation, BaseModel)):
        return {}
    return {field.alias or name: field for name, field in annotation.model_fields.items()}


def _below(annotation: Any, part: str) -> Iterator[Any]:
    if field := fields_of(annotation).get(part):
        yield _whole(field)
    elif get_origin(annotation) is dict:
        yield get_args(annotation)[1]
    elif get_origin(annotation) is tuple:
        yield get_args(annotation)[0]


def _whole(field: Any) -> Any:
    """The annotation of a field, with the discriminator that pydantic keeps beside it."""
    beside = [item for item in (field.discriminator, *field.metadata) if isinstance(item, str | Discriminator)]
    return Annotated[field.annotation, beside[0]] if beside else field.annotation


def _tagged(annotation: Any) -> Iterator[tuple[str, Any]]:
    """Name and type of the members that a discriminator distinguishes: their Tag, or what their `type` may be."""
    tagged = get_origin(annotation) is Annotated and any(
        isinstance(item, str | Discriminator) or getattr(item, "discriminator", None)
        for item in annotation.__metadata__
    )
    inside = get_args(annotation)[0] if get_origin(annotation) is Annotated else annotation
    for part in get_args(inside) if get_origin(inside) in (Union, UnionType) else ():
        if not tagged:
            yield from _tagged(part)
            continue
        tags = [item.tag for item in getattr(part, "__metadata__", ()) if isinstance(item, Tag)]
        for member in _members(part):
            yield from ((tag, member) for tag in tags or types_of(member))


def types_of(annotation: Any) -> tuple[str, ...]:
    """What `type` of a section may be."""
    field = fields_of(annotation).get("type")
    return get_args(field.annotation) if field else ()


def _members(annotation: Any) -> list[Any]:
    origin = get_origin(annotation)
    if origin is Annotated:
        return _members(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return [member for part in get_args(annotation) for member in _members(part)]
    return [] if origin is Literal else [annotation]

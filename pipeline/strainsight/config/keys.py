"""Config models along a path of keys, overrides from outside the file, and messages for pydantic errors."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from itertools import groupby
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, Discriminator, Tag, ValidationError

from strainsight.config.base import DOTTED, Problem
from strainsight.config.yaml_text import YamlProblem, parse
from strainsight.errors import ConfigError, did_you_mean


def path_in(model: type[BaseModel], data: Any, loc: Sequence[int | str]) -> tuple[str, ...]:
    """The keys of `loc`, without the names of union members that pydantic inserts.

    A member may have the same name as a key in it: {box: …} is the member box, with the key box."""
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
        elif i < len(loc) - 1 or not any(
            part in fields_of(entry_type) for item in annotations for entry_type in _members(item)
        ):
            continue  # neither there nor missing
        annotations = [
            item
            for section in annotations
            for entry_type in _members(section)
            for item in _below(entry_type, str(part))
        ]
        path.append(str(part))
    return tuple(path)


def keys_at(model: Any, path: Sequence[str], data: Any) -> list[str]:
    """Keys permitted in the mapping at `path`; of a union, those of the member that the data selects."""
    return list(dict.fromkeys(key for section in sections_at(model, path, data) for key in fields_of(section)))


def sections_at(model: type[BaseModel], path: Sequence[str], data: Any) -> list[Any]:
    """Types permitted at `path`; of a union, the member that the data selects, if any."""
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
    """List index, from 0, in a part of a dotted key, or None."""
    # isdigit alone is true of "²", and int refuses numbers of 5000 digits
    place = int(part) if part.isascii() and part.isdigit() and len(part) < 10 else count
    return place if place < count else None


def fields_of(annotation: Any) -> dict[str, Any]:
    """Key → field of a section; empty for other types."""
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
    """Annotation of a field, with its discriminator."""
    discriminators = [item for item in (field.discriminator, *field.metadata) if isinstance(item, str | Discriminator)]
    return Annotated[field.annotation, discriminators[0]] if discriminators else field.annotation


def _tagged(annotation: Any) -> Iterator[tuple[str, Any]]:
    """Name and type of the members that a discriminator distinguishes: their Tag, or the values of their `type`."""
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
    """Permitted values of `type` in a section."""
    field = fields_of(annotation).get("type")
    return get_args(field.annotation) if field else ()


def _members(annotation: Any) -> list[Any]:
    origin = get_origin(annotation)
    if origin is Annotated:
        return _members(get_args(annotation)[0])
    if origin in (Union, UnionType):
        return [member for part in get_args(annotation) for member in _members(part)]
    return [] if origin is Literal else [annotation]


TYPES = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "text",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "dict_type": "a mapping",
}
YES, NO = {"yes", "y", "on"}, {"no", "n", "off"}
"""Words that YAML 1.1 read as true and false."""
UNKNOWN, MISSING, NO_VALUE = "unknown key", "missing", "no value"
BOUNDS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


def problems_of(error: ValidationError, model: type[BaseModel], data: Any) -> list[Problem]:
    """All problems of a ValidationError in the terms of the config file, one for each key."""
    located = [
        (path_in(model, data, entry["loc"]), entry)
        for entry in error.errors(include_url=False)
        # a list that only counts as too short because its entries were refused, each with a separate problem
        if entry["type"] != "too_short" or len(entry["input"]) < entry["ctx"]["min_length"]
    ]
    # the last missing entry of a list of fixed length is its last entry
    lengths = {entry["loc"][:-1]: entry["loc"][-1] for _, entry in located if entry["type"] == "missing"}
    # The members of a union complain one after the other about the same value.
    problems = [
        _problem(path, [entry for _, entry in group], model, data, lengths)
        for path, group in groupby(located, key=lambda pair: pair[0])
    ]
    # A misspelt key is one problem, not an unknown key and a missing one.
    misspelt = {
        f"{problem.key.rpartition('.')[0]}.{problem.remedy.rpartition('mean ')[2].rstrip('?')}".lstrip(".")
        for problem in problems
        if problem.what == UNKNOWN
    }
    problems = list(dict.fromkeys(problems))  # a vector lacks each of its three components
    return [problem for problem in problems if problem.what != MISSING or problem.key not in misspelt]


def _problem(
    path: tuple[str, ...], entries: list[Any], model: type[BaseModel], data: Any, lengths: Mapping[Any, Any]
) -> Problem:
    key, first = ".".join(path), entries[0]
    match first["type"]:
        case "extra_forbidden" if path[-1].isdigit() and first["input"] is None and len(path) > 1:
            # {ratio: 0,01} is {ratio: 0, "01": null}
            return Problem(
                ".".join(path[:-1]),
                f"the comma before '{path[-1]}' separates two entries; it is not a decimal mark",
                "write a number with a decimal point, as in 0.01",
            )
        case "extra_forbidden":
            known = keys_at(model, path[:-1], data)
            return Problem(key, UNKNOWN, did_you_mean(path[-1], known, f"known keys: {', '.join(known)}"), True)
        case "missing" if (path and path[-1].isdigit()) or isinstance(first["input"], list):
            above = ".".join(path[:-1]) if path and path[-1].isdigit() else key
            return Problem(
                above,
                f"the list length is {len(first['input'])}, but has to be {lengths[first['loc'][:-1]] + 1}",
                _description(model, tuple(above.split(".")), data),
            )
        case "missing":
            return Problem(key, MISSING, _description(model, path, data), True)
        case "string_pattern_mismatch" if first["loc"][-1] == "[key]" or path[-1] in ("name", "suffix"):
            remedy = "use letters, digits, - and _ only, with a letter first"
            return Problem(key, f"{_shown(first['input'])} is not a valid name", remedy, True)
        case "union_tag_not_found":
            known = _tags(first["ctx"]) or [
                tag for member in sections_at(model, path, data) for tag in types_of(member)
            ]
            return Problem(key, "missing key 'type'", f"set type: {' or '.join(known)}" if known else "")
        case "union_tag_invalid":
            known, tag = _tags(first["ctx"]), first["ctx"]["tag"]
            what = f"'{tag}' is not one of {', '.join(known)}"
            return Problem(f"{key}.type", what, did_you_mean(str(tag), known, "set `type` to one of these values"))
        case "one_key":
            value, known = first["input"], keys_at(model, path, data)
            alone = isinstance(value, dict) and len(value) == 1 and not {*value} <= {*known}
            meant = did_you_mean(str(*value), known) if alone else ""
            return Problem(key, first["msg"], meant or _description(model, path, data))
        case "value_error":
            what, _, remedy = first["msg"].removeprefix("Value error, ").partition("; ")
            return Problem(key, what, remedy or _description(model, path, data))
    if first["input"] is None and first["type"] != "missing":
        return Problem(key, NO_VALUE, _description(model, path, data), at_key=True)
    problem = _wrong_value(key, entries)
    return problem if problem.remedy else replace(problem, remedy=_description(model, path, data))


def _wrong_value(key: str, entries: list[Any]) -> Problem:
    value = entries[0]["input"]
    wanted: list[str] = []
    choices: list[str] = []
    for entry in entries:
        kind, context = entry["type"], entry.get("ctx", {})
        if kind == "literal_error":
            choices += [choice.strip("'") for choice in context["expected"].replace(" or ", ", ").split(", ")]
        elif kind in TYPES:
            wanted.append(TYPES[kind])
        elif kind in BOUNDS:
            bound, word = BOUNDS[kind]
            wanted.append(f"{word} {context[bound]:g}")
        elif kind in ("too_short", "too_long", "string_too_short", "string_too_long"):
            limit = context.get("min_length", context.get("max_length"))
            one, several = ("character", "characters") if "string" in kind else ("entry", "entries")
            wanted.append(
                f"a {'text' if 'string' in kind else 'list'} of {'at least' if 'short' in kind else 'at most'} {limit} "
                f"{one if limit == 1 else several}"
            )
        else:
            wanted.append(entry["msg"][0].lower() + entry["msg"][1:])
    remedy = did_you_mean(value, choices) if choices and isinstance(value, str) else ""
    if choices and not wanted:
        return Problem(key, f"{_shown(value)} is not one of {', '.join(choices)}", remedy)
    if choices:
        wanted.append(f"one of {', '.join(choices)}" if len(choices) > 1 else f"'{choices[0]}'")
    if isinstance(value, str) and "a number" in wanted and not remedy:
        comma = re.fullmatch(r"([-+]?\d+),(\d+)", value.strip())
        remedy = "write the number without quotes and without unit"
        if comma:
            remedy = f"write the number with a decimal point: {comma[1]}.{comma[2]}"
    if isinstance(value, str) and wanted == [TYPES["bool_type"]] and value.lower() in YES | NO:
        remedy = f"write {'true' if value.lower() in YES else 'false'}"
    return Problem(key, f"the value is {_shown(value)}, but has to be {' or '.join(dict.fromkeys(wanted))}", remedy)


def _shown(value: Any) -> str:
    if value is None or isinstance(value, bool):
        return {None: "nothing", True: "true", False: "false"}[value]
    if isinstance(value, dict):
        return "a mapping"
    text = f"'{value}'" if isinstance(value, str) else _number(value) if isinstance(value, float) else str(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _number(value: float) -> str:
    text = f"{value:g}"
    return f"{text}.0" if text.lstrip("-").isdigit() else text


def _tags(context: Mapping[str, Any]) -> list[str]:
    """Members of a union that pydantic lists."""
    return [tag.strip(" '") for tag in context.get("expected_tags", "").split(", ") if tag]


def _description(model: type[BaseModel], path: tuple[str, ...], data: Any) -> str:
    """Description of a key from the models: "noise_std: Noise standard deviation of every gauge."."""
    while path:
        for section in sections_at(model, path[:-1], data) if not path[-1].isdigit() else ():
            field = fields_of(section).get(path[-1])
            if field is not None and field.description:
                return f"{path[-1]}: {field.description}"
        path = path[:-1]  # an entry of a list, or of a mapping by names, is what its list or mapping is
    return ""


SET_OF_A_SUITE = re.compile(r"(set|runs\.\d+\.set)\.(.+)")
"""Keys of a suite that contain one whole dotted key: `--set set.place.keep=6`."""


@dataclass(frozen=True)
class Override:
    """An override: dotted key, value, and location ("--set KEY", "file:line:column")."""

    key: str
    value: Any
    where: str


def parsed(override: str) -> Override:
    """Parse an override KEY=VALUE. Raises ConfigError if it has another form."""
    key, equals, text = override.partition("=")
    key = key.strip()
    if not equals or not DOTTED.fullmatch(key):
        raise ConfigError(f"'{override}' is not KEY=VALUE", where="--set", remedy="use the form --set place.keep=6")
    try:
        return Override(key, parse(text).data, f"--set {key}")
    except YamlProblem as problem:
        raise ConfigError(
            problem.what, where=f"--set {key}", remedy=problem.remedy or "use single quotes, --set 'KEY=VALUE'"
        ) from None


def put(data: dict[str, Any], override: Override) -> list[str]:
    """Set the value at its key, and create missing mappings on the way.

    Returns the dotted keys of the created mappings. Raises ConfigError for a list entry that does not exist."""
    *parents, last = override.key.split(".")
    if data.get("kind") == "suite" and (split := SET_OF_A_SUITE.fullmatch(override.key)):
        parents, last = split[1].split("."), split[2]
    spot: Any = data
    created = []
    for i, part in enumerate(parents, start=1):
        if isinstance(spot, list):
            place: Any = _index(spot, part, override)
            below = spot[place]
        else:
            place, below = part, spot.get(part)
        if not isinstance(below, dict | list):
            spot[place] = below = {}
            created.append(".".join(parents[:i]))
        spot = below
    # a copy: a later override may change a part of it, and a suite gives the same one to every run
    spot[_index(spot, last, override) if isinstance(spot, list) else last] = deepcopy(override.value)
    return created


def _index(entries: Sequence[Any], part: str, override: Override) -> int:
    if (place := place_in(part, len(entries))) is None:
        raise ConfigError(
            f"the list of length {len(entries)} has no entry '{part}'",
            where=override.where,
            remedy="use the index of an existing entry (first index: 0), or set the whole list, "
            f"{override.key.partition('.' + part)[0]}: [a, b]",
        )
    return place


def explained(problem: Problem, created: Sequence[str], model: type[BaseModel], data: Any) -> Problem:
    """Extend the remedy if a key is missing in a section that only an override created."""
    section = next((key for key in created if problem.key.startswith(f"{key}.")), None)
    if section is None or not problem.what.startswith(MISSING):
        return problem
    *parents, name = section.split(".")
    if name in keys_at(model, parents, data):
        return replace(problem, remedy=f"add the section `{section}` to the config; {problem.remedy}")
    for part in parents:
        data = data[int(part) if isinstance(data, list) else part]
    known = [key for key in data if key != name]
    return replace(problem, remedy=did_you_mean(name, known, problem.remedy))


def explain_suite_key(problem: Problem, overrides: Sequence[Override]) -> Problem:
    """Extend the remedy for a suite, which sets keys of its runs under `set`."""
    from strainsight.config.bench.bench import BenchConfig
    from strainsight.config.placement import PlacementConfig

    if problem.what != UNKNOWN or problem.key not in PlacementConfig.model_fields | BenchConfig.model_fields:
        return problem
    matches = [o for o in overrides if o.key == problem.key or o.key.startswith(f"{problem.key}.")]
    if not matches:
        return replace(problem, remedy=f"to set keys in every run of the suite, write set: {{{problem.key}.KEY: …}}")
    value = matches[-1].value
    return replace(
        problem,
        remedy="to set the key in every run of the suite, write "
        f"set.{matches[-1].key}={value if isinstance(value, str) else json.dumps(value)}",
    )

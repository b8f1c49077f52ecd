"""What pydantic found, said for the person who wrote the config."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import groupby
from typing import Any

from pydantic import BaseModel, ValidationError

from strainsight.config.base import Problem
from strainsight.config.keys import fields_of, keys_at, path_in, sections_at, types_of
from strainsight.errors import did_you_mean

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
"""What YAML 1.1 took for true and false."""
UNKNOWN, MISSING = "unknown key", "missing"
BOUNDS = {
    "greater_than": ("gt", "above"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "below"),
    "less_than_equal": ("le", "at most"),
}


def problems_of(error: ValidationError, model: type[BaseModel], data: Any) -> list[Problem]:
    """Every problem of a ValidationError, in the terms of the config file; one for each key."""
    found = [
        (path_in(model, data, entry["loc"]), entry) for entry in error.errors(include_url=False) if not _emptied(entry)
    ]
    # The members of a union complain one after the other about the same value.
    problems = [
        _problem(path, [entry for _, entry in group], model, data)
        for path, group in groupby(found, key=lambda pair: pair[0])
    ]
    # A misspelt key is one problem, not an unknown key and a missing one.
    misspelt = {
        f"{problem.key.rpartition('.')[0]}.{problem.remedy.removeprefix('did you mean ').rstrip('?')}".lstrip(".")
        for problem in problems
        if problem.what == UNKNOWN
    }
    return [problem for problem in problems if problem.what != MISSING or problem.key not in misspelt]


def _emptied(entry: Any) -> bool:
    """Whether a list only counts as too short because its entries were refused, each with a problem of its own."""
    return entry["type"] == "too_short" and len(entry["input"]) >= entry["ctx"]["min_length"]


def _problem(path: tuple[str, ...], entries: list[Any], model: type[BaseModel], data: Any) -> Problem:
    key, first = ".".join(path), entries[0]
    match first["type"]:
        case "extra_forbidden" if path[-1].isdigit() and first["input"] is None and len(path) > 1:
            # {ratio: 0,01} is {ratio: 0, "01": null}
            return Problem(
                ".".join(path[:-1]), f"',{path[-1]}' is no key", "write a number with a decimal point, as in 0.01"
            )
        case "extra_forbidden":
            known = keys_at(model, path[:-1], data)
            return Problem(key, UNKNOWN, did_you_mean(path[-1], known, f"known here: {', '.join(known)}"), True)
        case "missing" if (path and path[-1].isdigit()) or isinstance(first["input"], list):
            above = ".".join(path[:-1]) if path and path[-1].isdigit() else key
            return Problem(
                above, f"{len(first['input'])} entries are too few", _description(model, tuple(above.split(".")), data)
            )
        case "missing":
            return Problem(key, MISSING, _description(model, path, data), True)
        case "string_pattern_mismatch" if first["loc"][-1] == "[key]" or path[-1] in ("name", "suffix"):
            return Problem(key, f"{_shown(first['input'])} is not a name", "letters, digits, - and _ only", True)
        case "union_tag_not_found":
            known = _choices(first["ctx"].get("expected_tags", ""), model, path, data)
            return Problem(key, "missing key 'type'", f"give type: {' or '.join(known)}" if known else "")
        case "union_tag_invalid":
            known = [tag.strip().strip("'") for tag in first["ctx"]["expected_tags"].split(", ")]
            tag = first["ctx"]["tag"]
            return Problem(
                f"{key}.type",
                f"'{tag}' is not one of {', '.join(known)}",
                did_you_mean(str(tag), known, "choose one of them"),
            )
        case "one_key":
            given, known = first["input"], keys_at(model, path, data)
            alone = isinstance(given, dict) and len(given) == 1 and not {*given} <= {*known}
            meant = did_you_mean(str(*given), known) if alone else ""
            return Problem(key, first["msg"], meant or _description(model, path, data))
    if first["input"] is None and first["type"] != "missing":
        return Problem(key, "left blank", _description(model, path, data), at_key=True)
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
            wanted.append(f"{'at least' if 'short' in kind else 'at most'} {limit} long")
        else:
            wanted.append(entry["msg"][0].lower() + entry["msg"][1:])
    remedy = did_you_mean(value, choices) if choices and isinstance(value, str) else ""
    if choices and not wanted:
        return Problem(key, f"{_shown(value)} is not one of {', '.join(choices)}", remedy)
    if choices:
        wanted.append(f"one of {', '.join(choices)}" if len(choices) > 1 else f"'{choices[0]}'")
    if isinstance(value, str) and "a number" in wanted and not remedy:
        comma = re.fullmatch(r"([-+]?\d+),(\d+)", value.strip())
        remedy = "write it without quotes and without its unit"
        if comma:
            remedy = f"write it with a decimal point: {comma[1]}.{comma[2]}"
    if isinstance(value, str) and wanted == ["true or false"] and value.lower() in YES | NO:
        remedy = f"write {'true' if value.lower() in YES else 'false'}"
    return Problem(key, f"{_shown(value)} has to be {' or '.join(dict.fromkeys(wanted))}", remedy)


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


def _choices(tags: str, model: type[BaseModel], path: tuple[str, ...], data: Any) -> list[str]:
    if tags:
        return [tag.strip().strip("'") for tag in tags.split(", ")]
    return [tag for section in sections_at(model, path, data) for tag in types_of(section)]


def _description(model: type[BaseModel], path: tuple[str, ...], data: Any) -> str:
    """What the models say about a key: "noise_std: Noise standard deviation of every gauge."."""
    while path:
        for section in sections_at(model, path[:-1], data) if not path[-1].isdigit() else ():
            field = fields_of(section).get(path[-1])
            if field is not None and field.description:
                return f"{path[-1]}: {field.description}"
        path = path[:-1]  # an entry of a list, or of a mapping by names, is what its list or mapping is
    return ""

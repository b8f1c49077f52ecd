"""Part of a config that a stage declares; the stage reads only these keys, and only these enter its key."""

from __future__ import annotations

import json
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, TypeVar

from pydantic import BaseModel

M = TypeVar("M", bound=BaseModel)


def attributes_of(data: Mapping[str, Any]) -> SimpleNamespace:
    """JSON data with its keys as attributes; a key that was not declared is an AttributeError."""
    values: SimpleNamespace = json.loads(canonical(data), object_hook=lambda entry: SimpleNamespace(**entry))
    return values


def declared(model: M, data: Mapping[str, Any]) -> M:
    """The same config model with no more than the keys of `data`, its pruned JSON form; all else is an AttributeError.

    Frozen models stay what they are: their types hold, and a key that a stage did not declare is not there to be read."""
    fields = type(model).model_fields
    declared = {
        name: _declared(getattr(model, name), data[info.alias or name])
        for name, info in fields.items()
        if (info.alias or name) in data
    }
    pruned = type(model).__new__(type(model))
    for name, value in (
        ("__dict__", declared),
        ("__pydantic_fields_set__", set(declared)),
        ("__pydantic_extra__", None),
        ("__pydantic_private__", None),
    ):
        object.__setattr__(pruned, name, value)
    return pruned


def _declared(value: Any, data: Any) -> Any:
    if isinstance(value, BaseModel):
        return declared(value, data)
    if isinstance(value, dict):
        return {key: _declared(value[key], data[key]) for key in data}
    return value  # lists are declared whole


def expand(data: Any, pattern: str) -> list[str]:
    """Dotted paths of `data` that match `pattern`; `*` stands for every key of a mapping, every place of a list."""
    matches: list[tuple[str, Any]] = [("", data)]
    for part in pattern.split("."):
        step: list[tuple[str, Any]] = []
        for path, value in matches:
            below = _below(value)
            keys = list(below) if part == "*" else [part] * (part in below)
            step += [(f"{path}.{key}" if path else key, below[key]) for key in keys]
        matches = step
    return [path for path, _ in matches]


def look_up(data: Any, path: str) -> Any:
    """Value at a dotted path."""
    for part in path.split("."):
        data = _below(data)[part]
    return data


def _below(value: Any) -> Mapping[str, Any]:
    """Next parts of a dotted path: keys of a mapping, or indices of a list from 0."""
    if isinstance(value, list | tuple):
        return {str(place): item for place, item in enumerate(value)}
    return value if isinstance(value, Mapping) else {}


def prune(data: Mapping[str, Any], reads: tuple[str, ...]) -> dict[str, Any]:
    """The declared part of `data`, nested as in `data`. A pattern without `*` that matches nothing is a ValueError.

    Below a `*` the empty mapping itself stays, so that "no parameters" is a fact the stage can read. Lists are declared
    whole."""
    selected: dict[str, Any] = {}
    for pattern in reads:
        paths = expand(data, pattern)
        if not paths and "*" not in pattern:
            raise ValueError(f"definition of a stage: `reads` contains '{pattern}', but the config has no such key")
        before_star = pattern.split(".*")[0]
        if "*" in pattern and expand(data, before_star):
            _put(selected, before_star, {})
        for path in paths:
            _put(selected, path, look_up(data, path))
    return selected


def _put(target: dict[str, Any], path: str, value: Any) -> None:
    *parents, last = path.split(".")
    for part in parents:
        target = target.setdefault(part, {})
    if isinstance(value, Mapping):
        below = target.setdefault(last, {})
        for key, item in value.items():
            _put(below, key, item)
    else:
        target[last] = value


def canonical(value: Any) -> str:
    """JSON with sorted keys and no spaces: equal values give equal text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


def differences(old: Any, new: Any, path: str = "") -> list[tuple[str, Any, Any]]:
    """Leaves that differ, as (dotted path, old, new); `...` stands for absent. In the order of `new`, then of `old`."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        changes = []
        for key in [*new, *(key for key in old if key not in new)]:
            below = f"{path}.{key}" if path else key
            if key not in old or key not in new:
                changes.append((below, old.get(key, ...), new.get(key, ...)))
            else:
                changes += differences(old[key], new[key], below)
        return changes
    return [] if canonical(old) == canonical(new) else [(path, old, new)]

"""Values from outside the file of a config: --set KEY=VALUE, and what a suite sets."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

from pydantic import BaseModel

from strainsight.config.base import Problem
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.keys import keys_at, place_in
from strainsight.config.messages import MISSING, UNKNOWN
from strainsight.config.placement import PlacementConfig
from strainsight.config.suite import DOTTED
from strainsight.config.yaml_text import YamlProblem, parse
from strainsight.errors import ConfigError, did_you_mean

SET_OF_A_SUITE = re.compile(r"(set|runs\.\d+\.set)\.(.+)")
"""A key of a suite below which one dotted key follows as a whole: `--set set.place.keep=6`."""


@dataclass(frozen=True)
class Override:
    """A value from outside the file: dotted key, value, and where it was given ("--set KEY", "file:line:column")."""

    key: str
    value: Any
    where: str


def parsed(override: str) -> Override:
    """The override of a text KEY=VALUE. Raises ConfigError where it is none."""
    key, equals, text = override.partition("=")
    key = key.strip()
    if not equals or not DOTTED.fullmatch(key):
        raise ConfigError(f"'{override}' is not KEY=VALUE", where="--set", remedy="write --set place.keep=6")
    try:
        return Override(key, parse(text).data, f"--set {key}")
    except YamlProblem as problem:
        raise ConfigError(
            problem.what, where=f"--set {key}", remedy=problem.remedy or "quote what the shell must not see"
        ) from None


def put(data: dict[str, Any], override: Override) -> list[str]:
    """Put the value at its key; a mapping on the way that is not there, or is a plain value so far, is made.

    Returns the dotted keys of the mappings that were made. Raises ConfigError for a list's entry that is not there.
    """
    *parents, last = override.key.split(".")
    if data.get("kind") == "suite" and (found := SET_OF_A_SUITE.fullmatch(override.key)):
        parents, last = found[1].split("."), found[2]
    spot: Any = data
    made = []
    for i, part in enumerate(parents, start=1):
        if isinstance(spot, list):
            place: Any = _index(spot, part, override)
            below = spot[place]
        else:
            place, below = part, spot.get(part)
        if not isinstance(below, dict | list):
            spot[place] = below = {}
            made.append(".".join(parents[:i]))
        spot = below
    # a copy: a later override may change a part of it, and a suite gives the same one to every run
    spot[_index(spot, last, override) if isinstance(spot, list) else last] = deepcopy(override.value)
    return made


def _index(entries: Sequence[Any], part: str, override: Override) -> int:
    if (place := place_in(part, len(entries))) is None:
        raise ConfigError(
            f"a list of {len(entries)} entries has no entry '{part}'",
            where=override.where,
            remedy=f"count from 0, or set the whole list, {override.key.partition('.' + part)[0]}: [a, b]",
        )
    return place


def explained(problem: Problem, made: Sequence[str], model: type[BaseModel], data: Any) -> Problem:
    """For a key that is missing in a section which only an override made: is the section misspelt, or new to the config?"""
    section = next((key for key in made if problem.key.startswith(f"{key}.")), None)
    if section is None or not problem.what.startswith(MISSING):
        return problem
    *parents, name = section.split(".")
    if name in keys_at(model, parents, data):
        return replace(problem, remedy=f"the config has no section `{section}` yet: add it; {problem.remedy}")
    for part in parents:
        data = data[int(part) if isinstance(data, list) else part]
    known = [key for key in data if key != name]
    return replace(problem, remedy=did_you_mean(name, known, problem.remedy))


def meant_for_runs(problem: Problem, given: Sequence[Override]) -> Problem:
    """Say how a suite sets a key of its runs."""
    if problem.what != UNKNOWN or problem.key not in PlacementConfig.model_fields | BenchConfig.model_fields:
        return problem
    made = [o for o in given if o.key == problem.key or o.key.startswith(f"{problem.key}.")]
    written = (
        f"set.{made[-1].key}={_written(made[-1].value)}"
        if made
        else f"the keys below it as set: {{{problem.key}.KEY: …}}"
    )
    return replace(problem, remedy=f"write {written}")


def _written(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)

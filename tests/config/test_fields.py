"""Every key of a config stands in an example that ships, or is marked as an expert key; the template has no expert key."""

from __future__ import annotations

import inspect
import re

import pytest

from strainsight.config.deck_properties import Answers, CandidateLocation, LoadAnswer, Suggestion
from strainsight.config.keys import Override, fields_of, put, sections_at
from strainsight.config.load import KINDS, model_and_check
from strainsight.config.template import template
from strainsight.config.yaml_text import parse

from ..shared import ROOT

SHIPPED = sorted([*(ROOT / "configs").rglob("*.yaml"), *(ROOT / "docs").rglob("*.yaml")])
DISCRIMINATORS = ("kind", "type")


def declared(section, key):
    """The class that declares the field behind a key, and its name."""
    name = next(name for name, field in section.model_fields.items() if (field.alias or name) == key)
    return next(kind for kind in section.__mro__ if name in inspect.get_annotations(kind)), name


def sections_below(model, known):
    """All mappings that a config of this model may hold."""
    if model in known:
        return known
    known.append(model)
    for key in fields_of(model):
        for member in sections_at(model, (key,), {}):
            open_ = [member]
            while open_:
                kind = open_.pop()
                if fields_of(kind):
                    sections_below(kind, known)
                else:
                    open_ += [arg for arg in getattr(kind, "__args__", ()) if arg is not kind]
                    open_ += [kind.__origin__] if hasattr(kind, "__metadata__") else []
    return known


def paths_in(data, above=()):
    entries = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in entries:
        yield (*above, str(key))
        yield from paths_in(value, (*above, str(key)))


def keys_of(model, data):
    """The fields that data of this model set."""
    for path in paths_in(data):
        for section in sections_at(model, path[:-1], data):
            if path[-1] in fields_of(section):
                yield declared(section, path[-1])


def keys_in_file(path):
    data = parse(path.read_text(encoding="utf-8")).data
    yield from keys_of(model_and_check(data["kind"])[0], data)
    runs = data["runs"] if data["kind"] == "suite" else ()
    for run in {(run["config"], *sorted({**data.get("set", {}), **run.get("set", {})})): run for run in runs}.values():
        own = parse((path.parent / run["config"]).read_text(encoding="utf-8")).data
        for key, value in {**data.get("set", {}), **run.get("set", {})}.items():
            put(own, Override(key, value, ""))
        yield from keys_of(model_and_check(own["kind"])[0], own)


def keys_in_manual():
    for page in sorted((ROOT / "docs").rglob("*.md")):
        for text in re.findall(r"```yaml\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
            data = parse(text).data
            for model, _ in map(model_and_check, KINDS):
                if isinstance(data, dict) and {*data} <= {*fields_of(model)}:
                    yield from keys_of(model, data)


def templates():
    place = CandidateLocation("node", "2", "a node")
    for found in (Suggestion(), Suggestion(several_moduli=True, supports=False, thin=("a",), contact="open")):
        for find in ("modulus", "load"):
            yield template("part.bdf", found, Answers(find=find, loads=(LoadAnswer(place),), support=place, axis="[1, 0, 0]"))


@pytest.fixture(scope="module")
def in_template():
    model = model_and_check("placement")[0]
    return {key for text in templates() for key in keys_of(model, parse(text).data)}


@pytest.fixture(scope="module")
def in_examples(in_template):
    return in_template.union(*map(keys_in_file, SHIPPED), keys_in_manual())


@pytest.fixture(scope="module")
def fields():
    sections: list = []
    for model, _ in map(model_and_check, KINDS):
        sections_below(model, sections)
    known = {declared(section, key): field for section in sections for key, field in fields_of(section).items()}
    return {key: field for key, field in known.items() if key[1] not in DISCRIMINATORS}


def expert(field):
    return bool((field.json_schema_extra or {}).get("expert"))


def test_a_key_is_in_an_example_or_marked_as_an_expert_key(fields, in_examples):
    assert [key for key, field in fields.items() if key not in in_examples and not expert(field)] == []
    assert [key for key, field in fields.items() if key in in_examples and expert(field)] == []


def test_the_template_has_no_expert_key(fields, in_template):
    assert len(in_template) > 50
    assert [key for key in in_template if key in fields and expert(fields[key])] == []


def test_no_more_keys_are_defined_than_600(fields):
    assert 500 < len(fields) <= 600

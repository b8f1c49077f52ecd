"""What is generated from the models: the committed schema and the template."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from strainsight.config.answers import Answers, Place
from strainsight.config.load import load_config
from strainsight.config.schema import schema_text
from strainsight.config.template import template

ROOT = Path(__file__).parents[2]


def test_the_committed_schema_is_that_of_the_models():
    assert (ROOT / "docs" / "config.schema.json").read_text(encoding="utf-8") == schema_text()


def test_every_field_of_the_schema_is_described():
    def fields(node):
        if isinstance(node, dict):
            yield from node.get("properties", {}).items()
            for value in node.values():
                yield from fields(value)
        elif isinstance(node, list):
            for value in node:
                yield from fields(value)

    found = list(fields(json.loads(schema_text())))
    assert len(found) > 60
    assert [name for name, field in found if not (field.get("description") or field.get("$ref"))] == []


@pytest.mark.parametrize("deck", ["my deck.bdf", "../parts/hub-7.nas", "ünïcode.bdf", "it's: #1.bdf", "0815.dat"])
def test_the_template_is_valid_for_any_deck_name(tmp_path, deck):
    path = tmp_path / "own.yaml"
    told = Answers(load=Place("node", "2", "a node"), direction="[0, 0, 1]", amplitude=1e4, frequency=20.0)
    path.write_text(template(deck, answers=told), encoding="utf-8")
    assert load_config(path).data["mesh"]["file"] == deck

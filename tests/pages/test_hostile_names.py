"""Names that are attacks come out as words: from a deck and a config through every stage into the browser."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from strainsight_cli.main import app

from . import answers, checks, hostile, tables
from .every import (  # noqa: F401  every page has to pass these
    test_every_picture_has_words,
    test_it_fits_a_phone,
    test_it_is_photographed_and_printed,
    test_it_opens_without_a_word_and_asks_for_nothing,
    test_its_markup_and_styles_are_valid,
    test_there_is_no_barrier_in_light_or_in_dark,
)
from .runs import page_of


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("hostile")


@pytest.fixture(scope="module")
def config(folder):
    return hostile.config(folder)


@pytest.fixture(scope="module")
def report(folder, config):
    return page_of(config, folder / "results")


def test_names_of_the_deck_stand_on_the_page_as_they_are(look, report):
    words = checks.harmless(look(report))
    for name in hostile.IN_A_DECK:
        assert name in words


def test_the_numbers_of_a_load_and_a_parameter_are_those_of_the_artefacts(look, report):
    found = look(report)
    answers.opens_with_the_numbers_of_the_artefacts(found)
    answers.has_no_other_digit(found)


def test_tables_with_such_names_sort_copy_and_save(look, report):
    page = look(report).page
    tables.all_work(page, "beam-hostile")
    checks.quiet(look(report))


@pytest.mark.parametrize("name", hostile.NAMES)
@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("name: beam-hostile", "name: {}", "name"),
        ("  " + "E" * 64 + ":", "  {}:", "parameters"),
        ("  " + "F" * 64 + ":", "  {}:", "loads"),
    ],
)
def test_what_becomes_a_path_or_a_key_is_refused_with_its_place(folder, config, old, new, key, name):
    text = config.read_text(encoding="utf-8")
    assert text.count(old) == 1
    changed = folder / "refused.yaml"
    changed.write_text(text.replace(old, new.format(hostile.quoted(name))), encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(changed), "--results", str(folder / "none")])
    said = done.output + (done.stderr or "")
    assert done.exit_code == 2, said
    line = text[: text.index(old)].count("\n") + 1
    assert f"refused.yaml:{line}:" in said
    assert key in said
    assert "Traceback" not in said
    assert not (folder / "none").exists()

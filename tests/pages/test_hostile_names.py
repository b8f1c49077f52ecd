"""Names that are attacks come out as words: from a deck and a config through every stage into the browser."""

from __future__ import annotations

import pytest

from . import answers, checks, hostile, tables
from .every import *  # noqa: F403  every page has to pass these
from .runs import page_of

pytestmark = pytest.mark.slow


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

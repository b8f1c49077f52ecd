"""Names that are attacks come out as words: from a deck, a config and a suite through every stage into the browser."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight_cli.main import app

from . import answers, checks, hostile, tables
from .every import *  # noqa: F403  every page has to pass these

pytestmark = pytest.mark.slow
PLACEMENT, SUITE = "beam-hostile", "hostile-suite"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Of a suite of placements whose title, labels and notes are such names, too."""
    folder = tmp_path_factory.mktemp("hostile")
    suite = hostile.suite(folder, hostile.config(folder))
    done = CliRunner().invoke(app, ["run", str(suite), "--results", str(folder / "results")])
    assert done.exit_code == 0, done.output
    return folder / "results"


@pytest.fixture(scope="module", params=[PLACEMENT, SUITE])
def report(request, results):
    return results / request.param / "report.html"


@pytest.fixture
def placement(look, results):
    return look(results / PLACEMENT / "report.html")


@pytest.fixture
def suite(look, results):
    return look(results / SUITE / "report.html")


def test_names_of_the_deck_stand_on_the_page_as_they_are(placement):
    words = checks.harmless(placement)
    for name in hostile.IN_A_DECK:
        assert name in words


def test_every_text_of_the_suite_stands_on_its_page_as_it_is(suite):
    words = checks.harmless(suite)
    for name in hostile.NAMES:
        assert name in words


def test_the_numbers_of_a_load_and_a_parameter_are_those_of_the_artefacts(placement):
    answers.opens_with_the_numbers_of_the_artefacts(placement)
    answers.has_no_other_digit(placement)


def test_the_first_table_of_the_suite_has_the_numbers_of_the_runs(suite):
    shown = [value for _, numbers in answers.rows(suite, "#answer") for value in numbers]
    with h5py.File(suite.file.parent / "suite.h5") as artefact:
        # The page opens with a load's error after smoothing, and with a parameter's error and claim as filtered.
        told = {key: artefact[f"unknown/{key}"][()] for key in ("name", "error", "std", "smoothed")}
        load = np.char.startswith(told["name"].astype(bytes), b"F")
        errors = [*told["smoothed"][load], *told["error"][~load], *told["std"][~load]]
        wanted = [*errors, *artefact["run/gap"][()], *artefact["run/metric_final"][()]]
    wanted = [float(value) for value in wanted if value == value]
    assert len(wanted) > 8
    assert [value for value in wanted if value not in shown] == []


def test_links_within_the_page_lead_somewhere(suite):
    page = suite.page
    links = page.locator('a[href^="#"]')
    assert links.count() > 3
    for i in range(links.count()):
        links.nth(i).click()
        target = links.nth(i).get_attribute("href")
        assert page.evaluate("id => document.getElementById(id).getBoundingClientRect().top < innerHeight", target[1:])


def test_its_tables_sort_copy_and_save_with_all_digits(look, report):
    found = look(report)
    assert tables.all_work(found.page, report.parent.name)
    checks.quiet(found)


def test_a_formula_in_a_table_is_none_in_a_spreadsheet(suite):
    """A text that begins with =, + or @ is saved with an apostrophe before it."""
    texts = []
    for name in tables.unfolded(suite.page):
        texts += [text for row in tables.saved(tables.table_named(suite.page, name))[1] for text in row]
    assert any(hostile.FORMULA in text for text in texts)
    assert not [text for text in texts if text.startswith(("=", "+", "@"))]

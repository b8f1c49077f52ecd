"""The page of a suite of placements, whose title, labels and notes are attacks: an answer a run first, tables, pictures."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from . import answers, checks, hostile, tables
from .every import *  # noqa: F403  every page has to pass these
from .runs import page_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("suite")
    return page_of(hostile.suite(folder, hostile.config(folder)), folder / "results", name="hostile-suite")


def test_every_text_of_the_suite_stands_on_its_page_as_it_is(look, report):
    words = checks.harmless(look(report))
    for name in hostile.NAMES:
        assert name in words


def test_its_first_table_has_the_numbers_of_the_runs(look, report):
    """Errors and claims, and the metric and the distance from the best set of every run, from suite.h5."""
    found = look(report)
    shown = [value for _, numbers in answers.rows(found, "#answer") for value in numbers]
    with h5py.File(report.parent / "suite.h5") as suite:
        # The page opens with a load's error after smoothing, and with a parameter's error and claim as filtered.
        told = {key: suite[f"unknown/{key}"][()] for key in ("name", "error", "std", "smoothed")}
        load = np.char.startswith(told["name"].astype(bytes), b"F")
        errors = [*told["smoothed"][load], *told["error"][~load], *told["std"][~load]]
        wanted = [*errors, *suite["run/gap"][()], *suite["run/metric_final"][()]]
    wanted = [float(value) for value in wanted if value == value]
    assert len(wanted) > 8
    assert [value for value in wanted if value not in shown] == []


def test_links_within_the_page_lead_somewhere(look, report):
    """Each, when it is clicked, brings its place into the window."""
    page = look(report).page
    links = page.locator('a[href^="#"]')
    assert links.count() > 3
    for i in range(links.count()):
        links.nth(i).click()
        target = links.nth(i).get_attribute("href")
        assert page.evaluate("id => document.getElementById(id).getBoundingClientRect().top < innerHeight", target[1:])


def test_its_tables_sort_copy_and_save_with_all_digits(look, report):
    assert tables.all_work(look(report).page, "hostile-suite")


def test_a_formula_in_a_table_is_none_in_a_spreadsheet(look, report):
    """A text that begins with =, + or @ is saved with an apostrophe before it."""
    page = look(report).page
    texts = []
    for name in tables.unfolded(page):
        texts += [text for row in tables.saved(tables.table_named(page, name))[1] for text in row]
    assert any(hostile.FORMULA in text for text in texts)
    assert not [text for text in texts if text.startswith(("=", "+", "@"))]

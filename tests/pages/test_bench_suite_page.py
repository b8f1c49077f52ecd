"""The page of a suite of benches, whose studies, labels, notes and statements are attacks."""

from __future__ import annotations

import h5py
import pytest

from . import checks, hostile, tables
from .every import *  # noqa: F403  every page has to pass these
from .runs import page_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("benches")
    return page_of(hostile.bench_suite(folder), folder / "results", name="hostile-benches")


def test_every_text_of_the_suite_stands_on_its_page_as_it_is(look, report):
    words = checks.harmless(look(report))
    for name in hostile.NAMES:
        assert name in words


def test_its_tables_sort_copy_and_save_with_all_digits(look, report):
    found = look(report)
    assert len(tables.all_work(found.page, "hostile-benches")) >= 4
    values = [float(text) for text in found.page.locator("main data").evaluate_all("all => all.map(e => e.value)")]
    with h5py.File(report.parent / "suite.h5") as suite:
        wanted = [float(error) for error in suite["unknown/error"][()] if error == error]
    assert len(wanted) == 4
    assert [error for error in wanted if error not in values] == []


def test_links_within_the_page_lead_somewhere(look, report):
    """Each, when it is clicked, brings its place into the window."""
    page = look(report).page
    links = page.locator('a[href^="#"]')
    assert links.count() > 3
    for i in range(links.count()):
        links.nth(i).click()
        target = links.nth(i).get_attribute("href")
        assert page.evaluate("id => document.getElementById(id).getBoundingClientRect().top < innerHeight", target[1:])

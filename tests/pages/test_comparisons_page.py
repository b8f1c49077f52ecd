"""The page of a suite with what a source says beside what comes out: a row of every verdict, whose texts are attacks."""

from __future__ import annotations

import pytest

from . import checks, hostile, tables
from .every import (  # noqa: F401  every page has to pass these
    test_every_picture_has_words,
    test_it_fits_a_phone,
    test_it_is_photographed_and_printed,
    test_it_opens_without_a_word_and_asks_for_nothing,
    test_its_markup_and_styles_are_valid,
    test_there_is_no_barrier_in_light_or_in_dark,
)
from .runs import page_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("comparisons")
    return page_of(hostile.comparing_suite(folder), folder / "results", name="hostile-comparisons")


def test_every_text_stands_on_the_page_as_it_is_and_no_markup_is_seen(look, report):
    words = checks.harmless(look(report))
    for name in hostile.NAMES:
        assert name in words
    for markup in ("<data", "</p>", "<small", "<strong", 'class="why"'):
        assert markup not in words


def test_a_row_has_its_verdict_and_the_one_without_a_reason_is_marked(look, report):
    page = look(report).page
    rows = page.locator("table.comparisons tbody tr")
    wanted = ["holds", "holds under its settings only", "holds under ours only", "contradicted", "not measured", "contradicted"]
    assert rows.count() == len(wanted)
    for i, verdict in enumerate(wanted):
        last = rows.nth(i).locator("td").last.inner_text()
        assert last.lstrip("✓✕– ").startswith(verdict)
        assert ("no reason is given" in last) is (i == 5)


def test_links_lead_to_rows_and_runs_by_click_and_by_keyboard(look, report):
    page = look(report).page
    links = page.locator('a[href^="#comparison-"], table.comparisons a[href^="#run-"]')
    assert links.count() >= 5 + 8
    for i in range(links.count()):
        target = links.nth(i).get_attribute("href")[1:]
        assert page.locator(f'[id="{target}"]').count() == 1
        if i % 2:
            links.nth(i).click()
        else:
            links.nth(i).focus()
            page.keyboard.press("Enter")
        assert page.evaluate("id => document.getElementById(id).getBoundingClientRect().top < innerHeight", target)


def test_its_tables_sort_copy_and_save_with_all_digits(look, report):
    assert len(tables.all_work(look(report).page, "hostile-comparisons")) >= 2

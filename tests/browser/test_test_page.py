"""The page of a test in a browser: from findings whose signals are known, in the cases that put most and least on it."""

from __future__ import annotations

import pytest

from strainsight.pages.tested.figures import figures_of_test
from strainsight.pages.tested.page import page_of_test, views_of
from strainsight.pages.view.viewing import screenshots

from ..pages.tested.findings import CASES
from . import answers, space, tables
from .every import *  # noqa: F403  every page has to pass these

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=["plain", "σ withheld", "sensors", "held out"])
def report(request, tmp_path_factory):
    """The page, in a folder of the case's name, by which its pictures are called."""
    own = CASES[request.param]()
    folder = tmp_path_factory.mktemp("pages") / f"test-{request.param.replace(' ', '-').replace('σ', 'sigma')}"
    folder.mkdir()
    page = page_of_test(own, figures_of_test(own), tuple(screenshots(views_of(own))))
    (folder / "test.html").write_text(page, encoding="utf-8")
    return folder / "test.html"


def test_every_number_of_the_first_screen_is_exact(look, report):
    labels = ("G2.2", "G2.3", "G4.2", *(f"G{i}" for i in range(1, 7)))
    answers.has_no_other_digit(look(report), "run <7>.csv", "3.1 times", *labels)


def test_its_tables_sort_and_those_of_one_unit_copy_and_save(look, report):
    page = look(report).page
    names = tables.unfolded(page)
    assert {"channels", "extremes", "calibration"} <= set(names)
    for name in names:
        table = tables.table_named(page, name)
        head = tables.copied(table)[0]
        if any(text.endswith(", unit") for text in head):
            tables.sorts_by_every_head(table)
            assert name in ("channels", "extremes", "filters compared")
        else:
            tables.works(table, "beam", name)


def test_the_structure_turns_and_carries_the_stress(look, report):
    found = look(report)
    space.shows_a_structure(found)
    space.turns_under_the_mouse(found)
    assert found.page.locator(".scale:visible").count() == 3  # two maps and the state in space
    space.shows_strain(found)

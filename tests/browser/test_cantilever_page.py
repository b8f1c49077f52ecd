"""The page of a placement: the cantilever's four gauges for its modulus, as people open and use it."""

from __future__ import annotations

import pytest

from ..shared import COARSE, ROOT, made
from . import answers, checks, space, tables
from .every import *  # noqa: F403  every page has to pass these

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report():
    return made(ROOT / "configs" / "cantilever-youngs-modulus.yaml", *COARSE)["report"].path.parent / "report.html"


@pytest.fixture(scope="module")
def gauges(report):
    return space.gauges_of(report.parent)


def test_its_numbers_are_those_of_the_artefacts(look, report):
    found = look(report)
    answers.opens_with_the_numbers_of_the_artefacts(found)
    answers.has_no_other_digit(found)


def test_its_tables_sort_copy_and_save_with_all_digits(look, report):
    found = look(report)
    names = tables.all_work(found.page, "cantilever-youngs-modulus")
    assert {"gauges", "gauges: readings", "simulated test"} <= set(names)


def test_the_structure_turns_zooms_and_obeys_the_keyboard(look, report):
    found = look(report)
    space.shows_a_structure(found)
    space.turns_under_the_mouse(found)
    space.zooms_by_the_wheel(found)
    space.obeys_the_keyboard(found)


def test_strain_and_modes_can_be_chosen(look, report):
    found = look(report, still=True)
    space.shows_strain(found)
    checks.accessible(found)
    space.moves_in_its_shapes(found)


def test_a_picked_gauge_determines_its_id_position_and_direction(look, report, gauges):
    found = look(report)
    space.picks_gauges(found, gauges)


def test_a_phone_picks_by_touch(look, report, gauges):
    found = look(report, 390, 844, touch=True)
    label = gauges[-1][0]
    found.page.locator(f'button.chip[data-gauge="{label}"]').tap()
    space.tells_of(found.page, *gauges[-1])


def test_without_scripts_it_still_answers(look, report):
    found = look(report, scripts=False)
    page = found.page
    assert page.locator("#answer .tile").count() == 2
    assert page.locator('.scroll[data-table="gauges"] tbody tr').count() == 4
    assert page.locator("#answer img").is_visible()
    assert not page.locator("#space").is_visible()
    assert not page.locator("button.sort, .tools").count()

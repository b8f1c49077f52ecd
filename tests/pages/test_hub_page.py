"""The page of the coarse hub: a solid of 88 000 unknowns with gauges along principal directions."""

from __future__ import annotations

import pytest

from ..shared import HUB, ROOT
from . import answers, space, tables
from .every import (  # noqa: F401  every page has to pass these
    test_every_picture_has_words,
    test_it_fits_a_phone,
    test_it_is_photographed_and_printed,
    test_it_opens_without_a_word_and_asks_for_nothing,
    test_its_markup_and_styles_are_valid,
    test_there_is_no_barrier_in_light_or_in_dark,
)
from .runs import shared_page

pytestmark = pytest.mark.slow
SHORT = ("name=hub-youngs-modulus", "place.instants=3", "validate.truth.modes=20", "validate.truth.model=rom")
SHORT += ("validate.duration=0.2", "validate.random_sets=2", "validate.repeats=2")


@pytest.fixture(scope="module")
def report():
    return shared_page(ROOT / "configs" / "hub" / "hub-youngs-modulus.yaml", *SHORT, beside=HUB)


def test_its_numbers_are_those_of_the_artefacts(look, report):
    found = look(report)
    answers.opens_with_the_numbers_of_the_artefacts(found)
    answers.has_no_other_digit(found)


def test_its_tables_sort_copy_and_save_with_all_digits(look, report):
    assert "gauges" in tables.all_work(look(report).page, "hub-youngs-modulus")


def test_the_structure_turns_and_its_gauges_are_picked(look, report):
    found = look(report)
    space.shows_a_structure(found)
    space.turns_under_the_mouse(found)
    space.picks_gauges(found, space.gauges_of(report.parent))


def test_its_shapes_move(look, report):
    """A mode is chosen from the list: the structure is drawn in another shape, and at rest again as before."""
    space.moves_in_its_shapes(look(report, still=True))

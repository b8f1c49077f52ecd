"""Tests that every kind of page has to pass: imported by the file of each kind, whose fixture `report` is the page's path."""

from __future__ import annotations

from . import checks


def test_it_opens_without_a_word_and_asks_for_nothing(look, report):
    checks.quiet(look(report))


def test_its_markup_is_valid(report):
    checks.valid(report)


def test_there_is_no_barrier_in_light_or_in_dark(look, report):
    checks.readable_in_both_schemes(look, report)


def test_every_picture_has_words(look, report):
    checks.told_to_the_blind(look(report))


def test_it_fits_a_phone(look, report):
    checks.fits_a_phone(look, report)


def test_it_is_photographed_and_printed(look, report):
    checks.photographed(look, report, report.parent.name)

"""Altered models end in a message of the product: a small share of the 3000 of `make fuzz`."""

from __future__ import annotations

import sys

import pytest

from .structured import case, faults, sound

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the clocks are those of Linux")


def test_altered_models_are_taken_or_refused(tmp_path):
    assert faults(2, 0, 24, tmp_path) == {}


def test_a_case_follows_from_its_number_and_differs_from_what_is_sound():
    assert case(1, 7) == case(1, 7)
    assert sum(case(1, i) not in sound() for i in range(100)) > 90

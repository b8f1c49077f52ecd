"""The frame, the tables and the numbers of a page: nothing from outside, exact values, and nothing unescaped."""

from __future__ import annotations

import base64
import math
import re
from hashlib import sha256

import numpy as np
import pytest

from strainsight.pages.page.markup import count, data, measure, pairs, share, table
from strainsight.pages.page.sections import document, policy, text_of
from strainsight.text import (
    number,
    percent,
    quantity,
    reading_unit,
)

from ..outline import HOSTILE, Outline, names_of_regions, nothing_comes_from_outside


def digest(script):
    return base64.b64encode(sha256(script.encode()).digest()).decode()


def test_the_policy_names_every_script_by_its_digest_and_allows_nothing_else():
    said = dict(part.strip().split(" ", 1) for part in policy(["one()", "zwölf()"]).split(";"))
    assert said == {
        "default-src": "'none'",
        "img-src": "data:",
        "style-src": "'unsafe-inline'",
        "script-src": f"'sha256-{digest('one()')}' 'sha256-{digest('zwölf()')}'",
    }
    # As every implementation of SHA-256 has it.
    assert digest("one()") == "HR7iaask9daLMRRskMI++QeJtjWDOjyPA6lGzYGzKW4="


def test_what_is_plain_text_comes_out_escaped():
    outline = nothing_comes_from_outside(document("k", HOSTILE, HOSTILE, "a", [], "f"))
    assert len(outline.scripts) == 1
    (main,) = [attributes for tag, attributes in outline.seen if tag == "main"]
    assert main["data-run"] == HOSTILE
    assert "".join(outline.text).count(HOSTILE) == 3


@pytest.mark.parametrize("name", ["page/tables.js", "space/draw.js", "space/view.js"])
def test_scripts_write_no_markup_and_call_nothing_in_from_a_network(name):
    markup = ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "</")
    for word in (*markup, "eval(", "new Function", "fetch(", "http"):
        assert word not in text_of(name), word


@pytest.mark.parametrize("value", [0.1 + 0.2, 1e-300, -4.0, 2.1e11, math.inf, -math.inf])
def test_the_exact_value_comes_back_to_the_last_digit(value):
    (exact,) = re.findall(r'value="([^"]+)"', data(value, "shown"))
    assert float(exact) == value
    assert float(re.findall(r'value="([^"]+)"', data(np.float64(value), "shown"))[0]) == value


def test_what_is_no_number_reports_it_and_whole_numbers_stay_whole():
    assert '"nan"' in data(math.nan, "–")
    assert count(12345) == '<data value="12345">12\u202f345</data>'
    assert share(None) == measure(None) == "–"


def test_a_unit_is_that_of_the_exact_value_not_of_the_shown_one():
    assert measure(2.1e11, "Pa") == '<data value="210000000000.0" data-unit="Pa">210\u00a0GPa</data>'
    assert "data-unit" not in share(0.1) + measure(1.0)


def test_names_and_units_come_out_escaped():
    text = table(HOSTILE, (), []) + measure(1.0, HOSTILE) + pairs(HOSTILE, [(HOSTILE, HOSTILE)])
    outline = Outline(text)
    assert "script" not in outline.tags
    assert names_of_regions(outline)[0] == f"table: {HOSTILE}"
    assert [a["data-unit"] for tag, a in outline.seen if tag == "data"] == [HOSTILE]


DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def read(text: str) -> float:
    mantissa, _, power = text.replace("−", "-").replace("\u202f", "").partition("×10")
    return float(mantissa) * 10.0 ** int(power.translate(DIGITS) or 0)


@pytest.mark.parametrize("digits", [2, 3, 4])
def test_a_shown_number_differs_by_less_than_half_of_its_last_digit(digits):
    draw = np.random.default_rng(3)
    for value in draw.choice([-1, 1], 500) * 10.0 ** draw.uniform(-15, 15, 500):
        half = 0.5 * 10.0 ** (math.floor(math.log10(abs(value))) + 1 - digits)
        assert abs(read(number(float(value), digits)) - value) <= half * (1 + 1e-9)


def test_rounding_up_to_the_next_power_of_ten_keeps_the_value():
    assert [number(0.99999), number(9.99996), number(999999.9), number(-0.0)] == ["1", "10", "1×10⁶", "0"]


def test_engineers_prefixes():
    assert quantity(2.0989e11, "Pa") == "209.9\u00a0GPa"
    assert quantity(1e4, "N") == "10\u00a0kN"
    assert quantity(1e3, "N") == "1\u00a0kN"
    assert quantity(0.0, "N") == "0\u00a0N"
    assert quantity(7850.0, "kg/m³") == "7850\u00a0kg/m³"
    assert quantity(1.43, "1") == "1.43"


def test_per_cent_keeps_its_significant_zeros():
    shown = [percent(value) for value in (0.001, 0.00052, 0.0996, 0.177, 1.0, 12.3, 1e-9, 0.0)]
    assert [text.removesuffix("\u00a0%") for text in shown] == ["0.10", "0.052", "10", "18", "100", "1200", "0.000", "0.000"]


def test_what_is_no_number_is_reported():
    numbers = [number(math.nan), number(math.inf), number(-math.inf), percent(math.inf), percent(math.nan)]
    assert numbers == ["–", "∞", "−∞", "∞", "–"]


def test_readings_are_shown_in_the_units_of_their_instruments():
    assert reading_unit(9e-5, "strain") == (1e-6, "µm/m")
    assert [reading_unit(size, "m")[1] for size in (3e-9, 4e-6, 1e-3, 2.0, 5e3)] == ["nm", "µm", "mm", "m", "m"]
    assert reading_unit(41.0, "m/s^2") == reading_unit(41.0, "m/s²") == (1.0, "m/s²")
    for size in (math.nan, math.inf, 0.0):
        assert reading_unit(size, "m") == (1.0, "m")

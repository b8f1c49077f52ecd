"""The frame and the tables of a page: nothing from outside, exact values, and nothing unescaped."""

from __future__ import annotations

import base64
import math
import re
from hashlib import sha256

import numpy as np
import pytest

from strainsight.report.page.document import document, own, policy
from strainsight.report.page.markup import count, data, measure, pairs, share, table

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
        assert word not in own(name), word


@pytest.mark.parametrize("value", [0.1 + 0.2, 1e-300, -4.0, 2.1e11, math.inf, -math.inf])
def test_the_exact_value_comes_back_to_the_last_digit(value):
    (exact,) = re.findall(r'value="([^"]+)"', data(value, "shown"))
    assert float(exact) == value
    assert float(re.findall(r'value="([^"]+)"', data(np.float64(value), "shown"))[0]) == value


def test_what_is_no_number_says_so_and_whole_numbers_stay_whole():
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

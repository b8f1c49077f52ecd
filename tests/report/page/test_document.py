"""The frame of a page: nothing from outside, and no script but those that its policy names."""

from __future__ import annotations

import base64
from hashlib import sha256

import pytest

from strainsight.report.page.document import document, own, policy

from ..outline import Outline, nothing_comes_from_outside, own_scripts

HOSTILE = '"><script>alert(1)</script>'


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


def test_scripts_run_in_their_order_after_that_of_the_tables():
    outline = nothing_comes_from_outside(document("k", "n", "t", "a", ["<p>s</p>"], "f", scripts=("one();", "two();")))
    assert own_scripts(outline) == [own("page/tables.js"), "one();", "two();"]


def test_what_is_plain_text_comes_out_escaped():
    outline = nothing_comes_from_outside(document("k", HOSTILE, HOSTILE, "a", [], "f"))
    assert len(outline.scripts) == 1
    (main,) = [attributes for tag, attributes in outline.seen if tag == "main"]
    assert main["data-run"] == HOSTILE
    assert "".join(outline.text).count(HOSTILE) == 3


def test_another_script_is_another_policy():
    assert policy(["a"]) != policy(["b"])
    with pytest.raises(AssertionError):
        nothing_comes_from_outside(document("k", "n", "t", "a", [], "f").replace("// Tables", "// tables"))
    with pytest.raises(AssertionError):
        nothing_comes_from_outside(document("k", "n", "t", "a", ['<script type="module">x()</script>'], "f"))


@pytest.mark.parametrize("name", ["page/tables.js", "space/draw.js", "space/view.js"])
def test_scripts_write_no_markup_and_call_nothing_in_from_a_network(name):
    text = own(name)
    for word in (
        "innerHTML",
        "outerHTML",
        "insertAdjacentHTML",
        "document.write",
        "eval(",
        "new Function",
        "fetch(",
        "http",
        "</",
    ):
        assert word not in text, word


def test_the_page_s_own_parts_are_well_formed():
    outline = Outline(document("k", "n", "t", "a", ["", "<p>s</p>"], "f"))
    assert {"header", "main", "footer", "h1"} <= outline.tags
    assert outline.ids == ["in-short"]

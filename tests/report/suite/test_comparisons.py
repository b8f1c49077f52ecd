"""What a source says beside what is measured: the verdict follows from both sides."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import pytest

from strainsight.report.suite.comparisons import comparisons_answer, comparisons_table, side
from strainsight.report.suite.data import (
    CONTRADICTED,
    HOLDS,
    OURS_ONLY,
    THEIRS_ONLY,
    UNDECIDED,
    UNMEASURED,
    Comparison,
    Statement,
    Suite,
)
from strainsight.report.suite.statements import statements_table

NAN = float("nan")


def row(theirs, ours):
    """A row whose number has to be below 1; None: that side is not measured."""
    sides = [None if value is None else Statement("s", ((0, "n", value),), below=1.0) for value in (theirs, ours)]
    return Comparison("figure 2.4", "It <falls>.", "4", *sides, why="Because.")


@pytest.mark.parametrize(
    ("theirs", "ours", "verdict"),
    [
        (0.5, 0.5, HOLDS),
        (0.5, None, HOLDS),
        (None, 0.5, HOLDS),
        (0.5, 2.0, THEIRS_ONLY),
        (2.0, 0.5, OURS_ONLY),
        (2.0, 2.0, CONTRADICTED),
        (2.0, None, CONTRADICTED),
        (None, 2.0, CONTRADICTED),
        (NAN, 0.5, UNDECIDED),
        (0.5, NAN, UNDECIDED),
        (2.0, NAN, CONTRADICTED),
        (NAN, 2.0, CONTRADICTED),
        (NAN, None, UNDECIDED),
        (None, None, UNMEASURED),
    ],
)
def test_the_verdict(theirs, ours, verdict):
    assert row(theirs, ours).verdict == verdict


def test_a_side_shows_its_number_and_its_bound():
    assert side(row(0.5, None).as_printed) == "0.5 (below 1)"
    assert side(None) == "–"


def test_the_answer_counts_rows_and_links_those_that_do_not_simply_hold():
    own = row(0.5, 0.5), row(0.5, 2.0), row(2.0, 2.0)
    suite = Suite("s", "t", (), comparisons=own)
    text = re.sub(r"</?data[^>]*>", "", comparisons_answer(suite))
    assert "3 comparisons</strong>: 1 holds, 1 holds under its settings only" in text
    assert '1 contradicted (<a href="#comparison-3">3</a>)' in text
    twice = Suite("s", "t", (), comparisons=(*own, *own))
    assert "2 hold, 2 hold under its settings only" in re.sub(r"</?data[^>]*>", "", comparisons_answer(twice))
    assert comparisons_answer(Suite("s", "t", ())) == ""


def test_what_a_config_says_is_text_on_the_page_and_numbers_are_markup():
    run = SimpleNamespace(label="a <run>")
    own = replace(row(0.5, 2.0), as_printed=Statement("s", ((0, "n", 0.5),), below=1.0, unit="<N>"))
    table = comparisons_table(Suite("s", "t", (run,), comparisons=(own,)))
    assert "It &lt;falls&gt;." in table
    assert "a &lt;run&gt;" in table
    assert "&lt;N&gt;" in table
    assert not {"<falls>", "<run>", "<N>"} & set(re.findall(r"<[^>]*>", table))
    assert '<data value="0.5">0.5</data>' in table
    assert "&lt;data" not in table
    assert "✓ holds under its settings only" in table


@pytest.mark.parametrize("verdict", [(0.5, 2.0), (2.0, 0.5), (2.0, 2.0), (NAN, 0.5), (None, None)])
def test_a_row_that_does_not_hold_and_gives_no_reason_is_marked(verdict):
    run = SimpleNamespace(label="a run")
    own = row(*verdict)
    for why, marked in (("", True), ("Because.", False)):
        table = comparisons_table(Suite("s", "t", (run,), comparisons=(replace(own, why=why),)))
        assert ("no reason is given" in table) is marked
    assert "no reason" not in comparisons_table(Suite("s", "t", (run,), comparisons=(replace(row(0.5, 0.5), why=""),)))


def test_so_is_a_statement():
    run = SimpleNamespace(label="a run")
    for value, why, marked in ((2.0, "", True), (2.0, "Because.", False), (0.5, "", False)):
        claim = Statement("s", ((0, "n", value),), below=1.0, why=why)
        assert ("no reason is given" in statements_table(Suite("s", "t", (run,), statements=(claim,)))) is marked

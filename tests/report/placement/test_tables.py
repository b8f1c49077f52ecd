"""Tables of criteria and cases: every number in its row and column, and what is not a number in words."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.placement.data import Case, Criteria
from strainsight.report.placement.tables import cases_table, criteria_table


def cells(text):
    """Rows of the table as exact values where a cell has one, else as its words."""
    rows = re.findall(r"<tr>(.*?)</tr>", text.split("<tbody>")[1].split("</tbody>")[0])
    return [
        [
            float(exact[1]) if (exact := re.search(r'<data value="([^"]+)"', cell)) else re.sub("<[^>]+>", "|", cell)
            for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)
        ]
        for row in rows
    ]


def head(text):
    return re.findall(r"<th scope=\"col\"[^>]*>(.*?)</th>", text)


def test_ours_comes_first_with_its_bound_and_the_others_by_their_metric(full):
    report = full()
    text = criteria_table(report)
    rows = cells(text)
    assert [row[0] for row in rows] == [
        "|chosen set| (elimination, exchange)", "certified lower bound", "log-determinant", "effective independence",
        "random, median of 10",
    ]  # fmt: skip
    chosen = report.criteria[0]
    assert rows[0][1:] == [chosen.values[0], 1.0, *chosen.values[1:], 1.15e3, 1.65e8]
    assert rows[1][1:3] == [2.6187, pytest.approx(2.6187 / 2.62)]
    assert rows[1][3:] == ["–"] * 4
    assert rows[3][1:] == [3.5, pytest.approx(3.5 / 2.62), 0.074, 2.9, 1.3e3, 1.9e8]
    assert rows[4][1:] == [np.inf, np.inf, np.inf, np.inf, 2.1e3, np.inf]
    assert head(text)[-2:] == ["steady-state σ(tip)", "steady-state σ(E)"]
    assert "1.15\u00a0kN" in text
    assert "165\u00a0MPa" in text


def test_what_cannot_be_observed_is_reported_in_words_and_what_the_caption_must_say_is_there(full):
    text = criteria_table(full())
    assert text.count("cannot observe<") == 1
    assert "all scored by the same covariance" in text
    assert "know no limits of the layout" in text


def test_broken_and_missing_numbers_do_not_break_the_table(full):
    nan = Criteria("broken", (np.nan,) * 3, {"tip": np.nan})
    ours, fine = (
        replace(nan, values=(np.inf, np.nan, np.nan), rule="ours"),
        Criteria("fine", (2.0, 1.0, 1.0), {"E": 1.0}),
    )
    report = full(criteria=(ours, nan, fine))
    rows = cells(criteria_table(report))
    assert [row[0] for row in rows][2:] == ["fine", "broken"]
    assert all(len(row) == 7 for row in rows)
    assert "None" not in criteria_table(report)


def test_without_criteria_the_chosen_set_still_stands_beside_its_bound(full, bare):
    rows = cells(criteria_table(full(criteria=())))
    assert [row[:2] for row in rows] == [["|chosen set|", 2.62], ["certified lower bound", 2.6187]]
    assert len(cells(criteria_table(bare))) == 1
    assert "other rules" not in criteria_table(bare)


def test_cases_are_rows_and_excitations_are_columns(full):
    text = cases_table(full().cases)
    assert head(text) == ["unknown together", "training run", "35 Hz", "what is lost"]
    assert cells(text) == [
        ["tip", 8.0, 16.0, ""],
        ["E, rho", 91.0, 182.0, ""],
        ["tip, E, rho", 9e11, 1.8e12, "tip, E and rho scaled by one factor"],
    ]
    assert "at the same excitation" in text


def test_what_is_lost_at_one_excitation_only_is_reported_of_that_one():
    cases = (Case(("E",), "a", 1.0, 1.0, "E"), Case(("E",), "b", np.inf, np.nan, ""), Case((), "a", 2.0, 3.0))
    rows = cells(cases_table(cases))
    assert rows[0][2:] == [np.inf, "a: E"]
    assert rows[1] == ["none", 2.0, "–", ""]

"""Comparisons and results of a suite."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.suite.cases import groups_of, series_of
from strainsight.report.suite.comparisons import comparisons_answer
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
from strainsight.report.suite.results import counts, results_of

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


def test_the_answer_counts_rows_and_links_those_that_do_not_simply_hold():
    own = row(0.5, 0.5), row(0.5, 2.0), row(2.0, 2.0)
    suite = Suite("s", "t", (), comparisons=own)
    text = re.sub(r"</?data[^>]*>", "", comparisons_answer(suite))
    assert "3 comparisons</strong>: 1 holds, 1 holds under its settings only" in text
    assert '1 contradicted (<a href="#comparison-3">3</a>)' in text
    twice = Suite("s", "t", (), comparisons=(*own, *own))
    assert "2 hold, 2 hold under its settings only" in re.sub(r"</?data[^>]*>", "", comparisons_answer(twice))
    assert comparisons_answer(Suite("s", "t", ())) == ""


def test_every_run_comes_to_what_its_numbers_say(suite):
    found = counts(suite())
    assert found == {"consistent": [1], "overconfident": [2, 3], "not identified": [2], "not estimated": [4]}
    assert list(found) == ["not identified", "overconfident", "consistent", "not estimated"]  # what does not hold first


def test_a_smoothed_load_is_measured_by_its_smoothed_claim(suite):
    run = suite().runs[1]
    load, modulus = results_of(run)
    assert load.smoothed
    assert load.error == run.unknowns[0].smoothed_error
    assert load.std == run.unknowns[0].smoothed_std
    assert not modulus.smoothed
    assert modulus.std == run.unknowns[1].std


def test_the_claim_that_decides_is_the_verdict(suite):
    run = suite().runs[0]
    held, repeated = run.unknowns[0].claims
    for claims, verdict, wrong in (
        ((held, repeated), "consistent", ()),
        ((replace(repeated, verdict="too cautious"), held), "too cautious", ()),
        ((replace(repeated, verdict="overconfident"), held), "overconfident", ("overconfident",)),
        ((), "no claim", ()),
    ):
        own = replace(run, unknowns=(replace(run.unknowns[0], claims=claims),))
        (result,) = results_of(own)
        assert (result.verdict, result.verdicts) == (verdict, wrong)
        assert (result.rms, result.worst) == pytest.approx((0.0007, 0.0007))


def test_repeats_that_diverged_are_left_out_of_the_numbers(suite):
    run = suite().runs[0]
    lost = replace(run.repeats[0], error=np.full(20, np.nan))
    (result,) = results_of(replace(run, repeats=(lost,)))
    assert np.isnan(result.rms)
    assert (result.worst, result.lost, result.verdict) == (np.inf, 20, "diverged")


def test_one_lost_repeat_makes_the_worst_infinite_and_leaves_the_rms_of_the_others(suite):
    run = suite().runs[0]
    lost = replace(run.repeats[0], error=np.append(np.full(19, 0.0007), np.inf))
    (result,) = results_of(replace(run, repeats=(lost,)))
    assert (result.rms, result.worst, result.lost) == (pytest.approx(0.0007), np.inf, 1)
    assert result.verdicts == ("diverged",)


def test_runs_with_the_same_excitation_are_one_series(suite):
    series = series_of(suite())
    assert [entry.runs for entry in series] == [(1, 2, 4), (1, 2, 4), (3,), (3,)]
    assert [entry.heading for entry in series][:2] == ["runs 1, 2 and 4", "runs 1, 2 and 4 at 35 Hz"]
    # tip is a load of the layout, rho is not: loads are "input" in all runs, however many they are.
    assert groups_of(series) == ("input", "E + rho", "input + E + rho")


def test_another_excitation_is_another_series_though_the_numbers_are_equal(suite):
    runs = suite().runs[:2]
    cases = tuple(replace(case, excitation=case.excitation.replace("35", "36")) for case in runs[1].cases)
    series = series_of(suite(runs=(runs[0], replace(runs[1], cases=cases))))
    assert [(entry.runs, entry.excitation) for entry in series] == [
        ((1, 2), "training run"),
        ((1,), "35 Hz"),
        ((2,), "36 Hz"),
    ]


def test_singular_conditions_are_equal_whatever_their_digits(suite):
    one, other = suite().runs[:2]
    noisy = tuple(replace(case, condition=case.condition * 1e5) if case.lost else case for case in one.cases)
    same = tuple(replace(case, condition=np.inf) if case.lost else case for case in other.cases)
    assert len(series_of(suite(runs=(replace(one, cases=noisy), replace(other, cases=same))))) == 2

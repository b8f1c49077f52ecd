"""Verdicts of a suite: like is compared with like, and nothing wrong goes unsaid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.suite.cases import groups_of, numbered, series_of
from strainsight.report.suite.results import counts, results_of


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


def test_a_load_without_smoothing_is_shown_as_filtered(suite):
    run = suite().runs[1]
    run = replace(run, unknowns=(replace(run.unknowns[0], smoothed_error=None),), repeats=())
    (load,) = results_of(run)
    assert (load.smoothed, load.error, load.std) == (False, run.unknowns[0].error, run.unknowns[0].std)


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


def test_an_estimate_that_is_no_number_has_diverged(suite):
    run = suite().runs[0]
    run = replace(run, unknowns=(replace(run.unknowns[0], error=np.nan),), repeats=())
    assert results_of(run)[0].verdicts == ("diverged",)


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


def test_numbers_of_runs_read_as_people_write_them():
    assert [numbered((2,)), numbered((1, 2)), numbered((1, 2, 5))] == ["run 2", "runs 1 and 2", "runs 1, 2 and 5"]

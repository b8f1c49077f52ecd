"""Verdicts on the claimed σ, as console, pages and suites give them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import strainsight.estimation.verdict as kernel
import strainsight.report.placement.verdicts as words
from strainsight.cases.structure.problem import judged_as_stated_in_words, rests_on_loads_in_words
from strainsight.stages.pages.claims import claims_of


def verdicts(error=1.0, smoothed=None, repeats=1.0, many=20, draws=1):
    """Of an unknown whose σ is 1 everywhere: (of, verdict) of every claim, and the one that decides, the first, in words."""
    numbers = {"error.a": error, "std.a": 1.0, "smoothed.a": 1.0, "smoothed_std.a": 1.0}
    numbers |= {"draws.a": draws, "smoothed_draws.a": draws}
    if smoothed is not None:
        numbers |= {"smoothed.a": smoothed, "zero.a": False}
    claims = claims_of("a", numbers, (np.full(many, repeats), np.ones(many)))
    return [(claim.of, claim.verdict) for claim in claims], words.in_words(claims[0])


def test_repeats_decide_where_the_test_was_lucky():
    """Errors of twice σ in every one of twenty repeats, which one draw may have by chance."""
    found, said = verdicts(error=2.0, repeats=2.0)
    assert found == [("repeats", "overconfident"), ("test", "consistent")]
    assert said == "overconfident (RMS error of the repeats 2 times the claimed σ, at most 1.49 where it holds)"


def test_the_worst_of_two_decides():
    assert verdicts(error=20.0, repeats=2.0)[0][0] == ("test", "overconfident")
    assert verdicts(error=4.0, repeats=4.0)[0][0] == ("repeats", "overconfident")


def test_a_smoothed_load_is_held_against_its_own_claim():
    found, said = verdicts(smoothed=5.0)
    assert found[0] == ("smoothed", "overconfident")
    assert said.startswith("overconfident (smoothed error 5 times the claimed σ, at most 3.21")
    assert len(verdicts(smoothed=None)[0]) == 2


def test_a_record_that_is_worth_many_draws_is_judged_by_them():
    """Twice σ over a record: chance where it is worth one draw, none where it is worth fifty."""
    assert verdicts(error=2.0)[0][0][1] == "consistent"
    assert verdicts(error=2.0, draws=50)[0][0] == ("test", "overconfident")


@pytest.mark.parametrize("error", [1.0, 0.5])
def test_errors_far_below_sigma_are_no_fault(error):
    found, said = verdicts(error, repeats=0.1)
    assert found == [("repeats", "too cautious"), ("test", "consistent")]
    assert said == "too cautious (RMS error of the repeats 0.1 times the claimed σ)"


def test_without_repeats_the_test_is_all_there_is():
    assert verdicts(many=0)[0] == [("test", "consistent")]


def test_pages_and_kernels_use_the_same_words():
    """A page knows no kernel: its words stand in a file of its own."""
    ours = (kernel.OVERCONFIDENT, kernel.TOO_CAUTIOUS, kernel.CONSISTENT)
    assert ours == (words.OVER, words.CAUTIOUS, words.HELD)


@pytest.mark.parametrize(("known", "inputs", "parameters"), [(("tip",), ("x",), ("E",)), ((), ("x",), ()), ((), (), ("E",))])
def test_parameters_rest_on_unknown_loads_only_where_no_load_is_known(known, inputs, parameters):
    unknowns = SimpleNamespace(inputs=inputs, parameters=parameters)
    assert rests_on_loads_in_words(SimpleNamespace(known=known, unknowns=unknowns)) == ""
    both = SimpleNamespace(inputs=("x", "y"), parameters=("E", "rho"))
    said = rests_on_loads_in_words(SimpleNamespace(known=(), unknowns=both))
    assert "E, rho rests on what process_noise states of x, y" in said


@pytest.mark.parametrize(
    ("known", "inputs", "parameters", "said"),
    [
        (("tip",), ("x", "y"), ("E", "zeta"), "E is sought together with the damping factor zeta: its σ rests on"),
        (("tip",), ("x",), ("E",), ""),
        (("tip",), ("x",), ("zeta",), ""),
        (("tip",), (), ("E", "zeta"), ""),
        ((), ("x",), ("E", "zeta"), ""),
    ],
)
def test_parameters_beside_a_damping_factor_rest_on_loads_as_stated(known, inputs, parameters, said):
    unknowns = SimpleNamespace(inputs=inputs, parameters=parameters)
    model = SimpleNamespace(damping=SimpleNamespace(parameter="zeta"))
    found = judged_as_stated_in_words(SimpleNamespace(known=known, unknowns=unknowns, model=model))
    assert found.startswith(said)
    assert bool(found) == bool(said)

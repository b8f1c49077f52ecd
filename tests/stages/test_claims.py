"""Verdicts on the claimed σ, as console, pages and suites give them."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.stages.pages.claims import claims_of, doubt_of


def verdicts(error=1.0, smoothed=None, repeats=1.0, many=20):
    """Of an unknown whose σ is 1 everywhere: (of, verdict) of every claim, the one that decides first, and the doubt."""
    numbers = {"error.a": error, "std.a": 1.0, "smoothed.a": 1.0, "smoothed_std.a": 1.0}
    if smoothed is not None:
        numbers |= {"smoothed.a": smoothed, "zero.a": False}
    claims = claims_of("a", numbers, (np.full(many, repeats), np.ones(many)))
    return [(claim.of, claim.verdict) for claim in claims], doubt_of(claims)


def test_repeats_decide_where_the_test_was_lucky():
    """Errors of twice σ in every one of twenty repeats, which one draw may have by chance."""
    found, doubt = verdicts(error=2.0, repeats=2.0)
    assert found == [("repeats", "overconfident"), ("test", "as claimed")]
    assert doubt == "the RMS over 20 repeats is 2 times the claimed σ, at most 1.49 where the claim holds"


def test_the_worst_of_two_decides():
    assert verdicts(error=20.0, repeats=2.0)[0][0] == ("test", "overconfident")
    assert verdicts(error=4.0, repeats=4.0)[0][0] == ("repeats", "overconfident")


def test_a_smoothed_load_is_held_against_its_own_claim():
    found, doubt = verdicts(smoothed=5.0)
    assert found[0] == ("smoothed", "overconfident")
    assert doubt.startswith("the smoothed error is 5 times the claimed σ, at most 3.21")
    assert len(verdicts(smoothed=None)[0]) == 2


@pytest.mark.parametrize("error", [1.0, 0.5])
def test_errors_far_below_sigma_are_no_doubt(error):
    assert verdicts(error, repeats=0.1) == ([("repeats", "cautious"), ("test", "as claimed")], "")


def test_without_repeats_the_test_is_all_there_is():
    assert verdicts(many=0)[0] == [("test", "as claimed")]
    assert doubt_of(()) == ""

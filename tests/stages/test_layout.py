"""The layout that a config asks for: of least trace, proven, or of least loss after one failure."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.cases.layout.advice import advice
from strainsight.cases.layout.budget import budget_table, helps
from strainsight.cases.layout.expectation import Expectation
from strainsight.cases.layout.layout import layout_of, proved
from strainsight.placement.criteria.trace import Trace
from strainsight.placement.failure import loss_if_one_fails
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.placement.score import score


@pytest.fixture(scope="module")
def pools(artefacts):
    """Twelve gauges of the cantilever's pool, in its first scenario."""
    place = artefacts["place"]
    F, H, Q, R, weight = (place[f"/augmented/{key}"][0] for key in ("F", "H", "Q", "R", "weight"))
    some = np.arange(0, len(H), len(H) // 12)[:12]
    return (solve_pool(Scenario(F, Q, H[some], R[some], weight)),)


def layout(pools, greedy=(0, 1, 2), **asked):
    settings = {
        "keep": 3,
        "exchange": True,
        "certificate": True,
        "optimise": "metric",
        "prove": 0.0,
    }
    own = SimpleNamespace(**settings | asked)
    rest = (limits_of(12, 3), own, "mean", lambda *_: None)
    return proved(layout_of(pools, np.array(greedy), *rest), pools, *rest)


def failures(pools, gauges):
    return [score(pools, [g for g in gauges if g != out]) for out in gauges]


def test_a_proof_ends_at_the_best_of_all_sets(pools):
    best = min(score(pools, gauges) for gauges in combinations(range(12), 3))
    found = layout(pools, prove=60.0, exchange=False)
    assert found.proof.proven
    assert found.cost == pytest.approx(best, rel=1e-9)
    assert best * (1 - 2e-6) <= found.certificate.lower_bound <= best
    assert layout(pools).certificate.lower_bound <= best


def test_a_robust_layout_loses_less_in_its_worst_failure_and_both_say_what(pools):
    plain, robust = layout(pools), layout(pools, optimise="worst_failure")
    for found in (plain, robust):
        np.testing.assert_allclose(
            loss_if_one_fails(pools, found.gauges), failures(pools, found.gauges.tolist()), rtol=1e-9
        )
    least = min(max(failures(pools, gauges)) for gauges in combinations(range(12), 3))
    lost, otherwise = (loss_if_one_fails(pools, found.gauges).max() for found in (robust, plain))
    assert least * (1 - 1e-9) <= lost <= otherwise * (1 + 1e-9)
    assert robust.cost >= plain.cost * (1 - 1e-9)
    assert (robust.proof, robust.exchange) == (None, None)


@pytest.mark.parametrize(
    ("loss", "said"),
    [
        ([2.0, 3.0], "The worst failure is that of G2: σ of E grows by 50 %."),
        ([np.inf, 3.0], "An unknown is lost if G1 fails."),
        ([np.inf, np.inf], "Whichever gauge fails, an unknown is lost."),
        ([np.nan, 3.0], "What is left if G1 fails was not solved to accuracy."),
        ([np.nan, np.inf], "What is left if G1 fails was not solved to accuracy. An unknown is lost if G2 fails."),
    ],
)
def test_what_a_failure_leaves_is_reported_and_what_was_not_solved_is_no_loss(loss, said):
    words = _advice(np.array([0.025, 0.03]), loss)
    assert said in " ".join(words)
    assert not {"lost", "solved", "worst"} & set(" ".join(words).replace(said, "").split())


def test_what_helps_most_is_the_largest_part_of_the_variance():
    budget = {
        "tip": {"noise": 0.6, "process noise": 0.3, "gain": 0.1},
        "E": {"noise": 0.05, "process noise": 0.1, "gain": 0.85},
        "rho": {"noise": 0.25, "process noise": 0.0, "gain": 0.75},
    }
    said = list(helps(budget))
    assert said == [
        "What would help tip most: quieter channels, or more of them (noise: 60 % of the variance of tip).",
        "What would help E and rho most: channels calibrated more exactly (gain: 85 % of the variance of E and 75 % of the "
        "variance of rho).",
    ]
    assert list(helps({})) == []
    rows = budget_table(budget).rows
    assert rows[1] == ("E", "5.0 %", "10.0 %", "85.0 %")


def test_a_failure_that_helps_is_no_growth():
    """A gauge that reads wrong, and is not known to, can do harm."""
    assert _said(np.array([0.015, 0.018])) == "σ of no unknown grows if one gauge fails: what it reads wrong then goes with it."
    assert _said(np.array([0.015, 0.03])).endswith("G2: σ of E grows by 50 %.")


def _said(without):
    return next(text for text in _advice(without, [2.0, 3.0]) if "fail" in text)


def _advice(without, loss):
    """On two gauges, without each of which σ of E is that."""
    task = SimpleNamespace(
        criterion=Trace(), over=("E",), limits=limits_of(3, 2), settings=SimpleNamespace(keep=2),
        pool=SimpleNamespace(alone=0), relative=True, whole=None, sigma="the steady-state σ of E", cost_of=lambda rows: None,
    )  # fmt: skip
    listed = SimpleNamespace(labels=("G1", "G2"), bonded=np.zeros(2, dtype=bool), most=np.zeros(2), range=np.ones(2))
    removals = SimpleNamespace(cost=np.array([1.0, 1.1]), ties=((),))
    own = SimpleNamespace(gauges=np.arange(2), certificate=None)
    return advice(task, removals, own, listed, Expectation({"E": 0.02}, {"E": without}), np.array(loss), [])

"""What the advice says of other layouts, beside all of them."""

from __future__ import annotations

import re
from itertools import combinations

import numpy as np
import pytest

from strainsight.cases.layout.advice import best_possible
from strainsight.cases.layout.task import root_of
from strainsight.placement.certificate import Certificate, certify
from strainsight.placement.criteria.trace import Trace
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange

from ..placement.conftest import covariance_by_sign, last, make_beam, make_scenarios

KEEP, TRACE = 4, Trace()


def everything(inputs, parameters, seed):
    """The sentence on a layout of four of twelve gauges; σ² of every unknown by ours, and by all others (sets × unknowns)."""
    scenarios = make_scenarios(make_beam(12, 3, seed=seed), inputs, parameters)
    greedy = eliminate(scenarios, KEEP)
    swapped = exchange(greedy.pools, greedy.kept)
    names = (*inputs, *parameters)
    (sentence,) = best_possible(certify(greedy.pools, swapped.gauges, swapped.cost[-1]), TRACE, names, root_of(TRACE, names))
    (pool,) = greedy.pools
    at = last(len(pool.scenario.F), len(names))

    def weighted(gauges):
        return (pool.scenario.weight * np.diag(covariance_by_sign(pool.scenario, list(gauges))))[at]

    every = np.array([weighted(gauges) for gauges in combinations(range(12), KEEP)])
    return sentence, weighted(swapped.gauges), every


@pytest.mark.parametrize("seed", [0, 1])
def test_with_one_unknown_no_layout_has_a_lower_sigma_than_is_reported(seed):
    sentence, ours, every = everything((), ("E",), seed)
    said = float(re.fullmatch(r"With no other layout .* σ of E lower by more than (\S+) %\.", sentence)[1])
    assert 100 * (1 - np.sqrt(every.min() / ours[0])) <= said * (1 + 1e-6)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_with_two_unknowns_the_bound_is_on_their_weighted_sum_and_on_no_single_sigma(seed):
    """Of 495 layouts none has a lower sum, or root of it, than is said; one has a σ that is lower by more."""
    sentence, ours, every = everything(("Fz",), ("E",), seed)
    variance, deviation = map(float, re.findall(r"by more than (\S+) %", sentence))
    assert "tr(W P) lower by more than" in sentence
    assert "the weighted RMS of the steady-state σ of Fz and E" in sentence
    least = every.sum(axis=1).min() / ours.sum()
    assert 100 * (1 - least) <= variance * (1 + 1e-6)
    assert 100 * (1 - np.sqrt(least)) <= deviation * (1 + 1e-6)
    single = 100 * (1 - np.sqrt(every.min(axis=0) / ours))
    assert single.max() > deviation
    assert sentence.endswith("σ of one of them alone may be lower by more.")


@pytest.mark.parametrize(
    ("gap", "names", "said"),
    [
        (0.19, ("E",), "σ of E lower by more than 10 %."),
        (0.1235, ("E",), "σ of E lower by more than 6.4 %."),  # 1 − √0.8765 = 6.378 %
        (0.0, ("E",), "σ of E lower by more than 0.05 %."),
        (-1e-9, ("E",), "σ of E lower by more than 0.05 %."),
        (0.1235, ("x", "y", "E"), "13 %, or its root, the weighted RMS of the steady-state σ of x, y and E, by more than 6.4 %;"),
        (1e-5, ("x", "E"), "0.1 %, or its root, the weighted RMS of the steady-state σ of x and E, by more than 0.05 %;"),
    ],
)
def test_shares_are_rounded_up(gap, names, said):
    certificate = Certificate(1 - gap, gap, 1.0, np.ones(1), 1, np.ones(1))
    assert said in next(best_possible(certificate, TRACE, names, root_of(TRACE, names)))


def test_without_a_bound_nothing_is_reported():
    assert list(best_possible(None, TRACE, ("E",), "")) == []

"""What leaves no layout is named, with what would have to give way."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import ConfigError, InfeasibleError
from strainsight.placement.branch_and_bound import branch_and_bound
from strainsight.placement.elimination import eliminate
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import Scenario, solve_pool

from .rules import PAIRS, POOL, PRICE, Rules, zone

REFUSED = {
    "fixed in one zone": (
        {"keep": 4, "fixed": (0, 1), "zones": [zone("place.at_most.0", [0, 1, 2], 1)]},
        "place.at_most.0",
        r"what is bonded already \(gauges.fixed\) takes 2 gauges of the 1 that place.at_most.0 allows",
    ),
    "fixed too near to its own mirror image": (
        {"keep": 5, "fixed": (3, 4), "near": [(3, 4), (4, 4), (6, 6)]},
        "place.minimum_spacing",
        "the gauges of row 4 of the pool are bonded already",
    ),
    "too near to their own mirror images": (
        {"keep": 4, "near": [(g, g) for g in range(8)]},
        "place.minimum_spacing",
        "place.minimum_spacing leaves room for 3 of the pool's 11",
    ),
    "fixed too dear": (
        {"keep": 4, "fixed": (0, 10), "price": PRICE, "budget": 7.5},
        "place.budget",
        "takes 8 of the 7.5 that place.budget allows",
    ),
    "zones": (
        {"keep": 4, "zones": [zone("place.at_most.0", range(6), 1), zone("place.at_most.1", range(5, 11), 2)]},
        "place.at_most.1",
        "place.at_most.1 together with place.at_most.0 leaves room for 3 of the pool's 11",
    ),
    "one zone": (
        {"keep": 4, "zones": [zone("place.at_most.3", range(11), 2)]},
        "place.at_most.3",
        "4 gauges asked for, place.at_most.3 leaves room for 2 of the pool's 11",
    ),
    "spacing of what is fixed": (
        {"keep": 3, "fixed": (0,), "near": [(0, i) for i in range(1, 10)]},
        "place.minimum_spacing",
        "place.minimum_spacing leaves room for 2 of the pool's 11",
    ),
    "budget": (
        {"keep": 4, "price": PRICE + 1, "budget": 2.6},
        "place.budget",
        r"the cheapest gauges that detect every unknown cost 2\.7, place.budget is 2\.6",
    ),
    "budget of nothing": (
        {"keep": 4, "price": PRICE, "budget": 0.0},
        "place.budget",
        "the cheapest gauges that detect every unknown cost 0.7, place.budget is 0",
    ),
    "count": ({"keep": 1}, None, r"1 gauges cannot observe 2 unknowns \(Fz, E\)"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_leaves_no_layout_is_named(beam_of, scenarios_of, case):
    asked, key, words = REFUSED[case]
    (scenario,) = scenarios_of(beam_of(POOL, 2), ("Fz",), ("E",))
    limits = Rules(**asked).limits
    with pytest.raises(InfeasibleError, match=words) as refused:
        eliminate([scenario], limits, names=("Fz", "E"))
    assert refused.value.key == key
    assert refused.value.remedy
    with pytest.raises(InfeasibleError):
        branch_and_bound([solve_pool(scenario)], limits)


def test_a_zone_around_all_that_see_an_unknown_is_named_with_it(beam_of, scenarios_of):
    beam = beam_of(POOL, 3)
    (scenario,) = scenarios_of(beam, ("Fz", "Fy"), ())
    H = scenario.H.copy()
    sideways = np.flatnonzero(np.abs(beam.model.input_shape[:, 1]) > 1e-6 * np.abs(beam.model.input_shape).max())
    H[np.ix_(np.arange(POOL) != 7, sideways)] = 0.0
    scenario = Scenario(scenario.F, scenario.Q, H, scenario.r, scenario.weight)
    closed = Rules(4, zones=[zone("place.at_most.0", [6, 7], 0)]).limits
    with pytest.raises(InfeasibleError, match=r"kept within place.at_most.0, they cannot tell Fy") as refused:
        eliminate([scenario], closed, names=("Fz", "Fy"))
    assert refused.value.key == "place.at_most.0"
    # gauge 7 is too dear for its neighbours: it stays, as every layout needs it
    price = np.where(np.arange(POOL) == 7, 9.0, 1.0)
    rules = Rules(4, price=price, budget=10.5, near=[(7, i) for i in (0, 1, 2, 3, 4)])
    kept = eliminate([scenario], rules.limits).kept
    assert 7 in kept
    assert rules.hold(kept)
    with pytest.raises(InfeasibleError, match=r"cost 10, place.budget is 9"):
        eliminate([scenario], Rules(4, price=price, budget=9.0).limits)
    # what is bonded blinds the layout: three gauges of which none sees Fy
    blind = Rules(3, fixed=(0, 1, 2), zones=[zone("place.at_most.0", range(POOL), 9)]).limits
    with pytest.raises(InfeasibleError, match=r"the fewest of the pool .* within place.at_most.0 are 4") as refused:
        eliminate([scenario], blind)
    assert refused.value.key == "place.keep"


def test_impossible_counts_keep_their_words():
    with pytest.raises(ConfigError, match="12 gauges are to be kept of a pool of 11 with 0 fixed"):
        limits_of(11, 12)
    with pytest.raises(ConfigError, match="1 gauges are to be kept of a pool of 11 with 2 fixed"):
        limits_of(11, 1, fixed=(3, 4))
    with pytest.raises(ConfigError, match="18 gauges are to be kept of a pool of 17 with 4 fixed"):
        limits_of(11, 18, size=PAIRS, fixed=(0, 1))

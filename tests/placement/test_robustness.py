"""Many modes and unknowns, noises far apart, duplicates, gauges that see nothing, loads that move nothing."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from strainsight.errors import ConfigError, InfeasibleError, NumericalError
from strainsight.loads.input_models import Unknowns
from strainsight.loads.linearisation import gauge_intensity, linearise, process_intensity
from strainsight.placement.certificate import certify
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.exchange import exchange
from strainsight.placement.scenario import (
    AGREES,
    LARGE,
    Scenario,
    in_slow_motions,
    of_last_states,
    slow_pools,
    solve_pool,
)
from strainsight.placement.score import score

from ..shared import slowly
from .conftest import beam_of, oracle, residual, scenarios_of, with_accelerometers
from .whole_pools import augment_rows, eliminate, whole_pool_weight


def five_unknowns(beam_of, noise, *, modes, foundation, gauges=30):
    """Two tip loads, a patch actuator along the first gauge, modulus and density; the foundation is the known stiffness."""
    beam = beam_of(gauges, modes, foundation=foundation)
    shape = np.column_stack([beam.model.input_shape, beam.rows[0]])
    model = replace(beam.model, input_shape=shape, inputs=("Fz", "Fy", "patch"))
    u = np.column_stack([beam.u, np.zeros(len(beam.u))])
    unknowns = Unknowns(("Fz", "Fy", "patch"), ("E", "rho"), {"Fz": 1e4, "Fy": 1e3, "patch": 1e5}, beam.theta)
    F = linearise(model, unknowns, beam.theta, beam.x[[63]], u[[63]])[0]
    Q = process_intensity(modes + 1, unknowns, {"Fz": 20.0, "Fy": 40.0, "patch": 10.0}, {"E": 0.05, "rho": 0.05})
    H = augment_rows(beam.rows, unknowns)
    r = gauge_intensity(np.full(gauges, noise), 5e-4)
    weight = whole_pool_weight([Scenario(F, Q, H, r, np.zeros(len(F)))], len(F) - np.arange(5, 0, -1))
    return Scenario(F, Q, H, r, weight)


@pytest.mark.parametrize("noise", [1e-9, *slowly(1e-4)])
def test_forty_modes_and_five_unknowns_are_solved_at_every_noise(noise):
    found = eliminate([five_unknowns(beam_of, noise, modes=40, foundation=1e5, gauges=12)], 6)
    (pool,) = found.pools
    assert len(pool.P) == 87
    assert residual(pool.scenario, pool.P) < 1e-10
    assert np.linalg.eigvalsh(pool.P).min() > 0
    assert found.residual < 1e-10
    assert np.all(found.rise > 0)


@pytest.mark.parametrize("noise", [1e-9, 1e-6])
@pytest.mark.parametrize("modes", [10, 40])
def test_units_of_unknowns_change_nothing(noise, modes):
    scenario = five_unknowns(beam_of, noise, modes=modes, foundation=1e5)
    here = solve_pool(scenario)
    far = 10.0 ** np.random.default_rng(6).uniform(-6, 6, 5)
    for factors in [*(permutations([1e3, 1e-4, 30.0]) if modes == 10 else [(1e3, 1e-4, 30.0)]), far]:
        d = np.concatenate([np.ones(len(scenario.F) - len(factors)), factors])
        there = solve_pool(scenario.scaled(d))
        assert there.residual < 1e-12
        np.testing.assert_allclose(there.P, here.P, rtol=0, atol=1e-7)
        np.testing.assert_allclose(there.scale * d, here.scale, rtol=1e-6)


def test_elimination_with_precise_accelerometers_matches_brute_force():
    (strain,) = scenarios_of(beam_of(8, 3), ("Fz",), ("E",), noise=1e-4)
    scenario = with_accelerometers(strain, 3, 1e-6)
    found = eliminate([scenario], 3)
    assert found.residual < 1e-10
    np.testing.assert_allclose(np.diff(found.cost), found.rise, rtol=1e-4, atol=1e-7)
    follow(oracle, found)


@pytest.mark.parametrize("noise", [1e-9, 1e-6, 1e-4])
def test_elimination_with_wide_noise_range_matches_brute_force(noise):
    (scenario,) = scenarios_of(beam_of(14, 5), ("Fz",), ("E",), noise=noise)
    r = scenario.r * 10.0 ** np.random.default_rng(2).uniform(0, 10, 14)
    found = eliminate([Scenario(scenario.F, scenario.Q, scenario.H, r, scenario.weight)], 3)
    follow(oracle, found)


def follow(oracle, found):
    """Every step of an elimination of one scenario is the cheapest of all, by the oracle, and costs what it says."""
    scenario = found.pools[0].scenario
    left = list(range(len(scenario.H)))
    for out, cost in zip(found.removed.tolist(), found.cost[1:], strict=True):
        costs = {g: scenario.weight @ np.diag(oracle(scenario, [o for o in left if o != g])) for g in left}
        np.testing.assert_allclose(costs[out], min(costs.values()), rtol=1e-9)
        np.testing.assert_allclose(cost, costs[out], rtol=1e-6)
        left.remove(out)


def test_a_pool_of_duplicates_is_brute_force_and_evaluates_one_of_each():
    (scenario,) = scenarios_of(beam_of(8, 5), ("Fz",), ("E",))
    rng = np.random.default_rng(5)
    copy = rng.permutation(np.repeat(np.arange(8), 2))
    factor = rng.choice([-4.0, -1.0, 1.0, 2.0], 16)
    H, r = scenario.H[copy] * factor[:, None], scenario.r[copy] * factor**2
    found = eliminate([Scenario(scenario.F, scenario.Q, H, r, scenario.weight)], 4)
    follow(oracle, found)
    left = np.ones(16, dtype=bool)
    for out, ties in zip(found.removed, found.ties, strict=True):
        twins = np.flatnonzero(left & (copy == copy[out]))
        assert out == twins[0]
        assert list(ties) == twins[1:].tolist()
        left[out] = False
    assert found.solves.max() < 8


def test_a_load_in_a_clamped_direction_is_refused_by_name():
    beam = beam_of(20)
    model = replace(beam.model, input_shape=beam.model.input_shape * [1, 0])
    unknowns = Unknowns(("Fz", "Fy"), (), {"Fz": 1e4, "Fy": 1e3}, beam.theta)
    F = linearise(model, unknowns, beam.theta, beam.x[[63]], beam.u[[63]])[0]
    Q = process_intensity(model.size, unknowns, {"Fz": 20.0, "Fy": 40.0}, {})
    H = augment_rows(beam.rows, unknowns)
    scenario = Scenario(F, Q, H, gauge_intensity(np.full(20, 1e-6), 5e-4), np.ones(len(F)))
    with pytest.raises(InfeasibleError, match=r"all candidate gauges together cannot observe Fy\n"):
        eliminate([scenario], 4, names=unknowns.names)


def test_unobserved_motion_does_not_affect_layout():
    beam = beam_of(12, 6)
    (scenario,) = scenarios_of(beam, ("Fz",), ())
    H = scenario.H.copy()
    H[:, : beam.model.size][:, np.abs(beam.model.input_shape[:, 0]) < 1e-6 * np.abs(beam.model.input_shape).max()] = 0.0
    assert not np.array_equal(H, scenario.H)
    follow(oracle, eliminate([Scenario(scenario.F, scenario.Q, H, scenario.r, scenario.weight)], 2))


@pytest.mark.parametrize("modes", [10, 40])
def test_loads_modulus_and_density_together_are_never_placed(modes):
    # with 40 modes the scale that nothing tells is seen as rounding, and by the Riccati solver only
    with pytest.raises((InfeasibleError, NumericalError)):
        five_unknowns(beam_of, 1e-6, modes=modes, foundation=0.0)


@pytest.mark.parametrize(
    ("field", "at", "value", "words"),
    [
        ("H", (3, 2), np.nan, "operator of candidate gauge 3 is not finite"),
        ("H", (5, 0), np.inf, "operator of candidate gauge 5 is not finite"),
        ("r", 7, 0.0, "noise of candidate gauge 7 is 0"),
        ("r", 2, -1e-12, "noise of candidate gauge 2 is -1e-12"),
        ("r", 4, np.nan, "noise of candidate gauge 4 is nan"),
        ("F", (0, 0), np.nan, "F of the linearised system is not finite"),
        ("Q", (1, 1), np.inf, "Q of the linearised system is not finite"),
    ],
)
def test_invalid_numbers_are_refused(field, at, value, words):
    (scenario,) = scenarios_of(beam_of(10), ("Fz",), ("E",))
    broken = getattr(scenario, field).copy()
    broken[at] = value
    with pytest.raises(ConfigError, match=words):
        eliminate([replace(scenario, **{field: broken})], 4)
    if field == "r" and not value < 0:
        # one channel of a gauge of three
        noise = np.repeat(scenario.r[:, None], 3, axis=1)
        noise[at, 1] = value
        with pytest.raises(ConfigError, match=words):
            eliminate([replace(scenario, H=np.repeat(scenario.H[:, None], 3, axis=1), r=noise)], 4)


MODES = 34
"""And the static response to a tip force, which takes one coordinate more."""


@pytest.fixture(scope="module")
def scenarios():
    beam = beam_of(12, MODES, seed=5)
    return scenarios_of(beam, ("Fz",), ("E",), instants=(63, 125))


@pytest.fixture(scope="module")
def pools(scenarios):
    return tuple(solve_pool(own) for own in scenarios)


def found_in(pools):
    size = len(pools[0].P)
    return slow_pools(pools, (size - 2) // 2, np.array([-2, -1]))


def slow_metric(pools, slow):
    """The slow pools by the metric of the whole ones."""
    metrics = [pool.metric.scaled(1 / pool.scale) for pool in pools]
    return [own.under(of_last_states(metric, len(own.P))) for own, metric in zip(slow, metrics, strict=True)]


@pytest.mark.parametrize("count", [3, 8, 20])
def test_what_steady_loads_and_parameters_do_to_readings_is_exact(scenarios, count):
    own, motions = scenarios[0], MODES + 1
    slow = in_slow_motions(own, motions, count)
    for scenario, n in ((own, motions), (slow, (len(slow.F) - 2) // 2)):
        moving = slice(0, 2 * n)
        at_rest = -np.linalg.solve(scenario.F[moving, moving], scenario.F[moving, 2 * n :])
        read = scenario.H[:, moving] @ at_rest + scenario.H[:, 2 * n :]
        if scenario is own:
            expected = read
    np.testing.assert_allclose(read, expected, rtol=1e-7, atol=1e-9 * np.abs(expected).max())


def test_slow_motions_are_the_modes_of_the_lowest_frequencies(scenarios):
    slow = in_slow_motions(scenarios[0], MODES + 1, 6)
    n = (len(slow.F) - 2) // 2
    every = np.sort(np.linalg.eigvals(-scenarios[0].F[MODES + 1 : 2 * MODES + 2, : MODES + 1]).real)
    own = np.sort(np.linalg.eigvals(-slow.F[n : 2 * n, :n]).real)
    np.testing.assert_allclose(own, every[:6], rtol=1e-6)


def test_modes_of_one_frequency_stay_together():
    A = np.diag([1.0, 4.0, 4.0, 9.0])
    turn, _ = np.linalg.qr(np.random.default_rng(1).standard_normal((4, 4)))
    F = np.zeros((9, 9))
    F[:4, 4:8], F[4:8, :4], F[4:8, 4:8] = np.eye(4), -turn @ A @ turn.T, -0.1 * np.eye(4)
    F[4:8, 8] = 1.0
    scenario = Scenario(F, np.diag([0.0] * 4 + [0.1] * 5), np.ones((2, 9)), np.ones(2), np.zeros(9))
    assert len(in_slow_motions(scenario, 4, 2).F) == 2 * 3 + 1
    assert in_slow_motions(scenario, 4, 4) is scenario


def test_sigma_of_any_set_of_gauges_is_that_of_all_motions(pools):
    slow = found_in(pools)
    assert len(slow[0].P) < 0.7 * len(pools[0].P)
    rng = np.random.default_rng(2)
    for own, whole in zip(slow, pools, strict=True):
        for count in (12, 8, 4, 3):
            chosen = sorted(rng.choice(12, count, replace=False).tolist())
            quick, full = (np.sqrt(np.diag(oracle(p.scenario, chosen))[-2:]) * p.scale[-2:] for p in (own, whole))
            np.testing.assert_allclose(quick, full, rtol=1.5 * AGREES)


def test_search_in_slow_motions_ends_where_that_in_all_ends(pools):
    slow = slow_metric(pools, found_in(pools))
    costs = []
    for searched in (slow, pools):
        kept = eliminate_from(searched, 4).selected
        costs.append(score(pools, exchange(searched, kept).gauges, "mean"))
    assert costs[0] == pytest.approx(costs[1], rel=2 * AGREES)


def test_a_bound_that_begins_at_the_optimum_of_the_slow_motions_is_one_of_all(pools):
    slow = slow_metric(pools, found_in(pools))
    gauges = exchange(pools, eliminate_from(pools, 4).selected).gauges
    cost = score(pools, gauges, "mean")
    plain = certify(pools, gauges, cost)
    near = certify(slow, gauges, score(slow, gauges, "mean"))
    begun = certify(pools, gauges, cost, start=near.weights)
    assert begun.lower_bound == pytest.approx(plain.lower_bound, rel=3e-4)
    assert begun.lower_bound <= plain.relaxed
    assert begun.iterations < plain.iterations


def test_small_models_and_those_with_nothing_quick_are_searched_as_they_are():
    small = tuple(solve_pool(own) for own in scenarios_of(beam_of(12), ("Fz",), ("E",)))
    assert len(small[0].P) <= LARGE
    assert found_in(small) is small
    quick = scenarios_of(beam_of(24, MODES, seed=5), ("Fz",), ("E",), noise=1e-10, h=1e-6)
    kept = found_in(tuple(solve_pool(replace(own, Q=1e6 * own.Q)) for own in quick))
    assert len(kept[0].P) == len(quick[0].F)

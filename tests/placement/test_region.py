"""Weights within limits: projections and least linear costs against general solvers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, linprog, minimize

from strainsight.placement.layouts import Detection
from strainsight.placement.limits import limits_of
from strainsight.placement.region import Region, cheapest
from strainsight.placement.scenario import Scenario, solve_pool


def nearest(w, rows, bonded):
    """The point of the box next to w within linear constraints, by a general solver; bonded weights are 1."""
    found = minimize(
        lambda v: np.sum((v - w) ** 2),
        np.full(len(w), 0.4),
        jac=lambda v: 2 * (v - w),
        bounds=[(float(g in bonded), 1) for g in range(len(w))],
        constraints=rows,
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    return found.x


def drawn(seed):
    """Limits of a pool of 12 of which the even ones with a budget, by seed."""
    rng = np.random.default_rng(seed)
    return rng, limits_of(
        12,
        5,
        fixed=(3,),
        size=rng.integers(1, 3, 12),
        price=rng.uniform(0, 2, 12) * (rng.random(12) < 0.7),
        budget=4.0 if seed % 2 == 0 else None,
        near=np.array([(0, 1), (1, 2), (3, 4), (5, 6), (6, 7), (5, 7)]),
        zones=[("place.at_most.0", np.arange(12) > 7, 1)],
    )


@pytest.mark.parametrize("seed", range(6))
def test_the_projection_is_the_nearest_point_and_the_least_that_of_a_program(seed):
    rng, limits = drawn(seed)
    region = Region(limits)
    A = np.vstack([limits.rows.toarray(), -limits.size])
    b = np.append(limits.most, -limits.least)
    bounds = [(1, 1) if g in limits.fixed else (0, 1) for g in range(12)]
    for _ in range(3):
        w = rng.normal(0.5, 1.0, 12)
        mine = region.project(w)
        assert np.all(A @ mine <= b + 1e-6)
        assert mine[3] == 1
        np.testing.assert_allclose(mine, nearest(w, LinearConstraint(A, -np.inf, b), limits.fixed), atol=2e-5)
        slope = -rng.exponential(1.0, 12)
        least = linprog(slope, A_ub=A, b_ub=b, bounds=bounds).fun
        np.testing.assert_allclose(region.least(slope)[0], least, rtol=1e-9)


@pytest.mark.parametrize("case", ["plain", "plain, bonded", "pairs", "pairs, bonded", "budget", "budget in cents"])
def test_weights_far_too_low_or_high_move_to_the_nearest_that_the_limits_allow(case):
    """In words: 0 ≤ w ≤ 1, bonded at 1, least ≤ Σ size·w ≤ keep, price·w ≤ budget."""
    rng = np.random.default_rng(3)
    fixed = (2, 7) if "bonded" in case else ()
    size = np.where(np.arange(10) % 2, 1, 2) if "pairs" in case else np.ones(10)
    price, budget, unit = rng.uniform(0, 1, 10), 1.2, 1e-9 if "cents" in case else 1e9
    asked = {"price": unit * price, "budget": unit * budget} if "budget" in case else {"size": size}
    region = Region(limits_of(10, 6, fixed=fixed, **asked))
    least = 0 if "budget" in case else 5 if "pairs" in case else 6
    rows = [LinearConstraint(size, least, 6)]
    rows += [LinearConstraint(price, -np.inf, budget)] if "budget" in case else []
    for shift in (-1.0, 0.5, 2.0):
        w = rng.normal(shift, 0.4, 10)
        np.testing.assert_allclose(region.project(w), nearest(w, rows, fixed), atol=2e-5)


@pytest.mark.parametrize("seed", range(20))
def test_the_cheapest_sum_is_that_of_a_linear_program(seed):
    rng = np.random.default_rng(seed)
    slope, size = rng.normal(rng.choice([-1, 0, 1]), 1.0, 7), rng.integers(1, 4, 7)
    least = int(rng.integers(-2, 8))
    most = max(0, least + int(rng.integers(0, 9)))
    value, theta = cheapest(slope, size, least, most)
    done = linprog(slope, A_ub=np.array([size, -size]), b_ub=[most, -least], bounds=(0, 1))
    if done.status == 2:
        assert value == np.inf
        return
    np.testing.assert_allclose(value, done.fun, atol=1e-9)
    # leaving out what it takes, or the other way round, costs at least what the multiplier says
    for g in range(7):
        price = slope[g] + theta * size[g]
        other = linprog(
            slope,
            A_ub=np.array([size, -size]),
            b_ub=[most, -least],
            bounds=[((0, 0) if price < 0 else (1, 1)) if i == g else (0, 1) for i in range(7)],
        )
        assert other.status == 2 or other.fun >= value + abs(price) - 1e-9


def test_where_all_may_be_taken_the_cheapest_sum_is_that_of_what_costs_less_than_nothing():
    slope, size = np.array([-3.0, 2.0, -0.5, 0.0]), np.array([1, 2, 3, 1])
    for most in (7, 8, 100):
        assert cheapest(slope, size, 0, most) == (-3.5, 0.0)
    assert cheapest(slope[:0], size[:0], 0, 3) == (0.0, 0.0)
    assert cheapest(slope[:0], size[:0], 1, 3)[0] == np.inf
    assert cheapest(slope, size, 7, 7)[0] == pytest.approx(-1.5)


def test_what_swings_without_damping_needs_a_gauge_that_sees_either_part_of_it():
    F = np.zeros((4, 4))
    F[0, 1], F[1, 0], F[2, 3], F[3, 2] = 1.0, -4.0, 1.0, -9.0
    H = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 2.0, 0], [0, 0, 0, 1.0], [0, 0, 0, 0]])
    pool = solve_pool(Scenario(F, np.eye(4), H, np.ones(5), np.ones(4)))
    detection = Detection([pool])
    assert not detection.loses(np.array([0, 3]))
    assert not detection.loses(np.array([1, 2]))
    assert detection.hits == []
    assert detection.loses(np.array([0, 1, 4]))
    assert [hit.tolist() for hit in detection.hits] == [[False, False, True, True, False]]
    found = detection.layout(limits_of(5, 2, near=np.array([(0, 2), (0, 3)])), np.array([5.0, 1, 1, 1, 4]))
    assert found.gauges.tolist() in ([1, 2], [1, 3])

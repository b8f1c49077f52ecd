"""The lazy elimination is algorithm 2, gauge by gauge, in fifty digits for all seven cases of tables 6.1 and 6.2."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from scipy.linalg import matrix_balance, solve_continuous_lyapunov

from strainsight.augmentation.linearisation import Unknowns, augment_rows, linearise
from strainsight.augmentation.noise import process_intensity
from strainsight.errors import InfeasibleError
from strainsight.placement import choice, elimination
from strainsight.placement.criteria.criterion import Criterion
from strainsight.placement.criteria.worst_eigenvalue import WorstEigenvalue
from strainsight.placement.elimination import Scenario, eliminate, whole_pool_weight
from strainsight.placement.increment import removal
from strainsight.placement.scenario import thesis_weight


def test_it_is_lazy(beam_of, scenarios_of, monkeypatch):
    asked = []

    def counted(*arguments):
        asked.append(1)
        return removal(*arguments)

    monkeypatch.setattr(choice, "removal", counted)
    found = eliminate(scenarios_of(beam_of(60), ("Fz",), ("E",)), 4)
    assert found.solves.sum() == len(asked)
    assert found.solves.min() >= 1
    assert found.cost.shape == (57,)
    assert found.blocks.shape == (57, 2)
    assert found.solves.mean() < 2
    assert np.all(found.rise > 0)


def test_it_is_lazy_where_the_slope_of_the_criterion_says_little(monkeypatch):
    """Three unknowns that wander, the worst eigenvalue: by the slope of one direction alone 6.7 removals a step are evaluated."""
    H = np.random.default_rng(0).normal(size=(60, 3))
    scenario = Scenario(np.zeros((3, 3)), np.eye(3), H, np.ones(60), np.ones(3), WorstEigenvalue())
    found = eliminate([scenario], 6)
    assert found.solves.mean() < 2
    monkeypatch.setattr(WorstEigenvalue, "lifts", Criterion.lifts)
    slow = eliminate([scenario], 6)
    assert slow.solves.mean() > 5
    assert found.removed.tolist() == slow.removed.tolist()
    np.testing.assert_array_equal(found.rise, slow.rise)


def test_the_order_of_gauges_and_the_units_change_nothing(beam_of, scenarios_of):
    (scenario,) = scenarios_of(beam_of(40), ("Fz",), ("E",))
    found = eliminate([scenario], 5)
    rng = np.random.default_rng(3)
    shuffle = rng.permutation(40)
    moved = Scenario(scenario.F, scenario.Q, scenario.H[shuffle] * 1e6, scenario.r[shuffle] * 1e12, scenario.weight)
    again = eliminate([moved.scaled(10.0 ** rng.uniform(-4, 4, len(scenario.F)))], 5)
    assert shuffle[again.removed].tolist() == found.removed.tolist()
    np.testing.assert_allclose(again.cost, found.cost, rtol=1e-8)


def test_load_modulus_and_density_together_are_refused_in_words(beam_of, scenarios_of):
    beam = beam_of(20)
    # the side load is known and would tell the scale; at rest sideways it does not
    quiet = type(beam)(beam.model, beam.rows, beam.x * (np.abs(beam.x[63]) > 1e-9), beam.u * [1, 0], beam.theta)
    with pytest.raises(InfeasibleError, match="can tell all that is asked for"):
        scenarios_of(quiet, ("Fz",), ("E", "rho"))
    unknowns = Unknowns(("Fz",), ("E", "rho"), {"Fz": 1e4}, beam.theta)
    F = linearise(beam.model, unknowns, beam.theta, quiet.x[[63]], quiet.u[[63]])[0]
    Q = process_intensity(beam.model.size, unknowns, {"Fz": 20.0}, {"E": 0.05, "rho": 0.05})
    H = augment_rows(beam.rows, unknowns)
    with pytest.raises(InfeasibleError, match="Fz, E and rho together: fix one"):
        eliminate([Scenario(F, Q, H, np.full(len(H), 1e-15), np.ones(len(F)))], 4, names=unknowns.names)


def test_weights_start_every_unknown_at_one_and_the_thesis_keeps_physical_units(beam_of, scenarios_of):
    scenarios = scenarios_of(beam_of(20), ("Fz",), ("E",), instants=(55, 260))
    whole = eliminate(scenarios, 19)
    np.testing.assert_allclose(whole.blocks[0], [1.0, 1.0], rtol=1e-9)
    unknown = len(scenarios[0].F) - np.array([2, 1])
    weight = thesis_weight(len(scenarios[0].F), unknown, np.array([1e4, 2e11]))
    plain = [Scenario(s.F, s.Q, s.H, s.r, weight) for s in scenarios]
    normalised = whole_pool_weight(scenarios, unknown)
    np.testing.assert_allclose(eliminate(plain, 19).blocks[0], [1e8 / normalised[-2], 4e22 / normalised[-1]], rtol=1e-6)


def test_the_residual_is_the_largest_of_all_steps(beam_of, scenarios_of, monkeypatch):
    scenarios = scenarios_of(beam_of(8, 3), ("Fz",), ("E",))
    for residuals in ([1e-11, 3e-11, 2e-11], [1e-13, 1e-12, 4e-11], [5e-11, 1e-12, 1e-12]):
        values = iter(residuals)
        monkeypatch.setattr(elimination, "relative_residual", lambda *_, values=values: next(values))
        found = eliminate(scenarios, 5)
        assert found.residual == max(residuals)
        assert found.residual > max(pool.residual for pool in found.pools)


@pytest.mark.parametrize("aggregate", ["mean", "worst"])
def test_gauges_that_read_rounding_are_ties_and_leave_in_their_order(beam_of, scenarios_of, aggregate):
    """On a neutral axis, say: what their rows hold differs with the linear algebra."""
    scenarios = scenarios_of(beam_of(20, 4), ("Fz",), ("E",), instants=(55, 260))
    silent = [3, 7, 8, 15]
    for seed in range(3):
        rng = np.random.default_rng(seed)
        shaken = []
        for own in scenarios:
            H = own.H.copy()
            H[silent] *= 1e-11 * rng.standard_normal(H[silent].shape)
            shaken.append(replace(own, H=H))
        found = eliminate(shaken, 4, aggregate)
        assert found.removed[:4].tolist() == silent
        assert found.rise[:4].tolist() == [0.0] * 4
        assert [bool(ties) for ties in found.ties[:4]] == [True, True, True, False]
        assert (found.rise[4:] > 0).all()


# on a foundation whose stiffness is known, without which the last case has a direction that no gauge sees
SEVEN = [
    ((), ("E",)),
    ((), ("rho",)),
    (("Fz",), ()),
    ((), ("E", "rho")),
    (("Fz",), ("E",)),
    (("Fz",), ("rho",)),
    (("Fz",), ("E", "rho")),
]

FOUNDATION = 1e5
"""Stiffness of every unknown displacement and rotation to the ground [N/m, N m]."""

exact = np.vectorize(mpmath.mpf, otypes=[object])


def cost_in_fifty_digits(scenario, gauges, start):
    """tr(W P) with the residual of (5.14) in multiple precision, brought to nothing by corrections in double precision.

        A Δ + Δ Aᵀ = −(F P + P Fᵀ + Q − P G P),   A = F − P G stable,   P ← P + Δ  until Δ is 1e-45 of P

    start: a covariance in double precision, in whose coordinates of unit diagonal this is done; the floor is for motions
    that no process noise reaches.
    """
    _, (unit, _) = matrix_balance(scenario.F, permute=False, separate=True)
    variance = np.diag(start) / unit**2
    d = exact(unit * np.sqrt(np.maximum(variance, 1e-16 * variance.max())))
    F = exact(scenario.F) / d[:, None] * d
    Q = exact(scenario.Q) / d[:, None] / d
    H = exact(scenario.H[gauges]) * d
    r = exact(scenario.r[gauges])
    P = exact(start) / d[:, None] / d
    f, g = F.astype(float), (H.T.dot(H / r[:, None])).astype(float)
    for _ in range(40):
        PH = P.dot(H.T)
        FP = F.dot(P)
        residual = FP + FP.T + Q - (PH / r).dot(PH.T)
        size = np.abs(residual).max()
        A = f - P.astype(float) @ g
        step = solve_continuous_lyapunov(A, -(residual / size).astype(float))
        P = P + exact(0.5 * (step + step.T)) * size
        change = float(np.abs(step).max()) * size
        if change < mpmath.mpf("1e-45"):
            break
    else:
        raise AssertionError(f"fifty digits were not reached: {mpmath.nstr(change, 3)}")
    assert np.linalg.eigvals(f - P.astype(float) @ g).real.max() < 0
    return sum(mpmath.mpf(w) * P[i, i] * d[i] ** 2 for i, w in enumerate(scenario.weight) if w)


def algorithm_2(cost, count, keep):
    """Remove the gauge of the smallest trace without it, every candidate evaluated; order, traces, and how close the
    second candidate came, relative to the rise."""
    left = list(range(count))
    order, trace, margin = [], [cost(left)], []
    while len(left) > keep:
        costs = sorted((cost([other for other in left if other != g]), g) for g in left)
        (best, out), (second, _) = costs[:2]
        margin.append(float((second - best) / (best - trace[-1])))
        left.remove(out)
        order.append(out)
        trace.append(best)
    return order, trace, margin


@pytest.mark.parametrize(("inputs", "parameters"), SEVEN)
def test_elimination_is_brute_force_in_fifty_digits(oracle, beam_of, scenarios_of, inputs, parameters):
    (scenario,) = scenarios_of(beam_of(7, 2, foundation=FOUNDATION), inputs, parameters)
    found = eliminate([scenario], 3)
    with mpmath.workdps(55):
        order, trace, margin = algorithm_2(
            lambda gauges: cost_in_fifty_digits(scenario, gauges, oracle(scenario, gauges)), 7, 3
        )
        rise = [float(after - before) for before, after in pairwise(trace)]
    # the order is decided, and not by the last digits
    assert min(margin) > 1e-6
    assert found.removed.tolist() == order
    np.testing.assert_allclose(found.cost, [float(t) for t in trace], rtol=1e-9)
    np.testing.assert_allclose(found.rise, rise, rtol=1e-7)
    np.testing.assert_allclose(found.blocks.sum(axis=1), found.cost, rtol=1e-12)
    np.testing.assert_allclose(found.cost[0], len(inputs) + len(parameters), rtol=1e-9)
    assert found.residual < 1e-10

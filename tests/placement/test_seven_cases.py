"""All seven cases of tables 6.1 and 6.2: the elimination is algorithm 2 in fifty digits, in order and in value."""

from __future__ import annotations

from itertools import pairwise

import mpmath
import numpy as np
import pytest
from scipy.linalg import matrix_balance, solve_continuous_lyapunov

from strainsight.placement.elimination import eliminate

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
    (scenario,) = scenarios_of(beam_of(8, 2, foundation=FOUNDATION), inputs, parameters)
    found = eliminate([scenario], 3)
    with mpmath.workdps(55):
        order, trace, margin = algorithm_2(
            lambda gauges: cost_in_fifty_digits(scenario, gauges, oracle(scenario, gauges)), 8, 3
        )
        rise = [float(after - before) for before, after in pairwise(trace)]
    # the order is decided, and not by the last digits
    assert min(margin) > 1e-6
    assert found.removed.tolist() == order
    np.testing.assert_allclose(found.cost, [float(t) for t in trace], rtol=1e-9)
    np.testing.assert_allclose(found.rise, rise, rtol=1e-7)
    assert found.residual < 1e-10

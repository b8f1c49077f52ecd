"""A scenario in its slow motions alone, which quick ones follow at rest: what large models are searched by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import schur

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.placement.metric import Metric
from strainsight.placement.scenario import Pool, Scenario, solve_pool

LARGE = 60
"""States from which a pool is searched by its slow motions."""
AGREES = 1e-3
"""Relative difference in σ of every unknown, all gauges of the pool there, up to which motions count as slow enough to leave out:
the fewer gauges there are, the slower the filter, and the less it sees of quick motions."""
WORTH = 0.7
"""Share of the states above which a scenario in slow motions is not worth having."""
APART = 1e-3
"""Relative distance of two eigenvalues below which they stay together: rounding must not choose among modes of one frequency."""


def slow_pools(pools: Sequence[Pool], motions: int, unknowns: np.ndarray) -> tuple[Pool, ...]:
    """The scenarios in as few slow motions as leave σ of the unknowns what it is, to `AGREES` with the whole pool; the pools
    themselves where they have up to `LARGE` states, or where that takes more than `WORTH` of them.

    pools: of x* = [q (motions,), q̇, unknowns and what their models add]; unknowns (u,): indices in x* of what has to agree.
    """
    size = len(pools[0].P)
    if size <= LARGE:
        return tuple(pools)
    count = max(1, motions // 4)
    while 2 * count + size - 2 * motions <= WORTH * size:
        found: list[Pool] = []
        for pool in pools:
            slow = _slow_pool(pool, motions, count)
            if slow is None or not _agree(pool, slow, unknowns - size):
                break
            found.append(slow)
        else:
            return tuple(found)
        count = max(count + 1, count * 5 // 4)
    return tuple(pools)


def in_slow_motions(scenario: Scenario, motions: int, count: int) -> Scenario:
    """The scenario with q = S s + R f, where q̈ = −A q + … has the slow invariant subspace S of A, of its `count` least
    eigenvalues or a few more, and the quick one R; f follows at rest:

        ẋ_s = (F_ss − F_sf F_ff⁻¹ F_fs) x_s + w_s − F_sf F_ff⁻¹ w_f,      y = (H_s − H_f F_ff⁻¹ F_fs) x_s + v

    with x_f = (f, ḟ), so that what steady loads and parameters do to readings is exact; noise of the quick motions in the
    readings is left out. x* = [q (motions,), q̇, unknowns and what their models add], the last ones as they are.
    Source: singular perturbation (Kokotović, Khalil and O'Reilly, 1986).
    """
    size, n = len(scenario.F), motions
    A = -scenario.F[n : 2 * n, :n]
    values = np.sort(np.linalg.eigvals(A).real)
    while count < n and values[count] <= values[count - 1] * (1 + APART):
        count += 1
    if count == n:
        return scenario
    cut = float(np.sqrt(values[count - 1] * values[count]))
    S = schur(A, sort=lambda real, _imag: real < cut)[1][:, :count]
    R = schur(A, sort=lambda real, _imag: real >= cut)[1][:, : n - count]
    T = np.eye(size)
    T[:n, :n] = T[n : 2 * n, n : 2 * n] = np.hstack([S, R])
    back = np.linalg.inv(T)
    F, Q, H = back @ scenario.F @ T, back @ scenario.Q @ back.T, scenario.H @ T
    f = np.concatenate([np.arange(count, n), np.arange(n + count, 2 * n)])
    s = np.setdiff1d(np.arange(size), f)
    follows = -np.linalg.solve(F[np.ix_(f, f)], F[np.ix_(f, s)])
    reached = np.zeros((len(s), size))
    reached[:, s] = np.eye(len(s))
    reached[:, f] = -np.linalg.solve(F[np.ix_(f, f)].T, F[np.ix_(s, f)].T).T
    return replace(
        scenario,
        F=F[np.ix_(s, s)] + F[np.ix_(s, f)] @ follows,
        Q=reached @ Q @ reached.T,
        H=H[..., s] + H[..., f] @ follows,
        weight=np.zeros(len(s)),
    )


def of_last_states(metric: Metric, count: int) -> Metric:
    """The metric of as many last states, which the unknowns are among."""
    return metric if len(metric.weight) == count else Metric(metric.weight[-count:], metric.criterion)


def _slow_pool(pool: Pool, motions: int, count: int) -> Pool | None:
    """None where it cannot be solved."""
    try:
        return solve_pool(in_slow_motions(pool.scenario.scaled(1 / pool.scale), motions, count))
    except (InfeasibleError, NumericalError):
        return None


def _agree(pool: Pool, slow: Pool, at: np.ndarray) -> bool:
    """at: of the unknowns, from the last state."""
    full, own = (np.sqrt(np.diag(each.P)[at]) * each.scale[at] for each in (pool, slow))
    return bool(np.all(np.abs(own / full - 1) <= AGREES))

"""A fixed linearisation with its pool of gauges, its steady covariance, and its reduction to slow motions."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.linalg import schur

from strainsight.errors import ConfigError, InfeasibleError, NumericalError
from strainsight.loads.observability import (
    MarginalModes,
    least_gauges,
    marginal_modes,
    undetectable_directions,
    undetectable_in_words,
)
from strainsight.placement.criteria import Criterion, Metric, Trace
from strainsight.placement.riccati import (
    ACCEPTED,
    Information,
    Loop,
    balance,
    close_loop,
    information,
    polish,
    relative_residual,
    solve_anew,
)

Aggregate = Literal["mean", "worst"]
Gauges = Sequence[int] | np.ndarray
"""Rows of a pool."""


@dataclass(frozen=True)
class Scenario:
    """ẋ* = F x* + w, y = H x* + v with intensities Q and r, and the metric of its layouts: weight of each state, criterion. A
    pool row is what is bonded and removed as one. H (pool, n*) where each measures one signal, (pool, c, n*) where up to c,
    with rows of zeros where fewer; r (pool,) or (pool, c), positive there too, in [y² s]. F, Q (n*, n*) [1/s], [x*²/s];
    weight (n*,) diagonal of W."""

    F: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    r: np.ndarray
    weight: np.ndarray
    criterion: Criterion = field(default_factory=Trace)

    @cached_property
    def metric(self) -> Metric:
        return Metric(self.weight, self.criterion)

    @property
    def rows(self) -> np.ndarray:
        """H/√r (pool, c, n*): channels of each gauge at unit noise."""
        H = self.H[:, None, :] if self.H.ndim == 2 else self.H
        return H / np.sqrt(self.r[:, None] if self.r.ndim == 1 else self.r)[:, :, None]

    def scaled(self, d: np.ndarray) -> Scenario:
        """The same scenario for x*/d."""
        return replace(
            self, F=self.F / d[:, None] * d, Q=self.Q / d[:, None] / d, H=self.H * d, weight=self.weight * d * d
        )


@dataclass(frozen=True)
class Pool:
    """A scenario in the coordinates where the whole pool gives diag P = 1: x* = scale · x̃. rows (pool, c, n*): its gauges at
    unit noise; P (n*, n*) and its relative residual; modes: the marginal ones of F."""

    scenario: Scenario
    rows: np.ndarray
    scale: np.ndarray
    P: np.ndarray
    residual: float
    modes: MarginalModes

    def stacked(self, gauges: np.ndarray) -> np.ndarray:
        """Stacked channels (number · c, n*) of these gauges, by index or as a mask (pool,)."""
        return self.rows[gauges].reshape(-1, self.rows.shape[2])

    @property
    def metric(self) -> Metric:
        """The metric in these coordinates."""
        return self.scenario.metric

    def under(self, metric: Metric) -> Pool:
        """The pool with another metric, of x*."""
        scaled = metric.scaled(self.scale)
        return replace(self, scenario=replace(self.scenario, weight=scaled.weight, criterion=scaled.criterion))

    @property
    def channels(self) -> np.ndarray:
        """Number of channels of each gauge (pool,)."""
        return np.asarray(self.rows.any(axis=2).sum(axis=1))


def solve_pool(scenario: Scenario, names: Sequence[str] = (), units: np.ndarray | None = None) -> Pool:
    """Steady covariance of the whole pool, in balanced coordinates. names: of the unknowns, the last states, for the message,
    which compares them in these units (names,). Raises ConfigError where a number is not finite or a noise not positive,
    InfeasibleError where the pool cannot detect them or where the process noise does not reach all that fails to decay,
    NumericalError where the residual stays above 1e-10."""
    _check(scenario)
    size = len(scenario.F)
    rows = scenario.rows.reshape(-1, size)
    lost = undetectable_directions(scenario.F, rows)
    if lost.shape[1]:
        if units is not None:
            lost[size - len(units) :] /= units[:, None]
        raise InfeasibleError(
            f"all candidate gauges together cannot observe {undetectable_in_words(lost, names)}",
            remedy="add candidates (screen.keep; place.pool of a bench), or estimate fewer unknowns (place.estimate, "
            "loads.*.known; estimate.inputs and estimate.parameters of a bench)",
        )
    # detectability of the transposed pair: process noise reaches all that does not decay
    # rows of Q at unit variance, so that no unit of a state hides the noise of another: the null space is the same
    std = np.sqrt(np.diag(scenario.Q))[:, None]
    noise = np.divide(scenario.Q, std, out=np.zeros_like(scenario.Q), where=std > 0)
    unreached = undetectable_directions(scenario.F.T, noise)
    if unreached.shape[1]:
        raise _unreached(scenario.F, unreached, names)
    d, P = balance(scenario.F, scenario.Q, information(rows))
    balanced = scenario.scaled(d)
    residual = relative_residual(balanced.F, balanced.Q, information(balanced.rows.reshape(-1, size)), P)
    if not residual <= ACCEPTED:
        raise NumericalError(
            f"the Riccati equation of all candidates is solved with a relative residual of {residual:.1e}; the "
            f"tolerance is {ACCEPTED:.0e}",
            remedy="check whether an unknown is nearly unobservable, and whether noise levels differ by many orders of magnitude",
        )
    return Pool(balanced, balanced.rows, d, P, residual, marginal_modes(balanced.F))


def solve_named_pool(names: Sequence[str], scenario: Scenario) -> Pool:
    """`solve_pool` as a task of a sweep."""
    return solve_pool(scenario, names)


def _unreached(F: np.ndarray, directions: np.ndarray, names: Sequence[str]) -> InfeasibleError:
    """Error for undamped states without process noise; directions w (n*, k): wᵀF = λwᵀ, wᵀQ = 0. A motion of the structure has λ
    ≠ 0, an unknown λ = 0."""
    moves = np.any(np.abs(directions.T @ F) > 1e-6 * (np.abs(directions.T) @ np.abs(F)), axis=1)
    if moves.any():
        return InfeasibleError(
            "an undamped motion of the structure has no process noise, so no steady-state filter exists",
            remedy="add structural damping (a ratio of 1e-4 is enough), or a load that excites this motion: the process noise is "
            "a fraction of the motion in the training simulation (stage `train`)",
        )
    return InfeasibleError(
        f"{undetectable_in_words(directions, names)} has no or too little process noise, so no steady-state filter exists",
        remedy="increase this process noise, or reduce the process noise of the other unknowns",
    )


def _check(scenario: Scenario) -> None:
    for name, matrix in (("F", scenario.F), ("Q", scenario.Q), ("the weight of the unknowns", scenario.weight)):
        if not np.all(np.isfinite(matrix)):
            raise ConfigError(
                f"{name} of the linearised system is not finite",
                remedy="check the motion in the training simulation (stage `train`)",
            )
    blind = np.flatnonzero(~np.isfinite(scenario.H).reshape(len(scenario.H), -1).all(axis=1))
    if len(blind):
        raise ConfigError(
            f"the strain operator of candidate gauge {blind[0]} is not finite (gauges with this problem: {len(blind)})",
            remedy="check the shape of the elements below these gauges",
        )
    r = scenario.r.reshape(len(scenario.r), -1)
    refused = ~((r > 0) & np.isfinite(r))
    noiseless = np.flatnonzero(refused.any(axis=1))
    if len(noiseless):
        first = int(noiseless[0])
        raise ConfigError(
            f"the noise of candidate gauge {first} is {r[first][refused[first]][0]:g} "
            f"(gauges without a positive noise: {len(noiseless)})",
            remedy="set a noise greater than zero for each gauge (gauges.noise_std; place.noise of a bench)",
        )


def subset_covariance(pool: Pool, gauges: Gauges) -> np.ndarray | None:
    """P (n*, n*) with these gauges only, in the pool's coordinates; None where they cannot detect every unknown."""
    rows = pool.stacked(np.asarray(gauges, dtype=int))
    if undetectable_directions(pool.scenario.F, rows, pool.modes).shape[1]:
        return None
    return refine(pool, information(rows), None)


def refine(pool: Pool, G: Information, P: np.ndarray | None) -> np.ndarray:
    """P polished if its residual exceeds 1e-12; solved again from None, or if polishing does not reach 1e-10."""
    return refine_with_residual(pool, G, P)[0]


def refine_with_residual(pool: Pool, G: Information, P: np.ndarray | None) -> tuple[np.ndarray, float]:
    """`refine`, and the relative residual of its result."""
    s = pool.scenario
    if P is not None:
        error = relative_residual(s.F, s.Q, G, P)
        if error <= 1e-12:
            return P, error
        with suppress(NumericalError):
            P = polish(s.F, s.Q, G, P, steps=2)
            error = relative_residual(s.F, s.Q, G, P)
            if error <= ACCEPTED:
                return P, error
    P = solve_anew(s.F, s.Q, G)
    return P, relative_residual(s.F, s.Q, G, P)


def fewest_gauges(pools: Sequence[Pool]) -> tuple[int, int]:
    """Number of unknowns to be distinguished, and the fewest gauges with as many channels."""
    unknowns, fewest = 0, 0
    for pool in pools:
        least = least_gauges(pool.modes)
        most = np.cumsum(np.sort(pool.channels)[::-1])
        unknowns = max(unknowns, least)
        fewest = max(fewest, int(np.searchsorted(most, least)) + 1 if least else 0)
    return unknowns, fewest


def loop_of(pool: Pool, gauges: Gauges, P: np.ndarray) -> Loop:
    """Closed loop with these gauges and their covariance P (n*, n*)."""
    return close_loop(pool.scenario.F, information(pool.stacked(np.asarray(gauges, dtype=int))), P)


def covariances_of(pools: Sequence[Pool], gauges: Gauges) -> list[np.ndarray] | None:
    """P of every scenario, or None where these gauges lose an unknown."""
    covariances = []
    for pool in pools:
        if (P := subset_covariance(pool, gauges)) is None:
            return None
        covariances.append(P)
    return covariances


def loops_of(pools: Sequence[Pool], gauges: Gauges) -> list[Loop] | None:
    """The loop of every scenario, or None where these gauges lose an unknown."""
    covariances = covariances_of(pools, gauges)
    return (
        None if covariances is None else [loop_of(pool, gauges, P) for pool, P in zip(pools, covariances, strict=True)]
    )


def aggregated(costs: np.ndarray, aggregate: Aggregate) -> np.ndarray:
    """Mean or maximum over the scenarios, the first axis."""
    return np.asarray(costs.sum(axis=0) / len(costs) if aggregate == "mean" else costs.max(axis=0))


def weight_of_pools(pools: Sequence[Pool], unknown: np.ndarray) -> np.ndarray:
    """Weights (n*,) of x* that let the mean of tr(W P) start at the number of unknowns with the whole pool:

    Wᵢ = 1 / mean over scenarios of Pᵢᵢ  for the states i of `unknown`, 0 for the others.

    unknown (count,): their indices in x*."""
    at = np.asarray(unknown, dtype=int)
    weight, variance = np.zeros(len(pools[0].P)), np.zeros(len(at))
    for pool in pools:
        variance += (np.diag(pool.P) * pool.scale**2)[at] / len(pools)
    weight[at] = 1 / variance
    return weight


def thesis_weight(size: int, unknown: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Weights (size,) of the plain trace over the unknowns in their physical units (algorithm 2): scale² [N², SI²]. unknown
    (count,): their indices in x*; scale (count,)."""
    weight = np.zeros(size)
    weight[np.asarray(unknown, dtype=int)] = scale**2
    return weight


def in_reached_states(pool: Pool, last: int) -> Pool:
    """The pool without the states that the process noise does not reach, but for the last ones; with any of its gauges

        P = [P_rr, 0; 0, 0],   where P_rr solves (5.14) with F_rr, Q_rr and G_rr

    such as bending about an axis about which no load acts. The pool itself if P_rr does not solve it to 1e-12."""
    reached = np.diag(pool.P) > 0.5
    reached[len(reached) - last :] = True
    inner, s, modes = np.ix_(reached, reached), pool.scenario, pool.modes
    F, Q, P, rows = s.F[inner], s.Q[inner], pool.P[inner], pool.rows[..., reached]
    residual = relative_residual(F, Q, information(rows.reshape(-1, len(F))), P)
    if reached.all() or residual > REACHED:
        return pool
    return Pool(
        replace(s, F=F, Q=Q, H=s.H[..., reached], weight=s.weight[reached]),
        rows,
        pool.scale[reached],
        P,
        residual,
        MarginalModes(modes.eigenvalue, tuple(V[reached] for V in modes.vectors), modes.scale[reached]),
    )


REACHED = 1e-12
"""Largest relative residual without the states that noise does not reach."""
LARGE = 60
"""Number of states from which a pool is searched in its slow motions."""
AGREES = 1e-3
"""Relative difference in σ of each unknown, with all gauges of the pool, up to which quick motions are left out. Fewer gauges
make the filter slower and less sensitive to quick motions."""
WORTH = 0.7
"""Share of the states above which the reduction to slow motions does not pay."""
APART = 1e-3
"""Relative distance of eigenvalues below which they stay together, so that rounding does not select among equal modes."""


def slow_pools(pools: Sequence[Pool], motions: int, unknowns: np.ndarray) -> tuple[Pool, ...]:
    """The scenarios in as few slow motions as leave σ of the unknowns what it is, to `AGREES` with the whole pool; the pools
    themselves where they have up to `LARGE` states, or where that takes more than `WORTH` of them.

    pools: of x* = [q (motions,), q̇, unknowns and what their models add]; unknowns (u,): what has to agree, numbered from the last
    state."""
    size = len(pools[0].P)
    if size <= LARGE:
        return tuple(pools)
    count = max(1, motions // 4)
    while 2 * count + size - 2 * motions <= WORTH * size:
        selected: list[Pool] = []
        for pool in pools:
            if (slow := _slow_pool(pool, motions, count, unknowns)) is None:
                break
            selected.append(slow)
        else:
            return tuple(selected)
        count = max(count + 1, count * 5 // 4)
    return tuple(pools)


def in_slow_motions(scenario: Scenario, motions: int, count: int) -> Scenario:
    """The scenario with q = S s + R f, where q̈ = −A q + … has the slow invariant subspace S of A, of its `count` least
    eigenvalues or a few more, and the quick one R; f follows at rest:

        ẋ_s = (F_ss − F_sf F_ff⁻¹ F_fs) x_s + w_s − F_sf F_ff⁻¹ w_f,      y = (H_s − H_f F_ff⁻¹ F_fs) x_s + v

    with x_f = (f, ḟ), so that what steady loads and parameters do to readings is exact; noise of the quick motions in the
    readings is left out. x* = [q (motions,), q̇, unknowns and what their models add], the last ones as they are.
    Source: singular perturbation (Kokotović, Khalil and O'Reilly, 1986)."""
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
    """The metric of the last states, which contain the unknowns."""
    return metric if len(metric.weight) == count else Metric(metric.weight[-count:], metric.criterion)


def _slow_pool(pool: Pool, motions: int, count: int, unknowns: np.ndarray) -> Pool | None:
    """The pool in its slow motions; None if it cannot be solved or changes σ of the unknowns, numbered from the last state."""
    try:
        slow = solve_pool(in_slow_motions(pool.scenario.scaled(1 / pool.scale), motions, count))
    except (InfeasibleError, NumericalError):
        return None
    full, part = (np.sqrt(np.diag(each.P)[unknowns]) * each.scale[unknowns] for each in (pool, slow))
    return slow if np.all(np.abs(part / full - 1) <= AGREES) else None

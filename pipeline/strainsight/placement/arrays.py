"""A placement from plain arrays: a linear system with its candidates, or modes with a strain operator."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import ConfigError, InfeasibleError
from strainsight.loads.input_models import WALK, Unknowns
from strainsight.loads.linearisation import gauge_intensity, process_intensity
from strainsight.ordering import tied_order
from strainsight.placement.certificate import certify
from strainsight.placement.criteria import CRITERIA, Criterion, Metric, criterion_of
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.exchange import exchange
from strainsight.placement.failure import loss_if_one_fails
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import Pool, Scenario, solve_pool, subset_covariance, weight_of_pools
from strainsight.placement.score import score

CLEAR = 100.0
"""Reading of the gauge that feels a load most over the noise of a sample, where no amplitude is stated."""
SAMPLES = 10.0
"""Samples in a period of the highest mode, where no rate is stated."""


@dataclass(frozen=True)
class ArrayPlacement:
    """A layout, and what a Kalman filter on it claims once it is steady. gauges (k,): rows of H, the most missed first; names
    (u,) of the states that count; std (u,) [unit of the state]: σ of each; std_of_pool (u,): σ with every candidate; without
    (k, u): σ without each gauge, inf where one is lost; P (n, n): covariance of the whole state; removed (s,): candidates in
    the order in which the elimination removed them; cost: the criterion of the layout, of all candidates the mean over states
    1; lower_bound: below it no layout of as many gauges comes."""

    gauges: np.ndarray
    names: tuple[str, ...]
    std: np.ndarray
    std_of_pool: np.ndarray
    without: np.ndarray
    P: np.ndarray
    removed: np.ndarray
    cost: float
    lower_bound: float

    @property
    def gap(self) -> float:
        """By which share of its criterion the layout may miss the optimum at most [-]."""
        return (self.cost - self.lower_bound) / self.cost


def place_arrays(
    F: np.ndarray,
    H: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    *,
    keep: int,
    states: Sequence[int] | None = None,
    names: Sequence[str] = (),
    criterion: str | Criterion = "trace",
    fixed: Collection[int] = (),
    conflicts: np.ndarray | None = None,
) -> ArrayPlacement:
    """The `keep` rows of H with which a steady-state Kalman filter estimates the states best: elimination, exchanges, a lower
    bound.

        ẋ = F x + w,  y = H x + v;   0 = F P + P Fᵀ + Q − P Hᵀ R⁻¹ H P

    F (n, n) [1/s]; H (m, n), or (m, c, n) for gauges of up to c channels; Q (n, n), R (m,) or (m, c), or (m, m) diagonal:
    intensities of w and v, of a sample's noise σ every h seconds σ²h; states: numbers of those that count, all by default,
    each relative to its σ with every candidate; names (n,) of the states; criterion: "trace", "log_determinant",
    "worst_eigenvalue" or a `Criterion`; fixed: rows of H that stay; conflicts (p, 2): pairs of rows that are not kept both.
    Raises ConfigError for inconsistent shapes, InfeasibleError if no layout detects every state.
    Source: thesis, algorithm 2 and (5.14)."""
    F, H, Q = (np.asarray(matrix, dtype=float) for matrix in (F, H, Q))
    r, labels, at = _check_inputs(F, H, Q, np.asarray(R, dtype=float), names, states, criterion)
    _check_rows("fixed", np.array(list(fixed), dtype=int), len(H))
    pairs = None if conflicts is None else np.asarray(conflicts, dtype=int)
    if pairs is not None and (pairs.ndim != 2 or pairs.shape[1] != 2):
        raise ConfigError(
            f"`conflicts` has the shape {pairs.shape}", remedy="pass pairs of row numbers of H, of shape (p, 2)"
        )
    _check_rows("conflicts", np.zeros(0, dtype=int) if pairs is None else pairs, len(H))
    pool = solve_pool(Scenario(F, Q, H, r, np.zeros(len(F))), labels)
    pools = [pool.under(Metric(weight_of_pools([pool], at), criterion_of(criterion)))]
    limits = limits_of(len(H), keep, fixed=fixed, near=pairs)
    eliminated = eliminate_from(pools, limits, names=[labels[i] for i in at])
    gauges = exchange(pools, eliminated.selected, limits=limits).gauges
    cost = score(pools, gauges)
    gauges = gauges[tied_order(-loss_if_one_fails(pools, gauges))]
    P = subset_covariance(pool, gauges)
    assert P is not None  # an exchange keeps every state detected
    return ArrayPlacement(
        gauges=gauges,
        names=tuple(labels[i] for i in at),
        std=_std(pool, P, at),
        std_of_pool=_std(pool, pool.P, at),
        without=np.array([_std(pool, subset_covariance(pool, np.delete(gauges, i)), at) for i in range(len(gauges))]),
        P=P * np.outer(pool.scale, pool.scale),
        removed=eliminated.removed,
        cost=cost,
        lower_bound=certify(pools, gauges, cost, limits=limits).lower_bound,
    )


def place_modes(
    modes: np.ndarray,
    frequencies: np.ndarray,
    damping: np.ndarray | float,
    strain_operator: np.ndarray,
    *,
    keep: int,
    loads: np.ndarray | None = None,
    amplitude: np.ndarray | float | None = None,
    load_frequency: np.ndarray | float | None = None,
    noise: np.ndarray | float = 1e-6,
    rate: float | None = None,
    names: Sequence[str] = (),
    criterion: str | Criterion = "trace",
    fixed: Collection[int] = (),
    conflicts: np.ndarray | None = None,
) -> ArrayPlacement:
    """The `keep` gauges with which a steady-state Kalman filter estimates loads on a structure of known modes best.

        q̈ + 2ζω q̇ + ω² q = Φᵀ B a ũ,   ũ̇ = w of intensity κ 2π f,   y = S Φ q + v,   Φᵀ M Φ = I

    modes Φ (d, n), of unit modal mass; frequencies ω/2π (n,) [Hz], damping ζ (n,) or one [-]; strain_operator S (m, d):
    strain of every candidate for a displacement of each degree of freedom; loads B (d, u): where each unknown load acts, by
    default one modal force a mode; amplitude a (u,) [N], by default what moves the gauge that feels it most by 100 times its
    noise; load_frequency f (u,) [Hz], by default the lowest frequency; noise [strain] of a sample, at `rate` [Hz], by
    default 10 samples in a period of the highest mode; names (u,) of the loads; others as of `place_arrays`.
    Returns σ of every load relative to its amplitude. Raises as `place_arrays`.
    Source: thesis (5.18) to (5.30)."""
    Phi, f, S = (np.asarray(values, dtype=float) for values in (modes, frequencies, strain_operator))
    if Phi.ndim != 2 or f.shape != Phi.shape[1:] or S.ndim != 2 or S.shape[1] != len(Phi):
        raise ConfigError(
            f"modes {Phi.shape}, frequencies {f.shape} and strain_operator {S.shape} have inconsistent shapes",
            remedy="pass modes (DOFs, modes), frequencies (modes,) and strain_operator (gauges, DOFs)",
        )
    if not np.all((f > 0) & np.isfinite(f)):
        raise ConfigError(
            f"the frequency of a mode is {f[~((f > 0) & np.isfinite(f))][0]:g} Hz",
            remedy="remove rigid modes, which cause no strain, and pass positive frequencies [Hz]",
        )
    if loads is not None and (np.ndim(loads) != 2 or len(loads) != len(Phi)):
        raise ConfigError(
            f"loads has shape {np.shape(loads)}", remedy=f"pass loads of shape ({len(Phi)}, number of loads)"
        )
    force = np.eye(len(f)) if loads is None else Phi.T @ np.asarray(loads, dtype=float)
    n, u, omega, rows = len(f), force.shape[1], 2 * np.pi * f, S @ Phi
    sigma = _positive("noise", noise, len(rows))
    if amplitude is None:
        felt = np.abs((rows / omega**2) @ force / sigma[:, None]).max(axis=0)
        if not np.all(felt > 0):
            raise InfeasibleError(
                f"no candidate responds to load {int(np.argmin(felt > 0)) + 1}",
                remedy="pass more candidates or modes, or remove the load",
            )
        amplitude = CLEAR / felt
    a = _positive("amplitude", amplitude, u)
    labels = tuple(names) or tuple(f"load {i}" if loads is not None else f"modal force {i}" for i in range(1, u + 1))
    if len(labels) != u or len(set(labels)) < u:
        raise ConfigError(f"{u} loads have the names {', '.join(labels)}", remedy="pass a unique name for each load")
    walks = Unknowns(labels, (), dict(zip(labels, a.tolist(), strict=True)), {})
    speed = _positive("load_frequency", f.min() if load_frequency is None else load_frequency, u)
    zeta = _positive("damping", damping, n, zero=True)
    samples = _positive("rate", SAMPLES * f.max() if rate is None else rate, 1)[0]
    F = np.zeros((2 * n + u, 2 * n + u))
    F[:n, n : 2 * n] = np.eye(n)
    F[n : 2 * n, :n] = -np.diag(omega**2)
    F[n : 2 * n, n : 2 * n] = -2 * np.diag(zeta * omega)
    F[n : 2 * n, 2 * n :] = force * a
    return place_arrays(
        F,
        np.hstack([rows, np.zeros((len(rows), n + u))]),
        process_intensity(n, walks, dict(zip(labels, speed.tolist(), strict=True)), {}, kappa=WALK),
        gauge_intensity(sigma, 1 / samples),
        keep=keep,
        states=range(2 * n, 2 * n + u),
        names=(*(f"q{i}" for i in range(1, n + 1)), *(f"dq{i}/dt" for i in range(1, n + 1)), *labels),
        criterion=criterion,
        fixed=fixed,
        conflicts=conflicts,
    )


def _std(pool: Pool, P: np.ndarray | None, at: np.ndarray) -> np.ndarray:
    """σ (u,) of these states, inf where P is None."""
    return np.full(len(at), np.inf) if P is None else np.sqrt(np.diag(P)[at]) * pool.scale[at]


def _positive(what: str, values: np.ndarray | float, count: int, zero: bool = False) -> np.ndarray:
    """So many positive numbers, from as many or one; zero: whether that is allowed, too."""
    numbers = np.asarray(values, dtype=float)
    allowed = np.isfinite(numbers) & ((numbers > 0) | (zero & (numbers == 0)))
    if numbers.shape not in ((), (count,)) or not np.all(allowed):
        raise ConfigError(f"invalid {what}: {values}", remedy=f"pass one or {count} positive numbers")
    return np.broadcast_to(numbers, count)


def _check_rows(what: str, rows: np.ndarray, count: int) -> None:
    if (outside := rows[(rows < 0) | (rows >= count)]).size:
        raise ConfigError(
            f"{what} contains row {outside[0]}, which is not a row of H", remedy=f"use rows from 0 to {count - 1}"
        )


def _check_inputs(
    F: np.ndarray,
    H: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    names: Sequence[str],
    states: Sequence[int] | None,
    criterion: str | Criterion,
) -> tuple[np.ndarray, tuple[str, ...], np.ndarray]:
    """The intensities of the noise, a name for every state, and the numbers of those that count."""
    n = len(F)
    if F.shape != (n, n) or Q.shape != (n, n) or H.ndim not in (2, 3) or H.shape[-1] != n:
        raise ConfigError(
            f"F {F.shape}, Q {Q.shape} and H {H.shape} have inconsistent shapes",
            remedy="pass F (n, n), Q (n, n) and H (candidates, n)",
        )
    if H.ndim == 2 and R.shape == (len(H), len(H)):
        if np.any(np.diag(np.diag(R)) != R):
            raise ConfigError(
                "R has nonzero entries off the diagonal",
                remedy="pass the noise intensity of each candidate, of shape (candidates,)",
            )
        R = np.diag(R)
    if R.shape != H.shape[:-1]:
        raise ConfigError(
            f"R {R.shape} and H {H.shape} have inconsistent shapes", remedy=f"pass R of shape {H.shape[:-1]}"
        )
    at = np.arange(n) if states is None else np.asarray(states, dtype=int)
    if not len(at) or at.min() < 0 or at.max() >= n or len(np.unique(at)) < len(at):
        raise ConfigError(
            f"`states` is {at.tolist()}, but the system has {n} states",
            remedy=f"pass the number of each state only once, from 0 to {n - 1}",
        )
    if names and len(names) != n:
        raise ConfigError(f"{n} states have {len(names)} names", remedy="pass one name for each state, or no names")
    if isinstance(criterion, str) and criterion not in {c.name for c in CRITERIA}:
        raise ConfigError(
            f"unknown criterion '{criterion}'", remedy=f"choose one of {', '.join(c.name for c in CRITERIA)}"
        )
    return R, tuple(names) or tuple(f"x{i}" for i in range(n)), at

"""Unknowns that wander with no dynamics, ẋ = w and y = H x + v: P = √q G^(−1/2) for Q = q I and G = Hᵀ R⁻¹ H, in closed form."""

from __future__ import annotations

import numpy as np

from strainsight.placement.scenario import Scenario, solve_pool

COMBINED = {"mean": np.mean, "worst": np.max}


def pools_of(H, levels, weight):
    """A pool a scenario: H (scenarios, pool, unknowns) at unit noise, q of each scenario, W (unknowns,)."""
    n = H.shape[2]
    return [
        solve_pool(Scenario(np.zeros((n, n)), q * np.eye(n), h, np.ones(len(h)), weight))
        for h, q in zip(H, levels, strict=True)
    ]


def costs_of(H, levels, weight, v):
    """tr(W P) of every scenario with gauge weights v (pool,); inf where G is singular."""
    found = []
    for h, q in zip(H, levels, strict=True):
        lam, U = np.linalg.eigh((h.T * v) @ h)
        told = lam[0] > 1e-9 * lam[-1]
        found.append(np.sqrt(q) * weight @ (U**2 / np.sqrt(lam)).sum(axis=1) if told else np.inf)
    return np.array(found)

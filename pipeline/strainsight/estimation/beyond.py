"""What misaligned loads displace beyond the coordinates: static, in proportion to the load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.conditional import Nuisances, known_instants, on_loads
from strainsight.estimation.model import FilterModel


@dataclass(frozen=True)
class Beyond:
    """z = ν u of f constants: own (f,) where these stand among all ν; rows (f, n) of u [N] on the states [q, q̇, ζ, offsets],
    and what known loads are of it (T + 1, f)."""

    own: np.ndarray
    rows: np.ndarray
    fed: np.ndarray

    def load(self, x: np.ndarray, at: slice = slice(None)) -> np.ndarray:
        """u (L, f) of states x (L, n) at some instants."""
        return x @ self.rows.T + self.fed[at]

    def behind(
        self, at: slice, x: np.ndarray, P: np.ndarray, V: np.ndarray, nu: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States x (b, L, n), their covariance P (b, L, n, n) and V (L, d, n) at L instants, with z behind them:

            ẑ = ν̂ û,     ẑ − z = −(ν − ν̂) û     to first order, so that V has −û there, and P nothing

        û at the mean over the points; nu ν̂ (d,) that is in the motion.
        """
        f = len(self.own)
        if f == 0:
            return x, P, V
        load = self.load(x.mean(axis=0), at)
        error = np.zeros((*V.shape[:2], f))
        error[:, self.own, np.arange(f)] = -load
        z = np.broadcast_to(nu[self.own] * load, (*x.shape[:2], f))
        wider = np.pad(P, [(0, 0), (0, 0), (0, f), (0, f)])
        return np.concatenate([x, z], axis=2), wider, np.concatenate([V, error], axis=2)


def beyond_of(model: FilterModel, known: np.ndarray, nuisances: Nuisances, offsets: int) -> Beyond:
    """Of the loads that `Nuisances.load` names, where they are to stand `behind` the states; known (T, HOLD, n_known) [N];
    offsets: states behind [q, q̇, ζ]."""
    named = nuisances.load if nuisances.behind else nuisances.load[:0]
    f = len(named)
    ahead = len(nuisances.sources(model.model.size)) - len(nuisances.source)
    rows, fed = on_loads(model, np.eye(len(model.model.inputs))[named])
    return Beyond(ahead + np.arange(f), np.pad(rows, [(0, 0), (0, offsets)]), known_instants(known) @ fed.T)

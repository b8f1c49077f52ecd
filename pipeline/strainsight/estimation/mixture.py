"""What filters at many parameter values say together: mean and covariance of their mixture along the samples."""

from __future__ import annotations

import numpy as np

from strainsight.estimation.conditional import conditional_states
from strainsight.estimation.lattice import moments
from strainsight.estimation.model import FilterModel
from strainsight.estimation.parallel_filters import Filters, LinearModels, Passage, States
from strainsight.estimation.run import FilterRun
from strainsight.estimation.update import standard_deviation


class Mixture:
    """The arrays of a bank while it runs: T steps of a model with d nuisances."""

    def __init__(self, model: FilterModel, mean: np.ndarray, covariance: np.ndarray, steps: int, learned: bool):
        n, m = len(mean), model.H.shape[-2]
        at = conditional_states(model, n - model.size)
        self.model, self.steps, self.states_of_filters, self.learned = model, steps, len(at), learned
        # states of the filters first, then the parameters; x* has them the other way round where there are offsets
        self.order = np.concatenate([at, np.arange(n)[model.parameter_states]])
        self.mean, self.covariance = np.zeros((steps + 1, n)), np.zeros((steps + 1, n, n))
        self.mean[0], self.covariance[0] = mean[self.order], covariance[np.ix_(self.order, self.order)]
        self.gauge_mean, self.gauge_variance = np.zeros((steps, m)), np.zeros((steps, m))
        self.innovation, self.whitened = np.full((steps, m), np.nan), np.full((steps, m), np.nan)
        self.log_likelihood = 0.0

    def states(
        self,
        first: int,
        point: np.ndarray,
        log_weight: np.ndarray,
        found: States,
        models: LinearModels,
        known_end: np.ndarray,
    ) -> None:
        """After steps that begin with number `first`: points (B, k) with log-weights (B, L), filters at the ends of L steps,
        loads known there (L, p₁)."""
        L = log_weight.shape[1]
        span, after = slice(first, first + L), slice(first + 1, first + L + 1)
        w, _, _ = moments(point, log_weight.T)
        x, P = self._moments(after, point, w, found)
        y = np.einsum("bmn,btn->btm", models.H, x) + np.einsum("bmp,tp->btm", models.F, known_end)
        self.gauge_mean[span] = np.einsum("tb,btm->tm", w, y)
        y -= self.gauge_mean[span]
        own = np.einsum("bmn,btnk,bmk->btm", models.H, P, models.H, optimize=True) + y**2
        self.gauge_variance[span] = np.einsum("tb,btm->tm", w, own)
        if not self.learned:
            self._as_they_read(after, w, found, models.H)

    def begin(self, point: np.ndarray, log_weight: np.ndarray, filters: Filters) -> None:
        """At t = 0, of points (B, k) with log-weights (B,)."""
        w, _, _ = moments(point, log_weight[None])
        self._moments(slice(0, 1), point, w, filters.states)

    def _moments(self, at: slice, point: np.ndarray, w: np.ndarray, found: States) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance of the states at L instants, w (L, B); returns x (B, L, n) and P (B, L, n, n) of every filter."""
        V, states = found.V, self.states_of_filters
        # what the samples say of ν moves every estimate, and leaves the rest of it in P
        x = found.x - np.einsum("btda,btd->bta", V, found.nu)
        P = found.P + np.einsum("btda,btdk,btkc->btac", V, found.left, V, optimize=True)
        whole = np.concatenate([x, np.broadcast_to(point[:, None], (*x.shape[:2], point.shape[1]))], axis=2)
        self.mean[at] = np.einsum("tb,btn->tn", w, whole)
        off = whole - self.mean[at]
        weighted = off * w.T[..., None]
        self.covariance[at] = np.einsum("bta,btc->tac", weighted, off, optimize=True)
        self.covariance[at, :states, :states] += np.einsum("tb,btac->tac", w, P, optimize=True)
        return x, P

    def _as_they_read(self, after: slice, w: np.ndarray, found: States, H: np.ndarray) -> None:
        """Motion and loads as they were before the samples' mean of ν corrected them, and σ as well:

        x̂ + V ν̂,     P + V (1 − Λ) Vᵀ,     Λ the covariance of ν by the samples, 1 that without them (`removed_of`)
        """
        span, states = slice(after.start - 1, after.stop - 1), self.states_of_filters
        nu = np.einsum("tb,btd->td", w, found.nu)
        off = found.nu - nu
        left = np.einsum("tb,btdk->tdk", w, found.left) + np.einsum("tb,btd,btk->tdk", w, off, off, optimize=True)
        gone = removed_of(left)
        V = np.einsum("tb,btda->tda", w, found.V)
        self.mean[after, :states] += np.einsum("tda,td->ta", V, nu)
        self.covariance[after, :states, :states] += np.einsum("tda,tdk,tkc->tac", V, gone, V, optimize=True)
        sensed = np.einsum("tb,bmn,btdn->tdm", w, H, found.V, optimize=True)
        self.gauge_mean[span] += np.einsum("tdm,td->tm", sensed, nu)
        self.gauge_variance[span] += np.einsum("tdm,tdk,tkm->tm", sensed, gone, sensed, optimize=True)

    def innovations(
        self,
        first: int,
        point: np.ndarray,
        log_weight: np.ndarray,
        before: States,
        passage: Passage,
        samples: np.ndarray,
    ) -> None:
        """Of steps that begin with number `first`: points (B, k) with log-weights (B, L) before each step, filters before the
        first, what they found, samples (L, m)."""
        L = len(samples)
        span = slice(first, first + L)
        w, _, _ = moments(point, log_weight.T)
        own, slope = passage.states, passage.slope[:, :L]
        known, unsure = (
            np.concatenate([start, each[:, : L - 1]], axis=1)
            for start, each in ((before.nu, own.nu), (before.left, own.left))
        )
        foreseen = passage.expected[:, :L] + np.einsum("btmd,btd->btm", slope, known)
        spread = passage.S[:, :L] + np.einsum("btmd,btdk,btnk->btmn", slope, unsure, slope, optimize=True)
        expected = np.einsum("tb,btm->tm", w, foreseen)
        off = foreseen - expected
        S = np.einsum("tb,btmk->tmk", w, spread) + np.einsum("tb,btm,btk->tmk", w, off, off, optimize=True)
        self.innovation[span] = samples - expected
        for t in range(L):
            there = np.isfinite(samples[t])
            if there.any():
                factor = np.linalg.cholesky(S[t][np.ix_(there, there)])
                self.whitened[first + t, there] = np.linalg.solve(factor, self.innovation[first + t, there])

    def finished(self) -> FilterRun:
        """As a filter's run, of one run, with σ and covariances that hold what the nuisances add."""
        back = np.argsort(self.order)
        mean, covariance = self.mean[:, back], self.covariance[:, back[:, None], back]
        at = self.model.position
        return FilterRun(
            time=self.model.h * np.arange(self.steps + 1),
            mean=mean[:, None],
            std=standard_deviation(covariance)[:, None],
            unknown_covariance=covariance[:, None, at[:, None], at],
            gauge_mean=self.gauge_mean[:, None],
            gauge_std=np.sqrt(self.gauge_variance)[:, None],
            innovation=self.innovation[:, None],
            whitened=self.whitened[:, None],
            nis=np.nansum(self.whitened**2, axis=1)[:, None],
            lost=np.array([-1]),
            log_likelihood=np.array([self.log_likelihood]),
            last=covariance[-1:],
            covariance=covariance[:, None],
            jacobian=None,
            rows=None,
            adjusted=None,
        )


def removed_of(left: np.ndarray) -> np.ndarray:
    """1 − Λ (..., d, d): by how much samples that leave ν a covariance of Λ (..., d, d) made it smaller.

    Zero along a direction in which it is larger than before them: parameters that are all still likely ask for different ν.
    """
    size, axes = np.linalg.eigh(np.eye(left.shape[-1]) - left)
    return np.asarray((axes * np.maximum(size, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2))

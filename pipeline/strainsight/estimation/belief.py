"""How sure a filter is: a covariance carried as it is or as a factor, with one interface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from strainsight.estimation.update import (
    Form,
    beside,
    innovation_factor,
    joseph,
    pivoted_factors,
    predict,
    predict_factor,
    square_factor,
    transposed,
    update_factor,
    whitened_gain,
)


class Belief(Protocol):
    """The covariance of b runs."""

    @property
    def covariance(self) -> np.ndarray:
        """P (b, n, n)."""
        ...

    def predicted(self, A: np.ndarray, process: np.ndarray, before: np.ndarray | None) -> Belief:
        """A (P + before) Aᵀ + process."""
        ...

    def expected(
        self,
        A: np.ndarray,
        process: np.ndarray,
        before: np.ndarray | None,
        H: np.ndarray,
        R: np.ndarray,
        instant: float,
    ) -> np.ndarray:
        """L (b, m, m) of the innovations after `predicted`, without it."""
        ...

    def updated(self, H: np.ndarray, R: np.ndarray, instant: float) -> tuple[Belief, np.ndarray, np.ndarray]:
        """After the measurement, with G (b, n, m) and L (b, m, m) of `whitened_gain`."""
        ...

    def reset(self, runs: np.ndarray, P: np.ndarray) -> Belief:
        """With the covariances P (b, n, n) in the runs (b,) of bool."""
        ...


@dataclass(frozen=True)
class Joseph:
    """P itself, updated by Joseph's form."""

    covariance: np.ndarray

    def predicted(self, A: np.ndarray, process: np.ndarray, before: np.ndarray | None) -> Joseph:
        return Joseph(predict(self.covariance if before is None else self.covariance + before, A, process))

    def expected(
        self,
        A: np.ndarray,
        process: np.ndarray,
        before: np.ndarray | None,
        H: np.ndarray,
        R: np.ndarray,
        instant: float,
    ) -> np.ndarray:
        return whitened_gain(self.predicted(A, process, before).covariance, H, R, instant)[1]

    def updated(self, H: np.ndarray, R: np.ndarray, instant: float) -> tuple[Joseph, np.ndarray, np.ndarray]:
        P, G, L = joseph(self.covariance, H, R, instant)
        return Joseph(P), G, L

    def reset(self, runs: np.ndarray, P: np.ndarray) -> Joseph:
        return Joseph(np.where(runs[:, None, None], P, self.covariance))


@dataclass(frozen=True)
class SquareRoot:
    """F with P = F Fᵀ, moved by orthogonal steps; known: factors of the noise met last, so that constant noise is factored
    once."""

    factor: np.ndarray
    known: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @property
    def covariance(self) -> np.ndarray:
        return self.factor @ transposed(self.factor)

    def predicted(self, A: np.ndarray, process: np.ndarray, before: np.ndarray | None) -> SquareRoot:
        return SquareRoot(predict_factor(self._with(before), A, self._factor("process", process)), self.known)

    def expected(
        self,
        A: np.ndarray,
        process: np.ndarray,
        before: np.ndarray | None,
        H: np.ndarray,
        R: np.ndarray,
        instant: float,
    ) -> np.ndarray:
        return innovation_factor(self._with(before), A, self._factor("process", process), H, R, instant)

    def updated(self, H: np.ndarray, R: np.ndarray, instant: float) -> tuple[SquareRoot, np.ndarray, np.ndarray]:
        F, G, L = update_factor(self.factor, H, R, instant)
        return SquareRoot(F, self.known), G, L

    def reset(self, runs: np.ndarray, P: np.ndarray) -> SquareRoot:
        return SquareRoot(np.where(runs[:, None, None], square_factor(P), self.factor), self.known)

    def _with(self, before: np.ndarray | None) -> np.ndarray:
        """A factor of P + before."""
        return self.factor if before is None else beside(self.factor, self._factor("before", before))

    def _factor(self, which: str, Q: np.ndarray) -> np.ndarray:
        if which not in self.known or self.known[which][0] is not Q:
            # what is constant is factored once, what is found on the way in every step
            factor = square_factor(Q[None]) if Q.ndim == 2 else pivoted_factors(Q)
            # noise on few states has few columns, and every column costs an orthogonal step
            self.known[which] = (Q, factor[:, :, np.any(factor, axis=(0, 1))])
        return self.known[which][1]


def belief_of(form: Form, P: np.ndarray) -> Belief:
    """The covariance P (b, n, n) in the form asked for."""
    return Joseph(P) if form == "joseph" else SquareRoot(square_factor(P))

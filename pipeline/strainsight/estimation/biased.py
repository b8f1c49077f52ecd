"""Channels that read a constant too much: the offset of a real amplifier, estimated beside everything else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.core import StepModel
from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import Driven


@dataclass(frozen=True)
class Biased:
    """y = h(x) + E b with a constant b for some channels: the `StepModel` of [x, b].

    base: the model without; at (k,): the channels that have an offset; walk (k,): variances of what it changes by in a step,
    None for a constant. An offset that walks takes the slow part of the signal for itself: on a structure none does.
    """

    base: StepModel
    at: np.ndarray
    walk: np.ndarray | None = None

    @property
    def size(self) -> int:
        return self.base.size + len(self.at)

    @property
    def channels(self) -> int:
        return self.base.channels

    @property
    def h(self) -> float:
        return self.base.h

    @property
    def sets(self) -> int:
        return self.base.sets

    @property
    def linear(self) -> bool:
        return self.base.linear

    @property
    def position(self) -> np.ndarray:
        return self.base.position

    @property
    def loss(self) -> str:
        return self.base.loss

    def begin(self, x: np.ndarray, k: int) -> None:
        self.base.begin(x[:, : self.base.size], k)

    def step(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        ahead, A = self.base.step(x[:, : self.base.size], k)
        return np.hstack([ahead, x[:, self.base.size :]]), bordered(A, np.eye(len(self.at)))

    def measure(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        y, J = self.base.measure(x[:, : self.base.size], k)
        read = np.array(np.broadcast_to(y, (len(x), self.channels)))
        read[:, self.at] += x[:, self.base.size :]
        E = np.zeros((*J.shape[:-1], len(self.at)))
        E[..., self.at, range(len(self.at))] = 1.0
        return read, np.concatenate([J, E], axis=-1)

    def process(self, k: int) -> np.ndarray:
        walk = np.zeros(len(self.at)) if self.walk is None else self.walk
        return bordered(self.base.process(k), np.diag(walk))

    def before(self, k: int) -> np.ndarray | None:
        added = self.base.before(k)
        return None if added is None else bordered(added, np.zeros((len(self.at), len(self.at))))

    def noise(self, k: int) -> np.ndarray:
        return self.base.noise(k)

    def lost(self, x: np.ndarray) -> np.ndarray:
        return self.base.lost(x[:, : self.base.size])


def driven_with_offsets(model: FilterModel, known: np.ndarray, biased: np.ndarray | None = None) -> StepModel:
    """The reduced model under known loads (T, HOLD, n_known) [N]; biased (b,): channels with an offset, None for none."""
    driven = Driven(model, known)
    return driven if biased is None or not len(biased) else Biased(driven, biased)


def bordered(A: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """[[A, 0], [0, corner]] for A (..., n, n)."""
    n, k = A.shape[-1], len(corner)
    whole = np.zeros((*A.shape[:-2], n + k, n + k))
    whole[..., :n, :n], whole[..., n:, n:] = A, corner
    return whole

"""A mass on a spring of unknown stiffness, hardening or not, by implicit Euler: the small step on which a bank is tested."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.estimation.step_bank import StepBank

Q, V, W, U, XI = range(5)


@dataclass(frozen=True)
class Oscillator:
    """x = (q, v, w, u, ξ):  v' = v + h (u + w + known − ω² e^ξ (q' + c q'³) − 2ζω v'),  q' = q + h v',  w' = 0,  y = q'.

    As the bench's step does it, noise is added before it: w is white, u a random walk. known (T,) acts in every step.
    """

    known: np.ndarray
    h: float = 0.05
    omega: float = 6.0
    zeta: float = 0.05
    cubic: float = 0.0
    white: float = 0.0
    walk: float = 0.0
    sigma: float = 0.02
    size: int = 5
    channels: int = 1
    sets: int = 1
    linear: bool = False
    loss: str = "it has no step"

    @property
    def position(self):
        return np.array([U, XI])

    def begin(self, x, k):
        pass

    def step(self, x, k):
        h, k2, rate = self.h, self.omega**2 * np.exp(x[:, XI]), 2 * self.zeta * self.omega
        drive = x[:, U] + x[:, W] + self.known[k]
        v = x[:, V].copy()
        for _ in range(30 if self.cubic else 1):
            q = x[:, Q] + h * v
            S = 1 + h * rate + h**2 * k2 * (1 + 3 * self.cubic * q**2)
            v = v - (v - x[:, V] - h * (drive - k2 * (q + self.cubic * q**3) - rate * v)) / S
        q = x[:, Q] + h * v
        S = 1 + h * rate + h**2 * k2 * (1 + 3 * self.cubic * q**2)
        A = np.tile(np.eye(5), (len(x), 1, 1))
        A[:, W, W] = 0.0
        A[:, V, Q], A[:, V, V] = -h * k2 * (1 + 3 * self.cubic * q**2) / S, 1 / S
        A[:, V, W] = A[:, V, U] = h / S
        A[:, V, XI] = -h * k2 * (q + self.cubic * q**3) / S
        A[:, Q] = h * A[:, V]
        A[:, Q, Q] += 1
        return np.stack([q, v, 0 * v, x[:, U], x[:, XI]], axis=1), A

    def measure(self, x, k):
        J = np.zeros((len(x), 1, 5))
        J[:, 0, Q] = 1
        return x[:, :1].copy(), J

    def process(self, k):
        return np.zeros((5, 5))

    def before(self, k):
        return self._before

    def __post_init__(self):
        object.__setattr__(self, "_before", np.diag([0, 0, self.white**2, self.walk**2, 0]))

    def noise(self, k):
        return np.array([self.sigma**2])

    def lost(self, x):
        return ~np.isfinite(x.sum(axis=1))

    def drawn(self, mean, P, rng):
        """ξ (), and readings (T, 1), of a truth of the model itself."""
        x = mean + np.sqrt(np.diag(P)) * rng.normal(size=5)
        xi, y = x[XI], []
        for k in range(len(self.known)):
            noise = np.sqrt(np.diag(self.before(k))) * rng.normal(size=5)
            x = self.step((x + noise)[None], k)[0][0]
            y.append(x[Q] + self.sigma * rng.normal())
        return xi, np.array(y)[:, None]


def bank_of(mean, P, filters):
    """Constants known independently of the motion: given ξ, the rest is as before."""

    def begin(xi):
        x, own = np.tile(mean, (len(xi), 1)), P.copy()
        own[XI] = own[:, XI] = 0.0
        x[:, XI:] = xi
        return x, np.tile(own, (len(xi), 1, 1))

    return StepBank(mean, P, slice(XI, XI + 1), np.array([U, XI]), begin, filters)

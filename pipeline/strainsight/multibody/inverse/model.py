"""The implicit step with unknown loads and parameters, as a filter wants a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from strainsight.errors import NumericalError, UserError
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.inverse.nearest import nearest_state
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.inverse.zeroed import Zero
from strainsight.multibody.sensitivity import sensitivities
from strainsight.multibody.sensors import Readings
from strainsight.multibody.step import Step, step
from strainsight.multibody.system import System


class _Taken(NamedTuple):
    """A step that was taken from x in step k: f(x) (size,), A (size, size); drive (2n, all inputs) = ∂(q', v')/∂u of the known
    inputs u."""

    x: np.ndarray
    k: int
    ahead: np.ndarray
    A: np.ndarray
    drive: np.ndarray


@dataclass(frozen=True, eq=False)
class AugmentedStep:
    """x = (q, v, w, u, ξ) under one step of the system, a `StepModel` of the filter core:

        θ = θ(ξ),   (q', v') = step(q, v, u, h, θ, w),   w' = 0,   u' = u,   ξ' = ξ,      y = sensors(q', v') − offset
        before = diag(0, 0, Q_w, Q_u, Q_ξ),   process = 0,   noise = R

    w (n,) is a white generalised force: the step sets it to zero and `before` draws it anew, so that a disturbed state still
    satisfies φ = 0 and Bv = 0; u (nu,) the unknown inputs, a random walk whose value after a step acts at the end of it.
    system, sensors: compiled for each other; offset (m,) subtracted from every reading (zeroed gauges) [unit of the
    channel]; h [s]; known (T, all inputs): row k acts in step k, columns of unknown inputs are not read [N, N m];
    inputs (nu,): places of the unknown inputs in `system.inputs`; coordinates: of the unknown parameters;
    Q_w (n,), Q_u (nu,): variances a step, Q_xi (p,) or (p, p) covariance [unit²]; R (m,): variances of the readings [unit²];
    zero: ξ → a further offset (m,) and its slopes (m, p), of channels zeroed under load (`zero_at_rest`).
    A step that fails leaves NaN in its run. Runs are stepped one after the other; the last two steps of each are remembered.
    Source: thesis (1.40-1.56), with the noise before the step in place of (1.45).
    """

    system: System
    sensors: Readings
    offset: np.ndarray
    h: float
    known: np.ndarray
    inputs: np.ndarray
    coordinates: ParameterCoordinates
    Q_w: np.ndarray
    Q_u: np.ndarray
    Q_xi: np.ndarray
    R: np.ndarray
    zero: Zero | None = None
    _last: dict[int, Step] = field(default_factory=dict, repr=False)
    _taken: dict[int, tuple[_Taken, ...]] = field(default_factory=dict, repr=False)

    @property
    def q(self) -> slice:
        return slice(0, self.system.size)

    @property
    def v(self) -> slice:
        return slice(self.system.size, 2 * self.system.size)

    @property
    def w(self) -> slice:
        return slice(2 * self.system.size, 3 * self.system.size)

    @property
    def u(self) -> slice:
        return slice(3 * self.system.size, 3 * self.system.size + len(self.inputs))

    @property
    def xi(self) -> slice:
        return slice(self.u.stop, self.size)

    @property
    def size(self) -> int:
        return 3 * self.system.size + len(self.inputs) + self.coordinates.size

    @property
    def channels(self) -> int:
        return len(self.R)

    @property
    def sets(self) -> int:
        return 1

    @property
    def linear(self) -> bool:
        return False

    @property
    def position(self) -> np.ndarray:
        return np.arange(self.u.start, self.size)

    @property
    def loss(self) -> str:
        return "a time step could not be solved"

    def pack(self, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """x (size,) of q, v (n,), the unknown inputs u (nu,) and all parameters θ (nθ,); w = 0."""
        return np.concatenate([q, v, np.zeros(self.system.size), u, self.coordinates.xi(theta)])

    def step(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """f(x) (B, size) and ∂f/∂x (B, size, size) of x (B, size); NaN where a step fails."""
        taken = [self._take(run, own, k) for run, own in enumerate(x)]
        if len(taken) == 1:
            return taken[0].ahead[None], taken[0].A[None]
        return np.stack([one.ahead for one in taken]), np.stack([one.A for one in taken])

    def measure(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Readings (B, m) and their slopes (B, m, size)."""
        y, J = np.empty((len(x), self.channels)), np.zeros((len(x), self.channels, self.size))
        for run, own in enumerate(x):
            y[run], J[run, :, self.q], J[run, :, self.v] = self.sensors.read(own[self.q], own[self.v])
            if self.zero is not None and np.isfinite(own.sum()):
                try:
                    taken_off, slopes = self.zero(own[self.xi])
                except (NumericalError, UserError):
                    taken_off, slopes = np.full(self.channels, np.nan), np.zeros((self.channels, self.coordinates.size))
                y[run] -= taken_off
                J[run, :, self.xi] -= slopes
        return y - self.offset, J

    def process(self, k: int) -> np.ndarray:
        return self._noise[0]

    def before(self, k: int) -> np.ndarray:
        return self._noise[1]

    def noise(self, k: int) -> np.ndarray:
        return self.R

    def lost(self, x: np.ndarray) -> np.ndarray:
        return ~np.isfinite(x.sum(axis=1))

    def projected(self, x: np.ndarray) -> np.ndarray:
        """x (B, size) with q and v put back on φ(q) = 0, B(q)v = 0, nearest in the metric; NaN where that fails."""
        x = x.copy()
        for own in x:
            if np.isfinite(own.sum()):
                try:
                    own[self.q], own[self.v] = nearest_state(self.system, own[self.q], own[self.v])
                except UserError:
                    own[:] = np.nan
        return x

    def violation(self, x: np.ndarray) -> np.ndarray:
        """How far x (B, size) is off φ(q) = 0, beside ‖Dq‖ and in unit rows: the largest constraint (B,) [-]."""
        off = np.zeros(len(x))
        for run, own in enumerate(x):
            phi, B = constraints_at(self.system, own[self.q])
            if len(phi):
                d = self.system.metric
                off[run] = np.max(np.abs(phi) / np.linalg.norm(B / d, axis=1)) / np.linalg.norm(d * own[self.q])
        return off

    @cached_property
    def _noise(self) -> tuple[np.ndarray, np.ndarray]:
        still = np.zeros(2 * self.system.size)
        Q_xi = np.diag(self.Q_xi) if self.Q_xi.ndim == 1 else self.Q_xi
        before = block_diag(np.diag(np.concatenate([still, self.Q_w, self.Q_u])), Q_xi)
        return np.zeros((self.size, self.size)), before

    def _take(self, run: int, x: np.ndarray, k: int) -> _Taken:
        before = self._taken.get(run, ())
        for one in before:
            if one.k == k and np.array_equal(one.x, x):
                return one
        # an update ends at a trial, but may have refused one since
        taken = self._fresh(run, x, k)
        self._taken[run] = (taken, *before[:1])
        return taken

    def _fresh(self, run: int, x: np.ndarray, k: int) -> _Taken:
        size, u = self.size, np.array(self.known[k], dtype=float)
        u[self.inputs] = x[self.u]
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                theta, slopes = self.coordinates.theta(x[self.xi])
                near = self._near(run, x, k)
                new = step(self.system, x[self.q], x[self.v], u, self.h, theta, x[self.w], self._last.get(run), near)
                s = sensitivities(self.system, new)
        except (NumericalError, UserError):
            return _Taken(x.copy(), k, np.full(size, np.nan), np.full((size, size), np.nan), np.zeros((0, 0)))
        self._last[run] = new
        A, ahead, moved = np.zeros((size, size)), x.copy(), self.w.start
        ahead[self.q], ahead[self.v], ahead[self.w] = new.q, new.v, 0.0
        A[:moved, :moved], A[:moved, self.w] = s.A, s.B_w
        A[:moved, self.u], A[:moved, self.xi] = s.B_u[:, self.inputs], s.B_theta @ slopes
        A[range(self.u.start, size), range(self.u.start, size)] = 1.0
        drive = s.B_u.copy()
        drive[:, self.inputs] = 0.0
        return _Taken(x.copy(), k, ahead, A, drive)

    def _near(self, run: int, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Where the step taken last in this run says that x leads, to first order."""
        before = self._taken.get(run)
        if not before or not np.isfinite(before[0].ahead.sum()):
            return None
        last, moved = before[0], self.w.start
        ahead = last.ahead[:moved] + last.A[:moved] @ (x - last.x) + last.drive @ (self.known[k] - self.known[last.k])
        return (ahead[self.q], ahead[self.v]) if np.isfinite(ahead.sum()) else None

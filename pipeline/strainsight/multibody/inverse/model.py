"""A step in time with unknown loads and parameters, as a filter wants a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from strainsight.errors import NumericalError, UserError
from strainsight.multibody.advance import Advance, Method, advance, slopes
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.inverse.nearest import nearest_state
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.inverse.start import static_response
from strainsight.multibody.inverse.zeroed import Zero
from strainsight.multibody.sensors import Readings
from strainsight.multibody.static import static_equilibrium
from strainsight.multibody.system import System


class _Taken(NamedTuple):
    """A step that was taken from x in step k: f(x) (size,), A (size, size); drive: ∂(q', v')/∂u (2n, all inputs) of the known
    inputs u at its start and at its end."""

    x: np.ndarray
    k: int
    ahead: np.ndarray
    A: np.ndarray
    drive: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class AugmentedStep:
    """x = (q, v, w, δ, u, ξ) under one step of the system, a `StepModel` of the filter core:

        θ = θ(ξ),   (q', v') = advance(q, v, u → u + δ, h, θ, w),   w' = 0,   δ' = 0,   u' = u + δ,   ξ' = ξ
        y = sensors(q', v') − offset,      before = diag(0, 0, Q_w, Q_u, 0, Q_ξ),   process = 0,   noise = R

    u (nu,) are the unknown inputs, a random walk, straight between the steps, and δ (nu,) what they change by in the step;
    w (n,) is a white generalised force, there where Q_w is not zero. The step sets δ and w to zero and `before` draws them
    anew, so that a disturbed state still satisfies φ = 0 and Bv = 0.
    system, sensors: compiled for each other; offset (m,) subtracted from every reading (zeroed gauges) [unit of the
    channel]; h [s]; method: of the step; known (T + 1, all inputs): row k acts at kh, columns of unknown inputs are not read
    [N, N m]; inputs (nu,): places of the unknown inputs in `system.inputs`; coordinates: of the unknown parameters;
    Q_w (n,), Q_u (nu,): variances a step, Q_xi (p,) or (p, p) covariance [unit²]; R (m,): variances of the readings [unit²];
    zero: ξ → a further offset (m,) and its slopes (m, p), of channels zeroed under load (`zero_at_rest`).
    rest: whether step 0 begins in the equilibrium under u and ξ: then q of x is only where that is sought from, v is zero, and
    q = q₀(u, ξ) with ∂q₀ of `static_response`. A q that follows u and ξ to first order alone would swing about it.
    A step that fails leaves NaN in its run. Runs are stepped one after the other; the last two steps of each are remembered.
    Source: thesis (1.40-1.56), with the noise before the step in place of (1.45).
    """

    system: System
    sensors: Readings
    offset: np.ndarray
    h: float
    method: Method
    known: np.ndarray
    inputs: np.ndarray
    coordinates: ParameterCoordinates
    Q_w: np.ndarray
    Q_u: np.ndarray
    Q_xi: np.ndarray
    R: np.ndarray
    zero: Zero | None = None
    rest: bool = False
    _last: dict[int, Advance] = field(default_factory=dict, init=False, repr=False)
    _taken: dict[int, tuple[_Taken, ...]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def q(self) -> slice:
        return slice(0, self.system.size)

    @cached_property
    def v(self) -> slice:
        return slice(self.system.size, 2 * self.system.size)

    @cached_property
    def w(self) -> slice:
        return slice(self.v.stop, self.v.stop + (self.system.size if self.Q_w.any() else 0))

    @cached_property
    def delta(self) -> slice:
        return slice(self.w.stop, self.w.stop + len(self.inputs))

    @cached_property
    def u(self) -> slice:
        return slice(self.delta.stop, self.delta.stop + len(self.inputs))

    @cached_property
    def xi(self) -> slice:
        return slice(self.u.stop, self.size)

    @cached_property
    def size(self) -> int:
        return self.u.stop + self.coordinates.size

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
        """x (size,) of q, v (n,), the unknown inputs u (nu,) and all parameters θ (nθ,); w = δ = 0."""
        x = np.zeros(self.size)
        x[self.q], x[self.v], x[self.u], x[self.xi] = q, v, u, self.coordinates.xi(theta)
        return x

    def spread(self, P: np.ndarray) -> np.ndarray:
        """Covariance (size, size) of x from that of (q, v, u, ξ); w = δ = 0."""
        n = self.v.stop
        own = np.r_[0:n, self.u.start : self.size]
        whole = np.zeros((self.size, self.size))
        whole[np.ix_(own, own)] = P
        return whole

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
        before = np.zeros((self.size, self.size))
        if self.w.stop > self.w.start:
            before[self.w, self.w] = np.diag(self.Q_w)
        before[self.delta, self.delta] = np.diag(self.Q_u)
        before[self.xi, self.xi] = np.diag(self.Q_xi) if self.Q_xi.ndim == 1 else self.Q_xi
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
        size, start, end = self.size, *np.array(self.known[k : k + 2], dtype=float)
        start[self.inputs], end[self.inputs] = x[self.u], x[self.u] + x[self.delta]
        w = x[self.w] if self.w.stop > self.w.start else None
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                theta, by_xi = self.coordinates.theta(x[self.xi])
                last, near = self._last.get(run), self._near(run, x, k)
                q, v = x[self.q], x[self.v]
                if self.rest and k == 0:
                    q, v = static_equilibrium(self.system, q, start, theta)[0], np.zeros_like(v)
                new = advance(self.system, q, v, (start, end), self.h, theta, self.method, w, last, near)
                s = slopes(self.system, new)
        except (NumericalError, UserError):
            none = np.zeros((0, 0))
            return _Taken(x.copy(), k, np.full(size, np.nan), np.full((size, size), np.nan), (none, none))
        self._last[run] = new
        A, ahead, moved = np.zeros((size, size)), x.copy(), self.w.start
        ahead[self.q], ahead[self.v], ahead[self.w] = new.q, new.v, 0.0
        ahead[self.u], ahead[self.delta] = end[self.inputs], 0.0
        A[:moved, :moved], A[:moved, self.delta] = s.A, s.B_end[:, self.inputs]
        if w is not None:
            A[:moved, self.w] = s.B_w
        A[:moved, self.u] = s.B_start[:, self.inputs] + s.B_end[:, self.inputs]
        A[:moved, self.xi] = s.B_theta @ by_xi
        if self.rest and k == 0:
            by_u, by_theta = static_response(self.system, q, start, theta)
            A[:moved, :moved] = 0.0
            A[:moved, self.u] += s.A[:, self.q] @ by_u[:, self.inputs]
            A[:moved, self.xi] += s.A[:, self.q] @ by_theta @ by_xi
        A[self.u, self.delta] = np.eye(len(self.inputs))
        A[range(self.u.start, size), range(self.u.start, size)] = 1.0
        drive = s.B_start.copy(), s.B_end.copy()
        for own in drive:
            own[:, self.inputs] = 0.0
        return _Taken(x.copy(), k, ahead, A, drive)

    def _near(self, run: int, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Where the step taken last in this run says that x leads, to first order."""
        before = self._taken.get(run)
        if not before or not np.isfinite(before[0].ahead.sum()) or (self.rest and before[0].k == 0):
            return None  # the slopes of a step from rest know nothing of its q and v
        last, moved = before[0], self.w.start
        ahead = last.ahead[:moved] + last.A[:moved] @ (x - last.x)
        for later, own in enumerate(last.drive):
            ahead += own @ (self.known[k + later] - self.known[last.k + later])
        return (ahead[self.q], ahead[self.v]) if np.isfinite(ahead.sum()) else None

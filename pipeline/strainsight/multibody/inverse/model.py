"""A step in time with unknown loads and parameters, as a filter wants a model."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from strainsight.errors import NumericalError, UserError
from strainsight.multibody.accelerations import measure, unit_rows
from strainsight.multibody.initial import constraints_at, nearest_state, static_equilibrium
from strainsight.multibody.inverse.loads import LoadProcess
from strainsight.multibody.inverse.parameters import ParameterCoordinates, Zero, static_response
from strainsight.multibody.inverse.unmodelled_dynamics import Begun, Plant, Start, begin_step
from strainsight.multibody.sensors import CompiledSensors
from strainsight.multibody.step import Advance, Method, advance, slopes
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
    """x = (q, v, w, δ, c, ξ) under one step of the system, a `StepModel` of the filter core:

        θ = θ(ξ),   (q', v') = advance(q, v, u → u', h, θ, w) + e,   w' = 0,   δ' = 0,   c' = exp(Ah) c + δ,   ξ' = ξ
        y = sensors(q', v', u', θ) − offset,   before = diag(0, 0, Q_w, Q_δ, 0, Q_ξ),   process = diag(Q_e, 0, …),   noise = R

    c (k,) are the unknown inputs u (nu,) and, of smooth ones, their rates (`LoadProcess`), δ (k,) what is drawn of them in the
    step; w (n,) is a white generalised force, there where Q_w is not zero. The step sets δ and w to zero and `before` draws them
    anew, so that a disturbed state still satisfies φ = 0 and Bv = 0.
    e is what the step leaves out (`left_out`), linear in x about where the step begins, Q_e what no state tells of it; both are
    zero where `corrected` is false, and the step with loads straight within it is taken for true. e leaves the constraints by its
    square, and x has to be put back (`projected`).
    system, sensors: compiled for each other; offset (m,) subtracted from every reading (zeroed gauges) [unit of the
    channel]; method: of the step; known (T + 1, width): row k acts at kh, all inputs [N, N m], then p and ṗ of driven joints;
    columns of unknown inputs are not read; inputs (nu,): places of the unknown inputs in `system.inputs`; loads: how they
    move, and the step h [s]; coordinates: of the unknown parameters;
    Q_w (n,): variances a step, Q_xi (p,) or (p, p) covariance [unit²]; R (m,): variances of the readings [unit²];
    zero: ξ → a further offset (m,) and its slopes (m, p), of channels zeroed under load (`zero_at_rest`).
    second (T + 1, nd): p̈ of driven joints at kh, which accelerometers feel, None without any;
    rest: whether step 0 begins in the equilibrium under u and ξ: then q of x is only where that is sought from, v is zero, and
    q = q₀(u, ξ) with ∂q₀ of `static_response`. A q that follows u and ξ to first order alone would swing about it.
    printed: the noise as (1.45) and (1.57) have it, in diagonal blocks that are added after the step: δ and w are zero, and
        before = 0,   process = diag(0, (h w / d²)², 0, Q_δ, Q_ξ)        on (q, v, w, c, ξ)
    w/d² the rate that a force gives a coordinate alone [1/s²], d its metric: no joint is asked, so that a disturbed state leaves
    the constraints, and a load that changes in a step moves nothing in it.
    A step that fails leaves NaN in its run. Runs are stepped one after the other; the last two steps of each are remembered.
    Source: thesis (1.40-1.56), with the noise before the step in place of (1.45) unless `printed`."""

    system: System
    sensors: CompiledSensors
    offset: np.ndarray
    method: Method
    known: np.ndarray
    inputs: np.ndarray
    loads: LoadProcess
    coordinates: ParameterCoordinates
    Q_w: np.ndarray
    Q_xi: np.ndarray
    R: np.ndarray
    zero: Zero | None = None
    rest: bool = False
    corrected: bool = False
    printed: bool = False
    second: np.ndarray | None = None
    _last: dict[int, Advance] = field(default_factory=dict, init=False, repr=False)
    _recent: dict[int, tuple[_Taken, ...]] = field(default_factory=dict, init=False, repr=False)
    _rests: dict[int, np.ndarray] = field(default_factory=dict, init=False, repr=False)
    _begun: dict[int, Begun] = field(default_factory=dict, init=False, repr=False)
    _added: dict[str, tuple[tuple[np.ndarray | None, ...], np.ndarray]] = field(
        default_factory=dict, init=False, repr=False
    )

    @property
    def h(self) -> float:
        return self.loads.h

    @cached_property
    def q(self) -> slice:
        return slice(0, self.system.size)

    @cached_property
    def v(self) -> slice:
        return slice(self.system.size, 2 * self.system.size)

    @cached_property
    def w(self) -> slice:
        return slice(self.v.stop, self.v.stop + (self.system.size if self._forced else 0))

    @cached_property
    def delta(self) -> slice:
        return slice(self.w.stop, self.w.stop + self.loads.size)

    @cached_property
    def c(self) -> slice:
        return slice(self.delta.stop, self.delta.stop + self.loads.size)

    @cached_property
    def u(self) -> np.ndarray:
        """Places (nu,) of the unknown loads."""
        return self.c.start + self.loads.first

    @cached_property
    def xi(self) -> slice:
        return slice(self.c.stop, self.size)

    @cached_property
    def size(self) -> int:
        return self.c.stop + self.coordinates.size

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
        return np.concatenate([self.u, np.arange(self.xi.start, self.size)])

    @property
    def loss(self) -> str:
        return "a time step of the bench could not be solved"

    def pack(self, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """x (size,) of q, v (n,), the unknown inputs u (nu,) and all parameters θ (nθ,); w = δ = 0."""
        x = np.zeros(self.size)
        x[self.q], x[self.v], x[self.u], x[self.xi] = q, v, u, self.coordinates.xi(theta)
        return x

    def spread(self, P: np.ndarray) -> np.ndarray:
        """Covariance (size, size) of x from that of (q, v, u, ξ); w = δ = 0, rates as they are at the start."""
        states = np.concatenate([np.arange(self.v.stop), self.position])
        whole = np.zeros((self.size, self.size))
        whole[self.c, self.c] = np.diag(self.loads.std**2)
        whole[np.ix_(states, states)] = P
        return whole

    def begin(self, x: np.ndarray, k: int) -> None:
        """What step k from x (B, size) leaves out, for all trials of this step."""
        for run in [old for old in self._begun if old >= len(x)]:
            del self._begun[run]
        for run, state in enumerate(x if self.corrected else ()):
            self._begin(run, state, k)

    def step(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """f(x) (B, size) and ∂f/∂x (B, size, size) of x (B, size); NaN where a step fails."""
        steps = [self._whole(run, state, k) for run, state in enumerate(x)]
        if len(steps) == 1:
            return steps[0][0][None], steps[0][1][None]
        return np.stack([ahead for ahead, _ in steps]), np.stack([A for _, A in steps])

    def measure(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Readings (B, m) and their slopes (B, m, size)."""
        y, J = np.empty((len(x), self.channels)), np.zeros((len(x), self.channels, self.size))
        for run, state in enumerate(x):
            y[run], J[run] = self.measured_at(state, k + 1)
        return y - self.offset, J

    def measured_at(self, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Readings (m,) at kh of x (size,), zeroed but for `offset`, and their slopes (m, size)."""
        y, J = self.read(self.sensors, x, k)
        if self.zero is not None and np.isfinite(x.sum()):
            try:
                taken_off, slopes = self.zero(x[self.xi])
            except (NumericalError, UserError):
                taken_off, slopes = np.full(self.channels, np.nan), np.zeros((self.channels, self.coordinates.size))
            y -= taken_off
            J[:, self.xi] -= slopes
        return y, J

    def read(self, sensors: CompiledSensors, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """What sensors of the system read at kh of x (size,), and its slopes (m, size); NaN of accelerometers of no finite x."""
        J = np.zeros((len(sensors.channels), self.size))
        if not sensors.accelerometers:
            y, J[:, self.q], J[:, self.v] = sensors.read(x[self.q], x[self.v])
            return y, J
        if not np.isfinite(x.sum()):
            return np.full(len(J), np.nan), J
        u, (theta, by_xi) = np.array(self.known[k], dtype=float), self.coordinates.theta(x[self.xi])
        u[self.inputs] = x[self.u]
        second = np.zeros(len(self.system.drives.names)) if self.second is None else self.second[k]
        reading = measure(self.system, sensors, x[self.q], x[self.v], u, theta, second)
        J[:, self.q], J[:, self.v], J[:, self.u] = reading.by_q, reading.by_v, reading.by_u[:, self.inputs]
        J[:, self.xi] = reading.by_theta @ by_xi
        return reading.y, J

    def process(self, k: int) -> np.ndarray:
        """Of every run where it began step k (B, size, size), or one for all where nothing is corrected."""
        if not self.corrected:
            return self._noise[0]
        # the same array while nothing in it is new: its factors are kept by whoever takes them
        parts = tuple(part for run in sorted(self._begun) for part in self._begun[run].noises(k))
        known, whole = self._added.get("process", ((None,), self._noise[0]))
        if len(known) == len(parts) and all(new is old for new, old in zip(parts, known, strict=True)):
            return whole
        moved = self.v.stop
        whole = np.tile(self._noise[0], (max(len(self._begun), 1), 1, 1))
        for run, now in self._begun.items():
            for part in now.noises(k):
                if part is not None:
                    whole[run, :moved, :moved] += part
        self._added["process"] = parts, whole
        return whole

    def before(self, k: int) -> np.ndarray:
        return self._noise[1]

    def noise(self, k: int) -> np.ndarray:
        return self.R

    def lost(self, x: np.ndarray) -> np.ndarray:
        return ~np.isfinite(x.sum(axis=1))

    def projected(self, x: np.ndarray, k: int) -> np.ndarray:
        """x (B, size) at kh with q and v put back on φ(q) = 0, B(q)v = −φ_t, nearest in the metric; NaN where that fails."""
        x = x.copy()
        for state in x:
            if np.isfinite(state.sum()):
                try:
                    state[self.q], state[self.v] = nearest_state(
                        self.system, state[self.q], state[self.v], self.known[k]
                    )
                except UserError:
                    state[:] = np.nan
        return x

    def violation(self, x: np.ndarray, k: int) -> np.ndarray:
        """Violation of φ(q) = 0 by x (B, size) at kh, relative to ‖Dq‖ and in unit rows: the largest constraint (B,) [-]."""
        off = np.zeros(len(x))
        for run, state in enumerate(x):
            phi, B, _ = constraints_at(self.system, state[self.q], self.known[k])
            if len(phi):
                d = self.system.metric
                off[run] = np.max(np.abs(phi) * unit_rows(B, 1 / d)[1]) / np.linalg.norm(d * state[self.q])
        return off

    @property
    def _forced(self) -> bool:
        """Whether a white force is a state."""
        return bool(self.Q_w.any()) and not self.printed

    @cached_property
    def _noise(self) -> tuple[np.ndarray, np.ndarray]:
        """After every step, and before it."""
        after, nothing = np.zeros((self.size, self.size)), np.zeros((self.size, self.size))
        after[self.xi, self.xi] = np.diag(self.Q_xi) if self.Q_xi.ndim == 1 else self.Q_xi
        if self.printed:
            after[self.v, self.v] = np.diag(self.Q_w * (self.h / self.system.metric**2) ** 2)
            after[self.c, self.c] = self.loads.noise_covariance
            return after, nothing
        if self._forced:
            after[self.w, self.w] = np.diag(self.Q_w)
        after[self.delta, self.delta] = self.loads.noise_covariance
        return nothing, after

    def _whole(self, run: int, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """The step and its slopes, with what it leaves out."""
        step = self._take(run, x, k)
        if not self.corrected or not np.isfinite(step.ahead.sum()):
            return step.ahead, step.A
        now = self._begun.get(run)
        if now is None or now.k != k:
            now = self._begin(run, x, k)
        if now.left is None:
            return step.ahead, step.A
        left, moved = now.left, self.v.stop
        ahead, A = step.ahead.copy(), step.A.copy()
        off = x - now.x
        ahead[:moved] += now.by_xi @ off[self.xi]
        ahead[:moved] += (
            left.change + left.by_state @ off[:moved] + left.by_load @ off[self.c] + left.by_noise @ x[self.delta]
        )
        A[:moved, :moved] += left.by_state
        A[:moved, self.c] += left.by_load
        A[:moved, self.delta] += left.by_noise
        A[:moved, self.xi] += now.by_xi
        return ahead, A

    def _begin(self, run: int, x: np.ndarray, k: int) -> Begun:
        """Nothing where the step itself cannot be taken."""
        step, n = self._take(run, x, k), self.v.stop
        if not np.isfinite(step.ahead.sum()):
            self._begun[run] = Begun(k, x.copy(), None, np.zeros((n, self.coordinates.size)), np.zeros((n, n)))
            return self._begun[run]
        u, end = np.array(self.known[k : k + 2], dtype=float)
        u[self.inputs] = end[self.inputs] = x[self.u]
        theta, rest = self.coordinates.theta(x[self.xi])[0], self.rest and k == 0
        q, v = x[self.q], x[self.v]
        if rest:
            q, v = self._at_rest(run, q, u, theta), np.zeros_like(v)
        self._begun[run] = begin_step(
            Plant(self.system, self.method, self.loads, self.inputs), self.coordinates, x, x[self.xi], k,
            Start(q, v, x[self.c], u, end, theta), (step.ahead[self.q], step.ahead[self.v]), rest, self._begun.get(run),
        )  # fmt: skip
        return self._begun[run]

    def _take(self, run: int, x: np.ndarray, k: int) -> _Taken:
        before = self._recent.get(run, ())
        for one in before:
            if one.k == k and np.array_equal(one.x, x):
                return one
        # an update ends at a trial, but may have refused one since
        step = self._fresh(run, x, k)
        self._recent[run] = (step, *before[:1])
        return step

    def _fresh(self, run: int, x: np.ndarray, k: int) -> _Taken:
        size, start, end = self.size, *np.array(self.known[k : k + 2], dtype=float)
        c, first, across = self.loads.transition @ x[self.c] + x[self.delta], self.loads.first, self.loads.transition
        start[self.inputs], end[self.inputs] = x[self.u], c[first]
        w = x[self.w] if self.w.stop > self.w.start else None
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                theta, by_xi = self.coordinates.theta(x[self.xi])
                last, near = self._last.get(run), self._near(run, x, k)
                q, v = x[self.q], x[self.v]
                if self.rest and k == 0:
                    q, v = self._at_rest(run, q, start, theta), np.zeros_like(v)
                new = advance(self.system, q, v, (start, end), self.h, theta, self.method, w, last, near)
                s = slopes(self.system, new, w is not None)
        except (NumericalError, UserError):
            none = np.zeros((0, 0))
            return _Taken(x.copy(), k, np.full(size, np.nan), np.full((size, size), np.nan), (none, none))
        self._last[run] = new
        A, ahead, moved = np.zeros((size, size)), x.copy(), self.w.start
        ahead[self.q], ahead[self.v], ahead[self.w] = new.q, new.v, 0.0
        ahead[self.c], ahead[self.delta] = c, 0.0
        by_start, by_end = s.B_start[:, self.inputs], s.B_end[:, self.inputs]
        A[:moved, :moved] = s.A
        A[:moved, self.delta.start + first] = by_end
        A[:moved, self.c] = by_end @ across[first]
        A[:moved, self.u] += by_start
        if w is not None:
            A[:moved, self.w] = s.B_w
        A[:moved, self.xi] = s.B_theta @ by_xi
        if self.rest and k == 0:
            by_u, by_theta = static_response(self.system, q, start, theta)
            A[:moved, :moved] = 0.0
            A[:moved, self.u] += s.A[:, self.q] @ by_u[:, self.inputs]
            A[:moved, self.xi] += s.A[:, self.q] @ by_theta @ by_xi
        A[self.c, self.delta], A[self.c, self.c] = np.eye(self.loads.size), across
        A[self.xi, self.xi] = np.eye(self.coordinates.size)
        drive = s.B_start.copy(), s.B_end.copy()
        for slope in drive:
            slope[:, self.inputs] = 0.0
        return _Taken(x.copy(), k, ahead, A, drive)

    def _at_rest(self, run: int, q: np.ndarray, u: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """The equilibrium (n,) under u and θ near the one that was found last in this run, else near q."""
        known = self._rests.get(run)
        equilibrium = static_equilibrium(self.system, q if known is None else known, u, theta, near=known is not None)[
            0
        ]
        self._rests[run] = equilibrium
        return equilibrium

    def _near(self, run: int, x: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Where the step taken last in this run says that x leads, to first order."""
        before = self._recent.get(run)
        if not before or not np.isfinite(before[0].ahead.sum()) or (self.rest and before[0].k == 0):
            return None  # the slopes of a step from rest know nothing of its q and v
        last, moved = before[0], self.w.start
        ahead = last.ahead[:moved] + last.A[:moved] @ (x - last.x)
        for later, slope in enumerate(last.drive):
            ahead += slope @ (self.known[k + later] - self.known[last.k + later])
        return (ahead[self.q], ahead[self.v]) if np.isfinite(ahead.sum()) else None

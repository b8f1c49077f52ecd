"""Unmodelled dynamics of a step: the exact linearised flow of the bench, with loads that vary within the step, minus the step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpstrf

from strainsight.errors import NumericalError, UserError
from strainsight.multibody.accelerations import input_slopes, instant
from strainsight.multibody.coupled import tangent_space
from strainsight.multibody.inverse.loads import LoadProcess, doublings_of, step_responses
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.step import Method, linear_step
from strainsight.multibody.system import System

ROUNDING = 1e-12
"""Relative variance of a motion with known load at both ends below which it is rounding."""
WIDTH = 1e-4
"""Step of the differences in the parameter coordinates: logarithms, or µm of preload."""
CHECKED = 4
"""Steps between two estimates of the remaining error of `linearise`, which would double the cost in each step."""
KEPT, CLOSE = 8, 0.05
"""Most steps that one linearisation serves. The number doubles while its final error is below CLOSE of σ of the unobservable
part, and is one otherwise."""


class Start(NamedTuple):
    """Start of a step: q, v (n,); c (k,): unknown loads; u and u_end (width,): loads at start and end, with c for the unknown
    ones; theta (nθ,)."""

    q: np.ndarray
    v: np.ndarray
    c: np.ndarray
    u: np.ndarray
    u_end: np.ndarray
    theta: np.ndarray


@dataclass(frozen=True)
class StepError:
    """Error of a step, e = change + by_state ((q, v) − start) + by_load (c − start) + by_noise δ + ε, missing in (q', v').
    change (2n,); by_state (2n, 2n); by_load, by_noise (2n, k); noise (2n, 2n): covariance of ε, which is independent of δ."""

    change: np.ndarray
    by_state: np.ndarray
    by_load: np.ndarray
    by_noise: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True, eq=False)
class Linearised:
    """The bench linearised at one place, and the maps by which a step from a start near it leaves out

        T (by_speed ẏ₀ + by_load c + by_constant f₀' + by_ramp B(u(h) − u₀)),    f₀' = f₀ + C ẏ₀ − B c

    flow: T, C and B; by_speed, by_constant, by_ramp (2r, r), by_load (2r, k); left: what is left out where it was linearised.
    """

    flow: _Flow
    by_speed: np.ndarray
    by_load: np.ndarray
    by_constant: np.ndarray
    by_ramp: np.ndarray
    left: StepError

    def change(self, system: System, h: float, start: Start) -> np.ndarray:
        """`StepError.change` (2n,) of a step of h from start."""
        speed, constant, ramp = _driven(system, h, start, self.flow)
        response = self.by_speed @ speed + self.by_load @ start.c + self.by_constant @ constant + self.by_ramp @ ramp
        return _out(self.flow.T, response[:, None])[:, 0]


class Plant(NamedTuple):
    """What steps: the system, the method of the step, how the unknown loads move, and their places (nu,) in `system.inputs`."""

    system: System
    method: Method
    loads: LoadProcess
    inputs: np.ndarray


def linearise(plant: Plant, start: Start, middle: tuple[np.ndarray, np.ndarray]) -> Linearised:
    """Of the step of loads.h from `start`, linearised at `middle` (q, v), T its motions, M ÿ = f:

        f = f₀ − K y − C (ẏ − ẏ₀) + B (u(t) − u₀),   ċ = A c + w,   z = (y, ẏ),   (z, c)' = Φ (z, c) + …,   covariance Q
        e = T ((Φ − Φ_step) (z, c, 1) + (Q_zc Q_c⁻¹ − D) δ) + ε,     ε ~ N(0, T (Q_z − Q_zc Q_c⁻¹ Q_cz) Tᵀ)

    with Φ_step, D what the step makes of state and δ.

    The step takes loads for straight lines and modes for what implicit stages make of them; this is exact in both for a bench
    that is linear as long as the step lasts. ε is the path of the loads between its ends, a bridge, which no reading of c
    tells: independent of δ, and of other steps. f₀: what accelerates the bench at the start along its motions."""
    system, method, loads, _ = plant
    h, n, k = loads.h, system.size, loads.size
    flow = _flow(plant, start, middle)
    T, unknown = flow.T, flow.unknown
    r = T.shape[1]
    G = np.zeros((len(flow.F), r))
    G[r : 2 * r] = flow.yields
    phi, gathered, constant, ramp = step_responses(flow.F, flow.Q, G, h / 2**flow.doublings, flow.doublings)
    units = flow.units
    phi, gathered = units[:, None] * phi / units, units[:, None] * gathered * units
    z, c = slice(0, 2 * r), slice(2 * r, 2 * r + k)
    constant, ramp = units[z, None] * constant[z], units[z, None] * ramp[z]

    through, first, last = linear_step(flow.mass, flow.damping, flow.stiffness, h, method)
    by_state = phi[z, z] - through
    by_load = phi[z, c] - first @ unknown - last @ (unknown @ loads.transition)
    known = _by_ends(gathered[z, c], loads.noise_covariance)
    by_noise = known - last @ unknown
    bridge = _out(T, _semidefinite(gathered[z, z] - known @ gathered[c, z], np.diag(gathered)[z]))
    by_start = _out(T, _back(by_state, flow.along))
    left = StepError(np.zeros(2 * n), by_start, _out(T, by_load), _out(T, by_noise), bridge @ bridge.T)
    result = Linearised(flow, by_state[:, r:], by_load, constant - first - last, ramp / h - last, left)
    return replace(result, left=replace(left, change=result.change(system, h, start)))


def change_at(plant: Plant, start: Start, middle: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """`StepError.change` (2n,) alone, of `linearise` with these arguments: a fifth of its cost."""
    system, method, loads, _ = plant
    h = loads.h
    flow = _flow(plant, start, middle)
    T, r = flow.T, flow.T.shape[1]
    speed, constant, ramp = _driven(system, h, start, flow)
    G = np.zeros((len(flow.F), 2))
    G[r : 2 * r] = flow.yields @ np.column_stack([constant, ramp / h])
    phi, _, by_constant, by_ramp = step_responses(flow.F, None, G, h / 2**flow.doublings, flow.doublings)
    begun = np.concatenate([np.zeros(r), speed, start.c])
    exact = flow.units[: 2 * r] * ((phi @ begun) + by_constant[:, 0] + by_ramp[:, 1])[: 2 * r]
    through, first, last = linear_step(flow.mass, flow.damping, flow.stiffness, h, method)
    by_step = through[:, r:] @ speed + first @ (flow.unknown @ start.c + constant)
    by_step += last @ (flow.unknown @ (loads.transition @ start.c) + constant + ramp)
    return _out(T, (exact - by_step)[:, None])[:, 0]


@dataclass(frozen=True, eq=False)
class _Flow:
    """The bench linearised at one place: T (n, r) and D²T (n, r); mass, damping, stiffness (r, r), push B (r, all inputs), of
    them unknown (r, k) by c; in states (ωy, ẏ, c), so that both halves of a motion have equal weight: F, the intensity Q of their
    noise, yields (r, r) = M⁻¹, units of the states; doublings of a part of the step that make the whole."""

    T: np.ndarray
    along: np.ndarray
    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    push: np.ndarray
    unknown: np.ndarray
    F: np.ndarray
    Q: np.ndarray
    yields: np.ndarray
    units: np.ndarray
    doublings: int


def _flow(plant: Plant, start: Start, middle: tuple[np.ndarray, np.ndarray]) -> _Flow:
    system, _, loads, inputs = plant
    h, k, d = loads.h, loads.size, system.metric
    at = tangent_space(system, *middle, start.u, start.theta)
    T = at.T
    r = T.shape[1]
    M, C, K = at.matrices
    B = at.pushes(input_slopes(system, at.at, middle[0]))
    unknown = np.zeros((r, k))
    unknown[:, loads.first] = B[:, inputs]
    per = np.linalg.solve(M, np.hstack([K, C, unknown, np.eye(r)]))
    omega = max(float(np.sqrt(np.linalg.norm(per[:, :r]))), 1.0 / h)
    size = 2 * r + k
    F, Q = np.zeros((size, size)), np.zeros((size, size))
    F[:r, r : 2 * r] = omega * np.eye(r)
    F[r : 2 * r, :r], F[r : 2 * r, r : 2 * r] = -per[:, :r] / omega, -per[:, r : 2 * r]
    F[r : 2 * r, 2 * r :] = per[:, 2 * r : -r]
    F[2 * r :, 2 * r :], Q[2 * r :, 2 * r :] = loads.A, loads.Q
    doublings = doublings_of(h * max(omega, float(np.linalg.norm(per[:, r : 2 * r]))))
    units = np.ones(size)
    units[:r] = 1 / omega
    return _Flow(T, T * (d * d)[:, None], M, C, K, B, unknown, F, Q, per[:, -r:], units, doublings)


def _driven(system: System, h: float, start: Start, at: _Flow) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ẏ₀, f₀' = f₀ + C ẏ₀ − B c and B(u(h) − u₀) (r,) of a step from start."""
    p_second = (start.u_end - start.u)[system.drives.rates] / h
    moving = instant(system, start.q, start.v, start.u, start.theta, p_second)
    speed = start.v @ at.along
    constant = at.mass @ (moving.acceleration @ at.along) + at.damping @ speed - at.unknown @ start.c
    return speed, constant, at.push @ (start.u_end - start.u)[: at.push.shape[1]]


def _out(T: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(q, v) (2n, k) of motions z (2r, k)."""
    r = T.shape[1]
    return np.concatenate([T @ z[:r], T @ z[r:]])


def _back(X: np.ndarray, along: np.ndarray) -> np.ndarray:
    """X (k, 2r) by motions as one by q and v (k, 2n)."""
    r = along.shape[1]
    return np.concatenate([X[:, :r] @ along.T, X[:, r:] @ along.T], axis=1)


def _semidefinite(P: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """A factor (n, n) of P (n, n), which is what is left of these variances (n,): less than their rounding counts as none."""
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))
    left = 0.5 * (P + P.T) / np.outer(scale, scale)
    # of what is below in the diagonal nothing is kept, nor anything that goes with it
    none = np.diag(left) <= ROUNDING
    left[none] = left[:, none] = 0.0
    factor, order, rank, _ = dpstrf(left, lower=1, tol=ROUNDING)
    F = np.zeros((len(P), rank))
    F[order - 1] = np.tril(factor)[:, :rank]
    return np.asarray(scale[:, None] * F)


def _by_ends(cross: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Q_zc Q_c⁻¹ (2r, k), 0 of what no noise drives; own Q_c (k, k)."""
    if not squares.any():
        return np.zeros_like(cross)
    size = np.sqrt(np.diag(squares))
    driven = size > 0
    known = np.zeros_like(cross)
    scaled = squares[np.ix_(driven, driven)] / np.outer(size[driven], size[driven])
    known[:, driven] = np.linalg.solve(scaled, (cross[:, driven] / size[driven]).T).T / size[driven]
    return known


@dataclass(frozen=True, eq=False)
class Begun:
    """Step k begins where left.change was found; by_xi (2n, p): slopes of that by the parameters; stale (2n, 2n): mean square of
    what it changes by when linearised where it was not; left None: it cannot be had. at: what the step is linearised as, since
    step `since`, for `serves` steps."""

    k: int
    x: np.ndarray
    left: StepError | None
    by_xi: np.ndarray
    stale: np.ndarray
    at: Linearised | None = None
    since: int = 0
    serves: int = 1

    def noises(self, k: int) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Parts of the covariance (2n, 2n) of the motion that no state tells of step k, None of none: the same arrays as long as
        a linearisation serves."""
        return (None, None) if self.k != k else (None if self.left is None else self.left.noise, self.stale)


def begin_step(
    plant: Plant,
    coordinates: ParameterCoordinates,
    x: np.ndarray,
    xi: np.ndarray,
    k: int,
    start: Start,
    ahead: tuple[np.ndarray, np.ndarray],
    rest: bool,
    before: Begun | None,
) -> Begun:
    """Of step k from x, linearised half-way between its start and `ahead`, q' and v' of the step alone; xi (p,) of x. rest:
    whether it begins in the equilibrium under its loads and parameters: then nothing is left out whatever they are, but of
    the rates and of what is drawn. before: the step before, whose estimate of the error goes on, and its linearisation while
    it serves: then only what moves the bench at the start is found anew. When it has served, what it is off by is part of the
    error."""
    system, _, loads, _ = plant
    n, p = 2 * system.size, len(xi)
    by_xi = np.zeros((n, p))
    if before is not None and before.k != k - 1:
        before = None
    stale = np.zeros((n, n)) if before is None else before.stale
    if before is not None and before.left is None:
        before = None
    old = None if before is None else before.at
    middle = 0.5 * (start.q + ahead[0]), 0.5 * (start.v + ahead[1])
    try:
        if before is not None and old is not None and k < before.since + before.serves:
            left = replace(old.left, change=old.change(system, loads.h, start))
            return replace(before, k=k, x=x.copy(), left=left)
        at = linearise(plant, start, middle)
        left = at.left
        for j in range(0 if rest else p):
            moved = xi.copy()
            moved[j] += WIDTH
            change = change_at(plant, start._replace(theta=coordinates.theta(moved)[0]), middle)
            by_xi[:, j] = (change - left.change) / WIDTH
        serves, differences = 1, []
        if old is not None and before is not None:
            d = left.change - old.change(system, loads.h, start)
            sigma = np.sqrt(np.diag(left.noise))
            serves = min(2 * before.serves, KEPT) if np.all(np.abs(d) <= CLOSE * sigma) else 1
            if before.serves > 1:
                differences.append(d)
        if differences or k % CHECKED == 0:
            differences.append(left.change - change_at(plant, start, (start.q, start.v)))
        if differences:
            off = np.array(differences)
            new = off.T @ off
            stale = 0.5 * (stale + new) if stale.any() else new
    except (NumericalError, UserError):
        return Begun(k, x.copy(), None, np.zeros((n, p)), stale)
    if rest:
        by_load = left.by_load.copy()
        by_load[:, loads.first] = 0.0
        left = replace(left, by_state=np.zeros_like(left.by_state), by_load=by_load)
        return Begun(k, x.copy(), left, by_xi, stale)
    return Begun(k, x.copy(), left, by_xi, stale, at, k, serves)

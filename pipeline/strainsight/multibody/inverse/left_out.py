"""What a step leaves out: the exact flow of the bench linearised along it, with loads that move within it, less the step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpstrf

from strainsight.multibody.accelerations import instant
from strainsight.multibody.advance import CARRIED, GAMMA, INSTANTS, Method
from strainsight.multibody.equations import input_slopes
from strainsight.multibody.inverse.loads import SHORT, LoadProcess, step_responses
from strainsight.multibody.spectrum import tangent_space
from strainsight.multibody.system import System

ROUNDING = 1e-12
"""Share of its variance that is left of a motion when the load's ends are known, below which it is rounding."""


class Start(NamedTuple):
    """Where a step begins, and what is known of its loads: q, v (n,), c (k,) of the unknown ones, u and u_end (width,) at
    its start and end, the unknown ones of c at both; theta (nθ,)."""

    q: np.ndarray
    v: np.ndarray
    c: np.ndarray
    u: np.ndarray
    u_end: np.ndarray
    theta: np.ndarray


@dataclass(frozen=True)
class LeftOut:
    """e = change + by_state ((q, v) − start) + by_load (c − start) + by_drawn δ + ε, what (q', v') lacks after the step.

    change (2n,); by_state (2n, 2n); by_load, by_drawn (2n, k); noise (2n, 2n): covariance of ε, which δ does not tell.
    """

    change: np.ndarray
    by_state: np.ndarray
    by_load: np.ndarray
    by_drawn: np.ndarray
    noise: np.ndarray


@dataclass(frozen=True, eq=False)
class Linearised:
    """The bench linearised at one place, and the maps by which a step from a start near it leaves out

        T (by_speed ẏ₀ + by_load c + by_constant f₀' + by_ramp B(u(h) − u₀)),    f₀' = f₀ + C ẏ₀ − B c

    T (n, r); mass, damping (r, r); push B (r, all inputs), of them unknown (r, k) by c; by_speed, by_constant, by_ramp (2r, r),
    by_load (2r, k); left: what is left out where it was linearised.
    """

    T: np.ndarray
    mass: np.ndarray
    damping: np.ndarray
    push: np.ndarray
    unknown: np.ndarray
    by_speed: np.ndarray
    by_load: np.ndarray
    by_constant: np.ndarray
    by_ramp: np.ndarray
    left: LeftOut

    def change(self, system: System, h: float, start: Start) -> np.ndarray:
        """`LeftOut.change` (2n,) of a step of h from start."""
        d = system.metric
        along = self.T * (d * d)[:, None]
        p_second = (start.u_end - start.u)[system.drives.rates] / h
        moving = instant(system, start.q, start.v, start.u, start.theta, p_second)
        speed = start.v @ along
        constant = self.mass @ (moving.acceleration @ along) + self.damping @ speed - self.unknown @ start.c
        ramp = self.push @ (start.u_end - start.u)[: self.push.shape[1]]
        found = self.by_speed @ speed + self.by_load @ start.c + self.by_constant @ constant + self.by_ramp @ ramp
        r = len(speed)
        return np.concatenate([self.T @ found[:r], self.T @ found[r:]])


def linearised(
    system: System,
    method: Method,
    loads: LoadProcess,
    inputs: np.ndarray,
    start: Start,
    middle: tuple[np.ndarray, np.ndarray],
) -> Linearised:
    """Of the step of loads.h from `start`, linearised at `middle` (q, v), T its motions, M ÿ = f:

        f = f₀ − K y − C (ẏ − ẏ₀) + B (u(t) − u₀),   ċ = A c + w,   z = (y, ẏ),   (z, c)' = Φ (z, c) + …,   covariance Q
        e = T ((Φ − Φ_step) (z, c, 1) + (Q_zc Q_c⁻¹ − D) δ) + ε,     ε ~ N(0, T (Q_z − Q_zc Q_c⁻¹ Q_cz) Tᵀ)

    with Φ_step, D what the step makes of state and δ.

    The step takes loads for straight lines and modes for what implicit stages make of them; this is exact in both for a bench
    that is linear as long as the step lasts. ε is the path of the loads between its ends, a bridge, which no reading of c
    tells: independent of δ, and of other steps. f₀: what accelerates the bench at the start along its motions.
    inputs (nu,): places of the unknown loads in `system.inputs`.
    """
    h, n, k = loads.h, system.size, loads.size
    at = tangent_space(system, *middle, start.u, start.theta)
    T, d = at.T, system.metric
    r = T.shape[1]
    M, C, K = at.project(at.at.mass), at.project(at.at.damping), at.project(at.at.stiffness)
    B = -T.T @ input_slopes(system, at.at, middle[0])
    unknown = np.zeros((r, k))
    unknown[:, loads.first] = B[:, inputs]

    # η = ω y, so that both halves of a motion count alike
    per = np.linalg.solve(M, np.hstack([K, C, unknown, np.eye(r)]))
    omega = max(float(np.sqrt(np.linalg.norm(per[:, :r]))), 1.0 / h)
    size = 2 * r + k
    F, Q, G = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, r))
    F[:r, r : 2 * r] = omega * np.eye(r)
    F[r : 2 * r, :r], F[r : 2 * r, r : 2 * r] = -per[:, :r] / omega, -per[:, r : 2 * r]
    F[r : 2 * r, 2 * r :], G[r : 2 * r] = per[:, 2 * r : -r], per[:, -r:]
    F[2 * r :, 2 * r :], Q[2 * r :, 2 * r :] = loads.A, loads.Q
    doublings = max(0, int(np.ceil(np.log2(h * max(omega, float(np.linalg.norm(per[:, r : 2 * r]))) / SHORT))))
    phi, gathered, constant, ramp = step_responses(F, Q, G, h / 2**doublings, doublings)
    units = np.concatenate([np.full(r, 1 / omega), np.ones(r + k)])
    phi, gathered = units[:, None] * phi / units, units[:, None] * gathered * units
    z, c = slice(0, 2 * r), slice(2 * r, 2 * r + k)
    constant, ramp = units[z, None] * constant[z], units[z, None] * ramp[z]

    through, first, last = _step(M, C, K, h, method)
    by_state = phi[z, z] - through
    by_load = phi[z, c] - first @ unknown - last @ (unknown @ loads.transition)
    known = _by_ends(gathered[z, c], loads.drawn)
    by_drawn = known - last @ unknown
    noise = _semidefinite(gathered[z, z] - known @ gathered[c, z], np.diag(gathered)[z])
    out, back = np.zeros((2 * n, 2 * r)), np.zeros((2 * r, 2 * n))
    out[:n, :r] = out[n:, r:] = T
    back[:r, :n] = back[r:, n:] = T.T * (d * d)
    bridge = out @ noise
    left = LeftOut(np.zeros(2 * n), out @ by_state @ back, out @ by_load, out @ by_drawn, bridge @ bridge.T)
    found = Linearised(T, M, C, B, unknown, by_state[:, r:], by_load, constant - first - last, ramp / h - last, left)
    return replace(found, left=replace(left, change=found.change(system, h, start)))


def _step(M: np.ndarray, C: np.ndarray, K: np.ndarray, h: float, method: Method) -> tuple[np.ndarray, ...]:
    """The step of (y, ẏ) (2r, 2r), and of the forces at its start and end (2r, r), straight between, by `advance`."""
    r, own = len(M), h * INSTANTS[method][0]
    velocity = np.linalg.solve(M / own + C + own * K, np.column_stack([-K, M / own, np.eye(r)]))
    whole = np.vstack([own * velocity, velocity])
    whole[:r, :r] += np.eye(r)
    X, b = whole[:, : 2 * r], whole[:, 2 * r :]
    if method == "thesis":
        return X, np.zeros_like(b), b
    carried = CARRIED * X
    between = carried @ b
    return carried @ X + (1 - CARRIED) * X, (1 - GAMMA) * between, b + GAMMA * between


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


def _by_ends(cross: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Q_zc Q_c⁻¹ (2r, k), 0 of what no noise drives; own Q_c (k, k)."""
    if not own.any():
        return np.zeros_like(cross)
    size = np.sqrt(np.diag(own))
    there = size > 0
    known = np.zeros_like(cross)
    scaled = own[np.ix_(there, there)] / np.outer(size[there], size[there])
    known[:, there] = np.linalg.solve(scaled, (cross[:, there] / size[there]).T).T / size[there]
    return known

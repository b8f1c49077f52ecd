"""Small motions about a state: modes of the coupled system, its stability, its state space, and what a step follows of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space
from scipy.linalg.lapack import dgeqp3, dorgqr, dtrtrs

from strainsight.multibody.accelerations import Balance, balance, input_slopes
from strainsight.multibody.step import CARRIED, GAMMA, INSTANTS, Method
from strainsight.multibody.system import System

APART = 1e-6
"""Least ratio of the smallest to the largest diagonal entry of R, in pivoted QR factors of the constraints, for which they are
used."""


@dataclass(frozen=True)
class Tangent:
    """The motions q + T y that the constraints leave, T (n, r), orthonormal in the metric, and all derivatives there, the
    forces of the constraints balanced (at); scale: ‖K‖ before its terms cancel, in the metric."""

    T: np.ndarray
    at: Balance
    scale: float

    @property
    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """M, C, K (r, r): TᵀXT of mass, damping and stiffness."""
        M, C, K = (self.T.T @ X @ self.T for X in (self.at.mass, self.at.damping, self.at.stiffness))
        return M, C, K

    def pushes(self, slopes: np.ndarray) -> np.ndarray:
        """−Tᵀ ∂f (r, k) of slopes ∂f (n, k)."""
        return np.asarray(-self.T.T @ slopes)


def tangent_space(system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray) -> Tangent:
    """Of the system held where it is: q on the constraints; v only sets the forces that depend on it. The stiffness is K_T −
    Σ λ ∇²φ, K_T the tangent of all forces, λ the constraint forces that balance them best."""
    d = system.metric
    at = balance(system, q, v, u, theta)
    scale = float(np.linalg.norm(at.stiffness / np.outer(d, d)))
    N = np.eye(system.size)
    if system.constrained:
        N, lam = _null_space(at.B / d, at.load / d)
        balanced = balance(system, q, v, u, theta, lam=lam)
        scale += float(np.linalg.norm((balanced.stiffness - at.stiffness) / np.outer(d, d)))
        at = balanced
    return Tangent(N / d[:, None], at, scale)


def _null_space(B: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """N (n, r), B N = 0, and λ (m,) with the smallest ‖load − Bᵀλ‖, the smallest one where constraints depend on each other."""
    m = len(B)
    n = B.shape[1]
    packed, order, reflections, _, _ = dgeqp3(B.T)
    diagonal = np.abs(np.diag(packed))
    if m > n or not diagonal[-1] > APART * diagonal[0]:
        return null_space(B), np.linalg.lstsq(B.T, load, rcond=None)[0]
    square = np.zeros((n, n))
    square[:, :m] = packed
    Q, _, _ = dorgqr(square, reflections)
    lam = np.empty(m)
    lam[order - 1] = dtrtrs(packed[:m], Q[:, :m].T @ load)[0]
    return Q[:, m:], lam


ROUNDING = 100.0
"""Times n eps ‖K‖, K before its terms cancel: a stiffness below is none."""
GROWS = 1e-6
"""Growth rate of a motion relative to its own rate above which it is unstable: undamped oscillations are at the limit."""


@dataclass(frozen=True)
class CoupledModes:
    """Small motions q + Φη about a state at rest that the forces balance, M = 1 in η:

        η̈ + C η̇ + K η = B Δu,     ΦᵀMΦ = 1,     Φᵀ(K + Kᵀ)/2 Φ = diag ω²

    shapes Φ (n, r) [1/√kg in metres]; squares ω² (r,) [1/s²], ascending, exactly 0 where nothing holds; C, K (r, r), K diagonal
    where no load turns with a body; B (r, width of u)."""

    shapes: np.ndarray
    squares: np.ndarray
    C: np.ndarray
    K: np.ndarray
    B: np.ndarray

    @property
    def frequency(self) -> np.ndarray:
        """Undamped natural frequencies (r,) [Hz]; 0 where nothing holds the motion or it topples."""
        return np.asarray(np.sqrt(np.maximum(self.squares, 0.0)) / (2 * np.pi))

    @property
    def held_frequency(self) -> np.ndarray:
        """Those (k,) [Hz] of motions that something holds."""
        return self.frequency[self.squares > 0]

    @property
    def damping(self) -> np.ndarray:
        """Damping ratios (r,) of the modes by themselves, 0 where there is no frequency."""
        omega = np.sqrt(np.maximum(self.squares, 0.0))
        return np.divide(np.diag(self.C), 2 * omega, out=np.zeros(len(omega)), where=omega > 0)

    @property
    def A(self) -> np.ndarray:
        """ẋ = A x + [0; B] Δu of x = (η, η̇) (2r, 2r) [1/s]."""
        r = len(self.squares)
        return np.block([[np.zeros((r, r)), np.eye(r)], [-self.K, -self.C]])

    @property
    def eigenvalues(self) -> np.ndarray:
        """Of A (2r,) complex [1/s], by their size."""
        values = np.linalg.eigvals(self.A) if len(self.squares) else np.zeros(0, dtype=complex)
        return values[np.lexsort((values.imag, values.real, np.round(np.abs(values), 12)))]


def coupled_modes(system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray) -> CoupledModes:
    """Of the system held where it is; q (n,) on the constraints, v only sets the forces that depend on it."""
    tangent = tangent_space(system, q, v, u, theta)
    M, C, K = tangent.matrices
    force = tangent.pushes(input_slopes(system, tangent.at, np.asarray(q, dtype=float)))
    if not len(M):
        return CoupledModes(tangent.T, np.zeros(0), C, K, force)
    squares, V = eigh(0.5 * (K + K.T), 0.5 * (M + M.T))
    squares = np.where(np.abs(squares) > ROUNDING * system.size * np.finfo(float).eps * tangent.scale, squares, 0.0)
    turning = 0.5 * (K - K.T)
    K = np.diag(squares) + (V.T @ turning @ V if np.abs(turning).max() > 1e-12 * tangent.scale else 0.0)
    return CoupledModes(tangent.T @ V, squares, V.T @ C @ V, K, V.T @ force)


def growth(system: System, modes: CoupledModes) -> tuple[float, str]:
    """Rate [1/s] of the motion by which the state is left, 0 where it is stable, and the body that moves most in it. A motion
    that nothing holds neither grows nor returns, and counts as stable."""
    if not len(modes.squares):
        return 0.0, ""
    values, vectors = np.linalg.eig(modes.A)
    # a double eigenvalue at zero is √eps off
    least = np.sqrt(np.finfo(float).eps) * max(1.0, float(np.abs(modes.eigenvalues).max(initial=0.0)))
    k = int(np.argmax(values.real))
    if values[k].real <= max(least, GROWS * abs(values[k])):
        return 0.0, ""
    motion = np.abs(modes.shapes @ vectors[: len(modes.squares), k]) * system.metric
    return float(values[k].real), max(system.of, key=lambda name: float(np.linalg.norm(motion[system.of[name]])))


SHARE = 0.01
"""Of the displacement in a mode, by which the step may be off."""
FINENESS = 2000
"""Frequencies that are tried."""


def resolved_frequency(frequencies: np.ndarray, h: float, method: Method) -> float:
    """Frequency of a load [Hz] up to which the displacement of all undamped modes of frequencies (k,) [Hz] is accurate to
    SHARE. In steps of h [s]; at most the first mode."""
    first = float(np.min(frequencies))
    tried = np.geomspace(1e-4, 1.0, FINENESS)[:-1] * min(first, 0.5 / h)
    off = np.max([relative_error(tried, float(frequency), h, method) for frequency in frequencies], axis=0)
    failing = np.flatnonzero(off > SHARE)
    return float(tried[-1] if not len(failing) else tried[max(failing[0] - 1, 0)])


def load_error(loads: np.ndarray, frequencies: np.ndarray, h: float, method: Method) -> np.ndarray:
    """Share (nu,) of the RMS of each load about its mean that the step does not resolve, 0 for a constant load:

        √(Σ e²|U|² / Σ |U|²),     e = min(1, error of the displacement in any mode),     U its spectrum with Hann's window

    loads (T + 1, nu) every h [N, N m]; frequencies (k,) [Hz] of the undamped modes."""
    count = len(loads)
    about = loads - loads.mean(axis=0)
    energy = np.abs(np.fft.rfft(about * np.hanning(count)[:, None], axis=0)[1:]) ** 2
    tried = np.fft.rfftfreq(count, h)[1:]
    # a load that a mode follows at its own frequency has no displacement to compare with
    with np.errstate(divide="ignore", invalid="ignore"):
        off = np.max([relative_error(tried, float(frequency), h, method) for frequency in frequencies], axis=0)
    off = np.minimum(np.nan_to_num(off, nan=1.0, posinf=1.0), 1.0)
    whole = energy.sum(axis=0)
    return np.sqrt(np.divide(off**2 @ energy, whole, out=np.zeros(loads.shape[1]), where=whole > 0))


def relative_error(load: np.ndarray, frequency: float, h: float, method: Method) -> np.ndarray:
    """|X_h(Ω)/X(Ω) − 1| of the displacement X = 1/(ω² − Ω²) of an undamped mode ω under a load of Ω, both in Hz:

        X_h = (Y(iω) − Y(−iω))/(2iω),     Y(s) = (b₀ + b₁E)/(E − R),   E = exp(iΩh),   ẏ = s y + f   in steps with
        R = (1 − c) r + c r²,   b₁ = b (1 + γ c r),   b₀ = (1 − γ) c r b,   r = 1/(1 − γsh),   b = γh r,   c = (1 − γ)/γ

    and of implicit Euler R = r, b₁ = b, b₀ = 0 with γ = 1. load (k,) [Hz]; h [s]."""
    omega, E = 2 * np.pi * frequency, np.exp(2j * np.pi * load * h)
    step = INSTANTS[method][0] * h

    def response(s: complex) -> np.ndarray:
        r = 1 / (1 - step * s)
        b = step * r
        if method == "thesis":
            return np.asarray(b * E / (E - r))
        R = (1 - CARRIED) * r + CARRIED * r * r
        return np.asarray(((1 - GAMMA) * CARRIED * r * b + b * (1 + GAMMA * CARRIED * r) * E) / (E - R))

    displacement = (response(1j * omega) - response(-1j * omega)) / (2j * omega)
    return np.asarray(np.abs(displacement * (omega**2 - (2 * np.pi * load) ** 2) - 1))

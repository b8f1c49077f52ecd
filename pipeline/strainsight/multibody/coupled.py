"""Modes of the coupled system, whether it is stable, and its state space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh

from strainsight.multibody.equations import input_slopes
from strainsight.multibody.spectrum import tangent_space
from strainsight.multibody.system import System

ROUNDING = 100.0
"""Times n eps ‖K‖, K before its terms cancel: a stiffness below is none."""
GROWS = 1e-6
"""Growth of a motion beside its own quickness above which it is unstable: what only swings is on the edge, and rounds off."""


@dataclass(frozen=True)
class CoupledModes:
    """Small motions q + Φη about a state at rest that the forces balance, M = 1 in η:

        η̈ + C η̇ + K η = B Δu,     ΦᵀMΦ = 1,     Φᵀ(K + Kᵀ)/2 Φ = diag ω²

    shapes Φ (n, r) [1/√kg in metres]; squares ω² (r,) [1/s²], ascending, exactly 0 where nothing holds; C, K (r, r), K diagonal
    where no load turns with a body; B (r, width of u).
    """

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
        own, omega = np.diag(self.C), np.sqrt(np.maximum(self.squares, 0.0))
        return np.divide(own, 2 * omega, out=np.zeros(len(own)), where=omega > 0)

    @property
    def A(self) -> np.ndarray:
        """ẋ = A x + [0; B] Δu of x = (η, η̇) (2r, 2r) [1/s]."""
        r = len(self.squares)
        return np.block([[np.zeros((r, r)), np.eye(r)], [-self.K, -self.C]])

    @property
    def eigenvalues(self) -> np.ndarray:
        """Of A (2r,) complex [1/s], by their size."""
        found = np.linalg.eigvals(self.A) if len(self.squares) else np.zeros(0, dtype=complex)
        return found[np.lexsort((found.imag, found.real, np.round(np.abs(found), 12)))]


def coupled_modes(system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray) -> CoupledModes:
    """Of the system held where it is; q (n,) on the constraints, v only sets the forces that depend on it."""
    found = tangent_space(system, q, v, u, theta)
    M, C, K = (found.project(X) for X in (found.at.mass, found.at.damping, found.at.stiffness))
    force = -found.T.T @ input_slopes(system, found.at, np.asarray(q, dtype=float))
    if not len(M):
        none = np.zeros((0, 0))
        return CoupledModes(found.T, np.zeros(0), none, none, np.zeros((0, force.shape[1])))
    squares, V = eigh(0.5 * (K + K.T), 0.5 * (M + M.T))
    squares = np.where(np.abs(squares) > ROUNDING * system.size * np.finfo(float).eps * found.scale, squares, 0.0)
    turning = 0.5 * (K - K.T)
    K = np.diag(squares) + (V.T @ turning @ V if np.abs(turning).max() > 1e-12 * found.scale else 0.0)
    return CoupledModes(found.T @ V, squares, V.T @ C @ V, K, V.T @ force)


def growth(system: System, modes: CoupledModes) -> tuple[float, str]:
    """Rate [1/s] of the motion by which the state is left, 0 where it is stable, and the body that moves most in it.

    A motion that nothing holds neither grows nor returns, and counts as stable.
    """
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

"""Small motions about a state: those that the constraints leave, and all derivatives there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space
from scipy.linalg.lapack import dgeqp3, dorgqr, dtrtrs

from strainsight.multibody.equations import Balance, balance
from strainsight.multibody.system import System

APART = 1e-6
"""Smallest of the diagonal of R beside the largest, in pivoted QR factors of the constraints, from which these are good."""


@dataclass(frozen=True)
class Tangent:
    """The motions q + T y that the constraints leave, T (n, r), orthonormal in the metric, and all derivatives there, the
    forces of the constraints balanced (at); scale: ‖K‖ before its terms cancel, in the metric."""

    T: np.ndarray
    at: Balance
    scale: float

    def project(self, X: np.ndarray) -> np.ndarray:
        """TᵀXT (r, r)."""
        return self.T.T @ X @ self.T


def tangent_space(system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray) -> Tangent:
    """Of the system held where it is: q on the constraints; v only sets the forces that depend on it.

    The stiffness is K_T − Σ λ ∇²φ, K_T the tangent of all forces, λ the constraint forces that balance them best.
    """
    n, m = system.size, system.constrained
    zero = np.zeros(n)
    at = balance(system, q, v, zero, np.zeros(m), np.zeros(m), u, theta)
    d = system.metric
    scale = float(np.linalg.norm(at.stiffness / np.outer(d, d)))
    N = np.eye(n)
    if m:
        N, lam = _held(at.B / d, at.load / d)
        held = balance(system, q, v, zero, np.zeros(m), lam, u, theta)
        scale += float(np.linalg.norm((held.stiffness - at.stiffness) / np.outer(d, d)))
        at = held
    return Tangent(N / d[:, None], at, scale)


def _held(B: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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

"""The steady error covariance (5.14): solved, polished, and measured by its residual."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import schur
from scipy.linalg.lapack import dgees, dtrsyl

from strainsight.errors import NumericalError
from strainsight.loads.observability import balanced_units
from strainsight.placement.information import Information, as_information

ACCEPTED = 1e-10
"""Largest relative residual that is taken as solved."""
NOISE_FREE = 1e-8
"""States whose standard deviation is below this share of the largest are taken as not reached by the process noise."""
CLOSE = 1e-3
"""Below this residual a Newton step is solved for the correction of P, whose rounding is smaller than that of P."""


@dataclass(frozen=True)
class Loop:
    """A filter's closed loop A = F − P G with its real Schur form A = U T Uᵀ; abscissa is max Re λ(A) [1/s].

    factor R (k, n), G = RᵀR, where rounding of the sum G would be felt, else None.
    """

    P: np.ndarray
    information: Information
    A: np.ndarray
    T: np.ndarray
    U: np.ndarray
    abscissa: float
    factor: np.ndarray | None

    @property
    def G(self) -> np.ndarray:
        return self.information.G

    @property
    def stable(self) -> bool:
        return self.abscissa < 0


def close_loop(F: np.ndarray, G: Information | np.ndarray, P: np.ndarray) -> Loop:
    """A = F − P G and its Schur form; F (n, n) [1/s], G = HᵀR⁻¹H (n, n), P (n, n)."""
    known = as_information(G)
    R = known.needed(P)
    A = F - (P @ known.G if R is None else (P @ R.T) @ R)
    T, _, real, _, U, _, info = dgees(_unsorted, A, lwork=16 * len(A))
    if info != 0:
        raise NumericalError(f"the Schur form of a closed loop did not converge (LAPACK dgees {info})")
    return Loop(P, known, A, T, U, float(real.max()), R)


def lyapunov(loop: Loop, S: np.ndarray) -> np.ndarray:
    """X of A X + X Aᵀ + S = 0, S symmetric (n, n): A = U T Uᵀ, so T Y + Y Tᵀ = −UᵀSU and X = U Y Uᵀ."""
    return _solve(loop, S, "N", "T")


def lyapunov_in_schur(loop: Loop, S: np.ndarray) -> np.ndarray:
    """Y of T Y + Y Tᵀ + S = 0, S symmetric (n, n): X = U Y Uᵀ solves A X + X Aᵀ + U S Uᵀ = 0."""
    return _triangular(loop, S, "N", "T")


def adjoint_lyapunov(loop: Loop, W: np.ndarray) -> np.ndarray:
    """X of Aᵀ X + X A + W = 0, W symmetric (n, n): tr(W Y) = tr(X S) wherever A Y + Y Aᵀ + S = 0."""
    return _solve(loop, W, "T", "N")


def relative_residual(F: np.ndarray, Q: np.ndarray, G: Information | np.ndarray, P: np.ndarray) -> float:
    """‖F P + P Fᵀ + Q − P G P‖ / (2‖F P‖ + ‖Q‖ + ‖P G P‖), Frobenius, in the coordinates of `balance`."""
    return _residual(F, Q, as_information(G), P)[0]


def solve_care(F: np.ndarray, Q: np.ndarray, G: Information | np.ndarray) -> np.ndarray:
    """Steady covariance: the stabilising solution of (5.14)

        F P + P Fᵀ + Q − P G P = 0,     [Fᵀ, −G/s; −sQ, −F] [U₁; U₂] = [U₁; U₂] Λ₋,     P = U₂U₁⁻¹/s,   s = √(‖G‖/‖Q‖)

    by the ordered Schur form of the scaled Hamiltonian, then Newton-Kleinman. F (n, n) [1/s]; Q (n, n) intensity;
    G = HᵀR⁻¹H (n, n), (F, H) detectable. Returns P (n, n). Raises NumericalError where no n eigenvalues are stable.
    Source: Laub (1979); Kleinman (1968).
    """
    n, known = len(F), as_information(G)
    if not known.G.any():
        return _newton(F, Q, known, np.zeros((n, n)))
    if not Q.any():
        raise NumericalError("the process noise is zero", remedy="give every unknown a process noise")
    s = np.sqrt(np.linalg.norm(known.G) / np.linalg.norm(Q))
    try:
        _, Z, stable = schur(np.block([[F.T, -known.G / s], [-s * Q, -F]]), sort="lhp")
        P = np.linalg.solve(Z[:n, :n].T, Z[n:, :n].T).T / s
    except np.linalg.LinAlgError as error:
        raise NumericalError(f"the Hamiltonian of the Riccati equation was not solved: {error}") from error
    if stable != n:
        raise NumericalError(
            f"the Hamiltonian of the Riccati equation has {stable} stable eigenvalues instead of {n}",
            remedy="an unknown is next to unobservable, or the noises lie too far apart: check both",
        )
    return polish(F, Q, known, 0.5 * (P + P.T))


def polish(F: np.ndarray, Q: np.ndarray, G: Information | np.ndarray, P: np.ndarray, steps: int = 6) -> np.ndarray:
    """Newton-Kleinman steps from P until the relative residual is 1e-14 or stops falling. Returns P (n, n)."""
    known = as_information(G)
    error, defect = _residual(F, Q, known, P)
    best = P
    for _ in range(steps):
        if error < 1e-14:
            break
        P = _newton(F, Q, known, P, defect if error < CLOSE else None)
        new, defect = _residual(F, Q, known, P)
        if new < error:
            best = P
        if new > 0.5 * error and new < 1e-10:
            break
        error = min(new, error)
    return best


def balance(F: np.ndarray, Q: np.ndarray, G: Information | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Scale d (n,) and P̃ (n, n) with diag P̃ = 1, where P = diag(d) P̃ diag(d) solves (5.14).

        F̃ = D⁻¹ F D,    Q̃ = D⁻¹ Q D⁻¹,    G̃ = D G D

    Starts from the balanced units of F and repeats with d ← d √diag P̃. States that the process noise does not reach keep a
    scale of 1e-8 of the largest, measured against those units. Raises NumericalError as `solve_care`.
    """
    known = as_information(G)
    d = first = balanced_units(F)
    for _ in range(8):
        P = solve_care(F / d[:, None] * d, Q / d[:, None] / d, known.scaled(d))
        std = d * np.sqrt(np.maximum(np.diag(P), 0.0)) / first
        new = np.maximum(std, NOISE_FREE * std.max()) * first
        # a state on the floor drifts by rounding; the others have converged once their variance is 1
        if np.all(np.abs(np.log(new / d)) < 1e-6):
            return d, P
        P = P * np.outer(d / new, d / new)
        d = new
    return d, P


def solve_anew(F: np.ndarray, Q: np.ndarray, G: Information | np.ndarray) -> np.ndarray:
    """P of (5.14) from nothing: in these coordinates, or in balanced ones where these leave a residual above 1e-10.

    Raises NumericalError where neither reaches it.
    """
    known, error = as_information(G), np.inf
    try:
        P = solve_care(F, Q, known)
        error = relative_residual(F, Q, known, P)
    except NumericalError:
        pass
    if not error <= ACCEPTED:
        d, P = balance(F, Q, known)
        error = relative_residual(F / d[:, None] * d, Q / d[:, None] / d, known.scaled(d), P)
        P = P * d[:, None] * d
    if not error <= ACCEPTED:
        raise NumericalError(
            f"the Riccati equation of a set of gauges is solved to {error:.1e} only, {ACCEPTED:.0e} is asked for",
            remedy="an unknown is next to unobservable from it, or the noises lie too far apart: check both",
        )
    return P


def _residual(F: np.ndarray, Q: np.ndarray, known: Information, P: np.ndarray) -> tuple[float, np.ndarray]:
    """The relative residual and F P + P Fᵀ + Q − P G P (n, n)."""
    FP, PGP = F @ P, known.squared(P)
    defect = FP + FP.T + Q - PGP
    size = 2 * np.linalg.norm(FP) + np.linalg.norm(Q) + np.linalg.norm(PGP)
    return float(np.linalg.norm(defect) / size) if size > 0 else 0.0, defect


def _newton(
    F: np.ndarray, Q: np.ndarray, known: Information, P: np.ndarray, defect: np.ndarray | None = None
) -> np.ndarray:
    """One Newton-Kleinman step with A = F − P G: A P⁺ + P⁺ Aᵀ + Q + P G P = 0, or A (P⁺ − P) + (P⁺ − P) Aᵀ + defect = 0."""
    loop = close_loop(F, known, P)
    if not loop.stable:
        raise NumericalError(
            f"the steady filter is not stable: an error grows at {loop.abscissa:.3g} 1/s",
            remedy="an unknown is next to unobservable from these gauges",
        )
    return lyapunov(loop, Q + known.squared(P)) if defect is None else P + lyapunov(loop, defect)


def _solve(loop: Loop, S: np.ndarray, first: str, second: str) -> np.ndarray:
    X = loop.U @ _triangular(loop, loop.U.T @ S @ loop.U, first, second) @ loop.U.T
    return 0.5 * (X + X.T)


def _triangular(loop: Loop, S: np.ndarray, first: str, second: str) -> np.ndarray:
    Y, scale, info = dtrsyl(loop.T, loop.T, -S, trana=first, tranb=second)
    if info < 0:
        raise NumericalError(f"a Lyapunov equation was not solved (LAPACK dtrsyl {info})")
    return (0.5 / scale) * (Y + Y.T)


def _unsorted(_real: float, _imag: float | None = None) -> None:
    """`dgees` asks for a sorting function even where it does not sort."""

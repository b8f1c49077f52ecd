"""Steady error covariance (5.14), in continuous and discrete time: solution, refinement, and residual."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import schur, solve_discrete_lyapunov
from scipy.linalg.lapack import dgees, dtrsyl

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.loads.observability import balanced_units, undetectable_directions

CANCELLED = 10.0
"""Limit of Σ PᵢᵢGᵢᵢ / tr(P G), above which the sum G has lost digits needed for P G P. The ratio is 1 to 3 with strain
gauges, and 6e3 if an accelerometer measures a load and a modulus that are far better known than distinguished."""


@dataclass(frozen=True)
class Information:
    """G = HᵀR⁻¹H = RᵀR (n, n) of a set of gauges: their sum, and a factor R (k, n) where that is asked for. What a gauge of
    extreme precision reads is known so well that ‖P h‖ is a small share ε of ‖P‖‖h‖. A relative rounding u of the entries of
    G, which no way of summing avoids, then changes P G P by u/ε² of itself, that of R by u/ε. rows: gives H at unit noise (m,
    n), called where that matters; None where only the sum is known."""

    G: np.ndarray
    rows: Callable[[], np.ndarray] | None = None

    @cached_property
    def factor(self) -> np.ndarray | None:
        """R (k, n), k ≤ n; None if only the sum is known. Triangular with more rows than states."""
        if self.rows is None:
            return None
        rows = self.rows()
        return np.asarray(np.linalg.qr(rows, mode="r")) if len(rows) > len(self.G) else rows

    def needed(self, P: np.ndarray) -> np.ndarray | None:
        """The factor if P (n, n) requires it, None if the sum is accurate enough."""
        if self.rows is None or P.diagonal() @ self.G.diagonal() <= CANCELLED * np.vdot(P, self.G):
            return None
        return self.factor

    def squared(self, P: np.ndarray) -> np.ndarray:
        """P G P (n, n), of symmetric P."""
        if (R := self.needed(P)) is None:
            return np.asarray(P @ self.G @ P)
        B = P @ R.T
        return B @ B.T

    def scaled(self, d: np.ndarray) -> Information:
        """The same for x*/d; d (n,)."""
        rows = None if self.rows is None else lambda: np.asarray(self.factor) * d
        return Information(self.G * d[:, None] * d, rows)

    def with_rows(self, block: np.ndarray) -> Information:
        """The information with an additional gauge; block (c, n) at unit noise."""
        rows = self.rows
        return Information(self.G + block.T @ block, None if rows is None else lambda: np.vstack([rows(), block]))


def information(rows: np.ndarray) -> Information:
    """`Information` of rows at unit noise (m, n)."""
    return Information(rows.T @ rows, lambda: rows)


ACCEPTED = 1e-10
"""Largest permitted relative residual."""
NOISE_FREE = 1e-8
"""Relative standard deviation below which a state counts as unexcited by process noise."""
CLOSE = 1e-3
"""Residual below which a Newton step solves for the correction of P, whose rounding is smaller."""


@dataclass(frozen=True)
class Loop:
    """Closed loop A = F − P G of a filter; factor R (k, n), G = RᵀR, if the sum G is not accurate enough, else None."""

    P: np.ndarray
    information: Information
    A: np.ndarray
    factor: np.ndarray | None

    @property
    def G(self) -> np.ndarray:
        return self.information.G

    @cached_property
    def schur(self) -> tuple[np.ndarray, np.ndarray, float]:
        """T, U of the real Schur form A = U T Uᵀ, and the abscissa max Re λ(A) [1/s]."""
        T, _, real, _, U, _, info = dgees(_unsorted, self.A, lwork=16 * len(self.A))
        if info != 0:
            raise NumericalError(
                f"the Schur form of the filter matrix F − P HᵀR⁻¹H did not converge (LAPACK dgees {info})"
            )
        return T, U, float(real.max())

    @property
    def abscissa(self) -> float:
        return self.schur[2]

    @property
    def stable(self) -> bool:
        return self.abscissa < 0


def close_loop(F: np.ndarray, G: Information, P: np.ndarray) -> Loop:
    """A = F − P G; F (n, n) [1/s], G of the gauges, P (n, n)."""
    R = G.needed(P)
    return Loop(P, G, F - (P @ G.G if R is None else (P @ R.T) @ R), R)


def lyapunov(loop: Loop, S: np.ndarray, adjoint: bool = False) -> np.ndarray:
    """Solve a Lyapunov equation by the Schur form of A, S symmetric (n, n):

        A X + X Aᵀ + S = 0,     T Y + Y Tᵀ = −UᵀSU,   X = U Y Uᵀ;     adjoint:  Aᵀ X + X A + S = 0

    The adjoint gives tr(S Y) = tr(X Z) wherever A Y + Y Aᵀ + Z = 0."""
    T, U, _ = loop.schur
    first, second = "TN" if adjoint else "NT"
    Y, scale, info = dtrsyl(T, T, -(U.T @ S @ U), trana=first, tranb=second)
    if info < 0:
        raise NumericalError(f"a Lyapunov equation was not solved (LAPACK dtrsyl {info})")
    X = U @ Y @ U.T
    return np.asarray((0.5 / scale) * (X + X.T))


def relative_residual(F: np.ndarray, Q: np.ndarray, G: Information, P: np.ndarray) -> float:
    """‖F P + P Fᵀ + Q − P G P‖ / (2‖F P‖ + ‖Q‖ + ‖P G P‖), Frobenius, in the coordinates of `balance`."""
    return _residual(F, Q, G, P)[0]


def solve_care(F: np.ndarray, Q: np.ndarray, G: Information) -> np.ndarray:
    """Steady covariance: the stabilising solution of (5.14)

        F P + P Fᵀ + Q − P G P = 0,     [Fᵀ, −G/s; −sQ, −F] [U₁; U₂] = [U₁; U₂] Λ₋,     P = U₂U₁⁻¹/s,   s = √(‖G‖/‖Q‖)

    by the ordered Schur form of the scaled Hamiltonian, then Newton-Kleinman. F (n, n) [1/s]; Q (n, n) intensity;
    (F, H) detectable. Returns P (n, n). Raises NumericalError where no n eigenvalues are stable.
    Source: Laub (1979); Kleinman (1968)."""
    n = len(F)
    if not G.G.any():
        return _newton(F, Q, G, np.zeros((n, n)))
    if not Q.any():
        raise NumericalError(
            "the process noise is zero", remedy="set a process noise (process_noise, increment) for each unknown"
        )
    s = np.sqrt(np.linalg.norm(G.G) / np.linalg.norm(Q))
    try:
        _, Z, stable = schur(np.block([[F.T, -G.G / s], [-s * Q, -F]]), sort="lhp")
        P = np.linalg.solve(Z[:n, :n].T, Z[n:, :n].T).T / s
    except np.linalg.LinAlgError as error:
        raise NumericalError(
            f"the Hamiltonian eigenvalue problem of the Riccati equation was not solved: {error}"
        ) from error
    if stable != n:
        raise NumericalError(
            f"the Hamiltonian matrix of the Riccati equation has {stable} stable eigenvalues instead of {n}",
            remedy="check whether an unknown is nearly unobservable, and whether noise levels differ by many orders of magnitude",
        )
    return polish(F, Q, G, 0.5 * (P + P.T))


def polish(F: np.ndarray, Q: np.ndarray, G: Information, P: np.ndarray, steps: int = 6) -> np.ndarray:
    """Newton-Kleinman steps from P until the relative residual is 1e-14 or no longer decreases. Returns P (n, n)."""
    error, defect = _residual(F, Q, G, P)
    best = P
    for _ in range(steps):
        if error < 1e-14:
            break
        P = _newton(F, Q, G, P, defect if error < CLOSE else None)
        new, defect = _residual(F, Q, G, P)
        if new < error:
            best = P
        if new > 0.5 * error and new < 1e-10:
            break
        error = min(new, error)
    return best


def balance(F: np.ndarray, Q: np.ndarray, G: Information) -> tuple[np.ndarray, np.ndarray]:
    """Scale d (n,) and P̃ (n, n) with diag P̃ = 1, where P = diag(d) P̃ diag(d) solves (5.14).

        F̃ = D⁻¹ F D,    Q̃ = D⁻¹ Q D⁻¹,    G̃ = D G D

    Starts from the balanced units of F and repeats with d ← d √diag P̃. States that the process noise does not reach keep a
    scale of 1e-8 of the largest, measured against those units. Raises NumericalError as `solve_care`."""
    d = first = balanced_units(F)
    for _ in range(8):
        P = solve_care(F / d[:, None] * d, Q / d[:, None] / d, G.scaled(d))
        std = d * np.sqrt(np.maximum(np.diag(P), 0.0)) / first
        new = np.maximum(std, NOISE_FREE * std.max()) * first
        # a state on the floor drifts by rounding; the others have converged once their variance is 1
        if np.all(np.abs(np.log(new / d)) < 1e-6):
            return d, P
        P = P * np.outer(d / new, d / new)
        d = new
    return d, P


def solve_anew(F: np.ndarray, Q: np.ndarray, G: Information) -> np.ndarray:
    """P of (5.14) without a start: in these coordinates, or in balanced ones if the residual exceeds 1e-10. Raises
    NumericalError if both fail."""
    error = np.inf
    with suppress(NumericalError):
        P = solve_care(F, Q, G)
        error = relative_residual(F, Q, G, P)
    if not error <= ACCEPTED:
        d, P = balance(F, Q, G)
        error = relative_residual(F / d[:, None] * d, Q / d[:, None] / d, G.scaled(d), P)
        P = P * d[:, None] * d
    if not error <= ACCEPTED:
        raise NumericalError(
            f"the Riccati equation of a set of gauges is solved with a relative residual of {error:.1e}; the "
            f"tolerance is {ACCEPTED:.0e}",
            remedy="check whether an unknown is nearly unobservable, and whether noise levels differ by many orders of magnitude",
        )
    return P


def _residual(F: np.ndarray, Q: np.ndarray, G: Information, P: np.ndarray) -> tuple[float, np.ndarray]:
    """The relative residual and F P + P Fᵀ + Q − P G P (n, n)."""
    FP, PGP = F @ P, G.squared(P)
    defect = FP + FP.T + Q - PGP
    size = 2 * np.linalg.norm(FP) + np.linalg.norm(Q) + np.linalg.norm(PGP)
    return float(np.linalg.norm(defect) / size) if size > 0 else 0.0, defect


def _newton(
    F: np.ndarray, Q: np.ndarray, G: Information, P: np.ndarray, defect: np.ndarray | None = None
) -> np.ndarray:
    """One Newton-Kleinman step with A = F − P G: A P⁺ + P⁺ Aᵀ + Q + P G P = 0, or A (P⁺ − P) + (P⁺ − P) Aᵀ + defect = 0."""
    loop = close_loop(F, G, P)
    if not loop.stable:
        raise NumericalError(
            f"the steady-state filter is unstable: errors grow at a rate of {loop.abscissa:.3g} 1/s",
            remedy="add gauges, or estimate fewer unknowns: an unknown is nearly unobservable",
        )
    return lyapunov(loop, Q + G.squared(P)) if defect is None else P + lyapunov(loop, defect)


def _unsorted(_real: float, _imag: float | None = None) -> None:
    """Sorting function that `dgees` requires even without sorting."""


ACCEPTED_IN_STEPS = 1e-9
"""Largest permitted error of a covariance, relative to σᵢσⱼ."""
NOT_REACHED = 1e-8
"""Relative σ below which a state counts as unexcited by noise."""
SETTLED = 1e-13
"""Relative change of each variance in a doubling below which they are steady."""
MOST_DOUBLINGS = 60


def steady_factor(A: np.ndarray, H: np.ndarray, N: np.ndarray) -> np.ndarray | None:
    """L (n, k), P = LLᵀ after an update, of the steady filter on x' = A x + N w, y = H x + v, with w and v of unit covariance;
    None where the rows do not detect what fails to decay by itself.

    A (n, n), N (n, any), H (m, n), states in units of like size. From P⁻ = NNᵀ, F = Aᵀ, G = HᵀH every doubling takes as many
    steps as were done before:

        W = 1 + G P⁻,   P⁻ ← P⁻ + Fᵀ P⁻ W⁻¹ F,   G ← G + F W⁻¹ G Fᵀ,   F ← F W⁻¹ F

    on factors P⁻ = LLᵀ, G = CᵀC with CL = U Σ Vᵀ, so that nothing is inverted that could be singular and no variance loses
    its sign: P⁻W⁻¹ = L V(1 + Σ²)⁻¹VᵀLᵀ, W⁻¹G = CᵀU(1 + Σ²)⁻¹UᵀC, W⁻¹ = 1 − CᵀU Σ(1 + Σ²)⁻¹VᵀLᵀ.
    Raises InfeasibleError where a motion that does not decay is reached by no noise, NumericalError where P is further than
    1e-9 from the solution. Source: Anderson, Int. J. Control 28 (1978); Chu, Fan, Lin and Wang, Int. J. Control 77 (2004)."""
    one = np.eye(len(A))
    # (A − 1)(A + 1)⁻¹ has the eigenvectors of A, and Re λ ≥ 0 where A has |λ| ≥ 1
    unstepped = np.linalg.solve((A + one).T, (A - one).T).T
    if undetectable_directions(unstepped, H).shape[1]:
        return None
    if undetectable_directions(unstepped.T, N.T).shape[1]:
        raise InfeasibleError(
            "an undamped motion has no process noise, so no steady-state filter exists",
            remedy="add damping, or process noise for every motion",
        )
    F, C, L = A.T, _triangle(H), _triangle(N.T).T
    for _ in range(MOST_DOUBLINGS):
        variance = np.sum(L**2, axis=1)
        F, C, L = _double(F, C, L)
        grown = np.sum(L**2, axis=1) - variance
        # P⁻ grows; relative to each variance, as a state with a single noise source may dwarf the others
        if np.all(grown <= SETTLED * np.maximum(variance, NOT_REACHED**2 * variance.max())):
            break
    before = updated(L, H)
    # what doubling has rounded, a step of the filter itself forgets as fast as it forgets all else
    P = updated(_triangle(np.hstack([A @ before, N]).T).T, H)
    if not (error := _error(A, H, before, P)) <= ACCEPTED_IN_STEPS:
        solved = (
            f"solved with a relative error of {error:.1e}; the tolerance is {ACCEPTED_IN_STEPS:.0e}"
            if np.isfinite(error)
            else "not finite: the filter is unstable"
        )
        raise NumericalError(
            f"the steady-state covariance of a set of gauges is {solved}",
            remedy="check the units of the noise of gauges and inputs: their magnitudes differ too much for double precision",
        )
    return P


def factor_after(A: np.ndarray, H: np.ndarray, N: np.ndarray, start: np.ndarray, steps: int) -> np.ndarray:
    """L (n, k), P = LLᵀ after the update of the last of so many steps of the filter of `steady_factor`, from a start whose
    covariance has the factor start (n, any) and no reading. With the W, G, F and P⁻ of 2ʲ steps, which the doublings there give,

        P ← P⁻ + Fᵀ P (1 + G P)⁻¹ F

    leads any covariance P before a reading as many steps on; the steps are put together of powers of two."""
    P = _triangle(np.hstack([A @ start, N]).T).T
    F, C, L = A.T, _triangle(H), _triangle(N.T).T
    left = steps - 1
    while left > 0:
        if left % 2:
            P = _triangle(np.hstack([L, F.T @ updated(P, C)]).T).T
        left //= 2
        if left:
            F, C, L = _double(F, C, L)
    return updated(P, H)


def updated(L: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Factor L V(1 + Σ²)^(−½) of P − PHᵀ(1 + HPHᵀ)⁻¹HP, P = LLᵀ, HL = U Σ Vᵀ: readings H (m, n) of unit noise."""
    _, s, Vt = np.linalg.svd(H @ L)
    return np.asarray((L @ Vt.T) * _shrink_factors(s, len(Vt)))


def _double(F: np.ndarray, C: np.ndarray, L: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same for twice as many steps."""
    U, s, Vt = np.linalg.svd(C @ L)
    m = len(s)
    rise, observed = (
        (F.T @ L @ Vt.T) * _shrink_factors(s, len(Vt)),
        _shrink_factors(s, len(U))[:, None] * (U.T @ C @ F.T),
    )
    F = F @ F - (F @ C.T @ U[:, :m]) * (s / (1 + s**2)) @ (Vt[:m] @ L.T @ F)
    return F, _triangle(np.vstack([C, observed])), _triangle(np.hstack([L, rise]).T).T


def _error(A: np.ndarray, H: np.ndarray, before: np.ndarray, after: np.ndarray) -> float:
    """How far a covariance P, after = its factor, is from the solution, the largest |Xᵢⱼ|/σᵢσⱼ; infinite where its filter is
    not stable.
    X = Φ(X + P − P₋)Φᵀ, P₋ that of a step before, by Newton's step; Φ = (1 − KH)A. Source: Hewer, IEEE Trans. AC 16 (1971)."""
    std = np.linalg.norm(after, axis=1)
    std = np.maximum(std, NOT_REACHED * std.max())
    loop = (A - after @ (H @ after).T @ H @ A) / std[:, None] * std
    if not np.abs(np.linalg.eigvals(loop)).max() < 1:
        return float("inf")
    after, before = after / std[:, None], before / std[:, None]
    missed = loop @ (after @ after.T - before @ before.T) @ loop.T
    return float(np.abs(solve_discrete_lyapunov(loop, missed)).max())


def _shrink_factors(s: np.ndarray, size: int) -> np.ndarray:
    """(1 + Σ²)^(−½) (size,), one beyond the singular values."""
    return np.concatenate([1 / np.sqrt(1 + s**2), np.ones(size - len(s))])


def _triangle(X: np.ndarray) -> np.ndarray:
    """R (any, n) of no more than n rows with RᵀR = XᵀX, X (any, n)."""
    return X if len(X) <= X.shape[1] else np.asarray(np.linalg.qr(X, mode="r"))

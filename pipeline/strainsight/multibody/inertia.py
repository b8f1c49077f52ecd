"""Inertia of a moving flexible body in its floating frame: mass matrix, velocity terms, and their derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from strainsight.compiled import inner, kept
from strainsight.rom.inertia import InertiaInvariants


class Inertia(NamedTuple):
    """The invariants of one body that are not made of the others, contiguous, with at: its first coordinate."""

    at: int
    mass: float
    first: np.ndarray
    first_modal: np.ndarray
    second: np.ndarray
    coupling: np.ndarray
    coupling_modal: np.ndarray
    modal: np.ndarray


def as_inertia(at: int, x: InertiaInvariants) -> Inertia:
    """Arrays of the body whose coordinates begin at `at`, contiguous as compiled code wants them."""
    fields = (x.first, x.first_modal, x.second, x.coupling, x.coupling_modal, x.modal)
    return Inertia(at, float(x.mass), *(np.ascontiguousarray(field, dtype=float) for field in fields))


@kept()
def inertia_load(
    body: Inertia, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """M (s, s), g = M(q)a + c(q, v) (s,), ∂g/∂q, ∂c/∂v (s, s) of one body, s = 12 + n: `add_inertia`."""
    s = 12 + body.modal.shape[0]
    M, g, Gq, Gv = np.zeros((s, s)), np.zeros(s), np.zeros((s, s)), np.zeros((s, s))
    # no literal, for which numba would compile `add_inertia` a second time
    tangents = s > 0
    add_inertia(body, q, v, a, tangents, M, g, Gq, Gv)
    return M, g, Gq, Gv


@inner
def add_inertia(
    body: Inertia,
    q: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    tangents: bool,
    M: np.ndarray,
    g: np.ndarray,
    Gq: np.ndarray,
    Gv: np.ndarray,
) -> None:
    """g = M(q)a + c(q, v) (s,), with tangents M, ∂g/∂q, ∂c/∂v (s, s), too, into what is given as zeros, s = 12 + n.

        p̈ = a_r + Σ_j y_j a_j + RΦα + 2ṘΦη̇,  y = x + Φη,     g = ∫ρ Jᵀp̈,  J = ∂p/∂q = [1, y₁1, y₂1, y₃1, RΦ]
        ŝ = ∫ρ y,  Ĵ = ∫ρ y yᵀ,  C_j = ∫ρ y_j Φ,  E_ij = ∫ρ φ_iᵀφ_j  (n, n), φ_i row i of Φ,  RᵀR = 1

    a = [a_r, a_1, a_2, a_3, α] the accelerations. All that is quadratic in the modes is Σ_m x_m E_ij[m, :] of x = η, α and η̇,
    and Σ_ij s_ij E_ij of s = RᵀṘ and RᵀA, by one passage through E. Source: differentiation of p = r + R(x + Φη) and d'Alembert.
    """
    n = body.modal.shape[0]
    at = body.at
    R, W, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    spin, bent = np.zeros((3, 3)), np.zeros((3, 3))
    for j in range(3):
        for i in range(3):
            R[i, j], W[i, j], A[i, j] = q[at + 3 + 3 * j + i], v[at + 3 + 3 * j + i], a[at + 3 + 3 * j + i]
    for i in range(3):
        for j in range(3):
            for c in range(3):
                spin[i, j] += R[c, i] * W[c, j]
                bent[i, j] += R[c, i] * A[c, j]
    eta, rate, alpha = q[at + 12 : at + 12 + n], v[at + 12 : at + 12 + n], a[at + 12 : at + 12 + n]
    S, E = body.first_modal, body.coupling_modal
    C, by_rate, by_alpha = body.coupling.copy(), np.zeros((3, 3, n)), np.zeros((3, 3, n))
    turned, swung = np.zeros((n, n)), np.zeros((n, n))
    for k in range(n):
        for i in range(3):
            for j in range(3):
                for m in range(n):
                    C[i, j, m] += eta[k] * E[k, i, j, m]
                    by_rate[i, j, m] += rate[k] * E[k, i, j, m]
                if tangents:
                    for m in range(n):
                        by_alpha[i, j, m] += alpha[k] * E[k, i, j, m]
                        turned[k, m] += spin[i, j] * E[k, i, j, m]
                        swung[k, m] += bent[i, j] * E[k, i, j, m]
    s, J = body.first.copy(), body.second.copy()
    # ∫ρ Φα and 2 ∫ρ Φη̇, then with y_i before them
    push, drift = np.zeros((4, 3)), np.zeros((4, 3))
    for j in range(3):
        for m in range(n):
            s[j] += S[j, m] * eta[m]
            push[0, j] += S[j, m] * alpha[m]
            drift[0, j] += 2 * S[j, m] * rate[m]
        for i in range(3):
            for m in range(n):
                # Ĵ = ∫ρ (x + Φη)(x + Φη)ᵀ by C, which has one of the two deformed already
                J[i, j] += 0.5 * eta[m] * (C[i, j, m] + C[j, i, m] + body.coupling[i, j, m] + body.coupling[j, i, m])
                push[1 + i, j] += C[i, j, m] * alpha[m]
                drift[1 + i, j] += 2 * C[i, j, m] * rate[m]
    for c in range(3):
        g[c] = body.mass * a[at + c]
        for j in range(3):
            g[c] += A[c, j] * s[j] + R[c, j] * push[0, j] + W[c, j] * drift[0, j]
        for i in range(3):
            own = s[i] * a[at + c]
            for j in range(3):
                own += J[i, j] * A[c, j] + R[c, j] * push[1 + i, j] + W[c, j] * drift[1 + i, j]
            g[3 + 3 * i + c] = own
    for j in range(3):
        forward = R[0, j] * a[at] + R[1, j] * a[at + 1] + R[2, j] * a[at + 2]
        for m in range(n):
            g[12 + m] += S[j, m] * forward
        for i in range(3):
            for m in range(n):
                g[12 + m] += C[i, j, m] * bent[j, i] + 2 * spin[j, i] * by_rate[i, j, m]
    for m in range(n):
        for k in range(n):
            g[12 + m] += body.modal[m, k] * alpha[k]
    if not tangents:
        return
    for c in range(3):
        M[c, c] = body.mass
        for j in range(3):
            col = 3 + 3 * j + c
            M[c, col] = M[col, c] = s[j]
            Gq[c, col], Gv[c, col] = push[0, j], drift[0, j]
            for i in range(3):
                M[3 + 3 * i + c, col] = J[i, j]
                Gq[3 + 3 * i + c, col], Gv[3 + 3 * i + c, col] = push[1 + i, j], drift[1 + i, j]
        for j in range(3):
            col = 3 + 3 * j + c
            for m in range(n):
                M[c, 12 + m] += R[c, j] * S[j, m]
                Gq[c, 12 + m] += A[c, j] * S[j, m]
                Gv[c, 12 + m] += 2 * W[c, j] * S[j, m]
                Gq[12 + m, col] += S[j, m] * a[at + c]
            for i in range(3):
                row = 3 + 3 * i + c
                for m in range(n):
                    M[row, 12 + m] += R[c, j] * C[i, j, m]
                    Gv[row, 12 + m] += 2 * W[c, j] * C[i, j, m]
                    # ∂Ĵ_ij/∂η = C_i[j] + C_j[i];  ∂C_i/∂η = E_i
                    Gq[row, 12 + m] += (C[i, j, m] + C[j, i, m]) * A[c, j] + R[c, j] * by_alpha[j, i, m]
                    Gq[row, 12 + m] += 2 * W[c, j] * by_rate[j, i, m]
                    Gq[12 + m, col] += C[i, j, m] * A[c, i]
                    # R_j on the rate of φ_j, and Ṙ_i on that of φ_i: both halves of s_ji = R_j·Ṙ_i
                    Gq[12 + m, col] += 2 * W[c, i] * by_rate[i, j, m]
                    Gv[12 + m, row] += 2 * R[c, j] * by_rate[i, j, m]
            for m in range(n):
                Gq[3 + 3 * j + c, 12 + m] += S[j, m] * a[at + c]
    for m in range(n):
        for row in range(12):
            M[12 + m, row] = M[row, 12 + m]
        for k in range(n):
            M[12 + m, 12 + k] = body.modal[m, k]
            Gq[12 + m, 12 + k] = swung[m, k]
            Gv[12 + m, 12 + k] = 2 * turned[m, k]

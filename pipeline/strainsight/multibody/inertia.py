"""Inertia of a moving flexible body in its floating frame: mass matrix, velocity terms, and their derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from strainsight.rom.inertia import InertiaInvariants


class Inertia(NamedTuple):
    """The invariants of one body as contiguous arrays, with at: its first coordinate."""

    at: int
    mass: float
    first: np.ndarray
    first_modal: np.ndarray
    second: np.ndarray
    second_modal: np.ndarray
    second_modal2: np.ndarray
    coupling: np.ndarray
    coupling_modal: np.ndarray
    modal: np.ndarray


def as_inertia(at: int, x: InertiaInvariants) -> Inertia:
    """Arrays of the body whose coordinates begin at `at`, contiguous as compiled code wants them."""
    fields = (x.first, x.first_modal, x.second, x.second_modal, x.second_modal2, x.coupling, x.coupling_modal, x.modal)
    return Inertia(at, float(x.mass), *(np.ascontiguousarray(field, dtype=float) for field in fields))


@njit(cache=True)
def inertia_load(
    body: Inertia, q: np.ndarray, v: np.ndarray, a: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """M (s, s), g = M(q)a + c(q, v) (s,), ∂g/∂q, ∂c/∂v (s, s) of one body, s = 12 + n.

        p̈ = a_r + Σ_j y_j a_j + RΦα + 2ṘΦη̇,  y = x + Φη,     g = ∫ρ Jᵀp̈,  J = ∂p/∂q = [1, y₁1, y₂1, y₃1, RΦ]
        ŝ = ∫ρ y,  Ĵ = ∫ρ y yᵀ,  C_j = ∫ρ y_j Φ,  E_ab = ∫ρ φ_a φ_bᵀ  (n, n), φ_a row a of Φ,  RᵀR = 1

    a = [a_r, a_1, a_2, a_3, α] the accelerations. Source: differentiation of p = r + R(x + Φη) and d'Alembert.
    """
    n = body.modal.shape[0]
    at, s = body.at, 12 + n
    eta, rate, alpha = q[at + 12 : at + s], v[at + 12 : at + s], a[at + 12 : at + s]
    M, Gq, Gv = np.zeros((s, s)), np.zeros((s, s)), np.zeros((s, s))
    g = np.zeros(s)
    R, W, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for j in range(3):
        for i in range(3):
            R[i, j], W[i, j], A[i, j] = q[at + 3 + 3 * j + i], v[at + 3 + 3 * j + i], a[at + 3 + 3 * j + i]
    a_r = a[at : at + 3]
    S1, E = body.first_modal, body.coupling_modal

    s0 = body.first + S1 @ eta
    J2 = body.second.copy()
    J2_slope = body.second_modal.copy()
    C = body.coupling.copy()
    for k in range(n):
        for j in range(3):
            for c in range(3):
                for m in range(n):
                    C[j, c, m] += eta[k] * E[k, j, c, m]
        for m in range(n):
            for i in range(3):
                for j in range(3):
                    J2_slope[k, i, j] += eta[m] * (body.second_modal2[k, m, i, j] + body.second_modal2[m, k, i, j])
    for k in range(n):
        J2 += 0.5 * eta[k] * (body.second_modal[k] + J2_slope[k])

    RS, WS = R @ S1, W @ S1
    S1_alpha, S1_rate = S1 @ alpha, S1 @ rate
    for i in range(3):
        M[i, i] = body.mass
        for j in range(3):
            M[i, 3 + 3 * j + i] = s0[j]
            M[3 + 3 * j + i, i] = s0[j]
            Gq[i, 3 + 3 * j + i] = S1_alpha[j]
            Gv[i, 3 + 3 * j + i] = 2 * S1_rate[j]
            for k in range(3):
                M[3 + 3 * j + i, 3 + 3 * k + i] = J2[j, k]
    M[:3, 12:], M[12:, :3] = RS, RS.T
    Gq[:3, 12:], Gv[:3, 12:] = A @ S1, 2 * WS
    M[12:, 12:] = body.modal
    spin = R.T @ W
    coriolis = np.zeros((n, n))
    for k in range(n):
        for i in range(3):
            for j in range(3):
                for m in range(n):
                    coriolis[k, m] += spin[i, j] * E[k, i, j, m]
    for i in range(3):
        rows = slice(3 + 3 * i, 6 + 3 * i)
        RC = R @ C[i]
        M[rows, 12:], M[12:, rows] = RC, RC.T
        Gv[rows, 12:] = 2 * (W @ C[i])
        C_alpha, C_rate = C[i] @ alpha, C[i] @ rate
        for j in range(3):
            for c in range(3):
                Gq[3 + 3 * i + c, 3 + 3 * j + c] = C_alpha[j]
                Gv[3 + 3 * i + c, 3 + 3 * j + c] = 2 * C_rate[j]
        for k in range(n):
            Ek = E[k, i] @ alpha
            Ev = E[k, i] @ rate
            for c in range(3):
                value = S1[i, k] * a_r[c]
                for j in range(3):
                    value += J2_slope[k, i, j] * A[c, j] + R[c, j] * Ek[j] + 2 * W[c, j] * Ev[j]
                Gq[3 + 3 * i + c, 12 + k] = value
                for j in range(3):
                    # R_i on the rate of φ_i, and Ṙ_j on that of φ_j: both halves of spin_ij = R_i·Ṙ_j
                    Gq[12 + k, 3 + 3 * i + c] += 2 * W[c, j] * Ev[j]
                    Gv[12 + k, 3 + 3 * j + c] += 2 * R[c, i] * Ev[j]
        for c in range(3):
            RA = R[0, c] * A[0, i] + R[1, c] * A[1, i] + R[2, c] * A[2, i]
            for m in range(n):
                for k in range(n):
                    Gq[12 + k, 12 + m] += E[m, i, c, k] * RA
        for j in range(3):
            for c in range(3):
                for k in range(n):
                    Gq[12 + k, 3 + 3 * j + c] += C[i, j, k] * A[c, i]
    for j in range(3):
        for c in range(3):
            for k in range(n):
                Gq[12 + k, 3 + 3 * j + c] += S1[j, k] * a_r[c]
    Gv[12:, 12:] = 2 * coriolis
    acceleration = a[at : at + s]
    g += M @ acceleration
    for i in range(3):
        g[i] += 2 * (WS @ rate)[i]
        rows = slice(3 + 3 * i, 6 + 3 * i)
        g[rows] += 2 * (W @ (C[i] @ rate))
    g[12:] += 2 * (coriolis @ rate)
    return M, g, Gq, Gv

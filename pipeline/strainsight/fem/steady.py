"""The periodic motion of the whole model under tones: (K − ω²M + iωC) Z = S U."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from strainsight.errors import NumericalError
from strainsight.fem.complex_factor import factorise_complex
from strainsight.fem.viscous import ViscousDamping

CORRECTIONS = 4
LEFT = 1e-9
"""Residual over load, in the largest entry, of a solution; the factor does not pivot, and has to be corrected."""


def steady_state(
    K: sparse.csr_array,
    M: sparse.csr_array,
    S: np.ndarray,
    damping: ViscousDamping,
    frequency: np.ndarray,
    amplitude: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """z(0) = Σ Re Z and ż(0) = Σ Re iωZ of u(t) = Σ Re U exp(iωt), with a factor for every tone; modal damping by Woodbury:

        Z = Z₀ − Σᵢ φᵢ iωcᵢ (Mφᵢ)ᵀZ₀ / (aᵢ + iωcᵢ),    aᵢ = (1 + iωβ)ωᵢ² + iωα − ω²,    Z₀ = (K − ω²M + iω(αM + βK))⁻¹ S U

    K, M (n, n); S (n, n_u) [-]; frequency ω (k,) [rad/s]; amplitude U (k, n_u) complex [N]. Returns z [m], ż [m/s] (n,).
    `transient` steps this motion on to the error of its scheme and of the held load; that much of free vibration is in it.
    Raises NumericalError where an undamped mode has the frequency of a tone, and the errors of `factorise_complex`.
    """
    z, v = np.zeros(K.shape[0]), np.zeros(K.shape[0])
    for omega, tone in zip(frequency, amplitude, strict=True):
        if np.any(tone):
            Z = _response(K, M, S @ tone, damping, float(omega))
            z += Z.real
            v += (1j * omega * Z).real
    return z, v


def _response(
    K: sparse.csr_array, M: sparse.csr_array, force: np.ndarray, damping: ViscousDamping, omega: float
) -> np.ndarray:
    s = 1j * omega
    A = sparse.csr_array((1 + s * damping.beta) * K + (s * s + s * damping.alpha) * M)
    solve = factorise_complex(A)
    Z, residual = np.zeros(len(force), dtype=complex), force.astype(complex)
    for _ in range(CORRECTIONS):
        Z += solve(residual)
        residual = force - A @ Z
        if np.abs(residual).max() <= LEFT * np.abs(force).max():
            break
    else:
        raise NumericalError(
            f"the steady state at {omega / (2 * np.pi):.6g} Hz is not found to {LEFT:g}",
            key="train.settle",
            remedy="give a number of seconds to settle in, or more damping",
        )
    if damping.shapes is None:
        return Z
    rate = s * damping.rate
    a = s * s + s * damping.alpha + (1 + s * damping.beta) * damping.frequency**2
    return Z - damping.shapes @ (rate / (a + rate) * (damping.shapes.T @ (M @ Z)))

"""Classical lamination theory: what plies one on the other resist, with the shear of first-order theory.

Strain in the order xx, yy, xy, γ_xy = 2 ε_xy; z from the middle of the laminate along its normal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STIFF_IN_SHEAR = 1000.0
"""Of the A₆₆ of `in_shear`, what stands for a laminate that does not shear across: a plate of it has no more than a
thousandth of the deflection by shear that a homogeneous one has."""
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)
"""In a ply, where the square of the shear stress is of fourth degree in z."""


@dataclass(frozen=True)
class Resistance:
    """N = A ε + B κ, M = B ε + D κ, Q = S γ of a shell: A (..., 3, 3) [N/m], B [N], D [N m], S (..., 2, 2) [N/m] of xz, yz."""

    A: np.ndarray
    B: np.ndarray
    D: np.ndarray
    S: np.ndarray

    def seen_at(self, angle: np.ndarray) -> Resistance:
        """Along axes from which its own x is turned by the angle (e,) [rad] about the normal: (e, ...) of one or (e, ...)."""
        R, r = strain_turned(angle), _shear_turned(angle)
        A, B, D, S = (T.swapaxes(-1, -2) @ X @ T for X, T in ((self.A, R), (self.B, R), (self.D, R), (self.S, r)))
        return Resistance(A, B, D, S)


def plane_stress(e1: float, e2: float, nu12: float, g12: float) -> np.ndarray:
    """Q (3, 3) [Pa] of σ = Q ε along the axes of an orthotropic ply: Q₁₁ = E₁/(1 − ν₁₂ν₂₁), Q₁₂ = ν₁₂E₂/(1 − ν₁₂ν₂₁), Q₆₆ = G₁₂,
    ν₂₁ = ν₁₂E₂/E₁."""
    share = 1 - nu12**2 * e2 / e1
    return np.array([[e1 / share, nu12 * e2 / share, 0.0], [nu12 * e2 / share, e2 / share, 0.0], [0.0, 0.0, g12]])


def laminate_resistance(
    thickness: np.ndarray, angle: np.ndarray, Q: np.ndarray, shear_flexibility: np.ndarray
) -> Resistance:
    """Of plies from the lower face up, along x and y of the laminate, about its middle:

        (A, B, D) = ∫ (1, z, z²) Q̄ dz,     S⁻¹ = ∫ fᵀ Ḡ⁻¹ f dz,     τ(z) = f(z) (Q_x, Q_y)

    τ is what equilibrium across the thickness asks for, ∂τ_xz/∂z = −∂σ_xx/∂x − ∂τ_xy/∂y and the same along y, where the
    moments change by Q_x = ∂M_xx/∂x and Q_y = ∂M_yy/∂y alone, x and y those of the laminate, and no force in the plane changes:
    σ = Q̄ (b + z d) M with [a b; bᵀ d] = [A B; B D]⁻¹.
    So S stores the energy of that τ: 5/6 G t of a homogeneous shell, and the core's of a sandwich.

    thickness (n,) [m]; angle (n,) [rad] of axis 1 from x; Q (n, 3, 3) [Pa] along the axes of each ply; shear_flexibility
    (n, 2) 1/G₁z, 1/G₂z [1/Pa], 0 where it does not shear. Source: K. Rohwer, Improved transverse shear stiffnesses for layered
    finite elements, DFVLR-FB 88-32 (1988).
    """
    T, r = strain_turned(angle), _shear_turned(angle)
    Q = T.swapaxes(1, 2) @ Q @ T
    flexible = r.swapaxes(1, 2) @ (shear_flexibility[:, :, None] * r)
    z = np.concatenate([[0.0], np.cumsum(thickness)]) - 0.5 * np.sum(thickness)
    low, high = z[:-1], z[1:]
    A, B, D = (np.einsum("p,pij->ij", (high**k - low**k) / k, Q) for k in (1, 2, 3))
    both = np.linalg.inv(np.block([[A, B], [B, D]]))
    b, d = both[:3, 3:], both[3:, 3:]

    below, energy = np.zeros((2, 2)), np.zeros((2, 2))
    for i in range(len(thickness)):

        def rise(to: float, i: int = i) -> np.ndarray:
            """f of the part of ply i below z."""
            F = Q[i] @ ((to - low[i]) * b + 0.5 * (to**2 - low[i] ** 2) * d)
            return -np.array([[F[0, 0], F[2, 1]], [F[2, 0], F[1, 1]]])

        for point, weight in zip(_POINTS, _WEIGHTS, strict=True):
            f = below + rise(0.5 * (low[i] + high[i] + point * thickness[i]))
            energy += 0.5 * weight * thickness[i] * f.T @ flexible[i] @ f
        below = below + rise(high[i])
    lam, V = np.linalg.eigh(0.5 * (energy + energy.T))
    return Resistance(A, B, D, V / np.maximum(lam, 1 / (STIFF_IN_SHEAR * in_shear(A))) @ V.T)


def strain_turned(angle: np.ndarray) -> np.ndarray:
    """R (..., 3, 3): strains along x, y → along axes that are turned by the angle (...) [rad] from them."""
    c, s = np.cos(angle), np.sin(angle)
    rows = [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def in_shear(X: np.ndarray) -> np.ndarray:
    """(X₁₁ + X₂₂ − 2 X₁₂ + 4 X₃₃)/8 of X (..., 3, 3): the mean of X₃₃ over all axes, which is X₃₃ of an isotropic X."""
    return np.asarray(X[..., 0, 0] + X[..., 1, 1] - 2 * X[..., 0, 1] + 4 * X[..., 2, 2]) / 8


def _shear_turned(angle: np.ndarray) -> np.ndarray:
    """r (..., 2, 2) of γ_xz, γ_yz, as `strain_turned`."""
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, s], [-s, c]]), (0, 1), (-2, -1))

"""Springs and dampers whose load is linear in the displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.compiled import carray
from strainsight.multibody.compiled.law import MOVING, STILL, compiled_law
from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.frames import Frame
from strainsight.multibody.relations import bushing_displacements, cosine


@dataclass(frozen=True)
class LinearLaw:
    """F = (K + Σ θ_j K_j)(ρ − rest) + D ρ̇.

    stiffness K (k, k), rest (k,), terms K_j in the order of the parameters, damping D (k, k) or None.
    """

    stiffness: np.ndarray
    rest: np.ndarray
    terms: tuple[np.ndarray, ...] = ()
    damping: np.ndarray | None = None

    def load(self, rho: np.ndarray, rho_dot: np.ndarray, theta: np.ndarray) -> Load:
        apart = rho - self.rest
        K = self.stiffness
        slopes = np.empty((len(rho), len(self.terms)))
        for j, term in enumerate(self.terms):
            K = K + theta[j] * term
            slopes[:, j] = term @ apart
        F = K @ apart
        if self.damping is not None:
            F += self.damping @ rho_dot
        return Load(F, K, self.damping, slopes)

    memory = 0

    @property
    def address(self) -> int:
        return int(compiled_law(_load).address)

    def numbers(self, theta: np.ndarray) -> np.ndarray:
        """Whether it is damped; K(θ), D, rest, the terms."""
        K = self.stiffness
        for value, term in zip(theta, self.terms, strict=True):
            K = K + value * term
        D = np.zeros_like(K) if self.damping is None else self.damping
        return np.concatenate([[self.damping is not None], *(np.ravel(X) for X in (K, D, self.rest, *self.terms))])


def _load(k, p, numbers, memory, rho, rate, theta, F, F_rho, F_rate, F_theta):  # type: ignore[no-untyped-def]
    given = carray(numbers, 1 + 2 * k * k + k + p * k * k)
    x, xr, out = carray(rho, k), carray(rate, k), carray(F, k)
    by_rho, by_rate, by_theta = carray(F_rho, (k, k)), carray(F_rate, (k, k)), carray(F_theta, (k, p))
    rest = 1 + 2 * k * k
    for i in range(k):
        for j in range(k):
            apart = x[j] - given[rest + j]
            by_rho[i, j] = given[1 + k * i + j]
            by_rate[i, j] = given[1 + k * k + k * i + j]
            out[i] += by_rho[i, j] * apart + by_rate[i, j] * xr[j]
            for m in range(p):
                by_theta[i, m] += given[rest + k + k * (k * m + i) + j] * apart
    return MOVING if given[0] != 0.0 else STILL


def bushing(name: str, i: Frame, j: Frame, stiffness: Sequence[float], damping: Sequence[float]) -> RelativeElement:
    """The six displacements d of j in i, each with its own spring and damper: F = diag(k) d + diag(c) ḋ.

    stiffness k (6,) [N/m, then N m/rad], damping c (6,) [N s/m, then N m s/rad]: along x, y, z of i, then about them. Where
    k or c of a rotation is not zero the rotation has to be small.
    """
    k, c = np.asarray(stiffness, dtype=float), np.asarray(damping, dtype=float)
    turning = bool(k[3:].any() or c[3:].any())
    law = LinearLaw(np.diag(k), np.zeros(6), damping=np.diag(c) if c.any() else None)
    aligned = (cosine(i, 0, j, 0), cosine(i, 1, j, 1)) if turning else ()
    return RelativeElement(name, bushing_displacements(i, j), law, aligned=aligned)

"""Springs and dampers whose load is linear in the displacements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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

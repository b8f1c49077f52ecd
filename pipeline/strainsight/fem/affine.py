"""Operators that are affine in the parameters (5.8-5.10)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np


@dataclass(frozen=True)
class Parameter:
    """A property of some regions that stays free: name, what it is, where, and its reference value [SI]. A stiffness_factor [-]
    multiplies their stiffness as it is, whatever their materials and sections, or that of the springs of these names."""

    name: str
    property: Literal["youngs_modulus", "density", "stiffness_factor"]
    regions: tuple[int, ...]
    reference: float
    springs: tuple[str, ...] = ()


def of_stiffness(property: str) -> bool:
    """Whether the stiffness is proportional to such a parameter: a modulus, or a factor of all moduli."""
    return property in ("youngs_modulus", "stiffness_factor")


@dataclass(frozen=True)
class AffineOperator:
    """X(θ) = X₀ + Σᵢ Xᵢ θᵢ  (5.8), for dense or sparse X.

    constant is X₀; terms maps a parameter's name to Xᵢ [unit of X per unit of θᵢ]; one without a term has Xᵢ = 0.
    """

    constant: Any
    terms: Mapping[str, Any]

    def at(self, theta: Mapping[str, Any]) -> Any:
        """X(θ); a dense operator takes arrays of any common shape (...) as values and returns (..., n, n)."""
        total = self.constant
        for name, term in self.terms.items():
            value = theta[name]
            total = total + (term * value if np.ndim(value) == 0 else term * np.asarray(value)[..., None, None])
        return total

    def derivative(self, name: str) -> Any:
        """∂X/∂θ_name."""
        return self.terms[name] if name in self.terms else 0 * self.constant

    def project(self, basis: np.ndarray) -> AffineOperator:
        """Ψᵀ X(θ) Ψ term by term (5.4-5.7); basis Ψ (n, r)."""
        reduced = {name: _symmetric(basis.T @ (term @ basis)) for name, term in self.terms.items()}
        return AffineOperator(_symmetric(basis.T @ (self.constant @ basis)), reduced)


def _symmetric(X: np.ndarray) -> np.ndarray:
    return 0.5 * (X + X.T)

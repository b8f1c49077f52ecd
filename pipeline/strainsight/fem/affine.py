"""Operators that are affine in the parameters, or in functions of them (5.8-5.10)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
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
class Polynomial:
    """p(θ) = Π_k (θ − r_k)/s of one parameter, its roots r and s [SI]; beyond `within` it goes on along its tangent."""

    parameter: str
    roots: tuple[float, ...] = (0.0,)
    scale: float = 1.0
    within: tuple[float, float] = (-np.inf, np.inf)

    def at(self, theta: Mapping[str, Any]) -> Any:
        """p(θ) [-]; the value of θ may be an array."""
        value, inside = self._inside(theta)
        found = _product((inside - root) / self.scale for root in self.roots)
        return found if inside is value else found + self._slope(inside) * (value - inside)

    def derivative(self, theta: Mapping[str, Any]) -> Any:
        """dp/dθ, by the product rule."""
        return self._slope(self._inside(theta)[1])

    def _inside(self, theta: Mapping[str, Any]) -> tuple[Any, Any]:
        """θ, and the nearest value that is within."""
        value = theta[self.parameter]
        return value, value if np.isinf(self.within).all() else np.clip(value, *self.within)

    def _slope(self, value: Any) -> Any:
        each = [(value - root) / self.scale for root in self.roots]
        return sum(_product(each[:i] + each[i + 1 :]) for i in range(len(each))) / self.scale


@dataclass(frozen=True)
class Coefficient:
    """c(θ) = Π p(θ), each of another parameter: E t³ is that of E with one root, zero, and that of t with three."""

    factors: tuple[Polynomial, ...]

    def at(self, theta: Mapping[str, Any]) -> Any:
        """c(θ); values of θ may be arrays of any common shape."""
        return _product(own.at(theta) for own in self.factors)

    def derivative(self, name: str, theta: Mapping[str, Any]) -> Any:
        """∂c/∂θ_name."""
        return _product(own.derivative(theta) if own.parameter == name else own.at(theta) for own in self.factors)


@dataclass(frozen=True)
class AffineOperator:
    """X(θ) = X₀ + Σ_k c_k(θ) X_k  (5.8), for dense or sparse X.

    constant is X₀; terms maps names to X_k. A term that coefficients does not name bears the name of a parameter, and c_k is
    this parameter, [unit of X per unit of θ]; a parameter that no term has is without effect.
    """

    constant: Any
    terms: Mapping[str, Any]
    coefficients: Mapping[str, Coefficient] = field(default_factory=dict)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that X depends on, in the order of the terms."""
        found: dict[str, None] = {}
        for label in self.terms:
            own = self.coefficients.get(label)
            found |= dict.fromkeys([label] if own is None else [each.parameter for each in own.factors])
        return tuple(found)

    def at(self, theta: Mapping[str, Any]) -> Any:
        """X(θ); a dense operator takes arrays of any common shape (...) as values and returns (..., n, n)."""
        total = self.constant
        for label, term in self.terms.items():
            own = self.coefficients.get(label)
            total = total + _times(term, theta[label] if own is None else own.at(theta))
        return total

    def derivative(self, name: str, theta: Mapping[str, Any]) -> Any:
        """∂X/∂θ_name at θ, with values as in `at`; where X is linear in it (n, n) whatever θ."""
        found = []
        for label, term in self.terms.items():
            own = self.coefficients.get(label)
            if own is None and label == name:
                found.append(term)
            elif own is not None and any(each.parameter == name for each in own.factors):
                found.append(_times(term, own.derivative(name, theta)))
        return sum(found[1:], start=found[0]) if found else 0 * self.constant

    def of_all(self, change: Callable[[Any], Any]) -> AffineOperator:
        """X₀ and every X_k through a linear map: that of X(θ), term by term."""
        return AffineOperator(
            change(self.constant), {label: change(own) for label, own in self.terms.items()}, self.coefficients
        )

    def project(self, basis: np.ndarray) -> AffineOperator:
        """Ψᵀ X(θ) Ψ term by term (5.4-5.7); basis Ψ (n, r)."""
        return self.of_all(lambda X: _symmetric(basis.T @ (X @ basis)))


def sum_of(X: AffineOperator, Y: AffineOperator) -> AffineOperator:
    """X(θ) + Y(θ) term by term; terms of one name have one coefficient."""
    assert all(X.coefficients[label] == Y.coefficients[label] for label in X.coefficients if label in Y.terms)
    terms = {label: X.terms.get(label, 0) + Y.terms.get(label, 0) for label in {**X.terms, **Y.terms}}
    return AffineOperator(X.constant + Y.constant, terms, {**X.coefficients, **Y.coefficients})


def _times(X: Any, value: Any) -> Any:
    return X * value if np.ndim(value) == 0 else X * np.asarray(value)[..., None, None]


def _product(values: Iterable[Any]) -> Any:
    total: Any = 1.0
    for value in values:
        total = total * value
    return total


def _symmetric(X: np.ndarray) -> np.ndarray:
    return 0.5 * (X + X.T)

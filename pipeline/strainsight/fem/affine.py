"""Operators that are affine in the parameters, or in functions of them (5.8-5.10)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from scipy import sparse


@dataclass(frozen=True)
class Parameter:
    """A free property of regions or springs: name, property, regions (or names of springs) and its reference value [SI].

    property: youngs_modulus, density, stiffness_factor, e1, e2, g12, g1z, g2z, area_factor, bending_factor, torsion_factor,
    thickness. A stiffness_factor [-] multiplies the stiffness, whatever the materials and sections; e1 to g2z are moduli of
    plies, material is their id or name; section factors apply to beams, thickness to shells. range: interval of the values;
    without one, a property that the stiffness is not proportional to stays at its reference."""

    name: str
    property: str
    regions: tuple[int, ...]
    reference: float
    springs: tuple[str, ...] = ()
    range: tuple[float, float] | None = None
    material: int | str | None = None


DAMPING: Final = "damping_factor"
"""The property that multiplies the damping: neither stiffness nor mass depend on it."""


def at_their_references(parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Parameters for K and M at the references only: no range, so that nothing is interpolated."""
    return tuple(replace(parameter, range=None) for parameter in parameters)


def of_stiffness(property: str) -> bool:
    """Whether the stiffness depends on such a parameter."""
    return property not in ("density", DAMPING)


def scales_stiffness(property: str) -> bool:
    """Whether the stiffness is proportional to it: a modulus, or a factor of all moduli."""
    return property in ("youngs_modulus", "stiffness_factor")


@dataclass(frozen=True)
class Newton:
    """N_k(θ) = Π_{l<k} (x − r_l)/s, k = 0 … m, of one positive parameter: m roots r and scale s; x = θ [SI] or its logarithm.

    Beyond an end b of `within`, θ is b + w tanh((θ − b)/w), w = b · beyond: N_k levels off smoothly, because a polynomial
    that fits the interval can take any value outside it. With roots of zero these are the powers of θ."""

    parameter: str
    roots: tuple[float, ...] = (0.0,)
    scale: float = 1.0
    within: tuple[float, float] = (0.0, np.inf)
    beyond: float = 0.0
    logarithm: bool = False

    def at(self, theta: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
        """N_k and dN_k/dθ (m + 1, ...), for a value of shape (...)."""
        value, slope = np.asarray(theta[self.parameter]), np.asarray(1.0)
        if self.beyond:
            end = np.clip(value, *self.within)
            far = np.tanh((value - end) / (self.beyond * end))
            value, slope = end + self.beyond * end * far, 1 - far**2
        x, slope = (np.log(value), slope / value) if self.logarithm else (value, slope)
        N, by_x = [np.ones_like(x)], [np.zeros_like(x)]
        for root in self.roots:
            factor = (x - root) / self.scale
            by_x.append(by_x[-1] * factor + N[-1] / self.scale)
            N.append(N[-1] * factor)
        return np.stack(N), np.stack(by_x) * slope


@dataclass(frozen=True, eq=False)
class Coefficient:
    """c(θ) = Σ_ν w_ν Π_j N_{ν_j}(θ_j), a polynomial of some parameters: bases, one a parameter; weights (m₁ + 1, m₂ + 1, …)."""

    bases: tuple[Newton, ...]
    weights: np.ndarray

    def times(self, name: str) -> Coefficient:
        """θ_name c(θ), where c does not depend on θ_name."""
        return Coefficient((Newton(name), *self.bases), np.stack([0 * self.weights, self.weights]))


def _summed(weights: np.ndarray, tables: Sequence[np.ndarray]) -> np.ndarray:
    """Σ_ν w_ν Π_j N_{ν_j} (K, ...) of weights (K, m₁, m₂, …) and tables (m_j, ...)."""
    shape = np.broadcast_shapes(*(table.shape[1:] for table in tables))
    flat = []
    for table in tables:
        ahead = (1,) * (len(shape) + 1 - table.ndim)
        flat.append(
            np.broadcast_to(table.reshape(len(table), *ahead, *table.shape[1:]), (len(table), *shape)).reshape(
                len(table), -1
            )
        )
    total = weights @ flat[-1]
    for table in reversed(flat[:-1]):
        total = np.einsum("...mv,mv->...v", total, table)
    return total.reshape(len(weights), *shape)


@dataclass(frozen=True)
class AffineOperator:
    """X(θ) = X₀ + Σ_k c_k(θ) X_k  (5.8), for dense or sparse X.

    constant is X₀; terms maps names to X_k. A term that coefficients does not name bears the name of a parameter, and c_k is
    this parameter, [unit of X per unit of θ]; a parameter without a term has no effect."""

    constant: Any
    terms: Mapping[str, Any]
    coefficients: Mapping[str, Coefficient] = field(default_factory=dict)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters that X depends on, in the order of the terms."""
        names: dict[str, None] = {}
        for label in self.terms:
            coefficient = self.coefficients.get(label)
            names |= dict.fromkeys([label] if coefficient is None else [each.parameter for each in coefficient.bases])
        return tuple(names)

    def at(self, theta: Mapping[str, Any]) -> Any:
        """X(θ); a dense operator takes arrays of any common shape (...) as values and returns (..., n, n)."""
        total, is_copy = self.constant, False
        values = self._values(theta)
        for label, term in self.terms.items():
            value = values[label] if label in values else theta[label]
            both = isinstance(term, sparse.csr_array) and isinstance(total, sparse.csr_array)
            if both and same_places(total, term):
                data = total.data if is_copy else total.data.copy()
                data += value * term.data
                total = sparse.csr_array((data, total.indices, total.indptr), shape=total.shape)
            else:
                total = total + _times(term, value)
            is_copy = True
        return total

    def derivative(self, name: str, theta: Mapping[str, Any]) -> Any:
        """∂X/∂θ_name at θ, with values as in `at`; where X is linear in it (n, n) whatever θ."""
        terms = [self.terms[name]] if name in self.terms and name not in self.coefficients else []
        terms += [_times(self.terms[label], slope) for label, slope in self._values(theta, name).items()]
        return sum(terms[1:], start=terms[0]) if terms else 0 * self.constant

    @cached_property
    def _coefficients_by_bases(self) -> list[tuple[tuple[Newton, ...], list[str], np.ndarray]]:
        """Coefficients of the same bases: their terms, and their weights (K, m₁, m₂, …)."""
        groups: dict[tuple[Newton, ...], list[str]] = {}
        for label, coefficient in self.coefficients.items():
            groups.setdefault(coefficient.bases, []).append(label)
        return [
            (bases, labels, np.stack([self.coefficients[label].weights for label in labels]))
            for bases, labels in groups.items()
        ]

    def _values(self, theta: Mapping[str, Any], name: str | None = None) -> dict[str, Any]:
        """c_k(θ) of the terms with a coefficient, or ∂c_k/∂θ_name of those that depend on it."""
        values: dict[str, Any] = {}
        for bases, labels, weights in self._coefficients_by_bases:
            if name is None or any(basis.parameter == name for basis in bases):
                tables = [basis.at(theta)[name is not None and basis.parameter == name] for basis in bases]
                values |= zip(labels, _summed(weights, tables), strict=True)
        return values

    def of_all(self, change: Callable[[Any], Any]) -> AffineOperator:
        """X₀ and every X_k through a linear map: that of X(θ), term by term."""
        return AffineOperator(
            change(self.constant), {label: change(term) for label, term in self.terms.items()}, self.coefficients
        )

    def of_terms(self, change: Callable[[Any], Any]) -> AffineOperator:
        """Every X_k through a linear map, where X₀ = 0 and stays so."""
        return AffineOperator(0.0, {label: change(term) for label, term in self.terms.items()}, self.coefficients)

    def on_one_pattern(self) -> AffineOperator:
        """The same, where sparse, with X₀ and every X_k that has half as many entries or more on the pattern of all of these:
        X(θ) is a sum of arrays then."""
        large = [label for label, term in self.terms.items() if 2 * term.nnz >= self.constant.nnz > 0]
        constant, *wide = on_one([self.constant, *(self.terms[label] for label in large)])
        return replace(self, constant=constant, terms={**self.terms, **dict(zip(large, wide, strict=True))})

    def project(self, basis: np.ndarray) -> AffineOperator:
        """Ψᵀ X(θ) Ψ term by term (5.4-5.7); basis Ψ (n, r)."""
        return self.of_all(lambda X: _symmetric(basis.T @ (X @ basis)))


def sum_of(X: AffineOperator, Y: AffineOperator) -> AffineOperator:
    """X(θ) + Y(θ) term by term; they share no coefficient."""
    assert not X.coefficients.keys() & Y.terms.keys()
    assert not Y.coefficients.keys() & X.terms.keys()
    terms = {**X.terms, **Y.terms} | {
        label: X.terms[label] + Y.terms[label] for label in X.terms.keys() & Y.terms.keys()
    }
    return AffineOperator(added(X.constant, Y.constant), terms, {**X.coefficients, **Y.coefficients})


def _times(X: Any, value: Any) -> Any:
    return X * value if np.ndim(value) == 0 else X * np.asarray(value)[..., None, None]


def _symmetric(X: np.ndarray) -> np.ndarray:
    return 0.5 * (X + X.T)


NO_CHANGE = AffineOperator(0.0, {})
"""The zero operator: no parameter changes anything."""


def same_places(X: sparse.csr_array, Y: sparse.csr_array) -> bool:
    """Whether two CSR matrices have the same sparsity pattern."""
    same_size = X.shape == Y.shape and X.nnz == Y.nnz
    return same_size and np.array_equal(X.indptr, Y.indptr) and np.array_equal(X.indices, Y.indices)


def on_one(matrices: Sequence[sparse.csr_array]) -> list[sparse.csr_array]:
    """The same matrices, CSR with sorted columns, on their common pattern, zeros included; they share the index arrays."""
    pattern = _ones(matrices[0])
    for matrix in matrices[1:]:
        if not same_places(pattern, matrix):
            pattern = pattern + _ones(matrix)
    if max(pattern.nnz, *pattern.shape) < 2**31:  # half the memory, and quicker products
        places = pattern.indices.astype(np.int32), pattern.indptr.astype(np.int32)
        pattern = sparse.csr_array((pattern.data, *places), shape=pattern.shape)

    def expand_to_pattern(matrix: sparse.csr_array) -> sparse.csr_array:
        data = matrix.data
        if not same_places(pattern, matrix):
            # a sum of positive numbers drops no entry: what exceeds the ones of the pattern is the number of the entry
            number = sparse.csr_array(
                (np.arange(1.0, matrix.nnz + 1), matrix.indices, matrix.indptr), shape=matrix.shape
            )
            place = np.rint((number + pattern).data).astype(np.int64) - 1
            data = np.append(0.0, data)[place]
        return sparse.csr_array((data, pattern.indices, pattern.indptr), shape=pattern.shape)

    pattern.data[:] = 1.0
    return [expand_to_pattern(matrix) for matrix in matrices]


def from_entries(parts: Iterable[tuple[np.ndarray, Any, Any]], shape: tuple[int, int]) -> sparse.csr_array:
    """Sum of entries: values, with their rows and columns, which broadcast to the shape of the values; zeros are left out."""
    entries = [(np.zeros(0), *np.zeros((2, 0), dtype=np.int64))]
    for value, *places in parts:
        nonzero = value != 0
        row, column = (np.broadcast_to(place, value.shape)[nonzero] for place in places)
        entries.append((value[nonzero], row, column))
    value, row, column = (np.concatenate(part) for part in zip(*entries, strict=True))
    return sparse.csr_array((value, (row, column)), shape=shape)


def added(X: Any, Y: Any) -> Any:
    """X + Y, without a pass over a sparse matrix if the other is empty."""
    if isinstance(X, sparse.csr_array) and isinstance(Y, sparse.csr_array) and not (X.nnz and Y.nnz):
        return X if X.nnz else Y
    return X + Y


def _ones(X: sparse.csr_array) -> sparse.csr_array:
    return sparse.csr_array((np.ones(X.nnz), X.indices, X.indptr), shape=X.shape)

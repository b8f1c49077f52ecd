"""Operators of a mesh by its regions: the regions of each parameter, and how they depend on it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from itertools import count
from typing import TypeVar

import numpy as np
from scipy import sparse

from strainsight.errors import UserError
from strainsight.fem.affine import AffineOperator, Coefficient, Newton, Parameter, scales_stiffness, sum_of
from strainsight.mesh.model import CellBlock, Mesh
from strainsight.mesh.properties import OF_MASS, PLY_MODULI, meant, shapes, with_value, without_modulus
from strainsight.mesh.thin import BeamBlock, ShellBlock

TOLERANCE = 1e-8
"""Relative change of an operator that is neglected everywhere."""
MOST = 24
"""Largest total degree of all parameters."""
BEYOND = 0.1
"""How far outside its range a parameter acts, as a share of its value there."""

Operator = TypeVar("Operator", np.ndarray, sparse.csr_array)
Block = TypeVar("Block", bound=CellBlock | ShellBlock | BeamBlock)


def interpolated(of: Callable[[Mapping[str, float]], Operator], parameters: Sequence[Parameter]) -> AffineOperator:
    """Newton's interpolation of X(θ) over the ranges of some parameters, as a sum of few matrices:

        X(θ) = X(θ₀) + Σ_k c_k(θ) B_k,   c_k(θ) = Σ_ν w_kν Π_j N_{ν_j}(θ_j),   N_k(θ) = Π_{l<k} (x − z_l)/s

    x = θ of factors of a section and ln θ of moduli, whose poles, if any, are at θ ≤ 0. z_0 is the reference, where X(θ) is
    exact; the others are Leja points of the range widened by BEYOND. An index ν is used if each of its neighbours with one
    degree less adds more than TOLERANCE somewhere in the ranges. B_k are orthonormal, and span X − X(θ₀) at all points to a
    tenth of TOLERANCE. An X that is a polynomial is exact to rounding.

    of: values [SI] → X, an array or a sparse matrix, of one pattern at all θ. A change is measured as max |ΔX_ij|/√(X_ii X_jj) of
    a sparse matrix, so that small motions count as well, and relative to max |X| of an array.
    Raises UserError where degree MOST is not enough. Source: Chkifa, Cohen and Schwab, Found. Comput. Math. 14 (2014)."""
    axes = [_Axis(parameter) for parameter in parameters]
    names = [axis.name for axis in axes]
    first = of({parameter.name: parameter.reference for parameter in parameters})
    scale = _scales(first)
    span: list[np.ndarray] = []
    coefficients: dict[tuple[int, ...], np.ndarray] = {(0,) * len(parameters): np.zeros(0)}
    accepted = set(coefficients)
    for degree in count(1):
        candidates = [index for index in _of_degree(len(parameters), degree) if accepted.issuperset(_below(index))]
        if not candidates:
            break
        if degree > MOST:
            raise UserError(
                f"a polynomial of degree {MOST} cannot represent the stiffness over the parameter range of {', '.join(names)}",
                remedy=f"Reduce the width of the range: {' or '.join(f'parameters.{name}.range' for name in names)}.",
            )
        for index in candidates:
            theta = {axis.name: axis.theta(k) for axis, k in zip(axes, index, strict=True)}
            w = _coordinates_in((_data(of(theta)) - _data(first)) * scale, span)
            for other, lower in coefficients.items():
                if all(a <= b for a, b in zip(other, index, strict=True)):
                    w[: len(lower)] -= _value_at(axes, other, index) * lower
            coefficients[index] = w / _value_at(axes, index, index)
            change = np.abs(sum((a * B for a, B in zip(coefficients[index], span, strict=True)), np.zeros(1))).max()
            if change * np.prod([axis.largest(k) for axis, k in zip(axes, index, strict=True)]) > TOLERANCE:
                accepted.add(index)
    shape: list[int] = (np.max(list(accepted), axis=0) + 1).tolist()
    weights = np.zeros((len(span), int(np.prod(shape))))
    for degrees in accepted:
        weights[: len(coefficients[degrees]), np.ravel_multi_index(degrees, shape)] = coefficients[degrees]
    bases = tuple(axis.newton(m - 1) for axis, m in zip(axes, shape, strict=True))
    labels = [f"{' '.join(names)} ({k + 1})" for k in range(len(span))]
    return AffineOperator(
        first,
        {label: _like(first, B / scale) for label, B in zip(labels, span, strict=True)},
        {label: Coefficient(bases, each.reshape(shape)) for label, each in zip(labels, weights, strict=True)},
    )


def _coordinates_in(v: np.ndarray, span: list[np.ndarray]) -> np.ndarray:
    """Coordinates of v in an orthonormal span, which is extended by the remainder of v. Gram-Schmidt, twice."""
    w = np.zeros(len(span))
    for _ in range(2):
        share = np.array([B @ v for B in span])
        v = v - sum((a * B for a, B in zip(share, span, strict=True)), np.zeros(1))
        w += share
    if np.abs(v).max(initial=0.0) > 0.1 * TOLERANCE:
        norm = float(np.linalg.norm(v))
        span.append(v / norm)
        w = np.append(w, norm)
    return w


def _data(X: Operator) -> np.ndarray:
    return X.ravel() if isinstance(X, np.ndarray) else X.data


def _like(X: Operator, data: np.ndarray) -> Operator:
    if isinstance(X, np.ndarray):
        return data.reshape(X.shape)
    return sparse.csr_array((data, X.indices, X.indptr), shape=X.shape)


def _scales(X: Operator) -> np.ndarray:
    """Factor for the change of each entry."""
    if isinstance(X, np.ndarray):
        return np.full(X.size, 1 / np.abs(X).max())
    d = np.sqrt(np.maximum(X.diagonal(), 0.0))
    product = np.repeat(d, np.diff(X.indptr)) * d[X.indices]
    return np.where(product > 0, 1 / np.where(product > 0, product, 1.0), 1 / product.max())


def _value_at(axes: Sequence[_Axis], index: tuple[int, ...], at: tuple[int, ...]) -> float:
    """Π_j N_{index_j} at the points `at`."""
    each = zip(axes, index, at, strict=True)
    return float(np.prod([(axis.points[b] - axis.points[i]) / axis.scale for axis, k, b in each for i in range(k)]))


def _below(index: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """The neighbours with one degree less."""
    for j, k in enumerate(index):
        if k:
            yield (*index[:j], k - 1, *index[j + 1 :])


def _of_degree(dimensions: int, degree: int) -> Iterator[tuple[int, ...]]:
    """All ν with |ν| = degree."""
    if dimensions == 1:
        yield (degree,)
        return
    for first in range(degree, -1, -1):
        for rest in _of_degree(dimensions - 1, degree - first):
            yield (first, *rest)


class _Axis:
    """A parameter for interpolation in x = ln θ of a modulus, otherwise x = θ.
    range includes the reference; ends of x include BEYOND; scale is a quarter of their distance, so that N_k neither grows nor
    vanishes with k. points are Leja points: the reference, then each time the maximum of the product of distances."""

    def __init__(self, parameter: Parameter):
        assert parameter.range is not None
        self.name, self.reference = parameter.name, parameter.reference
        self.logarithm = parameter.property in ("youngs_modulus", *PLY_MODULI)
        low, high = self.range = (
            min(parameter.range[0], parameter.reference),
            max(parameter.range[1], parameter.reference),
        )
        assert low < high
        self.ends = self._x((1 - BEYOND) * low), self._x((1 + BEYOND) * high)
        low, high = self.ends
        self.scale = (high - low) / 4
        grid = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.linspace(0, np.pi, 401))
        self.points = [self._x(parameter.reference)]
        distance = np.abs(grid - self.points[0]) / self.scale
        while len(self.points) <= MOST:
            self.points.append(float(grid[np.argmax(distance)]))
            distance *= np.abs(grid - self.points[-1]) / self.scale

    def _x(self, theta: float) -> float:
        return float(np.log(theta)) if self.logarithm else theta

    def theta(self, k: int) -> float:
        """θ at point k; the reference to the last digit."""
        x = self.points[k]
        return self.reference if k == 0 else float(np.exp(x)) if self.logarithm else x

    def largest(self, k: int) -> float:
        """max |N_k| over the interval."""
        x = np.linspace(*self.ends, 401)
        return float(
            np.abs(np.prod([(x - root) / self.scale for root in self.points[:k]] or [np.ones(1)], axis=0)).max()
        )

    def newton(self, degree: int) -> Newton:
        """N_0 to N_degree."""
        return Newton(self.name, tuple(self.points[:degree]), self.scale, self.range, BEYOND, self.logarithm)


def region_operator(
    mesh: Mesh,
    parameters: Sequence[Parameter],
    kind: str,
    blocks: Sequence[CellBlock | ShellBlock | BeamBlock],
    summed: Callable[[Mesh, Mapping[int, float]], sparse.csr_array],
) -> AffineOperator:
    """ "stiffness" or "mass" of the elements of some blocks, split by the parameters that the regions depend on.

    summed: the matrix of a mesh and of regions with factors, of the same size for any of them."""
    mine = set(regions_of(blocks))
    shaped = _shaped(mesh, parameters, kind)
    X: dict[str, sparse.csr_array] = {}
    parts = []
    for name, regions in targets(mesh, parameters, kind).items():
        groups: dict[tuple[str, ...], dict[int, float]] = {}
        for number, factor in ((each, factor) for each, factor in regions.items() if each in mine):
            groups.setdefault(tuple(K.name for K in shaped.get(number, ())), {})[number] = factor
        for names, some in groups.items():
            if names:
                part = _interpolated(
                    mesh, [parameter for parameter in parameters if parameter.name in names], some, summed
                )
                parts.append(_proportional(part, name) if name else part)
            elif (K := summed(mesh, some)).nnz:
                X[name] = K
    constant = X.pop("") if "" in X else summed(mesh, {})
    return reduce(sum_of, parts, AffineOperator(constant, X))


def _shaped(mesh: Mesh, parameters: Sequence[Parameter], kind: str) -> dict[int, list[Parameter]]:
    """Region → the parameters that its stiffness or mass is not proportional to. Raises UserError if two are the same
    property of a region, and where a region has no such property."""
    dependent: dict[int, list[Parameter]] = {}
    owner: dict[tuple[int, str, int], Parameter] = {}
    for parameter in parameters:
        if kind == "mass" and parameter.property not in OF_MASS:
            continue
        for number in (each for each in parameter.regions if shapes(mesh, each, parameter.property)):
            which = (number, parameter.property, meant(mesh, number, parameter.property, parameter.material))
            if (other := owner.setdefault(which, parameter)) is not parameter:
                raise UserError(
                    f"parameters {other.name} and {parameter.name} both define the {parameter.property} of region {number}",
                    remedy="Remove one of the two parameters.",
                )
            dependent.setdefault(number, []).append(parameter)
    return dependent


def _interpolated(
    mesh: Mesh,
    parameters: Sequence[Parameter],
    regions: Mapping[int, float],
    summed: Callable[[Mesh, Mapping[int, float]], sparse.csr_array],
) -> AffineOperator:
    """The matrix of some regions over the ranges of the parameters that shape them."""

    def at(theta: Mapping[str, float]) -> sparse.csr_array:
        other = mesh
        for parameter in parameters:
            here = [number for number in parameter.regions if number in regions]
            other = with_value(other, parameter.property, here, theta[parameter.name], parameter.material)
        return summed(other, regions)

    if all(parameter.range is None for parameter in parameters):
        return AffineOperator(at({parameter.name: parameter.reference for parameter in parameters}), {})
    return interpolated(at, parameters)


def _proportional(X: AffineOperator, name: str) -> AffineOperator:
    """θ X(θ) of one more parameter."""
    terms = {f"{name} {label}": term for label, term in X.terms.items()}
    return AffineOperator(
        0 * X.constant,
        {name: X.constant} | terms,
        {f"{name} {label}": coefficient.times(name) for label, coefficient in X.coefficients.items()},
    )


def targets(mesh: Mesh, parameters: Sequence[Parameter], kind: str) -> dict[str, dict[int, float]]:
    """Factor (E or ρ) of each region by term: "" is the constant part, the name of a parameter its unit term.

    kind: "stiffness" or "mass". The factor is 1 where a modulus or density is the parameter, E where a stiffness factor is,
    and 1 for the stiffness of a region with several moduli. Parameters that a region depends on otherwise are ignored.
    Raises UserError for parameters that overlap or name no region, and for the modulus of a region with several."""
    present = regions_of(mesh.elements)
    owner: dict[int, Parameter] = {}
    names = [p.name for p in parameters]
    for p in parameters:
        if names.count(p.name) > 1 or not p.name:
            raise UserError(
                f"the parameter name {p.name!r} is empty or is used more than once",
                remedy="Give every parameter a separate name.",
            )
        for number in p.regions:
            if number not in present:
                raise UserError(
                    f"parameter {p.name} refers to region {number}, which has no elements",
                    remedy=f"Set `region` of this parameter to one of the regions {', '.join(map(str, present))}.",
                )
            if shapes(mesh, number, p.property):
                continue
            if p.property == "youngs_modulus" and (why := without_modulus(mesh, number)):
                raise UserError(
                    f"parameter {p.name} is a `youngs_modulus`, but region {number} ({why}) has no single Young's modulus",
                    remedy="Estimate a factor of the stiffness instead: `property: stiffness_factor`, `guess: 1.0`.",
                )
            if (
                scales_stiffness(p.property) == (kind == "stiffness")
                and (other := owner.setdefault(number, p)) is not p
            ):
                shared = p.property if p.property == other.property else kind
                raise UserError(
                    f"parameters {other.name} and {p.name} both define the {shared} of region {number}",
                    remedy="Remove one of the two parameters.",
                )
    targets: dict[str, dict[int, float]] = {}
    for number in present:
        parameter = owner.get(number)
        if parameter is not None and parameter.property != "stiffness_factor":
            factor = 1.0
        else:
            factor = density_of(mesh, number) if kind == "mass" else modulus_of(mesh, number)
        targets.setdefault(parameter.name if parameter else "", {})[number] = factor
    return targets


def modulus_of(mesh: Mesh, region: int) -> float:
    """Young's modulus [Pa] that multiplies the stiffness of a region; 1 where it has several, `without_modulus`."""
    return 1.0 if without_modulus(mesh, region) else mesh.materials[mesh.regions[region].material].youngs_modulus


def some_of(block: Block, which: np.ndarray) -> Block:
    """Some elements of a block."""
    columns = {name: column for name, column in vars(block).items() if isinstance(column, np.ndarray)}
    return replace(block, **{name: column[which] for name, column in columns.items() if len(column) == len(block.ids)})


def cut(block: Block, regions: Collection[int], size: int | None = None) -> Iterator[Block]:
    """The elements of a block in these regions, at most `size` at a time; None: all at once."""
    inside = np.flatnonzero(np.isin(block.region, list(regions)))
    size = size or len(inside) or 1
    for start in range(0, len(inside), size):
        yield some_of(block, inside[start : start + size])


def by_element(block: CellBlock | ShellBlock | BeamBlock, regions: Mapping[int, float]) -> np.ndarray:
    """(e,): the value of each element's region."""
    return np.array([regions[int(number)] for number in block.region])


def poisson_ratios(mesh: Mesh, region: np.ndarray) -> np.ndarray:
    """ν (e,) of the materials of regions (e,)."""
    return np.array([mesh.materials[mesh.regions[int(number)].material].poisson_ratio for number in region])


def density_of(mesh: Mesh, region: int) -> float:
    """Density [kg/m³] of a region (for a laminate the mean over its thickness) of a mesh that `check_mesh` has accepted."""
    density = mesh.density_of(region)
    assert density is not None
    return density


def regions_of(blocks: Iterable[CellBlock | ShellBlock | BeamBlock]) -> list[int]:
    """Regions of some elements."""
    return sorted({int(number) for block in blocks for number in np.unique(block.region)})

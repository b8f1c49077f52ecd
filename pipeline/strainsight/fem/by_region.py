"""Operators of a mesh by its regions: which of them go with which parameter, and how they depend on it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce

import numpy as np
from scipy import sparse

from strainsight.errors import UserError
from strainsight.fem.affine import AffineOperator, Parameter, scales_stiffness, sum_of
from strainsight.fem.interpolation import interpolated
from strainsight.mesh.model import CellBlock, Mesh
from strainsight.mesh.properties import OF_MASS, meant, shapes, with_value, without_modulus
from strainsight.mesh.thin import BeamBlock, ShellBlock


def region_operator(
    mesh: Mesh,
    parameters: Sequence[Parameter],
    kind: str,
    blocks: Sequence[CellBlock | ShellBlock | BeamBlock],
    summed: Callable[[Mesh, Mapping[int, float]], sparse.csr_array],
) -> AffineOperator:
    """ "stiffness" or "mass" of the elements of some blocks, by the regions of each parameter and each set of parameters that
    shape them; summed: that of a mesh and regions with factors, of one size for any of them."""
    mine = set(regions_of(blocks))
    shaped = _shaped(mesh, parameters, kind)
    X: dict[str, sparse.csr_array] = {}
    parts = []
    for name, regions in targets(mesh, parameters, kind).items():
        alike: dict[tuple[str, ...], dict[int, float]] = {}
        for number, factor in ((each, factor) for each, factor in regions.items() if each in mine):
            alike.setdefault(tuple(own.name for own in shaped.get(number, ())), {})[number] = factor
        for names, some in alike.items():
            if names:
                part = _interpolated(mesh, [own for own in parameters if own.name in names], some, summed)
                parts.append(_proportional(part, name) if name else part)
            elif (own := summed(mesh, some)).nnz:
                X[name] = own
    constant = X.pop("") if "" in X else summed(mesh, {})
    return reduce(sum_of, parts, AffineOperator(constant, X))


def _shaped(mesh: Mesh, parameters: Sequence[Parameter], kind: str) -> dict[int, list[Parameter]]:
    """Region → the parameters that its stiffness or mass is not proportional to. Raises UserError for two that are one property
    of a region, and where a region has no such property."""
    found: dict[int, list[Parameter]] = {}
    taken: dict[tuple[int, str, int], Parameter] = {}
    for own in parameters:
        if kind == "mass" and own.property not in OF_MASS:
            continue
        for number in (each for each in own.regions if shapes(mesh, each, own.property)):
            which = (number, own.property, meant(mesh, number, own.property, own.material))
            if (other := taken.setdefault(which, own)) is not own:
                raise UserError(
                    f"parameters {other.name} and {own.name} are both the {own.property} of region {number}",
                    remedy="keep one of them",
                )
            found.setdefault(number, []).append(own)
    return found


def _interpolated(
    mesh: Mesh,
    parameters: Sequence[Parameter],
    regions: Mapping[int, float],
    summed: Callable[[Mesh, Mapping[int, float]], sparse.csr_array],
) -> AffineOperator:
    """The matrix of some regions over the ranges of the parameters that shape them."""

    def at(theta: Mapping[str, float]) -> sparse.csr_array:
        other = mesh
        for own in parameters:
            here = [number for number in own.regions if number in regions]
            other = with_value(other, own.property, here, theta[own.name], own.material)
        return summed(other, regions)

    if all(own.range is None for own in parameters):
        return AffineOperator(at({own.name: own.reference for own in parameters}), {})
    return interpolated(at, parameters)


def _proportional(X: AffineOperator, name: str) -> AffineOperator:
    """θ X(θ) of one more parameter."""
    terms = {f"{name} {label}": own for label, own in X.terms.items()}
    return AffineOperator(
        0 * X.constant,
        {name: X.constant} | terms,
        {f"{name} {label}": own.times(name) for label, own in X.coefficients.items()},
    )


def targets(mesh: Mesh, parameters: Sequence[Parameter], kind: str) -> dict[str, dict[int, float]]:
    """Which regions go where with what factor, E or ρ: "" is the constant part, a parameter's name its unit term.

    kind: "stiffness" or "mass". The factor is 1 where a modulus or density is the parameter, E where a factor of the stiffness
    is, and that of the stiffness of a region that has several moduli is 1. Parameters that only shape a region are not asked.
    Raises UserError for parameters that overlap or name no region, and for the modulus of one that has several.
    """
    present = regions_of(mesh.elements)
    owner: dict[int, Parameter] = {}
    names = [p.name for p in parameters]
    for p in parameters:
        if names.count(p.name) > 1 or not p.name:
            raise UserError(f"{names.count(p.name)} parameters are called {p.name!r}", remedy="give each its own name")
        for number in p.regions:
            if number not in present:
                raise UserError(
                    f"parameter {p.name} refers to region {number}, which has no elements",
                    remedy=f"the mesh has regions {', '.join(map(str, present))}",
                )
            if shapes(mesh, number, p.property):
                continue
            if p.property == "youngs_modulus" and (why := without_modulus(mesh, number)):
                raise UserError(
                    f"parameter {p.name} is the youngs_modulus of region {number}, {why}, which has several moduli",
                    remedy="estimate a factor of its stiffness: property stiffness_factor, guess 1.0",
                )
            if (
                scales_stiffness(p.property) == (kind == "stiffness")
                and (other := owner.setdefault(number, p)) is not p
            ):
                alike = p.property == other.property
                raise UserError(
                    f"parameters {other.name} and {p.name} are both the {p.property if alike else kind} of region {number}",
                    remedy="keep one of them",
                )
    targets: dict[str, dict[int, float]] = {}
    for number in present:
        own = owner.get(number)
        if own is not None and own.property != "stiffness_factor":
            factor = 1.0
        else:
            factor = density_of(mesh, number) if kind == "mass" else modulus_of(mesh, number)
        targets.setdefault(own.name if own else "", {})[number] = factor
    return targets


def modulus_of(mesh: Mesh, region: int) -> float:
    """Young's modulus [Pa] that the stiffness of a region is multiplied with; 1 where it has several, `without_modulus`."""
    return 1.0 if without_modulus(mesh, region) else mesh.materials[mesh.regions[region].material].youngs_modulus


def density_of(mesh: Mesh, region: int) -> float:
    """Density [kg/m³] of a region, of a laminate the mean over its thickness, of a mesh that `check_mesh` has accepted."""
    density = mesh.density_of(region)
    assert density is not None
    return density


def regions_of(blocks: Iterable[CellBlock | ShellBlock | BeamBlock]) -> list[int]:
    """Regions of some elements."""
    return sorted({int(number) for block in blocks for number in np.unique(block.region)})

"""What a free thickness of shells changes of what is read on their faces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.material import named_regions
from strainsight.fem.affine import NO_CHANGE, AffineOperator, Parameter
from strainsight.fem.interpolation import interpolated
from strainsight.mesh.additions import region_ids
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import THICKNESS
from strainsight.mesh.thickness import Thickness, thickness_of

SMALL = 1e-4
"""Of the largest entry of all rows: what is less in all of a row is that well known, and not to its own digits."""


def free_thicknesses(config: PlacementConfig, mesh: Mesh, reference: Mapping[str, float]) -> tuple[Parameter, ...]:
    """The parameters that are a thickness, at their references [m]."""
    own = {name: entry for name, entry in config.parameters.items() if entry.property == THICKNESS}
    return tuple(
        Parameter(name, THICKNESS, region_ids(mesh, named_regions(entry.region)), reference[name], range=entry.range)
        for name, entry in own.items()
    )


def thickness_of_guess(config: PlacementConfig, mesh: Mesh, reference: Mapping[str, float]) -> Thickness | None:
    """Of the shells at the references [m], which may differ from the deck; None where no thickness is free."""
    return thickness_at(mesh, free_thicknesses(config, mesh, reference), reference)


def thickness_at(mesh: Mesh, free: Sequence[Parameter], theta: Mapping[str, float]) -> Thickness | None:
    """Of the shells at θ [m]; None where no thickness is free."""
    return thickness_of(mesh, [(own.regions, theta[own.name]) for own in free]) if free else None


def rows_along(
    mesh: Mesh, free: Sequence[Parameter], read: Callable[[Thickness | None], np.ndarray]
) -> tuple[np.ndarray, AffineOperator]:
    """Rows X(θ₀) (m, r) at the references, and ΔX(θ) = X(θ) − X(θ₀), without terms where no thickness is free:

        X(θ) = X(θ₀) + Σᵢ (X(θᵢ) − X(θ₀)),     each difference that of `interpolated`, every row over its largest entry

    as a row is a sum over points, each on a shell of one thickness. Linear in it on shells that are flat around a node, and else
    rational, as faces are longer or shorter than the middle.
    read: shells of another thickness → rows (m, r) as they read then."""
    reference = {own.name: own.reference for own in free}
    first = read(thickness_at(mesh, free, reference))
    size = np.abs(first).max(axis=1, initial=0.0, keepdims=True)
    size = np.maximum(size, SMALL * size.max(initial=0.0))  # rows that are zero but for rounding
    change = NO_CHANGE
    for own in free:

        def at(theta: Mapping[str, float]) -> np.ndarray:
            return read(thickness_at(mesh, free, {**reference, **theta})) / size

        found = interpolated(at, [own])
        terms = {label: size * X for label, X in found.terms.items()}
        change = AffineOperator(0.0, {**change.terms, **terms}, {**change.coefficients, **found.coefficients})
    return first, change

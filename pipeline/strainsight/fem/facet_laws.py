"""What strain makes of stress at faces of laminates and of anisotropic and layered solids; strain across those of laminates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.elasticity import anisotropic_regions, elasticities, pair
from strainsight.fem.interpolation import interpolated
from strainsight.fem.shell_sections import material_angle, plies_of, ply_stiffness
from strainsight.fem.shells import shell_axes
from strainsight.mesh.facets import UPPER, Facets, on_solids
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.laminates import Lamina
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import PLY_MODULI, shapes, with_value
from strainsight.mesh.thin import ShellBlock


@dataclass(frozen=True)
class FacetLaws:
    """facet (m,) those on laminates, anisotropic and composite solids, ascending; stiffness (m, 6, 6) [Pa] from strain to stress
    there in the order of `facet_strain`, shears γ, of a laminate that of the ply at the face, in plane stress, in the free moduli
    of plies, of a composite solid that of the layer at the centre of the facet; and on laminates contraction (m, 3, 3) c of
    ε_nn = −c : ε across the face, at their references, 0 on solids, whose strain is known.

    Of plies a deck says nothing of ν₁₃ and ν₂₃: ε_nn is that of ν₁₃ = ν₂₃ = ν₁₂. Strain along the face, which gauges read, and
    stress do not depend on it.
    """

    facet: np.ndarray
    stiffness: AffineOperator
    contraction: np.ndarray


def facet_laws(mesh: Mesh, facets: Facets, parameters: Sequence[Parameter] = ()) -> FacetLaws | None:
    """None where no facet is on a laminate, a shell of several materials, an anisotropic or a composite solid."""
    free = [
        replace(own, regions=tuple(number for number in own.regions if shapes(mesh, number, "youngs_modulus")))
        for own in parameters
        if own.property in ("youngs_modulus", *PLY_MODULI)
    ]
    free = [own for own in free if own.regions]

    def at(theta: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        other = mesh
        for own in free:
            other = with_value(other, own.property, own.regions, theta[own.name], own.material)
        return _joined([*(_of_block(other, block, facets) for block in other.shells), _of_solids(other, facets)])

    facet, stiffness, contraction = at({own.name: own.reference for own in free})
    if not len(facet):
        return None
    if not free:
        return FacetLaws(facet, AffineOperator(stiffness, {}), contraction)
    unknown = np.isnan(stiffness)  # of shells of several materials; nothing free changes them
    C = interpolated(lambda theta: np.where(unknown, 0.0, at(theta)[1]), free)
    return FacetLaws(facet, replace(C, constant=np.where(unknown, np.nan, C.constant)), contraction)


def _joined(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all blocks and solids, by facet."""
    facet, stiffness, contraction = (np.concatenate([part[i] for part in parts]) for i in range(3))
    order = np.argsort(facet)
    return facet[order], stiffness[order], contraction[order]


def _of_solids(mesh: Mesh, facets: Facets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At their centres; of composite solids the layer there."""
    own = np.isin(facets.region, anisotropic_regions(mesh)) & ~facets.of(mesh.thin)
    C = np.empty((len(own), 6, 6))
    for block, local, which, row in on_solids(mesh, facets):
        here, kind, facet = own[which], kind_of(block.kind), FACETS[facets.kind[which[0]]]
        if here.any():
            xi = facet.shape(facet.centre) @ kind.nodes[list(local)]
            element = row[here]
            position, region = mesh.position[block.nodes[element]], block.region[element]
            C[which[here]] = elasticities(mesh, kind, position, region, xi)[:, 0]
    return np.flatnonzero(own), C[own], np.zeros((int(own.sum()), 3, 3))


def _of_block(mesh: Mesh, block: ShellBlock, facets: Facets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    numbers = [int(number) for number in np.unique(block.region)]
    laminates = [number for number in numbers if mesh.laminate(number) is not None]
    general = {number: shell for number in numbers if (shell := mesh.general_shell(number)) is not None}
    which = np.flatnonzero(np.isin(facets.region, [*laminates, *general]) & np.isin(facets.element_id, block.ids))
    C, c = np.zeros((len(which), 6, 6)), np.zeros((len(which), 3, 3))
    if not len(which):
        return which, C, c
    order = np.argsort(block.ids)
    row = order[np.searchsorted(block.ids, facets.element_id[which], sorter=order)]
    axes = shell_axes(mesh.position[block.nodes], block.ids)[row]
    turned, upper = material_angle(mesh, block)[row], facets.facet[which] == UPPER
    for number in laminates:
        laminate, materials = mesh.laminate(number), plies_of(mesh, number)
        assert laminate is not None
        for here, end in ((upper, -1), (~upper, 0)):
            own = np.flatnonzero((block.region[row] == number) & here)
            angle = turned[own] + np.radians(laminate.plies[end].angle)
            one, two = _turned(axes[own], angle)
            Q, ply = ply_stiffness(materials[end]), materials[end]
            C[own] = _along(one, two, Q)
            if isinstance(ply, Lamina):
                share = ply.nu12 / ply.e1 * Q[0] + ply.nu12 / ply.e2 * Q[1]
            else:
                share = ply.poisson_ratio / ply.youngs_modulus * (Q[0] + Q[1])
            c[own] = share[0] * one[:, :, None] * one[:, None] + share[1] * two[:, :, None] * two[:, None]
    for number, shell in general.items():
        own = np.flatnonzero(block.region[row] == number)
        one, two = _turned(axes[own], turned[own])
        C[own] = _along(one, two, shell.membrane) if shell.uniform else np.nan
        S = np.linalg.inv(shell.membrane)
        share = -(S[0, 1] * shell.membrane[0] + S[0, 1] * S[1, 1] / S[0, 0] * shell.membrane[1])
        tensor = np.array([[share[0], share[2]], [share[2], share[1]]])
        both = np.stack([one, two], axis=2)
        c[own] = both @ tensor @ both.swapaxes(1, 2)
    return which, C, c


def _turned(axes: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x and y (m, 3) of axes (m, 3, 3), turned by angles (m,) [rad] about their z."""
    x, y = axes[:, :, 0], axes[:, :, 1]
    one = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    return one, np.cos(angle)[:, None] * y - np.sin(angle)[:, None] * x


def _along(one: np.ndarray, two: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Q (3, 3) of plane stress along directions (m, 3) as (m, 6, 6) along the basic axes."""
    R = np.stack([pair(one, one), pair(two, two), 2 * pair(one, two)], axis=2)
    return np.asarray(R @ Q @ R.swapaxes(1, 2))

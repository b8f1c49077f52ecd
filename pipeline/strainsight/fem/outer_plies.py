"""The plies at the faces of laminates: what strain along a face makes of stress there, and of strain across it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.interpolation import interpolated
from strainsight.fem.shell_sections import material_angle, plies_of, ply_stiffness
from strainsight.fem.shells import shell_axes
from strainsight.mesh.facets import UPPER, Facets
from strainsight.mesh.laminates import Lamina
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import PLY_MODULI, with_value
from strainsight.mesh.thin import ShellBlock


@dataclass(frozen=True)
class OuterPlies:
    """facet (m,) those on laminates, ascending; of the ply there, in plane stress, stiffness (m, 6, 6) [Pa] from strain to stress
    in the order of `facet_strain`, shears γ, in the free moduli of plies, and contraction (m, 3, 3) c of ε_nn = −c : ε across
    the face, at their references.

    A deck says nothing of ν₁₃ and ν₂₃: ε_nn is that of ν₁₃ = ν₂₃ = ν₁₂. Strain along the face, which gauges read, and stress
    do not depend on it.
    """

    facet: np.ndarray
    stiffness: AffineOperator
    contraction: np.ndarray


def outer_plies(mesh: Mesh, facets: Facets, parameters: Sequence[Parameter] = ()) -> OuterPlies | None:
    """None where no facet is on a laminate."""
    free = [
        replace(own, regions=tuple(number for number in own.regions if mesh.laminate(number) is not None))
        for own in parameters
        if own.property in ("youngs_modulus", *PLY_MODULI)
    ]
    free = [own for own in free if own.regions]

    def at(theta: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        other = mesh
        for own in free:
            other = with_value(other, own.property, own.regions, theta[own.name], own.material)
        return _joined([_of_block(other, block, facets) for block in mesh.shells])

    facet, stiffness, contraction = at({own.name: own.reference for own in free})
    if not len(facet):
        return None
    C = interpolated(lambda theta: at(theta)[1], free) if free else AffineOperator(stiffness, {})
    return OuterPlies(facet, C, contraction)


def _joined(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all blocks, by facet."""
    if not parts:
        return np.zeros(0, dtype=np.int64), np.zeros((0, 6, 6)), np.zeros((0, 3, 3))
    facet, stiffness, contraction = (np.concatenate([part[i] for part in parts]) for i in range(3))
    order = np.argsort(facet)
    return facet[order], stiffness[order], contraction[order]


def _of_block(mesh: Mesh, block: ShellBlock, facets: Facets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    laminates = [int(number) for number in np.unique(block.region) if mesh.laminate(int(number)) is not None]
    which = np.flatnonzero(np.isin(facets.region, laminates) & np.isin(facets.element_id, block.ids))
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
            x, y = axes[own, :, 0], axes[own, :, 1]
            one = np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
            two = np.cos(angle)[:, None] * y - np.sin(angle)[:, None] * x
            Q, ply = ply_stiffness(materials[end]), materials[end]
            R = np.stack([_pair(one, one), _pair(two, two), 2 * _pair(one, two)], axis=2)
            C[own] = R @ Q @ R.swapaxes(1, 2)
            if isinstance(ply, Lamina):
                share = ply.nu12 / ply.e1 * Q[0] + ply.nu12 / ply.e2 * Q[1]
            else:
                share = ply.poisson_ratio / ply.youngs_modulus * (Q[0] + Q[1])
            c[own] = share[0] * one[:, :, None] * one[:, None] + share[1] * two[:, :, None] * two[:, None]
    return which, C, c


def _pair(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """½(a bᵀ + b aᵀ) of the stress tensor (m, 6), xx yy zz xy yz zx."""
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
    return np.stack([0.5 * (a[:, i] * b[:, j] + a[:, j] * b[:, i]) for i, j in pairs], axis=1)

"""The plies at the faces of laminates: what strain along a face makes of stress there, and of strain across it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.fem.shell_sections import material_angle, plies_of, ply_stiffness
from strainsight.fem.shells import shell_axes
from strainsight.mesh.facets import UPPER, Facets
from strainsight.mesh.laminates import Lamina
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import ShellBlock


@dataclass(frozen=True)
class OuterPlies:
    """facet (m,) those on laminates, ascending; of the ply there, in plane stress, stiffness (m, 6, 6) [Pa] from strain to stress
    in the order of `facet_strain`, shears γ, and contraction (m, 3, 3) c of ε_nn = −c : ε across the face.

    A deck says nothing of ν₁₃ and ν₂₃: ε_nn is that of ν₁₃ = ν₂₃ = ν₁₂. Strain along the face, which gauges read, and stress
    do not depend on it.
    """

    facet: np.ndarray
    stiffness: np.ndarray
    contraction: np.ndarray


def outer_plies(mesh: Mesh, facets: Facets) -> OuterPlies | None:
    """None where no facet is on a laminate."""
    parts = [_of_block(mesh, block, facets) for block in mesh.shells]
    if not any(len(facet) for facet, _, _ in parts):
        return None
    facet, stiffness, contraction = (np.concatenate([part[i] for part in parts]) for i in range(3))
    order = np.argsort(facet)
    return OuterPlies(facet[order], stiffness[order], contraction[order])


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

"""Stiffness of anisotropic materials and layers along the basic axes, at points of elements; rules that see every layer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.by_region import interpolated
from strainsight.fem.element_matrices import element_masses, positions
from strainsight.fem.shells import shell_axes
from strainsight.fem.thin import material_angle, plies_of, ply_stiffness
from strainsight.mesh.anisotropic import Anisotropic, CompositeSolid
from strainsight.mesh.facets import UPPER, Facets, on_solids
from strainsight.mesh.kinds import FACETS, kind_of
from strainsight.mesh.kinds.kind import ElementKind, Rule
from strainsight.mesh.model import CellBlock, Material, Mesh
from strainsight.mesh.properties import PLY_MODULI, shapes, with_value
from strainsight.mesh.thin import Lamina, ShellBlock

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
"""Components of a symmetric tensor in our order, that of VTK: xx yy zz xy yz zx."""


def pair(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """½(a bᵀ + b aᵀ) (m, 6) of a and b (m, 3), as stress: xx yy zz xy yz zx."""
    return np.stack([0.5 * (a[:, i] * b[:, j] + a[:, j] * b[:, i]) for i, j in PAIRS], axis=1)


def turned(C: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """C along the basic axes (m, 6, 6) of C (6, 6) or (m, 6, 6) along others, axes (m, 3, 3) one in a column:

        C' = R C Rᵀ,     σ' = R σ,   ε = Rᵀ ε',   γ = 2ε

    so that column k of R is the stress tensor a_i ⊗ a_j, made symmetric and of the shears twice, of the k-th pair of axes.
    """
    columns = [(1.0 if i == j else 2.0) * pair(axes[:, :, i], axes[:, :, j]) for i, j in PAIRS]
    R = np.stack(columns, axis=2)
    return np.asarray(R @ C @ R.swapaxes(1, 2))


def isotropic_stiffness(own: Material) -> np.ndarray:
    """C (6, 6) [Pa] of E and ν, shears γ."""
    shear = own.youngs_modulus / (2 * (1 + own.poisson_ratio))
    C = shear * np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])
    C[:3, :3] += 2 * shear * own.poisson_ratio / (1 - 2 * own.poisson_ratio)
    return C


def anisotropic_regions(mesh: Mesh) -> list[int]:
    """Ids of the regions of solids whose material is anisotropic or one of several layers, ascending."""
    return sorted(n for n in mesh.regions if mesh.anisotropic_of(n) is not None or n in mesh.composites)


def elasticities(mesh: Mesh, kind: ElementKind, position: np.ndarray, region: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """C [Pa] along the basic axes at points ξ (q, 3) of elements position (e, k, 3) [m] in regions (e,) of `anisotropic_regions`:
    (e, q, 6, 6), of a composite solid that of the layer where ξ is; (e, 1, 6, 6) where it is one in all of an element."""
    numbers = np.unique(region).tolist()
    x = positions(kind, position, xi if any(_varies(mesh, number) for number in numbers) else xi[:1])
    C = np.empty((*x.shape[:2], 6, 6))
    for number in numbers:
        own = region == number
        C[own] = _in_region(mesh, number, x[own], xi)
    return C


def _varies(mesh: Mesh, region: int) -> bool:
    """Whether the material of a region, or how its axes lie, is another from point to point of an element."""
    orientation = mesh.orientations.get(region)
    return region in mesh.composites or (orientation is not None and orientation.varies)


def _in_region(mesh: Mesh, region: int, x: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """C (e, q, 6, 6) at x (e, q, 3), the points ξ (q, 3) of elements of one region."""
    composite, orientation = mesh.composites.get(region), mesh.orientations.get(region)
    e, q = x.shape[:2]
    if composite is None:
        material = mesh.anisotropic_of(region)
        assert material is not None
        if orientation is None:
            return np.broadcast_to(material.stiffness, (e, q, 6, 6))
        return turned(material.stiffness, orientation.axes_at(x.reshape(-1, 3))).reshape(e, q, 6, 6)
    C, at = np.empty((e, q, 6, 6)), composite.layer_at(xi)
    for i, own in enumerate(mesh.layer_materials(region)):
        here = at == i
        if isinstance(own, Anisotropic):
            axes = composite.layers[i].orientation.axes_at(x[:, here].reshape(-1, 3))
            C[:, here] = turned(own.stiffness, axes).reshape(e, -1, 6, 6)
        else:
            assert own is not None
            C[:, here] = isotropic_stiffness(own)
    return C


def by_rule(mesh: Mesh, kind: ElementKind, region: np.ndarray) -> Iterator[tuple[np.ndarray, Rule]]:
    """Elements (m,) of regions (e,) that `anisotropic_regions` names, and the rule of their stiffness: that of their kind, and of
    composite solids one that sees every layer."""
    layered = np.isin(region, list(mesh.composites))
    plain = np.flatnonzero(np.isin(region, anisotropic_regions(mesh)) & ~layered)
    if len(plain):
        yield plain, kind.stiffness
    for number in np.unique(region[layered]).tolist():
        yield np.flatnonzero(region == number), layered_rule(kind.stiffness, mesh.composites[number])


def layered_rule(rule: Rule, composite: CompositeSolid) -> Rule:
    """In every layer as many points along the layers as a rule has there, and its own points across: exact for the same
    polynomials in each layer. The rule is a product of one along the direction of the layers and one across."""
    xi, w = rule
    points, weights = [], []
    for low, high in pairwise(composite.ends.tolist()):
        own = xi.copy()
        own[:, composite.direction] = 0.5 * (low + high) + 0.5 * (high - low) * xi[:, composite.direction]
        points.append(own)
        weights.append(0.5 * (high - low) * w)
    return np.concatenate(points), np.concatenate(weights)


def relative_masses(mesh: Mesh, part: CellBlock, kind: ElementKind) -> np.ndarray:
    """∫ (ρ/ρ̄) N_a N_b dV [m³] (e, pairs) of elements and their node pairs a ≤ b, ρ̄ the density of their region: ρ is that of a
    layer where there are some. Of a mesh whose mass is lumped, on the diagonal alone, see `lumped`."""
    m = _consistent(mesh, part, kind)
    return lumped(m, part.nodes.shape[1]) if mesh.lumped else m


def lumped(m: np.ndarray, k: int) -> np.ndarray:
    """Diagonal masses of elements from their consistent ones m (e, pairs) of the pairs a ≤ b of k nodes [m³ or kg],

        m_a = m_aa Σ_bc m_bc / Σ_b m_bb,    0 beside the diagonal

    the diagonal scaled to the mass of the element, as in Hinton, Rock and Zienkiewicz (1976), so that all are positive, of
    quadratic elements too.
    """
    a, b = np.triu_indices(k)
    on = a == b
    diagonal = np.where(on, m, 0.0)
    total = m @ np.where(on, 1.0, 2.0)
    return np.asarray(diagonal * (total / diagonal.sum(axis=1))[:, None])


def _consistent(mesh: Mesh, part: CellBlock, kind: ElementKind) -> np.ndarray:
    position = mesh.position[part.nodes]
    layered = np.isin(part.region, list(mesh.composites))
    if not layered.any():
        return element_masses(kind, position, part.ids)[:, :, 0]
    m = np.empty((len(part.ids), position.shape[1] * (position.shape[1] + 1) // 2))
    if not layered.all():
        m[~layered] = element_masses(kind, position[~layered], part.ids[~layered])[:, :, 0]
    for number in np.unique(part.region[layered]).tolist():
        own, composite, mean = part.region == number, mesh.composites[number], mesh.density_of(number)
        xi, w = layered_rule(kind.mass, composite)
        if mean:
            rho = np.array([0.0 if each is None else each.density for each in mesh.layer_materials(number)])
            w = w * rho[composite.layer_at(xi)] / mean
        m[own] = element_masses(kind, position[own], part.ids[own], (xi, w))[:, :, 0]
    return m


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

"""Stiffness of anisotropic materials and layers along the basic axes, at points of elements; rules that see every layer."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from strainsight.fem.element_matrices import element_masses, positions
from strainsight.mesh.anisotropic import Anisotropic
from strainsight.mesh.composite_solids import CompositeSolid
from strainsight.mesh.kinds.kind import ElementKind, Rule
from strainsight.mesh.model import CellBlock, Material, Mesh

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

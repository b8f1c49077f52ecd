"""How heavy a mesh is, and where."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strainsight.errors import DeckError
from strainsight.fem.assembly import chunks, factors
from strainsight.fem.by_region import density_of, regions_of
from strainsight.fem.checks import check_mesh
from strainsight.fem.elasticity import relative_masses
from strainsight.fem.point_masses import weighed
from strainsight.fem.thin import thin_mass
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import CellBlock, Mesh


def mass_properties(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Total mass m = Σ_i m_i and centre of mass x̄ = Σ_i m_i x_i / m, m_i the row sums Σ_j ∫ ρ N_i N_j dV of the solids
    on node i, the point masses at their centres, and of mass matrices, shells and beams from their momentum M t and its
    moment about the origin, t a unit translation along each axis: m x̄ × e = Σ_i (x_i × f_i + moment_i), so that offsets count.

    Returns ([kg], (3,) [m]). Raises DeckError where the mass is zero.
    """
    check_mesh(mesh)
    per_node = np.zeros(len(mesh.position))
    for part, values in element_mass_parts(mesh):
        a, b = np.triu_indices(part.nodes.shape[1])
        other = values * (a != b)
        per_node += np.bincount(part.nodes[:, a].ravel(), values.ravel(), len(per_node))
        per_node += np.bincount(part.nodes[:, b].ravel(), other.ravel(), len(per_node))
    mass, moment = float(per_node.sum()), per_node @ mesh.position
    beside, about = _of_thin(mesh)
    mass, moment = mass + beside, moment + about
    for point in mesh.point_masses:
        own, about = weighed(point, mesh.position[point.node])
        mass, moment = mass + own, moment + about
    if not mass > 0.0:
        named = ", ".join(str(mesh.regions[number]) for number in regions_of(mesh.elements))
        raise DeckError(
            f"the total mass is {mass:g} kg: the density of {named or 'all regions'} is zero",
            remedy="give their materials a density, in the mesh file or under mesh.materials",
        )
    return mass, moment / mass


def _of_thin(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Mass [kg] of the shells and beams, and mass times its centre (3,) [kg m]."""
    x = mesh.position[mesh.thin_nodes]
    M, _ = thin_mass(mesh)
    # what moves along axis j: forces and moments (m, 3, j)
    pull = (M @ np.tile(np.vstack([np.eye(3), np.zeros((3, 3))]), (len(x), 1))).reshape(len(x), 6, 3)
    force, moment = pull[:, :3], pull[:, 3:]
    L = (np.cross(x[:, :, None], force, axis=1) + moment).sum(axis=0)
    centre = 0.5 * np.array([L[2, 1] - L[1, 2], L[0, 2] - L[2, 0], L[1, 0] - L[0, 1]])
    return float(np.trace(force.sum(axis=0)) / 3), centre


def element_mass_parts(mesh: Mesh) -> Iterator[tuple[CellBlock, np.ndarray]]:
    """Elements of the mesh, some at a time, and their ∫ ρ N_a N_b dV [kg] (e, pairs) of the node pairs a ≤ b."""
    density = {number: density_of(mesh, number) for number in regions_of(mesh.blocks)}
    for part in chunks(mesh, density):
        yield part, relative_masses(mesh, part, kind_of(part.kind)) * factors(part, density)

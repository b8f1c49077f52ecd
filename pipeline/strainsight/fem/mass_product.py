"""The consistent mass times a few motions, element by element: no matrix of the whole is made."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.fem.by_region import regions_of
from strainsight.fem.mass import element_mass_parts
from strainsight.fem.point_masses import point_mass_matrix
from strainsight.fem.thin import motions, thin_mass
from strainsight.mesh.model import Mesh


def has_mass(mesh: Mesh) -> bool:
    """Whether there are elements, and every region of theirs has a density."""
    regions = regions_of(mesh.elements)
    return bool(regions) and all((mesh.density_of(number) or 0.0) > 0 for number in regions)


def mass_product(mesh: Mesh, rotation_rows: Mapping[int, int], z: np.ndarray) -> np.ndarray:
    """M z (3n + 3r, k) [kg m, kg m²] of motions z (3n + 3r, k), rotations of node i from row rotation_rows[i]:

        (M z)_a = Σ_elements Σ_b ∫ ρ N_a N_b dV z_b     of solids,

    with shells, beams and point masses. The mesh `has_mass`.
    """
    n, k = len(mesh.position), z.shape[1]
    found = np.zeros_like(z)
    own, out = z[: 3 * n].reshape(n, 3 * k), found[: 3 * n].reshape(n, 3 * k)
    for part, values in element_mass_parts(mesh):
        nodes = part.nodes.shape[1]
        a, b = np.triu_indices(nodes)
        m = np.empty((len(values), nodes, nodes))
        m[:, a, b] = m[:, b, a] = values
        np.add.at(out, part.nodes, m @ own[part.nodes])
    if mesh.thin:
        P = motions(mesh, rotation_rows)
        found += P.T @ (thin_mass(mesh)[0] @ (P @ z))
    if mesh.point_masses:
        found += point_mass_matrix(mesh, rotation_rows) @ z
    return found

"""Mass, centre of mass and mass matrix of a mesh."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError
from strainsight.fem.affine import from_entries
from strainsight.fem.assembly import chunks
from strainsight.fem.by_region import by_element, density_of, regions_of
from strainsight.fem.checks import check_mesh
from strainsight.fem.elasticity import relative_masses
from strainsight.fem.equations import rigid_rows, translation_rows
from strainsight.fem.shells_and_beams import motions, thin_mass
from strainsight.mesh.joins import PointMass
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import CellBlock, Mesh


def point_mass_matrix(mesh: Mesh, rotation_rows: Mapping[int, int]) -> sparse.csr_array:
    """Mass of the point masses on z (3n + 3r)², rotations of node i from row rotation_rows[i] [kg, kg m, kg m²]:

        M = [m I, −m d×; m d×, J − m d×d×],   d offset of the centre, J inertia about it

    or its explicit matrix. At a node without rotations only the translational part counts.
    Raises DeckError for a negative mass and for an inertia or a matrix that is not symmetric."""
    entries = []
    for point in mesh.point_masses:
        at = translation_rows([point.node])
        if point.node in rotation_rows:
            at = np.concatenate([at, rotation_rows[point.node] + np.arange(3)])
        entries.append((block(point)[: len(at), : len(at)], at[:, None], at))
    size = 3 * len(mesh.position) + 3 * len(rotation_rows)
    return from_entries(entries, (size, size))


def block(point: PointMass) -> np.ndarray:
    """M (6, 6) of one point mass on the translations and rotations of its node."""
    check(point)
    if point.matrix is not None:
        return np.asarray(point.matrix)
    D = rigid_rows(np.asarray(point.offset, dtype=float)[None, :])[0]  # motion of the centre
    M = point.mass * D.T @ D
    M[3:, 3:] += point.inertia
    return M


def check(point: PointMass) -> None:
    """Raise DeckError for a negative mass and for an inertia or a matrix that is not symmetric."""
    if not point.mass >= 0:
        raise DeckError(f"point mass {point.id} has the mass {point.mass:g} kg", remedy="Specify a mass ≥ 0.")
    J = np.asarray(point.inertia)
    if not np.abs(J - J.T).max() <= 1e-9 * np.abs(J).max():
        raise DeckError(
            f"the inertia tensor of point mass {point.id} is not symmetric",
            remedy="Specify the six moments and products of inertia of a symmetric tensor.",
        )
    M = np.zeros((6, 6)) if point.matrix is None else point.matrix
    if not np.abs(M - M.T).max() <= 1e-9 * np.abs(M).max():
        raise DeckError(
            f"the 6 × 6 mass matrix of point mass {point.id} is not symmetric",
            remedy="Specify equal terms above and below the diagonal: M_ij = M_ji.",
        )


def weighed(point: PointMass, x: np.ndarray) -> tuple[float, np.ndarray]:
    """Mass m [kg] of a point mass on a node at x, and m times its centre (3,) [kg m].

    With a matrix: from the momentum of unit translations t and its moment, as for shells and beams,

        m c × e = Σ (x × f + moment).
    """
    check(point)
    if point.matrix is None:
        return point.mass, point.mass * (x + point.offset)
    L = np.cross(x[:, None], point.matrix[:3, :3], axis=0) + point.matrix[3:, :3]
    return point.mass, _axial(L)


def mass_properties(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Total mass m = Σ_i m_i and centre of mass x̄ = Σ_i m_i x_i / m, m_i the row sums Σ_j ∫ ρ N_i N_j dV of the solids
    on node i and the point masses at their centres. For mass matrices, shells and beams from their momentum M t and its
    moment about the origin, t a unit translation along each axis: m x̄ × e = Σ_i (x_i × f_i + moment_i), so that offsets count.

    Returns ([kg], (3,) [m]). Raises DeckError where the mass is zero."""
    check_mesh(mesh)
    per_node = np.zeros(len(mesh.position))
    for part, values in element_mass_parts(mesh):
        a, b = np.triu_indices(part.nodes.shape[1])
        other = values * (a != b)
        per_node += np.bincount(part.nodes[:, a].ravel(), values.ravel(), len(per_node))
        per_node += np.bincount(part.nodes[:, b].ravel(), other.ravel(), len(per_node))
    mass, moment = float(per_node.sum()), per_node @ mesh.position
    thin_mass_sum, about = _of_thin(mesh)
    mass, moment = mass + thin_mass_sum, moment + about
    for point in mesh.point_masses:
        point_mass, about = weighed(point, mesh.position[point.node])
        mass, moment = mass + point_mass, moment + about
    if not mass > 0.0:
        named = ", ".join(str(mesh.regions[number]) for number in regions_of(mesh.elements))
        raise DeckError(
            f"the total mass is {mass:g} kg: the density of {named or 'all regions'} is zero",
            remedy="Specify the density of the materials, in the mesh file or under mesh.materials.",
        )
    return mass, moment / mass


def _of_thin(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Mass [kg] of the shells and beams, and mass times its centre (3,) [kg m]."""
    x = mesh.position[mesh.thin_nodes]
    M, _ = thin_mass(mesh)
    # momentum of a motion along axis j: forces and moments (m, 3, j)
    pull = (M @ np.tile(np.vstack([np.eye(3), np.zeros((3, 3))]), (len(x), 1))).reshape(len(x), 6, 3)
    force, moment = pull[:, :3], pull[:, 3:]
    L = (np.cross(x[:, :, None], force, axis=1) + moment).sum(axis=0)
    return float(np.trace(force.sum(axis=0)) / 3), _axial(L)


def _axial(L: np.ndarray) -> np.ndarray:
    """a (3,) of L (3, 3) = a × e, from the skew part of L."""
    return 0.5 * np.array([L[2, 1] - L[1, 2], L[0, 2] - L[2, 0], L[1, 0] - L[0, 1]])


def element_mass_parts(mesh: Mesh) -> Iterator[tuple[CellBlock, np.ndarray]]:
    """Elements of the mesh, some at a time, and their ∫ ρ N_a N_b dV [kg] (e, pairs) of the node pairs a ≤ b."""
    density = {number: density_of(mesh, number) for number in regions_of(mesh.blocks)}
    for part in chunks(mesh, density):
        yield part, relative_masses(mesh, part, kind_of(part.kind)) * by_element(part, density)[:, None]


def has_mass(mesh: Mesh) -> bool:
    """Whether there are elements, and every region of theirs has a density."""
    regions = regions_of(mesh.elements)
    return bool(regions) and all((mesh.density_of(number) or 0.0) > 0 for number in regions)


def mass_product(mesh: Mesh, rotation_rows: Mapping[int, int], z: np.ndarray) -> np.ndarray:
    """M z (3n + 3r, k) [kg m, kg m²] of motions z (3n + 3r, k), rotations of node i from row rotation_rows[i]:

        (M z)_a = Σ_elements Σ_b ∫ ρ N_a N_b dV z_b     of solids,

    with shells, beams and point masses. The mesh `has_mass`."""
    n, k = len(mesh.position), z.shape[1]
    product = np.zeros_like(z)
    nodal_motions, out = z[: 3 * n].reshape(n, 3 * k), product[: 3 * n].reshape(n, 3 * k)
    for part, values in element_mass_parts(mesh):
        nodes = part.nodes.shape[1]
        a, b = np.triu_indices(nodes)
        m = np.empty((len(values), nodes, nodes))
        m[:, a, b] = m[:, b, a] = values
        np.add.at(out, part.nodes, m @ nodal_motions[part.nodes])
    if mesh.thin:
        P = motions(mesh, rotation_rows)
        product += P.T @ (thin_mass(mesh)[0] @ (P @ z))
    if mesh.point_masses:
        product += point_mass_matrix(mesh, rotation_rows) @ z
    return product

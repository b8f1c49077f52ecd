"""A structure of another size has the mass properties of one that is."""

from __future__ import annotations

import numpy as np

from strainsight.mesh.joins import PointMass
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.scaling import scaled


def mass_properties(mesh):
    """Mass [kg], and inertia about the origin [kg m²] of the point masses; volume of the tetrahedra [m³]."""
    total, inertia = 0.0, np.zeros((3, 3))
    for own in mesh.point_masses:
        r = mesh.position[own.node] + own.offset
        total += own.mass
        inertia += own.inertia + own.mass * (r @ r * np.eye(3) - np.outer(r, r))
    corners = mesh.position[mesh.blocks[0].nodes]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum() / 6
    return total, inertia, volume


def test_masses_grow_with_the_cube_and_inertias_with_the_fifth_power_of_the_size():
    rng = np.random.default_rng(3)
    mesh = Mesh(
        node_ids=np.arange(1, 7),
        position=rng.normal(size=(6, 3)),
        blocks=(CellBlock("tet4", np.array([1, 2]), np.array([[0, 1, 2, 3], [1, 2, 3, 4]]), np.array([1, 1])),),
        regions={1: Region(1, "solid", 1)},
        materials={1: Material(1, 2.1e11, 0.3, 7850.0)},
        fixed=np.array([[0, 0], [0, 1]]),
        point_masses=(PointMass(1, 4, 2.0, rng.normal(size=3), np.diag([0.1, 0.2, 0.25])), PointMass(2, 5, 0.5)),
    )
    half = scaled(mesh, 0.5)
    (m, J, V), (small_m, small_J, small_V) = mass_properties(mesh), mass_properties(half)
    np.testing.assert_allclose(small_m, m / 8, rtol=1e-14)
    np.testing.assert_allclose(small_J, J / 32, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(small_V, V / 8, rtol=1e-13)
    assert half.materials == mesh.materials
    assert scaled(mesh, 1.0) is mesh

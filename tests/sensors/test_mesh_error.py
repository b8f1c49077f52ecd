"""Estimated errors of the strain operator by the mesh, compared with a finer mesh."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy import sparse
from scipy.spatial.transform import Rotation

from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.factorisation import factorise
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.kinds import FACETS
from strainsight.sensors.candidates import ACCELERATION, candidates, concatenate, motion_candidates
from strainsight.sensors.installation import (
    InstallationStd,
    installation_variance,
    installed_rows,
    sample_installation,
    sensitivity_rows,
)
from strainsight.sensors.mesh_error import mesh_error_matrix
from strainsight.sensors.strain_operator import channel_matrix, matrix_of, points_within
from strainsight.sensors.surface import tangent

from ..bodies import body
from .conftest import KINDS, bare, plate, tube

ANGLES = (0.0, 45.0, 90.0)


def error_of(position, pool, facets):
    return mesh_error_matrix(position, points_within(position, pool, facets), len(pool), facets)


@pytest.mark.parametrize("kind", ["hex8", "tet4", "wedge6", "hex20", "tet10", "wedge15"])
def test_patch_without_jumps_of_strain_has_no_mesh_error(kind):
    """A linear displacement on any mesh, a quadratic one on quadratic elements with straight sides."""
    shear = np.array([[1.0, 0.2, 0.1], [0.0, 1.1, -0.2], [0.1, 0.0, 0.9]])
    mesh, rng = body(kind, (3, 2, 2), lambda *u: shear @ u), np.random.default_rng(1)
    x, facets = mesh.position, exterior_facets(mesh)
    pool = candidates(mesh, facets, None, ANGLES)
    field = x @ rng.standard_normal((3, 3))
    if len(mesh.blocks[0].nodes[0]) > 8:
        field = field + np.einsum("ni,nj,ijk->nk", x, x, rng.standard_normal((3, 3, 3)))
    error = error_of(x, pool, facets) @ field.ravel()
    assert np.abs(error).max() < 1e-12 * np.abs(channel_matrix(x, pool, facets) @ field.ravel()).max()


@pytest.mark.parametrize("kind", KINDS)
def test_mesh_error_does_not_depend_on_the_axes(kind):
    position, facets = tube(kind, 16, 3, 1.5, shake=0.1)
    pool = candidates(bare(position), facets, (0.3, 0.2, 1.0), ANGLES)
    R = Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix()
    turned = candidates(bare(position @ R.T), facets, R @ (0.3, 0.2, 1.0), ANGLES)
    field = np.random.default_rng(2).standard_normal(position.shape)
    one = error_of(position, pool, facets) @ field.ravel()
    other = error_of(position @ R.T, turned, facets) @ (field @ R.T).ravel()
    assert np.abs(one).max() > 1e-2
    np.testing.assert_allclose(one, other, atol=1e-12 * np.abs(one).max())


def test_facets_across_a_sharp_edge_or_of_another_region_are_not_averaged():
    mesh = body("hex8", (2, 1, 1), lambda *u: np.array(u))
    facets = exterior_facets(mesh)
    pool = candidates(mesh, facets, (1.0, 0.3, 0.2), on_constraints=True)
    top = np.flatnonzero(pool.normal[:, 2] > 0.9)
    touched = np.flatnonzero(np.abs(error_of(mesh.position, pool, facets)[top]).sum(axis=0)) // 3
    assert np.all(mesh.position[touched, 2] == 1)
    facets.region[:] = facets.element_id
    assert abs(error_of(mesh.position, pool, facets)).max() < 1e-12


def quarter_plate(kind, around, along):
    """Quarter of a square plate of 0.2 m with a hole of radius 0.03 m, 0.02 m thick; the same mesh in cells."""

    def chart(u, v, w):
        s = 1 - u / around
        circle = 0.03 * np.array([np.cos(np.pi / 2 * s), np.sin(np.pi / 2 * s)])
        square = 0.1 * np.minimum(1.0, [2 * (1 - s), 2 * s])
        t = v / along * (0.6 + 0.4 * v / along)
        return *(circle + t * (square - circle)), 0.02 * w

    counts = (around, along, 1)
    return body(kind, counts, chart), body(kind, counts, lambda u, v, w: (u / around, v / along, w)).position


def pulled(mesh):
    """Displacements (3n,) of the quarter plate, its end x = 0.1 m pulled by 0.1 mm."""
    x, prescribed, z = mesh.position, np.zeros(mesh.position.shape, dtype=bool), np.zeros(mesh.position.shape)
    end = x[:, 0] > 0.1 - 1e-9
    prescribed[:, 0], prescribed[:, 1], z[end, 0] = end | (x[:, 0] < 1e-9), x[:, 1] < 1e-9, 1e-4
    prescribed[np.argmin(np.linalg.norm(x - [0.1, 0, 0], axis=1)), 2] = True
    held, z = np.flatnonzero(prescribed), z.ravel()
    free = np.flatnonzero(~prescribed)
    rows = sparse.csr_array(assemble_stiffness(mesh)[free])
    z[free] = factorise(sparse.csr_array(rows[:, free])).solve(-(rows[:, held] @ z[held])[:, None])[:, 0]
    return z


@cache
def fine_plate():
    mesh, cells = quarter_plate("hex20", 12, 12)
    facets = exterior_facets(mesh)
    return mesh, facets, cells[facets.nodes[:, :4]], pulled(mesh)


def strain_on_fine_plate(at, direction):
    """Strain at places (m, 3) in cells along directions (m, 3)."""
    mesh, facets, corners, z = fine_plate()
    inside = np.all((corners.min(axis=1) - 1e-9 <= at[:, None]) & (at[:, None] <= corners.max(axis=1) + 1e-9), axis=2)
    facet, square = np.argmax(inside, axis=1), FACETS[2].nodes
    middle = corners[facet].mean(axis=1)
    slope = np.einsum("kd,mkc->mdc", square, corners[facet]) / 4
    local = np.einsum("mdc,mc->md", slope, at - middle) / np.sum(slope**2, axis=2)
    pool = candidates(mesh, facets, None, on_constraints=True).take(facet)
    points = points_within(mesh.position, pool, facets)
    points.local[:], points.direction[:] = local, tangent(direction, pool.normal)
    return matrix_of(mesh.position, points, len(at)) @ z


@pytest.mark.parametrize(("kind", "least"), [("hex8", 0.02), ("hex20", 0.005), ("tet4", 0.05), ("tet10", 0.01)])
def test_estimated_mesh_error_agrees_with_a_finer_mesh(kind, least):
    """RMS of the estimate over that of the error, of all gauges around the hole that read half the RMS strain."""
    mesh, cells = quarter_plate(kind, 4, 4)
    facets, z = exterior_facets(mesh), pulled(mesh)
    pool = candidates(mesh, facets, None, ANGLES, on_constraints=True)
    corners = 3 if kind.startswith("tet") else 4
    at = cells[pool.nodes[:, :corners]].mean(axis=1)
    inner = np.all((at[:, :2] > 1e-6), axis=1) & (at[:, 0] < 1 - 1e-6) & (at[:, 1] < 1 - 1e-6)
    reading, estimate = channel_matrix(mesh.position, pool, facets) @ z, error_of(mesh.position, pool, facets) @ z
    true = strain_on_fine_plate(at[inner], pool.direction[inner])
    large = np.abs(true) > 0.5 * np.sqrt(np.mean(true**2))
    error, estimate = (true - reading[inner])[large], estimate[inner][large]
    share = np.sqrt(np.mean(error**2) / np.mean(true[large] ** 2))
    assert share > least
    assert 0.3 < np.sqrt(np.mean(estimate**2) / np.mean(error**2)) < 3


def test_mesh_error_enters_rows_and_variance():
    position, facets = plate("quad4", 30, 20, 0.2)
    pool = concatenate(
        [
            candidates(bare(position), facets, (1, 0.2, 0.1), (0.0, 60.0), rosette=True),
            motion_candidates(bare(position), facets, ACCELERATION, ((1, 0.3, 0),)),
        ]
    )
    field = np.random.default_rng(4).standard_normal((position.size, 2))
    std, C = InstallationStd(mesh=0.5), np.array([[2.0, 0.3], [0.3, 1.0]])
    slopes = sensitivity_rows(position, pool, field, 0.0, facets=facets, mesh=True)
    assert not slopes.mesh[pool.quantity == ACCELERATION].any()
    installation = sample_installation(pool, std, np.random.default_rng(5))
    assert np.std(installation.mesh) == pytest.approx(0.5, rel=0.1)
    rows, _ = installed_rows(position, pool, field, installation, facets=facets)
    np.testing.assert_allclose(rows, slopes.gain + installation.mesh[:, None] * slopes.mesh, atol=1e-12)
    expected = 0.25 * np.einsum("mi,ij,mj->m", slopes.mesh, C, slopes.mesh)
    np.testing.assert_allclose(installation_variance(slopes, std, pool, C, C), expected)

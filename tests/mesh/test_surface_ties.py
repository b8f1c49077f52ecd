"""Nodes that follow the faces of another mesh, near or over a gap; the nearest point of a facet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.support import rigid_motions
from strainsight.mesh.connectivity import connectivity_warnings
from strainsight.mesh.joins import RigidElement
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.projection import nearest
from strainsight.mesh.surface_ties import with_surface_tie

from ..bodies import E, held, moved
from .boxes import FACE, TWO, both, box


def tied_bar(coarse, fine):
    """A cube of one cell and one of eight, tied, and which nodes are where they are tied."""
    mesh = both(box(coarse, (1, 1, 1)), box(fine, (2, 2, 2), at=(1, 0, 0)))
    steel = {i: replace(own, poisson_ratio=0.0) for i, own in mesh.materials.items()}
    at, own = mesh.position[:, 0] == 1, np.arange(len(mesh.position)) < len(box(coarse, (1, 1, 1)).position)
    mesh = replace(mesh, materials=steel)
    return with_surface_tie(mesh, np.flatnonzero(at & ~own), np.flatnonzero(at & own), 1e-6, "mesh.ties.0")


@pytest.mark.parametrize("coarse", ["tet4", "tet10", "hex8", "hex20", "wedge15"])
@pytest.mark.parametrize("fine", ["tet4", "hex20"])
def test_what_is_tied_to_a_surface_follows_every_linear_field_and_hangs_no_more(coarse, fine):
    mesh = tied_bar(coarse, fine)
    assert connectivity_warnings(mesh) == ()
    assert all(own.value[0] == 1 for own in mesh.relations)
    for field in (np.ones(len(mesh.position)), *mesh.position.T):
        np.testing.assert_allclose([own.value @ field[own.node] for own in mesh.relations], 0, atol=1e-13)


def tied_over(gap, kind="hex8", chart=lambda x, y, z: (x, y, z)):
    """A block of eight cells and one of 27, a gap [m] above it, tied."""
    mesh = both(box(kind), box(kind, (3, 3, 3), at=(0, 0, 1 + gap)))
    z, first = mesh.position[:, 2], np.arange(len(mesh.position)) < len(box(kind).position)
    fine, coarse = np.flatnonzero(~first & (z == z[~first].min())), np.flatnonzero(first & (z == 1))
    return with_surface_tie(replace(mesh, position=np.array(chart(*mesh.position.T)).T), fine, coarse, 0.1, "t")


@pytest.mark.parametrize("gap", [0.0, 1e-8, 1e-4])
@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet10"])
def test_a_tie_over_a_gap_follows_every_rigid_motion(gap, kind):
    def dome(x, y, z):
        return x + 0.1 * y * z, y, z - 0.2 * x**2 + 0.1 * x * y

    mesh = tied_over(gap, kind, dome)
    x = mesh.position
    for axis in np.eye(3):
        for u in (np.broadcast_to(axis, x.shape), np.cross(axis, x)):
            np.testing.assert_allclose(
                [own.value @ u[own.node, own.component] for own in mesh.relations], 0, atol=1e-12
            )


def test_blocks_that_are_tied_over_a_gap_are_one_free_structure():
    mesh = tied_over(1e-8)
    assert rigid_motions(mesh, constraint_transform(mesh)).shape[1] == 6


@pytest.mark.parametrize("code", range(len(FACETS)))
def test_the_nearest_point_of_a_curved_facet_is_the_foot_of_its_normal(code):
    kind = FACETS[code]
    nodes = np.column_stack([kind.nodes, 0.2 * kind.nodes[:, 0] ** 2 + 0.1 * kind.nodes[:, 0] * kind.nodes[:, 1]])[None]
    xi = np.array([[0.3, 0.1], [0.2, 0.6], [1.0, 0.0]])
    N, dN = kind.functions(xi)
    on, slopes = N @ nodes[0], np.einsum("mad,ac->mdc", dN, nodes[0])
    n = np.cross(slopes[:, 0], slopes[:, 1])
    n /= np.linalg.norm(n, axis=1)[:, None]
    feet = nearest(code, np.repeat(nodes, 3, axis=0), on + [[0.0], [1e-3], [-1e-2]] * n)
    np.testing.assert_allclose(feet.x, on, atol=1e-12)
    np.testing.assert_allclose(feet.apart, [0.0, 1e-3, 1e-2], atol=1e-12)


@pytest.mark.parametrize(("fine", "coarse"), [("hex8", "hex8"), ("tet10", "hex20")])
def test_a_bar_of_two_meshes_that_are_tied_is_stretched_as_one(fine, coarse):
    mesh = tied_bar(coarse, fine)
    n, end = len(mesh.position), mesh.position[:, 0] == 2
    mesh = held(held(mesh, mesh.position[:, 0] == 0), end, (1, 2))
    lead = RigidElement(1, n, np.flatnonzero(end), (0,))
    x = np.vstack([mesh.position, [2, 0.5, 0.5]])
    mesh = replace(mesh, position=x, node_ids=np.arange(1, n + 2), rigid=(lead,))
    mesh = held(mesh, np.arange(n + 1) == n, (3, 4, 5))
    force = np.zeros((n + 1, 3))
    force[-1, 0] = E
    u = moved(mesh, force).reshape(-1, 3)[:n]
    np.testing.assert_allclose(u, x[:n] * [1, 0, 0], atol=1e-11)


def test_a_node_beside_the_surface_is_refused():
    with pytest.raises(UserError, match=r"node \d+ does not lie on the surface, not within 0\.1 m"):
        with_surface_tie(TWO, np.flatnonzero(TWO.position[:, 0] == 2), FACE[0], 0.1, "mesh.ties.0")

"""Candidate bridges on both sides of a body: where the line through it leaves, which are one, what they read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.gauges.bridges import PATTERNS, bridges
from strainsight.gauges.candidates import candidates
from strainsight.gauges.opposite import opposite
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.walk import skin_of
from strainsight.gauges.zones import NormalCone
from strainsight.mesh.facets import Facets, exterior_facets

from ..bodies import body

KINDS = ("tet4", "tet10", "hex8", "hex20", "wedge6", "wedge15")
INNER, OUTER = 0.8, 1.0
UPRIGHT = [NormalCone((1, 0, 0), 10.0), NormalCone((0, 1, 0), 10.0)]
"""Sides of a box but for its top and bottom."""


def tube(kind, around=24, through=1, along=1):
    """A thick tube about x, its sections circles as well as the elements have them."""

    def chart(u, v, w):
        phi, r = 2 * np.pi * v / around, INNER + (OUTER - INNER) * w / through
        return (u / along, r * np.sin(phi), r * np.cos(phi))

    mesh = body(kind, (along, around, through), chart)
    return merged(mesh)


def merged(mesh):
    """Nodes in one place are one."""
    _, first, again = np.unique(np.round(mesh.position, 9), axis=0, return_index=True, return_inverse=True)
    again = again.ravel()
    blocks = tuple(replace(block, nodes=again[block.nodes]) for block in mesh.blocks)
    return replace(mesh, node_ids=np.arange(1, len(first) + 1), position=mesh.position[first], blocks=blocks)


def box(kind="hex20", counts=(6, 3, 2), size=(1.2, 0.3, 0.2)):
    return body(kind, counts, lambda *u: tuple(s * x / n for s, x, n in zip(size, u, counts, strict=True)))


@pytest.mark.parametrize("kind", KINDS)
def test_the_line_through_a_box_leaves_at_the_mirrored_place(kind):
    mesh = box(kind)
    facets = exterior_facets(mesh)
    skin = skin_of(mesh.position, facets)
    rng, size = np.random.default_rng(4), np.array([1.2, 0.3, 0.2])
    for axis in range(3):
        points = rng.uniform(0.001, 0.999, (12, 3)) * size
        points[:, axis] = size[axis]
        normal = np.tile(np.eye(3)[axis], (12, 1))
        found = opposite(skin, points, normal)
        points[:, axis] = 0
        np.testing.assert_allclose(found.point, points, atol=1e-9)
        np.testing.assert_allclose(found.distance, size[axis], rtol=1e-9)
        np.testing.assert_allclose(skin.normal[found.facet], -normal, atol=1e-9)


@pytest.mark.parametrize("kind", ["hex20", "tet10"])
def test_the_first_exit_of_a_tube_is_its_inner_wall_from_outside_and_its_outer_one_from_inside(kind):
    """A circle of 24 parabolas is off by 2e-5 of its radius at most."""
    mesh = tube(kind)
    skin = skin_of(mesh.position, exterior_facets(mesh))
    phi, x = np.linspace(0.05, 6.2, 37), np.full(37, 0.41)
    radial = np.column_stack([np.zeros(37), np.sin(phi), np.cos(phi)])
    outside = opposite(skin, np.column_stack([x, OUTER * radial[:, 1:]]), radial)
    np.testing.assert_allclose(outside.point, np.column_stack([x, INNER * radial[:, 1:]]), atol=5e-5)
    inside = opposite(skin, np.column_stack([x, INNER * radial[:, 1:]]), -radial)
    np.testing.assert_allclose(inside.point, np.column_stack([x, OUTER * radial[:, 1:]]), atol=5e-5)


def test_a_large_facet_between_small_ones_is_met():
    """Facets of 1 to 40 in size: the step is that of the largest, and none is passed over."""
    edges = np.array([0, 0.01, 0.02, 0.03, 0.43, 0.44])
    mesh = body(
        "hex8", (5, 5, 1), lambda u, v, w: (np.interp(u, range(6), edges), np.interp(v, range(6), edges), 0.05 * w)
    )
    skin = skin_of(mesh.position, exterior_facets(mesh))
    points = np.column_stack([*np.random.default_rng(0).uniform(1e-4, 0.4399, (2, 200)), np.full(200, 0.05)])
    found = opposite(skin, points, np.tile([0.0, 0, 1], (200, 1)))
    np.testing.assert_allclose(found.point, points * [1, 1, 0], atol=1e-12)


def test_a_surface_that_is_open_has_places_without_an_exit():
    mesh = box("hex8")
    facets = exterior_facets(mesh)
    top = np.flatnonzero(np.abs(mesh.position[facets.nodes[:, :4], 2] - 0.2).max(axis=1) < 1e-9)
    own = Facets(*(getattr(facets, c)[top] for c in ("element_id", "facet", "kind", "nodes", "region")))
    found = opposite(skin_of(mesh.position, own), np.array([[0.5, 0.1, 0.2]]), np.array([[0.0, 0, 1]]))
    assert found.facet[0] == -1


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("shear", [0.0, 0.3])
def test_patterns_read_what_they_are_for_in_uniform_and_linear_strain(pattern, shear):
    """Bending, stretch and a twist without warping: on top and bottom of a plate, z = ±h, ε = b + a z and γ_xy = −s z."""
    mesh = box()
    facets = exterior_facets(mesh)
    pool = candidates(mesh, facets, (1, 0, 0), exclude=UPRIGHT)
    found = bridges(skin_of(mesh.position, facets), pool, pattern, np.arange(len(facets.element_id)))
    assert found.alone == 0
    assert found.twice == len(pool) // 2
    assert len(found.candidates) == len(pool) // 2
    x, y, z = (mesh.position - [0, 0.15, 0.1]).T
    a, b, s = 2e-3, 5e-4, shear * 1e-2
    u = np.column_stack([a * x * z + b * x, -s * x * z, s * x * y - a * x**2 / 2])
    reading = channel_rows(mesh.position, found.candidates, u.reshape(-1, 1), facets=facets)[:, 0]
    side = found.candidates.normal[:, 2]
    expected = {
        "half-bending": 2 * a * 0.1 * side,
        "full-bending": 4 * a * 0.1 * side,
        "half-axial": np.full(len(side), 2 * b),
        "full-torsion": np.full(len(side), 2 * -s * 0.1),
    }[pattern]
    np.testing.assert_allclose(reading, expected, atol=1e-12)


def test_of_two_bridges_that_are_one_the_lower_number_stays():
    """With angles of 0° and 45°, and of torsion of 0° and 90°, which is one bridge with its signs turned."""
    mesh = box()
    facets = exterior_facets(mesh)
    skin, every = skin_of(mesh.position, facets), np.arange(len(facets.element_id))
    for pattern, angles, least in (
        ("half-bending", (0.0, 45.0, -45.0), 3),
        ("half-bending", (0.0, 45.0), 3),
        ("full-torsion", (0.0, 90.0), 1),
        ("full-torsion", (0.0, 45.0, 90.0, -45.0), 2),
    ):
        pool = candidates(mesh, facets, (1, 0, 0), angles, exclude=UPRIGHT)
        found = bridges(skin, pool, pattern, every)
        places = len(pool) // len(angles) // 2
        assert len(found.candidates) == least * places
        assert found.twice == len(pool) - least * places
        own = sets_of(found.candidates, pattern)
        assert len(set(own)) == len(own)
        if least == 1:
            assert np.all(found.candidates.position[:, 2] == found.candidates.position[0, 2])


def sets_of(pool, pattern):
    """Every bridge as the places and axes of its arms with their signs, by the sign of the first of these."""
    grids, channel, sign = pool.grids, pool.channel_of_grid, pool.sign_of_grid
    keys = []
    for c in range(len(pool)):
        own = np.flatnonzero(channel == c)
        axes = [np.outer(d, d).ravel() for d in grids.direction[own]]
        places = [tuple(np.round([*x, *axis], 6) + 0.0) for x, axis in zip(grids.position[own], axes, strict=True)]
        arms = sorted(zip(places, sign[own], strict=True))
        keys.append(tuple((place, own * arms[0][1]) for place, own in arms))
    return keys


def test_a_side_that_admits_no_gauge_leaves_its_bridges_out():
    mesh = box()
    facets = exterior_facets(mesh)
    pool = candidates(mesh, facets, (1, 0.1, 0.2))
    skin, every = skin_of(mesh.position, facets), np.arange(len(facets.element_id))
    above = skin.normal[:, 2] > 0.5
    free = pool.take(np.flatnonzero(pool.normal[:, 2] < 0.5))
    found = bridges(skin, free, "half-bending", every[~above])
    assert found.alone == np.sum(np.abs(free.position[:, 2]) < 1e-9) == 18
    assert np.all(np.abs(found.candidates.grids.normal[:, 2]) < 0.5)
    assert len(bridges(skin, free.take(np.arange(0)), "half-bending", every).candidates) == 0


def test_a_direction_that_is_steep_on_the_other_side_leaves_the_bridge_out():
    """Through a wedge whose upper side rises by a half: d is laid on it, and left out where it is its normal."""
    mesh = body("hex20", (4, 2, 2), lambda u, v, w: (u, v, w * (0.2 + u / 4)))  # z rises by 2 u/4 on top
    facets = exterior_facets(mesh)
    skin = skin_of(mesh.position, facets)
    below = facets_of(skin, lambda n: n[:, 2] < -0.9)
    pool = candidates(mesh, facets, (1, 0, 0), exclude=[NormalCone((1, 0, 0), 10.0)])
    pool = pool.take(np.flatnonzero(pool.normal[:, 2] < -0.9))
    found = bridges(skin, pool, "half-axial", np.arange(len(facets.element_id)))
    assert (found.alone, len(found.candidates)) == (0, len(below))
    np.testing.assert_allclose(found.candidates.arms.grid.direction, np.tile([2, 0, 1] / np.sqrt(5), (8, 1)), atol=1e-9)
    steep = replace(pool, direction=np.tile([-1.0, 0, 2] / np.sqrt(5), (8, 1)))
    assert bridges(skin, steep, "half-axial", np.arange(len(facets.element_id))).alone == 8


def facets_of(skin, where):
    return np.flatnonzero(where(skin.normal))

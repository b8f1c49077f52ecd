"""The nearest point of a surface, and gauges that are bonded there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.gauges.bonded import BondedEntry, bonded
from strainsight.gauges.candidates import candidates
from strainsight.gauges.locate import locate, project
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.walk import skin_of
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.kinds import FACETS

KINDS = {kind.name: kind for kind in FACETS if not len(kind.read_at)}


def sampled(name: str, n: int) -> np.ndarray:
    """A fine lattice of the reference facet, its borders included."""
    line = np.linspace(0, 1, n)
    u, v = (grid.ravel() for grid in np.meshgrid(line, line))
    return np.column_stack([u, v * (1 - u)]) if name.startswith("tri") else 2 * np.column_stack([u, v]) - 1


@pytest.mark.parametrize("name", KINDS)
def test_on_one_bent_facet_no_sample_is_nearer(name):
    """Points in the facet's plane, above it, beside it, far away; the facet shaken by 10 % of its size in all directions."""
    rng = np.random.default_rng(0)
    kind = KINDS[name]
    plane = kind.nodes
    corners = np.column_stack([plane, np.zeros(len(plane))]) + 0.1 * rng.uniform(-1, 1, (len(plane), 3))
    points = rng.uniform(-1, 1, (100, 3)) * np.repeat([0.3, 1.0, 2.0, 10.0], 25)[:, None] + corners.mean(axis=0)
    xi, x = project(kind, np.broadcast_to(corners, (100, *corners.shape)), points)
    np.testing.assert_allclose(kind.shape(xi) @ corners, x, atol=1e-13)
    if name.startswith("tri"):
        assert xi.min() >= -1e-15
        assert xi.sum(axis=1).max() <= 1 + 1e-15
    else:
        assert np.abs(xi).max() <= 1
    lattice = kind.shape(sampled(name, 201)) @ corners
    brute = np.linalg.norm(lattice[None] - points[:, None], axis=2).min(axis=1)
    own = np.linalg.norm(x - points, axis=1)
    assert np.all(own <= brute * (1 + 1e-12))
    # And not nearer than a lattice of 0.005 can miss.
    assert np.all(own >= brute - 0.03)


@pytest.mark.parametrize("kind", KINDS)
def test_points_on_a_surface_are_found_where_they_are(kind, tube):
    position, facets = tube(kind, 12, 3, 1.5, 0.15)
    skin = skin_of(position, facets)
    rng = np.random.default_rng(0)
    which = rng.integers(0, len(facets.kind), 80)
    xi = rng.uniform(0.02, 0.98, (80, 2))
    xi = np.column_stack([xi[:, 0], xi[:, 1] * (1 - xi[:, 0])]) if kind.startswith("tri") else 2 * xi - 1
    nodes = facets.nodes[which][:, : len(KINDS[kind].nodes)]
    points = np.einsum("pk,pkc->pc", KINDS[kind].shape(xi), position[nodes])
    found = locate(skin, points)
    np.testing.assert_allclose(found.distance, 0, atol=1e-12)
    np.testing.assert_allclose(found.point, points, atol=1e-12)
    np.testing.assert_array_equal(found.facet, which)
    np.testing.assert_allclose(found.local, xi, atol=1e-9)


@pytest.mark.parametrize("kind", ["tri6", "quad8"])
def test_beside_a_tube_the_distance_is_that_of_the_cylinder(kind, tube):
    R = 2.0
    position, facets = tube(kind, 32, 3, R, 0.1)
    nodes = facets.nodes[:, : len(KINDS[kind].nodes)]
    lattice = np.einsum("qk,fkc->fqc", KINDS[kind].shape(sampled(kind, 15)), position[nodes])
    astray = np.abs(np.hypot(lattice[..., 0], lattice[..., 1]) - R).max()
    assert astray < 1e-3 * R
    rng = np.random.default_rng(1)
    r, phi, z = rng.uniform(0.8, 6, 60), rng.uniform(0, 2 * np.pi, 60), rng.uniform(-3, 6, 60)
    points = np.column_stack([r * np.cos(phi), r * np.sin(phi), z])
    along = np.maximum(np.maximum(-z, z - 3), 0)
    found = locate(skin_of(position, facets), points)
    # The facets are parabolas; two surfaces are as near to a point but for how far they are apart.
    np.testing.assert_allclose(found.distance, np.hypot(r - R, along), atol=1.1 * astray)


@pytest.mark.parametrize("kind", KINDS)
def test_all_facets_asked_one_by_one_know_none_nearer(kind, plate):
    """A large facet beside small ones: its centre is far, itself near."""
    position, facets = plate(kind, 6, 2, 0.2)
    position = position * [1, 1, 1] + np.column_stack([np.zeros((len(position), 2)), 0.2 * np.sin(3 * position[:, 0])])
    position[:, 0] = position[:, 0] ** 3 / 10
    points = np.random.default_rng(2).uniform([-2, -2, -2], [24, 4, 2], (50, 3))
    found = locate(skin_of(position, facets), points)
    least = np.full(50, np.inf)
    for nodes in facets.nodes[:, : len(KINDS[kind].nodes)]:
        _, x = project(KINDS[kind], np.broadcast_to(position[nodes], (50, len(nodes), 3)), points)
        least = np.minimum(least, np.linalg.norm(x - points, axis=1))
    np.testing.assert_allclose(found.distance, least, rtol=1e-8, atol=1e-10)


def test_of_two_facets_equally_near_the_first_counts(plate):
    position, facets = plate("quad4", 2, 2)
    found = locate(skin_of(position, facets), np.array([[1.0, 1.0, 0.3], [1.0, 0.5, 0.0]]))
    np.testing.assert_array_equal(found.facet, [0, 0])
    np.testing.assert_allclose(found.local, [[1, 1], [1, 0]], atol=1e-12)


def test_a_bonded_gauge_lies_on_the_surface_along_its_direction(tube, bare):
    R = 1.0
    position, facets = tube("quad8", 40, 4, R)
    entries = [
        BondedEntry((1.001, 0.0, 2.1), (0.2, 0.0, 3.0), 0.05),
        BondedEntry((0.0, 0.999, 1.3), (1.0, 0.3, 0.0), 0.0, (0.0, 45.0, 90.0)),
    ]
    pool, distance = bonded(bare(position), facets, entries, 0.005)
    np.testing.assert_allclose(distance, 0.001, atol=1e-5)
    np.testing.assert_array_equal(pool.gauge, [0, 1, 1, 1])
    np.testing.assert_array_equal(pool.angle, [0, 0, 45, 90])
    np.testing.assert_array_equal(pool.length, [0.05, 0, 0, 0])
    assert pool.bonded.all()
    np.testing.assert_allclose(pool.position[:2], [[R, 0, 2.1], [0, R, 1.3]], atol=1e-4)
    expected = [[0, 0, 1], [1, 0, 0], np.array([1, 0, -1]) / np.sqrt(2), [0, 0, -1]]
    np.testing.assert_allclose(pool.direction, expected, atol=2e-3)
    # Off the centres of the facets, and read there.
    assert np.abs(pool.local).max() > 0.1
    G = np.random.default_rng(0).standard_normal((3, 3))
    rows = channel_rows(position, pool, (position @ G.T).reshape(-1, 1), facets=facets)
    d = pool.direction
    np.testing.assert_allclose(rows[:, 0], np.einsum("mi,ij,mj->m", d, G, d), atol=2e-3)


def test_bonded_where_a_candidate_sits_it_is_that_candidate(box_mesh):
    facets = exterior_facets(box_mesh)
    pool = candidates(box_mesh, facets, (1, 0.2, 0.4), (30.0,))
    entries = [BondedEntry(x + 1e-4 * n, d) for x, n, d in zip(pool.position, pool.normal, pool.direction, strict=True)]
    found, distance = bonded(box_mesh, facets, entries, 1e-3)
    np.testing.assert_allclose(distance, 1e-4, rtol=1e-6)
    for name in ("element", "facet", "nodes"):
        np.testing.assert_array_equal(getattr(found, name), getattr(pool, name))
    for name in ("position", "direction", "normal", "local"):
        np.testing.assert_allclose(getattr(found, name), getattr(pool, name), atol=1e-12)


GOOD = BondedEntry((0.45, 0.12, 0.2), (1, 0, 0))


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        (replace(GOOD, position=(0.45, 0.12, 0.206)), "bonded gauge 2 is 0.006 m from the surface .*, beyond 0.005 m"),
        (replace(GOOD, direction=(0.1, 0, 1)), "bonded gauge 2 has a direction at 5.71° to the normal"),
        (replace(GOOD, direction=(0, 0, 0)), "bonded gauge 2 has the direction"),
        (replace(GOOD, position=(0.45, np.nan, 0.2)), "bonded gauge 2 has the position"),
        (
            replace(GOOD, position=(0.45, 0.297, 0.2), direction=(0, 1, 0), length=0.01),
            "bonded gauge 2 has a grid of 0.01 m",
        ),
        (
            replace(GOOD, position=(0.45, 0.12, 0.201), direction=(-2, 0, 0)),
            "gauge 2 is in the place and direction of gauge 1",
        ),
    ],
)
def test_what_cannot_be_bonded_is_refused_by_its_number(entry, says, box_mesh):
    with pytest.raises(UserError, match=says) as caught:
        bonded(box_mesh, exterior_facets(box_mesh), [GOOD, entry], 0.005)
    assert caught.value.key == "gauges.fixed.1"


def test_two_gauges_in_one_place_across_one_another_are_two(box_mesh):
    pool, _ = bonded(box_mesh, exterior_facets(box_mesh), [GOOD, replace(GOOD, direction=(0, 1, 0))], 0.005)
    assert pool.gauges == 2
    none, distance = bonded(box_mesh, exterior_facets(box_mesh), [], 0.005)
    assert len(none) == len(distance) == 0


def test_facets_of_several_kinds_lie_side_by_side():
    """A quad4 and a tri6 that share an edge's corners only in space."""
    position = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0.0], [1.5, 0, 0], [1.5, 0.5, 0], [1, 0.5, 0]]
    )
    nodes = np.array([[0, 1, 2, 3, -1, -1, -1, -1], [1, 4, 2, 5, 6, 7, -1, -1]])
    ones = np.ones(2, dtype=int)
    facets = Facets(element_id=np.array([1, 2]), facet=ones, kind=np.array([2, 1]), nodes=nodes, region=ones)
    found = locate(skin_of(position, facets), np.array([[0.4, 0.4, 1.0], [1.3, 0.2, -2.0], [3, 0, 0]]))
    np.testing.assert_array_equal(found.facet, [0, 1, 1])
    np.testing.assert_allclose(found.distance, [1, 2, 1], atol=1e-12)

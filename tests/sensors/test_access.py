"""Where a gauge can be bonded: room over it, clearance, and what lies opposite."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.joins import Relation
from strainsight.sensors.access import opposite, room
from strainsight.sensors.bonded import PATTERNS, bridges
from strainsight.sensors.candidates import candidates
from strainsight.sensors.edges import carrier, carrier_clearance, crowded, obstacles, spaced
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.surface import facet_centres
from strainsight.sensors.surface_paths import skin_of
from strainsight.sensors.zones import NormalCone

from ..bodies import body, stacked

KINDS = ("tet10", "hex8", "wedge15")
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


def test_the_first_exit_of_a_tube_is_its_inner_wall_from_outside_and_its_outer_one_from_inside():
    """A circle of 24 parabolas is off by 2e-5 of its radius at most."""
    mesh = tube("hex20")
    skin = skin_of(mesh.position, exterior_facets(mesh))
    phi, x = np.linspace(0.05, 6.2, 37), np.full(37, 0.41)
    radial = np.column_stack([np.zeros(37), np.sin(phi), np.cos(phi)])
    outside = opposite(skin, np.column_stack([x, OUTER * radial[:, 1:]]), radial)
    np.testing.assert_allclose(outside.point, np.column_stack([x, INNER * radial[:, 1:]]), atol=5e-5)
    inside = opposite(skin, np.column_stack([x, INNER * radial[:, 1:]]), -radial)
    np.testing.assert_allclose(inside.point, np.column_stack([x, OUTER * radial[:, 1:]]), atol=5e-5)


def test_a_large_facet_between_small_ones_is_met():
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


def over(mesh, reach=10.0, axis=(1, 0, 0), of=None):
    """Gauges along an axis on every facet that it does not stand on, and the room over them; of: a part of the mesh."""
    facets = exterior_facets(mesh)
    every = candidates(mesh, facets, None) if of is None else candidates(of, exterior_facets(of), None)
    gauges = every.take(np.flatnonzero(np.abs(every.normal @ np.array(axis)) < 0.9))
    return gauges, room(skin_of(mesh.position, facets), gauges, reach)


def test_in_a_bore_it_is_the_chord_at_45_degrees_and_outside_there_is_no_end():
    """Rays from a point of a circle of diameter D: D along the normal, D cos 45° slanted."""
    mesh = tube("hex8")
    gauges, found = over(mesh)
    inside = np.sum(gauges.position[:, 1:] * gauges.normal[:, 1:], axis=1) < 0
    assert 10 < np.count_nonzero(inside) < len(inside) - 10
    assert np.isinf(found[~inside]).all()
    np.testing.assert_allclose(found[inside], np.sqrt(2) * INNER, rtol=0.02)
    _, near = over(mesh, reach=1.1)
    assert np.isinf(near).all()


def channel(kind, width, depth, walls=(True, True)):
    """A groove along x in a block of unit cells, `width` wide, `depth` deep, over one layer; walls of one cell or none."""
    rows = width + sum(walls)
    first = int(walls[0])
    return body(
        kind, (6, rows, 1 + depth), lambda *u: tuple(float(x) for x in u),
        keep=lambda i, j, k: k == 0 or (walls[0] and j == 0) or (walls[1] and j == rows - 1),
    ), first  # fmt: skip


def floor_of(gauges, first, width):
    x, n = gauges.position, gauges.normal
    return (np.abs(x[:, 2] - 1) < 1e-9) & (n[:, 2] > 0.9) & (x[:, 1] > first) & (x[:, 1] < first + width)


def test_on_the_floor_of_a_groove_it_is_the_way_to_the_farther_wall_and_on_a_wall_its_width():
    mesh, first = channel("hex8", 2, 3)
    gauges, found = over(mesh)
    floor = floor_of(gauges, first, 2)
    y = gauges.position[floor, 1] - first
    assert floor.any()
    np.testing.assert_allclose(found[floor], np.sqrt(2) * np.maximum(y, 2 - y), rtol=1e-4)
    wall = (np.abs(np.abs(gauges.position[:, 1] - first - 1) - 1) < 1e-9) & (gauges.position[:, 2] > 1)
    inner = wall & (np.sign(gauges.normal[:, 1]) == np.sign(first + 1 - gauges.position[:, 1]))
    assert inner.any()
    np.testing.assert_allclose(found[inner], 2.0, rtol=1e-4)
    assert np.isinf(found[~floor & ~inner]).all()


@pytest.mark.parametrize("shift", [0.0, 0.25])
def test_below_a_part_that_touches_there_is_no_room(shift):
    one = box("hex8")
    size = np.ptp(one.position, axis=0)
    mesh = stacked(one, np.array([shift, 0.0, size[2]]))
    low, many = one.position.min(axis=0), 0
    for part in (one, replace(one, position=mesh.position[len(one.position) :])):
        gauges, found = over(mesh, of=part)
        x = gauges.position
        touching = np.abs(x[:, 2] - low[2] - size[2]) < 1e-9
        below, above = gauges.normal[:, 2] > 0.9, gauges.normal[:, 2] < -0.9
        covered = touching & ((below & (x[:, 0] > low[0] + shift)) | (above & (x[:, 0] < low[0] + size[0])))
        many += np.count_nonzero(covered)
        assert np.all(found[covered] == 0)
        assert np.isinf(found[~covered]).all()
    assert many >= 8
    gauges, found = over(mesh)
    assert len(found) > 0
    assert np.isinf(found).all(), "where no hand gets at no gauge is a candidate"


def test_over_a_shallow_groove_and_with_one_wall_alone_a_hand_comes_in():
    for mesh, first, width in ((*channel("hex8", 2, 1), 2), (*channel("hex8", 2, 3, (True, False)), 2)):
        gauges, found = over(mesh)
        floor = floor_of(gauges, first, width)
        assert floor.any()
        assert np.isinf(found[floor]).all()


L, W, H = 1.0, 0.3, 0.2


def test_the_clearance_holds_the_carrier_however_it_is_turned():
    length, width = carrier(0.006)
    corners = 0.5 * np.array([[length, width], [length, -width], [-length, width], [-length, -width]])
    turns = np.deg2rad(np.arange(360))
    reach = [np.abs(corners @ [np.cos(t), np.sin(t)]).max() for t in turns]
    assert carrier_clearance(0.006) == pytest.approx(max(reach), rel=1e-3)
    assert carrier_clearance(0.0) == carrier_clearance(0.003)
    # where no length is stated, as the manual says
    assert carrier(0.0) == pytest.approx((0.008, 0.0045))
    assert carrier_clearance(0.0) == pytest.approx(0.0046, abs=5e-5)


def to_box_edge(x):
    """Distance to the nearest of the twelve edges of the box, in closed form: two of three coordinates on a side."""
    aside = np.minimum(x, np.array([L, W, H]) - x)
    return np.sqrt(np.sort(aside, axis=1)[:, 0] ** 2 + np.sort(aside, axis=1)[:, 1] ** 2)


@pytest.mark.parametrize("distance", [0.049, 0.06, 0.11])
def test_what_is_too_near_is_found_by_straight_lines(box_mesh, distance):
    """Edges of the box, the held face x = 0, the tied one x = 1 m, a loaded patch of four nodes: distances in closed form."""
    facets = exterior_facets(box_mesh)
    centre, _ = facet_centres(box_mesh.position, facets.kind, facets.nodes)
    x, y, z = box_mesh.position.T
    loaded = np.flatnonzero((z == H) & (np.abs(x - 0.55) < 0.06) & (np.abs(y - 0.15) < 0.06))
    assert len(loaded) == 4
    near = crowded(centre, obstacles(box_mesh, facets, loaded), distance)
    np.testing.assert_array_equal(near["edges"], to_box_edge(centre) < distance)
    # the boundary of the patch and the ends of the bar: no facet's centre lies over the inside of a mesh line nearer than that
    beside = np.linalg.norm(np.maximum(np.abs(centre - [0.55, 0.15, H]) - [0.05, 0.05, 0.0], 0), axis=1)
    inside = beside == 0
    np.testing.assert_array_equal(near["loads"][~inside], beside[~inside] < distance)
    assert near["loads"][inside].all() == (distance > 0.05)
    along = np.minimum(centre[:, 0], L - centre[:, 0])
    on_face = along == 0
    np.testing.assert_array_equal(near["supports"][~on_face], along[~on_face] < distance)


def test_spaced_points_are_counted_once():
    line = np.zeros((11, 3))
    line[:, 0] = 0.1 * np.arange(11)
    twice = np.repeat(line, 2, axis=0)
    assert len(spaced(twice, 0.2)) == 6
    assert len(spaced(twice, 0.0)) == 11
    assert len(spaced(twice, 0.0, 4)) == 4
    assert len(spaced(twice[:0], 0.2, 4)) == 0


def test_nodes_of_relations_are_kept_clear_as_those_of_ties(box_mesh):
    facets, loaded = exterior_facets(box_mesh), np.zeros(0, dtype=np.int64)
    tied = np.concatenate([tie.nodes for tie in (*box_mesh.rigid, *box_mesh.averaging)])
    one = Relation(1, tied, np.zeros(len(tied), int), np.ones(len(tied)))
    related = replace(box_mesh, rigid=(), averaging=(), relations=(one,))
    own, other = (obstacles(mesh, facets, loaded)["supports"] for mesh in (related, box_mesh))
    np.testing.assert_array_equal(own, other)
    assert len(own) > len(obstacles(replace(related, relations=()), facets, loaded)["supports"]) > 0

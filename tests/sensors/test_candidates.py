"""Candidates of gauges, and their mirror images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import InfeasibleError, UserError
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.joins import AveragingElement
from strainsight.mesh.model import Mesh
from strainsight.sensors.bonded import BondedEntry, bonded, imported_pool
from strainsight.sensors.candidates import DISPLACEMENT, candidates, concatenate, motion_candidates, tangents
from strainsight.sensors.edges import near_segments, sharp_edges
from strainsight.sensors.symmetry import mirror_partners
from strainsight.sensors.zones import Box, NearEdges

from ..refusals import expect_refusal
from .conftest import bricks, tube

NX, NY, NZ = 10, 3, 2


def box() -> Mesh:
    """10 × 3 × 2 hexahedra of edge 0.1 m, clamped at x = 0, with an RBE2 that holds the nodes at x = 1 m; ids of their own."""
    mesh = bricks()
    ids, (block,) = 10 * mesh.node_ids, mesh.blocks
    return replace(
        mesh,
        node_ids=ids,
        blocks=(replace(block, ids=block.ids + 99),),
        node_sets={"top": ids[:-1][np.isclose(mesh.position[:-1, 2], 0.2)]},
        element_sets={"first": np.array([100, 106, 112])},
    )


@pytest.fixture(scope="module")
def beam() -> tuple[Mesh, Facets]:
    mesh = box()
    return mesh, exterior_facets(mesh)


def test_facets_on_clamped_and_rigid_nodes_are_left_out(beam):
    gauges = candidates(*beam, (1, 0, 0))
    assert len(gauges) == 8 * 2 * (NY + NZ)
    assert gauges.position[:, 0].min() == pytest.approx(0.15)
    assert gauges.position[:, 0].max() == pytest.approx(0.85)


def test_clamped_rotations_of_solid_nodes_are_ignored(beam):
    mesh, facets = beam
    turned = np.array([(node, component) for node in np.unique(mesh.blocks[0].nodes) for component in (3, 4, 5)])
    same = replace(mesh, fixed=np.vstack([mesh.fixed, turned]))
    assert list(same.held) == list(np.unique(mesh.fixed[:, 0]))
    assert np.array_equal(candidates(same, facets, (1, 0, 0)).position, candidates(mesh, facets, (1, 0, 0)).position)


def test_facets_on_averaging_nodes_are_left_out(beam):
    mesh, facets = beam
    node = int(np.flatnonzero(np.all(np.isclose(mesh.position, [0.5, 0.1, 0.2]), axis=1))[0])
    averaged = replace(
        mesh, averaging=(AveragingElement(2, len(mesh.position) - 1, np.array([node]), np.ones(1), (0,)),)
    )
    assert len(candidates(mesh, facets, (1, 0, 0))) - len(candidates(averaged, facets, (1, 0, 0))) == 4


def test_facets_on_constraints_can_be_asked_for(beam):
    mesh, facets = beam
    around = candidates(mesh, facets, (1, 0.5, 0.3), on_constraints=True)
    assert len(around) == 2 * (NX * NY + NX * NZ + NY * NZ)


def test_zero_degrees_is_the_axis_projected_and_angles_turn_right_handed_about_the_normal(beam):
    axis = np.array([3.0, 1.0, 0.5])
    gauges = candidates(*beam, axis, (0.0, 30.0, 90.0))
    n = gauges.normal[::3]
    zero, thirty, ninety = gauges.direction[::3], gauges.direction[1::3], gauges.direction[2::3]
    projected = axis - (n @ axis)[:, None] * n
    np.testing.assert_allclose(zero, projected / np.linalg.norm(projected, axis=1)[:, None], atol=1e-14)
    np.testing.assert_allclose(ninety, np.cross(n, zero), atol=1e-14)
    np.testing.assert_allclose(thirty, np.sqrt(0.75) * zero + 0.5 * ninety, atol=1e-14)
    np.testing.assert_array_equal(gauges.angle[:3], [0.0, 30.0, 90.0])
    np.testing.assert_array_equal(gauges.element[::3], gauges.element[2::3])


def test_a_surface_is_an_element_set_or_a_node_set(beam):
    top = candidates(*beam, (1, 0, 0), surface="top")
    assert len(top) == 8 * NY
    np.testing.assert_allclose(top.normal, np.tile([0, 0, 1], (len(top), 1)), atol=1e-15)
    first = candidates(*beam, (1, 0, 0), surface="first")
    assert set(first.element) <= {100, 106, 112}
    assert len(first) == 4


def test_missing_set_is_refused_with_known_sets(beam):
    for name, said in (("topp", "did you mean top?"), ("lid", "first, top")):
        with expect_refusal(UserError, f"the mesh has no face, element set or node set '{name}'", remedy=said):
            candidates(*beam, (1, 0, 0), surface=name)


def test_excluded_zones_have_no_candidates(beam):
    mesh, facets = beam
    zones = (Box((0.0, -1.0, -1.0), (0.4, 1.0, 1.0)), Box((0.4, -1.0, 0.19), (2.0, 1.0, 1.0)))
    gauges = candidates(mesh, facets, (1, 0, 0), exclude=zones)
    assert gauges.position[:, 0].min() == pytest.approx(0.45)
    assert gauges.position[:, 2].max() < 0.19
    assert len(gauges) == 5 * (2 * NZ + NY)


def test_near_edges_zone_has_no_candidates(beam):
    assert len(candidates(*beam, (1, 0, 0), exclude=(NearEdges(0.0499),))) == 80
    inner = candidates(*beam, (1, 0, 0), exclude=(NearEdges(0.0501),))
    np.testing.assert_allclose(inner.position[:, 1], 0.15)
    assert len(inner) == 2 * 8


def test_an_axis_near_a_normal_is_refused_with_an_example(beam):
    for tilt, bad in ((9.9, True), (10.1, False)):
        axis = (np.sin(np.deg2rad(tilt)), 0.0, np.cos(np.deg2rad(tilt)))
        if not bad:
            candidates(*beam, axis)
            continue
        with pytest.raises(InfeasibleError, match=r"normal of 48 of 80 facets \(for example element \d+, facet \d\)") as error:
            candidates(*beam, axis)
        assert "gauges.surface" in error.value.remedy


@pytest.mark.parametrize("axis", [(0, 0, 0), (np.nan, 0, 0), (1, 0)])
def test_an_axis_without_direction_is_refused(beam, axis):
    with pytest.raises(UserError, match="gauge axis"):
        candidates(*beam, axis)


def test_a_facet_without_area_carries_no_gauge():
    position = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]])
    nodes = np.full((2, 8), -1)
    nodes[0, :3], nodes[1, :3] = [0, 1, 2], [0, 1, 3]
    facets = Facets(
        element_id=np.array([1, 2]), facet=np.ones(2, int), kind=np.zeros(2, int), nodes=nodes, region=np.ones(2, int)
    )
    mesh = Mesh(np.arange(1, 5), position, ())
    np.testing.assert_array_equal(candidates(mesh, facets, (1, 0, 0)).element, [2])


@pytest.mark.parametrize(("sides", "kind", "sharp"), [(8, "quad8", 0), (8, "quad4", 8), (16, "quad4", 0)])
def test_a_tube_is_smooth_when_its_facets_can_bend(sides, kind, sharp):
    """Eight quadratic facets go round without an edge; eight flat ones meet at 45°, sixteen at 22.5°."""
    segments = sharp_edges(*tube(kind, sides, 1, 1.0))
    along = np.abs((segments[:, 1] - segments[:, 0])[:, 2]) > 0.1
    assert np.count_nonzero(along) == 2 * sharp


def test_distances_to_segments_are_those_of_a_fine_sampling():
    rng = np.random.default_rng(0)
    points, segments = rng.uniform(0, 1, (60, 3)), rng.uniform(0, 1, (7, 2, 3))
    segments[0, 1] = segments[0, 0]
    s = np.linspace(0, 1, 2001)[:, None]
    distance = np.full(60, np.inf)
    for a, b in segments:
        line = a + s * (b - a)
        for i in range(60):
            distance[i] = min(distance[i], np.linalg.norm(line - points[i], axis=1).min())
    for limit in (0.05, 0.2, 0.5):
        clear = np.abs(distance - limit) > 1e-6
        np.testing.assert_array_equal(near_segments(points, segments, limit)[clear], (distance < limit)[clear])


def test_rounding_of_a_normal_chooses_no_other_tangent():
    rng = np.random.default_rng(0)
    for normal, tangent in ((np.eye(3)[0], [0, 1, 0]), (np.eye(3)[1], [1, 0, 0]), (-np.eye(3)[2], [1, 0, 0])):
        shaken = normal + 1e-15 * rng.standard_normal((50, 3))
        np.testing.assert_allclose(tangents(shaken), np.tile(tangent, (50, 1)), atol=1e-14)
    diagonal = np.full((50, 3), 1 / np.sqrt(3)) + 1e-15 * rng.standard_normal((50, 3))
    np.testing.assert_allclose(tangents(diagonal), np.tile(np.array([2, -1, -1]) / np.sqrt(6), (50, 1)), atol=1e-14)


MIDDLE = (0.0, 0.15, 0.0)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e4])
def test_on_a_beam_every_gauge_along_it_has_the_one_across(scale, box_mesh):
    mesh = replace(box_mesh, position=scale * box_mesh.position)
    pool = candidates(mesh, exterior_facets(mesh), (1, 0, 0))
    partner = mirror_partners(pool, scale * np.array(MIDDLE), (0, -3, 0))
    expected = pool.position * [1, -1, 1] + [0, 0.3 * scale, 0]
    np.testing.assert_allclose(pool.position[partner], expected, atol=1e-9 * scale)
    own = np.isclose(pool.position[:, 1], 0.15 * scale)
    assert 0 < own.sum() < len(pool)
    np.testing.assert_array_equal(partner == np.arange(len(pool)), own)


def test_oblique_directions_mirror_into_those_of_the_other_sense(box_mesh):
    facets = exterior_facets(box_mesh)
    pool = candidates(box_mesh, facets, (1, 0, 0), (0.0, 30.0, -30.0, 90.0))
    partner = mirror_partners(pool, MIDDLE, (0, 1, 0))
    assert np.all(partner >= 0)
    for a, b in ((0, 0), (30, -30), (-30, 30), (90, 90)):
        np.testing.assert_array_equal(pool.angle[partner][pool.angle == a], b)
    odd = candidates(box_mesh, facets, (1, 0, 0), (30.0,))
    np.testing.assert_array_equal(mirror_partners(odd, MIDDLE, (0, 1, 0)), -1)


def test_rosettes_mirror_as_wholes(box_mesh):
    facets = exterior_facets(box_mesh)
    even = candidates(box_mesh, facets, (1, 0, 0), (-45.0, 0.0, 45.0), rosette=True)
    partner = mirror_partners(even, MIDDLE, (0, 1, 0))
    np.testing.assert_array_equal(partner[partner], np.arange(even.gauges))
    odd = candidates(box_mesh, facets, (1, 0, 0), (0.0, 45.0, 90.0), rosette=True)
    np.testing.assert_array_equal(mirror_partners(odd, MIDDLE, (0, 1, 0)), -1)
    single = candidates(box_mesh, facets, (1, 0, 0), (0.0,))
    mixed = concatenate([single, even])
    where = mirror_partners(mixed, MIDDLE, (0, 1, 0))
    np.testing.assert_array_equal(where[single.gauges :] - single.gauges, partner)
    assert np.all(where[: single.gauges] < single.gauges)


def test_only_equal_gauges_are_mirror_partners(box_mesh):
    facets = exterior_facets(box_mesh)
    strain = candidates(box_mesh, facets, (1, 0, 0))
    motion = motion_candidates(box_mesh, facets, DISPLACEMENT, ((1, 0, 0),))
    fixed, _ = bonded(box_mesh, facets, [BondedEntry(strain.position[0], (1, 0, 0))], 1e-3)
    pool = concatenate([fixed, strain, motion])
    partner = mirror_partners(pool, MIDDLE, (0, 1, 0))
    assert partner[0] == -1
    first = pool.first
    there = partner >= 0
    for name in ("quantity", "array", "bonded"):
        value = getattr(pool, name)[first]
        np.testing.assert_array_equal(value[partner[there]], value[there])
    assert there[1:].all()
    longer = replace(strain, length=np.where(strain.position[:, 1] > 0.15, 0.01, 0.0))
    alone = mirror_partners(longer, MIDDLE, (0, 1, 0))
    np.testing.assert_array_equal(alone >= 0, np.isclose(strain.position[:, 1], 0.15))


def test_plane_without_symmetry_has_no_pairs(box_mesh):
    pool = candidates(box_mesh, exterior_facets(box_mesh), (1, 0, 0))
    np.testing.assert_array_equal(mirror_partners(pool, (0, 0.151, 0), (0, 1, 0)), -1)
    half = mirror_partners(pool, (0.3, 0, 0), (1, 0, 0))
    np.testing.assert_array_equal(half >= 0, pool.position[:, 0] < 0.46)
    with pytest.raises(UserError, match="normal"):
        mirror_partners(pool, MIDDLE, (0, 0, 0))


def test_pairs_are_those_of_a_plain_double_loop():
    rng = np.random.default_rng(0)
    n = rng.standard_normal(3)
    n /= np.linalg.norm(n)
    p = rng.standard_normal(3)
    x, d = rng.uniform(-1, 1, (40, 3)), rng.standard_normal((40, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    y, e = x - 2 * ((x - p) @ n)[:, None] * n, -(d - 2 * (d @ n)[:, None] * n)
    e[30:] = np.roll(e[30:], 1, axis=0)
    x, d = np.vstack([x, y + 1e-7 * rng.uniform(-1, 1, (40, 3))]), np.vstack([d, e])
    order = rng.permutation(80)
    x, d = x[order], d[order]
    partner = mirror_partners(imported_pool(np.arange(80), x, d), p, 2 * n)
    expected = np.full(80, -1)
    for i in range(80):
        for j in range(80):
            near = np.linalg.norm(x[i] - 2 * ((x[i] - p) @ n) * n - x[j]) < 1e-5
            if near and abs(abs((d[i] - 2 * (d[i] @ n) * n) @ d[j]) - 1) < 1e-9:
                expected[i] = j
    np.testing.assert_array_equal(partner, expected)
    assert np.count_nonzero(partner >= 0) == 60

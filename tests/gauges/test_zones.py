"""Zones take in what their words say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import InfeasibleError, UserError
from strainsight.gauges.candidates import candidates
from strainsight.gauges.surface import facet_centres
from strainsight.gauges.zones import Box, Cylinder, NearSet, NormalCone, On, inside, on_surface
from strainsight.mesh.facets import exterior_facets

from ..bodies import body

MESHES = Path(__file__).parents[2] / "meshes"


@pytest.fixture(scope="module")
def beam():
    """The cantilever along x with a set of two nodes at its tip's corner."""
    mesh = read_mesh(MESHES / "cantilever.bdf")
    order = np.argsort(np.linalg.norm(mesh.position - [2.0, 0.125, 0.095], axis=1))
    return replace(mesh, node_sets={"corner": mesh.node_ids[order[:2]]}, element_sets={"first": np.array([1])})


def kept(mesh, axis, *zones):
    return candidates(mesh, exterior_facets(mesh), axis, exclude=zones)


def test_a_cone_takes_the_facets_that_face_along_its_axis_either_way(beam):
    every = kept(beam, (1, 0, 0))
    sides = kept(beam, (1, 0, 0), NormalCone((0, 0, -2), 1.0))
    assert len(sides) == np.count_nonzero(np.abs(every.normal[:, 2]) < 0.5)
    assert np.all(np.abs(sides.normal[:, 1]) > 0.99)
    assert len(kept(beam, (1, 0, 0), NormalCone((0, 1, 1), 44.0))) == len(every)


def test_a_cone_around_the_gauge_axis_corrects_an_axis_along_a_normal(beam):
    with pytest.raises(InfeasibleError, match="within 10° of the normal") as caught:
        kept(beam, (0, 0, 1))
    assert "normal_cone: {axis: [0, 0, 1], angle: 10}" in caught.value.remedy
    assert np.all(np.abs(kept(beam, (0, 0, 1), NormalCone((0, 0, 1), 10.0)).normal[:, 1]) > 0.99)


def test_a_cylinder_has_its_axis_and_no_ends(beam):
    zone = Cylinder((1.0, 0.0, 7.0), (0, 0, -3.0), 0.3)
    every, left = kept(beam, (1, 0, 0)), kept(beam, (1, 0, 0), zone)
    away = np.hypot(every.position[:, 0] - 1.0, every.position[:, 1]) >= 0.3
    np.testing.assert_array_equal(left.position, every.position[away])
    assert 0 < len(left) < len(every)


@pytest.mark.parametrize("name", ["corner", "first"])
def test_a_set_keeps_gauges_at_a_distance_from_its_nodes(beam, name):
    every, left = kept(beam, (1, 0, 0)), kept(beam, (1, 0, 0), NearSet(name, 0.2))
    ids = beam.node_sets["corner"] if name == "corner" else beam.node_ids[beam.blocks[0].nodes[beam.blocks[0].ids == 1]]
    nodes = beam.position[np.isin(beam.node_ids, ids)]
    apart = np.linalg.norm(every.position[:, None] - nodes, axis=2).min(axis=1) >= 0.2
    np.testing.assert_array_equal(left.position, every.position[apart])
    assert 0 < len(left) < len(every)


@pytest.mark.parametrize(
    ("zone", "says"),
    [
        (NearSet("korner", 0.1), "korner"),
        (Cylinder((0, 0, 0), (0, 0, 0), 0.1), "no direction"),
        (NormalCone((0, 0, 0), 10.0), "no direction"),
    ],
)
def test_a_zone_of_nothing_is_refused(beam, zone, says):
    with pytest.raises(UserError, match=says):
        kept(beam, (1, 0, 0), zone)
    assert len(kept(beam, (1, 0, 0), Box((5, 5, 5), (6, 6, 6)))) == len(kept(beam, (1, 0, 0)))


@pytest.mark.parametrize("name", ["below", "above"])
def test_of_parts_that_touch_the_facets_of_one_are_its_own(name):
    """Two plates of 4 × 4 bricks, meshed alike, one on the other without a common node: each has its side of the contact."""
    one = body("hex8", (4, 4, 1), lambda u, v, w: (u, v, w))
    cells, n = one.blocks[0], len(one.position)
    nodes, ids = np.vstack([cells.nodes, cells.nodes + n]), np.arange(1, n + 1)
    both = replace(cells, ids=np.arange(1, 33), nodes=nodes, region=np.ones(32, dtype=np.int64))
    z = one.position[:, 2]
    mesh = replace(
        one,
        node_ids=np.arange(1, 2 * n + 1),
        position=np.vstack([one.position, one.position + np.eye(3)[2]]),
        blocks=(both,),
        node_sets={"below": ids[z == 1], "above": n + ids[z == 0]},
    )
    facets = exterior_facets(mesh)
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    there = on_surface(mesh, facets, name)
    assert np.count_nonzero(there) == 16
    np.testing.assert_array_equal(inside(On(name), mesh, facets, centre, normal), there)


def test_a_face_of_a_mesh_without_solids_is_refused(beam):
    nothing = np.zeros((1, 3))
    with pytest.raises(UserError, match="no surface that a zone could be on"):
        inside(On("first"), replace(beam, blocks=()), None, nothing, nothing)

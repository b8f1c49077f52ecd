"""A gauge's carrier keeps off edges, supports and loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.gauges.clearance import carrier, carrier_clearance, crowded, obstacles, room_for
from strainsight.gauges.surface import facet_centres
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import Relation

L, W, H = 1.0, 0.3, 0.2


def test_the_carrier_of_a_grid_whose_length_is_not_stated_is_the_one_that_the_manual_states():
    """8 × 4.5 mm, and half its diagonal, 4.6 mm."""
    assert carrier(0.0) == pytest.approx((0.008, 0.0045))
    assert carrier_clearance(0.0) == pytest.approx(0.0046, abs=5e-5)


def test_the_clearance_holds_the_carrier_however_it_is_turned():
    """The farthest of its corners, turned in steps of 1°, is on the circle of the clearance."""
    length, width = carrier(0.006)
    corners = 0.5 * np.array([[length, width], [length, -width], [-length, width], [-length, -width]])
    turns = np.deg2rad(np.arange(360))
    reach = [np.abs(corners @ [np.cos(t), np.sin(t)]).max() for t in turns]
    assert carrier_clearance(0.006) == pytest.approx(max(reach), rel=1e-3)
    assert carrier_clearance(0.0) == carrier_clearance(0.003)


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


def test_room_counts_places_that_are_so_far_apart():
    """Eleven places 0.1 m apart: six of them 0.2 m apart; two gauges in one place are one place."""
    line = np.zeros((11, 3))
    line[:, 0] = 0.1 * np.arange(11)
    twice = np.repeat(line, 2, axis=0)
    assert room_for(twice, 0.2, 6)
    assert not room_for(twice, 0.2, 7)
    assert room_for(twice, 0.0, 11)
    assert not room_for(twice, 0.0, 12)


def test_nodes_of_relations_are_kept_clear_as_those_of_ties(box_mesh):
    facets, loaded = exterior_facets(box_mesh), np.zeros(0, dtype=np.int64)
    tied = np.concatenate([tie.nodes for tie in (*box_mesh.rigid, *box_mesh.averaging)])
    one = Relation(1, tied, np.zeros(len(tied), int), np.ones(len(tied)))
    related = replace(box_mesh, rigid=(), averaging=(), relations=(one,))
    own, other = (obstacles(mesh, facets, loaded)["supports"] for mesh in (related, box_mesh))
    np.testing.assert_array_equal(own, other)
    assert len(own) > len(obstacles(replace(related, relations=()), facets, loaded)["supports"]) > 0

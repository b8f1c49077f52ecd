"""Distances and angles of gauges to the edges of their face, against hand geometry."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.gauges.edge_dimensions import angle_from, edge_dimensions
from strainsight.mesh.facets import exterior_facets

from .conftest import surface

L, W, H = 1.0, 0.3, 0.2
TOP = np.array([0.0, 0.0, 1.0])


def on_top(mesh, points, directions):
    """Dimensions of points on the facet of the top below the first of them: every facet of a face has the same edges."""
    facets = exterior_facets(mesh)
    corners = mesh.position[facets.nodes[:, :4]]
    top = np.flatnonzero(np.all(corners[..., 2] == H, axis=1))[0]
    points, directions = np.array(points, dtype=float), np.array(directions, dtype=float)
    return edge_dimensions(
        mesh.position, facets, np.full(len(points), facets.key[top]), points, directions, np.tile(TOP, (len(points), 1))
    )


def test_on_a_box_they_are_the_distances_to_two_sides(box_mesh):
    rng = np.random.default_rng(1)
    xy = rng.uniform(0.05, 0.95, (40, 2)) * [L, W]
    found = on_top(box_mesh, np.column_stack([xy, np.full(40, H)]), np.tile([1.0, 0, 0], (40, 1)))
    sides = np.minimum(xy, np.array([L, W]) - xy)
    np.testing.assert_allclose(found.distance, np.sort(sides, axis=1), rtol=1e-12)
    nearest = np.argmin(sides, axis=1)
    # The side that bounds x runs along y, at 90° to a gauge along x.
    np.testing.assert_allclose(found.angle[:, 0], np.where(nearest == 0, 90.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(found.angle[:, 1], np.where(nearest == 0, 0.0, 90.0), atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(found.foot - np.column_stack([xy, np.full(40, H)])[:, None], axis=2), found.distance, rtol=1e-12
    )


@pytest.mark.parametrize("turn", [-89.0, -30.0, 0.0, 17.0, 90.0])
def test_the_angle_is_counter_clockwise_as_seen_from_outside(box_mesh, turn):
    """0.02 m from the side along x, so that side is the edge, and its sense does not matter."""
    d = [np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn)), 0.0]
    found = on_top(box_mesh, [[0.5, 0.02, H], [0.5, W - 0.02, H]], [d, d])
    np.testing.assert_allclose(found.angle[:, 0], turn, atol=1e-9)
    back = on_top(box_mesh, [[0.5, 0.02, H]], [-np.array(d)])
    assert back.angle[0, 0] == pytest.approx(found.angle[0, 0], abs=1e-9)
    assert angle_from(np.array([-1.0, 0, 0]), np.array(d), TOP) == pytest.approx(turn, abs=1e-9)


def test_a_direction_along_the_normal_has_distances_and_no_angle(box_mesh):
    """As of an accelerometer; one that leans out of the surface has the angle of its shadow there."""
    found = on_top(box_mesh, [[0.5, 0.02, H]] * 3, [TOP, -TOP, [0.5, 0.5, 2**-0.5]])
    assert np.isfinite(found.distance).all()
    assert np.isnan(found.angle[:2]).all()
    np.testing.assert_allclose(found.angle[2], [45.0, -45.0], atol=1e-9)


def test_an_edge_of_another_face_does_not_count(box_mesh):
    """A thin plate: below its middle the other side's edges are as near as its own, which are the ones to measure from."""
    thin = box_mesh.position * [1, 1, 1e-3]
    facets = exterior_facets(box_mesh)
    own = np.all(box_mesh.position[facets.nodes[:, :4]][..., 2] == H, axis=1)
    found = edge_dimensions(
        thin,
        facets,
        facets.key[own][:1],
        np.array([[0.5, 0.1, 0.0]]),  # as if pressed through to the other side
        np.array([[1.0, 0, 0]]),
        TOP[None],
    )
    np.testing.assert_allclose(found.foot[0, 0], [0.5, 0.0, 1e-3 * H], atol=1e-12)


@pytest.mark.parametrize("kind", ["quad4", "quad8", "tri3", "tri6"])
def test_a_tube_has_the_rims_at_its_ends_and_no_edge_across(tube, kind):
    """Rims run round, so a gauge along the axis is at 90° to them; the skin is smooth all the way round."""
    position, facets = tube(kind, 24, 5, 2.0)
    place, normal = np.array([[2.0, 0.0, 1.3]]), np.array([[1.0, 0.0, 0.0]])
    found = edge_dimensions(position, facets, facets.key[:1], place, np.array([[0.0, 0.0, 1.0]]), normal)
    assert found.distance[0, 0] == pytest.approx(1.3, rel=1e-6)
    assert abs(found.angle[0, 0]) == pytest.approx(90.0, abs=1e-6)
    assert np.isnan(found.distance[0, 1])


@pytest.mark.parametrize(("half", "there"), [(50.0, True), (70.0, False)])
def test_an_edge_far_round_a_bent_face_is_none_to_measure_across_to(half, there):
    """In the middle of a shell of radius 2 m over ±50° its straight sides are 2r sin 25° away, 25° out of the tangent plane."""
    step = np.deg2rad(half) / 10
    chart = lambda u, v: (2 * np.cos(step * (u - 10)), 2 * np.sin(step * (u - 10)), v)  # noqa: E731
    position, facets = surface("quad8", 20, 8, chart)
    place, along = np.array([[2.0, 0.0, 0.5]]), np.array([[0.0, 1.0, 0.0]])
    found = edge_dimensions(position, facets, facets.key[:1], place, along, np.array([[1.0, 0.0, 0.0]]))
    assert found.distance[0, 0] == pytest.approx(0.5)
    if there:
        assert found.distance[0, 1] == pytest.approx(4 * np.sin(np.deg2rad(half / 2)), rel=1e-6)
    else:
        assert np.isnan(found.distance[0, 1])


def test_a_gauge_on_no_facet_has_no_edges(box_mesh):
    facets = exterior_facets(box_mesh)
    found = edge_dimensions(box_mesh.position, facets, np.array([-1]), np.zeros((1, 3)), TOP[None], TOP[None])
    assert np.isnan(found.distance).all()
    assert np.isnan(found.angle).all()

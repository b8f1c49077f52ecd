"""Triangles and marks of a picture: what is seen, and where sensors stand."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.report.picture.geometry import seen_from, triangles, views


def test_the_triangles_of_a_closed_surface_enclose_its_volume(beam):
    """∑ a·(b×c)/6 over outward triangles is the volume (divergence theorem)."""
    a, b, c = (beam.points[triangles(beam.faces)[:, i]] for i in range(3))
    assert np.sum(a * np.cross(b, c)) / 6 == pytest.approx(2.0 * 0.08 * 0.12)


def test_a_gauge_is_hidden_by_its_own_side_and_by_a_roof():
    square = np.array([[-2.0, -2.0, 0.0], [2.0, -2.0, 0.0], [2.0, 2.0, 0.0], [-2.0, 2.0, 0.0]])
    points = np.concatenate([square, square + np.array([0.0, 0.0, 1.0])])
    floor = np.array([[0, 1, 2], [0, 2, 3]])
    roof = floor + 4
    place, up = np.array([[0.3, 0.1, 0.0]]), np.array([[0.0, 0.0, 1.0]])
    eye = np.array([0.1, -0.1, 1.0]) / np.linalg.norm([0.1, -0.1, 1.0])
    assert seen_from(points, floor, place, up, eye).tolist() == [1]
    assert seen_from(points, floor, place, up, -eye).tolist() == [0]
    assert seen_from(points, np.concatenate([floor, roof]), place, up, eye).tolist() == [0]


def test_two_views_show_gauges_on_top_and_underneath(beam):
    triangle = triangles(beam.faces)
    position = np.array([gauge.position for gauge in beam.gauges])
    normal = np.array([gauge.normal for gauge in beam.gauges])
    corners = views(beam.points, triangle, position, normal)
    assert len(corners) == 2
    seen = sum(seen_from(beam.points, triangle, position, normal, corner) for corner in corners)
    assert np.all(seen >= 1)
    assert len(views(beam.points, triangle, position[:2], normal[:2])) == 1


def test_a_sensor_without_a_normal_is_not_hidden_by_the_facet_it_sits_on(beam):
    triangle, eye = triangles(beam.faces), np.array([0.3, -0.7, 0.65])
    place = np.array([[1.0, 0.03, 0.12], [1.0, 0.03, 0.0]])
    assert seen_from(beam.points, triangle, place, np.zeros((2, 3)), eye / np.linalg.norm(eye)).tolist() == [1, 0]

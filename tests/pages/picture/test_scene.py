"""The picture: its triangles, its size, transparent ground, gauges in their colours, and what hides them."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from strainsight.pages.chart.drawing import gauge_colour
from strainsight.pages.picture import scene
from strainsight.pages.picture.geometry import arrow, free_end, seen_from, triangles, views
from strainsight.pages.picture.layout import LoadArrow, PictureLayout
from strainsight.pages.picture.scene import LINES, spread_labels

from ..conftest import layout, mixed_layout

NOWHERE = np.zeros(3)


def without_facets(beam):
    """What comes as matrices: nodes on a line, gauges that lie on no surface."""
    points = np.column_stack([np.linspace(0, 2, 41), np.zeros(41), np.zeros(41)])
    gauges = tuple(
        replace(gauge, position=np.array([0.4 * (i + 1), 0, 0.02]), normal=NOWHERE, direction=direction)
        for i, (gauge, direction) in enumerate(zip(beam.gauges, [*np.eye(3), NOWHERE], strict=True))
    )
    return PictureLayout(points, np.full((0, 8), -1), np.empty((0, 3)), gauges, loose=points)


@pytest.fixture(scope="module")
def pictures():
    beam = layout()
    shown = {"beam": beam, "sensors": mixed_layout(), "no facets": without_facets(beam)}
    return {name: (shown[name], png) for name, png in zip(shown, scene.render_all(list(shown.values())), strict=True)}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "more"), [("beam", ()), ("sensors", ()), ("no facets", (LINES,))])
def test_every_gauge_is_pictured_in_its_colour(pictures, name, more):
    shown, png = pictures[name]
    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGBA"))
    assert pixels.shape == (840, 1280, 4)
    assert np.mean(pixels[..., 3] == 0) > 0.3
    for colour in (*map(gauge_colour, range(len(shown.gauges))), *more):
        wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
        assert np.sum(np.all(pixels[..., :3] == wanted, axis=2)) > 50


def test_labels_of_a_cluster_do_not_overlap():
    anchors = np.array([[320.0, 200.0]] * 6) + np.arange(6)[:, None] * [3.0, 1.0]
    names = [f"G{i}" for i in range(6)]
    places = spread_labels(anchors, np.tile([0.0, -1.0], (6, 1)), names, (640, 420))
    gap = np.abs(places[:, None] - places[None])
    apart = (gap[..., 0] > 24) | (gap[..., 1] > 25)
    assert np.all(apart | np.eye(6, dtype=bool))
    assert np.all((places > 0) & (places < [640, 420]))


def test_loads_are_drawn_outside_the_body(beam):
    tip = np.array([2.0, 0.04, 0.06])
    for direction in ([0.0, 0.0, 2.0], [-1.0, 0.0, 0.0], [0.0, 3.0, 1.0]):
        load = LoadArrow("F", tip, np.array(direction))
        start, step = arrow(load, beam)
        np.testing.assert_allclose(np.cross(step, direction), 0.0, atol=1e-12)
        free = free_end(load, beam)
        assert np.linalg.norm(free - np.clip(free, 0.0, [2.0, 0.08, 0.12])) > 0.1
        assert min(np.linalg.norm(start - tip), np.linalg.norm(start + step - tip)) < 1e-12


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

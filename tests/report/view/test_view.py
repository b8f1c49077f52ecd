"""What `view` shows: arrays on their way to the child, colours and ids in the picture, errors instead of crashes."""

from __future__ import annotations

import io
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from strainsight.errors import StrainsightError, UserError
from strainsight.report.chart.drawing import gauge_colour
from strainsight.report.picture.geometry import facet_of_triangle, triangles
from strainsight.report.view import viewing
from strainsight.report.view.parts import carried, gauge_arrows, plain
from strainsight.report.view.viewed import FACETS, Panel, View, exaggerated
from strainsight.report.view.viewer import fitting


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def close_to(image, colour, within=4):
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int(np.sum(np.all(np.abs(image - wanted) <= within, axis=2)))


def coloured(beam, values):
    return View("a beam", beam, (Panel("below", np.asarray(values, dtype=float)),), "stress", "MPa", FACETS)


def test_a_picture_has_the_size_a_white_ground_and_every_gauge_with_its_id(beam):
    image = pixels(viewing.screenshot(View("a beam", beam)))
    assert image.shape == (900, 1400, 3)
    assert np.mean(np.all(image == 255, axis=2)) > 0.3
    # The plate of an id has the gauge's colour, untouched by light.
    for i in range(len(beam.gauges)):
        assert close_to(image, gauge_colour(i)) > 100


def test_values_are_coloured_from_the_lowest_to_the_highest_with_a_scalar_bar(beam):
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    bare = replace(beam, gauges=(), loads=(), pool=np.empty((0, 3)))
    image = pixels(viewing.screenshot(coloured(bare, np.linspace(1.0, 9.0, len(beam.faces)))))
    plain_image = pixels(viewing.screenshot(View("a beam", bare)))
    for value in (0.05, 0.5, 0.95):
        colour = to_hex(colormaps["viridis"](value))
        assert close_to(image, colour, 6) > 60
        assert close_to(plain_image, colour, 6) == 0


def test_every_triangle_knows_its_facet():
    faces = np.full((4, 8), -1)
    faces[0, :8], faces[1, :3], faces[2, :4], faces[3, :6] = range(8), (8, 9, 10), (11, 12, 13, 14), range(15, 21)
    own = facet_of_triangle(faces)
    for triangle, facet in zip(triangles(faces), own, strict=True):
        assert set(triangle) <= set(faces[facet])


def test_gauges_go_with_the_points_nearest_to_them(beam):
    shift = np.zeros((len(beam.points), 3))
    shift[:, 2] = beam.points[:, 0]
    moved = carried(beam, Panel(shift=shift))
    np.testing.assert_array_equal(moved.points, beam.points + shift)
    for before, after in zip(beam.gauges, moved.gauges, strict=True):
        near = np.argmin(np.linalg.norm(beam.points - before.position, axis=1))
        np.testing.assert_allclose(after.position, before.position + shift[near])
    assert carried(beam, Panel()) is beam


def test_a_displacement_is_enlarged_by_a_round_factor_and_never_made_smaller():
    points = np.array([[0.0, 0, 0], [10.0, 0, 0]])
    assert exaggerated(points, np.array([[0, 0, 0], [0, 0, 0.003]])) == 200
    assert exaggerated(points, np.array([[0, 0, 0], [0, 0, 0.0061]])) == 50
    assert exaggerated(points, np.array([[0, 0, 0], [0, 0, 5.0]])) == 1
    assert exaggerated(points, np.zeros((2, 3))) == 1


def test_a_gauge_of_several_channels_has_an_arrow_along_each_and_one_of_none_a_ball(beam):
    gauge = replace(beam.gauges[0], directions=np.eye(3)[:2])
    arrows = gauge_arrows(gauge, 0.1)
    for axis, drawn in enumerate(arrows):
        extent = np.ptp(drawn.points, axis=0)
        assert extent[axis] == pytest.approx(0.1, rel=1e-3)
        assert np.argmax(extent) == axis
    assert len(gauge_arrows(replace(gauge, directions=np.empty((0, 3)), direction=np.zeros(3)), 0.1)) == 1


def test_hostile_names_are_shown_and_no_formula(beam):
    assert plain("a $x$") == "a ＄x＄"
    assert plain("5 $ a day") == "5 $ a day"
    names = ("<script>alert(1)</script>", "$\\frac{1}{0}$", "梁の先端", "x" * 300)
    gauges = tuple(replace(gauge, label=name) for gauge, name in zip(beam.gauges, names, strict=True))
    viewing.screenshot(View("$\\bad{$ % \n |", replace(beam, gauges=gauges)))


def test_a_crash_of_the_child_is_an_error_with_a_remedy(beam, monkeypatch, tmp_path):
    crash = tmp_path / "crash"
    crash.write_text("#!/bin/sh\necho 'no context' >&2\nkill -SEGV $$\n")
    crash.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(crash))
    with pytest.raises(StrainsightError, match="no context") as caught:
        viewing.screenshot(View("a beam", beam))
    assert "libegl1" in str(caught.value)
    monkeypatch.setenv("DISPLAY", ":99")
    with pytest.raises(StrainsightError, match="the window broke off") as caught:
        viewing.window(View("a beam", beam))
    assert "--screenshot" in str(caught.value)


@pytest.mark.parametrize(
    ("screen", "size"),
    [((1920, 1080), (1400, 900)), ((1280, 720), (1008, 648)), ((1000, 2000), (900, 578)), ((0, 0), (1400, 900))],
)
def test_a_window_is_no_larger_than_its_screen(screen, size):
    assert fitting(screen, (1400, 900)) == size


def test_a_display_that_does_not_answer_is_reported_with_exit_code_2_and_leaves_nothing_behind(beam, monkeypatch, tmp_path):
    monkeypatch.setenv("DISPLAY", ":7777")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(UserError, match="does not answer") as caught:
        viewing.window(View("a beam", beam))
    assert "--screenshot" in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="elsewhere there is always a display")
def test_without_a_display_there_is_no_window_but_a_remedy(beam, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(UserError, match="no display") as caught:
        viewing.window(View("a beam", beam))
    assert "--screenshot" in str(caught.value)

"""What `view` shows: arrays on their way to the child, colours and ids in the picture, errors instead of crashes."""

from __future__ import annotations

import io
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from strainsight.errors import StrainsightError, UserError
from strainsight.pages.chart.drawing import gauge_colour
from strainsight.pages.view import viewing
from strainsight.pages.view.viewing import FACETS, Panel, View, carried, exaggerated, plain

from ..conftest import layout
from ..outline import HOSTILE


def pixels(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def close_to(image, colour, within=4):
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return int(np.sum(np.all(np.abs(image - wanted) <= within, axis=2)))


def coloured(beam, values):
    return View("a beam", beam, (Panel("below", np.asarray(values, dtype=float)),), "stress", "MPa", FACETS)


@pytest.fixture(scope="module")
def pictures():
    """Pixels of the beam with its gauges and hostile names, and of the bare beam, coloured; by one child process."""
    beam = layout()
    names = (HOSTILE, "$\\frac{1}{0}$", "梁の先端", "x" * 300)
    gauges = tuple(replace(gauge, label=name) for gauge, name in zip(beam.gauges, names, strict=True))
    bare = replace(beam, gauges=(), loads=(), pool=np.empty((0, 3)))
    colours = coloured(bare, np.linspace(1.0, 9.0, len(beam.faces)))
    return [pixels(png) for png in viewing.screenshots([View("$\\bad{$ % \n |", replace(beam, gauges=gauges)), colours])]


@pytest.mark.slow
def test_a_picture_has_the_size_a_white_ground_and_every_gauge_with_its_id(beam, pictures):
    image, _ = pictures
    assert image.shape == (900, 1400, 3)
    assert np.mean(np.all(image == 255, axis=2)) > 0.3
    # The plate of an id has the gauge's colour, untouched by light.
    for i in range(len(beam.gauges)):
        assert close_to(image, gauge_colour(i)) > 100


def test_values_are_coloured_from_the_lowest_to_the_highest_with_a_scalar_bar(pictures):
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    plain_image, image = pictures
    for value in (0.05, 0.5, 0.95):
        colour = to_hex(colormaps["viridis"](value))
        assert close_to(image, colour, 6) > 60
        assert close_to(plain_image, colour, 6) == 0


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


def test_a_dollar_sign_begins_no_formula():
    assert plain("a $x$") == "a ＄x＄"
    assert plain("5 $ a day") == "5 $ a day"


def test_a_crash_of_the_child_is_an_error_with_a_remedy(beam, monkeypatch, tmp_path):
    crash = tmp_path / "crash"
    crash.write_text("#!/bin/sh\necho 'no context' >&2\nkill -SEGV $$\n")
    crash.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(crash))
    with pytest.raises(StrainsightError, match="no context") as caught:
        viewing.screenshots([View("a beam", beam)])
    assert "libegl1" in str(caught.value)
    monkeypatch.setenv("DISPLAY", ":99")
    with pytest.raises(StrainsightError, match="the window crashed") as caught:
        viewing.window(View("a beam", beam))
    assert "--screenshot" in str(caught.value)


def test_a_display_that_does_not_answer_is_reported_with_exit_code_2_and_leaves_nothing_behind(beam, monkeypatch, tmp_path):
    monkeypatch.setenv("DISPLAY", ":7777")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(UserError, match="does not respond") as caught:
        viewing.window(View("a beam", beam))
    assert "--screenshot" in str(caught.value)
    assert list(tmp_path.iterdir()) == []

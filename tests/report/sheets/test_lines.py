"""Segments joined into paths are the same lines; windows cut them where they leave."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from strainsight.report.sheets.lines import GRAIN, clipped, joined


def drawn(paths):
    return sum(np.linalg.norm(np.diff(np.array(path), axis=0), axis=1).sum() for path in paths)


def test_a_polygon_is_one_closed_path_of_its_corners():
    corners = np.array([[0, 0], [40, 0], [40, 25], [0, 25], [0, 0]], dtype=float)
    fine = np.concatenate([np.linspace(a, b, 11) for a, b in pairwise(corners)])
    segments = np.stack([fine[:-1], fine[1:]], axis=1)
    shuffled = segments[np.random.default_rng(0).permutation(len(segments))]
    (path,) = joined(shuffled)
    assert path[0] == path[-1]
    assert {tuple(point) for point in np.round(path, 9).tolist()} >= {tuple(c) for c in corners.tolist()}
    assert len(path) <= 6
    assert drawn([path]) == pytest.approx(130)


def test_each_line_of_a_grid_is_drawn_once():
    """Edges of 6 × 4 cells, each given twice and in either sense."""
    x, y = np.meshgrid(np.arange(7.0), np.arange(5.0), indexing="ij")
    p = np.stack([x, y], axis=-1)
    segments = np.concatenate(
        [np.stack([p[:-1], p[1:]], axis=2).reshape(-1, 2, 2), np.stack([p[:, :-1], p[:, 1:]], axis=2).reshape(-1, 2, 2)]
    )
    paths = joined(np.concatenate([segments, segments[:, ::-1]]))
    assert drawn(paths) == pytest.approx(6 * 5 + 4 * 7)


def test_a_circle_keeps_its_shape_to_a_grain():
    t = np.linspace(0, 2 * np.pi, 721)
    circle = 10 * np.column_stack([np.cos(t), np.sin(t)])
    (path,) = joined(np.stack([circle[:-1], circle[1:]], axis=1))
    assert np.abs(np.linalg.norm(path, axis=1) - 10).max() < GRAIN
    middle = 0.5 * (np.array(path[1:]) + path[:-1])
    assert np.abs(np.linalg.norm(middle, axis=1) - 10).max() < 3 * GRAIN  # the line, and the rounding of its ends
    assert len(path) < 100
    assert drawn([path]) == pytest.approx(20 * np.pi, rel=2e-3)


def test_what_is_outside_a_window_is_cut_off():
    """Against points along every segment: the share of those that lie inside."""
    rng = np.random.default_rng(2)
    segments = rng.uniform(-2, 2, (200, 2, 2))
    segments[:20, 1, 0] = segments[:20, 0, 0]  # upright ones
    low, high = np.array([-1.0, -0.5]), np.array([0.7, 1.0])
    share = np.linspace(0, 1, 4001)
    points = segments[:, :1] + share[None, :, None] * (segments[:, 1:] - segments[:, :1])
    inside = np.all((points >= low) & (points <= high), axis=2).mean(axis=1)
    long = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
    found = clipped(segments, low, high)
    assert len(found) == np.sum(inside > 0)
    own = np.linalg.norm(found[:, 1] - found[:, 0], axis=1)
    np.testing.assert_allclose(own, (inside * long)[inside > 0], atol=5e-3)

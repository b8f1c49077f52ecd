"""The room over a gauge: bores, grooves and gaps by their widths, and places that are free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.gauges.access import room
from strainsight.gauges.candidates import candidates
from strainsight.gauges.walk import skin_of
from strainsight.mesh.facets import exterior_facets

from ..bodies import body
from .test_patterns import INNER, box, tube

KINDS = ("hex8", "tet4", "wedge15")
"""With every kind of facet."""


def over(mesh, reach=10.0, axis=(1, 0, 0), of=None):
    """Gauges along an axis on every facet that it does not stand on, and the room over them; of: a part of the mesh."""
    facets = exterior_facets(mesh)
    every = candidates(mesh, facets, None) if of is None else candidates(of, exterior_facets(of), None)
    gauges = every.take(np.flatnonzero(np.abs(every.normal @ np.array(axis)) < 0.9))
    return gauges, room(skin_of(mesh.position, facets), gauges, reach)


@pytest.mark.parametrize("kind", KINDS)
def test_over_a_box_there_is_all_the_room_there_is(kind):
    _, found = over(box(kind))
    assert np.isinf(found).all()


@pytest.mark.parametrize(("kind", "exact"), [("hex8", 0.02), ("hex20", 2e-3), ("wedge15", 0.01)])
def test_in_a_bore_it_is_the_chord_at_45_degrees_and_outside_there_is_no_end(kind, exact):
    """Of rays from a point of a circle of diameter D the one along the normal goes D, those slanted by 45° to both sides
    D cos 45°, on the circle. Slanted along the bore they go farther or out of its end."""
    gauges, found = over(tube(kind))
    inside = np.sum(gauges.position[:, 1:] * gauges.normal[:, 1:], axis=1) < 0
    assert 10 < np.count_nonzero(inside) < len(inside) - 10
    assert np.isinf(found[~inside]).all()
    np.testing.assert_allclose(found[inside], np.sqrt(2) * INNER, rtol=exact)
    _, near = over(tube(kind), reach=1.1)
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


@pytest.mark.parametrize("kind", ["hex8", "tet4"])
def test_on_the_floor_of_a_groove_it_is_the_way_to_the_farther_wall_and_on_a_wall_its_width(kind):
    mesh, first = channel(kind, 2, 3)
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


@pytest.mark.parametrize(("kind", "shift"), [("hex8", 0.0), ("tet4", 0.25)])
def test_below_a_part_that_touches_there_is_no_room(kind, shift):
    """Two boxes of 6 × 3 × 2 cells, one on the other without a common node, meshed alike or not."""
    one = box(kind)
    size, n, block = np.ptp(one.position, axis=0), len(one.position), one.blocks[0]
    k = len(block.ids)
    upper = one.position + np.array([shift, 0.0, size[2]])
    mesh = replace(
        one,
        node_ids=np.arange(1, 2 * n + 1),
        position=np.vstack([one.position, upper]),
        blocks=(
            replace(
                block,
                ids=np.arange(1, 2 * k + 1),
                nodes=np.vstack([block.nodes, block.nodes + n]),
                region=np.ones(2 * k, dtype=np.int64),
            ),
        ),
    )
    low, many = one.position.min(axis=0), 0
    for part in (one, replace(one, position=upper)):
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


def test_over_a_shallow_groove_and_beside_one_wall_alone_a_hand_comes_in():
    """Walls of one cell: the slanted ray from 1.5 cells away passes over the farther one. One wall leaves a side."""
    for mesh, first, width in ((*channel("hex8", 2, 1), 2), (*channel("hex8", 2, 3, (True, False)), 2)):
        gauges, found = over(mesh)
        floor = floor_of(gauges, first, width)
        assert floor.any()
        assert np.isinf(found[floor]).all()


def test_beyond_the_reach_it_does_not_look():
    mesh, _ = channel("hex8", 2, 3)
    _, found = over(mesh, reach=1.9)
    assert np.isinf(found).all()
    _, found = over(mesh, reach=2.05)
    assert np.isfinite(found).any()
    assert found[np.isfinite(found)].max() <= 2.05

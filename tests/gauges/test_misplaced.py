"""A gauge bonded beside its place moves on over the surface, up to a sharp edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.gauges.candidates import ACCELERATION, DISPLACEMENT, candidates
from strainsight.gauges.misplaced import misplaced
from strainsight.gauges.motion import motion_candidates
from strainsight.gauges.rows import channel_rows, fits

KINDS = ("tri3", "tri6", "quad4", "quad8")


@pytest.mark.parametrize("kind", KINDS)
def test_on_a_plate_it_is_found_on_whatever_facet_the_offset_leads_to(kind, plate, bare):
    position, facets = plate(kind, 8, 6, 0.2)
    gauges = candidates(bare(position), facets, (1, 0.2, 0), (0.0, 35.0))
    rng = np.random.default_rng(0)
    offset, rotation = rng.uniform(-2, 2, (len(gauges), 2)), rng.uniform(-20, 20, len(gauges))
    meant = gauges.position + offset[:, :1] * gauges.direction + offset[:, 1:] * np.cross([0, 0, 1.0], gauges.direction)
    on = np.all((meant[:, :2] > 0) & (meant[:, :2] < [8, 6]), axis=1)
    moved, held = misplaced(position, gauges, facets, offset, rotation)
    np.testing.assert_array_equal(held, ~on)
    np.testing.assert_allclose(moved.position[on], meant[on], atol=1e-9)
    expected = Rotation.from_euler("z", rotation[:, None], degrees=True).apply(gauges.direction)
    np.testing.assert_allclose(moved.direction, expected, atol=1e-12)
    assert np.count_nonzero(moved.element != gauges.element) > 0.5 * len(gauges)
    # The others stop where the straight line to their place leaves the plate.
    share = np.nanmin(_crossings(gauges.position, meant, 8, 6)[~on], axis=1)
    stop = gauges.position[~on] + share[:, None] * (meant - gauges.position)[~on]
    np.testing.assert_allclose(moved.position[~on], stop, atol=1e-9)
    # And what they read is the field at that place: a linear one needs no oracle but itself.
    G = rng.standard_normal((3, 3))
    rows = channel_rows(
        position, gauges, (position @ G.T).reshape(-1, 1), facets=facets, offset=offset, rotation=rotation
    )
    np.testing.assert_allclose(rows[:, 0], np.einsum("mi,ij,mj->m", expected, G, expected), atol=1e-11)


def _crossings(a, b, width, height):
    """Shares of the way from a to b at which each of the four borders is crossed, nan where it is not ahead."""
    with np.errstate(all="ignore"):
        t = np.column_stack([(edge - a[:, i]) / (b - a)[:, i] for i, edge in ((0, 0), (0, width), (1, 0), (1, height))])
    return np.where(t > 0, t, np.nan)


@pytest.mark.parametrize("kind", KINDS)
def test_without_the_surface_it_stops_at_the_edge_of_its_facet(kind, plate, bare):
    """Along x from the centre, the triangle's hypotenuse is a third away, the square's edge a half."""
    position, facets = plate(kind, 1, 1)
    one = replace(facets, **{n: getattr(facets, n)[:1] for n in ("element_id", "facet", "kind", "nodes", "region")})
    gauges = candidates(bare(position), one, (1, 0, 0))
    border = 1 / 3 if kind.startswith("tri") else 1 / 2
    for way, clipped in ((border - 1e-6, False), (border + 1e-6, True), (1e9, True)):
        moved, held = misplaced(position, gauges, None, np.array([[way, 0.0]]))
        assert held[0] == clipped
        np.testing.assert_allclose(moved.position[0] - gauges.position[0], [min(way, border), 0, 0], atol=1e-9)


@pytest.mark.parametrize("kind", ["tri6", "quad8"])
def test_on_a_tube_it_lies_above_its_place_on_the_tangent_plane(kind, tube, bare):
    R = 2.0
    position, facets = tube(kind, 24, 5, R, 0.1)
    gauges = candidates(bare(position), facets, (0, 0, 1), (20.0,))
    gauges = gauges.take(np.flatnonzero(np.abs(gauges.position[:, 2] - 2.5) < 1.1))
    offset = np.random.default_rng(3).uniform(-0.9, 0.9, (len(gauges), 2))
    moved, held = misplaced(position, gauges, facets, offset, np.full(len(gauges), 3.0))
    assert not held.any()
    away = moved.position - gauges.position
    across = np.cross(gauges.normal, gauges.direction)
    found = np.column_stack([np.sum(away * gauges.direction, axis=1), np.sum(away * across, axis=1)])
    np.testing.assert_allclose(found, offset, atol=1e-9)
    np.testing.assert_allclose(np.hypot(moved.position[:, 0], moved.position[:, 1]), R, rtol=1e-3)
    # On a tube that is rolled out, a direction carried along keeps its angle with the axis.
    angle = np.rad2deg(np.arccos(moved.direction[:, 2]))
    np.testing.assert_allclose(angle, 23.0, atol=0.5)
    np.testing.assert_allclose(np.sum(moved.direction * moved.normal, axis=1), 0, atol=1e-12)


def test_over_a_sharp_edge_it_is_held_and_over_a_smooth_one_it_is_not(tube, bare):
    for sides, clipped in ((8, True), (16, False)):
        position, facets = tube("quad4", sides, 1, 1.0)
        half = np.sin(np.pi / sides)
        gauges = candidates(bare(position), facets, (0, 0, 1), (90.0,))
        moved, held = misplaced(position, gauges, facets, np.tile([1.2 * half, 0.0], (len(gauges), 1)))
        np.testing.assert_array_equal(held, np.full(sides, clipped))
        away = np.linalg.norm(moved.position - gauges.position, axis=1)
        if clipped:
            np.testing.assert_allclose(away, half, atol=1e-9)
        else:
            assert np.all(away > 1.2 * half)


def test_a_grid_stays_within_the_edges_by_less_of_the_same(plate, bare):
    """2 m from the edge with half a grid of 0.8 m, it may go 1.2 m of 1.8 m, and turn by as much of its rotation."""
    position, facets = plate("quad8", 5, 4)
    gauges = candidates(bare(position), facets, (1, 0, 0), length=1.6)
    gauges = gauges.take(np.flatnonzero(np.all(np.isclose(gauges.position, [2.5, 1.5, 0]), axis=1)))
    moved, held = misplaced(position, gauges, facets, np.array([[2.4, 0.0]]), np.array([0.0]))
    assert held[0]
    np.testing.assert_allclose(moved.position[0], [4.2, 1.5, 0], atol=2.4 / 4096)
    assert moved.position[0, 0] <= 4.2 + 1e-9
    assert fits(position, moved, facets).all()
    free, held = misplaced(position, gauges, facets, np.array([[1.6, 0.3]]), np.array([4.0]))
    assert not held[0]
    np.testing.assert_allclose(free.position[0], [4.1, 1.8, 0], atol=1e-9)
    # Turned upright a grid of 3.2 m does not fit into 1.5 m below; a share of the turn does.
    tall, held = misplaced(position, replace(gauges, length=np.array([3.2])), facets, None, np.array([90.0]))
    assert held[0]
    assert fits(position, tall, facets).all()
    assert 0.5 < np.rad2deg(np.arccos(tall.direction[0, 0])) < 90


def test_a_rosette_moves_as_one(plate, bare):
    position, facets = plate("quad8", 6, 5, 0.2)
    rosettes = candidates(bare(position), facets, (1, 0, 0), (0.0, 45.0, 90.0), rosette=True)
    offset = np.random.default_rng(1).uniform(-1, 1, (rosettes.gauges, 2))
    rotation = np.full(rosettes.gauges, 5.0)
    moved, _ = misplaced(position, rosettes, facets, offset, rotation)
    for name in ("element", "position", "local", "gauge"):
        value = getattr(moved, name).reshape(rosettes.gauges, 3, -1)
        np.testing.assert_array_equal(value[:, 0], value[:, 2])
    turned = Rotation.from_euler("z", 5, degrees=True).apply(rosettes.direction)
    np.testing.assert_allclose(moved.direction, turned, atol=1e-12)
    single = rosettes.take(rosettes.first)
    alone, _ = misplaced(position, single, facets, offset, rotation)
    np.testing.assert_allclose(alone.position, moved.position[::3], atol=1e-14)


def test_an_accelerometer_tilts_with_the_surface(tube, bare):
    R = 1.0
    position, facets = tube("quad8", 24, 3, R)
    sensors = motion_candidates(bare(position), facets, ACCELERATION, ("normal", (0, 0, 1)))
    # d ∥ n: the offset is along `tangents`; every sensor moves by 0.2 m somewhere.
    moved, held = misplaced(position, sensors, facets, np.tile([0.14, 0.14], (sensors.gauges, 1)))
    inner = ~held[sensors.gauge]
    radial = moved.position * [1, 1, 0] / R
    normal = np.arange(len(sensors)) % 2 == 0
    np.testing.assert_allclose(moved.direction[normal & inner], radial[normal & inner], atol=2e-3)
    np.testing.assert_allclose(moved.direction[normal], moved.normal[normal], atol=1e-12)
    np.testing.assert_allclose(
        moved.direction[~normal & inner], np.tile([0, 0, 1.0], ((~normal & inner).sum(), 1)), atol=2e-3
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_displacement_sensor_reads_the_motion_of_its_point(kind, plate, bare):
    position, facets = plate(kind, 6, 5, 0.2)
    sensors = motion_candidates(bare(position), facets, DISPLACEMENT, ((1, 0, 0), (0, 2, 0), "normal"))
    rng = np.random.default_rng(2)
    G, shift = rng.standard_normal((3, 3)), rng.standard_normal(3)
    offset = rng.uniform(-0.5, 0.5, (sensors.gauges, 2))
    moved, held = misplaced(position, sensors, facets, offset)
    assert not held.all()
    rows = channel_rows(position, sensors, (position @ G.T + shift).reshape(-1, 1), facets=facets, offset=offset)
    np.testing.assert_allclose(rows.reshape(-1, 3), moved.position[::3] @ G.T + shift, atol=1e-9)

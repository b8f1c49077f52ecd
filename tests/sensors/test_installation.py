"""Gauges as installed and misplaced: drawn with the stated σ, read where they lie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from strainsight.sensors.candidates import ACCELERATION, candidates, concatenate, motion_candidates
from strainsight.sensors.installation import (
    COMMON,
    SECOND,
    InstallationStd,
    installation_variance,
    installed_rows,
    sample_installation,
    sensitivity_rows,
)
from strainsight.sensors.strain_operator import channel_rows, fits, misplaced

from .conftest import KINDS, bare, misplaced_rows, plate, tube

STD = InstallationStd(position=0.03, angle=0.05, gain=0.02, transverse=0.01, offset=3e-6, drift=2e-6)
FIRST = tuple(name for name in (*COMMON, "gain", "transverse", "mesh") if name not in SECOND)


def pool_of(position, facets, bare):
    """Rosettes of two grids, then accelerometers along an axis and the normal."""
    rosettes = candidates(bare(position), facets, (1, 0.2, 0.1), (0.0, 60.0), rosette=True)
    sensors = motion_candidates(bare(position), facets, ACCELERATION, ((1, 0.3, 0), "normal"))
    return concatenate([rosettes, sensors])


def within(values, std):
    """Whether Σ(x/σ)² of independent normal values is what χ² has in 999 of 1000 cases."""
    low, high = chi2.ppf([5e-4, 1 - 5e-4], np.size(values))
    return low < np.sum(np.square(values) / std**2) < high


def test_installation_errors_are_independent_with_given_std():
    position, facets = plate("quad4", 40, 30)
    pool = pool_of(position, facets, bare)
    drawn = sample_installation(pool, STD, np.random.default_rng(3))
    straining, sensing = pool.quantity != ACCELERATION, pool.quantity == ACCELERATION
    first = pool.first
    assert within(drawn.place, STD.position)
    assert within(drawn.angle, STD.angle)
    assert within(drawn.tilt[sensing[first]], STD.angle)
    assert within(drawn.gain, STD.gain)
    assert within(drawn.transverse[straining], STD.transverse)
    assert within(drawn.offset[straining], STD.offset)
    assert within(drawn.drift[straining], STD.drift)
    for nothing in (
        drawn.tilt[straining[first]],
        drawn.transverse[sensing],
        drawn.offset[sensing],
        drawn.drift[sensing],
    ):
        assert not nothing.any()
    table = np.column_stack([drawn.place, drawn.angle, drawn.gain[first]])
    correlation = np.corrcoef(table.T) - np.eye(4)
    assert np.abs(correlation).max() < 4 / np.sqrt(len(table))
    zeros = np.column_stack([drawn.offset, drawn.drift])[straining]
    assert np.abs(np.corrcoef(zeros.T)[0, 1]) < 4 / np.sqrt(len(zeros))


def test_thermal_output_has_common_and_individual_part():
    pool = pool_of(*plate("quad4", 4, 3), bare)
    std = InstallationStd(temperature=5.0, thermal_output=1e-6, thermal_spread=7e-7)
    draws = [sample_installation(pool, std, np.random.default_rng([8, i])) for i in range(2000)]
    read = np.array([own.drift for own in draws]) / (5.0 * 1e-6)
    straining = pool.quantity != ACCELERATION
    assert not read[:, ~straining].any()
    product = (read.T @ read / len(read))[np.ix_(straining, straining)]
    same = np.equal.outer(pool.gauge[straining], pool.gauge[straining])
    # T² is that of all channels of a draw, and scatters by √(2/2000)
    level = product[~same].mean()
    assert level == pytest.approx(1.0, abs=4 * np.sqrt(2 / 2000))
    assert product[same].mean() / level == pytest.approx(1 + 0.7**2, rel=0.05)
    assert np.ptp(read[:, pool.gauge == 0], axis=1).max() == 0


def test_bonded_gauges_have_gain_errors_only():
    pool = pool_of(*plate("quad4", 4, 3), bare)
    drawn = sample_installation(replace(pool, bonded=np.ones(len(pool), dtype=bool)), STD, np.random.default_rng(3))
    free = sample_installation(pool, STD, np.random.default_rng(3))
    for nothing in (drawn.place, drawn.angle, drawn.tilt):
        assert not nothing.any()
    np.testing.assert_array_equal(drawn.gain, free.gain)
    np.testing.assert_array_equal(drawn.transverse, free.transverse)
    assert drawn.offset.any()


def test_installation_of_subset_agrees_with_all():
    position, facets = plate("quad8", 6, 5, 0.1)
    pool = pool_of(position, facets, bare)
    field = np.random.default_rng(0).standard_normal((3 * len(position), 2))
    drawn = sample_installation(pool, STD, np.random.default_rng(5))
    every, held = installed_rows(position, pool, field, drawn, facets=facets)
    some = np.array([17, 3, 40])
    channels = pool.channels(some)
    own, kept = installed_rows(position, pool.take(channels), field, drawn.take(pool, some), facets=facets)
    np.testing.assert_allclose(own, every[channels], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(kept, held[some])


@pytest.mark.parametrize("kind", ["tri3", "quad8"])
def test_homogeneous_strain_is_read_with_gain_and_transverse_sensitivity_in_the_turned_direction(kind):
    position, facets = plate(kind, 5, 4, 0.2)
    position = position @ Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix().T
    pool = pool_of(position, facets, bare)
    drawn = sample_installation(pool, STD, np.random.default_rng(2))
    G = np.random.default_rng(6).standard_normal((3, 3))
    rows, _ = installed_rows(position, pool, (position @ G.T).reshape(-1, 1), drawn, facets=facets)
    d, n = pool.direction, pool.normal
    turned = Rotation.from_rotvec(drawn.angle[pool.gauge][:, None] * n).apply(d)
    along, across = (np.einsum("mi,ij,mj->m", a, G, a) for a in (turned, np.cross(n, turned)))
    expected = (1 + drawn.gain) * (along + drawn.transverse * across) / (1 - 0.285 * drawn.transverse)
    straining = pool.quantity != ACCELERATION
    np.testing.assert_allclose(rows[straining, 0], expected[straining], atol=1e-12)
    np.testing.assert_array_equal(drawn.transverse[~straining], 0.0)


def test_an_accelerometer_is_turned_about_the_normal_and_then_tilted_as_a_whole():
    position, facets = plate("quad4", 5, 4)
    sensors = motion_candidates(bare(position), facets, ACCELERATION, ((1, 0, 0), (0, 1, 0), "normal"))
    drawn = sample_installation(sensors, InstallationStd(angle=0.3), np.random.default_rng(2))
    # the fields are unit motions of the whole: what a channel reads of them is its direction
    unit = np.tile(np.eye(3), (len(position), 1))
    rows, held = installed_rows(position, sensors, unit, drawn, facets=facets)
    assert not held.any()
    d = rows.reshape(-1, 3, 3)
    np.testing.assert_allclose(d @ np.swapaxes(d, 1, 2), np.tile(np.eye(3), (len(d), 1, 1)), atol=1e-12)
    turned = Rotation.from_euler("z", drawn.angle[:, None]).as_matrix()
    for i, (turn, tilt) in enumerate(zip(turned, drawn.tilt, strict=True)):
        expected = Rotation.from_rotvec(turn @ [*tilt, 0.0]).as_matrix() @ turn
        np.testing.assert_allclose(d[i].T, expected, atol=1e-12)


def test_the_variance_of_a_motion_is_that_of_many_installations():
    position, facets = plate("quad8", 7, 6)
    pool = pool_of(position, facets, bare)
    inner = np.flatnonzero(np.all((pool.position[pool.first, :2] > 1) & (pool.position[pool.first, :2] < 5), axis=1))
    pool = pool.take(pool.channels(inner[::6]))
    bonded = pool.gauge < 4
    pool = replace(pool, bonded=bonded)
    Q = np.random.default_rng(5).standard_normal((2, 3, 3, 3))
    field = 1e-2 * np.einsum("ki,rcij,kj->kcr", position, Q, position).reshape(-1, 2)
    motion, rates = np.random.default_rng(1).standard_normal((2, 30, 2)) @ [[1.0, 0.4], [0.0, 0.7]]
    rates = 5 * rates
    std = InstallationStd(position=2e-3, angle=4e-3, gain=3e-3, transverse=2e-3, offset=4e-5, drift=6e-5)
    slopes = sensitivity_rows(position, pool, field, std.position, facets=facets)
    still, moving = motion.T @ motion / 30, rates.T @ rates / 30
    claimed = installation_variance(slopes, std, pool, still, moving)
    sensing, rng = pool.quantity == ACCELERATION, np.random.default_rng(8)
    exact, squares = channel_rows(position, pool, field, facets=facets), np.zeros(len(pool))
    for _ in range(100):
        drawn = sample_installation(pool, std, rng)
        rows, _ = installed_rows(position, pool, field, drawn, facets=facets)
        change = np.where(sensing, rates @ (rows - exact).T, motion @ (rows - exact).T) + drawn.offset
        change += np.outer((np.arange(30) + 0.5) / 30, drawn.drift)
        squares += np.mean(change**2, axis=0) / 100
    for alone, expected in (
        (InstallationStd(offset=4e-5), 1.6e-9),
        (InstallationStd(drift=6e-5), 1.2e-9),
        (InstallationStd(temperature=30.0, thermal_output=1e-6, thermal_spread=2e-6), 1.2e-9),
    ):
        found = installation_variance(slopes, alone, pool, still, moving)
        np.testing.assert_allclose(found, np.where(sensing, 0.0, expected), rtol=1e-12)
    for nothing in (slopes.tilt_along[~sensing], slopes.tilt_across[~sensing], slopes.transverse[sensing]):
        assert not nothing.any()
    # Of 100 squares of one normal error the mean scatters by √(2/100); of several less.
    assert np.all(np.abs(squares / claimed - 1) < 5 * np.sqrt(2 / 100))
    assert np.mean(squares / claimed) == pytest.approx(1.0, abs=5 * np.sqrt(2 / 100 / pool.gauges))


def test_small_errors_of_installation_change_readings_by_their_sensitivities():
    position, facets = plate("quad8", 9, 8)
    pool = pool_of(position, facets, bare)
    inner = np.flatnonzero(np.all((pool.position[pool.first, :2] > 1) & (pool.position[pool.first, :2] < 7), axis=1))
    pool = pool.take(pool.channels(inner))
    Q = np.random.default_rng(5).standard_normal((3, 3, 3))
    field = 1e-2 * np.einsum("ki,cij,kj->kc", position, Q, position).reshape(-1, 1)
    exact = channel_rows(position, pool, field, facets=facets)
    slopes = sensitivity_rows(position, pool, field, 0.01, facets=facets)
    left = []
    for size in (1e-2, 1e-3):
        std = InstallationStd(size, size, size, size)
        drawn = sample_installation(pool, std, np.random.default_rng(7))
        rows, _ = installed_rows(position, pool, field, drawn, facets=facets)
        common = np.column_stack([drawn.place, drawn.angle, drawn.tilt])[pool.gauge]
        own = np.column_stack([drawn.gain, drawn.transverse, drawn.mesh])
        first = sum(
            value[:, None] * getattr(slopes, name)
            for name, value in zip(FIRST, np.hstack([common, own]).T, strict=True)
        )
        left.append(np.abs(rows - exact - first).max())
        assert np.abs(rows - exact).max() > 20 * left[-1]
    assert left[1] == pytest.approx(left[0] / 100, rel=0.2)


@pytest.mark.parametrize("kind", KINDS)
def test_on_a_plate_it_is_found_on_whatever_facet_the_offset_leads_to(kind):
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
    share = np.nanmin(_crossings(gauges.position, meant, 8, 6)[~on], axis=1)
    stop = gauges.position[~on] + share[:, None] * (meant - gauges.position)[~on]
    np.testing.assert_allclose(moved.position[~on], stop, atol=1e-9)
    G = rng.standard_normal((3, 3))
    rows = misplaced_rows(position, gauges, (position @ G.T).reshape(-1, 1), facets, offset, rotation)
    np.testing.assert_allclose(rows[:, 0], np.einsum("mi,ij,mj->m", expected, G, expected), atol=1e-11)


def _crossings(a, b, width, height):
    """Shares of the way from a to b at which each of the four borders is crossed, nan where it is not ahead."""
    with np.errstate(all="ignore"):
        t = np.column_stack([(edge - a[:, i]) / (b - a)[:, i] for i, edge in ((0, 0), (0, width), (1, 0), (1, height))])
    return np.where(t > 0, t, np.nan)


@pytest.mark.parametrize("kind", KINDS)
def test_without_the_surface_it_stops_at_the_edge_of_its_facet(kind):
    position, facets = plate(kind, 1, 1)
    one = replace(facets, **{n: getattr(facets, n)[:1] for n in ("element_id", "facet", "kind", "nodes", "region")})
    gauges = candidates(bare(position), one, (1, 0, 0))
    border = 1 / 3 if kind.startswith("tri") else 1 / 2
    for way, clipped in ((border - 1e-6, False), (border + 1e-6, True), (1e9, True)):
        moved, held = misplaced(position, gauges, None, np.array([[way, 0.0]]))
        assert held[0] == clipped
        np.testing.assert_allclose(moved.position[0] - gauges.position[0], [min(way, border), 0, 0], atol=1e-9)


@pytest.mark.parametrize("kind", ["tri6", "quad8"])
def test_on_a_tube_it_lies_above_its_place_on_the_tangent_plane(kind):
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


def test_sharp_edge_limits_displacement():
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


def test_grid_displacement_is_reduced_at_edges():
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


def test_a_rosette_moves_as_one():
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


def test_an_accelerometer_tilts_with_the_surface():
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

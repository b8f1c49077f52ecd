"""Channels and gauges: rosettes, triaxial sensors, several families in one pool."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from strainsight.errors import InfeasibleError, UserError
from strainsight.gauges.candidates import ACCELERATION, DISPLACEMENT, STRAIN, Candidates, candidates, concatenate
from strainsight.gauges.motion import motion_candidates, spaced
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.zones import Box
from strainsight.mesh.facets import exterior_facets


@pytest.fixture
def pool(plate, bare) -> Candidates:
    """Nine rosettes and nine triaxial accelerometers."""
    position, facets = plate("quad4", 3, 3)
    rosettes = candidates(bare(position), facets, (1, 0, 0), (0.0, 45.0, 90.0), rosette=True, length=0.1)
    sensors = motion_candidates(bare(position), facets, ACCELERATION, ("normal", (1, 0, 0), (0, 3.0, 0)), array=2)
    return concatenate([rosettes, sensors])


def test_what_is_left_out_is_a_point_gauge_of_strain_at_the_centre(plate, bare):
    position, facets = plate("tri3", 2, 1)
    full = candidates(bare(position), facets, (1, 0, 0))
    old = [entry.name for entry in fields(Candidates)][:8]
    short = Candidates(*(getattr(full, name) for name in old))
    for entry in fields(Candidates):
        np.testing.assert_array_equal(getattr(short, entry.name), getattr(full, entry.name))
    np.testing.assert_allclose(full.local, 1 / 3)
    assert full.gauges == 4
    assert not full.bonded.any()
    assert set(full.quantity) == {STRAIN}


def test_the_angles_of_a_rosette_are_one_gauge(pool):
    assert pool.gauges == 18
    np.testing.assert_array_equal(pool.gauge, np.repeat(np.arange(18), 3))
    np.testing.assert_array_equal(pool.first, 3 * np.arange(18))
    np.testing.assert_array_equal(pool.angle[:6], [0, 45, 90, 0, 45, 90])
    np.testing.assert_array_equal(pool.array, np.repeat([0, 2], 27))
    np.testing.assert_array_equal(pool.quantity, np.repeat([STRAIN, ACCELERATION], 27))
    np.testing.assert_array_equal(pool.length, np.repeat([0.1, 0.0], 27))


def test_taking_gauges_numbers_them_on(pool):
    index = pool.channels(np.array([12, 2, 7]))
    np.testing.assert_array_equal(index, [36, 37, 38, 6, 7, 8, 21, 22, 23])
    part = pool.take(index)
    np.testing.assert_array_equal(part.gauge, np.repeat([0, 1, 2], 3))
    np.testing.assert_array_equal(part.array, np.repeat([2, 0, 0], 3))
    assert len(pool.take(pool.channels(np.zeros(0, dtype=int)))) == 0
    assert pool.take(np.zeros(0, dtype=int)).gauges == 0


def test_putting_together_what_was_taken_apart_changes_nothing(pool):
    parts = [pool.take(pool.channels(numbers)) for numbers in np.split(np.arange(18), [5, 6])]
    again = concatenate(parts)
    for entry in fields(Candidates):
        np.testing.assert_array_equal(getattr(again, entry.name), getattr(pool, entry.name))


def test_a_triaxial_sensor_on_a_body_in_motion_reads_the_motion_of_its_point(box_mesh):
    facets = exterior_facets(box_mesh)
    axes = ("normal", (1, 1, 0), (0, 0, -2))
    sensors = motion_candidates(box_mesh, facets, DISPLACEMENT, axes, on_constraints=True)
    shift, spin = np.random.default_rng(0).standard_normal((2, 3))
    z = shift + np.cross(spin, box_mesh.position)
    read = channel_rows(box_mesh.position, sensors, z.reshape(-1, 1))[:, 0].reshape(-1, 3)
    here = sensors.position[::3]
    motion = shift + np.cross(spin, here)
    normal = sensors.normal[::3]
    expected = [np.sum(motion * normal, axis=1), motion @ [np.sqrt(0.5), np.sqrt(0.5), 0], -motion[:, 2]]
    np.testing.assert_allclose(read, np.column_stack(expected), atol=1e-12)
    middle = box_mesh.position.mean(axis=0)
    assert np.all(np.sum((here - middle) * normal, axis=1) > 0)


@pytest.mark.parametrize("every", [0.09, 0.2, 0.33])
def test_sensors_every_so_far_are_that_far_apart_and_leave_no_gap(every, box_mesh):
    facets = exterior_facets(box_mesh)
    whole = motion_candidates(box_mesh, facets, ACCELERATION)
    thin = motion_candidates(box_mesh, facets, ACCELERATION, every=every)
    gap = np.linalg.norm(thin.position[:, None] - thin.position, axis=2) + 10 * np.eye(len(thin))
    assert gap.min() >= every * (1 - 1e-6)
    reach = np.linalg.norm(whole.position[:, None] - thin.position, axis=2).min(axis=1)
    assert reach.max() < every


def test_points_are_passed_over_in_their_order():
    x = np.array([[0.0, 0, 0], [0.9, 0, 0], [1.0, 0, 0], [1.5, 0, 0], [2.0, 0, 0]])
    np.testing.assert_array_equal(spaced(x, 1.0), [0, 2, 4])


def test_an_axis_of_no_length_is_refused(box_mesh):
    with pytest.raises(UserError, match="sensor axis") as caught:
        motion_candidates(box_mesh, exterior_facets(box_mesh), ACCELERATION, ((0, 0, 0),), key="motion_sensors.top")
    assert caught.value.key == "motion_sensors.top.axes"


def test_zones_to_include_are_together_one(box_mesh):
    facets = exterior_facets(box_mesh)
    left, right = Box((0, -1, -1), (0.3, 1, 1)), Box((0.8, -1, -1), (2, 1, 1))
    every = candidates(box_mesh, facets, (1, 0, 0))
    inner = candidates(box_mesh, facets, (1, 0, 0), include=(left, right))
    x = every.position[:, 0]
    np.testing.assert_array_equal(inner.position, every.position[(x <= 0.3) | (x >= 0.8)])
    both = candidates(box_mesh, facets, (1, 0, 0), include=(left, right), exclude=(left,))
    assert both.position[:, 0].min() > 0.8


NOWHERE, EVERYWHERE = Box((5, 5, 5), (6, 6, 6)), Box((-1, -1, -1), (2, 2, 2))


@pytest.mark.parametrize(
    ("arguments", "key", "count"),
    [
        ({"surface": "lonely"}, "gauges.surface", "takes the last 112: 112 exterior, 0 on the surface 'lonely'"),
        ({"include": (NOWHERE, NOWHERE)}, "gauges.include", "takes the last 80"),
        ({"exclude": (NOWHERE, EVERYWHERE)}, "gauges.exclude.1", "80 outside exclude.0, 0 outside exclude.1"),
        ({"include": (EVERYWHERE,), "exclude": (EVERYWHERE,)}, "gauges.exclude.0", "80 in zones to include"),
    ],
)
def test_the_step_that_leaves_no_facet_is_named(arguments, key, count, box_mesh):
    with pytest.raises(InfeasibleError, match="no facet is left") as caught:
        candidates(box_mesh, exterior_facets(box_mesh), (1, 0, 0), **arguments)
    assert caught.value.key == key
    assert count in caught.value.what


def test_facets_on_supports_alone_name_the_surface(box_mesh):
    with pytest.raises(InfeasibleError, match="6 on the surface 'root', 6 with an area, 0 away from constrained") as e:
        motion_candidates(box_mesh, exterior_facets(box_mesh), ACCELERATION, surface="root", key="motion_sensors.a")
    assert e.value.key == "motion_sensors.a.surface"

"""Sensors read what they are named for, and know their slopes."""

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.multibody.frames import Frame
from strainsight.multibody.relations import bearing_displacements
from strainsight.multibody.sensors import RelationSensor, StrainSensor, axis_sensor, position_sensor, readings


def test_slopes_of_all_sensors_are_their_differences(everything):
    e = everything
    tip = Frame("tip", "arm", np.ones(3), np.eye(3), np.ones((3, 3)), np.eye(3))
    strain = StrainSensor("gauge", "hub", np.arange(8.0).reshape(2, 4))
    displacements = bearing_displacements(Frame("wall"), tip)
    sensors = [
        position_sensor("tip", tip), position_sensor("tip speed", tip, rate=True), strain,
        axis_sensor("nose", tip, 0), RelationSensor("ring", displacements), RelationSensor("ring rate", displacements, rate=True),
    ]  # fmt: skip
    both = readings(e.system, sensors)
    y, by_q, by_v = both.read(e.q, e.v)
    assert len(both.channels) == len(y) == 21
    assert both.channels[:3] == ("gauge 1", "gauge 2", "tip: place of tip")
    np.testing.assert_allclose(y[:2], strain.rows @ e.q[:4])
    n, size = len(e.q), 0.05
    for k, unit in enumerate(np.eye(n)):

        def at(s, u=unit):
            return both.read(e.q + s * u, e.v)[0]

        slope = (8 * (at(size) - at(-size)) - (at(2 * size) - at(-2 * size))) / (12 * size)
        np.testing.assert_allclose(by_q[:, k], slope, atol=1e-11)
        np.testing.assert_allclose(by_v[:, k], both.read(e.q, e.v + unit)[0] - y, atol=1e-11)


def test_position_of_a_frame_is_that_of_its_particle(random_particles, everything):
    e = everything
    corner = Frame("corner", "rock", np.array([1.0, 2.0, 3.0]))
    y, *_ = readings(e.system, [position_sensor("corner", corner), axis_sensor("x", corner, 1)]).read(e.q, e.v)
    own = e.q[e.system.of["rock"]]
    R = own[3:].reshape(3, 3).T
    np.testing.assert_allclose(y, np.concatenate([own[:3] + R @ [1.0, 2.0, 3.0], R[:, 1]]), atol=1e-15)


def test_strain_rows_of_another_size_are_refused(everything):
    with pytest.raises(InfeasibleError, match="gauge: strain rows of 3 coordinates on body hub, which has 4"):
        readings(everything.system, [StrainSensor("gauge", "hub", np.zeros((1, 3)))])
    with pytest.raises(InfeasibleError, match="there is no body hob"):
        readings(everything.system, [StrainSensor("gauge", "hob", np.zeros((1, 3)))])

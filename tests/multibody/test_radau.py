"""Radau's collocation beside two others: the published pendulum, and an explicit method of eighth order on a jointed bench."""

import numpy as np
import pytest

from strainsight.multibody.initial import constraints_at
from strainsight.multibody.radau import simulate_radau

from .inverse.benches import bench
from .inverse.test_other_truth import walked
from .test_pendulum import pendulum


def swing(steps):
    system, q, v = pendulum()
    return system, simulate_radau(system, q, v, np.zeros((steps + 1, 0)), 1.0 / steps, np.zeros(0))


def test_bob_is_where_the_benchmark_has_it_and_the_error_is_of_fifth_order():
    ends = [swing(n)[1].q[-1, 3:5] for n in (10, 20, 40, 80)]
    np.testing.assert_allclose(ends[-1], [0.98629175, -0.16501085], atol=1e-8)
    errors = [np.linalg.norm(end - ends[-1]) for end in ends[:-1]]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(5, abs=0.5)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(5, abs=0.5)


def test_every_step_ends_on_the_constraints():
    system, run = swing(20)
    for q, v in zip(run.q, run.v, strict=True):
        phi, B = constraints_at(system, q)
        assert np.abs(phi).max() < 1e-14
        assert np.abs(B @ v).max() < 1e-13 * max(1.0, np.abs(v).max())


def test_a_bench_of_modes_up_to_392_hz_reads_as_by_an_explicit_method():
    """Loads that are straight over 10 ms, from rest, 50 ms; displacements are of 5e-4 m, and their bends shake 392 Hz."""
    b = bench()
    corners = np.array([[0, 0, 0], [4e3, -2e3, 3e3], [9e3, -1e3, 1e3], [5e3, 2e3, -2e3], [1e3, 4e3, 2e3], [0, 3e3, 6e3]])

    def loads(h):
        t = h * np.arange(round(0.05 / h) + 1)
        return np.column_stack([np.interp(t, 0.01 * np.arange(6), own) for own in corners.T])

    explicit, off = walked(b, loads(1e-3), 1e-3), []
    for parts in (1, 2):
        found = simulate_radau(b.system, b.q, np.zeros_like(b.q), loads(1e-3 / parts), 1e-3 / parts, b.theta)
        states = zip(found.q[parts::parts], found.v[parts::parts], strict=True)
        off.append(np.abs([b.sensors.read(q, v)[0] for q, v in states] - explicit).max())
    assert np.abs(explicit).max() > 4e-4
    assert off[0] < 5e-9
    assert off[1] < off[0] / 8

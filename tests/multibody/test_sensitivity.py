"""The derivatives of the step are those of its results."""

import numpy as np
import pytest

from strainsight.multibody.advance import advance, slopes
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.sensitivity import sensitivities
from strainsight.multibody.step import step


def differences(function, x, size):
    """Fourth-order central differences, column by column."""
    columns = []
    for unit in np.eye(len(x)):
        near = function(x + size * unit) - function(x - size * unit)
        far = function(x + 2 * size * unit) - function(x - 2 * size * unit)
        columns.append((8 * near - far) / (12 * size))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("h", [1e-3, 0.05])
def test_sensitivities_of_a_step_are_its_differences(everything, h):
    e = everything
    n = e.system.size
    w = np.random.default_rng(3).normal(size=n)

    def after(x, u, theta, w):
        new = step(e.system, x[:n], x[n:], u, h, theta, w=w)
        return np.concatenate([new.q, new.v])

    x = np.concatenate([e.q, e.v])
    found = sensitivities(e.system, step(e.system, e.q, e.v, e.u, h, e.theta, w=w))
    for exact, difference in (
        (found.A[:, :n], differences(lambda z: after(np.concatenate([z, e.v]), e.u, e.theta, w), e.q, 1e-4)),
        (found.A[:, n:], differences(lambda z: after(np.concatenate([e.q, z]), e.u, e.theta, w), e.v, 1e-3)),
        (found.B_u, differences(lambda z: after(x, z, e.theta, w), e.u, 1e-1)),
        (found.B_theta, differences(lambda z: after(x, e.u, z, w), e.theta, 1e-3)),
        (found.B_w, differences(lambda z: after(x, e.u, e.theta, z), w, 1e-1)),
    ):
        for half in (slice(0, n), slice(n, None)):
            np.testing.assert_allclose(exact[half], difference[half], rtol=0, atol=1e-7 * np.abs(exact[half]).max())


@pytest.mark.parametrize("method", ["second_order", "thesis"])
@pytest.mark.parametrize("h", [1e-3, 0.05])
def test_slopes_of_an_advance_are_its_differences(everything, h, method):
    """By the state, the loads at both ends, the parameters and a force, through all stages."""
    e, rng = everything, np.random.default_rng(3)
    n, w, u = e.system.size, rng.normal(size=e.system.size), (e.u, e.u + rng.normal(size=len(e.u)))
    x = np.concatenate([e.q, e.v])

    def after(x, start, end, theta, w):
        new = advance(e.system, x[:n], x[n:], (start, end), h, theta, method, w)
        return np.concatenate([new.q, new.v])

    at = [x, *u, e.theta, w]
    found = slopes(e.system, advance(e.system, e.q, e.v, u, h, e.theta, method, w))
    named = (found.A, found.B_start, found.B_end, found.B_theta, found.B_w)
    for place, (exact, size) in enumerate(zip(named, (1e-4, 1e-1, 1e-1, 1e-3, 1e-1), strict=True)):
        difference = differences(lambda z, i=place: after(*at[:i], z, *at[i + 1 :]), at[place], size)
        for half in (slice(0, n), slice(n, None)):
            # of a load before the step Euler knows nothing
            scale = max(np.abs(exact[half]).max(), 1e-3 * np.abs(found.B_end[half]).max())
            np.testing.assert_allclose(exact[half], difference[half], rtol=0, atol=1e-7 * scale)


def test_names_of_inputs_and_parameters_are_in_the_order_of_the_columns(everything):
    assert everything.system.inputs == ("Fx", "Fy", "Fh", "Mx", "My", "Mz", "Mh")
    assert everything.system.parameters == ("E", "s", "d")


def test_the_new_state_satisfies_the_constraints_whatever_the_old_one(everything):
    e = everything
    m = e.system.constrained
    new = step(e.system, e.q + 0.01 * e.rng.normal(size=len(e.q)), e.v, e.u, 0.01, e.theta)
    phi, B = constraints_at(e.system, new.q)
    assert len(phi) == m
    assert np.abs(phi).max() < 1e-14
    assert np.abs(B @ new.v).max() < 1e-12 * np.abs(new.v).max()

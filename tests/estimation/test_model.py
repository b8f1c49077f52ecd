"""The augmented step: its Jacobian against differences, its value against the reduced model's own simulation."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import ConfigError
from strainsight.estimation.model import constant_step, physical, step
from strainsight.rom.modal_step import simulate

KNOWN = 1e4 * np.array([[0.7], [0.4], [-0.3]])


def state(model, rng):
    """A state of the size a 1e4 N load causes, with unknowns of order one."""
    n = model.model.size
    omega = np.sqrt(np.diag(model.model.stiffness.at(model.model.reference)))
    q = 1e4 * model.model.input_shape[:, 0] / omega**2
    scale = np.abs(np.concatenate([q, q * omega, np.full(model.size - 2 * n, 0.3)]))
    return scale * rng.normal(size=model.size), scale


@pytest.mark.parametrize("graded", [False, True])
@pytest.mark.parametrize(
    ("inputs", "parameters"),
    [
        (("tip",), ()),
        ((), ("E",)),
        ((), ("rho",)),
        ((), ("rho", "E")),
        (("tip",), ("E", "rho")),
        (("tip", "middle"), ("E",)),
    ],
)
def test_jacobian_is_the_derivative_of_the_step(make_beam, make_filter, inputs, parameters, graded):
    beam = make_beam(modes=6, graded=graded, load_nodes=(16, 8))
    known = () if "middle" in inputs else ("middle",)
    model = make_filter(beam, inputs=inputs, parameters=parameters, known=known)
    x, scale = state(model, np.random.default_rng(3))
    u = KNOWN[:, : len(known)]

    def forward(points):
        return step(model, points, u)[0] / scale

    d, directions = 2e-3, np.diag(scale)
    differences = (
        8 * (forward(x + d * directions) - forward(x - d * directions))
        - (forward(x + 2 * d * directions) - forward(x - 2 * d * directions))
    ).T / (12 * d)
    J = step(model, x[None], u)[1][0] * scale / scale[:, None]
    largest = np.abs(J).max(axis=0)
    np.testing.assert_allclose(J / largest, differences / largest, atol=1e-7)


def test_without_noise_the_step_is_the_simulation_of_the_reduced_model(make_beam, make_filter, sine):
    beam, h = make_beam(), 5e-4
    model = make_filter(beam, inputs=(), parameters=("E", "rho"), known=("tip",), h=h)
    u = sine(h * np.arange(50), h, 1e4, 20.0)
    p = np.array([0.05, -0.08])
    x = np.concatenate([np.zeros(20), p])[None]
    expected = simulate(beam.model, {"E": 2.1e11 * np.exp(p[0]), "rho": 7850.0 * np.exp(p[1])}, u, h)
    for k in range(50):
        x, _ = step(model, x, u[k])
    np.testing.assert_allclose(x[0, :20], expected[-1], rtol=1e-10, atol=1e-12 * np.abs(expected[-1]).max())
    np.testing.assert_array_equal(x[0, 20:], p)


def test_the_step_computed_once_is_the_same_step(make_beam, make_filter):
    model = make_filter(make_beam(), inputs=("tip",))
    x = np.random.default_rng(0).normal(size=(3, model.size))
    nothing = np.zeros((3, 0))
    for once, again in zip(step(model, x, nothing, constant_step(model)), step(model, x, nothing), strict=True):
        np.testing.assert_array_equal(once, again)
    assert constant_step(make_filter(make_beam(), parameters=("E",), known=("tip",))) is None


def test_inputs_neither_known_nor_estimated_are_zero(make_beam, make_filter):
    beam = make_beam(load_nodes=(16, 8))
    model = make_filter(beam)
    assert np.all(step(model, np.zeros((1, 20)), np.zeros((3, 0)))[0] == 0)


def test_physical_values_and_deviations(make_beam, make_filter):
    model = make_filter(make_beam(), inputs=("tip",), parameters=("E",))
    mean, std = np.zeros((7, 2, 22)), np.zeros((7, 2, 22))
    mean[..., 20:], std[..., 20:] = [2.0, 0.1], [0.5, 1e-3]
    values = physical(model, mean, std)
    assert values["tip"][0].shape == (7, 2)
    np.testing.assert_allclose([v[3, 1] for v in values["tip"]], [2e4, 5e3])
    np.testing.assert_allclose([v[3, 1] for v in values["E"]], [2.1e11 * np.exp(0.1), 2.1e8 * np.exp(0.1)])


def test_a_model_that_contradicts_itself_is_refused(make_beam, make_filter):
    beam = make_beam()
    with pytest.raises(ConfigError, match="both known and estimated"):
        make_filter(beam, inputs=("tip",), known=("tip",))
    with pytest.raises(ConfigError, match="rho has no value"):
        make_filter(beam, parameters=("E",), known=("tip",), fixed={"E": 2.1e11})

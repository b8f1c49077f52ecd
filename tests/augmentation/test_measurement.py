"""Measurement rows are the derivative of what the sensor reads."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.augmentation.input_models import IntegratedRandomWalk, Matern
from strainsight.augmentation.linearisation import Unknowns, augment_rows, linearise
from strainsight.augmentation.measurement import measurement_rows
from strainsight.gauges.candidates import ACCELERATION, DISPLACEMENT, STRAIN
from strainsight.rom.model import damping_matrix


@pytest.mark.parametrize("models", [{}, {"tip": IntegratedRandomWalk(20.0), "side": Matern(5.0, 2.5)}])
def test_rows_of_every_sensor_are_the_derivative_of_its_reading(chain_of, theta, models):
    model = chain_of()
    unknowns = Unknowns(("side", "tip"), ("E", "rho"), {"tip": 40.0, "side": 7.0}, theta, models)
    rng = np.random.default_rng(1)
    n = model.size
    x, u = rng.normal(size=(2, 2 * n)) * np.repeat([1e-3, 1.0], n), rng.normal(size=(2, 2)) * 50
    rows, quantity = rng.normal(size=(3, n)), np.array([STRAIN, ACCELERATION, DISPLACEMENT])
    H = measurement_rows(rows, quantity, linearise(model, unknowns, theta, x, u))
    assert H.shape == (2, 3, unknowns.size(model))

    def reading(state):
        value, loads = dict(theta), np.zeros(2)
        at = unknowns.position(model)
        for i, name in enumerate(unknowns.inputs):
            loads[model.inputs.index(name)] = unknowns.amplitude[name] * state[at[i]]
        for i, name in enumerate(unknowns.parameters):
            value[name] = unknowns.guess[name] * np.exp(state[at[2 + i]])
        q, v = state[:n], state[n : 2 * n]
        force = model.input_shape @ loads - damping_matrix(model, value) @ v - model.stiffness.at(value) @ q
        return np.array([rows[0] @ q, rows[1] @ np.linalg.solve(model.mass.at(value), force), rows[2] @ q])

    for s in range(2):
        centre = np.zeros(unknowns.size(model))
        centre[: 2 * n] = x[s]
        for name, at in zip(unknowns.inputs, unknowns.position(model), strict=False):
            centre[at] = u[s, model.inputs.index(name)] / unknowns.amplitude[name]
        difference = np.empty_like(H[s])
        for j in range(len(centre)):
            step = np.zeros_like(centre)
            step[j] = 1e-4 if j >= 2 * n else 1e-4 * max(abs(centre[j]), 1e-6)
            difference[:, j] = (reading(centre + step) - reading(centre - step)) / (2 * step[j])
        largest = np.abs(H[s]).max(axis=1, keepdims=True)
        np.testing.assert_allclose(H[s] / largest, difference / largest, atol=1e-6)


def test_strain_and_displacement_rows_are_the_augmented_rows(chain_of, theta):
    model = chain_of()
    unknowns = Unknowns(("tip",), (), {"tip": 40.0}, theta)
    F = linearise(model, unknowns, theta, np.zeros((1, 2 * model.size)), np.zeros((1, 2)))[0]
    rows = np.random.default_rng(0).normal(size=(3, model.size))
    quantity = np.array([STRAIN, DISPLACEMENT, STRAIN])
    np.testing.assert_array_equal(measurement_rows(rows, quantity, F), augment_rows(rows, unknowns))


def test_an_accelerometer_feels_the_load_at_once(chain_of, theta):
    model = chain_of()
    unknowns = Unknowns(("tip",), (), {"tip": 40.0}, theta)
    F = linearise(model, unknowns, theta, np.zeros((1, 2 * model.size)), np.zeros((1, 2)))[0]
    row = model.input_shape[:, :1].T
    H = measurement_rows(row, np.array([ACCELERATION]), F)
    at = unknowns.position(model)[0]
    assert H[0, at] == pytest.approx(40.0 * float(row[0] @ np.linalg.solve(model.mass.at(theta), row[0])))

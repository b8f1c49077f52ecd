"""What the state of the filter means, and models that contradict themselves."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.augmentation.input_models import Matern, Oscillator
from strainsight.errors import ConfigError
from strainsight.estimation.model import inputs_of, loads_of, physical


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


def test_an_input_is_read_where_its_model_puts_it(make_beam, make_filter):
    beam = make_beam(modes=3, load_nodes=(16, 8))
    models = {"tip": Matern(5.0, 2.5), "middle": Oscillator(20.0)}
    model = make_filter(beam, inputs=("tip", "middle"), parameters=("E",), models=models)
    assert model.size == 6 + 3 + 2 + 1
    assert model.position.tolist() == [6, 9, 11]
    assert (model.input_states, model.parameter_states) == (slice(6, 11), slice(11, 12))
    mean = np.arange(12.0)
    values = physical(model, mean, mean / 10)
    assert values["tip"] == (6e4, pytest.approx(6e3))
    assert values["middle"] == (9e4, pytest.approx(9e3))
    assert values["E"][0] == pytest.approx(2.1e11 * np.exp(11.0))
    assert loads_of(model, mean, np.zeros(0)).tolist() == [6e4, 9e4]
    held = inputs_of(model, mean, np.zeros((3, 0)))
    assert held.shape == (3, 2)
    assert held[0].tolist() == [6e4, 9e4]

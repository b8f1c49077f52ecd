"""The two error numbers on histories whose error is known."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.estimation.metrics import honesty, input_error, parameter_error


def test_a_parameter_is_judged_by_its_mean_over_the_last_half():
    estimate = np.concatenate([np.full(50, 9.0), np.full(25, 2.2), np.full(25, 2.0)])
    assert parameter_error(estimate, 2.0) == pytest.approx(0.05)
    np.testing.assert_allclose(parameter_error(np.stack([estimate, -estimate], axis=1), -2.0), [2.05, 0.05])


def test_an_input_is_judged_against_the_load_vector_after_the_first_tenth():
    truth = np.tile([3.0, 4.0], (100, 1))
    estimate = truth + np.array([0.5, 0.0])
    estimate[:10] = 1e6
    np.testing.assert_allclose(input_error(estimate, truth), [0.1, 0.0])
    np.testing.assert_allclose(input_error(np.stack([estimate, truth], axis=1), truth), [[0.1, 0.0], [0.0, 0.0]])
    # a truth of its own for every run: each error over its own load
    own = np.stack([truth, 2 * truth], axis=1)
    np.testing.assert_allclose(input_error(own + np.array([0.5, 0.0]), own), [[0.1, 0.0], [0.05, 0.0]])
    with pytest.raises(ValueError, match="zero"):
        input_error(estimate, 0 * truth)


def test_honesty_is_real_over_claimed():
    error = np.random.default_rng(0).standard_normal((100, 400, 2)) * [1.0, 2.0]
    np.testing.assert_allclose(honesty(error, np.ones_like(error)), [1.0, 2.0], rtol=0.02)

"""Drawn truths have the statistics that the filter assumes."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.estimation.draws import covariance_factor, draw_truth
from strainsight.estimation.filter import run_filter


def test_moments_follow_the_linear_model(make_beam, make_filter):
    model = make_filter(make_beam(modes=2), inputs=("tip",), q_velocity=3.0)
    mean, P0 = np.array([0.0, 0, 0, 0, 0.5]), np.diag([0.0, 0.0, 1e-2, 1e-3, 0.3])
    steps, runs = 3, 40000
    nothing = np.zeros((steps, 3, 0))
    truth, y = draw_truth(model, mean, P0, nothing, range(runs))
    A = run_filter(model, mean, P0, nothing, np.zeros((steps, 4)), keep="all").jacobian[0, 0]
    P, expected = P0, mean
    for _ in range(steps):
        P, expected = A @ P @ A.T + model.process, A @ expected
    d = np.sqrt(np.diag(P))
    np.testing.assert_allclose(truth[-1].mean(axis=0) / d, expected / d, atol=5 / np.sqrt(runs))
    np.testing.assert_allclose(np.cov(truth[-1].T) / np.outer(d, d), P / np.outer(d, d), atol=8 / np.sqrt(runs))
    noise = (y[-1] - truth[-1] @ model.H.T) / np.sqrt(model.r / model.h)
    np.testing.assert_allclose(np.cov(noise.T), np.eye(4), atol=8 / np.sqrt(runs))


def test_a_run_depends_on_its_own_seed_alone(make_beam, make_filter):
    model = make_filter(make_beam(modes=2), inputs=("tip",))
    nothing = np.zeros((20, 3, 0))
    together = draw_truth(model, np.zeros(5), np.eye(5), nothing, [5, 6, 7])
    alone = draw_truth(model, np.zeros(5), np.eye(5), nothing, [6])
    for many, one in zip(together, alone, strict=True):
        np.testing.assert_allclose(many[:, 1], one[:, 0], rtol=1e-12, atol=1e-12 * np.abs(one).max())


@pytest.mark.parametrize("unit", [1.0, 1e-18, 1e18])
def test_a_singular_covariance_has_a_factor_of_its_rank(unit):
    X = np.random.default_rng(0).normal(size=(6, 3)) * np.array([1, 1e-8, 1, 1e6, 0, 1])[:, None]
    P = X @ X.T * unit
    F = covariance_factor(P)
    assert F.shape == (6, 3)
    d = np.where(np.diag(P) > 0, np.sqrt(np.diag(P)), 1.0)
    np.testing.assert_allclose(F @ F.T / np.outer(d, d), P / np.outer(d, d), atol=1e-12)
    assert covariance_factor(np.zeros((4, 4))).shape == (4, 0)

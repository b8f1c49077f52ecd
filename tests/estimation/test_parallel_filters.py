"""Linear filters side by side, in parts that are kept and parts that are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from strainsight.estimation.parallel_filters import LinearModels, advance, filters_of

A = np.array([[0.8, 0.1], [-0.1, 0.7]])
Q, H, R = np.diag([0.5, 0.2]), np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([0.3, 0.4])


def models() -> LinearModels:
    """One filter of two states and two channels, nothing known and no nuisance."""
    none = np.zeros((0, 0))
    return LinearModels(
        A[None], np.zeros((1, 2, 0)), Q[None], H[None], np.zeros((1, 2, 0)), np.zeros((1, 0, 2, 2)), np.zeros((1, 0, 2, 0)),
        np.zeros((0, 2, 2)), np.zeros((0, 2, 0)), np.zeros((0, 2)), np.zeros((0, 2, 0)), np.zeros((0, 2)), none, np.zeros(0),
    )  # fmt: skip


def passed(filters, samples, keep):
    L = len(samples)
    known = np.zeros((L, 0))
    return advance(models(), filters, known, known, samples, np.tile(R, (L, 1)), np.zeros(2), keep, 1)


@pytest.mark.parametrize("before", [0, 30, 200])
def test_innovations_have_the_covariance_of_the_riccati_equation_whatever_was_kept_before(before):
    """S = H P⁻Hᵀ + R, P⁻ by SciPy; a filter that had become steady in a part that was not kept had S = 0."""
    samples = np.random.default_rng(3).standard_normal((before + 300, 2))
    filters = filters_of(models(), np.zeros((1, 2)), np.eye(2), np.zeros((1, 0, 2)))
    passed(filters, samples[:before], keep=False)
    found = passed(filters, samples[before:], keep=True)
    P = solve_discrete_are(A.T, H.T, Q, np.diag(R))
    np.testing.assert_allclose(found.S[0, -1], H @ P @ H.T + np.diag(R), rtol=1e-11)
    if before > 100:
        np.testing.assert_allclose(found.S[0, 0], H @ P @ H.T + np.diag(R), rtol=1e-11)

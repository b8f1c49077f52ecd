"""The square-root form is Joseph's where both have digits, and keeps them where Joseph's loses them."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.estimation.belief import belief_of
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import run_filter
from strainsight.estimation.reduced import Driven
from strainsight.estimation.smoother import smooth
from strainsight.estimation.update import covariance_factor, pivoted_factors


def test_both_forms_agree(make_beam, make_filter):
    """Of a load and a parameter; of loads alone each agrees with filterpy (test_filter)."""
    model = make_filter(make_beam(modes=4), ("tip",), ("E",), accelerometers=1, q_velocity=0.1)
    u, P0 = np.zeros((80, 3, 0)), np.diag([0.0] * 8 + [0.01] * (model.size - 8))
    _, y = draw_truth(model, np.zeros(model.size), P0, u, [0, 1])
    y[5, 0, 1] = y[20:30, 1] = np.nan
    one, two = (
        run_filter(model, np.zeros(model.size), P0, u, y, "all", form=form) for form in ("joseph", "square_root")
    )
    d = np.maximum(one.std, 1e-300)
    np.testing.assert_allclose(two.mean / d, one.mean / d, atol=1e-9 * np.abs(one.mean / d)[1:].max())
    np.testing.assert_allclose(two.std[1:], one.std[1:], rtol=1e-9)
    np.testing.assert_allclose(two.whitened, one.whitened, atol=1e-9 * np.nanmax(np.abs(one.whitened)))
    np.testing.assert_allclose(two.log_likelihood, one.log_likelihood, rtol=1e-9)
    later = [smooth(model, run) for run in (one, two)]
    unknown = model.position
    np.testing.assert_allclose(later[1].mean[..., unknown], later[0].mean[..., unknown], atol=1e-7)
    np.testing.assert_allclose(later[1].std[..., unknown], later[0].std[..., unknown], rtol=1e-7)


@pytest.mark.parametrize(("noise", "joseph", "square_root"), [(1e-9, 1e-9, 1e-12), (1e-12, 1e-3, 1e-9)])
def test_at_tiny_noise_the_factor_keeps_its_digits(make_beam, make_filter, noise, joseph, square_root):
    """Oracle: the textbook recursion with 60 digits, in units of its own deviations. The load is known at first to 1e4 N."""
    model = make_filter(make_beam(modes=3), ("tip",), strain_noise=noise, gauges=(0.05, 0.3, 0.9))
    n, steps, P0 = model.size, 30, np.diag([0.0] * 6 + [1.0])
    with mpmath.workdps(60):
        A = mpmath.matrix(Driven(model, np.zeros((1, 3, 0))).step(np.zeros((1, n)), 0)[1][0].tolist())
        H, W, R, P = (
            mpmath.matrix(X.tolist()) for X in (model.H, covariance_factor(model.process), np.diag(model.noise), P0)
        )
        # Of the noise of a step the factor is what counts: rounded to a matrix it has lost the digits in question.
        Q = W * W.T
        for _ in range(steps):
            P = A * P * A.T + Q
            S = H * P * H.T + R
            P = P - P * H.T * S**-1 * H * P
        exact = np.array(P.tolist(), dtype=float)
    d = np.sqrt(np.diag(exact))
    error = {}
    for form in ("joseph", "square_root"):
        run = run_filter(model, np.zeros(n), P0, np.zeros((steps, 3, 0)), np.zeros((steps, 3)), form=form)
        error[form] = np.abs((run.last[0] - exact) / np.outer(d, d)).max()
    assert error["joseph"] < joseph
    assert error["square_root"] < square_root
    assert error["square_root"] < 0.01 * error["joseph"]


@pytest.mark.parametrize("form", ["joseph", "square_root"])
def test_a_long_run_stays_symmetric_and_positive(make_beam, make_filter, form):
    """17 states, a sample missing now and then so that the covariance never comes to rest; 10⁶ steps of it are in
    benchmarks/filter.py."""
    model = make_filter(make_beam(modes=8), ("tip",), q_velocity=0.1)
    mean, P = np.zeros(17), np.diag([0.0] * 16 + [1.0])
    rng = np.random.default_rng(0)
    for _ in range(2):
        y = 1e-6 * rng.standard_normal((500, 4))
        y[rng.random(y.shape) < 0.01] = np.nan
        run = run_filter(model, mean, P, np.zeros((500, 3, 0)), y, form=form)
        mean, P = run.mean[-1], run.last
        assert np.array_equal(P, np.swapaxes(P, 1, 2))
        d = np.sqrt(np.diagonal(P[0]))
        assert np.linalg.eigvalsh(P[0] / np.outer(d, d)).min() > 0


def test_a_factor_with_pivots_is_that_of_its_own_matrix_whatever_stands_beside_it():
    """Of P with states that nearly tell each other: the same digits alone and among two thousand; of rank 6 no seventh column
    that counts; and what is not finite is no zero."""
    near = np.array([[1.0, 1 - 1e-13], [1 - 1e-13, 1.0]])
    alone = pivoted_factors(near[None])[0]
    among = pivoted_factors(np.concatenate([np.tile(np.eye(2), (2000, 1, 1)), near[None]]))[-1]
    np.testing.assert_array_equal(alone, among)
    G = np.random.default_rng(0).normal(size=(40, 6))
    F = pivoted_factors((G @ G.T)[None])[0]
    np.testing.assert_allclose(F @ F.T, G @ G.T, atol=1e-12 * np.abs(G @ G.T).max())
    assert np.count_nonzero(np.abs(F).max(axis=0)) == 6
    with pytest.raises(np.linalg.LinAlgError):
        pivoted_factors(np.full((1, 2, 2), np.nan))


@pytest.mark.parametrize("form", ["joseph", "square_root"])
def test_what_innovations_are_expected_to_be_is_their_covariance(form):
    """L Lᵀ = H (A (P + before) Aᵀ + process) Hᵀ + R, multiplied out, L lower with a positive diagonal; sensors that are the same
    and have no noise are refused."""
    rng = np.random.default_rng(3)
    n, m = 6, 2
    P, before, process = (X @ X.T for X in rng.normal(size=(3, n, 3)))
    A, H, R = rng.normal(size=(1, n, n)), rng.normal(size=(1, m, n)), np.array([[0.3, 0.02]])
    L = belief_of(form, P[None]).expected(A, process, before, H, R, 0.1)[0]
    S = H[0] @ (A[0] @ (P + before) @ A[0].T + process) @ H[0].T + np.diag(R[0])
    np.testing.assert_allclose(L @ L.T, S, rtol=1e-12)
    assert np.all(np.diag(L) > 0)
    assert L[0, 1] == 0
    with pytest.raises(NumericalError, match=r"not positive definite at 0\.1 s"):
        belief_of(form, P[None]).expected(A, process, before, np.zeros((1, m, n)), 0 * R, 0.1)

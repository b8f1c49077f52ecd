"""What every criterion has to be for the searches and bounds to hold; one more in `CRITERIA` is asked the same."""

from __future__ import annotations

from typing import get_args

import mpmath
import numpy as np
import pytest

from strainsight.config.placement import PlaceSection
from strainsight.errors import NumericalError
from strainsight.placement.criteria import CRITERIA, Criterion, LogDeterminant, WorstEigenvalue, criterion_of

from ..variances import VARIANCE, variance

EVERY = pytest.mark.parametrize("criterion", CRITERIA, ids=lambda criterion: criterion.name)
SIZES = (1, 2, 5)
ROUNDING = 1e-15
"""Of a value, relative; a difference over a step h has that over h."""


def drawn(seed, k, spread=3.0):
    """A covariance (k, k) with eigenvalues over some decades."""
    rng = np.random.default_rng(seed)
    V = np.linalg.qr(rng.normal(size=(k, k)))[0]
    return (V * 10 ** rng.uniform(-spread, 0, k)) @ V.T


def steps(seed, k, count):
    """Increments D ≥ 0 of every rank."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        B = rng.normal(size=(k, 1 + i % k))
        yield B @ B.T


def test_every_criterion_is_registered():
    assert get_args(PlaceSection.model_fields["criterion"].annotation) == tuple(VARIANCE)
    assert [criterion.name for criterion in CRITERIA] == list(VARIANCE)
    assert [criterion_of(name) for name in VARIANCE] == list(CRITERIA)


@EVERY
@pytest.mark.parametrize("k", SIZES)
def test_it_is_a_variance_of_first_degree_that_does_not_fall(criterion, k):
    for seed in range(5):
        M = drawn(seed, k)
        assert criterion.value(M) == pytest.approx(variance(criterion.name, M), rel=1e-10)
        assert criterion.value(1e6 * M) == pytest.approx(1e6 * criterion.value(M), rel=1e-12)
        for D in steps(seed, k, 6):
            assert criterion.value(M + D) >= criterion.value(M)


@EVERY
@pytest.mark.parametrize("k", SIZES)
def test_its_inverse_is_concave_in_the_information(criterion, k):
    """1/c of the inverse is no less between two points than the chord says: what all bounds rest on."""
    for seed in range(20):
        one, two = drawn(seed, k), drawn(seed + 100, k)
        for share in (0.1, 0.5, 0.9):
            between = np.linalg.inv(share * np.linalg.inv(one) + (1 - share) * np.linalg.inv(two))
            chord = share / criterion.value(one) + (1 - share) / criterion.value(two)
            assert 1 / criterion.value(0.5 * (between + between.T)) >= chord * (1 - 1e-9)


@EVERY
@pytest.mark.parametrize("k", SIZES)
def test_its_gradient_is_that_of_differences_and_positive_semidefinite(criterion, k):
    for seed in range(5):
        M = drawn(seed, k, 1.0)
        W = criterion.gradient(M)
        assert np.linalg.eigvalsh(W).min() >= -1e-12 * np.abs(W).max()
        assert np.vdot(W, M) == pytest.approx(criterion.value(M), rel=1e-11)
        for D in steps(seed, k, 6):
            h = 1e-4 * np.linalg.eigvalsh(M)[0] / np.linalg.norm(D)
            slope = (criterion.value(M + h * D) - criterion.value(M - h * D)) / (2 * h)
            assert np.vdot(W, D) == pytest.approx(slope, rel=1e-5, abs=ROUNDING * criterion.value(M) / h)


@EVERY
@pytest.mark.parametrize("size", [1e-13, 1e-4, 0.5])
@pytest.mark.parametrize("gap", [0.0, 1e-7, 0.3])
@pytest.mark.parametrize("units", [(1, 1, 1), (1, 1e-2, 5)])
def test_a_rise_has_its_digits_however_small_it_is(criterion, size, gap, units):
    """Oracle: eigenvalues with 60 digits."""
    rng = np.random.default_rng(12)
    V = np.linalg.qr(rng.normal(size=(3, 3)))[0] * np.array(units)[:, None]
    B = V @ rng.normal(size=(3, 3))
    M, D = (V * np.array([0.2, 2.0 - gap, 2.0])) @ V.T, size * B @ B.T
    with mpmath.workdps(60):
        before, step = (mpmath.matrix((0.5 * (X + X.T)).tolist()) for X in (M, D))
        old, new = (list(mpmath.eigsy(X, eigvals_only=True)) for X in (before, before + step))
        expected = VARIANCE[criterion.name](new) - VARIANCE[criterion.name](old)
    assert criterion.rise(M, D) == pytest.approx(float(expected), rel=1e-9)


@EVERY
@pytest.mark.parametrize("k", SIZES)
def test_no_rise_is_less_than_it_says_that_the_slope_makes_sure(criterion, k):
    nearest = np.inf
    for seed in range(20):
        M = drawn(seed, k, 1.0)
        W = criterion.gradient(M)
        for D in steps(seed, k, 10):
            for t in (1e-6, 1.0, 1e3):
                t *= criterion.value(M)
                rise = criterion.rise(M, D * (t / np.vdot(W, D)))
                least = criterion.least_rise(M, t)
                assert rise >= least * (1 - 1e-9)
                nearest = min(nearest, rise / least if least else np.inf)
    assert nearest < 1.1 or type(criterion).least_rise is Criterion.least_rise


@EVERY
@pytest.mark.parametrize("k", SIZES)
def test_no_larger_increment_rises_less_than_it_says_that_one_lifts(criterion, k):
    nearest = np.inf
    for seed in range(20):
        M = drawn(seed, k, 1.0)
        for D, more in zip(steps(seed, k, 10), steps(seed + 100, k, 10), strict=True):
            for size in (1e-9, 1e-2, 10.0):
                own = D * (size * criterion.value(M) / np.trace(D))
                doubt = 0.1 * np.linalg.eigvalsh(own)[-1]
                sure, less = criterion.lifts(M, np.array([own, own + doubt * np.eye(k)]), np.array([0.0, doubt]))
                rise = criterion.rise(M, own)
                assert criterion.rise(M, own + size * more) >= sure * (1 - 1e-9)
                assert rise >= max(sure, less) * (1 - 1e-9)
                nearest = min(nearest, rise / sure if sure else np.inf)
    assert nearest < 1.1 or type(criterion).lifts is Criterion.lifts


@EVERY
@pytest.mark.parametrize("k", SIZES)
@pytest.mark.parametrize("temperature", [1e-3, 1.0])
def test_softened_it_is_near_and_its_gradient_bounds_the_criterion(criterion, k, temperature):
    soft = criterion.softened(temperature)
    for seed in range(10):
        M = drawn(seed, k, 1.0)
        value = criterion.value(M)
        assert value * (1 - 1e-12) <= soft.value(M) <= value + temperature * np.log(k) + 1e-12
        W = soft.gradient(M)
        for D in steps(seed, k, 6):
            h = 1e-4 * np.linalg.eigvalsh(M)[0] / np.linalg.norm(D)
            slope = (soft.value(M + h * D) - soft.value(M - h * D)) / (2 * h)
            assert np.vdot(W, D) == pytest.approx(slope, rel=1e-4, abs=ROUNDING * soft.value(M) / h)
        if soft != criterion:
            for other in range(20):
                N = drawn(other, k)
                assert np.vdot(W, N) <= criterion.value(N) * (1 + 1e-12)


def test_of_a_repeated_eigenvalue_no_vector_is_chosen():
    M = np.diag([1.0, 2.0, 2.0])
    np.testing.assert_allclose(WorstEigenvalue().gradient(M), np.diag([0.0, 0.5, 0.5]), atol=1e-15)
    assert WorstEigenvalue().rise(M, np.diag([1.0, 1e-6, 0.0])) == pytest.approx(1e-6, rel=1e-9)


def test_what_the_worst_combination_does_not_feel_is_no_rise():
    """Rounding may tilt the vector by 1e-17; what comes of that orders nothing."""
    tilt = np.array([[1.0, 1e-17], [-1e-17, 1.0]])
    for M in (np.diag([1.0, 2.0]), tilt @ np.diag([1.0, 2.0]) @ tilt.T):
        assert WorstEigenvalue().rise(M, np.array([[0.3, 1e-17], [1e-17, 1e-30]])) == 0.0
        assert WorstEigenvalue().rise(M, np.diag([0.3, 1e-9])) == pytest.approx(1e-9, rel=1e-6)


def test_a_combination_known_without_error_is_refused_by_the_determinant():
    M = np.ones((2, 2))
    for asked in (LogDeterminant().gradient, lambda M: LogDeterminant().rise(M, M)):
        with pytest.raises(NumericalError, match="numerically singular"):
            asked(M)

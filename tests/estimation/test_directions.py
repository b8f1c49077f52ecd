"""Filters on the directions of the considered constants that samples distinguish, against filters on all constants."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.estimation.directions import distinguished_directions
from strainsight.estimation.parallel_filters import Data, LinearModels, advance, build_filters

from .truth import plain_motion

N, M, KNOWN, STEPS, MOVING, LOADS, COUNT = 4, 2, 1, 60, 5, 1, 24
FIXED = np.arange(COUNT) < 2


def bilinear_models(rng):
    """One model whose 24 constants act on the readings by six rows, and on the motion by two matrices."""
    A = 0.95 * np.linalg.qr(rng.standard_normal((N, N)))[0]
    alike = rng.standard_normal((COUNT, 6)) / 6
    D, E, B = (np.tensordot(alike, rng.standard_normal((6, M, size)), 1) for size in (N, KNOWN, LOADS))
    A_nu, G_nu = (
        np.tensordot(0.02 * rng.standard_normal((MOVING, 2)), rng.standard_normal((2, N, size)), 1)
        for size in (N, KNOWN)
    )
    about = np.where(FIXED, 0.5, 0.0)
    motion = plain_motion(A[None], rng.standard_normal((1, N, KNOWN)), A_nu[None], G_nu[None])
    return LinearModels(
        motion, 0.01 * np.eye(N)[None], rng.standard_normal((1, M, N)), np.zeros((1, M, KNOWN)), D, E,
        np.zeros((COUNT, M)), B, rng.standard_normal((LOADS, N)), rng.standard_normal((LOADS, KNOWN)), about,
        np.zeros((1, COUNT)), FIXED,
    )  # fmt: skip


def passed(models, data):
    d = models.considered_count
    filters = build_filters(models, np.zeros((1, N)), np.eye(N), np.zeros((1, d, N)))
    fit = advance(models, filters, data, keep=False).fit.sum()
    return fit, filters.states


@pytest.fixture(scope="module")
def both():
    rng = np.random.default_rng(5)
    models = bilinear_models(rng)
    known, samples = 0.3 * rng.standard_normal((STEPS, KNOWN)), 0.3 * rng.standard_normal((STEPS, M))
    samples[7, 0] = np.nan
    data = Data(known, known, samples, np.full((STEPS, M), 0.04), np.zeros(M))
    whole = passed(models, data)
    kept = np.arange(COUNT) == 3
    Q = distinguished_directions(models, whole[1].left[0, 0], kept)
    return models, Q, whole, passed(models.in_directions(Q), data)


def test_directions_change_neither_likelihood_nor_constants(both):
    _, Q, (fit, states), (reduced_fit, reduced) = both
    assert Q.shape[1] < 0.8 * COUNT
    assert reduced_fit == pytest.approx(fit, abs=1e-5)
    everything = reduced.of_all(Q)
    np.testing.assert_allclose(everything.nu, states.nu, atol=1e-6)
    np.testing.assert_allclose(everything.left, states.left, atol=1e-6)
    np.testing.assert_allclose(everything.x, states.x, atol=1e-6)


def test_directions_do_not_mix_groups(both):
    """Effect on the motion, fixed slopes, truncated displacements, kept constants; what moves comes first."""
    models, Q, *_ = both
    np.testing.assert_allclose(Q.T @ Q, np.eye(Q.shape[1]), atol=1e-12)
    group = np.select([np.isin(np.arange(COUNT), (3,)), np.arange(COUNT) == MOVING - 1, FIXED], [1, 2, 3], 4)
    group[MOVING:] += 10
    of = [np.unique(group[np.abs(column) > 1e-14]) for column in Q.T]
    assert all(len(groups) == 1 for groups in of)
    first = [int(groups[0]) for groups in of]
    assert first[: len(first) - sum(g > 10 for g in first)] == sorted((g for g in first if g < 10), key=[3, 4, 1, 2].index)
    np.testing.assert_allclose(Q @ (Q.T @ models.about), models.about, atol=1e-12)

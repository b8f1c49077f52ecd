"""Linear filters side by side, in parts that are kept and parts that are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from strainsight import compiled
from strainsight.estimation import parallel_filters
from strainsight.estimation.compiled import motion, nuisances, readings, vectors
from strainsight.estimation.compiled.filters import take_steps
from strainsight.estimation.conditional import known_ends, linear_models
from strainsight.estimation.linear import plain_motion
from strainsight.estimation.parallel_filters import advance, filters_of
from strainsight.sweep.where import Where, opened

from .conftest import plain_models
from .two_masses import REFERENCE, chain, constants
from .two_masses import forces as both_forces
from .two_masses import start as start_of

A = np.array([[0.8, 0.1], [-0.1, 0.7]])
Q, H, R = np.diag([0.5, 0.2]), np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([0.3, 0.4])


def passed(filters, samples, keep):
    L = len(samples)
    known = np.zeros((L, 0))
    return advance(plain_models(A, Q, H), filters, known, known, samples, np.tile(R, (L, 1)), np.zeros(2), keep)


@pytest.mark.parametrize("before", [0, 30, 200])
def test_innovations_have_the_covariance_of_the_riccati_equation_whatever_was_kept_before(before):
    """S = H P⁻Hᵀ + R, P⁻ by SciPy; a filter that had become steady in a part that was not kept had S = 0."""
    samples = np.random.default_rng(3).standard_normal((before + 300, 2))
    filters = filters_of(plain_models(A, Q, H), np.zeros((1, 2)), np.eye(2), np.zeros((1, 0, 2)))
    passed(filters, samples[:before], keep=False)
    found = passed(filters, samples[before:], keep=True)
    P = solve_discrete_are(A.T, H.T, Q, np.diag(R))
    np.testing.assert_allclose(found.S[0, -1], H @ P @ H.T + np.diag(R), rtol=1e-11)
    if before > 100:
        np.testing.assert_allclose(found.S[0, 0], H @ P @ H.T + np.diag(R), rtol=1e-11)


def test_threads_change_no_bit(monkeypatch):
    monkeypatch.setattr(parallel_filters, "APART", 1)
    model = chain(tuple(REFERENCE)[:1])
    own, rng = constants(model), np.random.default_rng(6)
    at = linear_models(model, np.linspace(-0.2, 0.2, 5)[:, None], own)
    (B, m, n), d, known = at.H.shape, at.nuisances, both_forces()[:40, :, :1]
    samples, found = rng.standard_normal((40, m)), []
    for jobs in (1, 2, 3):
        filters = filters_of(at, np.zeros((B, n)), np.eye(n), np.zeros((B, d, n)))
        with opened(Where(jobs=jobs)):
            read = known.reshape(40, -1), known_ends(known, own), samples, np.ones((40, m)), np.zeros(m)
            found.append(advance(at, filters, *read, True))
    for other in found[1:]:
        np.testing.assert_array_equal(other.fit, found[0].fit)
        np.testing.assert_array_equal(other.states.P, found[0].states.P)


def test_loops_are_compiled_once_for_arrays_of_any_kind():
    samples = np.asfortranarray(np.random.default_rng(1).standard_normal((5, 2)))
    filters = filters_of(plain_models(A, Q, H), np.zeros((1, 2)), np.eye(2), np.zeros((1, 0, 2)))
    known, noise = np.zeros((5, 0)), np.broadcast_to(R, (5, 2))
    advance(plain_models(A, Q, H), filters, known, known, samples, noise, np.zeros(2), True)
    advance(plain_models(A, Q, H), filters, known, known, samples[::-1], np.tile(R, (5, 1)), np.zeros(2), False)
    assert len(take_steps.signatures) == 1


def test_loops_that_are_kept_notice_a_change_of_every_file():
    stamp = take_steps._cache._cache_file._source_stamp
    for module in (compiled, motion, nuisances, readings, vectors):
        file = Path(module.__file__).stat()
        assert (file.st_mtime, file.st_size) in stamp, module.__name__


def test_a_step_of_modes_apart_is_that_of_full_matrices():
    model = chain(tuple(REFERENCE)[:1])
    own = replace(constants(model), stiffness=0.01)
    apart = linear_models(model, np.array([[-0.2], [0.0], [0.1]]), own)
    assert apart.motion.pairs.shape[-1] == model.model.size
    full = replace(apart, motion=plain_motion(apart.A, apart.G, apart.A_nu, apart.G_nu))
    n, m = apart.H.shape[2], apart.H.shape[1]
    known, samples = both_forces()[:50, :, :1], 1e-6 * np.random.default_rng(4).standard_normal((50, m))
    samples[5, 0], samples[9] = np.nan, np.nan
    R = np.tile(1e-13 * np.arange(1.0, m + 1), (50, 1))
    found = []
    for each in (apart, full):
        filters = filters_of(each, np.zeros((3, n)), start_of()[:n, :n], np.zeros((3, each.nuisances, n)), consider=True)
        found.append(advance(each, filters, known.reshape(50, -1), known_ends(known, own), samples, R, np.zeros(m), True))
    for name in ("fit", "expected", "S", "slope"):
        one, other = (getattr(own, name) for own in found)
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10 * np.abs(other).max())
    for name in ("x", "P", "V", "nu", "left"):
        one, other = (getattr(own.states, name) for own in found)
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10 * np.abs(other).max())

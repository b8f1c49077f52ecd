"""Modes found from vectors that are near: as exact as without them, and none is missed that they know nothing of."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh

from strainsight.fem import modes as own
from strainsight.fem.krylov import _beside as beside
from strainsight.fem.krylov import largest
from strainsight.fem.modes import modes

N, COUNT = 400, 4
ROUNDING = 1e-10
"""Of a frequency: K has a condition of 1e5."""


def chain(n: int) -> sparse.csr_array:
    """Unit masses on unit springs, the first held, the last free."""
    K = sparse.diags_array([np.r_[np.full(n - 1, 2.0), 1.0], -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    return sparse.csr_array(K)


def of_chain(n: int, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and shapes (n, k) of its modes 1, 2, …, in closed form."""
    angle = (2 * numbers - 1) * np.pi / (2 * n + 1)
    shapes = np.sin(angle * np.arange(1, n + 1)[:, None])
    return 2 * np.sin(angle / 2) / (2 * np.pi), shapes / np.linalg.norm(shapes, axis=0)


@pytest.fixture
def no_lanczos(monkeypatch):
    """Lanczos iterations from nothing are an error."""

    def refused(*_):
        raise AssertionError("the near modes were not good enough")

    monkeypatch.setattr(own, "_lanczos", refused)


@pytest.mark.parametrize("off", [0.0, 1e-6, 1e-2])
def test_from_shapes_that_are_a_little_off_come_the_modes_themselves(off, no_lanczos):
    exact, shapes = of_chain(N, np.arange(1, COUNT + 3))
    near = shapes + off * np.random.default_rng(3).standard_normal(shapes.shape) / np.sqrt(N)
    frequency, found = modes(chain(N), sparse.eye_array(N, format="csr"), COUNT, near=near)
    assert np.allclose(frequency, exact[:COUNT], rtol=ROUNDING, atol=0)
    assert np.allclose(np.abs(np.einsum("ij,ij->j", found, shapes[:, :COUNT])), 1.0, rtol=0, atol=1e-12)


def test_a_mode_that_the_near_ones_have_no_part_of_is_found_all_the_same():
    """The second mode is missing among them, and iterations from them would never see it: exact modes stay exact modes."""
    exact, shapes = of_chain(N, np.arange(1, COUNT + 4))
    frequency, _ = modes(chain(N), sparse.eye_array(N, format="csr"), COUNT, near=np.delete(shapes, 1, axis=1))
    assert np.allclose(frequency, exact[:COUNT], rtol=ROUNDING, atol=0)


def test_of_two_equal_chains_no_copy_of_the_last_frequency_is_cut_off():
    """Three modes of two chains: the shapes of the second pair are those that no rounding chooses, with near modes or without."""
    K, M = sparse.block_diag([chain(N)] * 2, format="csr"), sparse.eye_array(2 * N, format="csr")
    exact, shapes = of_chain(N, np.arange(1, 4))
    near = np.kron(np.eye(2), shapes)
    alone = modes(sparse.csr_array(K), M, 3)
    beside = modes(sparse.csr_array(K), M, 3, near=near)
    for frequency, found in (alone, beside):
        assert np.allclose(frequency, exact[[0, 0, 1]], rtol=ROUNDING, atol=0)
        assert np.allclose(found, alone[1], rtol=0, atol=1e-9)


def test_too_few_near_vectors_are_no_help_and_no_harm():
    exact, shapes = of_chain(N, np.arange(1, COUNT + 1))
    frequency, _ = modes(chain(N), sparse.eye_array(N, format="csr"), COUNT, near=shapes)
    assert np.allclose(frequency, exact, rtol=ROUNDING, atol=0)


@pytest.mark.parametrize("massive", [60, 9])
@pytest.mark.parametrize("most", [24, 60])
def test_block_iterations_find_what_the_dense_solution_has(massive, most):
    """A triple eigenvalue, motions without mass, restarts after 24 vectors, and a range that is used up after 9."""
    rng = np.random.default_rng(5)
    n, count = 60, 5
    V = np.linalg.qr(rng.standard_normal((n, n)))[0]
    A = V @ np.diag(np.r_[1.0, 2.0, 2.0, 2.0, np.geomspace(3, 300, n - 4)]) @ V.T
    m = np.zeros(n)
    m[:massive] = 1.0
    M = V @ np.diag(m) @ V.T
    inverse = np.linalg.inv(A)
    start = inverse @ (M @ rng.standard_normal((n, 4)))
    mu, phi, left = largest(lambda X: inverse @ X, sparse.csr_array(M), count, start, most, 1e-11, beside=1)
    exact = eigh(M, A, eigvals_only=True)[::-1][: count + 1]
    assert np.allclose(mu[:count], exact[:count], rtol=1e-12, atol=0)
    assert np.abs(mu[count] - exact[count]) <= left[count] + 1e-12
    assert np.allclose(phi.T @ M @ phi, np.eye(count + 1), rtol=0, atol=1e-12)
    assert np.all(np.linalg.norm(M @ (inverse @ (M @ phi) - mu * phi), axis=0)[:count] <= 2e-11)


def test_vectors_that_depend_on_each_other_are_no_start_and_do_no_harm():
    exact, shapes = of_chain(N, np.arange(1, COUNT + 4))
    for near in (np.hstack([shapes, shapes[:, :1]]), np.hstack([shapes, np.zeros((N, 1))])):
        frequency, _ = modes(chain(N), sparse.eye_array(N, format="csr"), COUNT, near=near)
        assert np.allclose(frequency, exact[:COUNT], rtol=ROUNDING, atol=0)


def test_what_is_left_beside_a_span_is_found_under_a_hundred_times_as_much_within_it():
    rng = np.random.default_rng(2)
    Q = np.linalg.qr(rng.standard_normal((50, 6)))[0]
    W = rng.standard_normal((50, 3)) + 100 * Q @ rng.standard_normal((6, 3))
    M = sparse.eye_array(50, format="csr")
    q, Mq, R = beside(Q, M, W, W)
    assert q.shape == (50, 3)
    assert np.allclose(q.T @ Mq, np.eye(3), atol=1e-12)
    assert np.allclose(Q.T @ Mq, 0, atol=1e-12)
    assert np.allclose(q @ R, W - Q @ (Q.T @ W), atol=1e-11)

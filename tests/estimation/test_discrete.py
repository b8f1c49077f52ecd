"""Input models over one step: the load they hold and the noise they gather, against quadrature and small steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm, solve_continuous_are, solve_continuous_lyapunov, solve_discrete_are

from strainsight.augmentation.input_models import (
    IntegratedRandomWalk,
    Matern,
    Oscillator,
    RandomWalk,
    input_intensity,
    rate_matrix,
)
from strainsight.augmentation.linearisation import linearise
from strainsight.augmentation.unknowns import Unknowns
from strainsight.estimation.discrete import input_hold, input_transition, process_covariance
from strainsight.estimation.motion import step
from strainsight.estimation.update import predict, update

SMOOTH = [IntegratedRandomWalk(20.0), Matern(10.0, 0.5), Matern(10.0, 2.5), Oscillator(20.0, 0.02)]


def unknowns(*models):
    names = ("F", "G")[: len(models)]
    return Unknowns(names, (), dict(zip(names, (1e4, 30.0), strict=False)), {}, dict(zip(names, models, strict=True)))


@pytest.mark.parametrize("model", SMOOTH)
@pytest.mark.parametrize("h", [1e-4, 1e-2])
def test_the_gathered_noise_is_the_integral(model, h):
    A, Q = rate_matrix(model), input_intensity(model, 0.0)
    expected = quad_vec(lambda s: expm(A * s) @ Q @ expm(A * s).T, 0, h, epsrel=1e-12, epsabs=0)[0]
    F, full = np.zeros((4 + len(A), 4 + len(A))), np.zeros((4 + len(A), 4 + len(A)))
    F[4:, 4:], full[2, 2], full[4:, 4:] = A, 7.0, Q
    found = process_covariance(F, full, h)
    np.testing.assert_allclose(found[4:, 4:], expected, rtol=1e-9, atol=1e-12 * expected.max())
    assert found[2, 2] == pytest.approx(7.0 * h, rel=1e-12)
    assert np.linalg.eigvalsh(found[4:, 4:]).min() > -1e-12 * expected.max()
    many = process_covariance(F, np.stack([full, 3 * full]), h)
    np.testing.assert_allclose(many, [found, 3 * found], rtol=1e-12, atol=1e-15 * np.abs(found).max())


@pytest.mark.parametrize("model", [Matern(10.0, nu) for nu in (0.5, 1.5, 2.5)] + [Oscillator(20.0, 0.02)])
def test_a_stationary_input_stays_as_large_as_it_is(model):
    P = solve_continuous_lyapunov(rate_matrix(model), -input_intensity(model, 0.0))
    A, h = input_transition(unknowns(model), 2e-3), 2e-3
    Q = process_covariance(rate_matrix(model), input_intensity(model, 0.0), h)
    np.testing.assert_allclose(A @ P @ A.T + Q, P, atol=1e-12)


def test_walks_are_held_exactly_and_in_their_order():
    both = unknowns(RandomWalk(), IntegratedRandomWalk(20.0))
    omega = 2 * np.pi * 20
    hold = input_hold(both, 1e-3)
    np.testing.assert_allclose(hold[:, 0], [[1e4, 0, 0], [0, 0, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(hold[:, 1], [[0, 30, 0], [0, 0, 30 * omega * 1e-3], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(process_covariance(np.zeros((3, 3)), np.eye(3), 0.1), 0.1 * np.eye(3), rtol=1e-14)


@pytest.mark.parametrize("h", [1e-4, 1e-2, 0.3])
def test_what_a_load_moves_while_it_drifts_is_in_the_noise_of_a_step(h):
    """Two modes under a random walk, the second turning up to 600 rad in a step: the integral over the whole state."""
    omega, zeta = np.array([60.0, 2000.0]), 0.01
    F, Q = np.zeros((5, 5)), np.diag([0.0, 0.0, 1e-3, 1e-2, 5.0])
    F[:2, 2:4], F[2:4, :2], F[2:4, 2:4] = np.eye(2), -np.diag(omega**2), -np.diag(2 * zeta * omega)
    F[2:4, 4] = [30.0, 80.0]
    found = process_covariance(F, Q, h)
    x, w = np.polynomial.legendre.leggauss(20)
    pieces = max(4, int(2000 * h))
    nodes = np.concatenate([h / pieces * (i + 0.5 + 0.5 * x) for i in range(pieces)])
    expected = sum(
        weight * expm(F * s) @ Q @ expm(F * s).T for s, weight in zip(nodes, np.tile(0.5 * h / pieces * w, pieces), strict=True)
    )
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=1e-9)
    assert np.linalg.eigvalsh(found / np.outer(size, size)).min() > -1e-12


@pytest.mark.parametrize("model", SMOOTH)
def test_the_hold_passes_through_the_load(model):
    one, h = unknowns(model), 1e-3
    zeta = np.arange(1.0, 1.0 + len(rate_matrix(model)))
    c = input_hold(one, h)[:, 0] @ zeta
    for s in (0.0, 0.5, 1.0):
        assert c @ [1, s, s * s] == pytest.approx(1e4 * (expm(rate_matrix(model) * s * h) @ zeta)[0], rel=1e-10)


@pytest.mark.parametrize("model", [IntegratedRandomWalk(20.0), Oscillator(20.0), Matern(20.0, 1.5)])
def test_steady_covariance_tends_to_the_continuous_one_at_first_order(make_beam, make_filter, model):
    """The placement's Riccati equation (5.14) with A_u in F is the limit of the filter with the same input model."""
    beam = make_beam(modes=3)
    differences = []
    for h in 2.0 ** np.array([-16, -17, -18, -19]):
        filtering = make_filter(beam, ("tip",), models={"tip": model}, h=h, q_velocity=1e-2)
        n = filtering.size
        scale = np.concatenate([1 / np.sqrt(np.diag(beam.model.stiffness.at(beam.model.reference))), np.ones(n - 3)])
        F = linearise(beam.model, filtering.unknowns, filtering.fixed, np.zeros((1, 6)), np.zeros((1, 1)))[0]
        whitened = filtering.H * scale / np.sqrt(filtering.r)[:, None]
        limit = solve_continuous_are(
            (F * scale / scale[:, None]).T, whitened.T, filtering.Q / np.outer(scale, scale), np.eye(4)
        )
        A = step(filtering, np.zeros((1, n)), np.zeros((3, 0)))[1][0] * scale / scale[:, None]
        ahead = solve_discrete_are(A.T, whitened.T, filtering.process / np.outer(scale, scale), np.eye(4) / h)
        gain = ahead @ whitened.T @ np.linalg.inv(whitened @ ahead @ whitened.T + np.eye(4) / h)
        steady = ahead - gain @ whitened @ ahead
        again = predict(steady[None], A[None], filtering.process / np.outer(scale, scale))
        _, again, _ = update(np.zeros((1, n)), again, whitened, np.full((1, 4), 1 / h), np.zeros((1, 4)))
        d = np.sqrt(np.diag(limit))
        np.testing.assert_allclose(again[0] / np.outer(d, d), steady / np.outer(d, d), atol=1e-7)
        differences.append(np.abs((steady - limit) / np.outer(d, d)).max())
    rate = np.array(differences[:-1]) / differences[1:]
    assert differences[-1] < 1e-2
    np.testing.assert_allclose(rate[-2:], 2.0, atol=0.15)

"""The bank of filters against Bayes by brute force, the linear filter, and truths that it was made for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from strainsight.estimation import bank
from strainsight.estimation.bank import filter_bank
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import run_filter
from strainsight.estimation.mixture import removed_of

from .chain import KAPPA, NOISE, REFERENCE, ROWS, STEPS, chain, continuous, forces, gathered, influence, start, step_at
from .drawn import prior

WHITE = (0, 0, 1e-4, 1e-4, KAPPA)


def joint(p, P0, steps=STEPS, white=WHITE):
    """Mean and covariance of all readings at θ = reference·exp(p), one Gaussian of 2·steps numbers; white (5,): intensities."""
    A, drive = step_at(p)
    # the noise is that of the model at the guess
    Q = gathered(continuous(REFERENCE)[0], np.diag(white))
    read = np.einsum("mi,kijn->kmjn", ROWS, influence(A, steps)[1:, :2]).reshape(2 * steps, steps + 1, 5)
    mean = (read[:, 1:] @ drive) @ forces(steps)[:, 0, 0]
    noise = np.concatenate([read[:, :1] @ P0[:5, :5], read[:, 1:] @ Q], axis=1)
    covariance = noise.reshape(2 * steps, -1) @ read.reshape(2 * steps, -1).T
    return mean, 0.5 * (covariance + covariance.T) + NOISE**2 * np.eye(2 * steps)


def log_normal(y, mean, covariance):
    L = np.linalg.cholesky(covariance)
    e = np.linalg.solve(L, y - mean)
    return -0.5 * (e @ e) - np.log(np.diag(L)).sum() - 0.5 * len(y) * np.log(2 * np.pi)


@pytest.fixture(scope="module")
def measured():
    model, P = chain(), start()
    truth, y = draw_truth(model, np.zeros(7), P, forces(), [5])
    return model, P, truth[:, 0], y[:, 0]


@dataclass(frozen=True)
class Square:
    """Bayes by brute force: log of prior times likelihood on a square of points, 0.8 σ apart."""

    point: np.ndarray
    log_density: np.ndarray
    cell: float


@pytest.fixture(scope="module")
def square(measured):
    model, P, _, y = measured
    found = filter_bank(model, np.zeros(7), P, forces(), y, spacing=0.6, depth=20.0)
    mean, std = found.run.mean[-1, 0, 5:], found.run.std[-1, 0, 5:]
    axis = 0.8 * np.arange(-9, 10)
    point = mean + std * np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    prior_std = np.sqrt(np.diag(P)[5:])
    size = np.log(2 * np.pi * prior_std.prod())
    density = [log_normal(y.ravel(), *joint(p, P)) - 0.5 * np.sum((p / prior_std) ** 2) - size for p in point]
    return found, Square(point, np.array(density), 0.8**2 * std.prod())


def test_is_bayes_by_brute_force(square):
    found, own = square
    w = np.exp(own.log_density - own.log_density.max())
    edge = w.reshape(19, 19)[[0, -1]].max(), w.reshape(19, 19)[:, [0, -1]].max()
    assert max(edge) < 1e-8
    w /= w.sum()
    mean = w @ own.point
    std = np.sqrt(w @ (own.point - mean) ** 2)
    np.testing.assert_allclose(found.run.mean[-1, 0, 5:] / std, mean / std, atol=1e-6)
    np.testing.assert_allclose(found.run.std[-1, 0, 5:], std, rtol=1e-6)
    evidence = np.logaddexp.reduce(own.log_density) + np.log(own.cell)
    assert found.run.log_likelihood[0] == pytest.approx(evidence, abs=1e-3)


def test_the_lattice_used_by_default_is_fine_enough(measured):
    model, P, _, y = measured
    coarse = filter_bank(model, np.zeros(7), P, forces(), y)
    fine = filter_bank(model, np.zeros(7), P, forces(), y, spacing=0.6, depth=20.0)
    np.testing.assert_allclose(coarse.run.mean[-1], fine.run.mean[-1], atol=0.01 * fine.run.std[-1].max())
    np.testing.assert_allclose(coarse.run.std[-1, 0, 4:], fine.run.std[-1, 0, 4:], rtol=0.01)


@pytest.mark.parametrize("accelerometers", [0, 1])
def test_without_parameters_it_is_the_filter(make_beam, make_filter, accelerometers):
    model = make_filter(make_beam(modes=4), inputs=("tip",), parameters=(), known=(), accelerometers=accelerometers)
    mean, P, known = np.zeros(model.size), prior(model), np.zeros((60, 3, 0))
    _, y = draw_truth(model, mean, P, known, [1])
    y[7, 0, 1] = y[20, 0] = np.nan
    found, run = filter_bank(model, mean, P, known, y[:, 0]).run, run_filter(model, mean, P, known, y)
    scale = np.sqrt(np.diagonal(run.last[0]))
    for name in ("mean", "std"):
        np.testing.assert_allclose(getattr(found, name) / scale, getattr(run, name) / scale, atol=1e-9)
    for name in ("gauge_mean", "gauge_std", "whitened", "nis", "log_likelihood", "unknown_covariance"):
        np.testing.assert_allclose(getattr(found, name), getattr(run, name), rtol=1e-8, atol=1e-9)


def test_a_point_of_the_bank_is_the_filter_at_these_parameters(make_beam, make_filter, sine):
    """Known loads, accelerometers and frequencies that the parameters change."""
    beam = make_beam(modes=4, graded=True)
    model = make_filter(
        beam, inputs=(), parameters=("E", "rho"), known=("tip",), accelerometers=1, q_parameter=0.0, q_velocity=1e-4
    )
    u = sine(model.h * np.arange(40), model.h, 1e4, 20.0)
    mean, P = np.zeros(model.size), prior(model, 0.05)
    _, y = draw_truth(model, mean, P, u, [2])
    found = filter_bank(model, mean, P, u, y[:, 0])
    inner = model.parameter_states.start
    posterior = []
    for p in found.point:
        theta = {name: model.unknowns.guess[name] * np.exp(own) for name, own in zip(("E", "rho"), p, strict=True)}
        alone = replace(
            model,
            unknowns=replace(model.unknowns, parameters=()),
            fixed=theta,
            H=model.H[:, :inner],
            Q=model.Q[:inner, :inner],
        )
        object.__setattr__(alone, "process", model.process[:inner, :inner])
        run = run_filter(alone, mean[:inner], P[:inner, :inner], u, y)
        posterior.append(run.log_likelihood[0] - 0.5 * np.sum(p**2) / 0.05**2)
    w = np.exp(np.array(posterior) - max(posterior))
    np.testing.assert_allclose(found.weight, w / w.sum(), atol=1e-6)


def crescent():
    """The end of the chain under a slow force reads 1/k₁ + 1/k₂ and hardly more: model, covariance, force, samples."""
    model = chain()
    model = replace(model, H=model.H[:1] + model.H[1:], r=model.r[:1])
    P = start()
    P[4, 4], P[5, 5], P[6, 6] = 1e-12, 0.3**2, 0.3**2
    slow = np.zeros((4 * STEPS, 3, 1))
    slow[:, 0, 0] = 20 * np.sin(np.pi * np.arange(4 * STEPS) / (4 * STEPS)) ** 2
    quiet = replace(model, Q=np.diag([0, 0, 1e-6, 1e-6, 1e-12, 0, 0]))
    _, y = draw_truth(quiet, np.zeros(7), P, slow, [2])
    return quiet, P, slow, y[:, 0]


def test_a_curved_posterior_is_laid_as_often_as_it_narrows_and_not_at_every_step(monkeypatch):
    """A crescent, narrower at its peak than its covariance says: by lattices and by columns, against a lattice twice as fine."""
    quiet, P, slow, y = crescent()
    fine = filter_bank(quiet, np.zeros(7), P, slow, y, spacing=0.5, depth=10.0)
    expected, std = fine.posterior[0], np.sqrt(np.diag(fine.posterior[1]))
    for few, off, wider in ((bank.FEW, 0.05, 0.05), (1, 0.1, 0.1)):
        monkeypatch.setattr(bank, "FEW", few)
        found = filter_bank(quiet, np.zeros(7), P, slow, y)
        mean, covariance = found.posterior
        np.testing.assert_allclose(mean, expected, atol=off * std.min())
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), std, rtol=wider)
        assert found.laid < 30


def test_what_samples_remove_of_a_covariance_is_one_less_what_they_leave_without_growth():
    """Between 0 and 1 along every direction, one matrix that grows among many that do not."""
    rng = np.random.default_rng(4)
    axes = np.linalg.qr(rng.normal(size=(6, 5, 5)))[0]
    left = rng.uniform(0, 1, (6, 5))
    left[:, 0] = 1.0
    small = axes @ (left[..., None] * axes.swapaxes(1, 2))
    np.testing.assert_allclose(removed_of(small), np.eye(5) - small, rtol=0, atol=1e-14)
    left[2, 1] = 1.4
    grown = axes @ (left[..., None] * axes.swapaxes(1, 2))
    exact = axes @ ((1 - np.minimum(left, 1.0))[..., None] * axes.swapaxes(1, 2))
    np.testing.assert_allclose(removed_of(grown), exact, rtol=0, atol=1e-14)

"""The damping of a mode beside the parameters of a bank, off by more than a slope in it can say: Bayes by brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from strainsight.estimation import bank
from strainsight.estimation.bank import filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.conditional import no_nuisances

from .chain import RATIO, REFERENCE, ROWS, STIFFNESS, H, chain, driven_chain, forces

STEPS, SPREAD = 150, np.log(1.5)
NOISE, PRIOR = 3e-4, 0.1
TRUE = 0.08, np.array([1.4, -1.1])
"""ln k₁ over its guess, and ν of both modes: ζ is 5.3 and 1.9 % in place of 3 %."""


def readings(p, nu):
    """What the chain reads (..., T, 2) from rest under its force without process noise, and [q, q̇] (..., T, 4), by the
    textbook: q̈ + Φ diag(exp(SPREAD ν) 2ζω) Φᵀ q̇ + K q = f, exact in every step; p (...), nu (..., 2)."""
    K = np.exp(p)[..., None, None] * REFERENCE["k1"] * STIFFNESS["k1"] + REFERENCE["k2"] * STIFFNESS["k2"]
    lam, modes = np.linalg.eigh(K)
    C = (modes * (np.exp(SPREAD * nu) * 2 * RATIO * np.sqrt(lam))[..., None, :]) @ np.swapaxes(modes, -1, -2)
    F = np.zeros((*p.shape, 5, 5))
    F[..., :2, 2:4], F[..., 2:4, :2], F[..., 2:4, 2:4], F[..., 3, 4] = np.eye(2), -K, -C, 1.0
    F[..., 2:4, 4] = [0.0, 1.0]
    step, x, found = expm(F * H), np.zeros((*p.shape, 4)), []
    for force in forces(STEPS)[:, 0, 0]:
        x = (step[..., :4, :4] @ x[..., None])[..., 0] + step[..., :4, 4] * force
        found.append(x)
    motion = np.stack(found, axis=-2)
    return motion[..., :2] @ ROWS.T, motion


@pytest.fixture(scope="module")
def case():
    """Model, covariance, tolerances and samples; weights of a grid over p and ν, and p, ν and the motion there."""
    model = driven_chain(noise=NOISE, parameters=("k1",))
    model = replace(model, Q=np.zeros_like(model.Q))
    P = np.diag([1e-16] * 4 + [PRIOR**2])
    y = readings(np.array(TRUE[0]), TRUE[1])[0] + NOISE * np.random.default_rng(3).standard_normal((STEPS, 2))
    own, std = np.array([TRUE[0], *TRUE[1]]), np.array([1e-3, 0.04, 0.04])
    for _ in range(2):
        # the second time about what the first says
        p, first, second = (m + s * np.linspace(-5, 5, 11) for m, s in zip(own, std, strict=True))
        point = np.stack(np.meshgrid(p, first, second, indexing="ij"), axis=-1).reshape(-1, 3)
        read, motion = readings(point[:, 0], point[:, 1:])
        density = -0.5 * np.sum((y - read) ** 2, axis=(1, 2)) / NOISE**2
        density -= 0.5 * point[:, 0] ** 2 / PRIOR**2 + 0.5 * np.sum(point[:, 1:] ** 2, axis=1)
        w = np.exp(density - density.max())
        w /= w.sum()
        own = w @ point
        std = np.sqrt(w @ (point - own) ** 2)
    nuisances = replace(no_nuisances(model), damping=SPREAD)
    return model, P, nuisances, y, w, point, motion


def moments(w, values):
    mean = np.tensordot(w, values, axes=1)
    return mean, np.sqrt(np.tensordot(w, (values - mean) ** 2, axes=1))


def test_parameters_beside_it_are_bayes(case):
    model, P, nuisances, y, w, point, _ = case
    found = filter_bank(model, np.zeros(5), P, forces(STEPS), y, nuisances)
    mean, std = moments(w, point)
    assert abs(found.run.mean[-1, 0, 4] - mean[0]) < 0.05 * std[0]
    assert found.run.std[-1, 0, 4] == pytest.approx(std[0], rel=0.01)
    nu, left = found.nuisances
    assert np.abs((nu - mean[1:]) / std[1:]).max() < 0.1
    np.testing.assert_allclose(np.sqrt(np.diagonal(left)), std[1:], rtol=0.05)


def test_the_motion_that_is_learned_is_too(case):
    model, P, nuisances, y, w, _, motion = case
    nuisances = replace(nuisances, learned=True)
    found = filter_bank(model, np.zeros(5), P, forces(STEPS), y, nuisances)
    own = smooth_bank(model, np.zeros(5), P, forces(STEPS), y, nuisances, found)
    mean, std = moments(w, motion)
    off = (own.mean[1:, 0, :4] - mean) / std.max(axis=0)
    assert np.sqrt(np.mean(off**2)) < 0.1
    assert np.sqrt(np.mean(own.std[1:, 0, :4] ** 2, axis=0)) == pytest.approx(
        np.sqrt(np.mean(std**2, axis=0)), rel=0.05
    )
    # the filter at the end knows as much
    at_end = (found.run.mean[-1, 0, :4] - mean[-1]) / std[-1]
    assert np.abs(at_end).max() < 0.15


def test_a_damping_that_is_as_it_is_meant_to_be_is_not_looked_for(case):
    """Little of the damping is in question: slopes at what is meant to be do."""
    model, P, nuisances, y, *_ = case
    found = filter_bank(model, np.zeros(5), P, forces(STEPS), y, replace(nuisances, damping=1e-3))
    assert not found.about.any()


@pytest.mark.parametrize("driven", [True, False])
def test_the_end_alone_says_what_a_whole_pass_does(case, driven, monkeypatch):
    """The damping is looked for by filters without states along the samples: as by those with them, to rounding; under a load
    that is unknown, too, where these states are those of second filters."""
    model, P, nuisances, y, *_ = case
    y = y[:40]
    if not driven:
        model, P = chain(NOISE), np.diag([1e-4] * 4 + [1.0] + [PRIOR**2] * 2)
        nuisances = replace(no_nuisances(model), damping=SPREAD)
    quick = filter_bank(model, np.zeros(model.size), P, forces(40), y, nuisances)
    monkeypatch.setattr(bank, "_end_of", lambda problem: None)
    whole = filter_bank(model, np.zeros(model.size), P, forces(40), y, nuisances)
    assert quick.about.any()
    for name in ("about", "point", "weight", "nu", "left"):
        np.testing.assert_allclose(getattr(quick, name), getattr(whole, name), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(quick.run.mean, whole.run.mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(quick.run.std, whole.run.std, rtol=1e-9, atol=1e-12)

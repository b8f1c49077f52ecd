"""Banks over more parameters than a lattice is for, against normal densities, lattices, Bayes by brute force and drawn truths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline

from strainsight.errors import NumericalError
from strainsight.estimation.bank import filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.columns import Columns, weakest
from strainsight.estimation.conditional import no_nuisances
from strainsight.estimation.draws import draw_truth

from ..shared import slowly
from .chain import NOISE, REFERENCE, chain, forces, joint, log_normal, start
from .two_masses import chain as gauged_chain
from .two_masses import constants
from .two_masses import forces as both_forces
from .two_masses import start as gauged_start


def normal(k, seed=0):
    rng = np.random.default_rng(seed)
    factor = np.tril(rng.standard_normal((k, k)))
    return rng.standard_normal(k), factor @ factor.T + 0.1 * np.eye(k)


@pytest.mark.parametrize("k", [2, 4, 7])
def test_of_a_normal_density_they_have_the_moments_wherever_they_stand(k):
    mean, covariance = normal(k)
    prior = 1e4 * np.eye(k)
    f, A = weakest(covariance, prior)
    rng = np.random.default_rng(1)
    centre = mean + np.arange(-6, 7)[:, None] * f + rng.uniform(-0.3, 0.3, (13, k - 1)) @ A.T
    columns = Columns(centre, A, np.linalg.inv(prior))
    off = columns.point - mean
    own = columns.weights(-0.5 * np.sum(off * np.linalg.solve(covariance, off.T).T, axis=1)[None])
    linear = rng.standard_normal((3, k))
    values = (columns.point @ linear.T)[:, None]
    middle = np.einsum("tb,btn->tn", own.mean, values)
    np.testing.assert_allclose(middle[0], linear @ mean, rtol=1e-8)
    np.testing.assert_allclose(own.covariance(values, middle)[0], linear @ covariance @ linear.T, rtol=1e-6, atol=1e-6)
    point, weight, nu, _ = own.sampled(values[:, 0], np.zeros((len(values), 3, 3)))
    assert weight.sum() == pytest.approx(1.0)
    assert (weight > 0).all()
    np.testing.assert_allclose(weight @ point, mean, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose((point - mean).T * weight @ (point - mean), covariance, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(nu, point @ linear.T, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("k", [2, 5])
def test_the_weakest_direction_is_the_one_that_samples_leave_widest(k):
    _, covariance = normal(k, 2)
    _, prior = normal(k, 3)
    f, A = weakest(covariance, prior)
    np.testing.assert_allclose(np.outer(f, f) + A @ A.T, covariance, rtol=1e-9, atol=1e-12)
    w = np.linalg.solve(covariance, f)
    share = (w @ covariance @ w) / (w @ prior @ w)
    drawn = np.random.default_rng(4).standard_normal((2000, k))
    shares = np.einsum("ni,ij,nj->n", drawn, covariance, drawn) / np.einsum("ni,ij,nj->n", drawn, prior, drawn)
    assert share >= shares.max() * (1 - 1e-9)


def test_of_equally_weak_directions_the_first_parameter_decides():
    covariance = np.diag([0.5, 1.0, 1.0, 1.0]) + 1e-9 * normal(4)[1]
    f, _ = weakest(covariance, np.eye(4))
    np.testing.assert_allclose(np.abs(f), [0, 1, 0, 0], atol=1e-6)


def five(std):
    """Four springs in parallel in place of the chain's first, of this σ each: with it they share what samples say."""
    whole, names = chain(), tuple(f"k{i}" for i in range(1, 6))
    terms = whole.model.stiffness.terms
    own = dict.fromkeys(names[:4], terms["k1"] / 4) | {"k5": terms["k2"]}
    reference = dict.fromkeys(names[:4], REFERENCE["k1"]) | {"k5": REFERENCE["k2"]}
    inner = replace(whole.model, stiffness=replace(whole.model.stiffness, terms=own), reference=reference)
    unknowns = replace(whole.unknowns, parameters=names, guess=reference)
    H, Q = np.hstack([whole.H[:, :5], np.zeros((2, 5))]), np.pad(whole.Q[:5, :5], (0, 5))
    P = np.diag([*np.diag(start())[:5], *[std**2] * 4, 0.2**2])
    return replace(whole, model=inner, unknowns=unknowns, H=H, Q=Q), P


@pytest.fixture(scope="module")
def likelihood():
    """Samples of the chain, and the logarithm of their likelihood at ln k₁, ln k₂ by brute force."""
    _, y = draw_truth(chain(), np.zeros(7), start(), forces(), [5])
    axes = np.linspace(-0.6, 0.6, 33), np.linspace(-0.25, 0.25, 25)
    values = [[log_normal(y[:, 0].ravel(), *joint(np.array([a, b]), start())) for b in axes[1]] for a in axes[0]]
    return y[:, 0], RectBivariateSpline(*axes, np.array(values)).ev


@pytest.mark.parametrize("std", [*slowly(0.05), 0.2])
def test_parameters_that_samples_cannot_part_keep_what_was_known_of_them(likelihood, std):
    """The likelihood of four springs in parallel is that of their sum, and the posterior a sheet, bent the more, the wider the
    prior: against 300 000 draws from that."""
    y, log_likelihood = likelihood
    model, P = five(std)
    bank = filter_bank(model, np.zeros(10), P, forces(), y)
    draws = np.random.default_rng(1).standard_normal((300_000, 5)) * np.sqrt(np.diag(P)[5:])
    first = np.log(np.mean(np.exp(draws[:, :4]), axis=1))
    there = (np.abs(first) < 0.6) & (np.abs(draws[:, 4]) < 0.25)
    draws, first = draws[there], first[there]
    log_weight = log_likelihood(first, draws[:, 4])
    w = np.exp(log_weight - log_weight.max())
    w /= w.sum()
    mean = w @ draws
    exact = np.sqrt(w @ (draws - mean) ** 2)
    found, claimed = bank.posterior
    np.testing.assert_allclose((found - mean) / exact, 0.0, atol=0.1)
    np.testing.assert_allclose(np.sqrt(np.diag(claimed)), exact, rtol=0.02)
    assert (np.sqrt(np.diag(claimed))[:4] > 0.8 * std).all()


@pytest.mark.parametrize("learned", [True, *slowly(False)])
def test_with_constants_they_find_what_a_lattice_finds(monkeypatch, learned):
    model, P, known = gauged_chain(("k1", "k2")), gauged_start(7), both_forces()[:40, :, :1]
    own = replace(constants(model), learned=learned)
    _, y = draw_truth(model, np.zeros(7), P, known, [4])
    y[3, 0, 1] = y[9, 0] = np.nan

    def bank():
        return filter_bank(model, np.zeros(7), P, known, y[:, 0], own)

    lattice = bank()
    monkeypatch.setattr("strainsight.estimation.bank.FEW", 1)
    columns = bank()
    scale = lattice.run.std[1:]
    np.testing.assert_allclose(columns.run.mean[1:] / scale, lattice.run.mean[1:] / scale, atol=0.1)
    np.testing.assert_allclose(columns.run.std[1:], scale, rtol=0.03)
    np.testing.assert_allclose(columns.run.gauge_mean / NOISE, lattice.run.gauge_mean / NOISE, atol=0.1)
    np.testing.assert_allclose(columns.run.gauge_std, lattice.run.gauge_std, rtol=0.03)
    np.testing.assert_allclose(columns.run.whitened, lattice.run.whitened, atol=0.1)
    (nu, left), (expected, spread) = columns.nuisances, lattice.nuisances
    np.testing.assert_allclose(nu, expected, atol=0.1)
    np.testing.assert_allclose(np.sqrt(np.diag(left)), np.sqrt(np.diag(spread)), rtol=0.03)


def test_the_smoother_begins_where_the_filter_ends(likelihood):
    (y, _), (model, P) = likelihood, five(0.1)
    own = no_nuisances(model)
    bank = filter_bank(model, np.zeros(10), P, forces(), y, own)
    later = smooth_bank(model, np.zeros(10), P, forces(), y, own, bank)
    std = bank.run.std[-1, 0]
    np.testing.assert_allclose(later.mean[-1, 0] / std, bank.run.mean[-1, 0] / std, atol=0.05)
    np.testing.assert_allclose(later.std[-1, 0], std, rtol=0.03)
    assert (later.std[1:, 0] < 1.05 * bank.run.std[1:, 0]).all()


def test_readings_of_another_model_are_refused_and_not_followed_without_end(likelihood):
    (y, _), (model, P) = likelihood, five(0.2)
    with pytest.raises(NumericalError):
        filter_bank(model, np.zeros(10), P, forces(), 1e3 * y)

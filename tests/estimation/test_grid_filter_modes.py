"""A grid filter beside damping and frequencies that are not exact, and over more parameters than a lattice is for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline
from scipy.linalg import expm

from strainsight.errors import NumericalError
from strainsight.estimation.columns import Columns, weakest
from strainsight.estimation.conditional import linear_models, none_considered, tune_frequencies
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.record import GridRecord, Settled
from strainsight.fem.affine import AffineOperator
from strainsight.sensors.candidates import ACCELERATION

from ..shared import slowly
from .chain import RATIO, REFERENCE, ROWS, STIFFNESS, H, chain, driven_chain, forces, joint, log_normal, start
from .truth import draw_truth
from .two_masses import chain as gauged_chain
from .two_masses import constants
from .two_masses import forces as both_forces
from .two_masses import start as gauged_start

STEPS, NOISE = 150, 3e-4
DAMPING, SPREAD = np.log(1.5), 0.03
FREQUENCY = SPREAD * np.array([[1.0, 1.0], [0.5, 0.0]])
"""σ of ln ω of both modes by what they have in common, and of the first by itself."""
OFF = {"damping": np.array([0.08, 1.4, -1.1]), "frequency": np.array([0.05, 1.6, -0.7])}
"""ln k₁ over its guess, and ν: ζ is 5.3 and 1.9 % in place of 3 %."""
PRIOR = {"damping": 0.1, "frequency": 0.2}


def rates(p, nu, kind="frequency"):
    """Rate matrix (..., 4, 4) of [q, q̇] and column (..., 4) of the force, by the textbook: M q̈ + C q̇ + K q = f with a mass
    Φ diag(exp(−2 ln ω)) Φᵀ, which leaves K, and C = Φ diag(2ζω) Φᵀ; p (...), nu (..., 2)."""
    K = np.exp(p)[..., None, None] * REFERENCE["k1"] * STIFFNESS["k1"] + REFERENCE["k2"] * STIFFNESS["k2"]
    lam, Phi = np.linalg.eigh(K)
    zeta, omega = (np.exp(DAMPING * nu), 1 + 0 * nu) if kind == "damping" else (1 + 0 * nu, np.exp(nu @ FREQUENCY))
    PhiT = np.swapaxes(Phi, -1, -2)
    inverse = (Phi * omega[..., None, :] ** 2) @ PhiT
    A, b = np.zeros((*p.shape, 4, 4)), np.zeros((*p.shape, 4))
    A[..., :2, 2:], A[..., 2:, :2] = np.eye(2), -inverse @ K
    A[..., 2:, 2:] = -(Phi * (2 * RATIO * zeta * omega * np.sqrt(lam))[..., None, :]) @ PhiT
    b[..., 2:] = inverse[..., 1]
    return A, b


def readings(p, nu, kind="frequency"):
    """What the chain reads (..., T, 2) from rest under its force, and [q, q̇] (..., T, 4), exact in every step."""
    A, b = rates(p, nu, kind)
    F = np.zeros((*p.shape, 5, 5))
    F[..., :4, :4], F[..., :4, 4] = A, b
    step, x, found = expm(F * H), np.zeros((*p.shape, 4)), []
    for force in forces(STEPS)[:, 0, 0]:
        x = (step[..., :4, :4] @ x[..., None])[..., 0] + step[..., :4, 4] * force
        found.append(x)
    motion = np.stack(found, axis=-2)
    return motion[..., :2] @ ROWS.T, motion


@pytest.fixture(scope="module", params=list(OFF))
def case(request):
    """Model, covariance, tolerances and samples; weights of a grid over p and ν along the axes of its posterior, p with ν, and
    the motion there."""
    kind = request.param
    model = driven_chain(noise=NOISE, parameters=("k1",))
    model = replace(model, Q=np.zeros_like(model.Q))
    P, own, prior = np.diag([1e-16] * 4 + [PRIOR[kind] ** 2]), OFF[kind], np.array([PRIOR[kind], 1.0, 1.0])
    y = readings(own[0], own[1:], kind)[0] + NOISE * np.random.default_rng(3).standard_normal((STEPS, 2))
    for _ in range(3):
        ends, middle = own + 1e-5 * np.eye(3), readings(own[0], own[1:], kind)[0]
        slope = (readings(ends[:, 0], ends[:, 1:], kind)[0] - middle).reshape(3, -1) / 1e-5
        size, axes = np.linalg.eigh(slope @ slope.T / NOISE**2 + np.diag(1 / prior**2))
        grid = np.stack(np.meshgrid(*[s * np.linspace(-5, 5, 9) for s in size**-0.5], indexing="ij"), axis=-1)
        point = own + grid.reshape(-1, 3) @ axes.T
        read, motion = readings(point[:, 0], point[:, 1:], kind)
        density = -0.5 * np.sum((y - read) ** 2, axis=(1, 2)) / NOISE**2 - 0.5 * np.sum((point / prior) ** 2, axis=1)
        w = np.exp(density - density.max())
        w /= w.sum()
        own = w @ point
    considered = replace(
        none_considered(model), **({"damping": DAMPING} if kind == "damping" else {"frequency": FREQUENCY})
    )
    return kind, model, P, considered, y, w, point, motion


def moments(w, values):
    mean = np.tensordot(w, values, axes=1)
    return mean, np.sqrt(np.tensordot(w, (values - mean) ** 2, axes=1))


def test_parameters_with_damping_match_bayes(case):
    kind, model, P, considered, y, w, point, _ = case
    found = filter_on_grid(GridRecord(model, np.zeros(5), P, forces(STEPS), y, considered))
    mean, std = moments(w, point)
    off, wider = {"damping": (0.05, 0.01), "frequency": (0.1, 0.05)}[kind]
    assert abs(found.run.mean[-1, 0, 4] - mean[0]) < off * std[0]
    assert found.run.std[-1, 0, 4] == pytest.approx(std[0], rel=wider)
    if kind == "damping":
        nu, left = found.nu_moments
        assert np.abs((nu - mean[1:]) / std[1:]).max() < 0.1
        np.testing.assert_allclose(np.sqrt(np.diagonal(left)), std[1:], rtol=0.05)


def test_learned_motion_matches_bayes(case):
    kind, model, P, considered, y, w, _, motion = case
    considered = replace(considered, learned=True)
    found = filter_on_grid(GridRecord(model, np.zeros(5), P, forces(STEPS), y, considered))
    own = smooth_on_grid(GridRecord(model, np.zeros(5), P, forces(STEPS), y, considered), found)
    mean, std = moments(w, motion)
    off, wider = {"damping": (0.1, 0.05), "frequency": (0.2, 0.1)}[kind]
    assert np.sqrt(np.mean(((own.mean[1:, 0, :4] - mean) / std.max(axis=0)) ** 2)) < off
    claimed, real = np.sqrt(np.mean(own.std[1:, 0, :4] ** 2, axis=0)), np.sqrt(np.mean(std**2, axis=0))
    np.testing.assert_allclose(claimed, real, rtol=wider)
    assert np.abs((found.run.mean[-1, 0, :4] - mean[-1]) / std[-1]).max() < 1.5 * off


def test_nominal_damping_is_not_relinearised():
    model, P, y, tolerances = damped(driven=True)
    assert not filter_on_grid(
        GridRecord(model, np.zeros(5), P, forces(40), y, replace(tolerances, damping=1e-3))
    ).about.any()


def damped(driven):
    """Model, covariance, samples and tolerances of a chain whose damping is off, under its known force alone or both."""
    y = readings(OFF["damping"][0], OFF["damping"][1:], "damping")[0][:40]
    y = y + NOISE * np.random.default_rng(3).standard_normal(y.shape)
    model, P = chain(NOISE), np.diag([1e-4] * 4 + [1.0] + [0.1**2] * 2)
    if driven:
        model, P = driven_chain(noise=NOISE, parameters=("k1",)), np.diag([1e-16] * 4 + [0.1**2])
        model = replace(model, Q=np.zeros_like(model.Q))
    return model, P, y, replace(none_considered(model), damping=DAMPING)


@pytest.mark.parametrize("driven", [True, False])
def test_parameters_alone_are_those_of_a_whole_pass(driven):
    model, P, y, considered = damped(driven)
    whole = filter_on_grid(GridRecord(model, np.zeros(model.size), P, forces(40), y, considered))
    alone = filter_on_grid(GridRecord(model, np.zeros(model.size), P, forces(40), y, considered), keep="parameters")
    assert whole.about.any()
    for name in ("about", "point", "weight", "nu", "left"):
        np.testing.assert_allclose(getattr(alone, name), getattr(whole, name), rtol=1e-9, atol=1e-12)
    of = model.parameter_states
    np.testing.assert_allclose(alone.run.mean[..., of], whole.run.mean[..., of], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(alone.run.std[..., of], whole.run.std[..., of], rtol=1e-9, atol=1e-12)
    assert np.isnan(alone.run.mean[1:, :, : of.start]).all()
    assert np.isnan(alone.run.gauge_mean).all()


@pytest.mark.parametrize("about", [(0.0, 0.0), (1.2, -0.8)])
def test_a_step_and_its_slopes_are_those_of_other_masses(about):
    model, about = driven_chain(parameters=("k1",)), np.array(about)
    considered = replace(none_considered(model), frequency=FREQUENCY, about=about)
    p = np.array([0.1, -0.2])
    own = linear_models(model, p[:, None], considered)

    def step(nu):
        A, b = rates(p, np.broadcast_to(nu, (2, 2)))
        F = np.zeros((2, 5, 5))
        F[:, :4, :4], F[:, :4, 4] = A, b
        return expm(F * H)

    whole = step(about)
    np.testing.assert_allclose(own.A, whole[:, :4, :4], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(own.G[..., 0], whole[:, :4, 4], rtol=1e-9, atol=1e-12)
    for k, unit in enumerate(1e-4 * np.eye(2)):
        slope = (step(about + unit) - step(about - unit)) / 2e-4
        np.testing.assert_allclose(own.A_nu[:, k], slope[:, :4, :4], atol=1e-6 * np.abs(slope).max())
        np.testing.assert_allclose(own.G_nu[:, k, :, 0], slope[:, :4, 4], atol=1e-6 * np.abs(slope[:, :4, 4]).max())


def test_accelerometers_read_what_other_masses_do_at_once():
    """M⁻¹(f − C q̇ − K q) with M of the frequencies, and its slopes."""
    model = driven_chain(parameters=())
    model = replace(model, quantity=np.array([ACCELERATION, ACCELERATION]))
    considered, nothing = replace(none_considered(model), frequency=FREQUENCY), np.zeros((1, 0))
    own = linear_models(model, nothing, considered)
    for k, unit in enumerate(1e-4 * np.eye(2)):
        ends = [rates(np.zeros(()), sign * unit) for sign in (1, -1)]
        A, b = (ROWS @ (ahead - behind)[2:] / 2e-4 for ahead, behind in zip(*ends, strict=True))
        np.testing.assert_allclose(own.D[k], A, atol=1e-6 * np.abs(A).max())
        np.testing.assert_allclose(own.E[k, :, 0], b, atol=1e-6 * np.abs(b).max())


def test_tuned_frequencies_equal_centre():
    model = driven_chain(parameters=("k1",))
    considered = replace(none_considered(model), frequency=SPREAD * np.eye(2), centre=np.array([0.05]))
    own, shift = tune_frequencies(model, considered, np.array([[0.05], [0.4]]))
    first, second = (REFERENCE[name] * STIFFNESS[name] for name in ("k1", "k2"))
    lam = [np.linalg.eigvalsh(np.exp(p) * first + second) for p in (0.05, 0.4)]
    np.testing.assert_allclose(shift, np.stack([np.zeros(2), 0.5 * np.log(lam[0] / lam[1]) / SPREAD]), atol=1e-9)
    np.testing.assert_allclose(lam[1] * own.model.frequency_factors[1] ** 2, lam[0], rtol=1e-12)


def modulus_and_gain(gain):
    """Both springs by one factor E under a force with σ of its size `gain`: ω goes with √E; the model, and the error."""
    K = sum(value * STIFFNESS[name] for name, value in REFERENCE.items())
    model = driven_chain(noise=1e-5, parameters=("k1",))
    masses = replace(model.model, stiffness=AffineOperator(np.zeros((2, 2)), {"E": K}), reference={"E": 1.0})
    unknowns = replace(model.unknowns, parameters=("E",), guess={"E": 1.0})
    model = replace(model, model=masses, unknowns=unknowns, fixed={}, Q=np.zeros_like(model.Q))
    size = np.array([[[0.0, 0.0], [gain, 0.0]]])
    return model, replace(none_considered(model), source=("gain",), D=np.zeros((1, 2, 4)), E=np.zeros((1, 2, 1)),
                          offset=np.zeros((1, 2)), shape=size, load=np.array([0]))  # fmt: skip


def test_modulus_sigma_is_twice_frequency_sigma():
    model, exact = modulus_and_gain(2.0)
    y = readings(np.zeros(()), np.zeros(2))[0]

    def std(considered):
        P = np.diag([1e-16] * 4 + [0.3**2])
        return filter_on_grid(GridRecord(model, np.zeros(5), P, forces(STEPS), y, considered)).run.std[-1, 0, 4]

    assert std(exact) < 0.1 * SPREAD
    prior = (2 * SPREAD) ** -2 + 0.3**-2
    assert std(replace(exact, frequency=SPREAD * np.ones((1, 2)))) == pytest.approx(prior**-0.5, rel=0.03)


def test_frequencies_change_nothing_far_below_resonance():
    """A slow sine for all time: E is known as well as the size of the force, whatever is known of ω."""
    gain, size, slow, steps, noise = 0.05, 1.12, 0.01, 150, 1e-5
    model, exact = modulus_and_gain(gain)
    F = np.zeros((5, 5))
    F[:4, :4], F[:4, 4] = rates(np.zeros(()), np.zeros(2))
    step, phase = expm(F * H), slow * np.abs(np.linalg.eigvals(F[:4, :4])).min() * H
    known = np.pad(np.sin(phase * np.arange(steps))[:, None, None], [(0, 0), (0, 2), (0, 0)])
    tone = Settled(np.array([phase / H]), np.array([[[-1j], [0.0], [0.0]]]), 1e-9 * np.ones(4))
    X = np.linalg.solve(np.exp(1j * phase) * np.eye(4) - step[:4, :4], -1j * step[:4, 4])
    motion = (X * np.exp(1j * phase * np.arange(1, steps + 1))[:, None]).real
    y = size * motion[:, :2] @ ROWS.T + noise * np.random.default_rng(2).standard_normal((steps, 2))

    def posterior(considered):
        record = GridRecord(model, np.zeros(5), np.diag([1.0] * 4 + [0.3**2]), known, y, considered, settled=tone)
        (mean,), ((variance,),) = filter_on_grid(record).posterior
        return mean, np.sqrt(variance)

    mean, std = posterior(exact)
    assert std == pytest.approx(gain, rel=0.1)
    assert mean == pytest.approx(-np.log(size), abs=0.5 * std)
    for spread in (SPREAD, 0.1 * SPREAD):
        tolerated = posterior(replace(exact, frequency=spread * np.ones((1, 2))))
        assert tolerated == pytest.approx((mean, std), abs=0.02 * std)


def normal(k, seed=0):
    rng = np.random.default_rng(seed)
    factor = np.tril(rng.standard_normal((k, k)))
    return rng.standard_normal(k), factor @ factor.T + 0.1 * np.eye(k)


@pytest.mark.parametrize("k", [2, 4, 7])
def test_columns_reproduce_normal_moments(k):
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
def test_weakest_direction_has_largest_remaining_variance(k):
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
def test_indistinguishable_parameters_keep_prior(likelihood, std):
    """The likelihood of four springs in parallel is that of their sum: against 300 000 draws of the prior, weighed by it."""
    y, log_likelihood = likelihood
    model, P = five(std)
    grid_run = filter_on_grid(GridRecord(model, np.zeros(10), P, forces(), y, none_considered(model)))
    draws = np.random.default_rng(1).standard_normal((300_000, 5)) * np.sqrt(np.diag(P)[5:])
    first = np.log(np.mean(np.exp(draws[:, :4]), axis=1))
    there = (np.abs(first) < 0.6) & (np.abs(draws[:, 4]) < 0.25)
    draws, first = draws[there], first[there]
    log_weight = log_likelihood(first, draws[:, 4])
    w = np.exp(log_weight - log_weight.max())
    w /= w.sum()
    mean = w @ draws
    exact = np.sqrt(w @ (draws - mean) ** 2)
    found, claimed = grid_run.posterior
    np.testing.assert_allclose((found - mean) / exact, 0.0, atol=0.1)
    np.testing.assert_allclose(np.sqrt(np.diag(claimed)), exact, rtol=0.02)
    assert (np.sqrt(np.diag(claimed))[:4] > 0.8 * std).all()


@pytest.mark.parametrize("learned", [True, *slowly(False)])
def test_columns_match_grid(monkeypatch, learned):
    model, P, known = gauged_chain(("k1", "k2")), gauged_start(7), both_forces()[:40, :, :1]
    own = replace(constants(model), learned=learned)
    _, y = draw_truth(model, np.zeros(7), P, known, [4])
    y[3, 0, 1] = y[9, 0] = np.nan

    def grid_run():
        return filter_on_grid(GridRecord(model, np.zeros(7), P, known, y[:, 0], own))

    on_grid = grid_run()
    monkeypatch.setattr("strainsight.estimation.grid_filter.FEW", 1)
    columns = grid_run()
    scale = on_grid.run.std[1:]
    np.testing.assert_allclose(columns.run.mean[1:] / scale, on_grid.run.mean[1:] / scale, atol=0.1)
    np.testing.assert_allclose(columns.run.std[1:], scale, rtol=0.03)
    np.testing.assert_allclose(columns.run.gauge_mean, on_grid.run.gauge_mean, atol=0.1 * 2e-3)
    np.testing.assert_allclose(columns.run.gauge_std, on_grid.run.gauge_std, rtol=0.03)
    np.testing.assert_allclose(columns.run.whitened, on_grid.run.whitened, atol=0.1)
    (nu, left), (expected, spread) = columns.nu_moments, on_grid.nu_moments
    np.testing.assert_allclose(nu, expected, atol=0.1)
    np.testing.assert_allclose(np.sqrt(np.diag(left)), np.sqrt(np.diag(spread)), rtol=0.03)


def test_smoother_starts_at_filter_end(likelihood):
    (y, _), (model, P) = likelihood, five(0.1)
    own = none_considered(model)
    grid_run = filter_on_grid(GridRecord(model, np.zeros(10), P, forces(), y, own))
    later = smooth_on_grid(GridRecord(model, np.zeros(10), P, forces(), y, own), grid_run)
    std = grid_run.run.std[-1, 0]
    np.testing.assert_allclose(later.mean[-1, 0] / std, grid_run.run.mean[-1, 0] / std, atol=0.05)
    np.testing.assert_allclose(later.std[-1, 0], std, rtol=0.03)
    assert (later.std[1:, 0] < 1.05 * grid_run.run.std[1:, 0]).all()


def test_readings_of_another_model_are_refused(likelihood):
    (y, _), (model, P) = likelihood, five(0.2)
    with pytest.raises(NumericalError):
        filter_on_grid(GridRecord(model, np.zeros(10), P, forces(), 1e3 * y, none_considered(model)))

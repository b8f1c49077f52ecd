"""The most likely value of a stiffness against the likelihood of the textbook's motion at every value."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from strainsight.estimation.claim import predict_grid_std
from strainsight.estimation.conditional import ConsideredParameters, none_considered
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.peak import MOST_SCANNED, build_scan_grid, find_hills, find_peak, resonance_widths
from strainsight.estimation.record import GridRecord, Settled, start_errors
from strainsight.rom.model import Damping

from ..shared import slowly
from .chain import RATIO, REFERENCE, ROWS, STIFFNESS, H, continuous, driven_chain, finer

STD = 0.3
VALUES = np.linspace(-1.2, 1.2, 2001)
"""Of p, which lie closer than a fifth of the narrowest σ below."""
NO_OFFSETS = np.zeros(0, dtype=int)
AMPLITUDE = 3.0


def steps_of(p):
    """Transitions (n, 4, 4) of [q, q̇] at p (n,), and what a force that is constant within a step adds (n, 4)."""
    whole = np.zeros((len(p), 5, 5))
    for block, value in zip(whole, p, strict=True):
        F, column = continuous({"k1": REFERENCE["k1"] * np.exp(value), "k2": REFERENCE["k2"]})
        block[:4, :4], block[:4, 4] = F[:4, :4], column[:4]
    step = expm(whole * H)
    return step[:, :4, :4], step[:, :4, 4]


def settled_readings(p, phase, steps):
    """Under AMPLITUDE sin(phase · j), for all time (n, steps, 2)."""
    A, b = steps_of(p)
    z = np.exp(1j * phase)
    X = np.linalg.solve(z * np.eye(4) - A, -1j * AMPLITUDE * b[..., None])[:, None, :, 0]
    return (X * z ** np.arange(1, steps + 1)[:, None]).real[..., :2] @ ROWS.T


def readings_from_rest(p, force):
    A, b = steps_of(p)
    x = [np.zeros_like(b)]
    for load in force:
        x.append((A @ x[-1][..., None])[..., 0] + b * load)
    return np.stack(x[1:], axis=1)[..., :2] @ ROWS.T


def log_density(readings, y, noise):
    """Of VALUES, but for a constant."""
    off = np.sum((readings(VALUES) - y) ** 2, axis=(1, 2))
    return -0.5 * (off / noise**2 + (VALUES / STD) ** 2)


def model_of(noise):
    model = driven_chain(noise, ("k1",))
    return replace(model, Q=0 * model.Q)


def prior(motion):
    return np.diag([motion**2] * 4 + [STD**2])


def held(force):
    return np.pad(force[:, None, None], [(0, 0), (0, 2), (0, 0)])


def tone_of(phase, steps):
    tone = np.array([[[-1j * AMPLITUDE], [0.0], [0.0]]])
    return held(AMPLITUDE * np.sin(phase * np.arange(steps))), Settled(np.array([phase / H]), tone, 1e-9 * np.ones(4))


@pytest.mark.parametrize(("truth", "noise"), [(0.45, 1e-3), (-0.55, 1e-3), (0.7, 5e-3)])
def test_peak_search_finds_global_maximum(truth, noise):
    force = AMPLITUDE * np.sin(0.7 * np.arange(150))
    y = readings_from_rest([truth], force)[0] + noise * np.random.default_rng(1).standard_normal((150, 2))
    density = log_density(lambda p: readings_from_rest(p, force), y, noise)
    model = model_of(noise)
    peak = find_peak(GridRecord(model, np.zeros(5), prior(1e-9), held(force), y, none_considered(model), NO_OFFSETS, None))
    weight = np.exp(density - density.max())
    std = np.sqrt(np.cov(VALUES, aweights=weight))
    assert peak.point[0] == pytest.approx(VALUES[np.argmax(density)], abs=0.3 * std)
    constant = -150 * np.log(2 * np.pi * noise**2) - 0.5 * np.log(2 * np.pi * STD**2)
    integral = density.max() + np.log(weight.sum() * (VALUES[1] - VALUES[0])) + constant
    assert peak.evidence == pytest.approx(integral, abs=0.1)


@pytest.mark.parametrize(
    ("phase", "truth", "noise"), [(0.7, -0.2, 1e-3), *slowly((0.35, -0.3, 1e-3)), (0.7, 0.5, 2e-2)]
)
def test_settled_start_has_bimodal_posterior(phase, truth, noise):
    y = settled_readings([truth], phase, 40)[0] + noise * np.random.default_rng(3).standard_normal((40, 2))
    density = log_density(lambda p: settled_readings(p, phase, 40), y, noise)
    weight = np.exp(density - density.max())
    weight /= weight.sum()
    model = model_of(noise)
    known, tone = tone_of(phase, 40)
    grid_run = filter_on_grid(GridRecord(model, np.zeros(5), prior(1.0), known, y, none_considered(model), settled=tone))
    mean, covariance = grid_run.posterior
    expected = weight @ VALUES
    std = np.sqrt(weight @ (VALUES - expected) ** 2)
    assert mean[0] == pytest.approx(expected, abs=0.05 * std)
    assert np.sqrt(covariance[0, 0]) == pytest.approx(std, rel=0.05)
    assert grid_run.weight[grid_run.point[:, 0] < 0].sum() == pytest.approx(weight[VALUES < 0].sum(), abs=0.03)


@pytest.mark.parametrize("noise", [1e-5, 1e-6])
def test_peak_between_grid_points_is_found(noise):
    truth, phase = -0.3, 0.7
    y = settled_readings([truth], phase, 40)[0] + noise * np.random.default_rng(3).standard_normal((40, 2))
    model, (known, tone) = model_of(noise), tone_of(phase, 40)
    grid_run = filter_on_grid(GridRecord(model, np.zeros(5), prior(1.0), known, y, none_considered(model), settled=tone))
    mean, covariance = grid_run.posterior
    std = np.sqrt(covariance[0, 0])
    assert std < 1e-3 * STD
    assert abs(mean[0] - truth) < 4 * std


@pytest.mark.parametrize("factor", [2.0, 1.3])
def test_the_peak_of_a_settled_motion_is_linear_about_the_damping_of_its_record(factor):
    """At a resonance, with a damping `factor` times too large: evidence of the true one, but for what not knowing it costs."""
    noise, truth, steps = 1e-3, 0.2, 300
    values = REFERENCE | {"k1": REFERENCE["k1"] * np.exp(truth)}
    first = np.sqrt(np.linalg.eigvalsh(sum(values[name] * STIFFNESS[name] for name in values))[0])
    phase = 1.01 * first * H
    y = settled_readings([truth], phase, steps)[0] + noise * np.random.default_rng(4).standard_normal((steps, 2))
    known, tone = tone_of(phase, steps)
    exact = model_of(noise)
    damped = replace(exact, model=replace(exact.model, damping=exact.model.damping.scaled((factor, factor))))
    uncertain = replace(none_considered(damped), damping=0.5)
    peak = find_peak(GridRecord(damped, np.zeros(5), prior(1.0), known, y, uncertain, NO_OFFSETS, tone))
    best = find_peak(GridRecord(exact, np.zeros(5), prior(1.0), known, y, none_considered(exact), NO_OFFSETS, tone))
    assert peak.about is not None
    assert peak.about[0] == pytest.approx(-np.log(factor) / 0.5, abs=0.01)
    assert peak.point[0] == pytest.approx(best.point[0], abs=1e-4)
    assert best.evidence - 8 < peak.evidence < best.evidence


def test_resonance_widths_match_finite_differences():
    def frequencies(name, p):
        values = REFERENCE | {name: REFERENCE[name] * np.exp(p)}
        return np.sqrt(np.linalg.eigvalsh(sum(values[own] * STIFFNESS[own] for own in values)))

    model = driven_chain()
    record = GridRecord(
        model, np.zeros(5), prior(1.0), np.zeros((1000, 3, 1)), np.zeros((1000, 2)), none_considered(model)
    )
    omega = frequencies("k1", 0.0)
    for name, width in zip(("k1", "k2"), resonance_widths([record]), strict=True):
        moved = (frequencies(name, 1e-5) - frequencies(name, -1e-5)) / 2e-5
        assert width == pytest.approx(np.min(2 * RATIO * omega / np.abs(moved)), rel=1e-6)
    short = replace(record, known=record.known[:10])
    np.testing.assert_array_less(resonance_widths([record]), resonance_widths([short]))


@pytest.mark.parametrize("parameters", [1, 2, 3, 5])
def test_a_scan_covers_the_prior_with_a_bounded_number_of_points(parameters):
    rng = np.random.default_rng(parameters)
    root = np.eye(parameters) + 0.1 * rng.normal(size=(parameters, parameters))
    covariance = 0.04 * root @ root.T
    grid = build_scan_grid(np.zeros(parameters), covariance, np.full(parameters, 0.02), 3.5)
    assert 30 < len(grid.node) <= 1.3 * MOST_SCANNED
    far = np.sqrt(np.max(np.sum(grid.point * np.linalg.solve(covariance, grid.point.T).T, axis=1)))
    assert 2.5 < far < 4.5


STEPS, LEAD = 40, 400
NOISE, GAIN = 2e-4, 0.02
EXACT = 0.5, 24.0
ZETA, DECAY = 0.2, 3.0
"""Damping ratio, and the least decay of the slower mode [1/s]: what a start from rest has set off is 1e-10 after LEAD steps."""


def force(steps):
    """Constant within every step: (T, HOLD, 1)."""
    held = np.zeros((len(steps), 3, 1))
    held[:, 0, 0] = 2 + 3 * np.sin(0.7 * steps)
    return held


SETTLED = Settled(
    np.array([0.0, 0.7 / H]),
    np.array([[[2.0], [0.0], [0.0]], [[-3.0j], [0.0], [0.0]]]),
    1e-9 * np.ones(4),
)


def damped_model(parameters):
    model = driven_chain(NOISE, parameters)
    return replace(model, model=replace(model.model, damping=Damping(ratio=ZETA)), Q=0 * model.Q)


def constants(model):
    D = np.zeros((2, 2, 4))
    D[[0, 1], [0, 1], :2] = GAIN * ROWS
    return ConsideredParameters(("gain", "gain"), D, np.zeros((2, 2, 1)), np.zeros((2, 2)), damping=0.3, stiffness=0.01)


def step_of(values, factors=(1.0, 1.0)):
    F, column = continuous(values, ZETA / RATIO * np.array(factors))
    F, column = F[:4, :4], column[:4]
    whole = expm(np.block([[F, column[:, None]], [np.zeros((1, 5))]]) * H)
    return whole[:4, :4], whole[:4, 4]


def long_run(values, factors=(1.0, 1.0)):
    """From rest LEAD steps before t = 0, by the textbook: (STEPS + 1, 4) from t = 0 on."""
    A, b = step_of(values, factors)
    x = [np.zeros(4)]
    for load in force(np.arange(-LEAD, STEPS))[:, 0, 0]:
        x.append(A @ x[-1] + b * load)
    return np.array(x[LEAD:])


def settled_prior(model, motion):
    return np.diag([motion**2] * 4 + [0.1**2] * (model.size - 4))


@pytest.mark.parametrize("parameters", [1, 2])
def test_hills_of_the_whole_record_are_climbed(parameters):
    """Two hills, of which a part of the record sees each two or three points away from its top, and the lower one higher."""
    grid = build_scan_grid(np.zeros(parameters), np.eye(parameters), np.full(parameters, 0.8), 3.5)
    tops = np.array([[1.0] * parameters, [-1.2] * parameters])
    tried = []

    def density(point, steps=100):
        tried.append(len(point) if steps == 100 else 0)
        late = (100 - steps) / 100
        height = np.array([-3.0 * late, -1.5 * (1 - late)])
        off = np.sum((point[:, None] - tops - 0.8 * late) ** 2, axis=2)
        return np.log(np.exp(height - 6 * off).sum(axis=1))

    which, value = find_hills(grid, density, 100)
    whole = density(grid.point)
    assert which[0] == np.argmax(whole)
    np.testing.assert_array_equal(value, whole[which])
    np.testing.assert_allclose(grid.point[which], tops, atol=grid.step.max() / 2 + 1e-12)
    assert sum(tried[:-1]) < 0.6 * len(grid.point)


def test_periodic_start_matches_long_run():
    model, size = damped_model(("k1", "k2")), 1e-4
    assert np.exp(-DECAY * LEAD * H) < 1e-10

    def start(logs=(0.0, 0.0), factors=(1.0, 1.0), stiffer=1.0):
        values = zip(REFERENCE.items(), logs, strict=True)
        return long_run({name: stiffer * value * np.exp(own) for (name, value), own in values}, factors)[0]

    def slope(of):
        return (of(size) - of(-size)) / (2 * size)

    P, V = start_errors(model, constants(model), settled_prior(model, 1.0), SETTLED)
    expected = [slope(lambda s, own=own: start(factors=np.exp(0.3 * s * own))) for own in np.eye(2)]
    expected += [slope(lambda s: start(stiffer=1 + 0.01 * s)), np.zeros(4), np.zeros(4)]
    expected += [slope(lambda s, own=own: start(logs=s * own)) for own in np.eye(2)]
    scale = np.abs(start()).max()
    np.testing.assert_allclose(V / scale, -np.array(expected) / scale, atol=1e-6)
    np.testing.assert_allclose(np.diag(P), [*SETTLED.std**2, 0.01, 0.01])


@pytest.mark.parametrize("learned", [*slowly(False), True])
def test_settled_start_matches_long_record_from_rest(learned):
    model = damped_model(("k1",))
    considered = replace(constants(model), learned=learned)
    rng = np.random.default_rng(4)
    x = long_run({"k1": 1.07 * REFERENCE["k1"], "k2": REFERENCE["k2"]}, (1.2, 0.9))
    y = (x[1:, :2] @ ROWS.T) * [1.01, 0.98] + NOISE * rng.standard_normal((STEPS, 2))
    waited = np.concatenate([np.full((LEAD, 2), np.nan), y])
    still, moving, zero = settled_prior(model, 1e-9), settled_prior(model, 1.0), np.zeros(5)
    known, longer = force(np.arange(STEPS)), force(np.arange(-LEAD, STEPS))
    with finer(*EXACT):
        found = filter_on_grid(GridRecord(model, zero, moving, known, y, considered, settled=SETTLED))
        expected = filter_on_grid(GridRecord(model, zero, still, longer, waited, considered))
    for one, other in zip(found.posterior, expected.posterior, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)
    smoothed = smooth_on_grid(GridRecord(model, zero, moving, known, y, considered, settled=SETTLED), found)
    by_waiting = smooth_on_grid(GridRecord(model, zero, still, longer, waited, considered), expected)
    # a smoother takes its slopes along one motion, the mean over the parameters, which begins a little otherwise
    for own, other, alike in ((found.run, expected.run, 1e-6), (smoothed, by_waiting, 5e-3)):
        scale = np.abs(own.mean).max(axis=0)
        np.testing.assert_allclose(own.mean[1:] / scale, other.mean[LEAD + 1 :] / scale, atol=max(0.02 * alike, 1e-6))
        np.testing.assert_allclose(own.std[1:], other.std[LEAD + 1 :], rtol=alike)
    # at t = 0 the sum over the lattice is right to its spacing
    np.testing.assert_allclose(found.run.std[0], expected.run.std[LEAD], rtol=1e-3)


def test_expected_sigma_matches_grid_filter():
    model = damped_model(("k1",))
    whole, known = constants(model), force(np.arange(STEPS))
    # so small that the posterior is normal
    considered = replace(whole, D=0.1 * whole.D, damping=0.03, stiffness=1e-3)
    x = long_run(REFERENCE)
    both = np.concatenate([known, 0 * known], axis=2)
    claim = predict_grid_std(model, x, both, settled_prior(model, 1.0), considered, SETTLED)
    grid_run = filter_on_grid(
        GridRecord(model, np.zeros(5), settled_prior(model, 1.0), known, x[1:, :2] @ ROWS.T, considered, settled=SETTLED)
    )
    np.testing.assert_allclose(claim.std[-1, 0], grid_run.run.std[-1, 0], rtol=0.02)
    unknown = predict_grid_std(model, x, both, settled_prior(model, 1.0), considered)
    assert claim.std[5, 0, 4] < 0.9 * unknown.std[5, 0, 4]

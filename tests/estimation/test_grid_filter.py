"""The parameter grid filter against Bayes by brute force, the linear filter, and truths that it was made for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from strainsight.estimation import grid_filter
from strainsight.estimation.conditional import ConsideredParameters, discrepancy, none_considered
from strainsight.estimation.filter import run_filter
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.mixture import removed_of
from strainsight.estimation.record import GridRecord

from .chain import (
    NOISE,
    REFERENCE,
    ROWS,
    STEPS,
    H,
    chain,
    continuous,
    driven_chain,
    driven_start,
    finer,
    forces,
    joint,
    log_normal,
    start,
)
from .conftest import make_beam, make_filter, prior, sine
from .truth import draw_truth


@pytest.fixture(scope="module")
def measured():
    model, P = chain(), start()
    truth, y = draw_truth(model, np.zeros(7), P, forces(), [5])
    return model, P, truth[:, 0], y[:, 0]


@pytest.fixture(scope="module")
def square(measured):
    """Bayes by brute force: log of prior times likelihood on a square of points, 0.8 σ apart."""
    model, P, _, y = measured
    with finer(0.6, 20.0):
        found = filter_on_grid(GridRecord(model, np.zeros(7), P, forces(), y, none_considered(model)))
    mean, std = found.run.mean[-1, 0, 5:], found.run.std[-1, 0, 5:]
    axis = 0.8 * np.arange(-9, 10)
    point = mean + std * np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    prior_std = np.sqrt(np.diag(P)[5:])
    size = np.log(2 * np.pi * prior_std.prod())
    density = [log_normal(y.ravel(), *joint(p, P)) - 0.5 * np.sum((p / prior_std) ** 2) - size for p in point]
    return found, point, np.array(density), 0.8**2 * std.prod()


def test_matches_brute_force_bayes(square):
    found, point, log_density, cell = square
    w = np.exp(log_density - log_density.max())
    edge = w.reshape(19, 19)[[0, -1]].max(), w.reshape(19, 19)[:, [0, -1]].max()
    assert max(edge) < 1e-8
    w /= w.sum()
    mean = w @ point
    std = np.sqrt(w @ (point - mean) ** 2)
    np.testing.assert_allclose(found.run.mean[-1, 0, 5:] / std, mean / std, atol=1e-6)
    np.testing.assert_allclose(found.run.std[-1, 0, 5:], std, rtol=1e-6)
    evidence = np.logaddexp.reduce(log_density) + np.log(cell)
    assert found.run.log_likelihood[0] == pytest.approx(evidence, abs=1e-3)


@pytest.mark.parametrize("accelerometers", [0, 1])
def test_without_parameters_matches_kalman_filter(accelerometers):
    model = make_filter(make_beam(modes=4), inputs=("tip",), parameters=(), known=(), accelerometers=accelerometers)
    mean, P, known = np.zeros(model.size), prior(model), np.zeros((60, 3, 0))
    _, y = draw_truth(model, mean, P, known, [1])
    y[7, 0, 1] = y[20, 0] = np.nan
    found, run = (
        filter_on_grid(GridRecord(model, mean, P, known, y[:, 0], none_considered(model))).run,
        run_filter(model, mean, P, known, y),
    )
    scale = np.sqrt(np.diagonal(run.last[0]))
    for name in ("mean", "std"):
        np.testing.assert_allclose(getattr(found, name) / scale, getattr(run, name) / scale, atol=1e-9)
    for name in ("gauge_mean", "gauge_std", "whitened", "nis", "log_likelihood", "unknown_covariance"):
        np.testing.assert_allclose(getattr(found, name), getattr(run, name), rtol=1e-8, atol=1e-9)


def test_grid_point_matches_filter_at_its_parameters():
    beam = make_beam(modes=4, graded=True)
    model = make_filter(
        beam, inputs=(), parameters=("E", "rho"), known=("tip",), accelerometers=1, q_parameter=0.0, q_velocity=1e-4
    )
    u = sine(model.h * np.arange(40), model.h, 1e4, 20.0)
    mean, P = np.zeros(model.size), prior(model, 0.05)
    _, y = draw_truth(model, mean, P, u, [2])
    found = filter_on_grid(GridRecord(model, mean, P, u, y[:, 0], none_considered(model)))
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


def test_grid_is_rebuilt_only_when_posterior_narrows(monkeypatch):
    quiet, P, slow, y = crescent()
    with finer(0.5, 10.0):
        fine = filter_on_grid(GridRecord(quiet, np.zeros(7), P, slow, y, none_considered(quiet)))
    expected, std = fine.posterior[0], np.sqrt(np.diag(fine.posterior[1]))
    for few, off, wider in ((grid_filter.FEW, 0.05, 0.05), (1, 0.1, 0.1)):
        monkeypatch.setattr(grid_filter, "FEW", few)
        found = filter_on_grid(GridRecord(quiet, np.zeros(7), P, slow, y, none_considered(quiet)))
        mean, covariance = found.posterior
        np.testing.assert_allclose(mean, expected, atol=off * std.min())
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), std, rtol=wider)
        assert found.grid_count < 30


def test_removed_covariance_is_one_minus_remaining():
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
    many = np.concatenate([*[small] * 20, grown, *[small] * 30])
    expected = np.stack([removed_of(each) for each in many])
    np.testing.assert_allclose(removed_of(many), expected, rtol=0, atol=1e-14)


def test_unlearned_motion_contains_full_constant_error():
    """At every parameter the plain filter's states, and σ that holds how an offset of one σ moves them."""
    model = driven_chain(parameters=())
    P = driven_start()[:4, :4]
    _, y = draw_truth(model, np.zeros(4), P, forces(), [5])
    offset = np.array([[NOISE, 0.0], [0.0, 3 * NOISE]])
    considered = ConsideredParameters(("first", "second"), np.zeros((2, 2, 4)), np.zeros((2, 2, 1)), offset)

    def run(values, own):
        return filter_on_grid(GridRecord(model, np.zeros(4), P, forces(), values, own)).run

    none = none_considered(model)
    plain, found = run(y[:, 0], none), run(y[:, 0], considered)
    moved = np.stack([run(y[:, 0] + own, none).mean - plain.mean for own in offset])
    scale = plain.std.max(axis=0)
    np.testing.assert_allclose(found.mean / scale, plain.mean / scale, atol=1e-9)
    np.testing.assert_allclose(found.std, np.sqrt(plain.std**2 + np.sum(moved**2, axis=0)), rtol=1e-7)


@pytest.mark.parametrize(("source", "sizes"), [("damping", (0.1, 0.0)), ("stiffness", (0.0, 0.1))])
def test_motion_sensitivity_equals_error_slope(source, sizes):
    model = driven_chain(noise=5e-5, parameters=())
    P, steps, size = driven_start()[:4, :4], 80, 1e-3
    considered = replace(none_considered(model), damping=sizes[0], stiffness=sizes[1])

    def readings(factors, stiffer):
        """What a chain reads without noise that begins at rest, and its motion."""
        F, column = continuous({name: stiffer * value for name, value in REFERENCE.items()}, factors)
        whole = expm(np.block([[F, column[:, None]], [np.zeros((1, 6))]]) * H)
        x = np.zeros((steps + 1, 5))
        for k, u in enumerate(forces(steps)[:, 0, 0]):
            x[k + 1] = whole[:5, :5] @ x[k] + whole[:5, 5] * u
        return x[1:, :2] @ ROWS.T, x[:, :4]

    def error(factors, stiffer):
        y, x = readings(factors, stiffer)
        return filter_on_grid(GridRecord(model, np.zeros(4), P, forces(steps), y, none_considered(model))).run.mean[:, 0] - x

    if source == "damping":
        ends = [[error(np.exp(s * size * 0.1 * mode), 1.0) for s in (1, -1)] for mode in np.eye(2)]
    else:
        ends = [[error(np.ones(2), np.exp(s * size * 0.1)) for s in (1, -1)]]
    slope = np.stack([(ahead - back) / (2 * size) for ahead, back in ends], axis=1)
    y, _ = readings(np.ones(2), 1.0)
    found, plain = (
        filter_on_grid(GridRecord(model, np.zeros(4), P, forces(steps), y, own)).run.std[:, 0]
        for own in (considered, none_considered(model))
    )
    added = np.sum(slope**2, axis=1)
    np.testing.assert_allclose((found**2 - plain**2) / added.max(axis=0), added / added.max(axis=0), atol=2e-4)


@pytest.mark.slow
def test_learned_constants_match_filter_states():
    model, P, std = chain(noise=2e-4), start(), np.array([2e-3, 5e-3])
    _, y = draw_truth(model, np.zeros(7), P, forces(), [3])
    y = y[:, 0] + np.array([1.5e-3, -4e-3])
    offset = np.diag(std)
    learned = ConsideredParameters(
        ("first", "second"), np.zeros((2, 2, 5)), np.zeros((2, 2, 1)), offset, damping=0.0, stiffness=0.0, learned=True
    )
    whole = np.diag(np.concatenate([np.diag(P), std**2]))
    with finer(0.6, 20.0):
        grid_run = filter_on_grid(GridRecord(model, np.zeros(7), P, forces(), y, learned))
        states = filter_on_grid(
            GridRecord(model, np.zeros(9), whole, forces(), y, none_considered(model), biased=np.arange(2))
        )
    scale = np.sqrt(np.diag(P))
    np.testing.assert_allclose(grid_run.run.mean[:, 0] / scale, states.run.mean[:, 0, :7] / scale, atol=2e-6)
    np.testing.assert_allclose(grid_run.run.std[1:, 0] / states.run.std[1:, 0, :7], 1.0, atol=1e-5)
    one, other = (
        smooth_on_grid(GridRecord(model, start, P_own, forces(), y, own, biased=at), found)
        for start, P_own, own, found, at in (
            (np.zeros(7), P, learned, grid_run, np.zeros(0, dtype=int)),
            (np.zeros(9), whole, none_considered(model), states, np.arange(2)),
        )
    )
    std = other.std[:, 0, :7]
    np.testing.assert_allclose(one.mean[:, 0] / std, other.mean[:, 0, :7] / std, atol=0.03)
    np.testing.assert_allclose(one.std[:, 0] / std, 1.0, atol=0.01)
    for name, tolerance in (("whitened", 1e-5), ("log_likelihood", 1e-3)):
        np.testing.assert_allclose(getattr(grid_run.run, name), getattr(states.run, name), atol=tolerance)


def test_discrepancy_adds_noise_excluded_from_innovation_check():
    model = make_filter(
        make_beam(modes=4), inputs=(), parameters=("E",), known=("tip",), q_parameter=0.0, q_velocity=1e-4
    )
    u = sine(model.h * np.arange(80), model.h, 1e4, 20.0)
    mean, P = np.zeros(model.size), prior(model, 0.05)
    _, y = draw_truth(model, mean, P, u, [2])
    y = y[:, 0]
    y[3, 1] = np.nan
    size = 0.3 * np.sqrt(np.nanmean(y**2, axis=0))
    noisier = replace(model, r=model.r + size**2 * model.h)
    found, plain = (
        filter_on_grid(GridRecord(own, mean, P, u, y, replace(none_considered(own), discrepancy=share)))
        for own, share in ((model, 0.3), (noisier, 0.0))
    )
    np.testing.assert_allclose(found.weight, plain.weight, rtol=1e-9)
    for name in ("mean", "innovation"):
        own, other = getattr(found.run, name), getattr(plain.run, name)
        np.testing.assert_allclose(own, other, rtol=1e-9, atol=1e-12 * np.nanmax(np.abs(other)))
    assert np.nansum(found.run.whitened**2) > 1.2 * np.nansum(plain.run.whitened**2)
    # a load that is unknown has to follow its samples
    assert not discrepancy(chain(), replace(none_considered(chain()), discrepancy=0.3), y[:, :2]).any()


def acting_otherwise(model, load, column):
    """One ν, of a load whose shape it changes by a column."""
    d = np.zeros((1, 2, model.parameter_states.start)), np.zeros((1, 2, 1)), np.zeros((1, 2))
    shape = np.zeros((1, 2, 2))
    shape[0, :, model.model.inputs.index(load)] = column
    return ConsideredParameters(("load",), *d, shape=shape)


@pytest.mark.slow
def test_sigma_is_calibrated_with_misaligned_unknown_load():
    """Chains whose unknown load acts on the second mass, too, by a drawn constant."""
    model, P, draws, mean = chain(noise=5e-4), start(), 60, np.zeros(7)
    considered = acting_otherwise(model, "unknown", [0.0, 0.15])
    rng, with_it, without, of_load = np.random.default_rng(4), [], [], []
    for b in range(draws):
        inner = replace(model.model, input_shape=model.model.input_shape + rng.standard_normal() * considered.shape[0])
        truth, y = draw_truth(replace(model, model=inner), mean, P, forces(), [b])
        truth, y = truth[:, 0], y[:, 0]
        grid_run = filter_on_grid(GridRecord(model, mean, P, forces(), y, considered))
        exact = filter_on_grid(GridRecord(model, mean, P, forces(), y, none_considered(model)))
        for run, found in ((grid_run.run, with_it), (exact.run, without)):
            found.append((run.mean[-1, 0, 5:] - truth[-1, 5:]) / run.std[-1, 0, 5:])
        later = smooth_on_grid(GridRecord(model, mean, P, forces(), y, considered), grid_run)
        of_load.append(np.mean(((later.mean[:, 0, 4] - truth[:, 4]) / later.std[:, 0, 4]) ** 2))
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(with_it), axis=0)), 1.0, atol=3 / np.sqrt(2 * draws))
    assert np.sqrt(np.mean(np.square(without), axis=0)).max() > 1.5
    assert np.sqrt(np.mean(of_load)) == pytest.approx(1.0, abs=3 / np.sqrt(2 * draws))


@pytest.mark.parametrize(
    ("column", "parameters"), [([0.0, 0.1], ()), ([0.2, 0.0], ("k1", "k2"))], ids=["gain", "direction"]
)
def test_misaligned_constant_force_matches_unknown_load(column, parameters):
    """ν ΔS F of a force F that does not change is a load of shape ΔS, unknown and constant, with σ = F."""
    noise = 5e-5
    whole, force, states = chain(noise), np.zeros((STEPS, 3, 1)), 4 + len(parameters)
    force[:, 0, 0] = 5.0
    one = driven_chain(noise, parameters)
    other = replace(
        whole,
        model=replace(whole.model, input_shape=np.column_stack([whole.model.input_shape[:, 0], column])),
        unknowns=replace(whole.unknowns, parameters=parameters),
        fixed=one.fixed,
        H=whole.H[:, : states + 1],
        Q=np.diag([0, 0, 1e-4, 1e-4, *[0.0] * (1 + len(parameters))]),
    )
    considered = replace(acting_otherwise(one, "known", column), learned=True)
    P = driven_start()[:states, :states]
    wider = np.diag(np.insert(np.diag(P), 4, 25.0))
    _, y = draw_truth(other, np.zeros(states + 1), wider, force, [3])
    there = np.delete(np.arange(states + 1), 4)
    with finer(0.8, 14.0):
        found = filter_on_grid(GridRecord(one, np.zeros(states), P, force, y[:, 0], considered))
        expected = filter_on_grid(GridRecord(other, np.zeros(states + 1), wider, force, y[:, 0], none_considered(other)))
    std = expected.run.std[1:, 0, there]
    np.testing.assert_allclose(found.run.mean[1:, 0] / std, expected.run.mean[1:, 0, there] / std, atol=1e-4)
    np.testing.assert_allclose(found.run.std[1:, 0] / std, 1.0, atol=1e-4)
    np.testing.assert_allclose(found.run.whitened, expected.run.whitened, atol=1e-4)
    assert found.run.log_likelihood[0] == pytest.approx(expected.run.log_likelihood[0], abs=1e-3)
    assert 5.0 * found.nu_moments[0][0] == pytest.approx(expected.run.mean[-1, 0, 4], abs=1e-3)
    smoothed = smooth_on_grid(GridRecord(one, np.zeros(states), P, force, y[:, 0], considered), found)
    by_states = smooth_on_grid(
        GridRecord(other, np.zeros(states + 1), wider, force, y[:, 0], none_considered(other)), expected
    )
    std = by_states.std[1:, 0, there]
    off = (0.03, 0.01) if parameters else (1e-6, 1e-6)
    np.testing.assert_allclose(smoothed.mean[1:, 0] / std, by_states.mean[1:, 0, there] / std, atol=off[0])
    np.testing.assert_allclose(smoothed.std[1:, 0] / std, 1.0, atol=off[1])

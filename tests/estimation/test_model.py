"""What a filter is made of: its model, drawn truths, error measures, samples, posteriors, discrete noise and its tuning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm
from scipy.stats import norm

from strainsight.errors import ConfigError, NumericalError
from strainsight.estimation import consistency
from strainsight.estimation.consistency import input_error, load_scale, scale_noise, settling_time, tune
from strainsight.estimation.filter import run_filter
from strainsight.estimation.mixture import marginal, peaks_of
from strainsight.estimation.model import input_hold, inputs_of, loads_of, physical, process_covariance
from strainsight.estimation.parameter_grid import build_grid_about
from strainsight.estimation.smoother import smooth
from strainsight.estimation.update import covariance_factor, predict
from strainsight.loads.input_models import (
    IntegratedRandomWalk,
    Matern,
    Oscillator,
    RandomWalk,
    Unknowns,
    input_intensity,
    rate_matrix,
)

from .conftest import drawn, make_beam, make_filter, prior, sine
from .truth import draw_truth


def test_inconsistent_model_is_refused():
    beam = make_beam()
    with pytest.raises(ConfigError, match="both known and estimated"):
        make_filter(beam, inputs=("tip",), known=("tip",))
    with pytest.raises(ConfigError, match="rho has no value"):
        make_filter(beam, parameters=("E",), known=("tip",), fixed={"E": 2.1e11})


def test_input_is_read_at_its_position():
    beam = make_beam(modes=3, load_nodes=(16, 8))
    models = {"tip": Matern(5.0, 2.5), "middle": Oscillator(20.0)}
    model = make_filter(beam, inputs=("tip", "middle"), parameters=("E",), models=models)
    assert model.size == 6 + 3 + 2 + 1
    assert model.position.tolist() == [6, 9, 11]
    assert (model.input_states, model.parameter_states) == (slice(6, 11), slice(11, 12))
    mean = np.arange(12.0)
    values = physical(model, mean, mean / 10)
    assert values["tip"] == (6e4, pytest.approx(6e3))
    assert values["middle"] == (9e4, pytest.approx(9e3))
    assert values["E"] == pytest.approx((2.1e11 * np.exp(11.0), 1.1 * 2.1e11 * np.exp(11.0)))
    assert loads_of(model, mean, np.zeros(0)).tolist() == [6e4, 9e4]
    held = inputs_of(model, mean, np.zeros((3, 0)))
    assert held.shape == (3, 2)
    assert held[0].tolist() == [6e4, 9e4]


def test_moments_match_linear_model():
    model = make_filter(make_beam(modes=2), inputs=("tip",), q_velocity=3.0)
    mean, P0 = np.array([0.0, 0, 0, 0, 0.5]), np.diag([0.0, 0.0, 1e-2, 1e-3, 0.3])
    steps, runs = 3, 10000
    nothing = np.zeros((steps, 3, 0))
    truth, y = draw_truth(model, mean, P0, nothing, range(runs))
    A = run_filter(model, mean, P0, nothing, np.zeros((steps, 4)), keep="all").jacobian[0, 0]
    P, expected = P0, mean
    for _ in range(steps):
        P, expected = A @ P @ A.T + model.process, A @ expected
    d = np.sqrt(np.diag(P))
    np.testing.assert_allclose(truth[-1].mean(axis=0) / d, expected / d, atol=5 / np.sqrt(runs))
    np.testing.assert_allclose(np.cov(truth[-1].T) / np.outer(d, d), P / np.outer(d, d), atol=8 / np.sqrt(runs))
    noise = (y[-1] - truth[-1] @ model.H.T) / np.sqrt(model.r / model.h)
    np.testing.assert_allclose(np.cov(noise.T), np.eye(4), atol=8 / np.sqrt(runs))


def test_run_depends_only_on_its_seed():
    model = make_filter(make_beam(modes=2), inputs=("tip",))
    nothing = np.zeros((20, 3, 0))
    together = draw_truth(model, np.zeros(5), np.eye(5), nothing, [5, 6, 7])
    alone = draw_truth(model, np.zeros(5), np.eye(5), nothing, [6])
    for many, one in zip(together, alone, strict=True):
        np.testing.assert_allclose(many[:, 1], one[:, 0], rtol=1e-12, atol=1e-12 * np.abs(one).max())


@pytest.mark.parametrize("unit", [1.0, 1e-18, 1e18])
def test_singular_covariance_factor_has_reduced_rank(unit):
    X = np.random.default_rng(0).normal(size=(6, 3)) * np.array([1, 1e-8, 1, 1e6, 0, 1])[:, None]
    P = X @ X.T * unit
    F = covariance_factor(P)
    assert F.shape == (6, 3)
    d = np.where(np.diag(P) > 0, np.sqrt(np.diag(P)), 1.0)
    np.testing.assert_allclose(F @ F.T / np.outer(d, d), P / np.outer(d, d), atol=1e-12)
    assert covariance_factor(np.zeros((4, 4))).shape == (4, 0)


def test_load_error_is_relative_to_rms():
    truth = 4.0 * np.sin(2 * np.pi * np.arange(100) / 30)
    truth[:10] = 1e6
    scale, zero = load_scale(truth, 1e9)
    assert not zero
    assert scale == pytest.approx(4.0 / np.sqrt(2))
    error = np.full((100, 3), [0.5, 0.0, -1.0])
    error[:10] = 1e6
    np.testing.assert_allclose(input_error(error, 2.0), [0.25, 0.0, 0.5])


@pytest.mark.parametrize("left", [0.0, 1e-12])
def test_error_of_zero_load_is_relative_to_amplitude(left):
    truth = np.concatenate([np.full(10, 3.0), np.full(90, left)])
    assert load_scale(truth, 50.0) == (50.0, True)


def test_settling_time_is_last_entry_into_band():
    time = np.arange(5.0)
    assert settling_time(time, np.array([3.0, 2.0, 2.4, 2.01, 2.0]), 2.0, 0.01) == 3.0
    assert settling_time(time, np.array([3.0, 3.0, 3.0, 3.0, 2.0]), 2.0, 0.01) == 4.0
    assert settling_time(time, np.array([2.0, 2.0, 2.0, 2.0, 3.0]), 2.0, 0.01) == np.inf
    assert settling_time(time, np.full(5, np.nan), 2.0, 0.01) == np.inf
    assert settling_time(time, np.full(5, -2.0), -2.0, 0.01) == 0.0
    assert settling_time(time, np.array([1.0, 1.0, 0.0, 0.0, 0.0]), 0.0, 0.01) == 2.0


def test_samples_missing_in_all_runs_leave_one_covariance():
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), (), runs=3)
    y[10:15], y[30, :, 2] = np.nan, np.nan
    run = run_filter(model, mean, P0, u, y, keep="all")
    assert run.covariance.shape[1] == 1
    apart = run_filter(replace(model, H=np.stack([model.H] * 3)), mean, P0, u, y, keep="all")
    np.testing.assert_allclose(run.mean, apart.mean, rtol=1e-8, atol=1e-9 * np.abs(apart.mean).max())
    np.testing.assert_allclose(run.log_likelihood, apart.log_likelihood, rtol=1e-9)
    assert np.isnan(run.whitened[10:15]).all()
    A = run.jacobian[0, 0]
    np.testing.assert_allclose(run.mean[12], run.mean[11] @ A.T, rtol=1e-12)
    np.testing.assert_array_equal(run.covariance[12, 0], predict(run.covariance[11], A, model.process)[0])
    together, single = smooth(model, run), smooth(model, apart)
    np.testing.assert_allclose(together.mean, single.mean, rtol=1e-7, atol=1e-8 * np.abs(single.mean).max())


@pytest.mark.parametrize("parameters", [(), ("E",)])
def test_sampling_every_fourth_step_is_missing_the_others(parameters):
    inputs, known = ((), ("tip",)) if parameters else (("tip",), ())
    model = make_filter(make_beam(modes=4), inputs, parameters, known, every=4)
    u = sine(model.h * np.arange(80), model.h, 1e4, 20.0)[:, :, : len(known)]
    truth, y = draw_truth(model, np.zeros(9), prior(model), u, [0, 1])
    assert y.shape == (20, 2, 4)
    assert np.std((y - truth[4::4] @ model.H.T) / np.sqrt(model.r / (4 * model.h))) == pytest.approx(1, abs=0.15)
    run = run_filter(model, np.zeros(9), prior(model), u, y, keep="all")
    sparse = np.full((80, 2, 4), np.nan)
    sparse[3::4] = y
    full = run_filter(replace(model, every=1, r=model.r / 4), np.zeros(9), prior(model), u, sparse, keep="all")
    np.testing.assert_array_equal(run.mean, full.mean)
    np.testing.assert_array_equal(smooth(model, run).mean, smooth(replace(model, every=1, r=model.r / 4), full).mean)


def test_noise_by_a_schedule():
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), (), runs=2)
    schedule = np.where(np.arange(60)[:, None, None] < 30, 1.0, 2.0) * model.r
    run = run_filter(replace(model, r=schedule), mean, P0, u, y)
    first = run_filter(model, mean, P0, u[:30], y[:30])
    second = run_filter(replace(model, r=2 * model.r), first.mean[-1], first.last, u[30:], y[30:])
    np.testing.assert_allclose(run.mean[-1], second.mean[-1], rtol=1e-9, atol=1e-12 * np.abs(run.mean).max())
    np.testing.assert_allclose(run.std[-1], second.std[-1], rtol=1e-9)
    np.testing.assert_allclose(run.log_likelihood, first.log_likelihood + second.log_likelihood, rtol=1e-9)


def test_marginal_of_normal_grid_posterior_is_normal():
    point = np.arange(-5.0, 6.0)
    weight = norm.pdf(point)
    own = marginal(0.3 + 0.02 * point, weight / weight.sum(), 0.02, (0.0, 0.1))
    np.testing.assert_allclose(own.density, norm.pdf(own.value, 0.3, 0.02), atol=2e-4 * own.density.max())
    np.testing.assert_allclose(own.prior, norm.pdf(own.value, 0.0, 0.1))
    assert own.left == pytest.approx(0.2, rel=1e-4)
    assert own.peak == pytest.approx([0.3], abs=1e-3)
    assert own.share == pytest.approx([1.0])


def test_each_parameter_of_a_correlated_normal_posterior_has_its_marginal():
    mean, covariance = np.array([0.1, -0.2]), np.array([[4.0, 2.9], [2.9, 2.5]])
    grid = build_grid_about(mean, covariance, 1.0, 5.0)
    off = grid.point - mean
    weight = np.exp(-0.5 * np.sum(off @ np.linalg.inv(covariance) * off, axis=1))
    weight /= weight.sum()
    for i in range(2):
        own = marginal(grid.point[:, i], weight, float(grid.step[i]), (0.0, 10.0))
        exact = norm.pdf(own.value, mean[i], np.sqrt(covariance[i, i]))
        np.testing.assert_allclose(own.density, exact, atol=2e-3 * exact.max())


def test_a_posterior_of_two_peaks_has_both_with_their_probabilities_and_keeps_its_moments():
    point = np.arange(-40, 120) * 0.1
    weight = 0.3 * norm.pdf(point, 0.0, 0.4) + 0.7 * norm.pdf(point, 8.0, 0.5)
    weight /= weight.sum()
    own = marginal(point, weight, 0.1, (0.0, 10.0))
    assert own.peak == pytest.approx([0.0, 8.0], abs=0.05)
    assert own.share == pytest.approx([0.3, 0.7], abs=1e-3)
    step = own.value[1] - own.value[0]
    mean = step * own.density @ own.value
    assert step * own.density.sum() == pytest.approx(1.0, abs=1e-6)
    assert mean == pytest.approx(weight @ point, rel=1e-6)
    assert step * own.density @ (own.value - mean) ** 2 == pytest.approx(weight @ (point - mean) ** 2, rel=1e-5)


def test_marginal_without_grid_is_normal():
    own = marginal(np.array([-1.0, 1.0]), np.array([0.5, 0.5]), np.inf, (0.0, 4.0))
    np.testing.assert_allclose(own.density, norm.pdf(own.value))
    assert own.left == pytest.approx(0.25)


@pytest.mark.parametrize(("distance", "peaks"), [(2.0, 1), (2.8, 1), (3.4, 2)])
def test_peaks_are_separated_by_deep_valley(distance, peaks):
    value = np.linspace(-6, 10, 801)
    density = norm.pdf(value) + norm.pdf(value, distance)
    between = 2 * norm.pdf(distance / 2) / density.max()
    assert (between < 0.5) == (peaks == 2)
    assert len(peaks_of(value, density)[0]) == peaks


def test_peak_with_low_probability_is_ignored():
    value = np.linspace(-6, 16, 801)
    found, share = peaks_of(value, 0.995 * norm.pdf(value) + 0.005 * norm.pdf(value, 10.0))
    assert found == pytest.approx([0.0], abs=0.03)
    assert share == pytest.approx([0.995], abs=1e-6)


SMOOTH = [IntegratedRandomWalk(20.0), Matern(10.0, 0.5), Matern(10.0, 2.5), Oscillator(20.0, 0.02)]


def unknowns(*models):
    names = ("F", "G")[: len(models)]
    return Unknowns(names, (), dict(zip(names, (1e4, 30.0), strict=False)), {}, dict(zip(names, models, strict=True)))


@pytest.mark.parametrize("model", SMOOTH)
@pytest.mark.parametrize("h", [1e-4, 1e-2])
def test_step_noise_equals_integral(model, h):
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


def test_random_walks_are_discretised_exactly():
    both = unknowns(RandomWalk(), IntegratedRandomWalk(20.0))
    omega = 2 * np.pi * 20
    hold = input_hold(both, 1e-3)
    np.testing.assert_allclose(hold[:, 0], [[1e4, 0, 0], [0, 0, 0], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(hold[:, 1], [[0, 30, 0], [0, 0, 30 * omega * 1e-3], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(process_covariance(np.zeros((3, 3)), np.eye(3), 0.1), 0.1 * np.eye(3), rtol=1e-14)


@pytest.mark.parametrize("h", [1e-4, 1e-2, 0.3])
def test_load_drift_within_step_enters_process_noise(h):
    """Two modes under a random walk, the second turning up to 600 rad in a step: the integral over the whole state."""
    omega, zeta = np.array([60.0, 2000.0]), 0.01
    F, Q = np.zeros((5, 5)), np.diag([0.0, 0.0, 1e-3, 1e-2, 5.0])
    F[:2, 2:4], F[2:4, :2], F[2:4, 2:4] = np.eye(2), -np.diag(omega**2), -np.diag(2 * zeta * omega)
    F[2:4, 4] = [30.0, 80.0]
    found = process_covariance(F, Q, h)
    x, w = np.polynomial.legendre.leggauss(20)
    pieces = max(4, int(2000 * h))
    nodes = np.concatenate([h / pieces * (i + 0.5 + 0.5 * x) for i in range(pieces)])
    A, weight = expm(F * nodes[:, None, None]), np.tile(0.5 * h / pieces * w, pieces)
    expected = np.einsum("s,sij,jk,slk->il", weight, A, Q, A, optimize=True)
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


STEPS = 200


def recorded(make_beam, make_filter, **options):
    model = make_filter(make_beam(modes=3), ("tip",), h=1e-3, noise_step=1e-3, **options)
    nothing, P0 = np.zeros((STEPS, 3, 0)), np.diag([0.0] * 6 + [1.0])
    _, y = draw_truth(model, np.zeros(7), P0, nothing, [0])
    return model, np.zeros(7), P0, nothing, y


@pytest.fixture(scope="module")
def best():
    model, *rest = recorded(make_beam, make_filter)
    return tune(model, *rest, parts=("noise",)).factors["noise"]


def test_tuned_factors_maximise_likelihood():
    model, mean, P0, known, y = recorded(make_beam, make_filter)
    _, other = draw_truth(model, mean, P0, known, [7])
    both = np.concatenate([y, other], axis=1)
    found = tune(model, mean, P0, known, both)

    def likelihood(a, b):
        factors = {"process": a * found.factors["process"], "noise": b * found.factors["noise"]}
        return run_filter(scale_noise(model, factors), mean, P0, known, both).log_likelihood.sum()

    best = likelihood(1, 1)
    assert best > run_filter(model, mean, P0, known, both).log_likelihood.sum()
    for a, b in ((0.9, 1), (1.1, 1), (1, 0.9), (1, 1.1), (0.9, 1.1), (1.1, 0.9)):
        assert likelihood(a, b) < best
    for axis in np.eye(2):
        less, more = likelihood(*np.exp(-0.02 * axis)), likelihood(*np.exp(0.02 * axis))
        assert abs(0.5 * 0.02 * (less - more) / (less - 2 * best + more)) < 1e-3


def test_parts_of_the_process_noise_are_distinguished():
    model, *rest = recorded(make_beam, make_filter, q_velocity=3.0)
    off = scale_noise(model, {"inputs": 10.0, "model_error": 0.1})
    assert np.allclose(np.diag(off.Q)[3:], np.diag(model.Q)[3:] * np.array([0.1, 0.1, 0.1, 10.0]))
    found = tune(off, *rest, parts=("inputs", "model_error"))
    assert np.log(10 * found.factors["inputs"]) == pytest.approx(0, abs=0.5)
    assert np.log(0.1 * found.factors["model_error"]) == pytest.approx(0, abs=0.5)


def test_a_schedule_of_noise_is_scaled_as_a_whole(best):
    model, *rest = recorded(make_beam, make_filter)
    schedule = np.broadcast_to(4 * model.r, (STEPS, 1, 4))
    found = tune(replace(model, r=schedule), *rest, parts=("noise",))
    assert found.factors["noise"] == pytest.approx(0.25 * best, rel=1e-3)
    assert best == pytest.approx(1.0, rel=0.15)


def test_a_part_without_noise_cannot_be_tuned():
    model, *rest = recorded(make_beam, make_filter)
    with pytest.raises(ConfigError, match="process noise of model_error is zero"):
        tune(model, *rest, parts=("model_error",))


def test_tuning_of_absent_noise_reaches_limit():
    model, mean, P0, known, _ = recorded(make_beam, make_filter)
    _, y = draw_truth(replace(model, Q=0 * model.Q), mean, P0, known, [0])
    found = tune(model, mean, P0, known, y, limit=1e3)
    assert found.undecided == ("process",)
    assert found.factors["process"] == pytest.approx(1e-3)


def test_tuning_recovers_from_divergence(best, monkeypatch):
    model, *rest = recorded(make_beam, make_filter)
    stated, lost = replace(model, r=100 * model.r), []

    def fragile(filtering, *arguments):
        if filtering.r.min() < 0.5 * model.r.min():
            lost.append(filtering.r.min())
            raise NumericalError("lost")
        return run_filter(filtering, *arguments)

    monkeypatch.setattr(consistency, "run_filter", fragile)
    assert tune(stated, *rest, parts=("noise",)).factors["noise"] == pytest.approx(best / 100, rel=0.02)
    assert lost


def test_a_record_that_loses_the_filter_from_the_start_is_refused():
    model = make_filter(make_beam(modes=3), parameters=("E",), known=("tip",))
    u = sine(model.h * np.arange(60), model.h, 1e4, 20.0)
    mean, P0 = np.zeros(7), np.diag([0.0] * 6 + [0.01])
    _, y = draw_truth(model, mean, P0, u, [0, 1])
    y[30:, 1] = 1e3
    with pytest.raises(NumericalError, match="diverges with the configured noise"):
        tune(model, mean, P0, u, y, parts=("noise",))
    assert run_filter(model, mean, P0, u, y).lost.tolist()[0] == -1


def test_one_sided_slope_after_divergence(best, monkeypatch):
    model, *rest = recorded(make_beam, make_filter)
    stated = replace(model, r=model.r / 4)

    def fragile(filtering, *arguments):
        run = run_filter(filtering, *arguments)
        lost = np.broadcast_to(filtering.r, (len(run.log_likelihood), 4)).min(axis=1) < 0.999 * stated.r.min()
        return replace(run, log_likelihood=np.where(lost, -np.inf, run.log_likelihood))

    monkeypatch.setattr(consistency, "run_filter", fragile)
    found = tune(stated, *rest, parts=("noise",))
    assert found.factors["noise"] == pytest.approx(4 * best, rel=0.02)

"""What the claimed σ is made of: each source alone, impulse by impulse, and drawn constants that no filter knows of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.claim import covariance_recursion
from strainsight.estimation.conditional import (
    Nuisances,
    acceleration_change,
    acceleration_rows,
    no_nuisances,
    on_loads,
    theta_at,
)
from strainsight.estimation.filter import run_filter
from strainsight.estimation.motion import measure
from strainsight.fem.affine import AffineOperator
from strainsight.rom.modal_step import simulate

from .two_masses import (
    DAMPING,
    DRIFT,
    GAIN,
    LOAD,
    NOISE,
    OFFSET,
    REFERENCE,
    ROWS,
    SHARE,
    STEPS,
    STIFFER,
    believed,
    chain,
    constants,
    forces,
    motion,
    nominal,
    start,
    steps_of,
)


def test_the_parts_are_the_errors_of_each_source_alone():
    """Every sample, every step of the process and every state at the start by itself: squares of what the filter makes of it."""
    model, P = chain(), start()
    budget = covariance_recursion(model, nominal(), forces(), P).budget
    still = np.zeros((STEPS, 3, 1))

    def estimate(y):
        return run_filter(model, np.zeros(5), P, still, y).mean

    impulses = NOISE * np.eye(2 * STEPS).reshape(STEPS, 2, 2 * STEPS).transpose(0, 2, 1)
    np.testing.assert_allclose(budget["noise"], np.sum(estimate(impulses) ** 2, axis=1), rtol=1e-7, atol=1e-18)

    A, B = steps_of(np.ones((1, 2)))
    whole = np.eye(5)
    whole[:4, :4], whole[:4, 4] = A[0], LOAD * B[0, :, 1]
    factor = np.linalg.cholesky(model.process)
    disturbed = np.zeros((STEPS + 1, STEPS, 5, 5))
    for k in range(STEPS):
        disturbed[k + 1] = disturbed[k] @ whole.T
        disturbed[k + 1, k] += factor.T
    begun = np.zeros((STEPS + 1, 5, 5))
    begun[0] = np.sqrt(P)
    for k in range(STEPS):
        begun[k + 1] = begun[k] @ whole.T
    for name, truth in (("process noise", disturbed.reshape(STEPS + 1, -1, 5)), ("start", begun)):
        error = estimate(truth[1:, :, :2] @ ROWS.T) - truth
        np.testing.assert_allclose(budget[name], np.sum(error**2, axis=1), rtol=1e-7, atol=1e-18)


@pytest.mark.parametrize("parameters", [(), ("k1", "k2")])
def test_the_parts_are_the_whole(parameters):
    model = chain(parameters)
    claim = covariance_recursion(model, nominal(), forces(), start(model.size), constants(model))
    assert set(claim.budget) == {"noise", "process noise", "start", "gain", "offset", "drift", "damping", "stiffness"}
    np.testing.assert_allclose(sum(claim.budget.values()), claim.std[:, 0] ** 2, rtol=1e-9)


def test_what_constants_add_is_the_slope_of_the_error():
    """Central differences of a filter that is fed with what a slightly different chain reads without noise."""
    model, size = chain(("k1", "k2")), 1e-3
    P, known, mean = start(model.size), forces()[..., :1], believed(model)

    def error(gain=(0, 0), offset=(0, 0), drift=(0, 0), damping=(0, 0), stiffer=0.0):
        x = motion(*steps_of(np.exp(DAMPING * np.array([damping])), np.exp(STIFFER * stiffer)))[:, 0]
        y = x[1:, :2] @ ROWS.T * (1 + GAIN * np.array(gain)) + OFFSET * np.array(offset)
        y += DRIFT * SHARE * drift
        whole = np.tile(mean, (STEPS + 1, 1))
        whole[:, :4] = x
        return run_filter(model, mean, P, known, y).mean[:, 0] - whole

    def slope(name, unit):
        return (error(**{name: size * unit}) - error(**{name: -size * unit})) / (2 * size)

    budget = covariance_recursion(model, nominal(), forces(), P, constants(model)).budget
    both = np.eye(2)
    for name in ("gain", "offset", "drift", "damping"):
        total = sum(slope(name, own) ** 2 for own in both)
        np.testing.assert_allclose(budget[name], total, rtol=2e-4, atol=2e-4 * total.max(axis=0).min(), err_msg=name)
    total = slope("stiffer", 1.0) ** 2
    np.testing.assert_allclose(budget["stiffness"] / total.max(axis=0), total / total.max(axis=0), atol=2e-4)


def test_drawn_constants_and_noise_err_as_claimed():
    """RMS error of the plain filter over many chains, with both gauges and with one, is the expected σ; without the constants
    it is not."""
    rng, draws = np.random.default_rng(3), 4000
    model, P, known = chain(), start(), forces()[..., :1]
    nuisances = replace(constants(model), stiffness=0.0)
    A, B = steps_of(np.exp(DAMPING * rng.standard_normal((draws, 2))))
    factor = np.linalg.cholesky(model.process)
    x = np.zeros((STEPS + 1, draws, 5))
    x[0] = believed(model) + rng.standard_normal((draws, 5)) @ np.sqrt(P)
    for k, u in enumerate(known[:, 0, 0]):
        x[k + 1] = x[k]
        x[k + 1, :, :4] = (A @ x[k, :, :4, None])[..., 0] + B[..., 0] * u + B[..., 1] * LOAD * x[k, :, 4:]
        x[k + 1] += rng.standard_normal((draws, 5)) @ factor.T
    y = x[1:, :, :2] @ ROWS.T * (1 + GAIN * rng.standard_normal((draws, 2))) + OFFSET * rng.standard_normal((draws, 2))
    y += NOISE * rng.standard_normal(y.shape) + DRIFT * SHARE[:, None] * rng.standard_normal((draws, 2))

    sets = replace(model, r=model.r * np.array([[1.0, 1.0], [1.0, 1e12]]))
    claim = covariance_recursion(sets, nominal(), forces(), P, nuisances)
    one = replace(model, H=model.H[:1], r=model.r[:1])
    late = slice(STEPS // 2, None)
    for b, (own, readings) in enumerate(((model, y), (one, y[..., :1]))):
        rms = np.sqrt(np.mean((run_filter(own, believed(model), P, known, readings).mean - x)[late] ** 2, axis=(0, 1)))
        expected = np.sqrt(np.mean(claim.std[late, b] ** 2, axis=0))
        np.testing.assert_allclose(rms, expected, rtol=0.03)
    plain = covariance_recursion(sets, nominal(), forces(), P).std[late]
    assert np.all(np.mean(claim.std[late, :, 4] ** 2, axis=0) > 1.5 * np.mean(plain[..., 4] ** 2, axis=0))
    share = {name: np.mean(part[late, 4]) / np.mean(claim.std[late, 0, 4] ** 2) for name, part in claim.budget.items()}
    assert min(share[name] for name in ("noise", "process noise", "gain", "offset", "drift", "damping")) > 0.02, share


def test_a_silent_gauge_adds_nothing_of_its_own():
    model = chain()
    own = constants(model)
    sets = replace(model, r=model.r * np.array([[1.0, 1e12]]))
    at = [0, 2, 4]
    first = replace(own, source=("gain", "offset", "drift"), D=own.D[at], E=own.E[at], offset=own.offset[at])
    P = start()
    whole, alone = (covariance_recursion(sets, nominal(), forces(), P, each) for each in (own, first))
    np.testing.assert_allclose(whole.std, alone.std, rtol=1e-9)


def test_nothing_tolerated_adds_nothing():
    model, P = chain(("k1",)), start(6)
    plain, none = (covariance_recursion(model, nominal(), forces(), P, own) for own in (None, no_nuisances(model)))
    np.testing.assert_array_equal(plain.std, none.std)
    assert plain.budget.keys() == none.budget.keys()


def test_gains_of_accelerometers_scale_what_known_and_unknown_loads_make_them_read(make_beam, make_filter, sine):
    """Readings of a beam under a constant unknown load and a known sine, each channel in turn scaled a little."""
    beam, h, steps, gain, size = make_beam(modes=4, graded=True, load_nodes=(16, 8)), 5e-4, 20, 0.03, 1e-3
    parameters = ("E",)
    model = make_filter(beam, ("tip",), parameters, ("middle",), h, accelerometers=2, q_velocity=0.1)
    u = np.zeros((steps, 3, 2))
    u[:, 0, 0], u[:, :, 1:] = 2e4, sine(h * np.arange(steps), h, 1e4, 20.0)
    x = simulate(beam.model, beam.model.reference, u, h)
    full = np.hstack([x[1:], np.full((steps, 1), 2.0), np.zeros((steps, model.size - 9))])
    y = measure(model, full, u[:, :, 1].sum(axis=1)[:, None])[0]
    P, mean = np.diag([0.0] * 8 + [1e-4] * (model.size - 8)), np.zeros(model.size)
    mean[8] = 2.0

    def estimate(factor):
        return run_filter(model, mean, P, u[:, :, 1:], y * factor).mean[:, 0]

    channels = len(model.H)
    D, E = np.zeros((channels, channels, 9)), np.zeros((channels, channels, 1))
    rows = [np.zeros((channels, 9)), np.zeros((channels, 1))]
    rows[0][:, :4] = model.H[:, :4]
    moving = model.accelerometers
    at_guess = theta_at(model, np.zeros((1, len(parameters))))
    rows[0][moving], rows[1][moving] = (own[0] for own in acceleration_rows(model, at_guess, model.H[moving, :4]))
    own = range(channels)
    D[own, own], E[own, own] = gain * rows[0], gain * rows[1]
    nuisances = Nuisances(("gain",) * channels, D, E, np.zeros((channels, channels)))
    found = covariance_recursion(model, x, u, P, nuisances).budget["gain"][:, 8:]
    step = gain * size * np.eye(channels)
    slopes = [(estimate(1 + own) - estimate(1 - own)) / (2 * size) for own in step]
    total = sum(slope[:, 8:] ** 2 for slope in slopes)
    np.testing.assert_allclose(found / total.max(axis=0), total / total.max(axis=0), atol=1e-4)


def test_a_model_without_any_parameter_is_that_with_all_of_them_fixed():
    with_them = chain()
    operator = with_them.model.stiffness
    whole = AffineOperator(sum(REFERENCE[name] * term for name, term in operator.terms.items()), {})
    bare = replace(with_them, model=replace(with_them.model, stiffness=whole, reference={}), fixed={})
    one, other = (covariance_recursion(m, nominal(), forces(), start(), constants(m)) for m in (with_them, bare))
    np.testing.assert_allclose(other.std, one.std, rtol=1e-9)
    for name, part in one.budget.items():
        np.testing.assert_allclose(other.budget[name], part, rtol=1e-7, atol=1e-12 * one.std.max() ** 2, err_msg=name)


def test_what_a_load_elsewhere_adds_is_the_slope_of_the_error(make_beam, make_filter, sine):
    """Readings of strain and acceleration of a beam whose loads, a constant unknown one and a known sine, push its coordinates
    otherwise than the filter believes, and strain a gauge besides."""
    beam, h, steps, size = make_beam(modes=4, graded=True, load_nodes=(16, 8)), 5e-4, 20, 1e-4
    parameters = ("E",)
    model = make_filter(beam, ("tip",), parameters, ("middle",), h, accelerometers=2, q_velocity=0.1)
    u = np.zeros((steps, 3, 2))
    u[:, 0, 0], u[:, :, 1:] = 2e4, sine(h * np.arange(steps), h, 1e4, 20.0)
    P, mean = np.diag([0.0] * 8 + [1e-4] * (model.size - 8)), np.zeros(model.size)
    mean[8] = 2.0
    shape = beam.model.input_shape
    changes = 0.02 * np.stack([shape * [1, 0], shape * [0, 1], shape[:, ::-1], shape[::-1] * [1, -1]])
    channels, moving = len(model.H), model.accelerometers
    strain = 1e-9 * np.arange(8.0 * channels).reshape(4, channels, 2) * ~moving[:, None] * (changes.any(axis=1))[:, None]

    def estimate(change, at_once):
        inner = replace(beam.model, input_shape=shape + change)
        x = simulate(inner, inner.reference, u, h)
        full = np.hstack([x[1:], np.full((steps, 1), 2.0), np.zeros((steps, model.size - 9))])
        loads = u.sum(axis=1)
        y = measure(replace(model, model=inner), full, loads[:, 1:])[0] + loads @ at_once.T
        whole = np.tile(mean, (steps + 1, 1))
        whole[:, :8] = x
        return run_filter(model, mean, P, u[:, :, 1:], y).mean[:, 0] - whole

    at_guess = theta_at(model, np.zeros((1, len(parameters))))
    direct = strain.copy()
    for own, change in zip(direct, changes, strict=True):
        own[moving] = model.H[moving, :4] @ acceleration_change(model, at_guess, change)[0]
    D, E = on_loads(model, direct)
    source = ("known", "unknown", "swapped", "mirrored")
    nuisances = Nuisances(source, D, E, np.zeros((4, channels)), shape=changes)
    x = simulate(beam.model, beam.model.reference, u, h)
    found = covariance_recursion(model, x, u, P, nuisances).budget
    for name, change, at_once in zip(source, changes, strain, strict=True):
        total = ((estimate(size * change, size * at_once) - estimate(-size * change, -size * at_once)) / (2 * size)) ** 2
        np.testing.assert_allclose(found[name] / total.max(axis=0), total / total.max(axis=0), atol=1e-4, err_msg=name)

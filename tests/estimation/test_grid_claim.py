"""The claimed σ and its parts: least squares on everything at once, the grid filter, the error of each source alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.claim import covariance_recursion, predict_grid_std
from strainsight.estimation.conditional import (
    ConsideredParameters,
    acceleration_change,
    acceleration_rows,
    load_rows,
    none_considered,
    theta_at,
)
from strainsight.estimation.filter import run_filter
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.model import measure
from strainsight.estimation.record import GridRecord
from strainsight.loads.input_models import Oscillator
from strainsight.rom.modal_step import simulate

from ..shared import slowly
from .conftest import drawn, make_beam, make_filter, sine
from .two_masses import (
    LOAD,
    NOISE,
    ROWS,
    STEPS,
    STIFFER,
    believed,
    chain,
    constants,
    forces,
    moved,
    nominal,
    readings,
    start,
    steps_of,
)

SOURCES = ("noise", "process noise", "start", "gain", "offset", "drift", "damping", "stiffness")


def slopes(parameters):
    """Of the motion (STEPS, 4) and the readings (STEPS, 2) in every mode's damping, the stiffness, gains, offsets, drifts and
    parameters, by differences of fourth order of the textbook's steps: (c, STEPS, 4), (c, STEPS, 2); and what each stands for."""
    size = 1e-3

    def slope(unit, **one):
        near, far = (
            moved(**dict.fromkeys(one, k * size * unit)) - moved(**dict.fromkeys(one, -k * size * unit)) for k in (1, 2)
        )
        return (8 * near - far)[1:] / (12 * size)

    motions = [slope(own, damping=1) for own in np.eye(2)] + [slope(1.0, stiffer=1)]
    motions += [np.zeros((STEPS, 4))] * 6 + [slope(1.0, **{name: 1}) for name in parameters]
    read = [own[:, :2] @ ROWS.T for own in motions]
    for k, name in enumerate(("gain", "gain", "offset", "offset", "drift", "drift")):
        read[3 + k] = readings(nominal(), **{name: np.eye(2)[k % 2]}) - readings(nominal())
    names = ("damping", "damping", "stiffness", "gain", "gain", "offset", "offset", "drift", "drift")
    return np.array(motions), np.array(read), (*names, *["start"] * len(parameters))


def everything(model, parameters):
    """All that is unknown in columns of unit size: states (STEPS, 5, N), readings (2·STEPS, N) and sources, constants last."""
    A, B = steps_of(np.ones((1, 2)))
    whole = np.eye(5)
    whole[:4, :4], whole[:4, 4] = A[0], LOAD * B[0, :, 1]
    factor = np.linalg.cholesky(model.process[:5, :5])
    N = 5 + 5 * STEPS
    x = np.zeros((STEPS + 1, 5, N))
    x[0, :, :5] = np.sqrt(start())
    for k in range(STEPS):
        x[k + 1] = whole @ x[k]
        x[k + 1, :, 5 + 5 * k : 10 + 5 * k] += factor
    x, y = x[1:], ROWS @ x[1:, :2]
    motions, read, source = slopes(parameters)
    of_constants = np.pad(np.transpose(motions, (1, 2, 0)), [(0, 0), (0, 1), (0, 0)])
    states = np.concatenate([x, np.zeros((STEPS, 5, 2 * STEPS)), of_constants], axis=2)
    readings = np.concatenate([np.concatenate(y), NOISE * np.eye(2 * STEPS), read.reshape(len(read), -1).T], axis=1)
    names = ("start",) * 5 + ("process noise",) * (5 * STEPS) + ("noise",) * (2 * STEPS) + source
    return states, readings, np.array(names), whole


def considering(states, y, whole, considered):
    """The state at the end (5, N) by the gains of least variance over the first `considered` columns, none of them learned."""
    believed = np.zeros(states.shape[1:])
    for k, x in enumerate(states):
        believed = whole @ believed
        i, e = (own[:, :considered] for own in (y[2 * k : 2 * k + 2] - ROWS @ believed[:2], x - believed))
        believed = believed + e @ i.T @ np.linalg.inv(i @ i.T) @ (y[2 * k : 2 * k + 2] - ROWS @ believed[:2])
    return believed


@pytest.mark.parametrize("learned", [False, True])
@pytest.mark.parametrize("parameters", [("k1", "k2"), ("k2",), ()])
def test_grid_claim_matches_least_squares(parameters, learned):
    """One regression without any recursion; states that do not follow ν by the gains of a filter that considers it."""
    model = chain(parameters)
    k = len(parameters)
    P = start(model.size)
    claim = predict_grid_std(model, nominal(), forces(), P, replace(constants(model), learned=learned))
    states, y, source, whole = everything(model, parameters)
    end = states[-1]
    prior = np.r_[np.ones(y.shape[1] - k), np.diag(P)[5:]]
    c = 9 + k
    white = slice(0, y.shape[1] - c)
    S = y[:, white] @ y[:, white].T
    E = y[:, -c:]
    left = np.linalg.inv(np.diag(1 / prior[-c:]) + E.T @ np.linalg.solve(S, E))
    on_constants = left @ np.linalg.solve(S, E).T  # ĉ of the readings
    on_states = end[:, white] @ np.linalg.solve(S, y[:, white]).T  # ŝ of them, constants known to be nothing
    V = end[:, -c:] - on_states @ E
    of_constants = np.eye(y.shape[1])[-c:] - on_constants @ y
    if learned:
        squares = (end - on_states @ y - V @ on_constants @ y) ** 2
    else:
        error = end - considering(states, y, whole, y.shape[1] - k)
        by_parameters = error[:, -c:] @ np.vstack([np.zeros((9, y.shape[1])), (on_constants @ y)[9:]])
        squares = error**2 + by_parameters**2
        squares[:, -c:] = (error - by_parameters)[:, -c:] ** 2
    squares = np.concatenate([squares, of_constants[9:] ** 2]) * prior
    np.testing.assert_allclose(claim.std[-1, 0], np.sqrt(squares.sum(axis=1)), rtol=1e-6)
    assert set(claim.budget) == set(SOURCES)
    for name in SOURCES:
        part = squares[:, source == name].sum(axis=1)
        np.testing.assert_allclose(claim.budget[name][-1], part, rtol=1e-5, atol=1e-9 * part.max(), err_msg=name)


@pytest.mark.parametrize(("learned", "free"), [(False, False), *slowly((False, True), (True, False)), (True, True)])
def test_grid_claim_matches_filter_on_exact_readings(learned, free):
    model = replace(chain(("k1", "k2")), free_loads=free)
    own = replace(constants(model), learned=learned)
    P, x = start(7), nominal()
    P[5:, 5:] = np.diag([0.01**2, 0.01**2])
    run = filter_on_grid(GridRecord(model, believed(model), P, forces()[..., :1], readings(x), own)).run
    claim = predict_grid_std(model, x, forces(), P, own)
    np.testing.assert_allclose(claim.std[1:, 0, 4:], run.std[1:, 0, 4:], rtol=2e-2)
    np.testing.assert_allclose(sum(claim.budget.values()), claim.std[:, 0] ** 2, rtol=1e-7)


@pytest.mark.parametrize(("parameters", "free"), [(("k1", "k2"), True), ((), False)])
def test_budget_parts_sum_to_variance(parameters, free):
    model = replace(chain(parameters), free_loads=free)
    claim = predict_grid_std(model, nominal(), forces(), start(model.size), constants(model))
    np.testing.assert_allclose(sum(claim.budget.values()), claim.std[:, 0] ** 2, rtol=1e-7)


def test_grid_claim_without_parameters_matches_kalman_filter():
    model = chain()
    own = none_considered(model)
    grid_run, filtered = (of(model, nominal(), forces(), start(), own) for of in (predict_grid_std, covariance_recursion))
    np.testing.assert_allclose(grid_run.std, filtered.std, rtol=1e-9)
    for name, part in filtered.budget.items():
        np.testing.assert_allclose(grid_run.budget[name], part, rtol=1e-7, atol=1e-15, err_msg=name)


def test_sigma_vanishes_for_infinite_samples():
    model = replace(chain(("k1",)), Q=np.zeros((6, 6)))
    P = np.zeros((6, 6))
    P[5, 5] = 0.2**2
    sets = replace(model, r=model.r * np.array([[1e-6, 1e-6], [1e-4, 1e-4], [1.0, 1e12]]))
    std = predict_grid_std(sets, nominal(), forces(), P, none_considered(model)).std[-1, :, 5]
    np.testing.assert_allclose(std[1] / std[0], 10, rtol=1e-4)
    one = replace(model, H=model.H[:1], r=model.r[:1])
    alone = predict_grid_std(one, nominal(), forces(), P, none_considered(one)).std[-1, 0, 5]
    np.testing.assert_allclose(std[2], alone, rtol=1e-9)


@pytest.mark.parametrize("quieter", [1e-3, 1e-6, 1e-9])
def test_confounded_constants_keep_prior_sigma(quieter):
    """A scale of all springs of σ 1 % beside both springs, each known to 20 %: samples say what each is times the scale."""
    model = chain(("k1", "k2"))
    model = replace(model, Q=np.zeros((7, 7)), r=model.r * quieter**2)
    P = np.diag([0.0] * 5 + [0.2**2, 0.2**2])
    scale = replace(none_considered(model), stiffness=STIFFER)
    found = predict_grid_std(model, nominal(), forces(), P, scale)
    expected = (1 / STIFFER**2 + 2 / 0.2**2) ** -0.5
    np.testing.assert_allclose(found.std[-1, 0, 5:], expected, rtol=2e-4)
    np.testing.assert_allclose(sum(found.budget.values())[-1, 5:], expected**2, rtol=4e-4)


def test_claim_of_many_gauges_matches_filter():
    gauges = tuple(np.linspace(0.02, 1.9, 60))
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), (), gauges=gauges)
    std = covariance_recursion(model, np.zeros((61, 8)), np.zeros((60, 3, 1)), P0).std
    np.testing.assert_allclose(std[:, :, -1], run_filter(model, mean, P0, u, y).std[:, :1, -1], rtol=1e-7)


def test_the_claim_along_a_motion_holds_for_accelerometers_and_input_models():
    beam, h, steps = make_beam(modes=5, graded=True, load_nodes=(16, 8)), 5e-4, 240
    model = make_filter(
        beam,
        ("tip",),
        ("E",),
        ("middle",),
        h,
        models={"tip": Oscillator(20.0)},
        accelerometers=2,
        every=3,
        q_velocity=0.1,
    )
    u = np.zeros((steps, 3, 2))
    u[:, :, 1:] = sine(h * np.arange(steps), h, 1e4, 20.0)
    x = simulate(beam.model, beam.model.reference, u, h)
    full = np.hstack([x[1:], np.zeros((steps, model.size - 10))])
    y = measure(model, full, u[:, :, 1].sum(axis=1)[:, None])[0][2::3]
    P0 = np.diag([0.0] * 10 + [1e-4] * (model.size - 10))
    run = run_filter(model, np.zeros(model.size), P0, u[:, :, 1:], y)
    std = covariance_recursion(model, x, u, P0).std
    np.testing.assert_allclose(std[:, 0, 10:], run.std[:, 0, 10:], rtol=1e-4)


def test_budget_parts_match_errors_of_each_source():
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


def test_constant_sensitivity_equals_error_slope():
    """Central differences of a filter that is fed with what a slightly different chain reads without noise."""
    model, size = chain(("k1", "k2")), 1e-3
    P, known, mean = start(model.size), forces()[..., :1], believed(model)

    def error(gain=(0, 0), offset=(0, 0), drift=(0, 0), damping=(0, 0), stiffer=0.0):
        x = moved(damping, stiffer)
        y = readings(x, gain, offset, drift)
        whole = np.tile(mean, (STEPS + 1, 1))
        whole[:, :4] = x
        return run_filter(model, mean, P, known, y).mean[:, 0] - whole

    def slope(name, unit):
        return (error(**{name: size * unit}) - error(**{name: -size * unit})) / (2 * size)

    claim = covariance_recursion(model, nominal(), forces(), P, constants(model))
    budget, both = claim.budget, np.eye(2)
    assert set(budget) == set(SOURCES)
    np.testing.assert_allclose(sum(budget.values()), claim.std[:, 0] ** 2, rtol=1e-9)
    for name in ("gain", "offset", "drift", "damping"):
        total = sum(slope(name, own) ** 2 for own in both)
        np.testing.assert_allclose(budget[name], total, rtol=2e-4, atol=2e-4 * total.max(axis=0).min(), err_msg=name)
    total = slope("stiffer", 1.0) ** 2
    np.testing.assert_allclose(budget["stiffness"] / total.max(axis=0), total / total.max(axis=0), atol=2e-4)
    sets = replace(model, r=model.r * np.array([[1.0, 1.0], [1.0, 1e12]]))
    side_by_side = covariance_recursion(sets, nominal(), forces(), P, constants(model))
    for own, r in enumerate(sets.r):
        alone = covariance_recursion(replace(model, r=r), nominal(), forces(), P, constants(model)).std
        np.testing.assert_allclose(side_by_side.std[:, own], alone[:, 0], rtol=1e-9)
    np.testing.assert_allclose(sum(side_by_side.budget.values()), side_by_side.std[:, 0] ** 2, rtol=1e-9)


@pytest.fixture
def loaded():
    """A beam under a constant unknown load and a known sine: beam, filter model, mean, covariance, loads and motion."""
    beam, steps = make_beam(modes=4, graded=True, load_nodes=(16, 8)), 20
    model = make_filter(beam, ("tip",), ("E",), ("middle",), accelerometers=2, q_velocity=0.1)
    u = np.zeros((steps, 3, 2))
    u[:, 0, 0], u[:, :, 1:] = 2e4, sine(model.h * np.arange(steps), model.h, 1e4, 20.0)
    P, mean = np.diag([0.0] * 8 + [1e-4] * (model.size - 8)), np.zeros(model.size)
    mean[8] = 2.0
    return beam, model, mean, P, u, simulate(beam.model, beam.model.reference, u, model.h)


def full_state(x):
    """With the unknown load, and E as it was guessed, at the end of every step."""
    return np.hstack([x[1:], np.full((len(x) - 1, 1), 2.0), np.zeros((len(x) - 1, 1))])


def test_accelerometer_gain_scales_load_response(loaded):
    _, model, mean, P, u, x = loaded
    gain, size, channels = 0.03, 1e-3, len(model.H)
    y = measure(model, full_state(x), u[:, :, 1].sum(axis=1)[:, None])[0]

    def estimate(factor):
        return run_filter(model, mean, P, u[:, :, 1:], y * factor).mean[:, 0]

    D, E = np.zeros((channels, channels, 9)), np.zeros((channels, channels, 1))
    rows = [np.zeros((channels, 9)), np.zeros((channels, 1))]
    rows[0][:, :4] = model.H[:, :4]
    moving = model.accelerometers
    at_guess = theta_at(model, np.zeros((1, 1)))
    rows[0][moving], rows[1][moving] = (own[0] for own in acceleration_rows(model, at_guess, model.H[moving, :4]))
    own = range(channels)
    D[own, own], E[own, own] = gain * rows[0], gain * rows[1]
    considered = ConsideredParameters(("gain",) * channels, D, E, np.zeros((channels, channels)))
    found = covariance_recursion(model, x, u, P, considered).budget["gain"][:, 8:]
    step = gain * size * np.eye(channels)
    slopes = [(estimate(1 + own) - estimate(1 - own)) / (2 * size) for own in step]
    total = sum(slope[:, 8:] ** 2 for slope in slopes)
    np.testing.assert_allclose(found / total.max(axis=0), total / total.max(axis=0), atol=1e-4)


def test_load_position_sensitivity_equals_error_slope(loaded):
    beam, model, mean, P, u, x = loaded
    size, shape, channels, moving = 1e-4, beam.model.input_shape, len(model.H), model.accelerometers
    changes = 0.02 * np.stack([shape * [1, 0], shape * [0, 1], shape[:, ::-1], shape[::-1] * [1, -1]])
    strain = (
        1e-9 * np.arange(8.0 * channels).reshape(4, channels, 2) * ~moving[:, None] * (changes.any(axis=1))[:, None]
    )

    def estimate(change, at_once):
        inner = replace(beam.model, input_shape=shape + change)
        x = simulate(inner, inner.reference, u, model.h)
        loads = u.sum(axis=1)
        y = measure(replace(model, model=inner), full_state(x), loads[:, 1:])[0] + loads @ at_once.T
        whole = np.tile(mean, (len(x), 1))
        whole[:, :8] = x
        return run_filter(model, mean, P, u[:, :, 1:], y).mean[:, 0] - whole

    at_guess = theta_at(model, np.zeros((1, 1)))
    direct = strain.copy()
    for own, change in zip(direct, changes, strict=True):
        own[moving] = model.H[moving, :4] @ acceleration_change(model, at_guess, change)[0]
    D, E = load_rows(model, direct)
    source = ("known", "unknown", "swapped", "mirrored")
    considered = ConsideredParameters(source, D, E, np.zeros((4, channels)), shape=changes)
    found = covariance_recursion(model, x, u, P, considered).budget
    for name, change, at_once in zip(source, changes, strain, strict=True):
        total = (
            (estimate(size * change, size * at_once) - estimate(-size * change, -size * at_once)) / (2 * size)
        ) ** 2
        np.testing.assert_allclose(found[name] / total.max(axis=0), total / total.max(axis=0), atol=1e-4, err_msg=name)

"""Motion and loads by gains that consider constants that nobody estimates: σ is that of the error, and the least there is."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from strainsight.estimation import consider_smoother
from strainsight.estimation.conditional import ConsideredParameters, linear_models, none_considered
from strainsight.estimation.consider_smoother import consider_smoothed
from strainsight.estimation.filter import run_filter
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.parallel_filters import Data
from strainsight.estimation.record import GridRecord
from strainsight.estimation.reduced import Biased, DrivenModel
from strainsight.estimation.smoother import WantedCovariances, smooth
from strainsight.fem.affine import AffineOperator

from ..shared import slowly
from .chain import ROWS, STIFFNESS, continuous, finer, forces, gathered, joint, loaded_chain, log_normal, start, states
from .chain import STEPS as LONG
from .chain import H as STEP
from .chain import chain as unknown_chain
from .conftest import make_beam, make_filter
from .truth import draw_truth
from .two_masses import REFERENCE, believed, chain, constants
from .two_masses import forces as both_forces
from .two_masses import start as start_of

STEPS = 8
OFFSETS = np.array([[2e-3, 0.0], [0.0, 5e-3], [1e-3, 1e-3], [0.0, 0.0]])
DRIFTS = np.array([[0.0, 0.0], [0.0, 2e-3], [0.0, 0.0], [3e-3, -4e-3]])
MISSING = (3, 0), (4, 0), (4, 1), (6, 1)
P = start()[:5, :5]


def offsets(learned=False):
    E = np.stack([np.zeros_like(DRIFTS), DRIFTS], axis=2)
    return ConsideredParameters(("offset",) * 4, np.zeros((4, 2, 5)), E, OFFSETS, learned=learned)


def both(model, y, considered):
    y = y.copy()
    for at in MISSING:
        y[at] = np.nan
    grid_run = filter_on_grid(GridRecord(model, np.zeros(5), P, forces(STEPS), y, considered))
    later = smooth_on_grid(GridRecord(model, np.zeros(5), P, forces(STEPS), y, considered), grid_run)
    return [(own.mean[:, 0], own.std[:, 0]) for own in (grid_run.run, later)]


def sources(model):
    """Each source of the truth by itself, of unit variance: states (N, STEPS + 1, 5) and readings (N, STEPS, 2), by expm."""
    F = continuous(REFERENCE)[0]
    A = expm(F * STEP)
    noise = np.linalg.cholesky(gathered(F, model.Q))
    first = [np.concatenate([own[None], np.zeros((STEPS, 5))]) for own in np.diag(np.sqrt(np.diag(P)))]
    steps = [np.insert(np.zeros((STEPS, 5)), k, own, axis=0) for k in range(1, STEPS + 1) for own in noise.T]
    x = np.array(first + steps + [np.zeros((STEPS + 1, 5))] * (2 * STEPS + len(OFFSETS)))
    for k in range(STEPS):
        x[:, k + 1] += x[:, k] @ A.T
    y = x[:, 1:, :2] @ ROWS.T
    white = np.sqrt(model.noise[0]) * np.eye(2 * STEPS).reshape(-1, STEPS, 2)
    y[-len(OFFSETS) - 2 * STEPS : -len(OFFSETS)] += white
    y[-len(OFFSETS) :] += OFFSETS[:, None] + DRIFTS[:, None] * np.arange(1, STEPS + 1)[:, None] / STEPS
    return x, y


def test_sigma_equals_error_of_each_source():
    """Filter and smoother are linear in their samples: what they make of each source by itself, less the motion that it is."""
    model = loaded_chain()
    x, y = sources(model)
    nothing = both(model, np.zeros((STEPS, 2)), offsets())
    errors = np.zeros((2, len(y), STEPS + 1, 5))
    for i, (motion, reading) in enumerate(zip(x, y, strict=True)):
        for which, (own, none) in enumerate(zip(both(model, reading, offsets()), nothing, strict=True)):
            errors[which, i] = own[0] - none[0] - motion
    for which, (_, std) in enumerate(nothing):
        real = np.sqrt(np.sum(errors[which] ** 2, axis=0))
        np.testing.assert_allclose(std[1:], real[1:], rtol=1e-6)
    assert (nothing[1][1][: STEPS // 2, 4] < nothing[0][1][: STEPS // 2, 4]).all()


def test_first_samples_match_full_bayes():
    model = loaded_chain()
    _, y = draw_truth(model, np.zeros(5), P, forces(STEPS), [3])
    (own, _), (all_of_it, _) = (both(model, y[:, 0] + 2e-3, offsets(learned)) for learned in (False, True))
    for considered, learned in zip(own, all_of_it, strict=True):
        np.testing.assert_allclose(considered[1], learned[1], rtol=1e-9, atol=1e-12)


def test_learning_smoother_matches_bayes_with_missing_samples():
    """Motion, load and constants are one normal vector, conditioned on the samples that are there."""
    model = loaded_chain()
    _, O, read_states, Q = states(np.zeros(2), forces(STEPS), np.diag(model.Q))
    prior = O @ block_diag(P, *[Q] * STEPS) @ O.T
    constants_read = OFFSETS[:, None] + DRIFTS[:, None] * np.arange(1, STEPS + 1)[:, None] / STEPS
    there = np.ones((STEPS, 2), dtype=bool)
    there[tuple(np.transpose(MISSING))] = False
    rows = np.hstack([read_states, constants_read.reshape(len(OFFSETS), -1).T])[there.ravel()]
    whole = block_diag(prior, np.eye(len(OFFSETS)))
    S = rows @ whole @ rows.T + model.noise[0] * np.eye(len(rows))
    variance = np.diag(whole - whole @ rows.T @ np.linalg.solve(S, rows @ whole))[: len(prior)].reshape(-1, 5)
    (_, later) = both(model, np.zeros((STEPS, 2)), offsets(learned=True))
    np.testing.assert_allclose(later[1], np.sqrt(variance), rtol=1e-9, atol=1e-12)


def test_model_without_parameters_matches_fixed_stiffness():
    model = loaded_chain()
    K = sum(value * STIFFNESS[name] for name, value in REFERENCE.items())
    plain = replace(model, model=replace(model.model, stiffness=AffineOperator(K, {}), reference={}), fixed={})
    _, y = draw_truth(model, np.zeros(5), P, forces(STEPS), [3])
    for one, other in zip(*(both(own, y[:, 0], offsets()) for own in (model, plain)), strict=True):
        np.testing.assert_allclose(one[0], other[0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(one[1], other[1], rtol=1e-9, atol=1e-12)


def test_smoother_without_constants_matches_rts():
    model, none = loaded_chain(), none_considered(loaded_chain())
    _, y = draw_truth(model, np.zeros(5), P, forces(STEPS), [3])
    one = linear_models(model, np.zeros((1, 0)), none)
    begin = np.zeros((1, 5)), P, np.zeros((1, 0, 5))
    known, noise = forces(STEPS), np.broadcast_to(model.noise, (STEPS, 2))
    data = Data(known.reshape(STEPS, -1), known.sum(axis=1), y[:, 0], noise, np.zeros(2))
    found = consider_smoothed(one, begin, data)
    expected = smooth(model, run_filter(model, np.zeros(5), P, known, y[:, 0], keep="all"))
    std = expected.std[:, 0]
    np.testing.assert_allclose(found.x[0] / std, expected.mean[:, 0] / std, atol=1e-9)
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.P[0], axis1=1, axis2=2)) / std, 1.0, atol=1e-9)


def test_smoothed_sigma_does_not_exceed_filtered_sigma():
    model, first = chain(), start_of()
    own, known = constants(model), both_forces()[:, :, :1]
    for noise in (1.0, 1e-1, 1e-2):
        quiet = replace(model, r=model.r * noise**2)
        _, y = draw_truth(quiet, np.zeros(5), first, known, [3])
        grid_run = filter_on_grid(GridRecord(quiet, np.zeros(5), first, known, y[:, 0], own))
        later = smooth_on_grid(GridRecord(quiet, np.zeros(5), first, known, y[:, 0], own), grid_run)
        assert (later.std <= grid_run.run.std * (1 + 1e-6)).all()


@pytest.mark.parametrize("learned", [False, *slowly(True)])
def test_piecewise_smoothing_matches_whole_record(monkeypatch, learned):
    model = chain(tuple(REFERENCE)[:1])
    own, mean, first, known = (
        replace(constants(model), learned=learned),
        believed(model),
        start_of(6),
        both_forces()[..., :1],
    )
    _, y = draw_truth(model, mean, first, known, [3])
    samples, last = y[:, 0], len(y)
    samples[7, 0], samples[15] = np.nan, np.nan
    grid_run = filter_on_grid(GridRecord(model, mean, first, known, samples, own))
    whole = smooth_on_grid(GridRecord(model, mean, first, known, samples, own), grid_run)
    rows = np.random.default_rng(1).standard_normal((3, model.size))
    wanted = WantedCovariances(rows, np.array([4, 1]), np.array([0, 6, 7, last]))
    monkeypatch.setattr(consider_smoother, "KEPT", 7 * linear_models(model, np.zeros((3, 1)), own).kept_a_step)
    shares = []
    found = smooth_on_grid(
        GridRecord(model, mean, first, known, samples, own), grid_run, wanted=wanted, progress=shares.append
    )
    close = partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-15)
    close(found.mean, whole.mean)
    close(found.std, whole.std)
    P = whole.covariance[:, 0]
    by_rows = np.sqrt(np.einsum("ra,tab,rb->tr", rows[[2, 0]], P, rows[[2, 0]]))
    close(found.std_of(rows[[2, 0]]), by_rows)
    close(found.covariance_of(np.array([1, 4])), P[:, [[1], [4]], [1, 4]])
    for k in wanted.instants:
        close(found.covariance_at(k), P[k])
    assert found.covariance is None
    assert len(shares) == (1 if learned else -(-last // 7))
    assert shares[-1] == 1.0
    with pytest.raises(ValueError, match="did not store"):
        found.covariance_at(5)
    with pytest.raises(ValueError, match="did not store"):
        found.std_of(np.ones((1, model.size)))


END = np.array([[6e-3, 0.0], [0.0, 4e-3], [5e-3, 5e-3]])
"""What one of every constant adds to both readings at the end (3, 2): two channels that drift, and what both feel."""
FELT = END[:, None] * np.arange(1, LONG + 1)[:, None] / LONG


def drifts(learned=False):
    E = np.stack([np.zeros((3, 2)), END], axis=2)
    return ConsideredParameters(("drift", "drift", "temperature"), np.zeros((3, 2, 5)), E, np.zeros((3, 2)), learned=learned)


def measured():
    model = unknown_chain()
    _, y = draw_truth(model, np.zeros(7), start(), forces(), [5])
    return model, y[:, 0] + np.tensordot([1.8, -1.6, 1.7], FELT, axes=1)


def test_parameters_and_drifts_match_brute_force_bayes():
    """All readings are one Gaussian at every θ: drifts are one more covariance of it, and one more regression."""
    model, y = measured()
    P, columns = start(), FELT.reshape(3, -1).T
    with finer(0.6, 20.0):
        grid_run = filter_on_grid(GridRecord(model, np.zeros(7), P, forces(), y, drifts()))
    mean, std = grid_run.run.mean[-1, 0, 5:], grid_run.run.std[-1, 0, 5:]
    axis = 0.7 * np.arange(-11, 12)
    point = mean + std * np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    log_density, nu = np.empty(len(point)), np.empty((len(point), 3))
    for i, p in enumerate(point):
        middle, covariance = joint(p, P)
        covariance = covariance + columns @ columns.T
        log_density[i] = log_normal(y.ravel(), middle, covariance) - 0.5 * np.sum(p**2 / np.diag(P)[5:])
        nu[i] = columns.T @ np.linalg.solve(covariance, y.ravel() - middle)
    w = np.exp(log_density - log_density.max())
    assert max(w.reshape(23, 23)[[0, -1]].max(), w.reshape(23, 23)[:, [0, -1]].max()) < 1e-8
    w /= w.sum()
    expected = w @ point
    np.testing.assert_allclose(mean / std, expected / std, atol=1e-6)
    np.testing.assert_allclose(std, np.sqrt(w @ (point - expected) ** 2), rtol=1e-6)
    np.testing.assert_allclose(grid_run.nu_moments[0], w @ nu, atol=1e-5)
    exact = filter_on_grid(GridRecord(model, np.zeros(7), P, forces(), y, none_considered(model))).run
    assert (np.abs(exact.mean[-1, 0, 5:] - mean) > 0.5 * std).any()


def test_motion_with_learned_drifts_matches_regression():
    model, P = loaded_chain(), start()[:5, :5]
    y, own = measured()[1], drifts(learned=True)
    grid_run = filter_on_grid(GridRecord(model, np.zeros(5), P, forces(), y, own))
    later = smooth_on_grid(GridRecord(model, np.zeros(5), P, forces(), y, own), grid_run)
    mean, covariance = joint(np.zeros(2), start())
    columns = FELT.reshape(3, -1).T
    whole, rows = covariance + columns @ columns.T, covariance[-2:].copy()
    rows[:, -2:] -= model.noise[0] * np.eye(2)
    expected = mean[-2:] + rows @ np.linalg.solve(whole, y.ravel() - mean)
    left = rows[:, -2:] - rows @ np.linalg.solve(whole, rows.T)
    np.testing.assert_allclose(ROWS @ later.mean[-1, 0, :2], expected, atol=1e-6 * np.sqrt(np.diag(left)).min())
    np.testing.assert_allclose(ROWS @ later.covariance[-1, 0, :2, :2] @ ROWS.T, left, rtol=1e-5, atol=1e-8 * left.max())
    np.testing.assert_allclose(later.mean[-1, 0] / later.std[-1, 0], grid_run.run.mean[-1, 0] / later.std[-1, 0], atol=1e-5)
    np.testing.assert_allclose(later.std[-1, 0], grid_run.run.std[-1, 0], rtol=1e-5)


AT = np.array([0, 2])
RECORD = 150


@pytest.fixture(scope="module")
def filters():
    beam = make_beam(modes=3, load_nodes=(16, 8))
    known = np.tile(np.array([50.0, 20.0, -10.0])[:, None], (RECORD, 1, 1))
    return {
        unknown: DrivenModel(
            make_filter(beam, ("tip",), unknown, ("middle",), accelerometers=1, h=1e-3, noise_step=1e-3), known
        )
        for unknown in ((), ("E",))
    }


@pytest.mark.parametrize("unknown", [(), ("E",)])
def test_offset_affects_only_its_channel(filters, unknown):
    plain = filters[unknown]
    model, n = Biased(plain, AT), plain.size
    rng = np.random.default_rng(4)
    x = rng.normal(size=(2, n)) * np.where(np.arange(n) < 6, 1e-4, 0.01)
    b = rng.normal(size=(2, len(AT)))
    both = np.hstack([x, b])
    for function, own, kept in ((model.step, plain.step, n), (model.measure, plain.measure, model.channels)):
        value, slope = function(both, 3)
        there, base = own(x, 3)
        shift = np.zeros_like(value[:, :kept])
        if function == model.measure:
            shift[:, AT] = b
        np.testing.assert_array_equal(value[:, :kept], there + shift)
        np.testing.assert_array_equal(slope[..., :kept, :n], base)
        moved = function(np.hstack([x, b + 1.0]), 3)[0] - value
        np.testing.assert_allclose(moved, np.broadcast_to(slope[..., n:].sum(axis=-1), moved.shape), atol=1e-12)
    np.testing.assert_array_equal(model.step(both, 3)[0][:, n:], b)
    np.testing.assert_array_equal(model.process(3), np.pad(plain.process(3), (0, len(AT))))

"""The claimed σ without a filter: that of the filter on the same motion, of least squares on everything at once, of the bank."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.augmentation.input_models import Oscillator
from strainsight.estimation.bank import filter_bank
from strainsight.estimation.bank_claim import bank_claim
from strainsight.estimation.claim import covariance_recursion
from strainsight.estimation.conditional import no_nuisances
from strainsight.estimation.filter import run_filter
from strainsight.estimation.motion import measure
from strainsight.rom.modal_step import simulate

from ..shared import slowly
from .drawn import drawn, prior
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

SOURCES = ("noise", "process noise", "start", "gain", "offset", "drift", "damping", "stiffness")


def slopes(parameters):
    """Of the motion (STEPS, 4) and the readings (STEPS, 2) in every mode's damping, the stiffness, gains, offsets, drifts and
    parameters, by differences of fourth order of the textbook's steps: (c, STEPS, 4), (c, STEPS, 2); and what each stands for."""
    size = 1e-3

    def moved(damping=(0.0, 0.0), stiffer=0.0, **logs):
        changed = {name: value * np.exp(logs.get(name, 0.0)) for name, value in REFERENCE.items()}
        return motion(*steps_of(np.exp(DAMPING * np.array([damping])), np.exp(STIFFER * stiffer), changed))[1:, 0]

    def slope(**one):
        near, far = (
            moved(**{name: k * size * unit for name, unit in one.items()})
            - moved(**{name: -k * size * unit for name, unit in one.items()})
            for k in (1, 2)
        )
        return (8 * near - far) / (12 * size)

    still = np.zeros((STEPS, 4))
    motions = [slope(damping=own) for own in np.eye(2)] + [slope(stiffer=1.0)] + [still] * 6
    read = [own[:, :2] @ ROWS.T for own in motions[:3]]
    read += [GAIN * (nominal()[1:, :2] @ ROWS.T) * own for own in np.eye(2)]
    read += [OFFSET * np.ones((STEPS, 1)) * own for own in np.eye(2)]
    read += [DRIFT * SHARE * own for own in np.eye(2)]
    for name in parameters:
        motions.append(slope(**{name: 1.0}))
        read.append(motions[-1][:, :2] @ ROWS.T)
    names = ("damping", "damping", "stiffness", "gain", "gain", "offset", "offset", "drift", "drift")
    source = (*names, *["start"] * len(parameters))
    return np.array(motions), np.array(read), source


def everything(model, parameters):
    """All that is unknown as columns of unit size: the states (STEPS, 5, N) and the readings (2·STEPS, N) that each makes, with
    one source each, the constants last."""
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
    """The state at the end that each column makes a filter believe (5, N), by the gains of least variance over the first
    `considered` columns, none of which it learns."""
    believed = np.zeros(states.shape[1:])
    for k, x in enumerate(states):
        believed = whole @ believed
        i, e = (own[:, :considered] for own in (y[2 * k : 2 * k + 2] - ROWS @ believed[:2], x - believed))
        believed = believed + e @ i.T @ np.linalg.inv(i @ i.T) @ (y[2 * k : 2 * k + 2] - ROWS @ believed[:2])
    return believed


@pytest.mark.parametrize("learned", [False, True])
@pytest.mark.parametrize("parameters", [("k1", "k2"), ("k2",), ()])
def test_it_is_that_of_least_squares_on_everything_at_once(parameters, learned):
    """Samples, steps of the process, states at the start, constants and parameters, as one regression without any recursion;
    states that do not follow ν by the gains of a filter that considers it, and beside them what parameters leave."""
    model = chain(parameters)
    k = len(parameters)
    P = start(model.size)
    claim = bank_claim(model, nominal(), forces(), P, replace(constants(model), learned=learned))
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


@pytest.mark.parametrize("learned", [False, True])
@pytest.mark.parametrize(("parameters", "free"), [(("k1", "k2"), False), (("k1", "k2"), True), ((), False)])
def test_the_parts_are_the_whole(parameters, free, learned):
    model = replace(chain(parameters), free_loads=free)
    claim = bank_claim(model, nominal(), forces(), start(model.size), replace(constants(model), learned=learned))
    np.testing.assert_allclose(sum(claim.budget.values()), claim.std[:, 0] ** 2, rtol=1e-7)


def test_without_parameters_and_tolerances_it_is_that_of_the_kalman_filter():
    model = chain()
    own = no_nuisances(model)
    found, expected = (claim(model, nominal(), forces(), start(), own) for claim in (bank_claim, covariance_recursion))
    np.testing.assert_allclose(found.std, expected.std, rtol=1e-9)
    for name, part in expected.budget.items():
        np.testing.assert_allclose(found.budget[name], part, rtol=1e-7, atol=1e-15, err_msg=name)


@pytest.mark.parametrize(
    ("learned", "free"), [(False, False), *slowly((False, True), (True, False)), (True, True)]
)
def test_it_is_what_the_bank_claims_of_readings_without_noise(learned, free):
    """Near the guess the posterior is normal; the lattice is right to a hundredth of σ."""
    model = replace(chain(("k1", "k2")), free_loads=free)
    own = replace(constants(model), learned=learned)
    P, x = start(7), nominal()
    P[5:, 5:] = np.diag([0.01**2, 0.01**2])
    run = filter_bank(model, believed(model), P, forces()[..., :1], x[1:, :2] @ ROWS.T, own).run
    claim = bank_claim(model, x, forces(), P, own)
    np.testing.assert_allclose(claim.std[1:, 0, 4:], run.std[1:, 0, 4:], rtol=2e-2)


def test_known_constants_and_samples_without_end_leave_nothing():
    """σ falls with the noise where nothing else is unknown, and a gauge that says nothing counts for none."""
    model = replace(chain(("k1",)), Q=np.zeros((6, 6)))
    P = np.zeros((6, 6))
    P[5, 5] = 0.2**2
    sets = replace(model, r=model.r * np.array([[1e-6, 1e-6], [1e-4, 1e-4], [1.0, 1e12]]))
    std = bank_claim(sets, nominal(), forces(), P, no_nuisances(model)).std[-1, :, 5]
    np.testing.assert_allclose(std[1] / std[0], 10, rtol=1e-4)
    one = replace(model, H=model.H[:1], r=model.r[:1])
    alone = bank_claim(one, nominal(), forces(), P, no_nuisances(one)).std[-1, 0, 5]
    np.testing.assert_allclose(std[2], alone, rtol=1e-9)


@pytest.mark.parametrize("quieter", [1e-3, 1e-6, 1e-9])
def test_confounded_constants_stay_unknown_however_quiet_the_readings(quieter):
    """A scale of all springs of σ 1 % beside both springs, each known to 20 %: samples say what each is times the scale."""
    model = chain(("k1", "k2"))
    model = replace(model, Q=np.zeros((7, 7)), r=model.r * quieter**2)
    P = np.diag([0.0] * 5 + [0.2**2, 0.2**2])
    scale = replace(no_nuisances(model), stiffness=STIFFER)
    found = bank_claim(model, nominal(), forces(), P, scale)
    expected = (1 / STIFFER**2 + 2 / 0.2**2) ** -0.5
    np.testing.assert_allclose(found.std[-1, 0, 5:], expected, rtol=2e-4)
    np.testing.assert_allclose(sum(found.budget.values())[-1, 5:], expected**2, rtol=4e-4)


def test_the_claim_along_a_motion_is_what_a_filter_on_that_motion_claims(make_beam, make_filter, sine):
    """Fed with strains free of noise and started at the truth, the filter stays on the motion: the two σ are one."""
    beam, h, steps = make_beam(graded=True), 5e-4, 120
    u = sine(h * np.arange(steps), h, 1e4, 20.0)
    x = simulate(beam.model, beam.model.reference, u, h)
    places = [(0.05, 0.3, 0.9, 1.5), (0.1, 0.2, 0.3, 0.4)]
    model = make_filter(beam, parameters=("rho", "E"), known=("tip",), h=h)
    H = np.stack([np.hstack([beam.rows(*p), np.zeros((4, model.size - 10))]) for p in places])
    model = replace(model, H=H)
    y = np.einsum("bmi,ki->kbm", H[..., :10], x[1:, :10])
    run = run_filter(model, np.zeros(model.size), prior(model), u, y)
    std = covariance_recursion(model, x, u, prior(model)).std
    np.testing.assert_allclose(std[..., 20:], run.std[..., 20:], rtol=1e-5)


def test_the_claim_for_inputs_needs_no_motion(make_beam, make_filter, sine):
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(), sine, ("tip",), ())
    std = covariance_recursion(model, np.zeros((61, 20)), np.zeros((60, 3, 1)), P0).std
    np.testing.assert_allclose(std, run_filter(model, mean, P0, u, y).std[:, :1], rtol=1e-9, atol=1e-30)


def test_the_claim_of_many_gauges_is_that_of_the_filter_with_all_of_them(make_beam, make_filter, sine):
    """Sixty gauges and nine states: what they say together is said by nine rows."""
    gauges = tuple(np.linspace(0.02, 1.9, 60))
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), (), gauges=gauges)
    std = covariance_recursion(model, np.zeros((61, 8)), np.zeros((60, 3, 1)), P0).std
    np.testing.assert_allclose(std[:, :, -1], run_filter(model, mean, P0, u, y).std[:, :1, -1], rtol=1e-7)


def test_the_claim_along_a_motion_holds_for_accelerometers_and_input_models(make_beam, make_filter, sine):
    """As above, with an accelerometer whose rows vary along the motion, an oscillator load and samples every third step."""
    beam, h, steps = make_beam(modes=5, graded=True, load_nodes=(16, 8)), 5e-4, 240
    model = make_filter(
        beam, ("tip",), ("E",), ("middle",), h, models={"tip": Oscillator(20.0)}, accelerometers=2, every=3, q_velocity=0.1
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

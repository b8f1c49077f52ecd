"""Constants beside the states of a bank: errors of gauges, loads, damping and stiffness, integrated out or learned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from strainsight.estimation.bank import filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.conditional import Nuisances, discrepancy, no_nuisances
from strainsight.estimation.draws import draw_truth

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
    forces,
    start,
)
from .drawn import prior


def test_motion_as_it_is_read_is_off_by_all_of_a_constant():
    """Offsets of both channels that no sample corrects the motion for, all loads known: at every parameter the plain filter's
    states, and σ that holds how an offset of one σ moves them."""
    model = driven_chain(parameters=())
    P = driven_start()[:4, :4]
    _, y = draw_truth(model, np.zeros(4), P, forces(), [5])
    offset = np.array([[NOISE, 0.0], [0.0, 3 * NOISE]])
    nuisances = Nuisances(("first", "second"), np.zeros((2, 2, 4)), np.zeros((2, 2, 1)), offset)

    def run(values, own=None):
        return filter_bank(model, np.zeros(4), P, forces(), values, own).run

    plain, found = run(y[:, 0]), run(y[:, 0], nuisances)
    moved = np.stack([run(y[:, 0] + own).mean - plain.mean for own in offset])
    scale = plain.std.max(axis=0)
    np.testing.assert_allclose(found.mean / scale, plain.mean / scale, atol=1e-9)
    np.testing.assert_allclose(found.std, np.sqrt(plain.std**2 + np.sum(moved**2, axis=0)), rtol=1e-7)


@pytest.mark.slow
def test_sigma_holds_where_gauges_read_too_much():
    """Over draws of gain errors of both gauges: σ of the parameters holds them integrated out, and does not hold without."""
    model, P, gain, draws = chain(noise=5e-5), start(), 0.02, 60
    truth, y = draw_truth(model, np.zeros(7), P, forces(), range(100, 100 + draws))
    D = np.zeros((2, 2, 5))
    D[[0, 1], [0, 1], :2] = gain * ROWS
    nuisances = Nuisances(("gain 1", "gain 2"), D, np.zeros((2, 2, 1)), np.zeros((2, 2)))
    rng = np.random.default_rng(1)
    with_it, without = [], []
    for b in range(draws):
        wrong = y[:, b] + (truth[1:, b, :2] @ ROWS.T) * gain * rng.standard_normal(2)
        bank = filter_bank(model, np.zeros(7), P, forces(), wrong, nuisances)
        exact = filter_bank(model, np.zeros(7), P, forces(), wrong)
        for run, found in ((bank.run, with_it), (exact.run, without)):
            found.append((run.mean[-1, 0, 5:] - truth[-1, b, 5:]) / run.std[-1, 0, 5:])
    ratio = np.sqrt(np.mean(np.square(with_it), axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=3 / np.sqrt(2 * draws))
    assert np.sqrt(np.mean(np.square(without), axis=0)).max() > 1.5


@pytest.mark.parametrize(("source", "sizes"), [("damping", (0.1, 0.0)), ("stiffness", (0.0, 0.1))])
def test_what_another_motion_adds_is_the_slope_of_the_error(source, sizes):
    """Exact readings of chains whose damping, mode by mode, or stiffness is a little off, under a known load."""
    model = driven_chain(noise=5e-5, parameters=())
    P, steps, size = driven_start()[:4, :4], 80, 1e-3
    nuisances = replace(no_nuisances(model), damping=sizes[0], stiffness=sizes[1])

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
        return filter_bank(model, np.zeros(4), P, forces(steps), y).run.mean[:, 0] - x

    if source == "damping":
        ends = [[error(np.exp(s * size * 0.1 * mode), 1.0) for s in (1, -1)] for mode in np.eye(2)]
    else:
        ends = [[error(np.ones(2), np.exp(s * size * 0.1)) for s in (1, -1)]]
    slope = np.stack([(ahead - back) / (2 * size) for ahead, back in ends], axis=1)
    y, _ = readings(np.ones(2), 1.0)
    found, plain = (filter_bank(model, np.zeros(4), P, forces(steps), y, own).run.std[:, 0] for own in (nuisances, None))
    added = np.sum(slope**2, axis=1)
    np.testing.assert_allclose((found**2 - plain**2) / added.max(axis=0), added / added.max(axis=0), atol=2e-4)


@pytest.mark.slow
def test_constants_that_are_learned_are_states_of_the_filter():
    """Offsets of both channels, learned as nuisances or estimated as states: the same posterior, evidence and innovations."""
    model, P, std = chain(noise=2e-4), start(), np.array([2e-3, 5e-3])
    _, y = draw_truth(model, np.zeros(7), P, forces(), [3])
    y = y[:, 0] + np.array([1.5e-3, -4e-3])
    offset = np.diag(std)
    learned = Nuisances(
        ("first", "second"), np.zeros((2, 2, 5)), np.zeros((2, 2, 1)), offset, damping=0.0, stiffness=0.0, learned=True
    )
    options = {"spacing": 0.6, "depth": 20.0}
    bank = filter_bank(model, np.zeros(7), P, forces(), y, learned, **options)
    whole = np.diag(np.concatenate([np.diag(P), std**2]))
    states = filter_bank(model, np.zeros(9), whole, forces(), y, biased=np.arange(2), **options)
    scale = np.sqrt(np.diag(P))
    np.testing.assert_allclose(bank.run.mean[:, 0] / scale, states.run.mean[:, 0, :7] / scale, atol=2e-6)
    np.testing.assert_allclose(bank.run.std[1:, 0] / states.run.std[1:, 0, :7], 1.0, atol=1e-5)
    one, other = (
        smooth_bank(model, start, P_own, forces(), y, own, found, at)
        for start, P_own, own, found, at in (
            (np.zeros(7), P, learned, bank, None),
            (np.zeros(9), whole, no_nuisances(model), states, np.arange(2)),
        )
    )
    # the smoothers take different points of the parameters: equal to second order in their σ
    std = other.std[:, 0, :7]
    np.testing.assert_allclose(one.mean[:, 0] / std, other.mean[:, 0, :7] / std, atol=0.03)
    np.testing.assert_allclose(one.std[:, 0] / std, 1.0, atol=0.01)
    for name, tolerance in (("whitened", 1e-5), ("log_likelihood", 1e-3)):
        np.testing.assert_allclose(getattr(bank.run, name), getattr(states.run, name), atol=tolerance)


def test_whether_the_motion_is_corrected_is_nothing_to_the_parameters():
    """Their posterior has the offsets integrated out either way; the motion has all of them in σ, or what the samples leave."""
    model, P, std = chain(noise=2e-4), start(), np.array([2e-3, 5e-3])
    _, y = draw_truth(model, np.zeros(7), P, forces(), [3])
    read = Nuisances(("first", "second"), np.zeros((2, 2, 5)), np.zeros((2, 2, 1)), np.diag(std))
    one, other = (
        filter_bank(model, np.zeros(7), P, forces(), y[:, 0] + [1.5e-3, -4e-3], own)
        for own in (read, replace(read, learned=True))
    )
    np.testing.assert_array_equal(one.weight, other.weight)
    np.testing.assert_array_equal(one.run.mean[:, 0, 5:], other.run.mean[:, 0, 5:])
    np.testing.assert_array_equal(one.run.std[:, 0, 5:], other.run.std[:, 0, 5:])
    assert (one.run.std[5:, 0, :2] > 1.2 * other.run.std[5:, 0, :2]).all()


def test_a_discrepancy_is_noise_of_its_share_by_which_innovations_are_not_judged(make_beam, make_filter, sine):
    model = make_filter(make_beam(modes=4), inputs=(), parameters=("E",), known=("tip",), q_parameter=0.0, q_velocity=1e-4)
    u = sine(model.h * np.arange(80), model.h, 1e4, 20.0)
    mean, P = np.zeros(model.size), prior(model, 0.05)
    _, y = draw_truth(model, mean, P, u, [2])
    y = y[:, 0]
    y[3, 1] = np.nan
    size = 0.3 * np.sqrt(np.nanmean(y**2, axis=0))
    noisier = replace(model, r=model.r + size**2 * model.h)
    found, plain = (
        filter_bank(own, mean, P, u, y, replace(no_nuisances(own), discrepancy=share))
        for own, share in ((model, 0.3), (noisier, 0.0))
    )
    np.testing.assert_allclose(found.weight, plain.weight, rtol=1e-9)
    for name in ("mean", "innovation"):
        own, other = getattr(found.run, name), getattr(plain.run, name)
        np.testing.assert_allclose(own, other, rtol=1e-9, atol=1e-12 * np.nanmax(np.abs(other)))
    assert np.nansum(found.run.whitened**2) > 1.2 * np.nansum(plain.run.whitened**2)
    # a load that is unknown has to follow its samples
    assert not discrepancy(chain(), replace(no_nuisances(chain()), discrepancy=0.3), y[:, :2]).any()


LOADS = {
    "gain of a known load": ("known", [0.0, 0.03]),
    "direction of a known load": ("known", [0.05, 0.0]),
    "direction of an unknown load": ("unknown", [0.0, 0.15]),
}
"""Load, and what one σ adds to its shape: the known one acts on the second mass, the unknown one on the first."""


def acting_otherwise(model, load, column):
    """One ν, of a load whose shape it changes by a column."""
    d = np.zeros((1, 2, model.parameter_states.start)), np.zeros((1, 2, 1)), np.zeros((1, 2))
    shape = np.zeros((1, 2, 2))
    shape[0, :, model.model.inputs.index(load)] = column
    return Nuisances(("load",), *d, shape=shape)


SLOW = {"gain of a known load"}


@pytest.mark.slow
@pytest.mark.parametrize("what", [pytest.param(own, marks=pytest.mark.slow) if own in SLOW else own for own in LOADS])
def test_sigma_holds_where_a_load_acts_otherwise(what):
    """Over draws of chains whose load acts otherwise by a constant: σ of the parameters, and of an unknown load by all samples,
    holds it integrated out, and does not hold without."""
    load, column = LOADS[what]
    model, P, n = (chain(noise=5e-4), start(), 5) if load == "unknown" else (driven_chain(noise=5e-5), driven_start(), 4)
    nuisances, draws = acting_otherwise(model, load, column), 60
    rng, mean = np.random.default_rng(4), np.zeros(model.size)
    with_it, without, of_load = [], [], []
    for b in range(draws):
        inner = replace(model.model, input_shape=model.model.input_shape + rng.standard_normal() * nuisances.shape[0])
        truth, y = draw_truth(replace(model, model=inner), mean, P, forces(), [b])
        truth, y = truth[:, 0], y[:, 0]
        bank = filter_bank(model, mean, P, forces(), y, nuisances)
        exact = filter_bank(model, mean, P, forces(), y)
        for run, found in ((bank.run, with_it), (exact.run, without)):
            found.append((run.mean[-1, 0, n:] - truth[-1, n:]) / run.std[-1, 0, n:])
        if load == "unknown":
            own = smooth_bank(model, mean, P, forces(), y, nuisances, bank)
            of_load.append(np.sqrt(np.mean(((own.mean[:, 0, 4] - truth[:, 4]) / own.std[:, 0, 4]) ** 2)))
    ratio = np.sqrt(np.mean(np.square(with_it), axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=3 / np.sqrt(2 * draws))
    assert np.sqrt(np.mean(np.square(without), axis=0)).max() > 1.5
    if of_load:
        assert np.sqrt(np.mean(np.square(of_load))) == pytest.approx(1.0, abs=3 / np.sqrt(2 * draws))


@pytest.mark.parametrize(
    ("column", "parameters"), [([0.0, 0.1], ()), ([0.2, 0.0], ("k1", "k2"))], ids=["gain", "direction"]
)
def test_a_constant_force_that_acts_otherwise_is_an_unknown_load(column, parameters):
    """ν ΔS F of a force F that does not change is a load of shape ΔS, unknown and constant, with σ = F: the same posterior,
    evidence, innovations and smoothed motion."""
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
    nuisances = replace(acting_otherwise(one, "known", column), learned=True)
    P = driven_start()[:states, :states]
    wider = np.diag(np.insert(np.diag(P), 4, 25.0))
    _, y = draw_truth(other, np.zeros(states + 1), wider, force, [3])
    options, there = {"spacing": 0.8, "depth": 14.0}, np.delete(np.arange(states + 1), 4)
    found = filter_bank(one, np.zeros(states), P, force, y[:, 0], nuisances, **options)
    expected = filter_bank(other, np.zeros(states + 1), wider, force, y[:, 0], **options)
    std = expected.run.std[1:, 0, there]
    np.testing.assert_allclose(found.run.mean[1:, 0] / std, expected.run.mean[1:, 0, there] / std, atol=1e-4)
    np.testing.assert_allclose(found.run.std[1:, 0] / std, 1.0, atol=1e-4)
    np.testing.assert_allclose(found.run.whitened, expected.run.whitened, atol=1e-4)
    assert found.run.log_likelihood[0] == pytest.approx(expected.run.log_likelihood[0], abs=1e-3)
    assert 5.0 * found.nuisances[0][0] == pytest.approx(expected.run.mean[-1, 0, 4], abs=1e-3)
    smoothed = smooth_bank(one, np.zeros(states), P, force, y[:, 0], nuisances, found)
    by_states = smooth_bank(other, np.zeros(states + 1), wider, force, y[:, 0], no_nuisances(other), expected)
    std = by_states.std[1:, 0, there]
    # the smoothers take different points of the parameters: equal to second order in their σ
    off = (0.03, 0.01) if parameters else (1e-6, 1e-6)
    np.testing.assert_allclose(smoothed.mean[1:, 0] / std, by_states.mean[1:, 0, there] / std, atol=off[0])
    np.testing.assert_allclose(smoothed.std[1:, 0] / std, 1.0, atol=off[1])

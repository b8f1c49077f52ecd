"""A bank that begins in the periodic motion is one that has waited for it, from rest and without a sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from strainsight.estimation.bank import filter_bank
from strainsight.estimation.bank_claim import bank_claim
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.conditional import Nuisances
from strainsight.estimation.settled import Settled, start_errors
from strainsight.rom.model import Damping

from ..shared import slowly
from .chain import RATIO, REFERENCE, ROWS, H, continuous, driven_chain

STEPS, LEAD = 40, 400
NOISE, GAIN = 2e-4, 0.02
EXACT = {"spacing": 0.5, "depth": 24.0}
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


def model_of(parameters):
    model = driven_chain(NOISE, parameters)
    return replace(model, model=replace(model.model, damping=Damping(ratio=ZETA)), Q=0 * model.Q)


def constants(model):
    """Gains of both gauges, damping mode by mode, stiffness."""
    D = np.zeros((2, 2, 4))
    D[[0, 1], [0, 1], :2] = GAIN * ROWS
    return Nuisances(("gain", "gain"), D, np.zeros((2, 2, 1)), np.zeros((2, 2)), damping=0.3, stiffness=0.01)


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


def prior(model, motion):
    return np.diag([motion**2] * 4 + [0.1**2] * (model.size - 4))


def test_the_start_and_its_slopes_are_those_of_a_long_run():
    model, size = model_of(("k1", "k2")), 1e-4
    assert np.exp(-DECAY * LEAD * H) < 1e-10

    def start(logs=(0.0, 0.0), factors=(1.0, 1.0), stiffer=1.0):
        values = zip(REFERENCE.items(), logs, strict=True)
        return long_run({name: stiffer * value * np.exp(own) for (name, value), own in values}, factors)[0]

    def slope(of):
        return (of(size) - of(-size)) / (2 * size)

    P, V = start_errors(model, constants(model), prior(model, 1.0), SETTLED)
    expected = [slope(lambda s, own=own: start(factors=np.exp(0.3 * s * own))) for own in np.eye(2)]
    expected += [slope(lambda s: start(stiffer=1 + 0.01 * s)), np.zeros(4), np.zeros(4)]
    expected += [slope(lambda s, own=own: start(logs=s * own)) for own in np.eye(2)]
    scale = np.abs(start()).max()
    np.testing.assert_allclose(V / scale, -np.array(expected) / scale, atol=1e-6)
    np.testing.assert_allclose(np.diag(P), [*SETTLED.std**2, 0.01, 0.01])


@pytest.mark.parametrize("learned", [*slowly(False), True])
def test_filter_and_smoother_are_those_that_waited_from_rest(learned):
    model = model_of(("k1",))
    nuisances = replace(constants(model), learned=learned)
    rng = np.random.default_rng(4)
    x = long_run({"k1": 1.07 * REFERENCE["k1"], "k2": REFERENCE["k2"]}, (1.2, 0.9))
    y = (x[1:, :2] @ ROWS.T) * [1.01, 0.98] + NOISE * rng.standard_normal((STEPS, 2))
    waited = np.concatenate([np.full((LEAD, 2), np.nan), y])
    still, moving, zero = prior(model, 1e-9), prior(model, 1.0), np.zeros(5)
    known, longer = force(np.arange(STEPS)), force(np.arange(-LEAD, STEPS))
    found = filter_bank(model, zero, moving, known, y, nuisances, settled=SETTLED, **EXACT)
    expected = filter_bank(model, zero, still, longer, waited, nuisances, **EXACT)
    for one, other in zip(found.posterior, expected.posterior, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6)
    smoothed = smooth_bank(model, zero, moving, known, y, nuisances, found, settled=SETTLED)
    by_waiting = smooth_bank(model, zero, still, longer, waited, nuisances, expected)
    # a smoother takes its slopes along one motion, the mean over the parameters, which begins a little otherwise
    for own, other, alike in ((found.run, expected.run, 1e-6), (smoothed, by_waiting, 5e-3)):
        scale = np.abs(own.mean).max(axis=0)
        np.testing.assert_allclose(own.mean[1:] / scale, other.mean[LEAD + 1 :] / scale, atol=max(0.02 * alike, 1e-6))
        np.testing.assert_allclose(own.std[1:], other.std[LEAD + 1 :], rtol=alike)
    # at t = 0 the sum over the lattice is right to its spacing
    np.testing.assert_allclose(found.run.std[0], expected.run.std[LEAD], rtol=1e-3)


def test_what_is_expected_is_what_the_bank_claims_on_exact_readings():
    model = model_of(("k1",))
    whole, known = constants(model), force(np.arange(STEPS))
    # so small that the posterior is normal
    nuisances = replace(whole, D=0.1 * whole.D, damping=0.03, stiffness=1e-3)
    x = long_run(REFERENCE)
    both = np.concatenate([known, 0 * known], axis=2)
    claim = bank_claim(model, x, both, prior(model, 1.0), nuisances, SETTLED)
    bank = filter_bank(model, np.zeros(5), prior(model, 1.0), known, x[1:, :2] @ ROWS.T, nuisances, settled=SETTLED)
    np.testing.assert_allclose(claim.std[-1, 0], bank.run.std[-1, 0], rtol=0.02)
    unknown = bank_claim(model, x, both, prior(model, 1.0), nuisances)
    assert claim.std[5, 0, 4] < 0.9 * unknown.std[5, 0, 4]

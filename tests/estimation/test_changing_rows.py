"""Rows that depend on an estimated parameter, as those on the face of a shell of unknown thickness do on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.bank import filter_bank
from strainsight.estimation.bank_smoother import smooth_bank
from strainsight.estimation.conditional import no_nuisances
from strainsight.estimation.filter import run_filter
from strainsight.estimation.motion import measure, surface_reading
from strainsight.estimation.reduced import Driven
from strainsight.estimation.sigma_point import run_sigma_points
from strainsight.fem.affine import NO_CHANGE, AffineOperator, Coefficient, Newton
from strainsight.gauges.candidates import ACCELERATION, STRAIN

from .chain import REFERENCE, ROWS, H, driven_chain, forces

MORE = np.array([[2.4, 0.4], [-3.6, 2.0]])
"""What twice the stiffness k1 adds to the rows, and a quarter of it the square of that change."""


def of_k1(rows):
    """ΔX(k1) = X (s + s²/4), s = k1/k1₀ − 1."""
    base = Newton("k1", (REFERENCE["k1"], REFERENCE["k1"]), REFERENCE["k1"])
    return AffineOperator(0.0, {"k1 (1)": rows}, {"k1 (1)": Coefficient((base,), np.array([0.0, 1.0, 0.25]))})


def rows_at(k1):
    s = k1 / REFERENCE["k1"] - 1
    return ROWS + (s + 0.25 * s**2) * MORE


def unknown(noise=2e-3):
    """The chain under its known force, k1 unknown, with rows that change with it."""
    return replace(driven_chain(noise, ("k1",)), change=of_k1(MORE))


@pytest.mark.parametrize("sets", [1, 3])
def test_reading_and_jacobian_are_those_of_the_rows_at_the_parameter(sets):
    """Of strain, and of an accelerometer whose direction changes; of every run by its own rows where it has some."""
    model = driven_chain(parameters=("k1", "k2"))
    phi, more = np.vstack([ROWS, [0.3, 1.0]]), np.vstack([MORE, [0.4, -0.2]])
    wide = np.hstack([phi, np.zeros((3, 4))])
    if sets > 1:
        factor = np.arange(1, sets + 1)[:, None, None]
        wide, more = factor * wide, factor * more
    quantity = np.array([STRAIN, STRAIN, ACCELERATION])
    model = replace(model, H=wide, change=of_k1(more), quantity=quantity, r=np.ones(3))
    x, known = np.random.default_rng(0).standard_normal((3, 6)) * [1, 1, 1, 1, 0.2, 0.2], np.array([0.7])
    y, J = measure(model, x, known)
    for b in range(3):
        s, own = np.expm1(x[b, 4]), b if sets > 1 else 0
        rows = (np.reshape(wide, (-1, 3, 6))[own, :, :2]) + (s + 0.25 * s**2) * np.reshape(more, (-1, 3, 2))[own]
        np.testing.assert_allclose(y[b, :2], (rows @ x[b, :2])[:2], rtol=1e-12)
    step = 1e-5
    for i in range(6):
        e = step * np.eye(6)[i]
        slope = (measure(model, x + e, known)[0] - measure(model, x - e, known)[0]) / (2 * step)
        np.testing.assert_allclose(np.broadcast_to(J, (3, 3, 6))[..., i], slope, atol=1e-6 * np.abs(slope).max())


def test_elsewhere_on_the_surface_is_read_as_a_channel_there_would():
    model = unknown()
    x = np.random.default_rng(1).standard_normal((4, 5)) * 0.1
    y, J = measure(model, x, np.zeros(1))
    found, slope = surface_reading(model, ROWS, of_k1(MORE), x)
    np.testing.assert_allclose(found, y)
    np.testing.assert_allclose(slope, J)


PRIOR, START = 0.1, np.diag([1e-8, 1e-8, 1e-6, 1e-6, 0.1**2])


def known_at(model, p):
    """The model that knows k1 = guess exp(p), with rows of that value."""
    k1 = REFERENCE["k1"] * np.exp(p)
    H_at = np.hstack([rows_at(k1), np.zeros((2, 2))])
    unknowns = replace(model.unknowns, parameters=())
    return replace(model, unknowns=unknowns, fixed={**REFERENCE, "k1": k1}, H=H_at, change=NO_CHANGE, Q=model.Q[:4, :4])


def samples(model, p, seed):
    """(T, 2) at k1 = guess exp(p), without process noise."""
    driven, x, y = Driven(known_at(model, p), forces()), np.zeros((1, 4)), []
    for k in range(len(forces())):
        x = driven.step(x, k)[0]
        y.append(driven.measure(x, k)[0][0])
    noise = np.random.default_rng(seed).standard_normal((len(y), 2)) * np.sqrt(model.r / H)
    return np.array(y) + noise


def by_brute_force(model, y):
    """Mean and σ of p: Kalman filters with rows of their own at every p of a grid, weighed by likelihood and prior."""
    grid = np.linspace(0.0, 0.25, 101)
    score = []
    for p in grid:
        own = known_at(model, p)
        score.append(
            run_filter(own, np.zeros(4), START[:4, :4], forces(), y).log_likelihood[0] - 0.5 * (p / PRIOR) ** 2
        )
    w = np.exp(np.array(score) - np.max(score))
    w /= w.sum()
    mean = w @ grid
    return mean, np.sqrt(w @ (grid - mean) ** 2)


def test_bank_is_bayes_by_brute_force_and_the_other_filters_are_near():
    """The rows alone say more of k1 here than the motion: without their change the estimate is 3σ off."""
    model = unknown()
    y = samples(model, 0.12, 7)
    mean, std = by_brute_force(model, y)
    assert abs(mean - 0.12) < 3 * std
    bank = filter_bank(model, np.zeros(5), START, forces(), y, no_nuisances(model))
    assert bank.run.mean[-1, 0, 4] == pytest.approx(mean, abs=0.01 * std)
    assert bank.run.std[-1, 0, 4] == pytest.approx(std, rel=0.01)
    later = smooth_bank(model, np.zeros(5), START, forces(), y, no_nuisances(model), bank)
    assert later.mean[0, 0, 4] == pytest.approx(mean, abs=0.01 * std)
    for run in (run_filter, run_sigma_points):
        other = run(model, np.zeros(5), START, forces(), y)
        assert other.mean[-1, 0, 4] == pytest.approx(mean, abs=0.3 * std)
        assert other.std[-1, 0, 4] == pytest.approx(std, rel=0.1)
    blind = filter_bank(replace(model, change=NO_CHANGE), np.zeros(5), START, forces(), y, no_nuisances(model))
    assert abs(blind.run.mean[-1, 0, 4] - mean) > 2 * std

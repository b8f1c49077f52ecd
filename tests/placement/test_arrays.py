"""Placements from plain arrays against all layouts, each by SciPy's Riccati equation."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are

from strainsight.errors import ConfigError, InfeasibleError
from strainsight.placement.arrays import place_arrays, place_modes


def system(states=4, candidates=8):
    rng = np.random.default_rng(0)
    F = rng.normal(size=(states, states)) - 2 * np.eye(states)
    return F, rng.normal(size=(candidates, states)), np.eye(states), rng.uniform(0.5, 2, candidates)


def variances(F, H, Q, R, gauges):
    """In units of the noise: with others SciPy's pencil is singular on some processors."""
    rows = (H / np.sqrt(R)[:, None])[list(gauges)]
    return np.diag(solve_continuous_are(F.T, rows.T, Q, np.eye(len(rows))))


@pytest.mark.parametrize("states", [None, [1, 3]])
def test_the_layout_is_the_best_of_all(states):
    F, H, Q, R = system()
    placed = place_arrays(F, H, Q, R, keep=3, states=states)
    at = slice(None) if states is None else states
    whole = variances(F, H, Q, R, range(8))[at]
    costs = {g: float(np.sum(variances(F, H, Q, R, g)[at] / whole)) for g in combinations(range(8), 3)}
    assert tuple(sorted(placed.gauges.tolist())) == min(costs, key=costs.get)
    assert placed.cost == pytest.approx(min(costs.values()), rel=1e-9)
    assert placed.lower_bound <= placed.cost
    assert 0 <= placed.gap < 0.01
    np.testing.assert_allclose(placed.std, np.sqrt(variances(F, H, Q, R, placed.gauges)[at]), rtol=1e-9)
    np.testing.assert_allclose(placed.std_of_pool, np.sqrt(whole), rtol=1e-9)
    for i, without in enumerate(placed.without):
        rest = np.delete(placed.gauges, i)
        np.testing.assert_allclose(without, np.sqrt(variances(F, H, Q, R, rest)[at]), rtol=1e-9)
    missed = [np.sum((row**2) / whole) for row in placed.without]
    assert missed == sorted(missed, reverse=True)


def test_units_of_the_states_change_no_layout():
    F, H, Q, R = system()
    d = np.array([1e-3, 1.0, 40.0, 1e5])
    first = place_arrays(F, H, Q, R, keep=3)
    other = place_arrays(F / d[:, None] * d, H * d, Q / np.outer(d, d), np.diag(R), keep=3)
    np.testing.assert_array_equal(first.gauges, other.gauges)
    np.testing.assert_allclose(other.std * d, first.std, rtol=1e-9)
    np.testing.assert_allclose(other.P * np.outer(d, d), first.P, rtol=1e-8, atol=1e-12)


def test_limits_of_a_layout_are_kept():
    F, H, Q, R = system()
    free = place_arrays(F, H, Q, R, keep=3)
    pair, left_out = free.gauges[:2], np.setdiff1d(np.arange(8), free.gauges)[0]
    placed = place_arrays(F, H, Q, R, keep=3, fixed=[left_out], conflicts=pair[None])
    assert left_out in placed.gauges
    assert not set(pair.tolist()) <= set(placed.gauges.tolist())
    assert placed.cost > free.cost


def beam(modes=3):
    """A simply supported beam of 1 m, EI/ρA = 50 m⁴/s², 1 kg/m, with gauges on its surface, 5 mm from the axis."""
    x, k = np.linspace(0, 1, 41), np.pi * np.arange(1, modes + 1)
    shapes = np.sqrt(2) * np.sin(np.outer(x, k))
    curvature = np.zeros((9, len(x)))
    for row, node in zip(curvature, range(4, 40, 4), strict=True):
        row[node - 1 : node + 2] = -5e-3 * np.array([1, -2, 1]) / (x[1] - x[0]) ** 2
    return x, shapes, np.sqrt(50) * k**2 / (2 * np.pi), curvature


def test_modes_and_a_strain_operator_give_the_best_pair():
    x, shapes, frequencies, S = beam()
    loads = np.zeros((len(x), 2))
    loads[10, 0] = loads[28, 1] = 1.0
    stated = {"amplitude": 20.0, "load_frequency": 2.0, "noise": 2e-6, "rate": 400.0}
    placed = place_modes(shapes, frequencies, 0.02, S, keep=2, loads=loads, names=("left", "right"), **stated)
    omega, n, Z = 2 * np.pi * frequencies, 3, np.zeros
    F = np.block(
        [
            [Z((n, n)), np.eye(n), Z((n, 2))],
            [-np.diag(omega**2), -0.04 * np.diag(omega), 20.0 * shapes.T @ loads],
            [Z((2, 8))],
        ]
    )
    Q = np.diag([0.0] * 6 + [2.0] * 2)  # κω of f = 2 Hz, with κ = 1/2π
    H, R = np.hstack([S @ shapes, Z((9, 5))]), np.full(9, (2e-6) ** 2 / 400)

    def sigma(gauges):
        unit = np.diag([*(1 / omega), 1, 1, 1, 1, 1])  # displacements in units of velocities: SciPy needs that
        F_, Q_ = np.linalg.solve(unit, F @ unit), np.linalg.solve(unit, np.linalg.solve(unit, Q).T)
        return np.sqrt(variances(F_, H @ unit, Q_, R, gauges)[6:])

    whole = sigma(range(9))
    best = min(combinations(range(9), 2), key=lambda g: np.sum((sigma(g) / whole) ** 2))
    assert tuple(sorted(placed.gauges.tolist())) == best
    assert placed.names == ("left", "right")
    np.testing.assert_allclose(placed.std, sigma(placed.gauges), rtol=1e-5)


def test_default_loads_are_modal_forces():
    _, shapes, frequencies, S = beam()
    placed = place_modes(shapes, frequencies, 0.02, S, keep=3)
    undamped = place_modes(shapes, frequencies, 0.0, S, keep=3)
    np.testing.assert_allclose(undamped.std, placed.std, rtol=0.1)
    assert placed.names == ("modal force 1", "modal force 2", "modal force 3")
    assert np.all(placed.std < 1)
    assert np.all(placed.std_of_pool <= placed.std)
    louder = place_modes(shapes, frequencies, 0.02, S, keep=3, noise=1e-5)
    np.testing.assert_allclose(louder.std, placed.std, rtol=1e-6)  # the default amplitude is a multiple of the noise


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"F": np.eye(3)}, "inconsistent shapes"),
        ({"R": np.ones((8, 8))}, "off the diagonal"),
        ({"R": np.ones(7)}, "inconsistent shapes"),
        ({"states": [0, 0]}, "states"),
        ({"names": ["a"]}, "4 states have 1 names"),
        ({"criterion": "best"}, "criterion 'best'"),
        ({"keep": 9}, "cannot keep 9 of the"),
        ({"fixed": [8]}, "fixed contains row 8"),
        ({"conflicts": [[0, -1]]}, "conflicts contains row -1"),
        ({"conflicts": [0, 1, 2]}, "conflicts"),
    ],
)
def test_inconsistent_arrays_are_refused(change, words):
    F, H, Q, R = system()
    with pytest.raises(ConfigError, match=words):
        place_arrays(**({"F": F, "H": H, "Q": Q, "R": R, "keep": 3} | change))


@pytest.mark.parametrize(
    "change",
    [
        {"noise": [1e-6, 1e-6]},
        {"noise": 0.0},
        {"amplitude": [1.0, 1.0]},
        {"load_frequency": -1.0},
        {"damping": [0.02, 0.02]},
        {"damping": -0.02},
        {"rate": 0.0},
        {"names": ("a", "a", "b")},
    ],
)
def test_numbers_that_are_too_few_or_not_positive_are_refused(change):
    _, shapes, frequencies, S = beam()
    settings = {"damping": 0.02, "strain_operator": S, "keep": 3} | change
    with pytest.raises(ConfigError, match=next(iter(change))):
        place_modes(shapes, frequencies, **settings)


def test_modes_that_cannot_be_used_are_refused():
    _, shapes, frequencies, S = beam()
    with pytest.raises(ConfigError, match="rigid modes"):
        place_modes(shapes, frequencies * [0, 1, 1], 0.02, S, keep=3)
    with pytest.raises(ConfigError, match="inconsistent shapes"):
        place_modes(shapes.T, frequencies, 0.02, S, keep=3)
    with pytest.raises(InfeasibleError, match="2 gauges cannot observe 3 unknowns"):
        place_modes(shapes, frequencies, 0.02, S, keep=2)
    with pytest.raises(InfeasibleError, match="no candidate responds to load 1"):
        place_modes(shapes, frequencies, 0.02, S, keep=1, loads=np.zeros((41, 1)))

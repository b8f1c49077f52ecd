"""The whole model in time against exponentials and closed forms, its Padé approximations, and its periodic motion."""

from __future__ import annotations

from dataclasses import replace
from math import factorial

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh

from strainsight.errors import NumericalError, UserError
from strainsight.fem import complex_factor
from strainsight.fem.steady import steady_state
from strainsight.fem.transient import DEGREES, choose, pade, transient
from strainsight.fem.viscous import ViscousDamping, modal_damping
from strainsight.signals.histories import Constant, MultiSine, Sine, hold_coefficients, tones_of

from ..shared import slowly
from .transients import NONE, chain, dense_damping, exact, model_of, random_load


@pytest.mark.parametrize(
    ("rate", "zeta"), [(rate, zeta) for rate in (0.05, 0.5, 2.0) for zeta in (0.0, 0.02, 0.5)] + [(0.5, 1.5)]
)
def test_one_mass_under_a_held_load_is_its_exponential(rate, zeta):
    h, T = 1e-3, 70
    omega = rate / h
    model = model_of([[3.0 * omega**2]], [[3.0]])
    damping = ViscousDamping(alpha=2 * zeta * omega)
    held = random_load(T, 1)
    found = transient(
        model, np.array([[2.0]]), {}, damping, held, h, np.eye(1), np.eye(1), highest=5.6 / (2 * np.pi * h)
    )
    true = exact(*(np.array([[value]]) for value in (3.0 * omega**2, 3.0, 3.0 * 2 * zeta * omega, 2.0)), held, h)
    assert (found.order, found.substeps) == (11, 1)
    within = 1e-9 if rate < 1 else 3e-7
    for got, expected in ((found.reading[:, 0], true[:, 0, 0]), (found.acceleration[:, 0], true[:, 2, 0])):
        np.testing.assert_allclose(got, expected, atol=within * np.abs(expected).max())


@pytest.mark.parametrize("J", [1, 2, 3])
def test_several_masses_loads_and_rows_over_several_blocks(J):
    K, M = chain(6)
    S = np.random.default_rng(1).standard_normal((6, 2))
    damping = replace(modal_damping(sparse.csr_array(K), sparse.csr_array(M), 0.03, 3), alpha=2.0)
    # the shapes are eigenvectors whatever the mass-proportional part
    held, h = random_load(70, 2, J), 2e-3
    rows = np.random.default_rng(2).standard_normal((4, 6))
    found = transient(
        model_of(K, M), S, {}, damping, held, h, rows, sparse.csr_array(rows[:2]), highest=600.0
    )
    true = exact(K, M, dense_damping(K, M, damping), S, held, h)
    np.testing.assert_allclose(found.reading, true[:, 0] @ rows.T, atol=1e-10 * np.abs(true[:, 0]).max())
    np.testing.assert_allclose(found.acceleration, true[:, 2] @ rows[:2].T, atol=1e-9 * np.abs(true[:, 2]).max())
    np.testing.assert_allclose(found.end, true[-1, :2], rtol=0, atol=1e-10 * np.abs(true[-1, :2]).max())


def test_a_motion_that_follows_its_load_is_exact_however_fast_the_mode():
    """Quadratic load, quadratic motion: z = u/k − m ü/k², for modes from far below to far above the step."""
    h, T = 1e-3, 40
    omega = np.array([10.0, 1e3, 1e5, 1e7])
    t = h * np.arange(T)
    held = np.stack([1 + 50 * t + 4e3 * t**2, h * (50 + 8e3 * t), np.full(T, 4e3 * h * h)], axis=1)[:, :, None]
    k = omega**2
    now = lambda time: (1 + 50 * time + 4e3 * time**2)[..., None] / k - 8e3 / k**2  # noqa: E731
    found = transient(
        model_of(np.diag(k), np.eye(4)),
        np.ones((4, 1)),
        {},
        NONE,
        held,
        h,
        np.eye(4),
        start=(now(np.zeros(())), 50 / k),
        highest=50.0,
    )
    expected = now(h * np.arange(T + 1))
    np.testing.assert_allclose(found.reading[:, 1:], expected[:, 1:], rtol=1e-11)
    np.testing.assert_allclose(found.reading[:, 0], expected[:, 0], rtol=1e-6)


# ---- damping


def test_damping_by_modes_is_the_stated_ratio_in_each_and_grows_above():
    K, M = chain(8)
    lam, Phi = eigh(K, M)
    omega = np.sqrt(lam)
    for above, expected in (
        ("stiffness", 0.02 * np.maximum(1.0, omega / omega[3])),
        ("none", np.where(np.arange(8) < 4, 0.02, 0.0)),
    ):
        C = dense_damping(K, M, modal_damping(sparse.csr_array(K), sparse.csr_array(M), 0.02, 4, above))
        np.testing.assert_allclose(Phi.T @ C @ Phi, np.diag(2 * expected * omega), atol=1e-10 * omega[-1])


# ---- meshes


def test_unknowns_without_mass_move_but_have_no_acceleration():
    K = np.array([[3e4, -1e4, 0], [-1e4, 2e4, -1e4], [0, -1e4, 1e4]])
    M = np.diag([1.0, 0.0, 1.0])
    held, h = hold_coefficients([Sine(5.0, 10.0)], 0.0, 1e-3, 50), 1e-3
    S = np.eye(3)[:, 2:]
    found = transient(model_of(K, M), S, {}, NONE, held, h, np.eye(3), highest=100.0)
    np.testing.assert_allclose(
        found.reading[:, 1], found.reading[:, [0, 2]].mean(axis=1), atol=1e-9 * np.abs(found.reading).max()
    )
    small = exact(
        K[[0, 2]][:, [0, 2]] - np.outer(K[[0, 2], 1], K[1, [0, 2]]) / K[1, 1],
        np.eye(2),
        np.zeros((2, 2)),
        S[[0, 2]],
        held,
        h,
    )
    np.testing.assert_allclose(found.reading[:, [0, 2]], small[:, 0], atol=1e-6 * np.abs(small[:, 0]).max())
    with pytest.raises(UserError, match="no mass"):
        transient(model_of(K, M), S, {}, NONE, held, h, np.eye(3), np.eye(3))


def test_without_pardiso_superlu_gives_the_same(monkeypatch):
    K, M = chain(6)
    held = random_load(20, 1)
    given = (model_of(K, M), np.eye(6)[:, :1], {}, ViscousDamping(1.0, 1e-5), held, 1e-3, np.eye(6))
    once = transient(*given).reading

    def missing(upper):
        raise ImportError

    monkeypatch.setattr(complex_factor, "_pardiso", missing)
    np.testing.assert_allclose(transient(*given).reading, once, rtol=1e-11, atol=1e-13 * np.abs(once).max())


def test_progress_and_a_motion_that_overflows():
    K, M = chain(2)
    shares = []
    transient(model_of(K, M), np.eye(2)[:, :1], {}, NONE, np.zeros((70, 1, 1)), 1e-3, np.eye(2), progress=shares.append)
    assert shares == [0.0, 32 / 70, 64 / 70]
    with pytest.raises(NumericalError, match="finite"):
        transient(model_of(K, M), np.eye(2)[:, :1], {}, NONE, np.full((3, 1, 1), np.nan), 1e-3, np.eye(2), highest=1.0)


@pytest.mark.parametrize("degree", DEGREES)
def test_the_approximation_has_its_order_and_its_damping(degree):
    """R has the Taylor coefficients of eᶻ up to z^(2s−1) and no further, |R(iy)| ≤ 1 everywhere, and |R∞| < 1."""
    scheme = pade(degree)
    turn = np.arange(64)
    coefficient = np.fft.fft(scheme.at(np.exp(2j * np.pi * turn / 64)))[: 2 * degree + 1].real / 64
    error = np.abs(coefficient - [1 / factorial(k) for k in range(2 * degree + 1)])
    assert error[:-1].max() < 3e-14 < error[-1]
    y = np.geomspace(1e-2, 1e6, 2000)
    assert np.all(np.abs(scheme.at(1j * y)) <= 1 + 1e-13)
    assert abs(scheme.at(1e12j)) == pytest.approx(abs(scheme.infinity), rel=1e-6)
    assert abs(scheme.infinity) < 0.91
    assert np.all(scheme.pole.real > 0)


@pytest.mark.parametrize("y", [0.01, 0.3, 0.5, 0.9, 2.7, 3.0, 5.6, 7.0, 20.0])
def test_what_is_resolved_keeps_its_period_and_its_amplitude(y):
    scheme, substeps = choose(y)
    R = scheme.at(1j * y / substeps) ** substeps
    turned = np.angle(R * np.exp(-1j * y))
    assert abs(turned) <= 1.01e-4 * y
    assert abs(np.log(abs(R))) <= 1e-4 * y


def test_fewest_solves_and_never_more_factors_for_nothing():
    cost = {y: choose(y)[0].degree * choose(y)[1] // 2 for y in (0.1, 0.5, 1.0, 2.0, 4.0, 8.0)}
    assert cost == {0.1: 1, 0.5: 1, 1.0: 2, 2.0: 2, 4.0: 3, 8.0: 6}


# ---- one and few unknowns


DAMPINGS = ["modal", "undamped above", "rayleigh", "none"]


def damping_of(kind, K, M):
    K, M = sparse.csr_array(K), sparse.csr_array(M)
    return {
        "modal": modal_damping(K, M, 0.02, 4),
        "undamped above": modal_damping(K, M, 0.02, 4, above="none"),
        "rayleigh": ViscousDamping(2.0, 1e-5),
        "none": NONE,
    }[kind]


@pytest.mark.parametrize("kind", DAMPINGS)
@pytest.mark.parametrize("hertz", [0.0, 3.0, 11.0, 40.0])
def test_it_is_the_dense_complex_solution(kind, hertz):
    """Below, between and above the modes of a chain of eight, 5.4 to 69 Hz."""
    K, M = chain(8)
    damping, omega = damping_of(kind, K, M), 2 * np.pi * hertz
    S, U = np.random.default_rng(1).standard_normal((8, 2)), np.array([1.0 - 2.0j, 0.5 + 0.3j])
    dense = K - omega**2 * M + 1j * omega * dense_damping(K, M, damping)
    expected = np.linalg.solve(dense, S @ U)
    z, v = steady_state(sparse.csr_array(K), sparse.csr_array(M), S, damping, np.array([omega]), U[None])
    np.testing.assert_allclose(z, expected.real, rtol=0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(v, (1j * omega * expected).real, rtol=0, atol=1e-9 * max(1, omega) * np.abs(expected).max())


@pytest.mark.parametrize("kind", ["modal", *slowly("rayleigh")])
def test_stepped_on_it_repeats(kind):
    """Three tones and a constant over their common period of 0.5 s, to the error of the scheme; from rest it is far from it."""
    K, M = chain(8)
    damping = damping_of(kind, K, M)
    S = np.eye(8)[:, [7, 3]]
    signals = [MultiSine(4.0, 12.0, 3, 5.0, seed=2), Constant(2.0)]
    tones, T = tones_of(signals), 1000
    held = hold_coefficients(signals, 0.0, 0.5 / T, T)
    start = steady_state(sparse.csr_array(K), sparse.csr_array(M), S, damping, tones.frequency, tones.amplitude)
    found = transient(model_of(K, M), S, {}, damping, held, 0.5 / T, np.eye(8), start=start).reading
    size = np.abs(found).max()
    assert np.abs(found[-1] - found[0]).max() <= 1e-5 * size
    rest = transient(model_of(K, M), S, {}, damping, held, 0.5 / T, np.eye(8)).reading
    assert np.abs(rest[-1] - rest[0]).max() > 0.1 * size


def test_a_tone_at_an_undamped_mode_is_refused():
    """k/m = 10⁴ to the last bit."""
    K, M = sparse.csr_array(np.array([[1e4]])), sparse.csr_array(np.array([[1.0]]))
    tones = tones_of([Sine(100.0 / (2 * np.pi), 1.0)])
    with pytest.raises(NumericalError):
        steady_state(K, M, np.ones((1, 1)), NONE, np.array([100.0]), tones.amplitude)

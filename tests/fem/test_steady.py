"""The periodic motion of the whole model: against dense complex matrices, and stepped on by the scheme in time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from strainsight.errors import NumericalError
from strainsight.fem.steady import steady_state
from strainsight.fem.transient import transient
from strainsight.fem.viscous import ViscousDamping, modal_damping
from strainsight.signals.histories import Constant, MultiSine, Sine, hold_coefficients, tones_of

from .transients import NONE, chain, dense_damping, model_of

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


@pytest.mark.parametrize("kind", ["modal", "rayleigh"])
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

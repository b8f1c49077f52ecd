"""The closed form of one oscillator against high precision, over the whole range of ωh."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from strainsight.errors import NumericalError
from strainsight.rom.model import Damping
from strainsight.rom.oscillator import HOLD, oscillator_step, phi_functions


def propagator(lam: mpmath.mpf, damping: Damping, h: float) -> mpmath.matrix:
    """[z, ż, g₀, g₁, g₂] → [z, ż](h) by the matrix exponential of the oscillator with its force as states."""
    if damping.kind == "modal":
        c = 2 * mpmath.mpf(damping.ratio) * mpmath.sqrt(lam)
    else:
        c = mpmath.mpf(damping.alpha) + mpmath.mpf(damping.beta) * lam
    h = mpmath.mpf(h)
    A = mpmath.zeros(5)
    A[0, 1] = 1
    A[1, 0], A[1, 1], A[1, 2] = -lam, -c, 1
    # The force and its derivatives in s = τ/h as states: g(0) = g₀, g' = g₁/h, g'' = 2g₂/h².
    A[2, 3] = A[3, 4] = 1
    scale = mpmath.diag([1, 1, 1, 1 / h, 2 / h**2])
    return (mpmath.expm(A * h, method="taylor") * scale)[:2, :]


DAMPINGS = [
    Damping(),
    Damping("modal", ratio=0.01),
    Damping("modal", ratio=1.7),
    Damping("rayleigh", alpha=3.0, beta=1e-3),
]


@pytest.mark.parametrize("damping", DAMPINGS, ids=["none", "modal", "overdamped", "rayleigh"])
@pytest.mark.parametrize("omega", [1.0, 100.0, 1e4, 3e5])
def test_the_step_and_its_slope_agree_with_sixty_digits(damping, omega):
    h, lam = 5e-4, omega**2
    T, dT = oscillator_step(np.array([lam]), damping, h)
    with mpmath.workdps(60 if omega < 1e5 else 250):
        exact = propagator(mpmath.mpf(lam), damping, h)
        step = mpmath.mpf(lam) * mpmath.mpf(10) ** -20
        slope = (propagator(lam + step, damping, h) - propagator(lam - step, damping, h)) / (2 * step)
        exact = np.array(exact.tolist(), dtype=float).reshape(2, 2 + HOLD)
        slope = np.array(slope.tolist(), dtype=float).reshape(2, 2 + HOLD)
    # What rounding may cost: the phase ωh where it is large, the difference of two close roots where it is small.
    # λ ∂T/∂λ is held against T itself: beside it, it is of order (ωh)² where ωh is small.
    cost = max(1.0, omega * h) / min(1.0, omega * h)
    size = np.outer([1.0, omega], [1.0, 1 / omega, *([1 / lam] * HOLD)]) if omega * h > 1 else np.abs(exact)
    assert np.all(np.abs(T[..., 0] - exact) <= 2e-14 * cost * (np.abs(exact) + size))
    assert np.all(lam * np.abs(dT[..., 0] - slope) <= 1e-13 * cost * (lam * np.abs(slope) + size))


def test_nothing_overflows_at_huge_frequencies():
    for damping in DAMPINGS:
        T, dT = oscillator_step(np.array([1e16, 1e20]), damping, 1e-2)
        assert np.isfinite(T).all()
        assert np.isfinite(dT).all()
        # Displacement under a constant force tends to g/λ within twice the static value.
        assert np.all(np.abs(T[0, 2]) <= 2.000001 / np.array([1e16, 1e20]))


def test_tiny_steps_move_by_newton():
    lam, h = np.array([1e4]), 1e-7
    T, _ = oscillator_step(lam, Damping("modal", ratio=0.01), h)
    np.testing.assert_allclose(T[0, :, 0], [1.0, h, h**2 / 2, h**2 / 6, h**2 / 12], rtol=1e-6)
    np.testing.assert_allclose(T[1, 2:, 0], [h, h / 2, h / 3], rtol=1e-6)


def test_undamped_motion_keeps_its_energy_and_its_area():
    lam = np.geomspace(1e2, 1e12, 40)
    T, _ = oscillator_step(lam, Damping(), 1e-3)
    A = np.moveaxis(T[:, :2], -1, 0)
    np.testing.assert_allclose(np.linalg.det(A), 1.0, atol=1e-9)
    energy = np.stack([np.diag([w, 1.0]) for w in lam])
    scaled = np.swapaxes(A, -1, -2) @ energy @ A
    np.testing.assert_allclose(scaled[:, 0, 0] / lam, 1.0, atol=1e-9)
    np.testing.assert_allclose(scaled[:, 1, 1], 1.0, atol=1e-9)


def test_critical_damping_is_refused_with_a_remedy():
    with pytest.raises(NumericalError, match="critically damped"):
        oscillator_step(np.array([25.0]), Damping("modal", ratio=1.0), 0.1)


def test_phi_functions_against_high_precision():
    z = np.array([0.0, 1e-9, 0.3j, -0.999, 0.7 + 0.7j, 1.0, -1.0001, 5j, -40.0, 300j, -1e5 + 2e4j])
    phi = phi_functions(z, 4)
    with mpmath.workdps(40):
        for i, value in enumerate(z):
            for k in range(5):
                exact = complex(mpmath.hyp1f1(1, k + 1, mpmath.mpc(value)) / mpmath.factorial(k))
                assert abs(phi[k][i] - exact) <= 2e-14 * max(abs(exact), 1e-30) * max(1, abs(value))

"""Histories are what their formulas say, and the quadratic hold carries a sine through the exact step to 1e-8."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.rom.model import Damping
from strainsight.rom.oscillator import oscillator_step
from strainsight.signals.histories import (
    Constant,
    FromSamples,
    MultiSine,
    Sine,
    Sweep,
    evaluate,
    hold_coefficients,
    tones_of,
)


def held(coefficients: np.ndarray, s: float) -> np.ndarray:
    return coefficients[:, 0] + coefficients[:, 1] * s + coefficients[:, 2] * s * s


def test_sine_starts_at_its_phase_and_repeats():
    sine = Sine(frequency=20.0, amplitude=1e4, phase=0.3)
    t = np.linspace(0, 0.2, 41)
    np.testing.assert_allclose(evaluate(sine, t), 1e4 * np.sin(40 * np.pi * t + 0.3), rtol=0, atol=1e-9)
    np.testing.assert_allclose(evaluate(sine, t + 0.05), evaluate(sine, t), rtol=0, atol=1e-7)


def test_a_sweep_has_the_instantaneous_frequency_of_a_straight_line():
    sweep = Sweep(start=5.0, stop=50.0, duration=2.0, amplitude=3.0, phase=0.4)
    t = np.linspace(0.0, 3.0, 3_000_001)
    frequency = np.where(t < 2.0, 5.0 + 45.0 * t / 2.0, 50.0)
    # Independent of the closed form: the phase is the running integral of the frequency.
    phase = np.concatenate([[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1]) * np.diff(t))])
    np.testing.assert_allclose(evaluate(sweep, t), 3.0 * np.sin(2 * np.pi * phase + 0.4), rtol=0, atol=2e-7)


def test_a_sweep_that_goes_nowhere_is_a_sine():
    t = np.linspace(0, 3, 100)
    np.testing.assert_allclose(evaluate(Sweep(7.0, 7.0, 2.0, 1.5), t), evaluate(Sine(7.0, 1.5), t), rtol=0, atol=1e-12)


def test_a_multi_sine_has_the_power_of_a_sine_and_the_phases_of_its_seed():
    period = 10.0
    t = np.arange(100_000) * period / 100_000
    signal = MultiSine(lowest=1.0, highest=20.0, count=20, amplitude=4.0, seed=3)
    u = evaluate(signal, t)
    assert np.sqrt(np.mean(u**2)) == pytest.approx(4.0 / np.sqrt(2), rel=1e-10)
    spectrum = np.abs(np.fft.rfft(u)) / len(t) * 2
    lines = np.flatnonzero(spectrum > 1e-6)
    np.testing.assert_array_equal(lines / period, np.arange(1, 21))
    np.testing.assert_allclose(spectrum[lines], 4.0 / np.sqrt(20), rtol=1e-10)
    np.testing.assert_array_equal(u, evaluate(signal, t))
    assert not np.allclose(u, evaluate(MultiSine(1.0, 20.0, 20, 4.0, seed=4), t))


def test_recorded_values_are_joined_by_straight_lines():
    record = FromSamples(time=[0.0, 1.0, 3.0], value=[0.0, 2.0, -2.0])
    np.testing.assert_allclose(evaluate(record, [0.0, 0.5, 2.0, 3.0]), [0.0, 1.0, 0.0, -2.0], atol=1e-15)


@pytest.mark.parametrize("t", [-0.1, 3.1])
def test_a_record_is_never_extrapolated(t):
    with pytest.raises(InfeasibleError, match="covers 0 to 3 s"):
        evaluate(FromSamples([0.0, 1.0, 3.0], [0.0, 2.0, -2.0]), np.array([t]))


def test_rounding_at_the_end_of_a_record_is_no_extrapolation():
    record = FromSamples(np.arange(2001) * 5e-4, np.arange(2001.0))
    assert evaluate(record, np.array([1.0 + 1e-13]))[0] == pytest.approx(2000.0)


@pytest.mark.parametrize(
    ("time", "value", "message"),
    [
        ([0.0, 1.0], [1.0], "2 times and 1 values"),
        ([], [], "0 times"),
        ([0.0, 1.0, 1.0], [1.0, 2.0, 3.0], "does not increase from 1 s"),
        ([0.0, np.nan], [1.0, 2.0], "sample 2"),
    ],
)
def test_a_broken_record_is_refused(time, value, message):
    with pytest.raises(InfeasibleError, match=message):
        FromSamples(np.array(time), np.array(value))


def test_the_hold_meets_the_history_at_both_ends_and_in_the_middle():
    signals = [Sine(20.0, 2.0, 0.1), Sweep(1.0, 30.0, 0.1, 5.0), MultiSine(1.0, 9.0, 4, 1.0)]
    start, h, steps = 0.7, 2e-3, 40
    u = hold_coefficients(signals, start, h, steps)
    assert u.shape == (steps, 3, 3)
    for s in (0.0, 0.5, 1.0):
        t = start + (np.arange(steps) + s) * h
        expected = np.stack([evaluate(signal, t) for signal in signals], axis=-1)
        np.testing.assert_allclose(held(u, s), expected, rtol=0, atol=1e-11)


def test_the_hold_of_a_parabola_is_the_parabola_and_a_recorded_line_is_a_line():
    record = FromSamples(np.linspace(0, 1, 11), 3 - 2 * np.linspace(0, 1, 11))
    u = hold_coefficients([record], 0.0, 0.1, 10)
    np.testing.assert_allclose(u[:, 1, 0], -0.2, atol=1e-14)
    np.testing.assert_allclose(u[:, 2, 0], 0.0, atol=1e-14)


def test_no_input_gives_no_columns():
    assert hold_coefficients([], 0.0, 0.1, 5).shape == (5, 3, 0)


def test_a_sweep_needs_a_duration_and_a_multi_sine_a_line():
    with pytest.raises(InfeasibleError):
        Sweep(1.0, 2.0, 0.0, 1.0)
    with pytest.raises(InfeasibleError):
        MultiSine(1.0, 2.0, 0, 1.0)


@pytest.mark.parametrize("points", [40, 100, 400])
def test_a_held_sine_drives_an_oscillator_as_the_analytic_sine_does(points):
    """z̈ + 2ζω₀ż + ω₀²z = sin ωt from rest, 20 Hz into 43 Hz: analytic by steady state plus free decay."""
    omega, omega0, zeta = 2 * np.pi * 20.0, 2 * np.pi * 43.0, 0.01
    h, steps = 1 / (20.0 * points), 20 * points
    t = h * np.arange(steps + 1)
    steady = 1 / (omega0**2 - omega**2 + 2j * zeta * omega0 * omega)
    s = omega0 * (-zeta + 1j * np.sqrt(1 - zeta**2))
    # Free decay Re(A eˢᵗ) that cancels the steady displacement and velocity at t = 0.
    z0, v0 = -steady.imag, -(1j * omega * steady).imag
    a = z0 - 1j * (v0 - s.real * z0) / s.imag
    exact = (steady * np.exp(1j * omega * t)).imag + (a * np.exp(s * t)).real

    T, _ = oscillator_step(np.array([omega0**2]), Damping("modal", ratio=zeta), h)
    u = hold_coefficients([Sine(20.0, 1.0)], 0.0, h, steps)[:, :, 0]
    state = np.zeros(2)
    z = [0.0]
    for k in range(steps):
        state = T[:, :2, 0] @ state + T[:, 2:, 0] @ u[k]
        z.append(state[0])
    predicted = (omega * h) ** 3 * omega0 * h / 720  # 4.6e-8 at 100 points a period
    assert np.max(np.abs(np.array(z) - exact)) < 2 * predicted * np.max(np.abs(exact))


def test_a_constant_is_the_same_at_any_time():
    np.testing.assert_array_equal(evaluate(Constant(-3.5), np.array([0.0, 1e-9, 1e6])), [-3.5, -3.5, -3.5])


@pytest.mark.parametrize(
    "signal",
    [Sine(3.0, 2.0, 0.7), MultiSine(1.0, 9.0, 5, 4.0, seed=3), MultiSine(2.0, 2.0, 3, 1.0), Constant(-1.5)],
)
def test_tones_are_the_signal_at_any_time_before_and_after(signal):
    t = np.linspace(-2.0, 3.0, 101)
    tones = tones_of([signal])
    values = (np.exp(1j * t[:, None] * tones.frequency) @ tones.amplitude).real[:, 0]
    np.testing.assert_allclose(values, evaluate(signal, t), atol=1e-12)


def test_signals_share_their_tones():
    tones = tones_of([Sine(3.0, 2.0), Constant(1.0), Sine(3.0, 1.0, 0.5 * np.pi)])
    np.testing.assert_allclose(tones.frequency, [0.0, 6 * np.pi])
    np.testing.assert_allclose(tones.amplitude, [[0, 1, 0], [-2j, 0, 1]], atol=1e-15)


@pytest.mark.parametrize("other", [Sweep(1.0, 2.0, 1.0, 1.0), FromSamples(np.array([0.0, 1.0]), np.array([0.0, 1.0]))])
def test_a_signal_that_does_not_go_on_for_ever_has_no_tones(other):
    assert tones_of([Sine(3.0, 2.0), other]) is None

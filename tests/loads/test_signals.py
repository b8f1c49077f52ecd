"""Histories, motions, interpolation and spectra of signals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from strainsight.errors import InfeasibleError
from strainsight.loads.histories import (
    LONGEST,
    Constant,
    FromSamples,
    MultiSine,
    Ramp,
    Sine,
    Sweep,
    density,
    evaluate,
    fill_gaps,
    gap,
    hold_coefficients,
    interpolate,
    join_by_lines,
    motion,
    noise_density,
    share_above,
    swing,
    tones_of,
)
from strainsight.rom.modal_step import oscillator_step
from strainsight.rom.model import Damping


def held(coefficients: np.ndarray, s: float) -> np.ndarray:
    return coefficients[:, 0] + coefficients[:, 1] * s + coefficients[:, 2] * s * s


def test_a_sweep_has_the_instantaneous_frequency_of_a_straight_line():
    sweep = Sweep(start=5.0, stop=50.0, duration=2.0, amplitude=3.0, phase=0.4)
    t = np.linspace(0.0, 3.0, 300_001)
    frequency = np.where(t < 2.0, 5.0 + 45.0 * t / 2.0, 50.0)
    # Independent of the closed form: the phase is the running integral of the frequency.
    phase = np.concatenate([[0.0], np.cumsum(0.5 * (frequency[1:] + frequency[:-1]) * np.diff(t))])
    np.testing.assert_allclose(evaluate(sweep, t), 3.0 * np.sin(2 * np.pi * phase + 0.4), rtol=0, atol=2e-7)


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


def test_recorded_values_are_joined_by_straight_lines_and_never_extrapolated():
    record = FromSamples(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, -2.0]))
    # the last is rounding at the end
    np.testing.assert_allclose(
        evaluate(record, [0.0, 0.5, 2.0, 3.0, 3 + 1e-13]), [0.0, 1.0, 0.0, -2.0, -2.0], atol=1e-12
    )
    for t in (-0.1, 3.1):
        with pytest.raises(InfeasibleError, match="covers 0 to 3 s"):
            evaluate(record, np.array([t]))


def test_the_hold_meets_the_history_at_both_ends_and_in_the_middle():
    signals = [Sine(20.0, 2.0, 0.1), Sweep(1.0, 30.0, 0.1, 5.0), MultiSine(1.0, 9.0, 4, 1.0)]
    start, h, steps = 0.7, 2e-3, 40
    u = hold_coefficients(signals, start, h, steps)
    assert u.shape == (steps, 3, 3)
    for s in (0.0, 0.5, 1.0):
        t = start + (np.arange(steps) + s) * h
        expected = np.stack([evaluate(signal, t) for signal in signals], axis=-1)
        np.testing.assert_allclose(held(u, s), expected, rtol=0, atol=1e-11)


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
def test_transient_signals_have_no_tones(other):
    assert tones_of([Sine(3.0, 2.0), other]) is None


TIME = np.linspace(0.05, 2.95, 30)
SAMPLED = FromSamples(np.linspace(0, 3, 61), np.sin(np.linspace(0, 3, 61)))
MULTISINE = MultiSine(0.3, 1.0, 4, 2.0, 7)
SIGNALS = [Constant(2.0), Ramp(1.0, -2.0, 0.5, 1.3), Sine(0.7, 1.5, 0.4), Sweep(0.2, 1.0, 2.0, 1.1), MULTISINE]


@pytest.mark.parametrize("signal", [*SIGNALS, SAMPLED], ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("of", ["position", "rate"])
def test_rate_and_acceleration_are_the_derivatives_of_the_position(signal, of):
    if of == "rate" and isinstance(signal, Sweep):
        with pytest.raises(InfeasibleError, match="sweep"):
            motion(signal, of)
        return
    at, e = motion(signal, of, 0.3), 1e-3
    p, rate, second = at(TIME)
    for own, k, exact in ((p, 0, rate), (rate, 1, second)):
        difference = (8 * (at(TIME + e)[k] - at(TIME - e)[k]) - (at(TIME + 2 * e)[k] - at(TIME - 2 * e)[k])) / (12 * e)
        # the acceleration of a spline bends at every sample, that of a ramp at its ends
        np.testing.assert_allclose(
            exact, difference, atol=2e-3 if isinstance(signal, FromSamples | Ramp | Sweep) else 1e-8
        )
        assert own.shape == TIME.shape


@pytest.mark.parametrize("signal", SIGNALS, ids=lambda s: type(s).__name__)
def test_a_position_is_the_history_itself(signal):
    np.testing.assert_allclose(motion(signal, "position")(TIME)[0], evaluate(signal, TIME), atol=1e-14)


@pytest.mark.parametrize("signal", [*SIGNALS[:3], SIGNALS[4], SAMPLED], ids=lambda s: type(s).__name__)
def test_a_rate_is_the_history_and_its_position_starts_at_the_given_one(signal):
    at = motion(signal, "rate", 0.3)
    assert at(np.zeros(1))[0, 0] == pytest.approx(0.3, abs=1e-14)
    np.testing.assert_allclose(at(TIME)[1], evaluate(signal, TIME), atol=2e-4 if signal is SAMPLED else 1e-14)


def test_a_recorded_motion_is_a_smooth_curve_through_its_samples():
    p, rate, second = motion(SAMPLED, "position")(TIME)
    np.testing.assert_allclose(p, np.sin(TIME), atol=2e-6)
    np.testing.assert_allclose(rate, np.cos(TIME), atol=2e-4)
    np.testing.assert_allclose(second, -np.sin(TIME), atol=1e-2)
    with pytest.raises(InfeasibleError, match="covers 0 to 3 s"):
        motion(SAMPLED, "position")(np.array([3.5]))


def test_spline_overshoot_of_a_parabola():
    """Which it is exactly: y = t² at ±½, ±3/2 is ¼ below the samples about 0, which range over 2."""
    t = np.array([-1.5, -0.5, 0.5, 1.5])
    assert swing(FromSamples(t, t**2)) == pytest.approx((0.125, 0.0))
    assert swing(FromSamples(t, t))[0] == 0.0


def test_the_longest_time_without_a_sample_is_found():
    assert gap(FromSamples(np.array([0.0, 0.1, 0.2, 1.4, 1.5]), np.zeros(5))) == pytest.approx((12.0, 0.2, 1.4))


# Values between samples against sines in closed form.
COUNT, MARGIN = 401, 40
INDEX = np.arange(COUNT)


def sine(t, frequency):
    return np.sin(2 * np.pi * frequency * t + 0.7)


@pytest.mark.parametrize(("frequency", "error"), [(0.1, 1e-6), (0.2, 1e-4), (0.25, 5e-4), (0.3, 5e-3)])
@pytest.mark.parametrize("factor", [2, 4])
def test_spline_follows_a_sine_up_to_a_third_of_the_sampling_rate(frequency, error, factor):
    fine = np.arange(factor * (COUNT - 1) + 1) / factor
    inside = (fine > MARGIN) & (fine < COUNT - MARGIN)
    found = interpolate(sine(INDEX, frequency), factor)
    np.testing.assert_allclose(found[inside], sine(fine, frequency)[inside], atol=error)
    np.testing.assert_array_equal(found[::factor], sine(INDEX, frequency))


def test_polynomials_of_the_degree_of_the_spline_are_exact_to_the_ends():
    t = np.linspace(-1, 1, 30)
    fine = np.linspace(-1, 1, 59)
    np.testing.assert_allclose(interpolate(t**7 - t**3, 2), fine**7 - fine**3, atol=1e-10)


@pytest.mark.parametrize("spacing", [2, 5, 10])
def test_a_table_of_two_rates_has_the_band_of_the_slower_one(spacing):
    true = sine(INDEX, 0.2 / spacing)
    sparse = np.where(INDEX % spacing == 0, true, np.nan)
    inside = slice(8 * spacing, COUNT - 8 * spacing)
    np.testing.assert_allclose(fill_gaps(sparse)[inside], true[inside], atol=1e-3)


def test_a_gap_does_not_raise_the_noise_of_its_neighbours():
    noise = np.random.default_rng(0).standard_normal(COUNT)
    noise[200:210] = np.nan
    assert np.abs(fill_gaps(noise)[200:210]).max() < 5


def test_lines_and_share_of_fast_motion():
    np.testing.assert_allclose(join_by_lines(np.array([0.0, np.nan, 4.0]), 2), [0, 1, 2, 3, 4])
    both = 3.0 * sine(INDEX, 0.05) + 4.0 * sine(INDEX, 0.4)
    assert share_above(both, 0.2) == pytest.approx(0.8, abs=0.01)
    assert share_above(both + 100.0, 0.2) == pytest.approx(4 / np.sqrt(2 * 100**2 + 25), rel=0.01)
    assert share_above(np.zeros(COUNT), 0.1) == 0.0


# Spectral densities: those of scipy where all samples are there, and the mean square of what they are of.
@pytest.mark.parametrize("samples", [40, 1000, 100_000])
def test_density_agrees_with_scipy(samples):
    values = np.random.default_rng(1).standard_normal(samples) + 7.0
    f, found = density(values, 1e-3)
    length = 2 * len(f) if samples > 40 else 16
    theirs = signal.welch(values, 1e3, window="hann", nperseg=length, noverlap=length // 2, detrend="constant")
    np.testing.assert_allclose(f, theirs[0][1:], rtol=1e-12)
    np.testing.assert_allclose(found, theirs[1][1:], rtol=1e-9)
    assert length <= LONGEST


def test_density_with_missing_samples():
    rng = np.random.default_rng(3)
    values = rng.standard_normal(20_000)
    values[5_000:6_000] = np.nan
    values[17_003] = np.nan
    _, found = density(values, 0.01)
    assert np.isfinite(found).all()
    assert found.mean() == pytest.approx(noise_density(1.0, 0.01), rel=0.1)


def test_density_is_empty_without_complete_segment():
    values = np.random.default_rng(4).standard_normal(1000)
    values[::10] = np.nan
    for own in (values, np.full(50, np.nan), np.zeros(0), np.ones(5)):
        f, found = density(own, 0.1)
        assert len(f) == len(found) == 0

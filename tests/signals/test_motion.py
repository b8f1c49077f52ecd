"""Positions, rates and accelerations of histories."""

import numpy as np
import pytest

from strainsight.errors import InfeasibleError
from strainsight.signals.histories import Constant, FromSamples, MultiSine, Ramp, Sine, Sweep, evaluate
from strainsight.signals.motion import gap, motion, swing

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
        np.testing.assert_allclose(exact, difference, atol=2e-3 if isinstance(signal, FromSamples | Ramp | Sweep) else 1e-8)
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


def test_a_ramp_begins_and_ends_at_rest():
    p, rate, second = motion(Ramp(1.0, 3.0, 0.5, 2.0), "position")(np.array([0.0, 0.5, 1.5, 2.5, 9.0]))
    np.testing.assert_allclose(p, [1, 1, 2, 3, 3], atol=1e-14)
    np.testing.assert_allclose(rate, [0, 0, 1.875, 0, 0], atol=1e-14)
    np.testing.assert_allclose(second, 0.0, atol=1e-13)


def test_a_spline_leaves_the_samples_of_a_parabola_by_its_vertex():
    """Which it is exactly: y = t² at ±½, ±3/2 is ¼ below the samples about 0, which range over 2."""
    t = np.array([-1.5, -0.5, 0.5, 1.5])
    assert swing(FromSamples(t, t**2)) == pytest.approx((0.125, 0.0))
    assert swing(FromSamples(t, t))[0] == 0.0


def test_the_longest_time_without_a_sample_is_found():
    assert gap(FromSamples(np.array([0.0, 0.1, 0.2, 1.4, 1.5]), np.zeros(5))) == pytest.approx((12.0, 0.2, 1.4))

"""Readings become SI on one uniform clock."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.calibration import Bridge, ChannelSettings, calibrate
from strainsight.measurements.clock import Clock, to_step, uniform_clock
from strainsight.measurements.csv_layout import TextFormat
from strainsight.measurements.records import Recording, known_unit

from ..refusals import expect_refusal

TIME = np.arange(1000) * 1e-3


def recording(values, unit=None):
    return Recording(TIME, {"a": np.asarray(values, float)}, {"a": unit}, "test.csv", np.array([[0, 2]]))


def calibrated(values, settings, unit=None):
    return calibrate(recording(values, unit), "a", settings)


@pytest.mark.parametrize(
    ("units", "si"),
    [
        (("strain", "Strain", "in/in", "mm/mm", "MM/MM", "inch/inch", "ε", "ɛ"), 1.0),
        (
            ("um/m", "µm/m", "μm/m", "[um/m]", "ppm", "uin/in", "µin/in", "ue", "µstrain", "uStrain", "MicroStrain"),
            1e-6,
        ),
        (("µɛ", "µε", "USTRAIN"), 1e-6),
        (("mm/m", "µm/mm", "‰", "millistrain"), 1e-3),
        (("%",), 0.01),
        (("m/s²", "m/s^2", "m/s**2"), 1.0),
        (("g",), 9.80665),
        (("mm/s2", "mm"), 1e-3),
        (("um",), 1e-6),
        (("kN",), 1e3),
        (("lbf", "lb", "Pounds", "pound"), 4.4482216152605),
        (("N·m", "N m"), 1.0),
        (("psi",), 6894.757293168361),
    ],
)
def test_units_and_their_spellings(units, si):
    for unit in units:
        assert known_unit(unit).factor == pytest.approx(si, rel=1e-15)
        np.testing.assert_allclose(calibrated(np.full(1000, 3.0), ChannelSettings(unit))[0], 3 * si, rtol=1e-14)


def test_file_unit_must_match_config():
    ones = np.ones(1000)
    for same in ("ppm", "µm/m", None):
        assert calibrated(ones, ChannelSettings("um/m"), same)[0][0] == 1e-6
    with expect_refusal(UserError, "the unit of channel 'a' is um/m in the config, but mV/V in the file", remedy="override"):
        calibrated(ones, ChannelSettings("um/m"), "mV/V")
    with pytest.raises(UserError, match="but Volt in the file"):
        calibrated(ones, ChannelSettings("um/m"), "Volt")
    values, notes = calibrated(ones, ChannelSettings("um/m", override=True), "mV/V")
    assert values[0] == 1e-6
    assert notes[0] == "a: the unit is mV/V in the file, but um/m is used as set in the config"
    with pytest.raises(UserError, match=r"-9999 um/m in 1 of 1000 samples.*marks missing samples"):
        calibrated(np.r_[ones[1:], -9999.0], ChannelSettings("um/m", override=True), "mV/V")


def test_calibration_order():
    signal = 50 * np.sin(20 * TIME)
    reading = 7.0 + 3.0 * TIME + signal
    settings = ChannelSettings("um/m", offset=7.0, drift=3.0, scale=2.0, sign=-1)
    np.testing.assert_allclose(calibrated(reading, settings)[0], -2e-6 * signal, atol=1e-18)
    window = signal[(TIME >= 0.2) & (TIME <= 0.4)].mean()
    values, notes = calibrated(reading, ChannelSettings("um/m", drift=3.0, zero=(0.2, 0.4)))
    np.testing.assert_allclose(values, 1e-6 * (signal - window), atol=1e-18)
    assert any("the mean of 201 samples from 0.2 to 0.4 s" in note for note in notes)


def test_missing_samples_are_excluded_from_mean():
    reading = np.where(np.arange(1000) % 10 == 3, np.nan, 5.0)
    values, _ = calibrated(reading, ChannelSettings("um/m", zero=(0, 1)))
    np.testing.assert_array_equal(np.isnan(values), np.isnan(reading))
    assert np.nanmax(np.abs(values)) < 1e-18
    dead, notes = calibrated(np.full(1000, np.nan), ChannelSettings("um/m", zero=(0, 1)))
    assert np.isnan(dead).all()
    assert "a: the channel has no samples, so no mean over the interval `zero` was subtracted" in notes


def test_marked_samples_are_excluded_from_mean():
    values = np.full(1000, 5.0)
    values[[100, 200, 201]] = 1e31, 700.0, -900.0
    spans = ((0.1, 0.1), (0.1995, 0.2015))
    own, notes = calibrated(values, ChannelSettings("um/m", zero=(0.0, 1.0), missing=spans))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(own)), [100, 200, 201])
    np.testing.assert_allclose(own[np.isfinite(own)], 0.0, atol=1e-20)
    assert "a: samples were marked as missing (3 of 1000)" in notes
    with pytest.raises(UserError, match=r"missing samples from 2 to 3 s contains no sample; the record runs from 0 to 0\.999 s"):
        calibrated(values, ChannelSettings("um/m", missing=((2.0, 3.0),)))


def test_impossible_readings_are_refused():
    ones = np.ones(1000)
    record = r"the record runs from 0 to 0\.999 s"
    with pytest.raises(UserError, match=f"'a' has no sample in the zero interval from 2 to 3 s; {record}"):
        calibrated(ones, ChannelSettings("um/m", zero=(2, 3)))
    reading = ones.copy()
    reading[41] = 600.0
    with pytest.raises(UserError, match="has the value 600 mV/V, which a quarter bridge cannot") as caught:
        calibrated(reading, ChannelSettings("mV/V", bridge=Bridge("quarter", 2.0)))
    assert caught.value.where == "test.csv:43"
    reading[41] = -9.97e36
    with pytest.raises(UserError, match=r"has the value -9\.97e\+36 um/m") as caught:
        calibrated(reading, ChannelSettings("um/m"))
    assert caught.value.where == "test.csv:43"
    assert "a: strains up to 100 %; check the unit" in calibrated(ones, ChannelSettings("strain"))[1]


@pytest.mark.parametrize(
    ("settings", "wrong", "said"),
    [
        (ChannelSettings, {"unit": "mV/V"}, "a channel in mV/V requires a bridge and a gauge factor"),
        (ChannelSettings, {"unit": "um/m", "bridge": Bridge("quarter", 2.0)}, "a channel in um/m cannot have a quarter bridge"),
        (ChannelSettings, {"unit": "um/m", "zero": (1.0, 0.0)}, "zero interval"),
        (Bridge, {"arrangement": "half-poisson", "gauge_factor": 2.0}, "no Poisson's ratio"),
        (Bridge, {"arrangement": "half", "gauge_factor": 2.0, "poisson_ratio": 0.3}, "has no transverse gauge"),
        (TextFormat, {"delimiter": ",", "decimal": ","}, "decimal"),
    ],
)
def test_invalid_settings_are_refused(settings, wrong, said):
    with pytest.raises(UserError, match=said):
        settings(**wrong)


# One uniform clock: gaps of whole steps are filled, everything else is refused at its place.
def stamps(time):
    time = np.asarray(time, float)
    return Recording(time, {}, {}, "test.csv", np.array([[0, 2]]))


@pytest.mark.parametrize("start", [0.0, -3.0, 1.7e9])
def test_clean_clock_is_unchanged(start):
    clock = uniform_clock(stamps(start + np.arange(5000) / 1024))
    assert clock.step == pytest.approx(1 / 1024, rel=1e-9)
    assert clock.start == pytest.approx(start, abs=1e-6)
    assert (clock.count, clock.notes) == (5000, ())


def test_step_from_rounded_times():
    # 2048 Hz with six decimals: intervals of 488 and 489 µs, whose median is 0.06 % low, half a step after 850 samples.
    time = np.round(np.arange(200_000) / 2048, 6)
    clock = uniform_clock(stamps(time))
    assert clock.step == pytest.approx(1 / 2048, rel=1e-9)
    assert clock.count == 200_000
    assert abs(clock.time - time).max() < 0.6e-6


def test_integer_gaps_are_filled():
    kept = np.r_[0:100, 112:300, 301:1000]
    rng = np.random.default_rng(0)
    clock = uniform_clock(stamps(kept * 1e-3 + rng.uniform(-2e-5, 2e-5, kept.size)))
    np.testing.assert_array_equal(clock.row, kept)
    # A line through n stamps with errors s has a slope known to s √12 / n^1.5.
    assert clock.step == pytest.approx(1e-3, rel=4 * 0.0116 * np.sqrt(12) / 1000**1.5)
    assert ["(12 in total" in clock.notes[0], "(1 in total" in clock.notes[1], len(clock.notes)] == [True, True, 2]
    assert "test.csv:102" in clock.notes[0]
    spread = clock.spread(kept.astype(float))
    np.testing.assert_array_equal(spread[kept], kept)
    assert np.count_nonzero(np.isnan(spread)) == 13


def test_single_wrong_time_stamps_are_corrected():
    time = 0.01 * np.arange(1000)
    time[[400, 700]] += [0.004, -0.003]
    clock = uniform_clock(stamps(time))
    np.testing.assert_allclose(clock.time, 0.01 * np.arange(1000), atol=1e-9)
    assert clock.notes == (
        "the time 4.004 s (test.csv:402) is not on the uniform clock, so 4 s was used",
        "the time 6.997 s (test.csv:702) is not on the uniform clock, so 7 s was used",
    )


def test_inexact_time_stamps_are_refused():
    time = 0.01 * np.arange(1000) + np.random.default_rng(0).uniform(-3e-3, 3e-3, 1000)
    with expect_refusal(UserError, "the time increases", remedy="time: {rate: 100, unit: Hz}"):
        uniform_clock(stamps(time))


def jump(at, size, count=1000, step=1e-3):
    time = np.arange(count) * step
    time[at:] += size
    return time


@pytest.mark.parametrize(
    ("time", "said", "line"),
    [
        (jump(400, 0.0104), r"the time increases by 0\.0114 s from 0\.399 to 0\.4104 s, which is 11\.4 steps", 402),
        (jump(400, -0.0105), r"the time decreases by 0\.0095 s, from 0\.399 to 0\.3895 s", 402),
        (jump(400, -0.001), r"0.399 s occurs twice", 402),
        (jump(999, 1e6), r"filling the gaps would extend the record from 1000 to 1e\+09", 1001),
        (np.cumsum(np.r_[np.full(500, 1e-3), np.full(499, 1.3e-3)]), "; many other intervals are irregular too", 502),
        (np.arange(1000)[::-1] * 1e-3, r"the time decreases by 0\.001 s, from 0\.999 to 0\.998 s;", 3),
        (np.arange(1000) * 1e-3 + 8e-5 * (np.arange(1000) == 700), r"the time 0\.70008 s deviates by 7\.99 %", 702),
    ],
)
def test_clock_errors_are_refused_with_place(time, said, line):
    with pytest.raises(UserError, match=said) as caught:
        uniform_clock(stamps(time))
    if line:
        assert caught.value.where == f"test.csv:{line}"
    assert caught.value.remedy


def test_finer_and_coarser_filter_step():
    clock = Clock(2.0, 1e-3, 10, np.array([0, 1, 2, 4, 5, 7, 8, 9]))
    fine, taken, notes = to_step(clock, 0.25e-3)
    np.testing.assert_array_equal(taken, np.arange(8))
    np.testing.assert_allclose(fine.time[fine.row], clock.time[clock.row], rtol=1e-15)
    assert fine.count == 37
    assert "rows without samples were inserted between consecutive samples (3 each)" in notes[0]
    coarse, taken, notes = to_step(clock, 2e-3)
    np.testing.assert_allclose(coarse.time, [2, 2.002, 2.004, 2.006, 2.008])
    np.testing.assert_array_equal(coarse.row, [0, 1, 2, 4])
    np.testing.assert_allclose(coarse.time[coarse.row], clock.time[clock.row][taken])
    assert "frequencies above 250 Hz cause aliasing" in notes[0]
    same, taken, notes = to_step(clock, 1e-3)
    assert (same.count, notes, len(taken)) == (10, (), 8)


def test_step_tolerance_covers_six_digits():
    found, _, notes = to_step(Clock(0.0, 4.88281e-4, 10**6, np.arange(10**6)), 1 / 2048)
    assert found.step == 1 / 2048
    assert "0.51 ppm" in notes[0]


@pytest.mark.parametrize("step", [0.7e-3, 1.5e-3, 1.0002e-3])
def test_noninteger_step_ratio_is_refused(step):
    with pytest.raises(UserError) as caught:
        to_step(Clock(0.0, 1e-3, 1000, np.arange(1000)), step)
    assert caught.value.remedy

"""Readings become SI by what is stated, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.bridges import Bridge
from strainsight.measurements.calibration import ChannelSettings, calibrate
from strainsight.measurements.records import Recording
from strainsight.measurements.units import UNITS, known_unit, spelling

TIME = np.arange(1000) * 1e-3


def recording(values, unit=None):
    return Recording(TIME, {"a": np.asarray(values, float)}, {"a": unit}, "test.csv", np.array([[0, 2]]))


def calibrated(values, settings, unit=None):
    return calibrate(recording(values, unit), "a", settings)


@pytest.mark.parametrize(
    ("unit", "si"),
    [
        ("um/m", 1e-6), ("µm/m", 1e-6), ("μm/m", 1e-6), ("ppm", 1e-6), ("strain", 1.0), ("%", 0.01), ("[um/m]", 1e-6),
        ("µε", 1e-6), ("m/s²", 1.0), ("m/s^2", 1.0), ("m/s**2", 1.0), ("g", 9.80665), ("mm/s2", 1e-3), ("kN", 1e3),
        ("lbf", 4.4482216152605), ("mm", 1e-3), ("um", 1e-6), ("N·m", 1.0), ("N m", 1.0), ("psi", 6894.757293168361),
    ],
)  # fmt: skip
def test_units_and_their_spellings(unit, si):
    assert known_unit(unit).factor == pytest.approx(si, rel=1e-15)
    np.testing.assert_allclose(calibrated(np.full(1000, 3.0), ChannelSettings(unit))[0], 3 * si, rtol=1e-14)


@pytest.mark.parametrize(
    ("units", "si"),
    [
        (("strain", "Strain", "in/in", "mm/mm", "MM/MM", "inch/inch", "ε", "ɛ"), 1.0),
        (("uin/in", "µin/in", "ue", "µstrain", "uStrain", "MicroStrain", "µɛ", "µε", "USTRAIN"), 1e-6),
        (("mm/m", "µm/mm", "‰", "millistrain"), 1e-3),
        (("lbf", "lb", "Pounds", "pound"), 4.4482216152605),
    ],
)
def test_units_in_other_words(units, si):
    assert [known_unit(unit).factor for unit in units] == pytest.approx([si] * len(units), rel=1e-15)


def test_every_unit_is_in_its_own_spelling_and_similar_ones_are_not_suggested():
    """mm/n may be a typing error for mm/m or for um/m, a thousandth."""
    assert all(spelling(unit) == unit for unit in UNITS)
    with pytest.raises(UserError) as caught:
        ChannelSettings("mm/n")
    assert caught.value.remedy.startswith("known units: strain, m/m")
    for wrong in ("KN", "volts", "", "µ"):
        with pytest.raises(UserError, match="unknown unit"):
            ChannelSettings(wrong)


def test_the_file_and_the_settings_have_to_agree_unless_overridden():
    ones = np.ones(1000)
    for same in ("ppm", "µm/m", None):
        assert calibrated(ones, ChannelSettings("um/m"), same)[0][0] == 1e-6
    with pytest.raises(UserError, match="stated in um/m, the file has it in mV/V") as caught:
        calibrated(ones, ChannelSettings("um/m"), "mV/V")
    assert "override" in caught.value.remedy
    with pytest.raises(UserError, match="the file has it in Volt"):
        calibrated(ones, ChannelSettings("um/m"), "Volt")
    values, notes = calibrated(ones, ChannelSettings("um/m", override=True), "mV/V")
    assert values[0] == 1e-6
    assert notes[0] == "a: the file says mV/V, taken as um/m as the settings say"
    with pytest.raises(UserError, match=r"-9999 um/m in 1 of 1000 samples.*stands for a missing value"):
        calibrated(np.r_[ones[1:], -9999.0], ChannelSettings("um/m", override=True), "mV/V")


def test_offset_drift_zero_scale_and_sign_in_their_order():
    signal = 50 * np.sin(20 * TIME)
    reading = 7.0 + 3.0 * TIME + signal
    settings = ChannelSettings("um/m", offset=7.0, drift=3.0, scale=2.0, sign=-1)
    np.testing.assert_allclose(calibrated(reading, settings)[0], -2e-6 * signal, atol=1e-18)
    window = signal[(TIME >= 0.2) & (TIME <= 0.4)].mean()
    values, notes = calibrated(reading, ChannelSettings("um/m", drift=3.0, zero=(0.2, 0.4)))
    np.testing.assert_allclose(values, 1e-6 * (signal - window), atol=1e-18)
    assert any("the mean of 201 samples from 0.2 to 0.4 s" in note for note in notes)


def test_a_bridge_out_of_balance_is_zeroed_before_its_formula():
    strain = np.where(TIME < 0.1, 0.0, 2e-3 * np.sin(9 * TIME))
    x = 2.1 * strain
    r = 1e3 * x / (4 + 2 * x)
    settings = ChannelSettings("mV/V", bridge=Bridge("quarter", 2.1), zero=(0.0, 0.099))
    assert settings.quantity == "strain"
    values, notes = calibrated(0.8 + r, settings, "mV/V")
    np.testing.assert_allclose(values, strain, atol=1e-16)
    assert "a: mV/V became strain, quarter bridge, gauge factor 2.1" in notes


def test_a_bridge_wired_the_other_way_round_is_turned_before_its_formula():
    x = 2.1 * 2e-3
    r = 1e3 * x / (4 + 2 * x)
    values, notes = calibrated(np.full(1000, -r), ChannelSettings("mV/V", bridge=Bridge("quarter", 2.1), sign=-1))
    np.testing.assert_allclose(values, 2e-3, rtol=1e-13)
    assert "a: its sign was turned" in notes


def test_missing_samples_stay_missing_and_do_not_enter_the_mean():
    reading = np.where(np.arange(1000) % 10 == 3, np.nan, 5.0)
    values, _ = calibrated(reading, ChannelSettings("um/m", zero=(0, 1)))
    np.testing.assert_array_equal(np.isnan(values), np.isnan(reading))
    assert np.nanmax(np.abs(values)) < 1e-18
    dead, notes = calibrated(np.full(1000, np.nan), ChannelSettings("um/m", zero=(0, 1)))
    assert np.isnan(dead).all()
    assert "a: no sample at all, so nothing was zeroed" in notes


def test_samples_that_are_marked_as_missing_do_not_enter_the_mean():
    """Ends of a span belong to it; an absurd number there is no error."""
    values = np.full(1000, 5.0)
    values[[100, 200, 201]] = 1e31, 700.0, -900.0
    spans = ((0.1, 0.1), (0.1995, 0.2015))
    own, notes = calibrated(values, ChannelSettings("um/m", zero=(0.0, 1.0), missing=spans))
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(own)), [100, 200, 201])
    np.testing.assert_allclose(own[np.isfinite(own)], 0.0, atol=1e-20)
    assert "a: 3 samples were marked as missing" in notes
    with pytest.raises(UserError, match=r"no sample from 2 to 3 s, the record runs from 0 to 0\.999 s"):
        calibrated(values, ChannelSettings("um/m", missing=((2.0, 3.0),)))


def test_what_cannot_be_is_refused_and_what_is_unlikely_is_reported():
    ones = np.ones(1000)
    with pytest.raises(UserError, match=r"no sample from 2 to 3 s, the record runs from 0 to 0.999 s"):
        calibrated(ones, ChannelSettings("um/m", zero=(2, 3)))
    reading = ones.copy()
    reading[41] = 600.0
    with pytest.raises(UserError, match="reads 600 mV/V, more than a quarter bridge") as caught:
        calibrated(reading, ChannelSettings("mV/V", bridge=Bridge("quarter", 2.0)))
    assert caught.value.where == "test.csv:43"
    reading[41] = -9.97e36
    with pytest.raises(UserError, match=r"reads -9\.97e\+36 um/m") as caught:
        calibrated(reading, ChannelSettings("um/m"))
    assert caught.value.where == "test.csv:43"
    assert "a: strains up to 100 %: is the unit right?" in calibrated(ones, ChannelSettings("strain"))[1]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"unit": "mV/V"}, "without bridge"),
        ({"unit": "um/m", "bridge": Bridge("quarter", 2.0)}, "with a quarter bridge"),
        ({"unit": "um/m", "sign": 0}, "sign"),
        ({"unit": "um/m", "scale": -1.0}, "scale"),
        ({"unit": "um/m", "offset": float("nan")}, "offset"),
        ({"unit": "um/m", "drift": float("inf")}, "drift"),
        ({"unit": "um/m", "zero": (1.0, 0.0)}, "window"),
        ({"unit": "um/m", "zero": (float("nan"), 0.0)}, "window"),
    ],
)
def test_settings_that_cannot_be(wrong, said):
    with pytest.raises(UserError, match=said):
        ChannelSettings(**wrong)

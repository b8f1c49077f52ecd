"""Channels and conversion rules of MDF files as asammdf writes them."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.assemble import assemble
from strainsight.measurements.calibration import ChannelSettings
from strainsight.measurements.reader import read_binary, read_recording

from ..refusals import expect_refusal
from .written import COUNT, A, B, T, mdf, signal

pytest.importorskip("asammdf")


def read(path, channels, **options):
    return read_binary("mdf", path, channels, **options, sandboxed=False)


def two_groups(path):
    slow = T[::10] * 1.0
    return mdf(
        path,
        ("fast", [signal("G1"), signal("G2", B, conversion={"a": 0.5, "b": 3.0})]),
        ("slow", [signal("G1", A[::10], slow, "N"), signal("F", A[::10], slow, "kN")]),
    )


@pytest.mark.parametrize("version", ["3.30", "4.10", "4.20"])
def test_physical_values_units_and_time(tmp_path, version):
    """A channel of 16-bit numbers with y = raw/2 + 3."""
    signals = [signal("G1"), signal("G2", B, conversion={"a": 0.5, "b": 3.0})]
    path = mdf(tmp_path / f"a.m{'df' if version < '4' else 'f4'}", ("rig", signals), version=version)
    found = read(path, ["G2", "G1"])
    np.testing.assert_allclose(found.time, T, atol=1e-12)
    np.testing.assert_array_equal(found.channels["G1"], A)
    np.testing.assert_array_equal(found.channels["G2"], 0.5 * B + 3.0)
    assert found.units == {"G1": "um/m", "G2": "um/m"}


def test_mdf_is_read_in_child_process(tmp_path):
    path = mdf(tmp_path / "a.mf4", ("rig", [signal("G1"), signal("µ", 2 * A, unit="µm/m")]))
    found = read_recording(path, ["rig/G1", "µ"])
    assert found.units == {"rig/G1": "um/m", "µ": "µm/m"}
    np.testing.assert_array_equal(found.channels["µ"], 2 * A)


def test_invalidation_bits_are_missing_samples(tmp_path):
    bad = np.isin(np.arange(COUNT), [0, 7, 8, COUNT - 1])
    path = mdf(tmp_path / "a.mf4", ("rig", [signal("G1", invalidation_bits=bad), signal("G2")]))
    found = read(path, ["G1", "G2"])
    np.testing.assert_array_equal(found.channels["G1"], np.where(bad, np.nan, A))
    np.testing.assert_array_equal(found.channels["G2"], A)
    assert f"G1: missing samples in the file: 4 of {COUNT}" in assemble(found, {"G1": ChannelSettings("um/m")}).notes


def test_ambiguous_channel_requires_group(tmp_path):
    path = two_groups(tmp_path / "a.mf4")
    with pytest.raises(UserError, match="2 channels have the name 'G1'") as caught:
        read(path, ["G1"])
    assert caught.value.remedy == "specify group and channel: 'fast/G1' or 'slow/G1'"
    np.testing.assert_array_equal(read(path, ["fast/G1"]).channels["fast/G1"], A)
    assert read(path, ["slow/G1"]).units == {"slow/G1": "N"}
    np.testing.assert_array_equal(read(path, ["1/G1"]).channels["1/G1"], A[::10])


def test_groups_with_equal_clock_are_combined(tmp_path):
    path = mdf(tmp_path / "a.mf4", ("one", [signal("G1")]), ("two", [signal("F", 2 * A, unit="N")]))
    np.testing.assert_array_equal(read(path, ["G1", "F"]).channels["F"], 2 * A)


def test_different_rates_are_refused(tmp_path):
    with pytest.raises(UserError) as caught:
        read(two_groups(tmp_path / "a.mf4"), ["fast/G1", "G2", "F"])
    assert caught.value.what == "the channels have 2 different sampling rates: 1000 Hz ('fast/G1', 'G2'), 100 Hz ('F')"
    assert "resampled to one" in caught.value.remedy
    assert caught.value.exit_code == 2


def test_text_is_refused(tmp_path):
    states = {"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on"}
    relay = signal("relay", (B > 0).astype("u1"), conversion=states)
    path = mdf(tmp_path / "a.mf4", ("rig", [relay, signal("note", np.array([b"ok"] * COUNT), encoding="utf-8")]))
    for name in ("relay", "note"):
        with pytest.raises(UserError, match=f"'{name}'.* text instead of numbers"):
            read(path, [name])


def test_time_channel_of_same_group(tmp_path):
    path = mdf(
        tmp_path / "a.mf4", ("rig", [signal("G1"), signal("t2", 1e3 * T + 5e3, unit="ms")]), ("other", [signal("F")])
    )
    np.testing.assert_allclose(read(path, ["G1"], time="t2", time_unit="ms").time, T + 5.0, atol=1e-12)
    np.testing.assert_allclose(read(path, ["G1"], time="time", time_unit="s").time, T, atol=1e-12)
    with pytest.raises(UserError, match="the time channel 't2' and channel 'F' belong to different channel groups"):
        read(path, ["F"], time="t2")
    with pytest.raises(UserError, match="the time unit is s in the config, but ms in the file"):
        read(path, ["G1"], time="t2", time_unit="s")


# Conversion rules of MDF channels give the physical values of the standard, or are refused; raw values never pass for them.
RAW = np.arange(COUNT) % 40
"""Raw values 0 … 39."""


def converted(tmp_path, rule, raw=RAW, version="4.10", **more):
    path = tmp_path / ("a.mf4" if version > "4" else "a.mdf")
    mdf(path, ("rig", [signal("G1", raw, conversion=rule, **more)]), version=version)
    return read_binary("mdf", path, ["G1"], sandboxed=False).channels["G1"]


def table(name, keys, values):
    return {f"raw_{i}": k for i, k in enumerate(keys)} | {f"{name}_{i}": v for i, v in enumerate(values)}


def ranges(rows, key, **more):
    """rows: lower and upper limit, and what stands for the values between."""
    names = ("lower", "upper", key)
    return {f"{name}_{i}": value for i, row in enumerate(rows) for name, value in zip(names, row, strict=True)} | more


P = {f"P{i}": float(p) for i, p in enumerate((2, 3, 5, 0.25, 7, 11), 1)}


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_rational_conversion(tmp_path, version):
    x = RAW.astype(float)
    value = (2 * x**2 + 3 * x + 5) / (0.25 * x**2 + 7 * x + 11)
    np.testing.assert_allclose(converted(tmp_path, P, version=version), value, rtol=1e-14)
    scaled = dict.fromkeys(P, 0.0) | {"P1": 3.0, "P5": 2.0}  # 3x² / 2x, also at 0
    np.testing.assert_allclose(converted(tmp_path, scaled, version=version), 1.5 * x, rtol=1e-14)


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_table_conversion_inside_and_outside(tmp_path, version):
    keys, values = [5.0, 10.0, 20.0], [1.0, -2.0, 4.0]
    line = table("phys", keys, values) | {"interpolation": True}
    np.testing.assert_allclose(converted(tmp_path, line, version=version), np.interp(RAW, keys, values), rtol=1e-14)
    nearest = [values[min(range(3), key=lambda i: (abs(x - keys[i]), keys[i]))] for x in RAW]
    steps = table("phys", keys, values) | {"interpolation": False}
    np.testing.assert_array_equal(converted(tmp_path, steps, version=version), nearest)


def test_range_upper_limit_only_for_integers(tmp_path):
    rule = ranges([(0, 9, 1.5), (10, 19, -2.0), (25, 30, 7.0)], "phys", default=99.0)
    integers = [1.5 if x <= 9 else -2.0 if x <= 19 else 7.0 if 25 <= x <= 30 else 99.0 for x in RAW]
    np.testing.assert_array_equal(converted(tmp_path, rule, RAW.astype("u1")), integers)
    floats = [1.5 if x < 9 else -2.0 if 10 <= x < 19 else 7.0 if 25 <= x < 30 else 99.0 for x in RAW]
    np.testing.assert_array_equal(converted(tmp_path, rule, RAW.astype(float)), floats)


def test_table_with_unused_text_is_converted(tmp_path):
    from asammdf.blocks.conversion_utils import from_dict

    line = from_dict({"a": 0.5, "b": 3.0})
    rule = {"val_0": 255.0, "text_0": b"sensor error", "default_addr": line}
    np.testing.assert_allclose(converted(tmp_path, rule, RAW.astype("u1")), 0.5 * RAW + 3)
    spoiled = np.where(RAW == 7, 255, RAW).astype("u1")
    with pytest.raises(UserError, match="the values are text instead of numbers"):
        converted(tmp_path, rule, spoiled)
    bad = spoiled == 255
    np.testing.assert_allclose(
        converted(tmp_path, rule, spoiled, invalidation_bits=bad), np.where(bad, np.nan, 0.5 * RAW + 3)
    )
    of_ranges = ranges([(0, 50, line), (255, 255, b"sensor error")], "text", default_addr=b"")
    np.testing.assert_allclose(converted(tmp_path, of_ranges, RAW.astype("u1")), 0.5 * RAW + 3)
    with pytest.raises(UserError, match="255 means 'sensor error'"):
        converted(tmp_path, of_ranges, spoiled)


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        (table("phys", [5.0, 5.0, 20.0], [1.0, 2.0, 3.0]) | {"interpolation": True}, "raw values in the conversion table do not"),
        (ranges([(0, 9, 1.0), (5, 19, 2.0)], "phys", default=0.0), "the ranges in the conversion table overlap"),
        ({"formula": "X1*foo"}, "the conversion formula 'X1\\*foo' cannot be evaluated: 'foo' is neither"),
        ({"formula": "1/X1"}, "no physical value at sample 1: the conversion '1/X1' of the raw value 0 yields inf"),
        (dict.fromkeys(P, 0.0), "no physical value at sample 1: the conversion rule of the raw value 0 yields nan"),
    ],
)
def test_conversion_without_value_is_refused(tmp_path, rule, message):
    with expect_refusal(UserError, f"'G1'.*{message}", remedy=""):
        converted(tmp_path, rule)


def test_damaged_conversion_is_refused(tmp_path):
    path = mdf(tmp_path / "a.mf4", ("rig", [signal("G1", B, conversion={"a": 0.5, "b": 3.0})]))
    content = bytearray(path.read_bytes())
    at = content.rindex(b"##CC")
    content[at + 8 : at + 16] = (1 << 40).to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(UserError, match="the conversion rule of channel 'G1' cannot be read"):
        read_binary("mdf", path, ["G1"], sandboxed=False)


@pytest.mark.parametrize(("code", "name"), [(7, "exponential"), (8, "logarithmic"), (99, "type 99")])
def test_ambiguous_conversion_is_refused(tmp_path, code, name):
    path = mdf(tmp_path / "a.mdf", ("rig", [signal("G1", A, conversion=P)]), version="3.30")
    content = bytearray(path.read_bytes())
    at = content.rindex(b"CC")
    while int.from_bytes(content[at + 42 : at + 44], "little") != 9:  # its code: rational
        at = content.rindex(b"CC", 0, at)
    content[at + 42 : at + 44] = code.to_bytes(2, "little")
    content[at + 2 : at + 4] = (46 + 56).to_bytes(2, "little")
    path.write_bytes(content)
    with pytest.raises(UserError, match=f"'G1': the conversion rule is not supported: {name}"):
        read_binary("mdf", path, ["G1"], sandboxed=False)

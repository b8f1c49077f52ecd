"""Channels of TDMS files as npTDMS writes them come back scaled, on the clock of their waveform or of a time channel."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.reader import read_binary, read_recording

from ..refusals import expect_refusal
from .written import A, B, T, tdms, waveform

pytest.importorskip("nptdms")
START = np.datetime64("2025-01-06T10:00:00.000000")


def read(path, channels, **options):
    return read_binary("tdms", path, channels, **options, sandboxed=False)


def test_values_units_and_time(tmp_path):
    """Times of sample k are wf_start_offset + k wf_increment."""
    channels = {"rig/G1": waveform(wf_start_offset=0.25), "rig/G2": waveform(B, "N", wf_start_offset=0.25)}
    path = tdms(tmp_path / "a.tdms", channels)
    found = read_recording(path, ["G2", "rig/G1"])
    np.testing.assert_allclose(found.time, 0.25 + T, rtol=1e-14)
    np.testing.assert_array_equal(found.channels["rig/G1"], A)
    np.testing.assert_array_equal(found.channels["G2"], B)
    assert found.units == {"G2": "N", "rig/G1": "um/m"}


def test_tdms_scales_are_applied(tmp_path):
    """A linear scale as DAQmx writes it: y = 0.5 raw + 3."""
    values, properties = waveform(B)
    properties |= {
        "NI_Number_Of_Scales": np.int32(1),
        "NI_Scaling_Status": "unscaled",
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 0.5,
        "NI_Scale[0]_Linear_Y_Intercept": 3.0,
        "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF),
    }
    path = tdms(tmp_path / "a.tdms", {"rig/G1": (values, properties)})
    np.testing.assert_allclose(read(path, ["G1"]).channels["G1"], 0.5 * B + 3.0, rtol=1e-15)


@pytest.mark.parametrize("holder", ["channel", "group", "file"])
def test_unknown_tdms_scale_is_refused(tmp_path, holder):
    """npTDMS leaves it out and gives raw values; where the values are scaled already it does not count."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    scale = {"NI_Number_Of_Scales": np.int32(1), "NI_Scale[0]_Scale_Type": "Reciprocal"}
    values, properties = waveform(B)
    for status in ("unscaled", "scaled"):
        more = {
            name: scale | {"NI_Scaling_Status": status} if name == holder else {}
            for name in ("channel", "group", "file")
        }
        with TdmsWriter(tmp_path / "a.tdms") as file:
            channel = ChannelObject("rig", "G1", values, properties | more["channel"])
            file.write_segment([RootObject(more["file"]), GroupObject("rig", more["group"]), channel])
        if status == "scaled":
            np.testing.assert_array_equal(read(tmp_path / "a.tdms", ["G1"]).channels["G1"], B)
            continue
        with pytest.raises(UserError, match="'G1' has a scale of type 'Reciprocal', which is not supported"):
            read(tmp_path / "a.tdms", ["G1"])


def test_channels_with_slashes_and_quotes_in_their_names(tmp_path):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(tmp_path / "a.tdms") as file:
        file.write_segment([ChannelObject("cDAQ1Mod1/ai", "ai0/it's", *waveform())])
    for name in ("ai0/it's", "cDAQ1Mod1/ai/ai0/it's"):
        np.testing.assert_array_equal(read(tmp_path / "a.tdms", [name]).channels[name], A)


LATER = START + np.timedelta64(100, "ms")


@pytest.mark.parametrize(("start", "offset"), [(LATER, 0.0), (START, 0.1), (LATER, -0.1)])
def test_tdms_start_and_offset_define_clock(tmp_path, start, offset):
    second = waveform(wf_start_time=start, wf_start_offset=offset)
    path = tdms(tmp_path / "a.tdms", {"rig/G1": waveform(wf_start_time=START), "rig/G2": second})
    if offset < 0:  # it makes up for the start
        np.testing.assert_allclose(read(path, ["G1", "G2"]).time, T, atol=1e-12)
        return
    with pytest.raises(UserError, match=r"'G2' has 400 samples from 0\.1 to 0\.499 s"):
        read(path, ["G1", "G2"])


def test_tdms_time_channel(tmp_path):
    stamps = START + np.arange(len(A)) * np.timedelta64(1000, "us")
    channels = {"rig/Zeit": (1e3 * T + 7.0, {"unit_string": "ms"}), "rig/stamps": (stamps, {})}
    path = tdms(tmp_path / "a.tdms", channels | {"rig/G1": (A, {"unit_string": "um/m"})})
    np.testing.assert_allclose(read(path, ["G1"], time="Zeit", time_unit="ms").time, T + 7e-3, rtol=1e-12)
    np.testing.assert_allclose(read(path, ["G1"], time="stamps", time_unit="s").time, T, atol=1e-12)
    with pytest.raises(UserError, match="'G1' has no wf_increment") as caught:
        read(path, ["G1"])
    assert caught.value.remedy == "specify the time channel in estimate.time.channel, for example 'rig/Zeit'"
    with pytest.raises(UserError, match="'stamps' contains dates and times instead of numbers"):
        read(path, ["stamps"], time="Zeit", time_unit="ms")


@pytest.mark.parametrize("step", [0.0, -1e-3, "fast", np.nan])
def test_invalid_tdms_increment_is_refused(tmp_path, step):
    with pytest.raises(UserError, match=r"'G1' has the invalid wf_increment"):
        read(tdms(tmp_path / "a.tdms", {"rig/G1": waveform(step=step)}), ["G1"])


def test_nan_is_missing_and_infinite_is_refused(tmp_path):
    bad = np.where(np.arange(len(A)) == 4, np.nan, A)
    path = tdms(tmp_path / "a.tdms", {"rig/G1": waveform(bad), "rig/G2": waveform(np.where(np.isnan(bad), np.inf, A))})
    np.testing.assert_array_equal(read(path, ["G1"]).channels["G1"], bad)
    with pytest.raises(UserError, match="sample 5 of channel 'G2' is infinite"):
        read(path, ["G2"])


def test_invalid_tdms_channels_are_refused(tmp_path):
    channels = {"G1": waveform(), "short": waveform(A[:-1]), "note": waveform(["a"] * len(A))}
    channels["two"] = waveform(unit="um/m", Unit="N")
    path = tdms(tmp_path / "a.tdms", {f"rig/{name}": channel for name, channel in channels.items()})
    for names, said in (
        (["G1", "short"], "'short' has 399 samples from 0 to 0.398 s"),
        (["note"], "'note' contains text or objects instead of numbers"),
        (["two"], "'two' has several units: 'N' and 'um/m'"),
        (["G5"], "channel 'G5' not found"),
    ):
        with pytest.raises(UserError, match=said):
            read(path, names)


def test_tdms_index_file_is_ignored(tmp_path):
    path = tdms(tmp_path / "a.tdms", {"rig/G1": waveform()})
    (tmp_path / "a.tdms_index").write_bytes(b"TDSh" + bytes(100))
    np.testing.assert_array_equal(read(path, ["G1"]).channels["G1"], A)


def test_incomplete_tdms_is_refused(tmp_path):
    path = tdms(tmp_path / "a.tdms", {"rig/G1": waveform(), "rig/G2": waveform()})
    path.write_bytes(path.read_bytes()[:-1000])
    with expect_refusal(
        UserError, "the last segment of the file is incomplete", remedy="save the file again"
    ):
        read(path, ["G1"])

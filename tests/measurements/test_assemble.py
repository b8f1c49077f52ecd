"""A test as it comes from the rig: every format, shuffled, in mV/V, with holes, a jump and drift, and back to the truth."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.assemble import assemble
from strainsight.measurements.bridges import Bridge
from strainsight.measurements.calibration import ChannelSettings
from strainsight.measurements.delay import Delay
from strainsight.measurements.reader import read_recording
from strainsight.measurements.records import Recording

COUNT, STEP = 2000, 1e-3
TIME = 5.0 + STEP * np.arange(COUNT)
RNG = np.random.default_rng(7)
UNLOADED = TIME < 5.2
STRAIN = np.where(UNLOADED, 0.0, 8e-4 * np.sin(40 * (TIME - 5.2)))
ACCELERATION = np.where(UNLOADED, 0.0, 30.0 * np.cos(90 * TIME))
FORCE = np.where(UNLOADED, 0.0, 2500.0 * np.sin(3 * (TIME - 5.2)))
LOST = {name: RNG.random(COUNT) < 0.1 for name in ("g1", "g2", "acc")}
GAP = np.r_[700:712, 1500]
KEPT = np.setdiff1d(np.arange(COUNT), GAP)
SETTINGS = {
    "g2": ChannelSettings("mV/V", bridge=Bridge("half-poisson", 2.05, 0.3), zero=(5.0, 5.199), sign=-1),
    "F": ChannelSettings("kN"),
    "g1": ChannelSettings("um/m", drift=4.0, zero=(5.0, 5.199)),
    "acc": ChannelSettings("g", offset=0.25),
}
TRUTH = {"g1": STRAIN, "g2": STRAIN, "acc": ACCELERATION, "F": FORCE}
UNITS = {"g1": "µm/m", "g2": "mV/V", "acc": "g", "F": "kN"}


def readings():
    """What the rig writes: names → (COUNT,), NaN where a sample is lost."""
    x = 2.05 * STRAIN
    found = {
        "g1": 1e6 * STRAIN + 12.0 + 4.0 * (TIME - TIME[0]),
        # One gauge along, one across, adjacent; wired the other way round and out of balance.
        "g2": 0.3 - 1e3 * ((1 + x) / (2 + 0.7 * x) - 0.5),
        "acc": ACCELERATION / 9.80665 + 0.25,
        "F": FORCE / 1e3,
    }
    for name, lost in LOST.items():
        found[name] = np.where(lost, np.nan, found[name])
    return found


def write_csv(path, end="\r\n", mark=",", decimal="."):
    values = {**readings(), "note": None}
    order = ["acc", "g2", "note", "time", "F", "g1"]
    units = {**UNITS, "time": "ms", "note": ""}

    def cell(name, k):
        if name == "note":
            return "ok" if k % 3 else '"ok; and, more"'
        value = 1e3 * TIME[k] if name == "time" else values[name][k]
        return "" if np.isnan(value) else f"{value:.17g}".replace(".", decimal)

    rows = ["# rig 4", mark.join(order), mark.join(f"[{units[name]}]" for name in order)]
    rows += [mark.join(cell(name, k) for name in order) for k in KEPT]
    path.write_bytes(b"\xef\xbb\xbf" + (end.join(rows) + end).encode())


def expect_truth(signals, atol=0.0):
    assert signals.names == ("g2", "F", "g1", "acc")
    assert signals.quantities == ("strain", "force", "strain", "acceleration")
    np.testing.assert_allclose(signals.time, TIME, rtol=1e-9)
    for column, name in enumerate(signals.names):
        gone = np.isin(np.arange(COUNT), GAP) | LOST.get(name, np.zeros(COUNT, bool))
        np.testing.assert_array_equal(np.isnan(signals.values[:, column]), gone)
        scale = np.abs(TRUTH[name]).max()
        np.testing.assert_allclose(
            signals.values[~gone, column], TRUTH[name][~gone], rtol=0, atol=atol * scale + 1e-12 * scale
        )
    assert any(note.startswith("12 rows without samples were put in behind 5.699 s") for note in signals.notes)
    assert any(note.startswith("1 row without samples was put in behind 6.499 s") for note in signals.notes)
    assert f"g1: {int(LOST['g1'][KEPT].sum())} of {len(KEPT)} samples are missing" in signals.notes
    assert "g2: mV/V became strain, half-poisson bridge, gauge factor 2.05" in signals.notes


@pytest.mark.parametrize(("end", "mark"), [("\n", ","), ("\r\n", ";"), ("\r\n", "\t")])
def test_a_test_from_csv(tmp_path, end, mark):
    path = tmp_path / "rig.csv"
    write_csv(path, end, mark)
    recording = read_recording(path, list(SETTINGS), time="time")
    expect_truth(assemble(recording, SETTINGS))
    # Three lines stand above the numbers, and lines count from 1.
    assert recording.place(0).endswith("rig.csv:4")


def test_a_test_from_hdf5(tmp_path):
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        for name, values in readings().items():
            file[name] = values[KEPT]
            file[name].attrs["units"] = UNITS[name]
        file["clock/t"] = TIME[KEPT]
    expect_truth(assemble(read_recording(tmp_path / "rig.h5", list(SETTINGS), time="clock/t", time_unit="s"), SETTINGS))


def test_a_test_from_uff58(tmp_path):
    content = b""
    for node, (name, values) in enumerate(readings().items(), start=1):
        rows = np.zeros(len(KEPT), [("t", ">f8"), ("y", ">f8")])
        rows["t"], rows["y"] = TIME[KEPT], values[KEPT]
        content += (
            (
                f"    -1\n    58b     2     2          11{rows.nbytes:12d}     0     0           0           0\n"
                f"{name}\nNONE\nNONE\nNONE\nNONE\n"
                f"    1         0    0         0 NONE      {node:10d}   0 NONE                0   0\n"
                f"         4{len(KEPT):10d}         0  0.00000E+00  0.00000E+00  0.00000E+00\n"
                "        17    0    0    0 NONE                 s\n"
                f"         0    0    0    0 NONE                 {UNITS[name]}\n"
                "         0    0    0    0 NONE                 NONE\n"
                "         0    0    0    0 NONE                 NONE\n"
            ).encode()
            + rows.tobytes()
            + b"    -1\n"
        )
    (tmp_path / "rig.unv").write_bytes(content)
    expect_truth(assemble(read_recording(tmp_path / "rig.unv", list(SETTINGS)), SETTINGS))


def test_decimal_commas_are_refused_with_the_line_or_read_where_stated(tmp_path):
    from strainsight.measurements.csv_layout import TextFormat

    path = tmp_path / "rig.csv"
    write_csv(path, mark=";", decimal=",")
    with pytest.raises(UserError, match="is no number") as caught:
        read_recording(path, list(SETTINGS), time="time")
    assert caught.value.where.endswith("rig.csv:4")
    expect_truth(assemble(read_recording(path, list(SETTINGS), time="time", form=TextFormat(decimal=",")), SETTINGS))


def test_a_clock_with_a_jump_that_is_no_whole_number_is_refused_with_the_line(tmp_path):
    path = tmp_path / "rig.csv"
    rows = [f"{t + (0.0104 if k >= 300 else 0):.6f},1" for k, t in enumerate(TIME)]
    path.write_text("time [s],g1 [um/m]\n" + "\n".join(rows))
    with pytest.raises(UserError, match=r"the clock jumps by 0.0114 s from 5.299 to 5.3104 s: 11.4 steps") as caught:
        assemble(read_recording(path, ["g1"], time="time"), {"g1": SETTINGS["g1"]})
    assert caught.value.where.endswith("rig.csv:302")


def test_mv_per_v_is_not_taken_for_strain():
    recording = Recording(TIME, {"g1": STRAIN}, {"g1": "mV/V"}, "rig.csv")
    with pytest.raises(UserError, match="stated in um/m, the file has it in mV/V") as caught:
        assemble(recording, {"g1": ChannelSettings("um/m")})
    assert caught.value.key == "g1"
    with pytest.raises(UserError, match="no channel 'g3'") as caught:
        assemble(recording, {"g3": ChannelSettings("um/m")})
    assert caught.value.remedy == "did you mean g1?"


@pytest.mark.parametrize("factor", [0.25, 0.5, 1, 2, 5])
def test_the_step_of_the_filter_moves_no_sample(factor):
    recording = Recording(TIME[KEPT], {"F": readings()["F"][KEPT]}, {"F": None}, "rig.csv")
    signals = assemble(recording, {"F": SETTINGS["F"]}, STEP * factor)
    assert np.diff(signals.time) == pytest.approx(STEP * factor, rel=1e-6)
    seen = np.flatnonzero(~np.isnan(signals.values[:, 0]))
    sample = np.rint((signals.time[seen] - TIME[0]) / STEP).astype(int)
    np.testing.assert_allclose(signals.time[seen], TIME[sample], rtol=0, atol=1e-9)
    np.testing.assert_allclose(signals.values[seen, 0], FORCE[sample], rtol=1e-14)
    expected = KEPT if factor < 1 else KEPT[KEPT % factor == 0]
    np.testing.assert_array_equal(sample, expected)


@pytest.mark.parametrize(("count", "said"), [(20, True), (19, False)])
def test_a_stretch_of_missing_samples_is_named_with_its_time(count, said):
    values = np.zeros(500)
    values[100 : 100 + count] = np.nan
    values[[3, 400, 401]] = np.nan
    notes = assemble(
        Recording(1e-3 * np.arange(500), {"a": values}, {"a": "um/m"}, "rig"), {"a": ChannelSettings("um/m")}
    ).notes
    assert f"a: {count + 3} of 500 samples are missing" in notes
    assert any(note.startswith("a: 20 of them in a row, from 0.1 to 0.119 s") for note in notes) == said


LATE = 7


def late_record(gap=()):
    """Two channels of one sine, "b" written LATE samples late."""
    row = np.setdiff1d(np.arange(100), gap)
    time = 2.0 + STEP * row
    channels = {"a": np.sin(30 * time), "b": np.sin(30 * (time - LATE * STEP))}
    return Recording(time, channels, {"a": "m/m", "b": "m/m"}, "rig.csv")


@pytest.mark.parametrize("delay", [Delay(samples=LATE), Delay(seconds=LATE * STEP), Delay(seconds=LATE * STEP * 1.0005)])
def test_a_channel_that_is_written_late_is_put_at_its_own_time(delay):
    found = assemble(late_record(), {"a": ChannelSettings("m/m"), "b": ChannelSettings("m/m", delay=delay)})
    np.testing.assert_allclose(found.values[:-LATE, 1], found.values[:-LATE, 0], atol=1e-12)
    assert np.isnan(found.values[-LATE:, 1]).all()
    assert any("b: 7 samples late" in note for note in found.notes)


def test_one_that_is_early_lacks_samples_at_the_beginning():
    early = {"a": ChannelSettings("m/m", delay=Delay(samples=-LATE)), "b": ChannelSettings("m/m")}
    found = assemble(late_record(), early)
    np.testing.assert_allclose(found.values[LATE:, 0], found.values[LATE:, 1], atol=1e-12)
    assert np.isnan(found.values[:LATE, 0]).all()


@pytest.mark.parametrize("step", [2 * STEP, STEP / 2])
def test_a_delay_is_in_samples_of_the_file_whatever_the_step_of_the_filter(step):
    settings = {"a": ChannelSettings("m/m"), "b": ChannelSettings("m/m", delay=Delay(samples=LATE))}
    found = assemble(late_record(gap=[40, 41]), settings, step)
    there = np.isfinite(found.values).all(axis=1)
    assert there.sum() > 35
    np.testing.assert_allclose(found.values[there, 1], found.values[there, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("delay", "what"),
    [
        (Delay(seconds=2.4 * STEP), r"a delay of 0\.0024 s is 2\.4 samples of 0\.001 s, and nothing is interpolated"),
        (Delay(samples=100), "a delay of 100 samples, the record has 100"),
        (Delay(seconds=-1.0), "a delay of -1000 samples, the record has 100"),
    ],
)
def test_a_delay_that_does_not_fit_the_record_is_refused(delay, what):
    with pytest.raises(UserError, match=what) as caught:
        assemble(late_record(), {"b": ChannelSettings("m/m", delay=delay)})
    assert caught.value.key == "b"

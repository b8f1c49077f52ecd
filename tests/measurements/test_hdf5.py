"""Datasets come back as they were written; links, shapes, types and holes that cannot be imported are refused."""

from __future__ import annotations

import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest

from strainsight import child_reader, memory, processes
from strainsight.errors import UserError
from strainsight.measurements import hdf5_datasets, reader
from strainsight.measurements.reader import read_binary

from ..refusals import expect_refusal

T = np.arange(100) * 1e-3
A = np.random.default_rng(0).normal(size=100)


@pytest.fixture
def make(tmp_path):
    """A function that fills an open file → its path, with a clock "time" [s] unless it makes one."""

    def written(fill):
        path = tmp_path / "test.h5"
        with h5py.File(path, "w") as file:
            fill(file)
            if "time" not in file:
                file["time"] = T
                file["time"].attrs["units"] = "s"
        return path

    return written


def test_hdf5_datasets_of_all_types(make):
    def fill(file):
        file["run 1/strain/a"] = A.astype(">f4")
        file["run 1/strain/a"].attrs["unit"] = np.bytes_("um/m")
        file.create_dataset("b", data=np.arange(100, dtype="i2"), chunks=(7,), compression="gzip", shuffle=True)
        file["b"].attrs["units"] = "mV/V"
        file["column"] = A[:, None]
        file["link"] = h5py.SoftLink("/run 1/here")
        file["run 1/here"] = h5py.SoftLink("strain/a")
        file["filled"] = np.where(np.arange(100) % 7 == 0, -999.0, A)
        file["filled"].attrs["_FillValue"] = -999.0
        file["table"] = np.stack([T * 1e3, A, 2 * A], axis=1)
        file["table"].attrs["units"] = ["ms", "um/m", "g"]

    path = make(fill)
    expected = {
        "run 1/strain/a": A.astype("f4"), "/b": np.arange(100), "column": A, "link": A.astype("f4"),
        "filled": np.where(np.arange(100) % 7 == 0, np.nan, A), "table[2]": 2 * A, "table[1]": A,
    }  # fmt: skip
    for clock in ("time", "table[0]"):
        recording = read_binary("hdf5", path, list(expected), time=clock, sandboxed=False)
        np.testing.assert_allclose(recording.time, T, rtol=1e-15)
        for name, values in expected.items():
            np.testing.assert_array_equal(recording.channels[name], values)
    assert list(recording.units.values()) == ["um/m", "mV/V", None, "um/m", None, "g", "um/m"]
    assert recording.channels["/b"].dtype == float
    assert recording.place(3).endswith("test.h5, sample 4")


def hole(file):
    file.create_dataset("a", shape=(100,), chunks=(10,), dtype=float)[:50] = 1.0


def two_units(file):
    file["a"] = A
    file["a"].attrs.update(units="um/m", unit="g")


def packed(file):
    file["a"] = np.arange(100)
    file["a"].attrs["scale_factor"] = 0.5


def virtual(file):
    layout = h5py.VirtualLayout(shape=(100,), dtype=float)
    layout[:] = h5py.VirtualSource("other.h5", "a", shape=(100,))
    file.create_virtual_dataset("a", layout)


FAULTS = {
    # datasets and links of a file, or what makes them
    "external link": ({"a": h5py.ExternalLink("other.h5", "/a")}, "links to another file"),
    "behind a soft link": ({"e": h5py.ExternalLink("x.h5", "/"), "a": h5py.SoftLink("/e/a")}, "links to another file"),
    "soft links in a circle": ({"a": h5py.SoftLink("/b"), "b": h5py.SoftLink("/a")}, "more than 16 consecutive links"),
    "virtual": (virtual, "in another file"),
    "external storage": (
        lambda file: file.create_dataset("a", (100,), float, external=[("other.raw", 0, 800)]), "in another file",
    ),
    "text": ({"a": ["1"] * 100}, "instead of real numbers"),
    "compound": ({"a": np.zeros(100, [("x", float)])}, "instead of real numbers"),
    "table": ({"a": np.zeros((100, 3))}, "has 3 columns"),
    "shorter": ({"a": A[:99]}, "dataset has 99 samples, but the time axis has 100"),
    "absurd": (lambda file: file.create_dataset("a", (10**15,), float, chunks=(1000,)), "'/a' has 1000000000000000 samples"),
    "chunks": (lambda file: file.create_dataset("a", (100,), float, chunks=(2**29 - 8,), maxshape=(None,)), "stored in chunks"),
    "gaps for a whole disk": (
        lambda file: file.create_dataset("a", (10**8,), float, chunks=(10**6,), fillvalue=np.nan),
        "claims 800000000 bytes in a file of|has 100000000 samples",
    ),
    "half written": (hole, "5 of 10 blocks"),
    "infinite": ({"a": np.where(np.arange(100) == 4, np.inf, A)}, "sample 5 of channel 'a' is infinite"),
    "two units": (two_units, "'a' has several units: 'g'"),
    "packed": (packed, "packed values"),
    "time missing": ({"a": A, "time": T + np.nan}, "the file does not define the unit of the time"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_what_cannot_be_imported_is_refused(make, fault):
    content, said = FAULTS[fault]
    path = make(content if callable(content) else lambda file: [file.__setitem__(*item) for item in content.items()])
    with expect_refusal(UserError, said, remedy="") as caught:
        read_binary("hdf5", path, ["a"], time="time", sandboxed=False)
    assert "test.h5" in caught.value.where


def test_time_without_unit_or_with_gaps_is_refused(make):
    def fill(file):
        file["time"] = np.where(np.arange(100) == 3, np.nan, T)

    path = make(fill)
    with pytest.raises(UserError, match="the file does not define the unit of the time"):
        read_binary("hdf5", path, [], time="time", sandboxed=False)
    with pytest.raises(UserError, match="sample 4 has no time"):
        read_binary("hdf5", path, [], time="time", time_unit="s", sandboxed=False)


def limited(monkeypatch, seconds):
    monkeypatch.setitem(reader.LIBRARIES, "hdf5", replace(reader.LIBRARIES["hdf5"], seconds=seconds))


HANGS = "import time; time.sleep(60)"


@pytest.mark.parametrize("does", ["import os; os.abort()", f"print('ready', flush=True); {HANGS}"])
def test_library_crash_is_reported(make, monkeypatch, does):
    path = make(lambda file: file.__setitem__("a", A))
    monkeypatch.setattr(reader, "COMMAND", [sys.executable, "-c", does])
    monkeypatch.setattr(child_reader, "START_LIMIT", 0.5)
    limited(monkeypatch, 0.5)
    monkeypatch.setattr(processes, "LONGER", 1.0)
    with pytest.raises(UserError, match="library crashed or took too long"):
        read_binary("hdf5", path, ["a"], time="time")


BUSY = "import time, sys; sys.stdin.read(); print('ready', flush=True)\nwhile True: pass"


def test_processor_time_is_limited(make, monkeypatch):
    path = make(lambda file: file.__setitem__("a", A))
    monkeypatch.setattr(reader, "COMMAND", [sys.executable, "-c", BUSY])
    limited(monkeypatch, 0.5)
    monkeypatch.setattr(processes, "LONGER", 1e6)
    with pytest.raises(UserError, match="library crashed or took too long"):
        read_binary("hdf5", path, ["a"], time="time")


def test_slow_disk_is_not_a_timeout(make, monkeypatch):
    path = make(lambda file: file.__setitem__("a", A))
    answers = (
        "import sys, time, json\nsys.stdin.read()\n"
        "def say(text): print(text, flush=True)\n"
        "say('ready'); say(json.dumps({'declared': [16, 16], 'arrays': []}))\n"
        "for i in range(2): time.sleep(0.6); say(json.dumps({'unit': 's', 'arrays': [['<f8', [2]]]})); "
        "sys.stdout.buffer.write(b'\\0' * 15 + b'?'); sys.stdout.flush()\n"
    )
    monkeypatch.setattr(reader, "COMMAND", [sys.executable, "-c", answers])
    limited(monkeypatch, 0.2)
    assert read_binary("hdf5", path, ["a"], time="time").time.shape == (2,)


def test_limits_follow_declared_size(make, monkeypatch):
    """2 MB of a table of which one column is asked for, in a file of 20 kB: a second more for every so many bytes unpacked, and
    refused before a sample is read where memory does not hold the column, its copies, and 0.2 MB of chunks."""

    def fill(file):
        file.create_dataset("time", data=np.arange(10**4) * 1e-3, compression="gzip").attrs["units"] = "s"
        file.create_dataset("table", (10**4, 25), "f8", chunks=(10**3, 25), compression="gzip")[...] = 1.0

    path = make(fill)
    assert hdf5_datasets.declared(path, ["time", "table[3]"]) == [80_000, 2_000_000]
    monkeypatch.setattr(memory, "available_memory", lambda: 6e5)
    assert hdf5_datasets.declared(path, ["time", "table[3]"]) == [80_000, 2_000_000]
    monkeypatch.setattr(memory, "available_memory", lambda: 5e5)
    with pytest.raises(UserError, match=r"a channel of 10000 samples: .* GiB of memory are needed"):
        hdf5_datasets.declared(path, ["time", "table[3]"])


def test_sandbox_gives_same_result(make):
    path = make(lambda file: file.__setitem__("µ", A))
    apart, here = (read_binary("hdf5", path, ["µ"], time="time", sandboxed=choice) for choice in (True, False))
    np.testing.assert_array_equal(apart.channels["µ"], here.channels["µ"])
    assert (apart.units, apart.source) == (here.units, here.source)
    said = []
    for choice in (True, False):
        with pytest.raises(UserError) as caught:
            read_binary("hdf5", path, ["mu"], time="time", sandboxed=choice)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_rate_replaces_time(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = [1.0, np.nan, 3.0]
    recording = read_binary("hdf5", tmp_path / "a.h5", ["a"], rate=10.0, sandboxed=False)
    np.testing.assert_array_equal(recording.time, [0, 0.1, 0.2])
    np.testing.assert_array_equal(recording.channels["a"], [1.0, np.nan, 3.0])

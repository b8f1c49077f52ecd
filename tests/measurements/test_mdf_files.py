"""MDF files that asammdf would unpack, sort or complete on disk: nothing is written, and archives are bounded."""

from __future__ import annotations

import os
import sys
import tempfile
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from strainsight import processes
from strainsight.errors import UserError
from strainsight.measurements import reader
from strainsight.measurements.reader import read_binary

from .written import A, B, T, mdf, signal

pytest.importorskip("asammdf")


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    for name in ("TMPDIR", "TEMP", "TMP"):
        monkeypatch.setenv(name, str(folder))
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def plain(path):
    return mdf(path, ("rig", [signal("G1"), signal("G2", B, conversion={"a": 0.5, "b": 3.0})]))


def zipped(path, content=None, name="run/a.mf4"):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("notes.txt", "of the test")
        archive.writestr(name, plain(path.with_name("inside.mf4")).read_bytes() if content is None else content)
    return path


def not_finalized(path):
    """As a logger leaves it that lost power: the length of the last block of samples is not written yet."""
    content = bytearray(plain(path).read_bytes())
    content[:8], content[60] = b"UnFinMF ", 4
    at = content.rindex(b"##DT")
    content[at + 8 : at + 16] = (24).to_bytes(8, "little")
    path.write_bytes(content)
    return path


def unsorted(path):
    file = bytearray(mdf(path, ("one", [signal("G1")]), ("two", [signal("G2", B)])).read_bytes())

    def link(block, number):
        at = block + 24 + 8 * number
        return at, int.from_bytes(file[at : at + 8], "little")

    def put(at, value, size=8):
        file[at : at + size] = value.to_bytes(size, "little")

    first = link(64, 0)[1]
    second = link(first, 0)[1]
    groups = [link(block, 1)[1] for block in (first, second)]
    records = []
    for group, kind in zip(groups, ("<f8,<f8", "<f8,<i2"), strict=True):
        samples = np.array(list(zip(T, A if kind.endswith("f8") else B, strict=True)), np.dtype(kind))
        records.append([sample.tobytes() for sample in samples])
        assert int.from_bytes(file[group + 96 : group + 100], "little") == samples.itemsize
    put(link(first, 0)[0], 0)  # the file has one block of data, with both groups
    put(link(groups[0], 0)[0], groups[1])
    for number, group in enumerate(groups, 1):
        put(group + 24 + 6 * 8, number)
    put(first + 24 + 4 * 8, 1, 1)
    data = b"".join(b"\1" + a + b"\2" + b for a, b in zip(*records, strict=True))
    put(link(first, 2)[0], len(file))
    path.write_bytes(bytes(file) + b"##DT" + bytes(4) + (24 + len(data)).to_bytes(8, "little") + bytes(8) + data)
    return path


@pytest.mark.parametrize("make", [zipped, not_finalized, unsorted])
def test_mdf_reading_leaves_no_files(tmp_path, temporary, make):
    path = make(tmp_path / ("a.zip" if make is zipped else "a.mf4"))
    there = sorted(os.listdir(tmp_path))
    content = path.read_bytes()
    recording = read_binary("mdf", path, ["G1", "G2"], sandboxed=False)
    np.testing.assert_allclose(recording.time, T, atol=1e-12)
    np.testing.assert_array_equal(recording.channels["G1"], A)
    np.testing.assert_array_equal(recording.channels["G2"], B if make is unsorted else 0.5 * B + 3)
    assert os.listdir(temporary) == []
    assert sorted(os.listdir(tmp_path)) == there
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: zipped(path, bytes(20_000_000)), "unpacks to 20000000 bytes, more than 100 times"),
        (lambda path: zipped(path, bytes(1000)), "cannot be read as MDF: .*not a valid ASAM MDF file"),
        (lambda path: zipped(path, name="a.exe"), r"the archive contains no file with the ending \.mf4"),
        (lambda path: path.write_bytes(zipped(path).read_bytes()[:900]) and path, "cannot be read as MDF: .*zip"),
    ],
)
def test_refused_archive_leaves_no_files(tmp_path, temporary, make, message):
    path = make(tmp_path / "a.zip")
    with pytest.raises(UserError, match=message):
        read_binary("mdf", path, ["G1"], sandboxed=False)
    assert os.listdir(temporary) == []


HANGS = """
import time
from strainsight.measurements import mdf, reader
mdf._places = lambda file: time.sleep(60)
reader.answer_for("mdf")
"""
"""A reader that does not come back from an open file."""


def test_killed_reader_leaves_no_files(tmp_path, temporary, monkeypatch):
    monkeypatch.setattr(reader, "COMMAND", [sys.executable, "-P", "-c", HANGS])
    monkeypatch.setitem(reader.LIBRARIES, "mdf", replace(reader.LIBRARIES["mdf"], seconds=1.0))
    monkeypatch.setattr(processes, "LONGER", 1.0)
    path = not_finalized(tmp_path / "a.mf4")
    with pytest.raises(UserError, match="library crashed or took too long"):
        read_binary("mdf", path, ["G1"])
    assert os.listdir(temporary) == []

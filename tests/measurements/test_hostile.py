"""Damaged and malicious files end in a UserError, soon, and in little memory."""

from __future__ import annotations

import tracemalloc
import warnings

import h5py
import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements.assemble import assemble
from strainsight.measurements.calibration import ChannelSettings
from strainsight.measurements.reader import read_recording

from ..fuzz.guard import soon

RUBBISH = np.random.default_rng(5).bytes(200_000)
TABLE = b"time [s],a [um/m]\n" + b"".join(b"%.3f,%d\n" % (k * 1e-3, k) for k in range(500))


def hdf5(tmp_path, fill):
    with h5py.File(tmp_path / "made.h5", "w") as file:
        fill(file)
    return (tmp_path / "made.h5").read_bytes()


def good_hdf5(file):
    file["time"], file["a"] = np.arange(500) * 1e-3, np.arange(500.0)
    file["time"].attrs["units"] = "s"


def bomb(file):
    good_hdf5(file)
    del file["a"]
    file.create_dataset("a", (10**12,), "f8", chunks=(10**6,), compression="gzip")


CSV = {
    "empty": b"",
    "rubbish behind a header": b"time [s],a [um/m]\n" + RUBBISH.replace(b"\0", b"x"),
    "one endless line": b"1," * 1_000_000,
    "endless cell": b"time [s],a [um/m]\n0," + b"1" * 2_000_000 + b"\n1,2\n",
    "endless header": b"," * 2_000_000,
    "clock far away": TABLE + b"1e300,1\n",
    "clock of tiny steps": b"time [s],a [um/m]\n0,1\n5e-324,2\n1e9,3\n",
    "escape signs": b"\x1b]0;own\x07,\x1b[2J\n1,2\n",
}
FILES = CSV | {
    "signature.h5": lambda tmp: b"\x89HDF\r\n\x1a\n" + RUBBISH,
    "cut.h5": lambda tmp: hdf5(tmp, good_hdf5)[:3000],
    "bomb.h5": lambda tmp: hdf5(tmp, bomb),
    "marks.uff": lambda tmp: b"    -1\n" * 100_001,
    "open.uff": lambda tmp: b"    -1\n    58\n",
    "endless dataset.uff": lambda tmp: b"    -1\n  2411\n" + b"1\n" * 100_000,
    "nameless": lambda tmp: TABLE,
}


def read(path):
    names = ["1:3"] if path.suffix in (".uff", ".ufb") else ["a"]
    recording = read_recording(path, names, time=None if names == ["1:3"] else "time")
    return assemble(recording, {names[0]: ChannelSettings("um/m")})


def refused(path):
    tracemalloc.start()
    try:
        with soon(), warnings.catch_warnings():
            warnings.simplefilter("error")
            with pytest.raises(UserError) as caught:
                read(path)
        assert tracemalloc.get_traced_memory()[1] < 200e6
    finally:
        tracemalloc.stop()
    error = caught.value
    assert error.remedy
    assert len(str(error)) < 2000
    assert str(error).replace("\n", "").isprintable()


def test_valid_files_are_accepted(tmp_path):
    for name, content in {"a.csv": TABLE, "a.h5": hdf5(tmp_path, good_hdf5)}.items():
        (tmp_path / name).write_bytes(content)
        assert np.isfinite(read(tmp_path / name).values).all()


@pytest.mark.parametrize("name", FILES)
def test_damaged_and_malicious_files(tmp_path, name):
    path = tmp_path / (f"{name}.csv" if name in CSV else name)
    path.write_bytes(FILES[name](tmp_path) if callable(FILES[name]) else FILES[name])
    refused(path)


def test_missing_file_is_refused(tmp_path):
    (tmp_path / "folder.csv").mkdir()
    for path in (tmp_path / "folder.csv", tmp_path / "none.csv", tmp_path / "none.h5", tmp_path / ("x" * 300 + ".csv")):
        refused(path)

"""Damaged MDF, TDMS and MAT files end in a UserError, and so does a library that is missing, crashes or hangs."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.measurements import reader
from strainsight.measurements.reader import read_binary

from ..refusals import expect_refusal
from .written import A, B, T, mat5, mat73, mdf, signal, tdms, waveform

pytest.importorskip("asammdf")
pytest.importorskip("nptdms")
RUBBISH = np.random.default_rng(5).bytes(100_000)
HEADS = {
    "mdf": b"MDF     4.10    ",
    "tdms": b"TDSm\x0e\0\0\0\x69\x12\0\0",
    "mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM",
}
NAMES = {"mdf": "a.mf4", "tdms": "a.tdms", "mat": "a.mat"}
FILES = {
    "a.mf4": lambda path: mdf(path, ("rig", [signal("G1"), signal("G2", B)])),
    "a.tdms": lambda path: tdms(path, {"rig/G1": waveform(), "rig/G2": waveform(B)}),
    "5.mat": lambda path: mat5(path, {"t": T, "G1": A, "G2": B}),
    "73.mat": lambda path: mat73(path, {"t": T, "G1": A, "G2": B}),
}


def kind_of(path):
    return {".mf4": "mdf", ".tdms": "tdms", ".mat": "mat"}[path.suffix]


def read(path, sandboxed=False):
    time = ("t", "s") if kind_of(path) == "mat" else (None, None)
    return read_binary(kind_of(path), path, ["G1", "G2"], time=time[0], time_unit=time[1], sandboxed=sandboxed)


def refused(path, said="", **options):
    with expect_refusal(UserError, said, remedy="") as caught:
        read(path, **options)
    assert caught.value.exit_code == 2
    assert "Traceback" not in str(caught.value)
    assert len(str(caught.value)) < 2000


CONTENTS = {"empty": b"", "rubbish": RUBBISH, "zeros": bytes(5000), "text": b"time,G1\n0,1\n" * 99}


@pytest.mark.parametrize("kind", NAMES)
@pytest.mark.parametrize("content", [*CONTENTS, "head"])
def test_wrong_file_type_is_refused(tmp_path, kind, content):
    path = tmp_path / NAMES[kind]
    path.write_bytes(CONTENTS.get(content, HEADS[kind] + RUBBISH))
    other = f"cannot be read as {kind.upper()}|not found|according to the file|incomplete"
    refused(path, "the file is empty" if content == "empty" else other)


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9, 0.995])
def test_truncated_file_is_refused(tmp_path, name, share):
    path = FILES[name](tmp_path / name)
    np.testing.assert_array_equal(read(path).channels["G1"], A)
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    refused(path)


@pytest.mark.parametrize(("kind", "package"), [("mdf", "asammdf"), ("tdms", "npTDMS")])
def test_missing_package_is_reported(tmp_path, monkeypatch, kind, package):
    monkeypatch.setattr(reader, "find_spec", lambda name: None)
    (tmp_path / NAMES[kind]).write_bytes(b"x")
    with pytest.raises(UserError, match=f"files require {package}, which is not installed") as caught:
        read_binary(kind, tmp_path / NAMES[kind], ["G1"])
    assert caught.value.remedy == 'install it: pip install "strainsight[daq]"'


def test_mat_needs_no_package(tmp_path, monkeypatch):
    monkeypatch.setattr(reader, "find_spec", lambda name: None)
    np.testing.assert_array_equal(read(FILES["5.mat"](tmp_path / "a.mat")).channels["G1"], A)


@pytest.mark.parametrize("error", [MemoryError(), RecursionError("deep"), ValueError("odd\nvalue"), KeyError()])
def test_library_errors_become_messages(tmp_path, monkeypatch, error):
    def signals(path, names):
        raise error

    monkeypatch.setattr(reader, "import_module", lambda name: SimpleNamespace(signals=signals))
    refused(
        FILES["a.tdms"](tmp_path / "a.tdms"),
        "requires more memory than is plausible" if isinstance(error, MemoryError) else "cannot be read as TDMS: ",
    )

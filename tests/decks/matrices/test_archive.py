"""An archive of some megabytes may stand for gigabytes: what it declares is weighed against memory before it is unpacked."""

from __future__ import annotations

import io
import resource
import struct
import zipfile

import numpy as np
import pytest
from scipy import sparse

from strainsight import memory
from strainsight.decks.matrices.files import read_matrix
from strainsight.errors import StrainsightError

SIDE = 1500
"""A matrix of 18 MB, which packs to 18 kB."""


@pytest.fixture
def small(monkeypatch):
    """A machine with 20 MB left, which unpacking must not touch."""
    monkeypatch.setattr(memory, "available_memory", lambda: 20e6)

    def never(*_, **__):
        pytest.fail("it was unpacked")

    monkeypatch.setattr(np.lib.npyio.NpzFile, "__getitem__", never)
    monkeypatch.setattr(sparse, "load_npz", never)


def dense(path):
    np.savez_compressed(path, np.zeros((SIDE, SIDE)))


def csr(path):
    zeros = np.zeros(SIDE * SIDE)
    parts = {"indices": zeros.astype(np.int32), "indptr": np.zeros(SIDE + 1, np.int32), "data": zeros}
    np.savez_compressed(path, format=np.bytes_("csr"), shape=np.array([SIDE, SIDE]), **parts)


@pytest.mark.parametrize("write", [dense, csr])
def test_what_memory_does_not_hold_is_not_unpacked(tmp_path, small, write):
    path = tmp_path / "k.npz"
    write(path)
    assert path.stat().st_size < 1e5
    with pytest.raises(StrainsightError, match=r"MB\) unpacks to (18|27.01) MB: .* GiB of memory are needed"):
        read_matrix(path)


def member(shape, content: bytes) -> bytes:
    """A .npy file whose header may claim what its content has not."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return stream.getvalue() + content


def archive(path, content: bytes, size: int | None = None):
    """One array; size: what both headers of the archive state in place of its true length."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.npy", content)
    if size is not None:
        raw = bytearray(path.read_bytes())
        for magic, at in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
            start = raw.index(magic) + at
            raw[start : start + 4] = struct.pack("<I", size)
        path.write_bytes(bytes(raw))
    return path


LIES = {
    "the array claims more than is there": lambda path: archive(path, member((10**6, 10**6), b"")),
    "the archive states less than there is": lambda path: archive(path, member((SIDE, SIDE), bytes(8 * SIDE**2)), 1000),
    "both headers state little": lambda path: archive(path, member((3, 3), bytes(8 * SIDE**2)), 128 + 72),
    "the archive states more": lambda path: archive(path, member((3, 3), bytes(72)), 1 << 31),
}


@pytest.mark.parametrize("lie", LIES)
def test_headers_that_lie_cost_no_memory(tmp_path, lie):
    path = LIES[lie](tmp_path / "k.npz")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(StrainsightError, match=r"k\.npz"):
        read_matrix(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 10_000  # [kB]; the content is 18 MB

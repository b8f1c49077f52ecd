"""Matrices in files and archives."""

from __future__ import annotations

import gzip
import io
import resource
import struct
import zipfile

import numpy as np
import pytest
from scipy import sparse
from scipy.io import mmwrite

from strainsight import memory
from strainsight.errors import DeckError, StrainsightError
from strainsight.foreign.matrices.files import read_matrix, read_numbering, symmetric

from ...refusals import expect_refusal


@pytest.fixture
def K() -> sparse.csr_array:
    A = sparse.random_array((8, 8), density=0.3, rng=np.random.default_rng(1))
    return sparse.csr_array(A + A.T)


def market(path, K, symmetry="general", packed=False):
    stream = io.BytesIO()
    mmwrite(stream, K, symmetry=symmetry, precision=17)
    path.write_bytes(gzip.compress(stream.getvalue()) if packed else stream.getvalue())
    return path


@pytest.mark.parametrize("symmetry", ["general", "symmetric"])
@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("name", ["k.mtx", "K.MTX", "k.mtx.gz"])
def test_matrix_market(tmp_path, K, symmetry, dense, name):
    path = market(tmp_path / name, K.toarray() if dense else K.tocoo(), symmetry, name.endswith(".gz"))
    assert np.array_equal(read_matrix(path).toarray(), K.toarray())


@pytest.mark.parametrize("form", ["csr", "csc", "coo", "dia", "bsr"])
@pytest.mark.parametrize("dtype", [float, np.float32, int])
def test_scipy_archives(tmp_path, K, form, dtype):
    K = sparse.csr_array((100 * K).astype(dtype))
    sparse.save_npz(tmp_path / "k.npz", K.asformat(form))
    assert np.array_equal(read_matrix(tmp_path / "k.npz").toarray(), K.toarray())


def test_numpy_archives_by_name(tmp_path, K):
    np.savez(tmp_path / "k.npz", K=K.toarray(), M=2 * K.toarray())
    assert np.array_equal(read_matrix(tmp_path / "k.npz", "M").toarray(), 2 * K.toarray())
    with pytest.raises(DeckError, match="2 arrays: K, M"):
        read_matrix(tmp_path / "k.npz")
    with expect_refusal(DeckError, "no array 'X'", remedy="K, M"):
        read_matrix(tmp_path / "k.npz", "X")
    np.savez(tmp_path / "one.npz", K.toarray())
    assert np.array_equal(read_matrix(tmp_path / "one.npz").toarray(), K.toarray())


def archive(tmp_path, **arrays):
    np.savez(tmp_path / "k.npz", **arrays)
    return tmp_path / "k.npz"


def compressed(tmp_path, data, indices, indptr, shape, form=b"csr"):
    return archive(tmp_path, data=data, indices=indices, indptr=indptr, shape=shape, format=np.array(form))


def text(tmp_path, content, name="k.mtx"):
    (tmp_path / name).write_bytes(content)
    return tmp_path / name


HEAD = b"%%MatrixMarket matrix coordinate real general\n"
SYMMETRIC = b"%%%%MatrixMarket matrix %s real symmetric\n"
HOSTILE = {
    "column beyond the matrix": lambda p: compressed(p, np.ones(1), np.array([10**6]), np.array([0, 1, 1]), (2, 2)),
    "offsets that fall": lambda p: compressed(p, np.ones(2), np.array([0, 1]), np.array([0, 2, 1]), (2, 2)),
    "a format of no name": lambda p: compressed(p, np.ones(1), np.array([0]), np.array([0, 1]), (1, 1), b"lil"),
    "pickled": lambda p: archive(p, a=np.array([[object()]], dtype=object)),
    "no archive": lambda p: text(p, b"PK\x03\x04 and nothing else", "k.npz"),
    "a cut archive": lambda p: text(p, archive(p, a=np.ones((9, 9))).read_bytes()[:300], "k.npz"),
    "NaN": lambda p: archive(p, a=np.array([[np.nan]])),
    "cut text": lambda p: text(p, HEAD + b"3 3 3\n1 1 1.0\n"),
    "index beyond": lambda p: text(p, HEAD + b"3 3 1\n4 1 1.0\n"),
    "absurd rows": lambda p: text(p, HEAD + b"99999999999 99999999999 1\n1 1 1.0\n"),
    "absurd entries": lambda p: text(p, HEAD + b"300000 300000 90000000000\n1 1 1.0\n"),
    "complex": lambda p: text(p, HEAD.replace(b"real", b"complex") + b"1 1 1\n1 1 1.0 1.0\n"),
    "infinite": lambda p: text(p, HEAD + b"1 1 1\n1 1 inf\n"),
    # SciPy's reader ends the process on these two.
    "a line of one number": lambda p: text(p, SYMMETRIC % b"coordinate" + b"9 9 4\n1 1 1.5\n2 1\n3 1 2\n3 3 1\n"),
    "a cut array": lambda p: text(p, SYMMETRIC % b"array" + b"9 9\n" + b"1.5\n" * 9 + b"x\n"),
    "a symmetric one that is not square": lambda p: text(p, SYMMETRIC % b"coordinate" + b"3 2 1\n1 1 1.0\n"),
    "a size of many digits": lambda p: text(p, HEAD + b"9" * 5000 + b" 1 1\n1 1 1\n"),
    "a bomb": lambda p: text(p, gzip.compress(HEAD + b"3 3 50000000\n" + b"1 1 1\n" * 10), "k.mtx.gz"),
    "empty": lambda p: text(p, b""),
    "other ending": lambda p: text(p, b"1 2 3", "k.csv"),
    "missing": lambda p: p / "none.mtx",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_invalid_matrix_is_refused(tmp_path, name):
    path = HOSTILE[name](tmp_path)
    with pytest.raises(DeckError) as caught:
        read_matrix(path)
    assert caught.value.where.startswith(str(path))
    assert caught.value.remedy


@pytest.mark.parametrize(("part", "which"), [(sparse.tril, "lower"), (sparse.triu, "upper")])
def test_triangular_matrix_is_refused(tmp_path, K, part, which):
    with pytest.raises(DeckError, match=f"only the {which} triangle"):
        symmetric(sparse.csr_array(part(K)), tmp_path)


def test_asymmetry_is_removed_or_refused(tmp_path, K):
    largest = abs(K).max()
    for off in (1e-10, 3e-8):
        X = K.tolil()
        X[2, 5] += off * largest
        if off < 1e-8:
            S, measured = symmetric(sparse.csr_array(X), tmp_path)
            assert abs(S - S.T).max() == 0
            assert measured == pytest.approx(off, rel=1e-3)
        else:
            with pytest.raises(DeckError, match=r"\(3, 6\)|\(6, 3\)") as caught:
                symmetric(sparse.csr_array(X), tmp_path)
            assert "3.0e-08" in caught.value.what
    assert symmetric(K, tmp_path)[1] == 0
    with pytest.raises(DeckError, match="8 rows and 5 columns"):
        symmetric(K[:, :5], tmp_path)


def test_a_numbering_is_nodes_and_components(tmp_path):
    (tmp_path / "rows.csv").write_text("Node, Component\n7,1\n 7 , 6\n12,3\n\n")
    node, component = read_numbering(tmp_path / "rows.csv")
    assert node.tolist() == [7, 7, 12]
    assert component.tolist() == [0, 5, 2]


@pytest.mark.parametrize(
    ("lines", "said", "line"),
    [
        ("7,1\n8,1\n", "first line is '7,1'", 1),
        ("node,component\n7,1\n7,one\n", "'one', not an integer", 3),
        ("node,component\n7,1\n1000000000000,1\n", "1000000000000, too large", 3),
        ("node,component\n7,1\n7\n", "is 1, not 2", 3),
        ("node,component\n7,7\n", "component 7", 2),
        ("node,component\n7,0\n", "scalar point", 2),
        ("node,component\n7,1\n8,1\n7,1\n", "node 7, component 1 is assigned to two matrix rows", 4),
        ("node,component\n", "write one line node,component for each matrix row", None),
    ],
)
def test_invalid_numbering_is_refused(tmp_path, lines, said, line):
    path = tmp_path / "rows.csv"
    path.write_text(lines)
    with pytest.raises(DeckError, match=said) as caught:
        read_numbering(path)
    assert caught.value.where == (f"{path}:{line}" if line else str(path))


# An archive of some megabytes may stand for gigabytes: what it declares is weighed against memory before it is unpacked.
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
def test_archive_exceeding_memory_is_refused(tmp_path, small, write):
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


def write_archive(path, content: bytes, size: int | None = None):
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
    "the array claims more than is there": lambda path: write_archive(path, member((10**6, 10**6), b"")),
    "the archive states less than there is": lambda path: write_archive(path, member((SIDE, SIDE), bytes(8 * SIDE**2)), 1000),
    "both headers state little": lambda path: write_archive(path, member((3, 3), bytes(8 * SIDE**2)), 128 + 72),
    "the archive states more": lambda path: write_archive(path, member((3, 3), bytes(72)), 1 << 31),
}


@pytest.mark.parametrize("lie", LIES)
def test_false_headers_allocate_no_memory(tmp_path, lie):
    path = LIES[lie](tmp_path / "k.npz")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(StrainsightError, match=r"k\.npz"):
        read_matrix(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 10_000  # [kB]; the content is 18 MB

"""OUTPUT4 files against pyYeti, and what is no such file."""

from __future__ import annotations

import struct
import warnings

import numpy as np
import pytest
from scipy import sparse

from strainsight.decks.matrices.op4 import read_op4
from strainsight.errors import DeckError

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning:pyyeti")


def write(path, matrices, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from pyyeti.nastran import op4
    op4.write(path, matrices, **options)


def random(rows, columns, seed=0, density=0.3):
    A = sparse.random_array((rows, columns), density=density, rng=np.random.default_rng(seed), format="lil")
    A[0, 0] = -1.25e-7
    return sparse.csr_array(A)


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("layout", ["dense", "bigmat", "nonbigmat"])
@pytest.mark.parametrize("shape", [(12, 12), (5, 17), (40, 3)])
def test_every_layout_comes_back(tmp_path, binary, layout, shape):
    A = random(*shape)
    write(tmp_path / "a.op4", {"k": A.toarray()}, binary=binary, sparse=layout, digits=16)
    assert np.allclose(read_op4(tmp_path / "a.op4").toarray(), A.toarray(), rtol=1e-15, atol=0)


@pytest.mark.parametrize("endian", ["<", ">"])
def test_both_byte_orders_are_read(tmp_path, endian):
    A = random(9, 9)
    write(tmp_path / "a.op4", {"k": A.toarray()}, binary=True, sparse="nonbigmat", endian=endian)
    assert np.array_equal(read_op4(tmp_path / "a.op4").toarray(), A.toarray())


@pytest.mark.parametrize("binary", [False, True])
def test_more_than_65535_rows_make_bigmat_whatever_the_sign_in_the_header(tmp_path, binary):
    A = sparse.csr_array(([1.0, 2.0, 3.0], ([0, 65_535, 69_999], [0, 1, 1])), shape=(70_000, 3))
    write(tmp_path / "a.op4", {"k": A.tocoo()}, binary=binary, sparse="nonbigmat", digits=16)
    assert abs(read_op4(tmp_path / "a.op4") - A).max() == 0


def test_the_formats_of_field_width_9_and_16_digits(tmp_path):
    A = random(7, 7)
    for digits in (9, 16):
        write(tmp_path / "a.op4", {"k": A.toarray()}, binary=False, digits=digits)
        assert np.allclose(read_op4(tmp_path / "a.op4").toarray(), A.toarray(), rtol=0.6 * 10.0**-digits, atol=0)


def long_integers(A, kind=2) -> bytes:
    """A binary file with 64-bit integers (ILP-64), written by hand: dense columns."""
    frame = lambda payload: struct.pack("<i", len(payload)) + payload + struct.pack("<i", len(payload))  # noqa: E731
    n, m = A.shape
    parts = [frame(struct.pack("<4q", m, n, 2, kind) + b"KAA             ")]
    parts += [frame(struct.pack("<3q", j + 1, 1, n) + A[:, j].astype("<f8").tobytes()) for j in range(m)]
    return b"".join(parts) + frame(struct.pack("<3q", m + 1, 1, 1) + struct.pack("<d", 1.0))


def test_files_with_64_bit_integers(tmp_path):
    A = random(6, 4).toarray()
    (tmp_path / "a.op4").write_bytes(long_integers(A))
    assert np.array_equal(read_op4(tmp_path / "a.op4", "kaa").toarray(), A)


TEXT = """\
       2       2       6       2KGG     1P,3E24.16
       1       1       2
  1.5000000000000000D+00 -2.5000000000000000D+00
       2       1       2
 -2.5000000000000000-101  4.0000000000000000D+00
       3       1       1
  1.0000000000000000E+00
"""


def test_fortran_writes_d_for_e_and_nothing_before_three_digits(tmp_path):
    (tmp_path / "a.op4").write_text(TEXT)
    assert read_op4(tmp_path / "a.op4").toarray().tolist() == [[1.5, -2.5e-101], [-2.5, 4.0]]


def test_one_of_several_matrices_is_taken_by_name_and_named_where_it_is_not(tmp_path):
    K, M = random(5, 5, 1), random(5, 5, 2)
    for binary in (False, True):
        write(tmp_path / "a.op4", {"kgg": K.toarray(), "mgg": M.toarray()}, binary=binary, digits=16)
        assert np.allclose(read_op4(tmp_path / "a.op4", "MGG").toarray(), M.toarray(), rtol=1e-15)
        assert np.allclose(read_op4(tmp_path / "a.op4", "kgg").toarray(), K.toarray(), rtol=1e-15)
        with pytest.raises(DeckError, match="2 matrices: KGG, MGG"):
            read_op4(tmp_path / "a.op4")
        with pytest.raises(DeckError, match="no matrix 'kaa'") as caught:
            read_op4(tmp_path / "a.op4", "kaa")
        assert "KGG, MGG" in caught.value.remedy


@pytest.mark.parametrize(
    ("change", "said", "line"),
    [
        (lambda t: t[:150], "ends within", 5),
        (lambda t: t.replace("4.0000000000000000D+00", "4.000000000000000x0D+0"), "not a number", 5),
        (lambda t: t.replace("       1       1       2", "       1       2       2"), "2 numbers from row 2 of 2", 2),
        (lambda t: t.replace("       2       1       2", "       1       1       2"), "follows column", 4),
        (lambda t: t.replace("       2       2       6", "99999999999999999999999"), "no header|no line", 1),
        (lambda t: t.replace("       2KGG", "       4KGG"), "complex", 1),
        (lambda t: t.replace("       1       1       2", "       1       1      -2"), "-2 numbers", 2),
        (lambda t: "\x00\x01\x02" * 50, "no line of an OP4 file", 1),
        (lambda t: "", "no matrix", None),
    ],
)
def test_damaged_text_is_refused_at_its_line(tmp_path, change, said, line):
    path = tmp_path / "a.op4"
    path.write_text(change(TEXT))
    with pytest.raises(DeckError, match=said) as caught:
        read_op4(path)
    assert caught.value.where == (f"{path}:{line}" if line else str(path))


def test_every_cut_of_a_binary_file_is_refused(tmp_path):
    A = random(6, 6)
    path = tmp_path / "a.op4"
    write(path, {"k": A.toarray()}, binary=True, sparse="bigmat")
    whole = path.read_bytes()
    for length in range(0, len(whole), 3):
        path.write_bytes(whole[:length])
        with pytest.raises(DeckError):
            read_op4(path)


@pytest.mark.parametrize("layout", ["dense", "bigmat", "nonbigmat"])
def test_a_binary_file_with_any_word_altered_is_refused_or_read_and_never_hangs(tmp_path, layout):
    """Large, negative and small words in every place: no loop, no allocation beyond the file."""
    path = tmp_path / "a.op4"
    write(path, {"k": random(5, 5).toarray()}, binary=True, sparse=layout)
    whole = path.read_bytes()
    refused = 0
    for at in range(0, len(whole), 4):
        for word in (-1, 0, 7, 2**31 - 1, -(2**31)):
            path.write_bytes(whole[:at] + struct.pack("<i", word) + whole[at + 4 :])
            try:
                assert max(read_op4(path).shape) <= 2**31
            except DeckError:
                refused += 1
    assert refused > 20


@pytest.mark.parametrize("name", ["k", "K"])
def test_a_name_that_two_matrices_have_is_refused(tmp_path, name):
    for matrix, path in (("k", "a.op4"), ("m", "b.op4"), ("K", "c.op4")):
        write(tmp_path / path, {matrix: np.eye(3)}, binary=True)
    content = b"".join((tmp_path / path).read_bytes() for path in ("a.op4", "b.op4", "c.op4"))
    (tmp_path / "d.op4").write_bytes(content)
    assert np.array_equal(read_op4(tmp_path / "d.op4", "m").toarray(), np.eye(3))
    with pytest.raises(DeckError, match="holds the matrix K twice") as caught:
        read_op4(tmp_path / "d.op4", name)
    assert caught.value.where == str(tmp_path / "d.op4")

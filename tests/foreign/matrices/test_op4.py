"""Matrices of Nastran (OP4) and of CalculiX."""

from __future__ import annotations

import shutil
import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble
from strainsight.foreign.matrices.files import read_matrix, read_numbering, read_op4, symmetric
from strainsight_cli.main import app

from ...refusals import expect_refusal

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
def test_op4_roundtrip_of_all_layouts(tmp_path, binary, layout, shape):
    A = random(*shape)
    write(tmp_path / "a.op4", {"k": A.toarray()}, binary=binary, sparse=layout, digits=16)
    assert np.allclose(read_op4(tmp_path / "a.op4").toarray(), A.toarray(), rtol=1e-15, atol=0)


@pytest.mark.parametrize("endian", ["<", ">"])
def test_both_byte_orders_are_read(tmp_path, endian):
    A = random(9, 9)
    write(tmp_path / "a.op4", {"k": A.toarray()}, binary=True, sparse="nonbigmat", endian=endian)
    assert np.array_equal(read_op4(tmp_path / "a.op4").toarray(), A.toarray())


@pytest.mark.parametrize("binary", [False, True])
def test_bigmat_from_65536_rows(tmp_path, binary):
    A = sparse.csr_array(([1.0, 2.0, 3.0], ([0, 65_535, 69_999], [0, 1, 1])), shape=(70_000, 3))
    write(tmp_path / "a.op4", {"k": A.tocoo()}, binary=binary, sparse="nonbigmat", digits=16)
    assert abs(read_op4(tmp_path / "a.op4") - A).max() == 0


def test_the_formats_of_field_width_9_and_16_digits(tmp_path):
    A = random(7, 7)
    for digits in (9, 16):
        write(tmp_path / "a.op4", {"k": A.toarray()}, binary=False, digits=digits)
        assert np.allclose(read_op4(tmp_path / "a.op4").toarray(), A.toarray(), rtol=0.6 * 10.0**-digits, atol=0)


def long_integers(A, kind=2) -> bytes:
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


def test_fortran_exponents_are_read(tmp_path):
    (tmp_path / "a.op4").write_text(TEXT)
    assert read_op4(tmp_path / "a.op4").toarray().tolist() == [[1.5, -2.5e-101], [-2.5, 4.0]]


def test_op4_matrix_is_selected_by_name(tmp_path):
    K, M = random(5, 5, 1), random(5, 5, 2)
    for binary in (False, True):
        write(tmp_path / "a.op4", {"kgg": K.toarray(), "mgg": M.toarray()}, binary=binary, digits=16)
        assert np.allclose(read_op4(tmp_path / "a.op4", "MGG").toarray(), M.toarray(), rtol=1e-15)
        assert np.allclose(read_op4(tmp_path / "a.op4", "kgg").toarray(), K.toarray(), rtol=1e-15)
        with pytest.raises(DeckError, match="2 matrices: KGG, MGG"):
            read_op4(tmp_path / "a.op4")
        with expect_refusal(DeckError, "no matrix 'kaa'", remedy="KGG, MGG"):
            read_op4(tmp_path / "a.op4", "kaa")


@pytest.mark.parametrize(
    ("change", "said", "line"),
    [
        (lambda t: t[:150], "the file ends inside a matrix", 5),
        (lambda t: t.replace("4.0000000000000000D+00", "4.000000000000000x0D+0"), "not a number", 5),
        (lambda t: t.replace("       1       1       2", "       1       2       2"), "column 1 of matrix KGG has 2 numbers", 2),
        (lambda t: t.replace("       2       1       2", "       1       1       2"), "follows column", 4),
        (lambda t: t.replace("       2KGG", "       4KGG"), "complex", 1),
        (lambda t: "\x00\x01\x02" * 50, "is not a valid line of an OP4 file", 1),
    ],
)
def test_damaged_text_is_refused_at_its_line(tmp_path, change, said, line):
    path = tmp_path / "a.op4"
    path.write_text(change(TEXT))
    with pytest.raises(DeckError, match=said) as caught:
        read_op4(path)
    assert caught.value.where == (f"{path}:{line}" if line else str(path))


@pytest.fixture
def job(tmp_path):
    """A deck, and the matrices that CalculiX 2.20 wrote of it: one C3D4, whose nodes 3 and 4 move."""
    for path in (Path(__file__).parent / "data").iterdir():
        shutil.copy(path, tmp_path)
    return tmp_path / "job.inp"


def test_calculix_matrices_match_deck(job):
    nodes, components = read_numbering(job.with_suffix(".dof"))
    K = read_matrix(job.with_suffix(".sti"))
    own = assemble(read_abaqus(job))[0].constant.toarray()
    at = 3 * (nodes - 1) + components
    assert np.allclose(K.toarray(), own[np.ix_(at, at)], rtol=1e-12, atol=1e-2)
    assert symmetric(K, job)[1] == 0.0
    expected = 7850 / 6 / 16 * np.equal.outer(components, components)
    assert np.allclose(read_matrix(job.with_suffix(".mas")).toarray(), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("ending", "text", "what"),
    [
        (".sti", "{}2 1 0.0\n", "both triangles"),
        (".sti", "1 1\n", "the number of values per line is 2, not 3"),
        (".sti", "1 1 1.\n1 2 x\n", r"job.sti:2.*'1 2 x' does not consist of row, column and value"),
        (".sti", "", "the file is empty"),
        (".dof", "{}5\n", r"'5' is not of the form node\.component"),
        (".dof", "{}4.2\n", "node 4, component 2 is assigned to two matrix rows"),
    ],
)
def test_invalid_calculix_matrix_is_refused(job, ending, text, what):
    path = job.with_suffix(ending)
    path.write_text(text.format(path.read_text()))
    with pytest.raises(DeckError, match=what) as caught:
        read_numbering(path) if ending == ".dof" else read_matrix(path)
    assert str(path) in str(caught.value)


def test_init_finds_matrices_of_deck(job, monkeypatch):
    monkeypatch.chdir(job.parent)
    options = ["--load", "node 4", "--direction", "0 0 1", "--amplitude", "1", "--frequency", "1"]
    assert CliRunner().invoke(app, ["init", "job.inp", *options]).exit_code == 0
    config = job.with_suffix(".yaml")
    text = config.read_text().replace("  # matrices:", "  matrices:").replace("    region: 1 ", "    # ")
    config.write_text(text)
    own = load_config(config).model.mesh.matrices
    assert own.numbering == "job.dof"
    assert [(term.file, term.parameter, term.at) for term in (*own.stiffness, *own.mass)] == [
        ("job.sti", "E", 2.1e11),
        ("job.mas", None, None),
    ]
    done = CliRunner().invoke(app, ["import", "job.yaml"])
    assert done.exit_code == 0, done.output

"""OUTPUT2 files written here record by record; pyYeti reads the same ones as an oracle of the writer."""

from __future__ import annotations

import gzip
import struct
import tracemalloc

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.foreign.results.reader import read_responses

from ...refusals import expect_refusal

MODE, STATIC, FREQUENCY, TRANSIENT, BUCKLING, COMPLEX = 2, 1, 5, 6, 8, 9
NODES = [3, 1, 20_000_001]
SHAPE = np.arange(18, dtype=float).reshape(3, 6) / 7 - 1


class Writer:
    """Words of an OUTPUT2 file: `order` and `width` as struct has them."""

    def __init__(self, order="<", width=4):
        self.order, self.width = order, width
        self.i, self.f = ("i", "f") if width == 4 else ("q", "d")

    def words(self, *values):
        return b"".join(struct.pack(self.order + (self.i if isinstance(v, int) else self.f), v) for v in values)

    def text(self, text, words):
        characters = text.ljust(4 * words)[: 4 * words].encode()
        return b"".join(characters[k : k + 4].ljust(self.width) for k in range(0, len(characters), 4))

    def fortran(self, content):
        length = struct.pack(self.order + "i", len(content))
        return length + content + length

    def key(self, value):
        return self.fortran(self.words(value))

    def logical(self, content, number, part=10**9):
        """A record of a table, in parts of so many words."""
        size = part * self.width
        parts = [content[k : k + size] for k in range(0, len(content), size)]
        body = b"".join(self.key(len(p) // self.width) + self.fortran(p) for p in parts)
        return self.key(1) + self.fortran(self.words(0)) + body + self.key(-number)

    def file(self, *blocks, head=True):
        start = [self.words(1, 2, 26), self.text("NASTRAN FORT TAPE ID CODE - ", 7), self.text("XXXXXXXX", 2)]
        begin = b"".join(self.key(len(s) // self.width) + self.fortran(s) for s in start) + self.key(-1) + self.key(0)
        return (begin if head else b"") + b"".join(blocks) + self.key(0)

    def block(self, name, *records, part=10**9):
        out = self.key(2) + self.fortran(self.text(name, 2)) + self.key(-1)
        out += self.key(7) + self.fortran(self.words(101, 0, 0, 0, 0, 0, 0)) + self.key(-2)
        records = (self.text(name, 2), *records)
        out += b"".join(self.logical(content, number, part) for number, content in enumerate(records, start=3))
        return out + self.key(1) + self.fortran(self.words(0)) + self.key(0)

    def identification(
        self, analysis, table, *, subcase=1, mode=1, eigenvalue=0.0, wide=8, code=1, thermal=0, label="", subtitle=""
    ):
        words = [0] * 50
        words[0], words[1], words[3], words[4] = 10 * analysis + 2, table, subcase, mode
        words[5], words[8], words[9], words[22] = eigenvalue, code, wide, thermal
        return self.words(*words) + self.text("the title", 32) + self.text(subtitle, 32) + self.text(label, 32)

    def rows(self, nodes=NODES, motion=SHAPE, types=None):
        types = types or [1] * len(nodes)
        return b"".join(
            self.words(10 * node + 2, kind, *map(float, u)) for node, kind, u in zip(nodes, types, motion, strict=True)
        )

    def modes(self, name="OUGV1", eigenvalues=(4.0e4, 9.0e4), **other):
        pairs = [
            (self.identification(MODE, 7, mode=k, eigenvalue=v, **other), self.rows(motion=k * SHAPE))
            for k, v in enumerate(eigenvalues, start=1)
        ]
        return self.block(name, *(record for pair in pairs for record in pair))

    def static(self, subcase=1, name="OUGV1", **other):
        rows = other.pop("rows", None) or self.rows(motion=subcase * SHAPE)
        return self.block(name, self.identification(other.pop("analysis", STATIC), 1, subcase=subcase, **other), rows)

    def lama(self, rows):
        head = self.words(*[10 * MODE, 6, 0, 1, 0, 0, 0, 0, 0, 7], *[0] * 40) + self.text("", 96)
        return self.block("LAMA", head, b"".join(self.words(k, k, float(v), 0.0, 0.0, m, 0.0) for k, v, m in rows))


def written(tmp_path, content, name="run.op2"):
    path = tmp_path / name
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize(("width", "digits"), [(4, 6e-8), (8, 1e-15)])
@pytest.mark.parametrize("head", [True, False])
def test_op2_modes_in_all_byte_orders_and_widths(tmp_path, order, width, digits, head):
    w = Writer(order, width)
    path = written(tmp_path, w.file(w.lama([(1, 4e4, 2.5), (2, 9e4, 0.5)]), w.modes(label="  MODES   OF IT "), head=head))
    first, second = read_responses(path)
    assert (first.kind, first.step, first.number, second.number) == ("mode", 1, 1, 2)
    assert first.node_ids.tolist() == NODES
    np.testing.assert_allclose(second.motion, 2 * SHAPE, rtol=digits)
    np.testing.assert_allclose([first.frequency, second.frequency], [200 / (2 * np.pi), 300 / (2 * np.pi)], rtol=1e-14)
    assert (first.modal_mass, second.modal_mass) == (2.5, 0.5)
    assert first.label == "MODES OF IT"
    assert first.along_node_axes
    assert first.rounding == pytest.approx(digits, rel=2)


def test_op2_shapes_match_pyyeti(tmp_path):
    from pyyeti.nastran.op2 import OP2

    w = Writer()
    path = written(tmp_path, w.file(w.modes(eigenvalues=(4e4, 9e4, 1.6e5))))
    with OP2(str(path)) as file:
        file.set_position("OUGV1")
        name, *_ = file.rdop2nt()
        theirs = file._rdop2ougv1(name)
    ours = list(read_responses(path))
    np.testing.assert_array_equal(theirs["ougv1"], np.stack([r.motion.ravel() for r in ours], axis=1))
    np.testing.assert_allclose(np.sqrt(theirs["lambda"]) / (2 * np.pi), [r.frequency for r in ours], rtol=1e-14)
    np.testing.assert_array_equal(theirs["dof"][::6, 0], ours[0].node_ids)


def test_a_negative_eigenvalue_is_a_negative_frequency(tmp_path):
    w = Writer()
    (mode,) = read_responses(written(tmp_path, w.file(w.modes(eigenvalues=(-4e4,)))))
    assert mode.frequency == pytest.approx(-200 / (2 * np.pi), rel=1e-14)
    assert mode.modal_mass is None


def test_subcases_are_steps(tmp_path):
    w = Writer()
    tables = [w.static(subcase, label=f"LOAD {subcase}") for subcase in (7, 8)]
    load_steps = [w.static(9, analysis=10, subtitle="nonlinear") for _ in range(3)]
    found = list(read_responses(written(tmp_path, w.file(*tables, *load_steps))))
    assert [(r.kind, r.step, r.number) for r in found] == [
        ("static", 7, 1), ("static", 8, 1), ("static", 9, 1), ("static", 9, 2), ("static", 9, 3),
    ]
    assert [r.label for r in found] == ["LOAD 7", "LOAD 8", *["nonlinear"] * 3]
    np.testing.assert_array_equal(found[1].motion, (8 * SHAPE).astype("f4"))
    assert {r.frequency for r in found} == {0.0}


@pytest.mark.parametrize(
    ("name", "node_axes"),
    [("OUGV1", True), ("OUG1", True), ("OPHIG", True), ("BOUGV1", False), ("OUGV1PAT", False), ("BOPHIG", False)],
)
def test_op2_table_name_defines_axes(tmp_path, name, node_axes):
    w = Writer()
    (found,) = read_responses(written(tmp_path, w.file(w.static(name=name))))
    assert found.along_node_axes is node_axes


def test_op2_table_name_with_pattern_suffix(tmp_path):
    """As of MSC 2014, six more words follow the two of a name, in the head of the file as well."""
    w = Writer()
    more = w.key(6) + w.fortran(w.text("LONGER NAME", 6))
    content = w.file(w.static(4, "OUG1"))
    for name in ("XXXXXXXX", "OUG1"):
        part = w.key(2) + w.fortran(w.text(name, 2)) + w.key(-1)
        assert content.count(part) == 1
        content = content.replace(part, part[: -len(w.key(-1))] + more + w.key(-1))
    (found,) = read_responses(written(tmp_path, content))
    assert found.step == 4


def test_first_of_two_op2_tables_is_used(tmp_path):
    w = Writer()
    tables = [w.modes(), w.modes("BOPHIG"), w.static(2, "BOUGV1"), w.static(2), w.static(3)]
    found = list(read_responses(written(tmp_path, w.file(*tables))))
    assert [(r.kind, r.step, r.number, r.along_node_axes) for r in found] == [
        ("mode", 1, 1, True),
        ("mode", 1, 2, True),
        ("static", 2, 1, False),
        ("static", 3, 1, True),
    ]


def test_scalar_points_are_left_out_and_counted(tmp_path):
    w = Writer()
    (found,) = read_responses(written(tmp_path, w.file(w.static(rows=w.rows(types=[1, 2, 1])))))
    assert found.node_ids.tolist() == [NODES[0], NODES[2]]
    np.testing.assert_array_equal(found.motion, SHAPE[[0, 2]].astype("f4"))
    assert found.scalar_points == 1


def test_other_op2_tables_are_skipped(tmp_path):
    w = Writer()
    velocity = w.block("OUGV1", w.identification(STATIC, 11), w.rows())
    temperature = w.static(2, thermal=1)
    psd = w.block("OUGPSD2", w.identification(FREQUENCY, 6601), w.rows())
    matrix_column = w.key(1) + w.fortran(w.words(1)) + w.key(2) + w.fortran(w.words(1, 2, 3)) + w.key(-4)
    matrix = w.block("KGG")[: -len(w.key(1) + w.fortran(w.words(0)) + w.key(0))] + matrix_column + w.key(0)
    (found,) = read_responses(written(tmp_path, w.file(velocity, temperature, psd, matrix, w.static(5))))
    assert found.step == 5


def test_records_in_parts_and_packed_files(tmp_path):
    w = Writer()
    content = w.file(w.block("OUGV1", w.identification(STATIC, 1), w.rows(), part=5))
    (whole,) = read_responses(written(tmp_path, content))
    (packed,) = read_responses(written(tmp_path, gzip.compress(content), "run.op2.gz"))
    for found in (whole, packed):
        np.testing.assert_array_equal(found.motion, SHAPE.astype("f4"))


@pytest.mark.parametrize(
    ("analysis", "table", "wide", "said"),
    [
        (FREQUENCY, 1001, 14, "a frequency response"),
        (TRANSIENT, 1, 8, "a transient response"),
        (STATIC, 1001, 14, "complex displacements"),
        (STATIC, 2001, 8, "SORT2"),
        (STATIC, 1, 14, "14 words per row"),
    ],
)
def test_other_kinds_are_refused_by_name_with_a_remedy(tmp_path, analysis, table, wide, said):
    w = Writer()
    block = w.block("OUGV1", w.identification(analysis, table, subcase=3, wide=wide), w.rows())
    path = written(tmp_path, w.file(block))
    with expect_refusal(DeckError, said, remedy="") as caught:
        list(read_responses(path))
    assert "OUGV1 of subcase 3" in caught.value.where


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nonfinite_numbers_are_refused(tmp_path, bad):
    w = Writer()
    motion = SHAPE.copy()
    motion[1, 2] = bad
    with pytest.raises(DeckError, match=r"the motion of node 1 is not finite: -0\.142857,"):
        list(read_responses(written(tmp_path, w.file(w.static(rows=w.rows(motion=motion))))))
    with pytest.raises(DeckError, match="frequency"):
        list(read_responses(written(tmp_path, w.file(w.modes(eigenvalues=(bad,))))))
    with pytest.raises(DeckError, match="the displacements of node 3 occur twice"):
        list(read_responses(written(tmp_path, w.file(w.static(rows=w.rows(nodes=[3, 1, 3]))))))


def test_truncated_op2_is_refused(tmp_path):
    w = Writer()
    parts = [w.file()[: -len(w.key(0))], w.static(1), w.static(2), w.key(0)]
    content = b"".join(parts)
    whole = {0, *np.cumsum([len(part) for part in parts]).tolist()}
    for size in range(1, len(content), 7):
        if size in whole:
            continue
        with pytest.raises(DeckError) as caught:
            list(read_responses(written(tmp_path, content[:size])))
        assert "byte" in caught.value.where or size < 4
        assert caught.value.remedy


def test_false_record_length_allocates_no_memory(tmp_path):
    w = Writer()
    content = w.file() + w.key(2**28) + struct.pack("<i", 2**30) + bytes(100)
    path = written(tmp_path, content)
    tracemalloc.start()
    with pytest.raises(DeckError, match="1073741824 bytes begins here"):
        list(read_responses(path))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 50e6


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "the file is empty"),
        (b"$TITLE = text\n" * 10, "not a binary OUTPUT2 file"),
        (struct.pack("<iii", 4, 2, 5), "a record of 4 bytes begins here, but does not end correctly"),
    ],
)
def test_wrong_file_type_is_refused(tmp_path, content, said):
    with expect_refusal(DeckError, said, remedy=""):
        list(read_responses(written(tmp_path, content)))



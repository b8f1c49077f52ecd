"""Punch files written here by the Fortran formats I10,A8,3E18.6 and A6,12X,3E18.6."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.foreign.results.reader import read_responses

from ...refusals import expect_refusal

NODES = [3, 1, 99_999_999]
SHAPE = np.arange(18, dtype=float).reshape(3, 6) / 7 - 1


def comments(quantity, *more, subcase=1, output="REAL OUTPUT", label=""):
    said = ["TITLE   = A RUN", "SUBTITLE=", f"LABEL   ={label}", quantity, output, f"SUBCASE ID ={subcase:12d}", *more]
    return [f"${line}" for line in said]


def rows(nodes=NODES, motion=SHAPE, kind="G"):
    out = []
    for node, u in zip(nodes, motion, strict=True):
        out.append(f"{node:10d}{kind:>8s}" + "".join(f"{x:18.6E}" for x in u[:3]))
        out.append(f"{'-CONT-':18s}" + "".join(f"{x:18.6E}" for x in u[3:]))
    return out


def mode(number, eigenvalue, **other):
    return comments("EIGENVECTOR", f"EIGENVALUE = {eigenvalue:14.7E}   MODE = {number:5d}", **other)


def written(tmp_path, *blocks, end="\n"):
    lines = [line for block in blocks for line in block]
    path = tmp_path / "run.pch"
    path.write_text("".join(f"{line:72s}{number:8d}{end}" for number, line in enumerate(lines, start=1)), newline="")
    return path


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_modes_have_frequency_subcase_and_number(tmp_path, end):
    path = written(tmp_path, mode(1, 4e4, subcase=2, label="FREE"), rows(), mode(2, 9e4), rows(motion=2 * SHAPE), end=end)
    first, second = read_responses(path)
    assert (first.kind, first.step, first.number, first.label) == ("mode", 2, 1, "FREE")
    assert (second.step, second.number, second.label) == (1, 2, "A RUN")
    assert first.node_ids.tolist() == NODES
    np.testing.assert_allclose(second.motion, 2 * SHAPE, rtol=first.rounding)
    np.testing.assert_allclose([first.frequency, second.frequency], [200 / 2 / np.pi, 300 / 2 / np.pi], rtol=1e-12)
    assert first.along_node_axes
    assert first.modal_mass is None


def test_punch_displacements_are_numbered_per_subcase(tmp_path):
    path = written(
        tmp_path,
        ["GRID           1               0.0     0.0     0.0"],
        comments("DISPLACEMENTS", subcase=4),
        rows(),
        comments("SPCF", subcase=4),
        rows(),
        comments("VELOCITY", subcase=4),
        rows(),
        comments("ELEMENT STRAINS", "ELEMENT TYPE =         102  BUSH", subcase=4),
        rows(),
        comments("DISPLACEMENTS", subcase=4),
        rows(motion=3 * SHAPE),
    )
    found = list(read_responses(path))
    assert [(r.kind, r.step, r.number, r.frequency) for r in found] == [("static", 4, 1, 0.0), ("static", 4, 2, 0.0)]
    np.testing.assert_allclose(found[1].motion, 3 * SHAPE, rtol=found[1].rounding)


def test_scalar_points_are_left_out_and_counted(tmp_path):
    block = [*rows(NODES[:1], SHAPE[:1]), *rows([8], SHAPE[:1], "S"), *rows(NODES[1:], SHAPE[1:])]
    (found,) = read_responses(written(tmp_path, comments("DISPLACEMENTS"), block))
    assert found.node_ids.tolist() == NODES
    assert found.scalar_points == 1


def test_an_exponent_without_its_letter_is_read(tmp_path):
    lines = rows()
    lines[2] = lines[2][:18] + f"{'1.250000-101':>18s}" + lines[2][36:]
    (found,) = read_responses(written(tmp_path, comments("DISPLACEMENTS"), lines))
    assert found.motion[1, 0] == 1.25e-101
    np.testing.assert_allclose(found.motion[2], SHAPE[2], rtol=found.rounding)


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (comments("DISPLACEMENTS", output="REAL-IMAGINARY OUTPUT"), "complex displacements"),
        (comments("DISPLACEMENTS", "FREQUENCY =   1.0000000E+01"), "a frequency response"),
        (comments("DISPLACEMENTS", "POINT ID =           1"), "SORT2"),
        (comments("EIGENVECTOR"), "EIGENVALUE and MODE"),
    ],
)
def test_other_kinds_are_refused_with_line_and_remedy(tmp_path, block, said):
    with expect_refusal(DeckError, said, where=f"run.pch:{len(block) + 1}", remedy=""):
        list(read_responses(written(tmp_path, block, rows())))


@pytest.mark.parametrize(
    ("row", "columns", "text", "said", "line"),
    [
        (0, slice(0, 10), "     three", "'three' is not a finite number", 7),
        (3, slice(18, 36), "               NaN", r"the motion of node 1 is not finite: -0\.142857,", "7, subcase 1"),
        (1, slice(0, 18), " " * 18, "the displacements of a node must have two lines", 7),
    ],
)
def test_invalid_punch_lines_are_refused(tmp_path, row, columns, text, said, line):
    lines = rows()
    lines[row] = lines[row][: columns.start] + text + lines[row][columns.stop :]
    with expect_refusal(DeckError, said, where=f":{line}"):
        list(read_responses(written(tmp_path, comments("DISPLACEMENTS"), lines)))


@pytest.mark.parametrize("content", [b"\x04\0\0\0" * 50, b"x" * 10_000])
def test_binary_punch_is_refused(tmp_path, content):
    path = tmp_path / "run.pch"
    path.write_bytes(content)
    with pytest.raises(DeckError, match="the file is not a punch file"):
        list(read_responses(path))

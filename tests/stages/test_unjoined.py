"""Decks of parts that touch: what `import` says first, and what its remedies do."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from strainsight_cli.main import app

from .test_bad_deck import CONFIG


def cubes(cells, fixed, first=1):
    """Nastran cards of cubes of the unit cell: cells of positions and edge lengths, each with nodes of its own."""
    lines = ["SOL 103", "CEND", "BEGIN BULK"]
    for n, (at, size) in enumerate(cells):
        corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
        ids = [8 * n + k + first for k in range(8)]
        lines += [
            f"GRID,{i},,{','.join(str(a + size * c) for a, c in zip(at, corner, strict=True))}"
            for i, corner in zip(ids, corners, strict=True)
        ]
        lines.append(f"CHEXA,{n + 1},1,{','.join(map(str, ids[:6]))}\n,{ids[6]},{ids[7]}")
    lines += ["PSOLID,1,1", "MAT1,1,2.1+11,,.3,7850.", f"SPC1,1,123,{','.join(map(str, fixed))}", "ENDDATA"]
    return "\n".join(lines) + "\n"


def imported(folder, deck, more=""):
    (folder / "own.bdf").write_text(deck)
    (folder / "own.yaml").write_text(CONFIG.format(file="own.bdf", more=more).replace("node: 4", "node: 7"))
    done = CliRunner(env={"COLUMNS": "4000"}).invoke(
        app, ["import", str(folder / "own.yaml"), "--results", str(folder / "results")]
    )
    return done.exit_code, " ".join(done.output.split())


PAIR = cubes([((0.0, 0.0, 0.0), 1.0), ((1.0, 0.0, 0.0), 1.0)], (1, 4, 5, 8, 10, 11))


def test_two_cubes_that_are_not_merged_are_named_and_are_one_part_with_mesh_merge(tmp_path):
    code, said = imported(tmp_path, PAIR)
    assert code == 0
    assert "8 nodes lie in the place of another that is not joined to them, as 2 and 9 at (1, 0, 0) m" in said
    assert said.index("8 nodes lie in the place") == said.index("warning") + len("warning: ")
    code, said = imported(tmp_path, PAIR, ", merge: 1.0e-6")
    assert code == 0
    assert "4 nodes became others within 1e-06 m, as 9 which is 2 now" in said
    assert "nodes lie in the place" not in said
    assert "12 nodes, 2 hex8" in said


def test_the_same_cube_twice_is_an_error_with_its_line(tmp_path):
    code, said = imported(tmp_path, cubes([((0.0, 0.0, 0.0), 1.0)] * 2, (1, 4, 5, 8)))
    assert code == 2
    assert "own.bdf:22" in said
    assert "elements 1 and 2 (hex8) lie in one place" in said


def test_a_small_cube_on_a_large_one_hangs_until_it_is_tied(tmp_path):
    deck = cubes([((0.0, 0.0, 0.0), 1.0), ((1.0, 0.25, 0.25), 0.5)], (1, 4, 5, 8, 10, 11))
    code, said = imported(tmp_path, deck)
    assert code == 0
    assert "4 nodes lie on elements that are not theirs, as 9 on element 1 at (1, 0.25, 0.25) m" in said
    deck = deck.replace("SPC1,1,123,1,4,5,8,10,11", "SPC1,1,123,1,4,5,8")
    faces = (
        ", faces: {fine: {normal: [-1, 0, 0], box: [[0.9, 0, 0], [1.1, 1, 1]]},"
        " coarse: {normal: [1, 0, 0], box: [[0.9, 0, 0], [1.1, 1, 1]]}},"
        " ties: [{type: surface, set: fine, to: coarse}]"
    )
    code, said = imported(tmp_path, deck, faces)
    assert code == 0, said
    assert "not theirs" not in said
    assert "mesh.ties.0" in said


@pytest.mark.parametrize(
    ("tie", "what"),
    [
        ("{type: surface, set: fine}", "a surface needs `to`"),
        ("{type: surface, set: fine, to: coarse, reference: 3}", "a surface has no reference node"),
        ("{type: rigid, set: fine}", "rigid needs `reference`"),
    ],
)
def test_a_tie_has_the_keys_of_its_type(tmp_path, tie, what):
    code, said = imported(tmp_path, PAIR, f", ties: [{tie}]")
    assert code == 2
    assert what in said

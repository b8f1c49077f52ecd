"""Results of CalculiX: a file that it wrote, files in its three ways to write numbers, and damaged ones."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.decks.results.reader import read_responses
from strainsight.errors import DeckError
from strainsight.fem.checks import check_geometry
from strainsight.mesh.model import CellBlock, Material, Mesh, Region

from ...frd import Found, write_frd
from ...solids import SOLIDS

COLUMN = Path(__file__).parent / "data" / "column.frd"
"""A column of two cubes of 1 m, clamped below; steps 1 and 2: 1 N along x and y on node 11 of its top; step 3: three modes."""


def test_a_file_of_calculix():
    found = list(read_responses(COLUMN))
    assert [(own.kind, own.step, own.number) for own in found] == [
        ("static", 1, 1),
        ("static", 2, 1),
        ("mode", 3, 1),
        ("mode", 3, 2),
        ("mode", 3, 3),
    ]
    assert all(own.node_ids.tolist() == list(range(1, 13)) and own.motion.shape == (12, 3) for own in found)
    assert [own.modal_mass for own in found] == [None, None, 1.0, 1.0, 1.0]
    # its eigenvalues, as its .dat has them
    assert [(2 * math.pi * own.frequency) ** 2 for own in found[2:]] == pytest.approx(
        [1.962242e6, 1.962242e6, 6.679308e6], rel=3e-7
    )
    along_x, along_y = found[0].motion, found[1].motion
    assert along_x[10, 1] == pytest.approx(along_y[10, 0], rel=1e-6)  # Maxwell and Betti
    assert not np.any(along_x[:4])
    assert along_x[10, 0] == 1.62778e-10


def test_the_mesh_of_a_file_of_calculix():
    mesh = read_mesh(COLUMN)
    assert {number: region.name for number, region in mesh.regions.items()} == {1: "S"}
    assert mesh.blocks[0].kind == "hex8"
    assert mesh.blocks[0].ids.tolist() == [1, 2]
    assert mesh.node_ids[mesh.blocks[0].nodes].tolist() == [list(range(1, 9)), list(range(5, 13))]
    assert mesh.position[10].tolist() == [1.0, 1.0, 2.0]


@pytest.mark.parametrize("kind", ["hex8", "wedge6", "tet4", "hex20", "wedge15", "tet10"])
def test_every_solid_keeps_its_nodes(kind, tmp_path):
    mesh = mesh_of(kind, SOLIDS[kind].points())
    write_frd(tmp_path / "one.frd", mesh, motions(mesh), form=3)
    again = read_mesh(tmp_path / "one.frd")
    check_geometry(again)
    assert again.blocks[0].kind == kind
    assert np.array_equal(again.node_ids[again.blocks[0].nodes], mesh.node_ids[mesh.blocks[0].nodes])
    assert np.array_equal(again.position, mesh.position)


def mesh_of(kind, position):
    n = len(position)
    return Mesh(
        node_ids=10 + np.arange(n),
        position=position,
        blocks=(CellBlock(kind, np.array([7]), np.arange(n)[None], np.array([1])),),
        regions={1: Region(1, "S", 1)},
        materials={1: Material(1, 2.1e11, 0.3, 7850.0)},
        fixed=np.zeros((0, 2), dtype=np.int64),
    )


def motions(mesh):
    rng = np.random.default_rng(1)
    n = len(mesh.position)
    size = 10.0 ** rng.integers(-12, 3, (n, 3, 5))
    values = rng.uniform(-1, 1, (n, 3, 5)) * size
    return Found(np.array([12.3456789, 45.6789012, 789.0123]), values[:, :, 2:], values[:, :, :2])


@pytest.mark.parametrize(("form", "digits"), [(1, 5e-6), (2, 6e-8), (3, 0.0)])
def test_numbers_as_text_and_binary(form, digits, tmp_path):
    mesh = mesh_of("hex8", SOLIDS["hex8"].points())
    wanted = motions(mesh)
    write_frd(tmp_path / "a.frd", mesh, wanted, form=form)
    (tmp_path / "b.frd.gz").write_bytes(gzip.compress((tmp_path / "a.frd").read_bytes()))
    for path in (tmp_path / "a.frd", tmp_path / "b.frd.gz"):
        found = list(read_responses(path))
        assert [own.kind for own in found] == ["static"] * 2 + ["mode"] * 3
        assert [own.frequency for own in found[2:]] == pytest.approx(wanted.frequency, rel=1e-9)
        values = np.concatenate([wanted.static, wanted.shapes], axis=2)
        for j, own in enumerate(found):
            assert np.array_equal(own.node_ids, mesh.node_ids)
            assert np.all(np.abs(own.motion - values[:, :, j]) <= digits * np.abs(values[:, :, j]))
            assert digits <= own.rounding


def test_a_number_that_is_wider_than_its_column(tmp_path):
    """CalculiX writes −1.23457E-100 in 13 columns of 12."""
    text = COLUMN.read_text()
    row = next(line for line in text.splitlines() if line.startswith(" -1         9 7.69237E-11"))
    (tmp_path / "a.frd").write_text(text.replace(row, row[:13] + "-7.69237E-111" + row[25:]))
    found = next(iter(read_responses(tmp_path / "a.frd")))
    assert found.motion[8, 0] == -7.69237e-111
    assert found.motion[8, 1] == 3.69008e-11
    assert found.motion[10, 0] == 1.62778e-10


def step(kind: str):
    """The file with its static steps said to be of another kind."""
    return lambda text: text.replace(
        "                     0    1           1", f"                     {kind}    1           1"
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text[: len(text) // 2], "cut off|does not end|cannot be read"),
        (lambda text: text[: text.index(" 9999")], "9999"),
        (lambda text: text.replace("7.69237E-11", "        NaN"), "finite"),
        (lambda text: text.replace("7.69237E-11", "7.6923xE-11"), "cannot be read"),
        (lambda text: text.replace(" -4  DISP        4", " -4  DISP        x"), "cannot be read"),
        (step("4"), "neither static nor a frequency step"),
        (lambda text: text.replace(f"{12:12d}{0:22d}    1", f"{13:12d}{0:22d}    1"), "cannot be read"),
    ],
)
def test_a_damaged_file_is_an_error_that_names_it(change, said, tmp_path):
    path = tmp_path / "a.frd"
    path.write_text(change(COLUMN.read_text()))
    with pytest.raises(DeckError, match=said) as caught:
        list(read_responses(path))
    assert caught.value.where.startswith(str(path))
    assert caught.value.remedy


def test_a_file_that_is_not_there_or_no_results(tmp_path):
    with pytest.raises(DeckError, match="no such file"):
        list(read_responses(tmp_path / "a.frd"))
    with pytest.raises(DeckError, match="no file of results by its name"):
        list(read_responses(tmp_path / "a.dat"))


def test_one_response_at_a_time(tmp_path):
    """The first response is there before the rest of the file is looked at: what is damaged behind it does not show."""
    text = COLUMN.read_text()
    second = text.index("    1PSTEP", text.index("    1PSTEP") + 1)
    (tmp_path / "a.frd").write_text(text[:second] + "  100CX")
    found = read_responses(tmp_path / "a.frd")
    assert next(found).step == 1
    with pytest.raises(DeckError):
        next(found)


@pytest.mark.parametrize("form", [1, 3])
def test_altered_bytes_are_an_error_or_results(form, tmp_path):
    """Never another exception: a few hundred files with bytes changed, taken out or put in."""
    mesh = mesh_of("hex8", SOLIDS["hex8"].points())
    write_frd(tmp_path / "whole.frd", mesh, motions(mesh), form=form)
    whole, path, rng = (tmp_path / "whole.frd").read_bytes(), tmp_path / "a.frd", np.random.default_rng(form)
    refused = 0
    for _ in range(300):
        at, count = int(rng.integers(len(whole))), int(rng.choice([1, 5, 80]))
        new = (bytes(rng.integers(0, 256, count, dtype=np.uint8)), b"", whole[at : at + 2 * count])[rng.integers(3)]
        path.write_bytes(whole[:at] + new + whole[at + count :])
        for read in (lambda: list(read_responses(path)), lambda: read_mesh(path)):
            try:
                read()
            except DeckError:
                refused += 1
    assert refused > 100

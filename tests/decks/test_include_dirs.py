"""A deck takes in files of its own folder, and of those that the config names, and nothing else, whatever leads there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from strainsight.cases.structure.mesh import mesh_of
from strainsight.config.mesh import MeshFile
from strainsight.errors import ConfigError, DeckError

from .abaqus.test_deck import TETRAHEDRON as ABAQUS
from .conftest import TETRAHEDRON as NASTRAN

FORMS = {
    "own.bdf": ("INCLUDE '{}'\n", NASTRAN),
    "own.inp": ("*INCLUDE, INPUT={}\n", ABAQUS),
}
"""Name of the deck → how it takes in a file, and what is in that."""


@pytest.fixture(params=FORMS)
def project(request, tmp_path):
    """config/ (the base), config/decks/own.*, and beside it bulk/parts/part, elsewhere/part; → what reads the deck with a name
    in its line, and the line."""
    line, content = FORMS[request.param]
    for folder in ("config/decks", "bulk/parts", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    for folder in ("bulk/parts", "elsewhere"):
        (tmp_path / folder / "part").write_text(content)
    deck = tmp_path / "config" / "decks" / request.param

    def read(name: str, *dirs: str):
        deck.write_text(line.format(name))
        base = tmp_path / "config"
        return mesh_of(MeshFile(file=f"decks/{deck.name}", include_dirs=dirs), deck, base=base)

    return read, line


def test_a_file_of_a_folder_that_is_named_is_read_and_an_input(project, tmp_path):
    for name in ("../../bulk/parts/part", str(tmp_path / "bulk" / "parts" / "part")):
        for dirs in (["../bulk"], ["../elsewhere", "../bulk/parts"], [str(tmp_path / "bulk")]):
            mesh = project[0](name, *dirs)
            assert list(mesh.node_ids) == [1, 2, 3, 4]
            assert [own.rsplit("/", 1)[-1] for own in mesh.included] == ["part"]


@pytest.mark.parametrize("dirs", [(), ("../elsewhere",), ("../bul",), ("decks",)])
def test_no_other_folder_is_read(project, tmp_path, dirs):
    (tmp_path / "bul").mkdir()  # the beginning of a name is no folder above it
    with pytest.raises(DeckError, match="leaves the folder of the deck") as caught:
        project[0]("../../bulk/parts/part", *dirs)
    assert f"name its folder, {tmp_path}/bulk/parts, as seen from the config" in caught.value.remedy
    assert caught.value.remedy.endswith("mesh.include_dirs: [FOLDER]")
    assert caught.value.where.endswith(":1")


def test_neither_dots_nor_links_lead_out_of_it(project, tmp_path):
    (tmp_path / "bulk" / "link").symlink_to(tmp_path / "elsewhere" / "part")
    (tmp_path / "bulk" / "folder").symlink_to(tmp_path / "elsewhere")
    for name in ("../../bulk/../elsewhere/part", "../../bulk/link", "../../bulk/folder/part"):
        with pytest.raises(DeckError, match=r"leaves the folder of the deck and those of mesh\.include_dirs"):
            project[0](name, "../bulk")
    (tmp_path / "to_bulk").symlink_to(tmp_path / "bulk")  # a link that the config names is meant
    assert list(project[0]("../../bulk/parts/part", "../to_bulk").node_ids) == [1, 2, 3, 4]


def test_a_file_that_is_taken_in_is_held_to_the_same_folders(project, tmp_path):
    read, line = project
    (tmp_path / "bulk" / "more").write_text(line.format("../elsewhere/part"))
    with pytest.raises(DeckError, match="leaves the folder") as caught:
        read("../../bulk/more", "../bulk")
    assert caught.value.where.endswith("more:1")
    assert len(read("../../bulk/more", "../bulk", "../elsewhere").node_ids) == 4


def test_a_name_is_relative_to_the_file_to_the_deck_or_to_the_folders(project, tmp_path):
    read, line = project
    more = tmp_path / "bulk" / "parts" / "more"
    for name, folder in (("part", "bulk/parts"), ("beside", "config/decks"), ("parts/part", "bulk"), ("elsewhere/part", "")):
        more.write_text(line.format(name))
        if name == "beside":
            (tmp_path / folder / name).write_text((tmp_path / "elsewhere" / "part").read_text())
        mesh = read("../../bulk/parts/more", "../bulk", "..")
        assert (tmp_path / folder / name).resolve() in [(tmp_path / own).resolve() for own in mesh.included]
        assert not mesh.doubts
    more.write_text(line.format("nowhere"))
    with pytest.raises(DeckError, match="no such file"):
        read("../../bulk/parts/more", "../bulk")


NAMES = [
    ("own.bdf", "part", "sub"),  # MSC and NX Nastran: a name alone is beside the file that includes it,
    ("own.bdf", "sub/part", "."),  # a path begins at the deck
    ("own.fem", "part", "sub"),  # OptiStruct: all at the file
    ("own.fem", "sub/part", "sub"),
    ("own.inp", "part", "."),  # Abaqus and CalculiX: all where the job is started
    ("own.inp", "sub/part", "."),
]


@pytest.mark.parametrize(("deck", "name", "base"), NAMES)
def test_of_two_files_of_a_name_the_one_counts_that_the_program_takes(tmp_path, deck, name, base):
    """Node 4 of the two files is at another place; the deck includes sub/more, which includes the name."""
    line, content = FORMS["own.inp" if deck.endswith("inp") else "own.bdf"]
    (tmp_path / "sub" / "sub").mkdir(parents=True)
    for folder, z in ((".", "2."), ("sub", "3.")):
        (tmp_path / folder / name).write_text(re.sub(r"(\n(?:GRID,)?4,.*,) *1\.?\n", rf"\g<1>{z}\n", content))
    (tmp_path / "sub" / "more").write_text(line.format(name))
    (tmp_path / deck).write_text(line.format("sub/more"))
    mesh = mesh_of(MeshFile(file=deck), tmp_path / deck, base=tmp_path)
    assert mesh.position[3, 2] == (2.0 if base == "." else 3.0)
    (doubt,) = (own for own in mesh.doubts if "INCLUDE" in own)
    assert f"{(tmp_path / base / name).resolve()} was read" in doubt
    (tmp_path / "sub" / name).unlink()
    assert not [own for own in mesh_of(MeshFile(file=deck), tmp_path / deck, base=tmp_path).doubts if "INCLUDE" in own]


def test_paths_of_windows_are_read(project, tmp_path):
    read, _ = project
    (tmp_path / "config" / "decks" / "Sub").mkdir()
    part = tmp_path / "config" / "decks" / "Sub" / "Part.txt"
    part.write_text((tmp_path / "elsewhere" / "part").read_text())
    for name, noted in (("Sub\\Part.txt", False), (".\\Sub\\Part.txt", False), ("SUB/part.TXT", True), ("sub\\PART.txt", True)):
        mesh = read(name)
        assert [Path(own).resolve() for own in mesh.included] == [part.resolve()]
        assert any("other capitals" in note for note in mesh.notes) == noted
    odd = tmp_path / "config" / "decks" / "Sub\\Part.txt"  # a file whose name has a backslash is that file
    odd.write_text(part.read_text())
    assert [Path(own).resolve() for own in read("Sub\\Part.txt").included] == [odd.resolve()]


def test_a_folder_that_is_not_there_is_named_with_its_key(project):
    with pytest.raises(ConfigError, match="no such folder") as caught:
        project[0]("part", "../bulk", "../none")
    assert caught.value.key == "mesh.include_dirs"

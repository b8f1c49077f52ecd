"""A deck takes in files of its own folder, and of those that the config names, and nothing else, whatever leads there."""

from __future__ import annotations

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


def test_a_name_is_seen_from_the_file_then_from_the_deck_then_from_the_folders(project, tmp_path):
    read, line = project
    more = tmp_path / "bulk" / "parts" / "more"
    for name, folder in (("part", "bulk/parts"), ("beside", "config/decks"), ("parts/part", "bulk"), ("elsewhere/part", "")):
        more.write_text(line.format(name))
        if name == "beside":
            (tmp_path / folder / name).write_text((tmp_path / "elsewhere" / "part").read_text())
        mesh = read("../../bulk/parts/more", "../bulk", "..")
        assert (tmp_path / folder / name).resolve() in [(tmp_path / own).resolve() for own in mesh.included]
    more.write_text(line.format("nowhere"))
    with pytest.raises(DeckError, match="no such file"):
        read("../../bulk/parts/more", "../bulk")


def test_a_folder_that_is_not_there_is_named_with_its_key(project):
    with pytest.raises(ConfigError, match="no such folder") as caught:
        project[0]("part", "../bulk", "../none")
    assert caught.value.key == "mesh.include_dirs"

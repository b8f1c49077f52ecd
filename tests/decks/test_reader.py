"""Units, formats, included files and the order of nodes, in every format."""

from __future__ import annotations

import gzip
import re
from pathlib import Path

import meshio
import numpy as np
import pytest

from strainsight.config.mesh import MeshFile
from strainsight.decks.reader import format_of, read_mesh
from strainsight.errors import ConfigError, DeckError, UserError
from strainsight.experiment.structure.mesh import mesh_of
from strainsight.mesh.assigned_sections import GivenSection
from strainsight.mesh.sanity import sanity_warnings
from strainsight.mesh.thin import ShellSection
from strainsight.mesh.units import LENGTH, MASS, length_factor, mass_factor

from ..refusals import expect_refusal
from ..solids import SOLIDS
from .abaqus.test_deck import TETRAHEDRON as ABAQUS
from .conftest import TETRAHEDRON as NASTRAN


def deck(path, length, E, rho, mass):
    path.write_text(
        f"GRID,1\nGRID,2,,{length}\nGRID,3,,,{length}\nGRID,4,,,,{length}\nCTETRA,10,1,1,2,3,4\nPSOLID,1,1\n"
        f"MAT1,1,{E},,.3,{rho}\nSPC1,1,123,1,2,3\nCONM2,90,4,,{mass}\n"
    )
    return path


@pytest.mark.parametrize(
    ("length_unit", "mass_unit", "length", "E", "rho", "mass"),
    [
        ("m", "kg", "1.", "2.1e11", "7850.", "3."),
        ("mm", "t", "1000.", "2.1e5", "7.85e-9", "3.e-3"),
        ("mm", "kg", "1000.", "2.1e8", "7.85e-6", "3."),
        ("cm", "g", "100.", "2.1e12", "7.85", "3000."),
        ("in", "lbf*s2/in", "39.37007874015748", "30457924.9", "7.345374e-4", "0.01713044"),
        ("ft", "slug", "3.280839895013123", "4385941183.", "15.2315", "0.2055653"),
    ],
)
def test_results_are_independent_of_units(tmp_path, length_unit, mass_unit, length, E, rho, mass):
    mesh = read_mesh(deck(tmp_path / "a.bdf", length, E, rho, mass), length_unit, mass_unit)
    material = mesh.materials[1]
    np.testing.assert_allclose(mesh.position[1:], np.eye(3), rtol=1e-14)
    assert material.youngs_modulus == pytest.approx(2.1e11, rel=1e-6)
    assert material.density == pytest.approx(7850, rel=1e-5)
    assert material.poisson_ratio == 0.3
    assert mesh.point_masses[0].mass == pytest.approx(3.0, rel=1e-6)
    assert sanity_warnings(mesh) == ()


def test_pound_units_follow_from_the_international_pound_and_standard_gravity():
    pound_force = 0.45359237 * 9.80665
    assert MASS["slug"] == pytest.approx(pound_force / 0.3048, rel=1e-15)
    assert MASS["lbf*s2/in"] == pytest.approx(pound_force / 0.0254, rel=1e-15)
    assert LENGTH["ft"] == pytest.approx(12 * LENGTH["in"])


@pytest.mark.parametrize(
    ("function", "unit", "key", "hint"),
    [
        (length_factor, "mmm", "mesh.length_unit", "Did you mean 'mm'"),
        (length_factor, "parsec", "mesh.length_unit", "Use one of the units m, "),
        (mass_factor, "kgs", "mesh.mass_unit", "Did you mean 'kg'"),
    ],
)
def test_unknown_unit_lists_known_units(function, unit, key, hint):
    with expect_refusal(UserError, "unknown unit", remedy=hint, key=key):
        function(unit)


@pytest.mark.parametrize(
    ("name", "text", "format"),
    [
        ("a.bdf", "GRID,1\n", "nastran"),
        ("a.BDF.gz", "", "nastran"),
        ("a.fem", "", "nastran"),
        ("a.inp", "*NODE\n", "abaqus"),
        ("a.msh", "$MeshFormat\n2.2 0 8\n", "gmsh"),
        ("a.msh", '(0 "Fluent")\n', "meshio"),
        ("a.vtu", "<VTKFile>", "meshio"),
        ("hub.v2.dat", "GRID,1\n", "nastran"),
        ("nothing", "", "meshio"),
    ],
)
def test_file_ending_selects_reader(tmp_path, name, text, format):
    (tmp_path / name).write_text(text)
    assert format_of(tmp_path / name) == format


def test_format_setting_overrides_ending(tmp_path):
    path = deck(tmp_path / "a.txt", "1.", "2.1e11", "7850.", "0.")
    assert len(read_mesh(path, format="nastran").node_ids) == 4


SHELLS = {
    "a.bdf": "GRID,1\nGRID,2,,1.\nGRID,3,,1.,1.\nGRID,4,,,1.\nCQUAD,7,1,1,2,3,4\n",
    "a.inp": "*NODE\n1,0,0,0\n2,1,0,0\n3,1,1,0\n4,0,1,0\n*ELEMENT,TYPE=S9R5\n7,1,2,3,4\n",
    "a.msh": "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
    "$Elements\n1\n7 3 2 1 1 1 2 3 4\n$EndElements\n",
    "a.vtk": "# vtk DataFile Version 3.0\nshell\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n"
    "0 0 0\n1 0 0\n1 1 0\n0 1 0\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n9\n",
}


@pytest.mark.parametrize("name", SHELLS)
def test_shell_deck_is_read_without_required_solids(tmp_path, name):
    (tmp_path / name).write_text(SHELLS[name])
    with pytest.raises(DeckError, match="contains no solid"):
        read_mesh(tmp_path / name)
    mesh = read_mesh(tmp_path / name, solids=False)
    assert mesh.node_ids.tolist() == [1, 2, 3, 4]
    assert mesh.blocks == ()


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(DeckError, match="no such file"):
        read_mesh(tmp_path / "none.bdf")
    with pytest.raises(DeckError, match="not a file"):
        read_mesh(tmp_path)


GMSH = SHELLS["a.msh"].replace("7 3 2 1 1 1 2 3 4", "7 4 2 1 1 1 2 4 3").replace("3 1 1 0", "3 0 0 1")


@pytest.mark.parametrize("name", ["part.msh.gz", "PART.MSH.GZ"])
def test_compressed_gmsh_mesh_is_read(tmp_path, name):
    (tmp_path / name).write_bytes(gzip.compress(GMSH.encode()))
    mesh = read_mesh(tmp_path / name)
    assert mesh.blocks[0].kind == "tet4"
    assert mesh.where("node", 4) == f"{tmp_path / name}:9"
    (tmp_path / name).write_bytes(gzip.compress(GMSH.encode())[:-20])
    with pytest.raises(DeckError, match="cannot be unpacked"):
        read_mesh(tmp_path / name, format="gmsh")


@pytest.mark.parametrize("name", ["part.vtu.gz", "part.med.gz"])
def test_other_compressed_meshes_are_refused(tmp_path, name):
    (tmp_path / name).write_bytes(gzip.compress(b"<VTKFile>"))
    with expect_refusal(DeckError, "compressed", remedy="unpack the mesh"):
        read_mesh(tmp_path / name)


@pytest.mark.parametrize(("name", "line"), [("part.bdf.gz", b"$ a comment\n" * 85), ("part.inp.gz", b"\0" * 1024)])
def test_decompression_bomb_is_refused(tmp_path, name, line):
    with gzip.open(tmp_path / name, "wb", compresslevel=1) as file:
        for _ in range(90):
            file.write(line * 1024)
    with pytest.raises(DeckError, match="the unpacked file is more than 100 times larger") as caught:
        read_mesh(tmp_path / name)
    assert caught.value.where.startswith(str(tmp_path / name))


# A deck takes in files of its own folder, and of those that the config names, and nothing else, whatever leads there.
FORMS = {"own.bdf": ("INCLUDE '{}'\n", NASTRAN), "own.inp": ("*INCLUDE, INPUT={}\n", ABAQUS)}
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


def test_include_dirs_files_are_inputs(project, tmp_path):
    for name in ("../../bulk/parts/part", str(tmp_path / "bulk" / "parts" / "part")):
        for dirs in (["../bulk"], ["../elsewhere", "../bulk/parts"], [str(tmp_path / "bulk")]):
            mesh = project[0](name, *dirs)
            assert list(mesh.node_ids) == [1, 2, 3, 4]
            assert [own.rsplit("/", 1)[-1] for own in mesh.included] == ["part"]


@pytest.mark.parametrize("dirs", [(), ("../elsewhere",), ("../bul",), ("decks",)])
def test_include_outside_folders_is_refused(project, tmp_path, dirs):
    (tmp_path / "bul").mkdir()  # the beginning of a name is no folder above it
    with pytest.raises(DeckError, match="the folder of the deck") as caught:
        project[0]("../../bulk/parts/part", *dirs)
    assert f"add its folder {tmp_path}/bulk/parts to the list" in caught.value.remedy
    assert caught.value.remedy.endswith("mesh.include_dirs (relative to the config file)")
    assert caught.value.where.endswith(":1")


def test_dots_and_links_cannot_leave_folders(project, tmp_path):
    (tmp_path / "bulk" / "link").symlink_to(tmp_path / "elsewhere" / "part")
    (tmp_path / "bulk" / "folder").symlink_to(tmp_path / "elsewhere")
    for name in ("../../bulk/../elsewhere/part", "../../bulk/link", "../../bulk/folder/part"):
        with pytest.raises(DeckError, match="move the included file into the folder of the deck or below it, or add its"):
            project[0](name, "../bulk")
    (tmp_path / "to_bulk").symlink_to(tmp_path / "bulk")  # a link that the config names is meant
    assert list(project[0]("../../bulk/parts/part", "../to_bulk").node_ids) == [1, 2, 3, 4]


def test_nested_includes_obey_folders(project, tmp_path):
    read, line = project
    (tmp_path / "bulk" / "more").write_text(line.format("../elsewhere/part"))
    with expect_refusal(DeckError, "move the included file into the folder of the deck or below it, or add its", where="more:1"):
        read("../../bulk/more", "../bulk")
    assert len(read("../../bulk/more", "../bulk", "../elsewhere").node_ids) == 4


def test_include_names_are_resolved_in_order(project, tmp_path):
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
def test_ambiguous_include_follows_program(tmp_path, deck, name, base):
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
    assert f"{(tmp_path / base / name).resolve()}, but" in doubt
    (tmp_path / "sub" / name).unlink()
    assert not [own for own in mesh_of(MeshFile(file=deck), tmp_path / deck, base=tmp_path).doubts if "INCLUDE" in own]


def test_windows_paths_are_read(project, tmp_path):
    read, _ = project
    (tmp_path / "config" / "decks" / "Sub").mkdir()
    part = tmp_path / "config" / "decks" / "Sub" / "Part.txt"
    part.write_text((tmp_path / "elsewhere" / "part").read_text())
    for name, noted in (("Sub\\Part.txt", False), (".\\Sub\\Part.txt", False), ("SUB/part.TXT", True), ("sub\\PART.txt", True)):
        mesh = read(name)
        assert [Path(own).resolve() for own in mesh.included] == [part.resolve()]
        assert any("differ in upper and lower case" in note for note in mesh.notes) == noted
    odd = tmp_path / "config" / "decks" / "Sub\\Part.txt"  # a file whose name has a backslash is that file
    odd.write_text(part.read_text())
    assert [Path(own).resolve() for own in read("Sub\\Part.txt").included] == [odd.resolve()]


def test_missing_include_folder_is_refused(project):
    with expect_refusal(ConfigError, "folder not found", key="mesh.include_dirs"):
        project[0]("part", "../bulk", "../none")


RING = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
SECOND_ORDER = {
    "tetra10": (SOLIDS["tet10"].points(), 4),
    "hexahedron20": (SOLIDS["hex20"].points(), 8),
    "quad8": (np.vstack([RING, (RING + np.roll(RING, -1, axis=0)) / 2]), 4),
    "triangle6": (np.vstack([RING[:3], (RING[:3] + np.roll(RING[:3], -1, axis=0)) / 2]), 3),
}
"""Cell of meshio → nodes of one element, and how many of them are corners."""


@pytest.mark.parametrize("cell", SECOND_ORDER)
def test_wrong_mid_side_order_is_refused(tmp_path, cell):
    x, corners = SECOND_ORDER[cell]
    order = np.arange(len(x))
    sections = {"mesh.sections.skin": GivenSection(None, ShellSection(0.01))} if corners < 8 and not np.any(x[:, 2]) else None

    def read(cells):
        meshio.write(tmp_path / "part.vtu", meshio.Mesh(np.vstack([x, x + np.array([3.0, 0, 0])]), [(cell, cells)]))
        return read_mesh(tmp_path / "part.vtu", solids=sections is None, materials=False, sections=sections)

    assert len(read(np.stack([order, order + len(x)])).elements) == 1
    rolled = np.r_[order[:corners], np.roll(order[corners:], 1)]
    with pytest.raises(DeckError, match=r"in all .* The node order differs") as caught:
        read(np.stack([rolled, rolled + len(x)]))
    assert "merge" not in caught.value.remedy

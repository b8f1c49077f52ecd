"""Meshes of gmsh in all of its formats; damaged ones are refused."""

from __future__ import annotations

import struct

import meshio
import numpy as np
import pytest

from strainsight.decks.gmsh.mesh import read_gmsh
from strainsight.errors import DeckError

from ...refusals import expect_refusal, refusal_table
from .conftest import DATA, FORMER, NEW, OLD, REAL, check_same


def test_all_gmsh_formats_give_same_mesh():
    meshes = [read_gmsh(path) for path in REAL]
    assert len(meshes) == 4
    for mesh in meshes[1:]:
        check_same(mesh, meshes[0])


def test_gmsh_volumes_match_geometry():
    mesh = read_gmsh(REAL[0])
    (block,) = mesh.blocks
    x = mesh.position[block.nodes[:, :4]]
    volume = np.linalg.det(x[:, 1:] - x[:, :1]) / 6
    found = {mesh.regions[int(i)].name: volume[block.region == i].sum() for i in np.unique(block.region)}
    assert found == pytest.approx({"block": 1.0, "pin": 0.25}, rel=1e-12)
    foot = np.isin(mesh.node_ids, mesh.node_sets["foot"])
    np.testing.assert_array_equal(foot, mesh.position[:, 2] < 1e-9)
    assert {k: len(v) for k, v in mesh.element_sets.items()} == {
        "block": np.count_nonzero(block.region == 7),
        "pin": np.count_nonzero(block.region == 3),
    }


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_connectivity_matches_meshio(path):
    mesh, other = read_gmsh(path), meshio.read(path)
    expected = np.concatenate([other.points[b.data] for b in other.cells if b.type == "tetra10"])
    own = mesh.position[np.concatenate([b.nodes for b in mesh.blocks])]
    keys = [np.lexsort(x.mean(axis=1).round(9).T) for x in (own, expected)]
    np.testing.assert_allclose(own[keys[0]], expected[keys[1]], atol=1e-15)


@pytest.mark.parametrize("text", [OLD, NEW, FORMER], ids=["2.2", "4.1", "4.0"])
def test_numbers_groups_and_lines_of_the_file_are_kept(read, text):
    mesh = read(text)
    assert mesh.node_ids.tolist() == [10, 7, 30, 4, 5]
    assert mesh.position[mesh.node_index(5)].tolist() == [1, 1, 1]
    (block,) = mesh.blocks
    assert (block.kind, block.ids.tolist(), block.region.tolist()) == ("tet4", [6, 8], [9, 9])
    assert mesh.node_ids[block.nodes[1]].tolist() == [7, 30, 4, 5]
    assert (mesh.regions[9].name, mesh.regions[9].material) == ("steel part", 0)
    assert {k: v.tolist() for k, v in mesh.node_sets.items()} == {"foot": [7, 10, 30], "steel part": [4, 5, 7, 10, 30]}
    assert {k: v.tolist() for k, v in mesh.element_sets.items()} == {"steel part": [6, 8]}
    lines = text.splitlines()
    for kind, number, entry in (("node", 30, "0 1 0"), ("element", 8, "7 30 4 5")):
        assert entry in lines[int(mesh.where(kind, number).rpartition(":")[2]) - 1]
    assert (mesh.notes, mesh.ignored) == ((), {})


def test_windows_line_ends_and_blank_lines_change_nothing(read):
    check_same(read(OLD.replace("\n", "\r\n")), read(OLD))
    check_same(read(NEW.replace("\n", "\n\n")), read(NEW))


@pytest.mark.parametrize("order", "<>")
def test_both_byte_orders_of_binary(read, order):
    def section(name, body):
        return b"$" + name + b"\n" + body + b"\n$End" + name + b"\n"

    def pack(form, *values):
        return struct.pack(order + form, *values)

    x = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    rows = b"".join(pack("iddd", i, *p) for i, p in enumerate(x, 1))
    elements = b"1\n" + pack("iii", 4, 1, 2) + pack("7i", 6, 9, 1, 1, 2, 3, 4)
    mesh = read(
        section(b"MeshFormat", b"2.2 1 8\n" + pack("i", 1))
        + section(b"Nodes", b"4\n" + rows)
        + section(b"Elements", elements)
    )
    np.testing.assert_array_equal(mesh.position, x)
    assert (mesh.blocks[0].ids.tolist(), mesh.blocks[0].region.tolist()) == ([6], [9])


def test_parametric_nodes_are_read(read):
    parametric = NEW.replace("2 1 0 3\n", "2 1 1 3\n")
    for row in ("0 0 0\n", "1 0 0\n", "0 1 0\n"):
        parametric = parametric.replace("\n" + row, "\n" + row[:-1] + " 0.5 0.25\n", 1)
    check_same(read(parametric), read(NEW))
    old = OLD.replace("Nodes", "ParametricNodes")
    parameters = {"10 0 0 0": "0 1", "7 1 0 0": "1 5 0.5", "30 0 1 0": "2 5 0.5 0.25", "4 0 0 1": "3 1", "5 1 1 1": "3 1"}
    for node, more in parameters.items():
        old = old.replace(f"\n{node}\n", f"\n{node} {more}\n")
    check_same(read(old), read(OLD))


REPEATED = OLD.replace("$Elements\n3", "$Elements\n4").replace("$EndEl", "9 4 2 3 2 7 30 4 5\n$EndEl")
GROUPS = {
    # text, regions of the two solids, sets, names of regions, note
    "an entity in two volumes is in both sets and the lower region": (
        NEW.replace("2 0 0 0 1 1 1 1 9 0", "2 0 0 0 1 1 1 2 9 -3 0"), [9, 3], {"3d-3": [8], "steel part": [6, 8]},
        {3: "volume 3", 9: "steel part"}, "elements in several physical volumes (1 in total, for example in the volumes 3, 9)",
    ),
    "an element that format 2 repeats for its second group counts once": (
        REPEATED, [3, 9], {"3d-3": [9], "steel part": [6, 9]}, {3: "volume 3", 9: "steel part"}, "element 8 repeats element 9",
    ),
    "without volumes all is one region": (
        OLD.replace("4 2 9 1", "4 2 0 1").replace("4 2 9 2", "4 0"), [1, 1], {}, {1: "solids"}, "no physical volumes",
    ),
    "elements outside all volumes are a region of their own": (
        OLD.replace("4 2 9 2", "4 2 0 2"), [10, 9], {"steel part": [6]}, {9: "steel part", 10: "no physical volume"},
        "elements in no physical volume (1 in total) are assigned to region 10",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", GROUPS)
def test_physical_volumes_are_regions_and_sets(read, name):
    text, regions, sets, names, note = GROUPS[name]
    mesh = read(text)
    assert mesh.blocks[0].region.tolist() == regions
    assert {k: v.tolist() for k, v in mesh.element_sets.items()} == sets
    assert {i: region.name for i, region in mesh.regions.items()} == names
    assert any(note in text for text in mesh.notes)


def test_sections_that_are_not_imported_are_counted(read):
    extra = "$Comments\n$Nodes are below\n$EndComments\n" + OLD + '$NodeData\n1\n"u"\n0\n0\n$EndNodeData\n'
    assert read(extra).ignored == {"$NodeData": 1}
    check_same(read(extra), read(OLD))


test_errors_have_line = refusal_table(str.replace, [
    (OLD, "7 30 4 5\n", "7 30 4 6\n", r"element 8 \(4-node tetrahedron\) refers to the missing node 6", 21),
    (OLD, "\n4 0 0 1", "\n7 0 0 1", "node id 7 is used twice", 14),
    (OLD, "2 7 30 4 5", "2 10 30 4 7", r"element 8 \(tet4\) has the same nodes as element 6 \(tet4\) at ", 21),
    (OLD, "2 7 30 4 5", "2 7 30 4 4", r"element 8 \(tet4\): the element has the same node twice", 21),
    (OLD, "5 1 1 1", "5 1 nan 1", "node 5 has a coordinate that is not a finite", 15),
    (OLD, "7 1 0 0", "7 1 O 0", "'O' is not a number", 12),
    (OLD, "$Nodes\n5", "$Nodes\n900000000000", "more numbers, but contains only", 11),
    (OLD, "$Elements\n3", "$Elements\n4", "declares 4 elements, but contains only 3", 21),
    (NEW, "2 5 4 30", "2 6 4 30", "declares 6 nodes, but its blocks contain 5", ""),
    (OLD, "8 4 2 9", "8 77 2 9", "element type 77 is unknown", 21),
    (OLD, "Nodes", "Knots", r"the section \$Nodes is missing", 1),
    (OLD, OLD, "$NOD\n0\n$ENDNOD\n", "gmsh format 1", 1),
    (NEW, "$Nodes", "$PartitionedEntities\n2\n$EndPartitionedEntities\n$Nodes", "is partitioned", ""),
    (OLD, '3 9 "', "9" * 5000 + ' 9 "', r"\$PhysicalNames:", ""),
    (OLD, '"foot"', "foot", r"\$PhysicalNames:", 6),
])


@pytest.mark.parametrize(
    ("number", "nodes", "name", "remedy"),
    [
        (12, 27, "27-node hexahedron", "Mesh.SecondOrderIncomplete = 1"),
        (14, 14, "14-node pyramid", "avoid pyramids"),
        (29, 20, "20-node tetrahedron", "Mesh.ElementOrder = 2"),
    ],
)
def test_unsupported_solids_are_refused_with_remedy(read, number, nodes, name, remedy):
    extra = f"17 {number} 0 " + " ".join(["10"] * nodes)
    with expect_refusal(DeckError, name, remedy=remedy) as error:
        read(OLD.replace("$Elements\n3", "$Elements\n4").replace("$EndEl", extra + "\n$EndEl"))
    assert "element 17" in error.value.what


def test_a_mesh_of_surfaces_is_refused(read):
    with expect_refusal(DeckError, r"the mesh contains no solid elements \(1 3-node triangle\)", remedy="gmsh -3"):
        read(OLD.replace("$Elements\n3", "$Elements\n1").replace("\n6 4 2 9 1 10 7 30 4\n8 4 2 9 2 7 30 4 5", ""))


def test_binary_counts_beyond_the_file_are_refused(read):
    content = (DATA / "pin-4.1-binary.msh").read_bytes()
    at = content.index(b"$Nodes\n") + len(b"$Nodes\n") + 4 * 8 + 3 * 4
    for claimed in (2**40, 2**62, 2**64 - 1):
        with pytest.raises(DeckError, match=r"\$Nodes: .*(expected|exceeds|more entries)"):
            read(content[:at] + struct.pack("<Q", claimed) + content[at + 8 :])

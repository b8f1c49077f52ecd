"""What is wrong with a gmsh mesh is named with its line."""

from __future__ import annotations

import struct

import pytest

from strainsight.errors import DeckError

from .conftest import DATA, NEW, OLD, REAL

BROKEN = {
    "missing node": (OLD, "7 30 4 5\n", "7 30 4 6\n", 21, "element 8 (4-node tetrahedron) refers to node 6"),
    "missing node of a face": (OLD, "1 10 7 30\n6", "1 10 7 31\n6", 19, "refers to node 31"),
    "missing node, 4.1": (NEW, "8 7 30 4 5", "8 7 30 4 6", 37, "refers to node 6"),
    "node twice": (OLD, "\n4 0 0 1", "\n7 0 0 1", 14, "node number 7 stands twice"),
    "element twice": (OLD, "8 4 2 9", "6 4 2 9", 21, "element number 6 stands twice"),
    "same element again": (
        OLD,
        "2 7 30 4 5",
        "2 10 30 4 7",
        21,
        "element 8 (tet4): the same nodes as element 6 (tet4) at ",
    ),
    "collapsed": (OLD, "2 7 30 4 5", "2 7 30 4 4", 21, "element 8 (tet4): a node stands twice"),
    "not finite": (OLD, "5 1 1 1", "5 1 nan 1", 15, "node 5 has a coordinate that is not a finite"),
    "number 0": (OLD, "4 0 0 1\n5", "0 0 0 1\n5", 14, "node number 0 is not positive"),
    "a word": (OLD, "7 1 0 0", "7 1 O 0", 12, "'O' is no number"),
    "a fraction": (OLD, "8 4 2 9", "8 4.5 2 9", 21, "4.5 stands where a whole number belongs"),
    "run together": (OLD, "7 1 0 0", "7 1 0-0 0", 12, "'0-0' is no number"),
    "too many claimed": (OLD, "$Nodes\n5", "$Nodes\n900000000000", 11, "more numbers are claimed"),
    "too few claimed": (OLD, "$Nodes\n5", "$Nodes\n4", 15, "numbers more than the counts claim"),
    "elements claimed": (OLD, "$Elements\n3", "$Elements\n4", 21, "4 elements are claimed, 3 are there"),
    "blocks claimed": (NEW, "2 5 4 30", "2 6 4 30", None, "6 nodes are claimed, the blocks hold 5"),
    "unknown type": (OLD, "8 4 2 9", "8 77 2 9", 21, "element type 77 is unknown"),
    "no end": (OLD, "$EndElements\n", "", 17, "$Elements does not end"),
    "no nodes": (OLD, "Nodes", "Knots", 1, "there is no section $Nodes"),
    "nodes twice": (OLD, "$Elements", "$Nodes\n0\n$EndNodes\n$Elements", 17, "$Nodes stands twice"),
    "prose": (OLD, "$Elements", "Elements", 17, "a section ($Nodes) should begin here"),
    "format 1": (OLD, OLD, "$NOD\n0\n$ENDNOD\n", 1, "format 1 of gmsh"),
    "format 5": (OLD, "2.2 0 8", "5.0 0 8", 2, "format 5.0 of gmsh"),
    "partitions": (NEW, "$Nodes", "$PartitionedEntities\n2\n$EndPartitionedEntities\n$Nodes", None, "is partitioned"),
    "a dimension of many digits": (OLD, '3 9 "', "9" * 5000 + ' 9 "', None, "should read like"),
    "a tag of many digits": (OLD, '3 9 "', "3 " + "9" * 5000 + ' "', None, "should read like"),
    "bad name": (OLD, '"foot"', "foot", 6, "should read like"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_is_wrong_is_named_with_its_line(read, case):
    text, old, new, line, message = BROKEN[case]
    with pytest.raises(DeckError) as error:
        read(text.replace(old, new))
    assert message in error.value.what
    assert error.value.remedy
    assert line is None or error.value.where.endswith(f"part.msh:{line}")


@pytest.mark.parametrize(
    ("number", "nodes", "name", "remedy"),
    [
        (12, 27, "27-node hexahedron", "Mesh.SecondOrderIncomplete = 1"),
        (13, 18, "18-node prism", "Mesh.SecondOrderIncomplete = 1"),
        (14, 14, "14-node pyramid", "without pyramids"),
        (19, 13, "13-node pyramid", "Mesh.ElementOrder = 1"),
        (29, 20, "20-node tetrahedron", "Mesh.ElementOrder = 2"),
    ],
)
def test_solids_that_are_not_supported_are_refused_with_the_way_out(read, number, nodes, name, remedy):
    extra = f"17 {number} 0 " + " ".join(["10"] * nodes)
    with pytest.raises(DeckError, match=name) as error:
        read(OLD.replace("$Elements\n3", "$Elements\n4").replace("$EndEl", extra + "\n$EndEl"))
    assert "element 17" in error.value.what
    assert remedy in error.value.remedy


def test_a_mesh_of_surfaces_is_refused(read):
    with pytest.raises(DeckError, match=r"no solid element \(1 3-node triangle\)") as error:
        read(OLD.replace("$Elements\n3", "$Elements\n1").replace("\n6 4 2 9 1 10 7 30 4\n8 4 2 9 2 7 30 4 5", ""))
    assert "gmsh -3" in error.value.remedy


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.stem)
def test_a_truncated_file_is_refused(read, path):
    content = path.read_bytes().rstrip()
    for end in range(0, len(content), 97):
        with pytest.raises(DeckError):
            read(content[:end])


def test_binary_counts_beyond_the_file_are_refused(read):
    content = (DATA / "pin-4.1-binary.msh").read_bytes()
    at = content.index(b"$Nodes\n") + len(b"$Nodes\n") + 4 * 8 + 3 * 4
    for claimed in (2**40, 2**62, 2**64 - 1):
        with pytest.raises(DeckError, match=r"\$Nodes: .*(claimed|beyond)"):
            read(content[:at] + struct.pack("<Q", claimed) + content[at + 8 :])


@pytest.mark.parametrize("name", ["pin-2.2-binary.msh", "pin-4.1-binary.msh"])
@pytest.mark.parametrize("section", [b"$Nodes\n", b"$Elements\n"])
def test_a_binary_file_that_ends_at_a_count_is_refused(read, name, section):
    content = (DATA / name).read_bytes()
    at = content.index(section) + len(section)
    for end in range(at - 2, at + 12):
        with pytest.raises(DeckError):
            read(content[:end])

"""*TIE: two blocks, one on the other, joined."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from strainsight.errors import DeckError, UserError
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.fem.results_checks import check_positions
from strainsight.mesh.additions import node_indices
from strainsight.mesh.merging import merged
from strainsight.mesh.surface_ties import with_surface_tie, without_held

HEX = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
REST = (
    "*MATERIAL, NAME=M\n*ELASTIC\n2.1e11, .3\n*DENSITY\n7850.\n*SOLID SECTION, ELSET=LOWER, MATERIAL=M\n"
    "*SOLID SECTION, ELSET=UPPER, MATERIAL=M\n*SURFACE, NAME=TOP\nTOPS, S2\n*SURFACE, NAME=BOTTOM\nBOTTOMS, S1\n"
)


def block(name: str, cells: int, low: float, first: int) -> str:
    """cells × cells × 1 hexahedra over a square metre, 1 m high; nodes and elements from `first` + 1."""
    step = 1 / cells
    at = {point: first + 1 + i for i, point in enumerate(product(range(cells + 1), range(cells + 1), range(2)))}
    lines = ["*NODE", *(f"{number}, {x * step!r}, {y * step!r}, {low + z!r}" for (x, y, z), number in at.items())]
    lines.append(f"*ELEMENT, TYPE=C3D8, ELSET={name}")
    for i, (x, y) in enumerate(product(range(cells), range(cells))):
        lines.append(", ".join(map(str, [first + 1 + i, *(at[x + a, y + b, c] for a, b, c in HEX)])))
    for level in (0, 1):
        lines += [f"*NSET, NSET={name}{level}", *(str(n) for point, n in at.items() if point[2] == level)]
    return "\n".join([*lines, f"*ELSET, ELSET={'TOPS' if low == 0 else 'BOTTOMS'}", name, ""])


def deck(upper: int, tie: str = "*TIE, NAME=T\nBOTTOM, TOP\n", gap: float = 0.0) -> str:
    both = block("LOWER", 1, 0.0, 0) + block("UPPER", upper, 1.0 + gap, 1000)
    return both + REST + tie + "*BOUNDARY\nLOWER0, 1, 3\n"


def frequencies(mesh, count=10):
    model = build_model(mesh)
    return modes(model.stiffness.constant, model.mass.constant, count)[0]


def test_blocks_of_one_mesh_that_are_tied_move_as_one(read):
    tied, loose = read(deck(1)), read(deck(1, tie=""))
    assert frequencies(tied) == pytest.approx(frequencies(merged(loose, 1e-9)), rel=1e-9)
    assert any("4 nodes of BOTTOM follow TOP (*TIE T)" in note for note in tied.notes)
    assert tied.where("relation", 1).endswith(str(deck(1).splitlines().index("BOTTOM, TOP") + 1))


def test_a_finer_block_is_tied_as_by_a_tie_of_the_config(read):
    mesh, loose = read(deck(3)), read(deck(3, tie=""))
    own = with_surface_tie(loose, node_indices(loose, "BOTTOM"), node_indices(loose, "TOP"), 1e-6, "")
    for a, b in zip(mesh.relations, own.relations, strict=True):
        assert np.array_equal(a.node, b.node)
        assert np.array_equal(a.value, b.value)


def test_nodes_beyond_the_tolerance_are_left_with_a_note(read):
    assert len(read(deck(2, gap=0.03)).relations) == 27
    assert len(read(deck(2, "*TIE, NAME=T, POSITION TOLERANCE=0.2\nBOTTOM, TOP\n", gap=0.1)).relations) == 27
    with pytest.raises(DeckError, match="does not lie on the surface"):
        read(deck(2, gap=0.1))
    mesh = read(deck(2).replace("BOTTOM\nBOTTOMS, S1", "BOTTOM, TYPE=NODE\nUPPER0\nUPPER1"))
    said = [text for text in mesh.doubts if "9 of 18 others lie more than" in text]
    assert len(said) == 1
    assert "POSITION TOLERANCE" in said[0]
    assert "mesh.ties" in said[0]


def test_results_in_which_adjust_has_moved_the_tied_nodes_are_of_the_same_mesh(read):
    mesh = read(deck(2, gap=0.03))
    rows, there = np.arange(len(mesh.position)), mesh.position.copy()
    there[node_indices(mesh, "BOTTOM"), 2] = 1.0
    check_positions(mesh, rows, there, 0.0, "a.frd")
    there[node_indices(mesh, "UPPER1"), 2] = 2.0
    with pytest.raises(UserError, match="9 of 26 nodes are elsewhere"):
        check_positions(mesh, rows, there, 0.0, "a.frd")


@pytest.mark.parametrize("of_config", [False, True])
def test_a_plane_of_symmetry_through_tied_surfaces_holds_them_as_it_holds_one_block(read, of_config):
    at_zero = [line.split(", ") for line in deck(1).splitlines() if line.split(", ")[1:2] == ["0.0"]]
    held = "*BOUNDARY\n" + "".join(f"{number}, 1, 1\n" for number, *_ in at_zero)
    loose = read(deck(1, tie="") + held)
    tied = read(deck(1) + ("" if of_config else held))
    if of_config:
        with pytest.raises(UserError, match="dependent in"):
            build_model(replace(tied, fixed=loose.fixed))
        tied = without_held(replace(tied, fixed=loose.fixed))
    assert any("2 components of nodes" in note for note in tied.notes)
    assert frequencies(tied) == pytest.approx(frequencies(merged(loose, 1e-9)), rel=1e-9)


def test_a_tie_of_shells_is_named_with_its_place_and_can_be_left_out_alone(read):
    text = deck(1) + (
        "*NODE\n9001, 0., 0., 2.\n9002, 1., 0., 2.\n9003, 1., 1., 2.\n*ELEMENT, TYPE=S3, ELSET=SKIN\n9001, 9001, 9002, 9003\n"
        "*SHELL SECTION, ELSET=SKIN, MATERIAL=M\n.01\n*SURFACE, NAME=PLATE\nSKIN, SPOS\n*TIE, NAME=U\nPLATE, TOP\n"
    )
    mesh = read(text)
    where = mesh.unsupported["*TIE that joins shells or beams"]
    assert where.endswith(f":{text.splitlines().index('PLATE, TOP') + 1}")
    left = read(text, ignore=["TIE that joins shells or beams"])
    assert (len(left.relations), left.unsupported) == (12, {})


@pytest.mark.parametrize("option", [", CYCLIC SYMMETRY=YES", ", MULTISTAGE"])
def test_a_symmetry_is_not_taken_for_a_joint(read, option):
    mesh = read(deck(1, f"*TIE, NAME=T{option}\nBOTTOM, TOP\n"))
    assert (mesh.relations, list(mesh.unsupported)) == ((), ["*TIE that is a symmetry"])


def test_surfaces_that_are_not_there_are_named_with_their_line(read):
    text = deck(1, "*TIE, NAME=T\nBOTTOM, OTHER\n")
    with pytest.raises(DeckError, match="surface 'OTHER' is not in the deck") as caught:
        read(text)
    assert caught.value.where.endswith(str(text.splitlines().index("BOTTOM, OTHER") + 1))

"""Tied surfaces and contact pairs of Abaqus decks; CalculiX as oracle."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from strainsight.config.template import template
from strainsight.errors import ContactError, DeckError, UserError
from strainsight.fem.model import build_model
from strainsight.foreign.imported_modes import check_positions
from strainsight.mesh.additions import node_indices
from strainsight.mesh.connectivity import merged
from strainsight.mesh.surface_ties import with_surface_tie, without_held
from strainsight.stages.suggestion import suggestion

from ...bodies import body
from ..programs import frequencies, needs_calculix, printed_frequencies

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


def test_tied_matching_blocks_move_together(read):
    tied, loose = read(deck(1)), read(deck(1, tie=""))
    assert frequencies(tied, 10) == pytest.approx(frequencies(merged(loose, 1e-9), 10), rel=1e-9)
    assert any("4 of 4 nodes of surface BOTTOM are tied to surface TOP (*TIE T)" in note for note in tied.notes)
    assert tied.where("relation", 1).endswith(str(deck(1).splitlines().index("BOTTOM, TOP") + 1))


def test_deck_tie_equals_config_tie(read):
    mesh, loose = read(deck(3)), read(deck(3, tie=""))
    own = with_surface_tie(loose, node_indices(loose, "BOTTOM"), node_indices(loose, "TOP"), 1e-6, "")
    for a, b in zip(mesh.relations, own.relations, strict=True):
        assert np.array_equal(a.node, b.node)
        assert np.array_equal(a.value, b.value)


def test_nodes_outside_tie_tolerance_are_noted(read):
    assert len(read(deck(2, gap=0.03)).relations) == 27
    assert len(read(deck(2, "*TIE, NAME=T, POSITION TOLERANCE=0.2\nBOTTOM, TOP\n", gap=0.1)).relations) == 27
    with pytest.raises(DeckError, match=r"is farther than .* from the surface"):
        read(deck(2, gap=0.1))
    mesh = read(deck(2).replace("BOTTOM\nBOTTOMS, S1", "BOTTOM, TYPE=NODE\nUPPER0\nUPPER1"))
    said = [text for text in mesh.doubts if "9 of 18 nodes of surface" in text]
    assert len(said) == 1
    assert "POSITION TOLERANCE" in said[0]
    assert "mesh.ties" in said[0]


def test_adjusted_tie_nodes_match_results(read):
    mesh = read(deck(2, gap=0.03))
    rows, there = np.arange(len(mesh.position)), mesh.position.copy()
    there[node_indices(mesh, "BOTTOM"), 2] = 1.0
    check_positions(mesh, rows, there, 0.0, "a.frd")
    there[node_indices(mesh, "UPPER1"), 2] = 2.0
    with pytest.raises(UserError, match="9 of 26 nodes do not have the same position"):
        check_positions(mesh, rows, there, 0.0, "a.frd")


@pytest.mark.parametrize("of_config", [False, True])
def test_symmetry_plane_through_tie_equals_one_block(read, of_config):
    at_zero = [line.split(", ") for line in deck(1).splitlines() if line.split(", ")[1:2] == ["0.0"]]
    held = "*BOUNDARY\n" + "".join(f"{number}, 1, 1\n" for number, *_ in at_zero)
    loose = read(deck(1, tie="") + held)
    tied = read(deck(1) + ("" if of_config else held))
    if of_config:
        with pytest.raises(UserError, match="dependent in"):
            build_model(replace(tied, fixed=loose.fixed))
        tied = without_held(replace(tied, fixed=loose.fixed))
    assert any("(number of components: 2)" in note for note in tied.notes)
    assert frequencies(tied, 10) == pytest.approx(frequencies(merged(loose, 1e-9), 10), rel=1e-9)


@pytest.mark.parametrize("option", [", CYCLIC SYMMETRY=YES", ", MULTISTAGE"])
def test_cyclic_tie_is_not_a_joint(read, option):
    mesh = read(deck(1, f"*TIE, NAME=T{option}\nBOTTOM, TOP\n"))
    assert (mesh.relations, list(mesh.unsupported)) == ((), ["*TIE that is a symmetry"])


# *CONTACT PAIR: two blocks, one on the other, bonded or open as the config says; CalculiX as oracle.
SOFT, TIED = "LINEAR\n1e12, 1e3", "TIED\n1e12\n*FRICTION\n.1, 1e12"
CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
HEX20 = CORNERS + [tuple(np.add(CORNERS[a], CORNERS[b]) // 2) for a, b in EDGES]


def contact(behaviour: str = SOFT, options: str = "") -> str:
    return (
        f"*SURFACE INTERACTION, NAME=I\n*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE={behaviour}\n"
        f"*CONTACT PAIR, INTERACTION=I, TYPE=SURFACE TO SURFACE{options}\nBOTTOM, TOP\n"
    )


def quadratic(more: str) -> str:
    """Two C3D20, each 1 m wide, and one of half the width on both, all clamped at their far faces."""
    text = ""
    for upper, (low, wide) in enumerate([((0, 0, 0), (1, 1, 1)), ((0.5, 0.25, 1), (1, 0.5, 1))]):
        mesh = body("hex20", (2 - upper, 1, 1), lambda *u, low=low, wide=wide: np.add(low, np.multiply(wide, u)))
        mesh = replace(mesh, node_ids=1000 * upper + mesh.node_ids)
        (block,) = mesh.blocks
        elements = 1000 * upper + block.ids
        text += "*NODE\n" + "".join(f"{n}, {x}, {y}, {z}\n" for n, (x, y, z) in zip(mesh.node_ids, mesh.position, strict=True))
        text += "*ELEMENT, TYPE=C3D20, ELSET=ALL\n"
        for e, nodes in zip(elements, mesh.node_ids[block.nodes].tolist(), strict=True):
            text += f"{e}, {', '.join(map(str, nodes[:10]))},\n{', '.join(map(str, nodes[10:]))}\n"
        text += "*BOUNDARY\n" + "".join(f"{n}, 1, 3\n" for n in mesh.node_ids[mesh.position[:, 2] == 2 * upper])
        text += f"*SURFACE, NAME={'BOTTOM' if upper else 'TOP'}\n" + "".join(f"{e}, S{1 if upper else 2}\n" for e in elements)
    return f"{text}*MATERIAL, NAME=M\n*ELASTIC\n2.1e11, .3\n*DENSITY\n7800.\n*SOLID SECTION, ELSET=ALL, MATERIAL=M\n{more}"


def test_contact_requires_choice(read):
    text = deck(2, contact())
    with pytest.raises(ContactError, match="the deck has surfaces in contact, but a linear model cannot open or close") as caught:
        read(text)
    assert caught.value.where.endswith(f":{text.splitlines().index('BOTTOM, TOP') + 1}")
    assert "mesh.contact: bonded" in (caught.value.remedy or "")
    assert "mesh.contact: open" in (caught.value.remedy or "")
    assert caught.value.choices == ("BOTTOM on TOP",)


def test_bonded_contact_equals_tie_and_open_equals_none(read):
    bonded, tied = read(deck(2, contact()), contact="bonded"), read(deck(2))
    assert frequencies(bonded, 10) == pytest.approx(frequencies(tied, 10), rel=1e-12)
    assert bonded.where("relation", 1) == bonded.where("relation", len(bonded.relations))
    one = read(deck(1, contact()), contact="bonded")
    loose = read(deck(1, contact()), contact="open")
    assert loose.relations == ()
    assert frequencies(one, 10) == pytest.approx(frequencies(merged(loose, 1e-9), 10), rel=1e-9)


@pytest.mark.parametrize("choice", [None, "open", "bonded"])
@pytest.mark.parametrize("text", [contact(TIED), contact(SOFT, ", TIED")])
def test_tied_contact_is_always_bonded(read, choice, text):
    mesh = read(deck(2, text), contact=choice)
    assert frequencies(mesh, 10) == pytest.approx(frequencies(read(deck(2)), 10), rel=1e-12)
    assert "TIED in the deck" in mesh.contacts[0]


def test_only_touching_nodes_are_bonded(read):
    apart = read(deck(2, contact(), gap=0.2), contact="bonded")
    assert apart.relations == ()
    expected = "0 of 9 nodes of BOTTOM are bonded (mesh.contact: bonded); nodes not bonded because they are farther than"
    assert expected in apart.contacts[0]
    adjusted = read(deck(2, contact(SOFT, ", ADJUST=0.3"), gap=0.2), contact="bonded")
    assert len(adjusted.relations) == 27


def test_reversed_pair_is_bonded_once(read):
    mesh = read(deck(2, contact() + "TOP, BOTTOM\n"), contact="bonded")
    assert frequencies(mesh, 10) == pytest.approx(frequencies(read(deck(2)), 10), rel=1e-12)
    itself = read(deck(2, contact().replace("BOTTOM, TOP", "TOP, TOP")), contact="bonded")
    assert mesh.contacts[1] == "contact of TOP on BOTTOM: this contact is already included in the contact of BOTTOM on TOP"
    because = "contact of TOP on TOP: the contact is open, because a surface cannot be bonded to itself"
    assert (itself.relations, itself.contacts) == ((), (because,))


@pytest.mark.parametrize("first", ["*CONTACT PAIR, INTERACTION=I\nBELOW, ABOVE\n", "*TIE, NAME=T\nBELOW, ABOVE\n"])
def test_mutual_contact_is_not_circular(read, first):
    again = "*SURFACE, NAME=BELOW\nTOPS, S2\n*SURFACE, NAME=ABOVE\nBOTTOMS, S1\n"
    mesh = read(deck(2, again + first + contact()), contact="bonded")
    expected = "contact of BOTTOM on TOP: 5 of 9 nodes of BOTTOM are bonded (mesh.contact: bonded); nodes not bonded "
    assert mesh.contacts[-1].startswith(expected + "because nodes of")
    assert frequencies(mesh, 10) == pytest.approx(frequencies(read(deck(2)), 10), rel=1e-12)


def test_shells_are_not_bonded(read):
    text = deck(1, contact()) + (
        "*NODE\n9001, 0., 0., 2.\n9002, 1., 0., 2.\n9003, 1., 1., 2.\n*ELEMENT, TYPE=S3, ELSET=SKIN\n9001, 9001, 9002, 9003\n"
        "*SHELL SECTION, ELSET=SKIN, MATERIAL=M\n.01\n*SURFACE, NAME=PLATE\nSKIN, SPOS\n"
        "*CONTACT PAIR, INTERACTION=I\nPLATE, TOP\n"
    )
    assert len(read(text, contact="open").contacts) == 2
    with pytest.raises(DeckError, match="PLATE on TOP includes shells or beams"):
        read(text, contact="bonded")


def test_nodes_with_transform_are_bonded(read):
    text = deck(2, contact())
    turned = (
        text
        + "*TRANSFORM, NSET=UPPER0, TYPE=C\n.1, .2, 0., .1, .2, 1.\n*TRANSFORM, NSET=LOWER1\n1., 2., 3., 0., 1., 1.\n"
    )
    mesh = read(turned, contact="bonded")
    assert len(mesh.axes) == 13
    assert frequencies(mesh, 10) == pytest.approx(frequencies(read(text, contact="bonded"), 10), rel=1e-9)


def test_init_selects_bonded_contact(tmp_path):
    path = tmp_path / "deck.inp"
    path.write_text(deck(2, contact()))
    found = suggestion(path)
    assert (found.contact, found.pairs) == ("bonded", ("BOTTOM on TOP",))
    assert "  contact: bonded       # ← bonded or open: with `open`, a part has no support" in template("deck.inp", found)
    path.write_text(deck(2, contact()) + "*BOUNDARY\nUPPER1, 1, 3\n")
    assert suggestion(path).contact == "open"
    path.write_text(deck(2))
    assert suggestion(path).contact is None
    assert "contact:" not in template("deck.inp", suggestion(path))


@needs_calculix
@pytest.mark.parametrize("kind", ["soft", "tied"])
def test_calculix_frequency_step_ignores_contact(tmp_path, read, kind):
    """Whatever presses the blocks together, a *FREQUENCY step without PERTURBATION leaves them apart, TIED ones too; bonded is
    its *TIE."""
    step = "*STEP\n*FREQUENCY\n8\n*END STEP\n"
    found = {}
    for name, more in (("contact", contact(SOFT if kind == "soft" else TIED)), ("tie", "*TIE, NAME=T\nBOTTOM, TOP\n")):
        (tmp_path / f"{name}.inp").write_text(quadratic(more + step))
        found[name] = printed_frequencies(tmp_path / f"{name}.inp", 8)
    bonded = read(quadratic(contact()), contact="bonded")
    np.testing.assert_allclose(frequencies(bonded, 8), found["tie"], rtol=1e-6)
    np.testing.assert_allclose(frequencies(replace(bonded, relations=()), 8), found["contact"], rtol=1e-6)
    assert len(node_indices(bonded, "BOTTOM")) == 8

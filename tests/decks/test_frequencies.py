"""Mass and ten frequencies of a bar, however a deck writes it, are those of scikit-fem with the deck's ties, masses, springs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes

from ..solids import SOLIDS
from .bars import (
    NU,
    OF,
    PLACE,
    RHO,
    STIFF,
    Bar,
    E,
    Reference,
    T,
    anisotropic,
    averaged,
    bar,
    barred,
    centred,
    held_tip,
    loaded,
    plain,
    related,
    rigid_tip,
    sprung,
    symmetry,
    turned_roller,
)

CORD = ["CORD2R", 7, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.6, 0.8, 0.0]
Writer = Callable[[Bar], str | dict[str, str]]
Oracle = Callable[[Bar], Reference]
Case = tuple[str, str, Writer, Oracle]


def number(node: int) -> int:
    return 5 + 3 * node


def numbers(nodes) -> list[int]:
    return [number(node) for node in nodes]


def cards(own: Bar, held: bool = True) -> list[list]:
    solid = SOLIDS[own.kind]
    places = {frozenset(edge): 0 for edge in solid.edges}
    order = list(range(len(solid.corners)))
    order += [
        len(solid.corners) + [*places].index(frozenset(edge)) for edge in (solid.nastran_edges if solid.edges else ())
    ]
    found: list[list] = [["GRID", number(i), "", *x] for i, x in enumerate(own.x.tolist())]
    found += [[solid.nastran, e, 1, *numbers(cell[i] for i in order)] for e, cell in enumerate(own.cells, start=1)]
    found += [["PSOLID", 1, 1], ["MAT1", 1, E, "", NU, RHO]]
    return found + ([["SPC1", 1, 123, *numbers(own.root)]] if held else [])


def free(found: list[list]) -> str:
    words = [[repr(f) if isinstance(f, float) else str(f) for f in card] for card in found]
    return "".join(
        "\n,".join([",".join(w[:9]), *(",".join(w[i : i + 8]) for i in range(9, len(w), 8))]) + "\n" for w in words
    )


def bulk(text: str, control: str = "") -> str:
    return f"SOL 103\nCEND\nSPC = 1\n{control}BEGIN BULK\n{text}ENDDATA\n"


def inp(
    own: Bar,
    support: str = "*BOUNDARY\nROOT, 1, 3\n",
    elastic: str = f"*ELASTIC\n{E!r}, {NU}\n",
    more: str = "",
    x: np.ndarray | None = None,
) -> str:
    place = (own.x if x is None else x).tolist()
    lines = ["*NODE", *(f"{number(i)}, {a!r}, {b!r}, {c!r}" for i, (a, b, c) in enumerate(place))]
    lines.append(f"*ELEMENT, TYPE={SOLIDS[own.kind].abaqus}, ELSET=ALL")
    for e, cell in enumerate(own.cells, start=1):
        words = [str(e), *map(str, numbers(cell))]
        lines += [", ".join(words[:12]) + ("," if words[12:] else ""), *([", ".join(words[12:])] if words[12:] else [])]
    for name, nodes in (("ROOT", own.root), ("TIP", own.tip)):
        lines += [f"*NSET, NSET={name}", *map(str, numbers(nodes))]
    head = (
        "\n".join(lines) + f"\n*MATERIAL, NAME=M\n{elastic}*DENSITY\n{RHO!r}\n*SOLID SECTION, ELSET=ALL, MATERIAL=M\n"
    )
    return head + more + support


def replaced(old: list, *new: list) -> Callable[[Bar], str]:
    return lambda own: bulk(free([card for card in cards(own) if card[0] != old[0]] + list(new)))


def added(*new) -> Callable[[Bar], str]:
    return lambda own: bulk(free(cards(own) + [card(own) if callable(card) else card for card in new]))


def fixed_width(own: Bar) -> str:
    """Large fields with marks of continuation, whose first column is another one each."""
    lines = []
    for n, card in enumerate(cards(own)):
        words = [f"{f:.10E}" if isinstance(f, float) else str(f) for f in card]
        rest = words[1:]
        parts = [rest[i : i + 4] for i in range(0, len(rest), 4)]
        for i, part in enumerate(parts):
            head = f"{words[0]}*" if i == 0 else f"*C{n}X{i}"
            mark = f"+C{n}X{i + 1}" if i + 1 < len(parts) else ""
            lines.append(f"{head:<8}" + "".join(f"{word:>16}" for word in part).ljust(64) + mark)
    return bulk("\n".join(lines) + "\n")


def in_cylinder(own: Bar) -> str:
    found = cards(own)
    for card in found:
        if card[0] == "GRID":
            x, y, z = card[3:6]
            card[2:6] = [8, float(np.hypot(x, y)), float(np.degrees(np.arctan2(y, x))), z]
    return bulk(free([["CORD2C", 8, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0], *found]))


def rolled(own: Bar) -> str:
    found = cards(own)
    for card in found:
        if card[0] == "GRID" and card[1] in numbers(own.tip[:2]):
            card.append(7)
    return bulk(free([CORD, *found, ["SPC1", 1, 2, *numbers(own.tip[:2])]]))


def left_handed(own: Bar) -> str:
    found = cards(own)
    for card in found:
        if card[0] == "CTETRA":
            card[3:7] = [card[4], card[3], card[5], card[6]]
            card[7:13] = [card[7], card[9], card[8], card[11], card[10], card[12]]
    return bulk(free(found))


REFERENCE = ["GRID", 900, "", *PLACE.tolist()]
CONM2 = ["CONM2", 901, 900, "", 20.0, 0.1, 0.0, 0.02, "", 0.5, "", 0.4, "", "", 0.3]
CENTRED = ["CONM2", 901, 900, "", 20.0, "", "", "", "", 0.5, "", 0.4, "", "", 0.3]
TIP = f"*NODE, NSET=REF\n900, {', '.join(map(repr, PLACE.tolist()))}\n"
POINT = "*ELEMENT, TYPE=MASS, ELSET=P\n901, 900\n*MASS, ELSET=P\n20.\n"
POINT += "*ELEMENT, TYPE=ROTARYI, ELSET=R\n902, 900\n*ROTARY INERTIA, ELSET=R\n.5, .4, .3\n"
MAT9 = ["MAT9", 1, *(float(STIFF[i, j]) for i in range(6) for j in range(i, 6)), RHO]


def two(own: Bar) -> str:
    """The second half of the bar with nodes of its own, tied to the first."""
    text = inp(own)
    cut = np.flatnonzero(own.u == 1).tolist()
    twin = {number(node): 2000 + number(node) for node in cut}
    second = [e for e, cell in enumerate(own.cells, start=1) if own.u[cell].max() > 1]
    lines, inside = [], False
    for line in text.splitlines():
        inside = line.startswith("*ELEMENT") or (inside and not line.startswith("*"))
        words = line.split(", ")
        if inside and words[0].isdigit() and int(words[0]) in second:
            line = ", ".join([words[0], *(str(twin.get(int(word), int(word))) for word in words[1:])])
        lines.append(line)
    nodes = [f"{twin[number(n)]}, {', '.join(map(repr, own.x[n].tolist()))}" for n in cut]
    sets = ["*NSET, NSET=TWINS", *map(str, twin.values()), "*ELSET, ELSET=FIRST"]
    sets += [str(e) for e in range(1, len(own.cells) + 1) if e not in second]
    tie = ["*SURFACE, NAME=A, TYPE=NODE", "TWINS", "*SURFACE, NAME=B", "FIRST", "*TIE, NAME=T", "A, B"]
    return "\n".join(["*NODE", *nodes, *lines, *sets, *tie, ""])


def instance(own: Bar) -> str:
    """The bar elsewhere and turned, put back by its instance."""
    angle = float(np.degrees(np.arctan2(0.8, 0.6)))
    mesh, material = inp(own, support="", x=own.x @ T + [3.0, 1.0, 0.0]).split("*MATERIAL", 1)
    elastic, section = material.split("*SOLID SECTION", 1)
    return (
        f"*PART, NAME=P\n{mesh}*SOLID SECTION{section}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n"
        f"-3., -1., 0.\n0., 0., 0., 0., 0., 1., {angle!r}\n*END INSTANCE\n*END ASSEMBLY\n*MATERIAL{elastic}"
        "*BOUNDARY\nI.ROOT, 1, 3\n"
    )


def rigid_bar(i: int) -> Callable[[Bar], list]:
    return lambda own: ["RBAR", 90 + i, number(own.tip[0]), number(own.tip[i]), 123456]


def relation(a: int, b: int) -> list:
    return ["MPC", 2, a, 1, 1.0, b, 1, -0.5, "", "", b, 3, 0.25]


def nastran(write: Writer, reference: Oracle = plain, kind: str = "tet10") -> Case:
    return ".bdf", kind, write, reference


def abaqus(write: Writer, reference: Oracle = plain, kind: str = "tet10") -> Case:
    return ".inp", kind, write, reference


def modelled(more: str, reference: Oracle) -> Case:
    """An Abaqus deck with more model data; {0} and {1} are the first two nodes of the tip."""
    return abaqus(lambda own: inp(own, more=more.format(*numbers(own.tip[:2]))), reference)


RBE2 = added(REFERENCE, lambda own: ["RBE2", 9, 900, 123, *numbers(own.tip)], CONM2)
RBE3 = added(REFERENCE, lambda own: ["RBE3", 9, "", 900, 123456, 1.0, 123, *numbers(own.tip)], CENTRED)
CELAS = (
    lambda own: ["CELAS2", 91, 3e7, number(own.tip[0]), 2],
    lambda own: ["CELAS1", 92, 93, number(own.tip[0]), 3, number(own.tip[1]), 3],
    ["PELAS", 93, 2e8],
)
ROLLER = "*NSET, NSET=ROLL\n{}, {}\n*TRANSFORM, NSET=ROLL\n.6, .8, 0., -.8, .6, 0.\n*BOUNDARY\nROOT, 1, 3\nROLL, 2\n"
SURFACE = "*SURFACE, NAME=S, TYPE=NODE\nTIP, 1.\n*COUPLING, REF NODE=900, SURFACE=S, CONSTRAINT NAME=C\n*DISTRIBUTING\n"
SPRINGS = "*ELEMENT, TYPE=SPRING1, ELSET=S1\n91, {0}\n*SPRING, ELSET=S1\n2\n3e7\n"
SPRINGS += "*ELEMENT, TYPE=SPRING2, ELSET=S2\n92, {0}, {1}\n*SPRING, ELSET=S2\n3, 3\n2e8\n"
ORTHO = "*ELASTIC, TYPE=ORTHO\n9e10, 3e10, 7e10, 2e10, 2e10, 5e10, 3e10, 1e10\n2e10\n"
STEP = "*BOUNDARY\nTIP, 1, 3\n*STEP\n*FREQUENCY\n10\n*BOUNDARY, OP=NEW\nROOT, 1, 3\n*END STEP\n"
CASES: dict[str, Case] = {
    **{f"bdf {kind}": nastran(lambda own: bulk(free(cards(own))), kind=kind) for kind in OF},
    **{f"inp {kind}": abaqus(inp, kind=kind) for kind in OF},
    "large fields, marks": nastran(fixed_width),
    "cylinder": nastran(in_cylinder),
    "CD": nastran(rolled, turned_roller),
    "left-handed": nastran(left_handed),
    "WTMASS": nastran(replaced(["MAT1"], ["MAT1", 1, E, "", NU, RHO * 386.0], ["PARAM", "WTMASS", 1 / 386.0])),
    **{f"RBE2, CONM2, {kind}": nastran(RBE2, rigid_tip, kind) for kind in ("tet10", "hex20")},
    "RBE3": nastran(RBE3, averaged),
    "MPC": nastran(lambda own: bulk(free([*cards(own), relation(*numbers(own.tip[:2]))]), "MPC = 2\n"), related),
    "RBAR": nastran(added(*map(rigid_bar, (1, 2, 3))), barred),
    "CELAS": nastran(added(*CELAS), sprung),
    "MAT9": nastran(replaced(["MAT1"], MAT9), anisotropic),
    "SPC not at zero": nastran(added(lambda own: ["SPC", 1, number(own.tip[0]), 1, 0.1]), held_tip),
    "CONM2 on a solid": nastran(added(lambda own: ["CONM2", 91, number(own.tip[0]), "", 12.0]), loaded),
    "instance": abaqus(instance),
    "TRANSFORM": abaqus(lambda own: inp(own, ROLLER.format(*numbers(own.tip[:2]))), turned_roller),
    "ENCASTRE": abaqus(lambda own: inp(own, "*BOUNDARY\nROOT, ENCASTRE\nTIP, YSYMM\n"), symmetry),
    "EQUATION": modelled("*EQUATION\n3\n{0}, 1, 1., {1}, 1, -.5, {1}, 3, .25\n", related),
    "KINEMATIC": modelled(f"{TIP}{POINT}*KINEMATIC COUPLING, REF NODE=900\nTIP, 1, 3\n", centred),
    "RIGID BODY": modelled(f"{TIP}{POINT}*RIGID BODY, NSET=TIP, REF NODE=900\n", centred),
    "MPC BEAM": modelled(f"{TIP}{POINT}*MPC\nBEAM, TIP, REF\n", centred),
    "DISTRIBUTING": modelled(f"{TIP}{POINT}{SURFACE}", averaged),
    "SPRING": modelled(SPRINGS, sprung),
    "MASS": modelled("*ELEMENT, TYPE=MASS, ELSET=P\n91, {0}\n*MASS, ELSET=P\n12.\n", loaded),
    "ORTHOTROPIC": abaqus(lambda own: inp(own, elastic=ORTHO), anisotropic),
    "not at zero in a step": abaqus(
        lambda own: inp(own) + f"*STEP\n*STATIC\n*BOUNDARY\n{number(own.tip[0])}, 1, 1, .1\n*END STEP\n", held_tip
    ),
    "TIE": abaqus(two),
}


@pytest.mark.parametrize("name", CASES)
def test_mass_and_ten_frequencies_are_those_of_scikit_fem(tmp_path, name):
    ending, kind, write, reference = CASES[name]
    written = write(bar(kind))
    for file, text in (written if isinstance(written, dict) else {"": written}).items():
        (tmp_path / (file or f"bar{ending}")).write_text(text)
    mesh = read_mesh(tmp_path / f"bar{ending}")
    assert not mesh.unsupported
    expected = reference(bar(kind))
    assert mass_properties(mesh)[0] == pytest.approx(expected.total(), rel=1e-9)
    model = build_model(mesh)
    own = modes(model.stiffness.constant, model.mass.constant, 10)[0]
    assert own == pytest.approx(expected.frequencies(), rel=1e-8)

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
    anisotropic,
    averaged,
    bar,
    barred,
    centred,
    plain,
    related,
    rigid_tip,
    sprung,
)

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


REFERENCE = ["GRID", 900, "", *PLACE.tolist()]
CONM2 = ["CONM2", 901, 900, "", 20.0, 0.1, 0.0, 0.02, "", 0.5, "", 0.4, "", "", 0.3]
CENTRED = ["CONM2", 901, 900, "", 20.0, "", "", "", "", 0.5, "", 0.4, "", "", 0.3]
TIP = f"*NODE, NSET=REF\n900, {', '.join(map(repr, PLACE.tolist()))}\n"
POINT = "*ELEMENT, TYPE=MASS, ELSET=P\n901, 900\n*MASS, ELSET=P\n20.\n"
POINT += "*ELEMENT, TYPE=ROTARYI, ELSET=R\n902, 900\n*ROTARY INERTIA, ELSET=R\n.5, .4, .3\n"
MAT9 = ["MAT9", 1, *(float(STIFF[i, j]) for i in range(6) for j in range(i, 6)), RHO]


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
SURFACE = "*SURFACE, NAME=S, TYPE=NODE\nTIP, 1.\n*COUPLING, REF NODE=900, SURFACE=S, CONSTRAINT NAME=C\n*DISTRIBUTING\n"
SPRINGS = "*ELEMENT, TYPE=SPRING1, ELSET=S1\n91, {0}\n*SPRING, ELSET=S1\n2\n3e7\n"
SPRINGS += "*ELEMENT, TYPE=SPRING2, ELSET=S2\n92, {0}, {1}\n*SPRING, ELSET=S2\n3, 3\n2e8\n"
ORTHO = "*ELASTIC, TYPE=ORTHO\n9e10, 3e10, 7e10, 2e10, 2e10, 5e10, 3e10, 1e10\n2e10\n"
CASES: dict[str, Case] = {
    **{f"bdf {kind}": nastran(lambda own: bulk(free(cards(own))), kind=kind) for kind in OF},
    **{f"inp {kind}": abaqus(inp, kind=kind) for kind in OF},
    **{f"RBE2, CONM2, {kind}": nastran(RBE2, rigid_tip, kind) for kind in ("tet10", "hex20")},
    "RBE3": nastran(RBE3, averaged),
    "MPC": nastran(lambda own: bulk(free([*cards(own), relation(*numbers(own.tip[:2]))]), "MPC = 2\n"), related),
    "RBAR": nastran(added(*map(rigid_bar, (1, 2, 3))), barred),
    "CELAS": nastran(added(*CELAS), sprung),
    "MAT9": nastran(replaced(["MAT1"], MAT9), anisotropic),
    "EQUATION": modelled("*EQUATION\n3\n{0}, 1, 1., {1}, 1, -.5, {1}, 3, .25\n", related),
    "KINEMATIC": modelled(f"{TIP}{POINT}*KINEMATIC COUPLING, REF NODE=900\nTIP, 1, 3\n", centred),
    "RIGID BODY": modelled(f"{TIP}{POINT}*RIGID BODY, NSET=TIP, REF NODE=900\n", centred),
    "MPC BEAM": modelled(f"{TIP}{POINT}*MPC\nBEAM, TIP, REF\n", centred),
    "DISTRIBUTING": modelled(f"{TIP}{POINT}{SURFACE}", averaged),
    "SPRING": modelled(SPRINGS, sprung),
    "ORTHOTROPIC": abaqus(lambda own: inp(own, elastic=ORTHO), anisotropic),
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

"""Equations and cyclic symmetry of Abaqus decks; CalculiX as oracle."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from tests.decks.abaqus.test_contact import HEX20

from strainsight.decks.abaqus.deck import read_abaqus
from strainsight.errors import DeckError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.mass import mass_properties

from ...refusals import refusal_table
from ..programs import displacements, frequencies, needs_calculix, printed_displacements
from .test_loads import bar

EQUATIONS = """\
*NODE, NSET=NALL
900, 1., .2, .1
*TRANSFORM, NSET=TURNED
.6, .8, 0., -.8, .6, 0.
*NSET, NSET=TURNED
3, 900
*EQUATION
2
3, 1, 1., 900, 1, -.7
3
6, 2, 2.
900, 2, -.5, 23, 3, .3
1
30, 3, 1.
4
9, 1, 1., 6, 3, .4, 23, 1, -.8,
30, 2, .6
"""


@needs_calculix
def test_equation_displacements_match_calculix(tmp_path):
    """Weighted, to a node that no element has, along axes of nodes, to the ground."""
    path = tmp_path / "bar.inp"
    load = "*STEP\n*STATIC\n*CLOAD\n900, 1, 2.E4\n900, 2, 1.E4\n23, 3, -3.E4\n*NODE PRINT, NSET=NALL\nU\n*END STEP\n"
    path.write_text(bar() + EQUATIONS + load)
    expected = printed_displacements(path)
    mesh = read_abaqus(path)
    assert [len(own.node) for own in mesh.relations] == [2, 3, 1, 4]
    (u,) = displacements(mesh, *mesh.loads)
    # CalculiX prints along the axes of a node, and two motions of 900 alone
    printed = np.array([row @ mesh.axes.get(node, np.eye(3)) for node, row in enumerate(u)])
    assert np.abs(printed[-1, :2]).min() > 0.01 * np.abs(printed).max()
    np.testing.assert_allclose(printed, expected, atol=1e-6 * np.abs(expected).max())


def test_node_sets_expand_equations(read):
    sets = "*NSET, NSET=A\n9, 5\n*NSET, NSET=B\n30, 3\n*EQUATION\n3\nA, 2, 1., B, 1, -1., 6, 3, .5\n"
    mesh = read(bar() + sets)
    named = [mesh.node_ids[own.node].tolist() for own in mesh.relations]
    assert named == [[5, 3, 6], [9, 30, 6]]
    assert all(own.component.tolist() == [1, 0, 2] and own.value.tolist() == [1, -1, 0.5] for own in mesh.relations)


def test_equation_on_rot_node_uses_rotations(read):
    text = bar() + "*NODE\n900, 1., .2, .1\n901, 1., .2, .1\n*NSET, NSET=T\n3, 9\n"
    text += "*RIGID BODY, NSET=T, REF NODE=900, ROT NODE=901\n*EQUATION\n3\n23, 1, 1., 901, 2, -.25, 900, 6, 2.\n"
    mesh = read(text)
    (own,) = mesh.relations
    assert mesh.node_ids[own.node].tolist() == [23, 900, 900]
    assert own.component.tolist() == [0, 4, 5]
    T = constraint_transform(mesh)
    row = T.reference_rows[mesh.node_index(900)]
    found = T.transform[[3 * mesh.node_index(23)]].toarray()
    np.testing.assert_allclose(found, (0.25 * T.transform[[row + 1]] - 2 * T.transform[[row + 2]]).toarray())


def test_equation_errors_have_source_line(read):
    text = bar() + "*EQUATION\n2\n23, 1, 1., 6, 1, -1.\n2\n23, 1, 1., 9, 1, -1.\n"
    lines = text.count("\n")
    mesh = read(text)
    with pytest.raises(DeckError, match=r"node 23 is dependent in \*EQUATION \(.*\) and in \*EQUATION") as caught, mesh.located():
        constraint_transform(mesh)
    assert caught.value.where.endswith(f"deck.inp:{lines - 1}")
    assert f"deck.inp:{lines - 3}" in str(caught.value)


def test_equations_of_later_steps_are_noted(read):
    own = "*EQUATION\n2\n23, 1, 1., 6, 1, -1.\n"
    steps = "*STEP\n*STATIC\n*END STEP\n*STEP\n*EQUATION, REMOVE ALL\n*END STEP\n"
    mesh = read(bar() + own + steps)
    assert len(mesh.relations) == 1
    assert "the equations of step 2" in mesh.notes[-1]


test_invalid_equations_are_refused = refusal_table(lambda cards: bar() + cards, [
    ("*EQUATION, REMOVE\n2\n5, 1, 1., 6, 1, -1.\n", "REMOVE is not supported", 1),
    ("*EQUATION\n3\n5, 1, 1., 6, 1, -1.\n", "3 terms are declared, but 2 are defined", 2),
    ("*EQUATION\n2\n5, 1, 0., 6, 1, 1.\n", "the coefficient of the first term is 0", 3),
    ("*EQUATION\n2\n5, 1, 1., 6, 4, 1.\n", "degree of freedom 4 does not exist at node", 3),
    ("*EQUATION\n2\nNALL, 1, 1., ONE, 1, 1.\n*NSET, NSET=ONE\n5, 6\n", "2 nodes, but the node set of the first term has", 3),
    ("*EQUATION\n1\nONE, 1, 1.\n*NSET, NSET=ONE, UNSORTED\n6, 5\n", "'ONE' is UNSORTED", 3),
    ("*STEP\n*EQUATION\n1\n5, 1, 1.\n*END STEP\n", r"equations inside the first \*STEP are not supported", 2),
], before=bar().count("\n"))


# *CYCLIC SYMMETRY MODEL: a sector of a wheel made whole, beside the wheel written whole, and CalculiX.
N, CELLS = 5, 2
MATERIAL = "*MATERIAL, NAME=M\n*ELASTIC\n2.1e11, .3\n*DENSITY\n7800.\n"
PLY = (
    "*MATERIAL, NAME=M\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n"
    "2.e11, 1.e10, 1.e10, .3, .3, .4, 6.e9, 6.e9\n3.e9\n*DENSITY\n1600.\n"
)
SECTOR = "*TIE, CYCLIC SYMMETRY, NAME=T\nFIRST, LAST\n*CYCLIC SYMMETRY MODEL, N=5\n0., 0., 1., 0., 0., 3.\n"


def at(i: int, j: int, k: int) -> tuple[float, float, float]:
    """Half cells along radius, angle and height: 1 m to 1.6 m, a bend in the rim, 0.5 m high."""
    radius, angle = 1.0 + 0.3 * i + 0.02 * (j % 2), np.pi * j / (N * CELLS)
    return radius * np.cos(angle), radius * np.sin(angle), 0.25 * k + 0.01 * i


def wheel(sectors: int, material: str = MATERIAL, section: str = "", more: str = "") -> str:
    """The first of the N sectors, or all of them, the cells of each in an ELSET S1, S2, …; held at the inner edge below along
    the radius and the axis, and in one sector in all."""
    nodes: dict[tuple[int, int, int], int] = {}
    half = 2 * CELLS
    lines, sets = ["*NODE"], []
    elements = []
    for s, c in product(range(sectors), range(CELLS)):
        points = [(x, half * s + 2 * c + y, z) for x, y, z in HEX20]
        if sectors == N:
            points = [(x, y % (half * N), z) for x, y, z in points]
        elements.append((s, [nodes.setdefault(point, len(nodes) + 1) for point in points]))
    lines += [f"{number}, {', '.join(f'{x:.12e}' for x in at(*point))}" for point, number in nodes.items()]
    for s in range(sectors):
        lines.append(f"*ELEMENT, TYPE=C3D20, ELSET=S{s + 1}")
        for e, (of, own) in enumerate(elements):
            if of == s:
                lines += [", ".join(map(str, [e + 1, *own[:10]])) + ",", ", ".join(map(str, own[10:]))]
        lines.append(f"*SOLID SECTION, ELSET=S{s + 1}, MATERIAL=M{section.format(s + 1)}")
    inner = [number for (i, _, k), number in nodes.items() if (i, k) == (0, 0)]
    sets += ["*NSET, NSET=INNER", *map(str, inner), "*TRANSFORM, NSET=INNER, TYPE=C\n0., 0., 0., 0., 0., 1."]
    sets += ["*BOUNDARY\nINNER, 1, 1\nINNER, 3, 3"]
    for name, j in (("FIRST", 0), ("LAST", half)):
        own = [number for point, number in nodes.items() if point[1] == j]
        sets += [f"*NSET, NSET={name}S", *map(str, own), f"*SURFACE, NAME={name}, TYPE=NODE\n{name}S"]
    for s in range(sectors):
        a, b = (nodes[2, half * s + 1, k] for k in (0, 2))
        sets.append(f"*EQUATION\n2\n{a}, 3, 1., {b}, 3, -1.")
        sets.append(f"*ELEMENT, TYPE=MASS, ELSET=P{s}\n{9001 + s}, {nodes[2, half * s + 2, 2]}\n*MASS, ELSET=P{s}\n50.")
    return "\n".join([*lines, *sets, material]) + more


def test_cyclic_sector_matches_full_wheel(read):
    held = "*BOUNDARY\nINNER, 2, 2\n"
    ring, whole = read(wheel(1, more=SECTOR + held)), read(wheel(N, more=held))
    assert len(ring.position) == len(whole.position)
    assert frequencies(ring, 24) == pytest.approx(frequencies(whole, 24), rel=1e-8)
    for a, b in zip(mass_properties(ring), mass_properties(whole), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-9)
    assert sum(own.mass for own in ring.point_masses) == 50 * N
    assert any("expanded to a full ring of 5" in note for note in ring.notes)
    assert ring.unsupported == {}


@pytest.mark.parametrize(
    ("sector", "of_all"),
    [
        (
            ", ORIENTATION=O1",
            [
                f"*ORIENTATION, NAME=O{s + 1}\n{np.cos(v):.12e}, {np.sin(v):.12e}, 0., {-np.sin(v):.12e}, {np.cos(v):.12e}, 0.\n"
                for s, v in enumerate(2 * np.pi * np.arange(N) / N)
            ],
        ),
        (", ORIENTATION=O", ["*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL\n0., 0., 0., 0., 0., 1.\n"]),
    ],
)
def test_material_axes_rotate_with_sector(read, sector, of_all):
    more = "*BOUNDARY\nINNER, 2, 2\n" + "".join(of_all)
    ring = read(wheel(1, PLY, sector, SECTOR + more))
    whole = read(wheel(N, PLY, ", ORIENTATION=O{}" if len(of_all) > 1 else sector, more))
    assert frequencies(ring, 12) == pytest.approx(frequencies(whole, 12), rel=1e-8)
    assert len(ring.regions) == (N if len(of_all) > 1 else 1)
    assert any("copied to each sector, for example 'S1 (sector 2)'" in note for note in ring.notes) == (len(of_all) > 1)


def test_sector_sets_and_loads_are_copied(read):
    mesh = read(wheel(1, more=SECTOR + "*STEP\n*STATIC\n*CLOAD\n20, 3, 7.\n20, 1, 2.\n*END STEP\n"))
    (load,) = mesh.loads.values()
    np.testing.assert_allclose(load.force.sum(axis=0), [0, 0, 7 * N], atol=1e-12)
    each = [mesh.element_sets[f"SECTOR-{j + 1}"] for j in range(N)]
    assert sorted(np.concatenate(each)) == sorted(mesh.element_sets["S1"])
    assert len(mesh.element_sets["S1"]) == N * CELLS
    number = int(each[2][0])
    assert number % 10 == 1
    assert mesh.where("element", number) == mesh.where("element", 1)


def test_repeated_sector_faces_are_merged(read):
    held = "*BOUNDARY\nINNER, 2, 2\n"
    once = read(wheel(1, more=SECTOR + held))
    for names in ("FIRST, LAST", "LAST, FIRST"):
        twice = read(wheel(1, more=f"{SECTOR}*TIE, CYCLIC SYMMETRY, NAME=U\n{names}\n{held}"))
        assert len(twice.position) == len(once.position)
        assert frequencies(twice, 12) == pytest.approx(frequencies(once, 12), rel=1e-9)


def test_rigid_hub_on_axis_is_merged(read):
    """Mass on the axis is that of one sector, N times in all, as CalculiX counts it."""
    hub = "*NODE\n7000, 0., 0., {}\n*RIGID BODY, NSET=INNER, REF NODE=7000\n*BOUNDARY\n7000, 1, 6\n" + (
        "*ELEMENT, TYPE=MASS, ELSET=Q\n9900, 7000\n*MASS, ELSET=Q\n{}\n"
    )

    def free(text, height, mass):
        return text.replace("*BOUNDARY\nINNER, 1, 1\nINNER, 3, 3", "") + hub.format(height, mass)

    ring, whole = read(free(wheel(1, more=SECTOR), 0.1, 3.0)), read(free(wheel(N), 0.1, 3.0 * N))
    assert len(ring.rigid) == 1
    assert frequencies(ring, 12) == pytest.approx(frequencies(whole, 12), rel=1e-8)
    assert mass_properties(ring)[0] == pytest.approx(mass_properties(whole)[0], rel=1e-12)


def wedge(off: float) -> str:
    """A sixth of a disc, one wedge with an edge on the axis, or `off` it [m]; held at the rim."""
    v = np.pi / 3
    corner = [(off, 0.0), (1.0, 0.0), (np.cos(v), np.sin(v))]
    nodes = [(*point, z) for z in (0.0, 0.5) for point in corner]
    return "\n".join(
        [
            "*NODE",
            *(f"{i + 1}, {', '.join(f'{x:.12e}' for x in point)}" for i, point in enumerate(nodes)),
            "*ELEMENT, TYPE=C3D6, ELSET=E\n1, 1, 2, 3, 4, 5, 6\n*SOLID SECTION, ELSET=E, MATERIAL=M",
            "*NSET, NSET=A\n1, 2, 4, 5\n*NSET, NSET=B\n1, 3, 4, 6",
            "*SURFACE, NAME=FIRST, TYPE=NODE\nA\n*SURFACE, NAME=LAST, TYPE=NODE\nB\n*BOUNDARY\n3, 1, 3",
            MATERIAL + SECTOR.replace("N=5", "N=6"),
        ]
    )


@pytest.mark.parametrize("off", [0.0, 1e-7, 1e-5])
def test_axis_nodes_are_merged_despite_rounding(read, off):
    ring = read(wedge(off))
    assert len(ring.position) == 2 + 2 * 6
    assert frequencies(ring, 6) == pytest.approx(frequencies(read(wedge(0.0)), 6), rel=1e-4)


test_invalid_sectors_are_refused = refusal_table(lambda more: wheel(1, more=more), [
    (SECTOR.replace("N=5", "N=7"), "do not match after a rotation by 360°/7"),
    (f"{SECTOR}*CYCLIC SYMMETRY MODEL, N=6\n0., 0., 1., 0., 0., 3.\n", "number of sectors or the symmetry axis differs from"),
    (f"{SECTOR}*CYCLIC SYMMETRY MODEL, N=5\n0., 0., 1., 0., 1., 3.\n", "number of sectors or the symmetry axis differs from"),
    # nodes 2 and 6 of the first cut face
    (f"{SECTOR}*EQUATION\n2\n2, 1, 1., 6, 1, -1.\n", r"\*EQUATION.* is on a cut face of the sector, but the opposite node"),
], placed=False)

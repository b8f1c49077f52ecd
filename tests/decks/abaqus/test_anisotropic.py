"""Anisotropic and layered solids of Abaqus decks against tensors with four indices and CalculiX."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.checks import check_mesh
from strainsight.fem.mass import mass_properties

from ...anisotropy import CONSTANTS, TURN, flexibility, strains, tensor, triclinic, turned, work, works_of
from ...bodies import body
from ...refusals import refusal_table
from ..programs import frequencies, needs_calculix, printed_frequencies
from .test_loads import bricks

ABAQUS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""11, 22, 33, 12, 13, 23 (Analysis User's Guide, Linear elastic behavior)."""
CORNERS = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], float)


def numbers(values, width=8):
    lines = [list(values)[i : i + width] for i in range(0, len(values), width)]
    return "\n".join(", ".join(f"{float(v):.10e}" for v in line) for line in lines)


ENGINEERING = "*ELASTIC, TYPE=ENGINEERING CONSTANTS\n" + numbers(np.ravel(CONSTANTS))
SKEW = "*ORIENTATION, NAME=O\n" + numbers([*TURN[:, 0], *(TURN[:, 1] + 0.3 * TURN[:, 0])], 6)


def deck(elastic, orientation="", named=", ORIENTATION=O", solid="", turn=""):
    nodes = "\n".join(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(CORNERS, start=1))
    return f"""*NODE
{nodes}
*ELEMENT, TYPE=C3D8, ELSET=ALL
1, 1, 2, 3, 4, 5, 6, 7, 8
*MATERIAL, NAME=M
{elastic}
*DENSITY
1600.
{orientation}{turn}
*SOLID SECTION, ELSET=ALL, MATERIAL=M{named if orientation else ""}{solid}
"""


def check_layers(mesh, C, volume=1.0, rtol=1e-8):
    """The work of every strain of a parallelepiped is that of the tensor."""
    check_mesh(mesh)
    expected = [volume * work(C, strain) for strain in strains()]
    np.testing.assert_allclose(works_of(assemble_stiffness(mesh), mesh.position), expected, rtol=rtol)


def check(read, text, C, rtol=1e-8):
    mesh = read(text.replace("\n\n", "\n"))
    check_layers(mesh, C, rtol=rtol)
    return mesh


def inverse(S):
    """C of S, both (3, 3, 3, 3), on the six symmetric tensors of norm one."""
    basis = []
    for i, j in ABAQUS:
        own = np.zeros((3, 3))
        own[i, j] = own[j, i] = 1.0 if i == j else np.sqrt(0.5)
        basis.append(own)
    flat = np.array([[np.einsum("ij,ijkl,kl->", a, S, b) for b in basis] for a in basis])
    return np.einsum("ab,aij,bkl->ijkl", np.linalg.inv(flat), basis, basis)


def about(axis, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    R, a, b = np.eye(3), axis % 3, (axis + 1) % 3
    R[[a, a, b, b], [a, b, a, b]] = c, -s, s, c
    return R


def orientation(system, *points):
    return f"*ORIENTATION, NAME=O{system}\n" + numbers(np.ravel(points), 6)


TRICLINIC, ORTHO = triclinic(), np.diag([9.0, 8, 7, 1, 2, 3]) * 1e9
ORTHO[:3, :3] += 1e9 * np.array([[0, 3, 2], [3, 0, 1], [2, 1, 0]])
BY_COLUMNS = numbers([TRICLINIC[i, j] for j in range(6) for i in range(j + 1)])
ORTHO_12_13_23 = numbers([*(ORTHO[i, j] for j in range(3) for i in range(j + 1)), *ORTHO.diagonal()[3:]])
C = inverse(flexibility(*CONSTANTS))
FAR = np.array([0.5, 0.5, 0.5]) - 2e4 * TURN[:, 0]
AROUND = orientation(", SYSTEM=CYLINDRICAL", FAR, FAR + TURN[:, 2])
"""About an axis far away, to the angle that a cube spans."""
ELASTIC = {
    "ANISOTROPIC": (deck(f"*ELASTIC, TYPE=ANISOTROPIC\n{BY_COLUMNS}", SKEW), turned(tensor(TRICLINIC, ABAQUS), TURN)),
    **{
        name: (deck(f"*ELASTIC, TYPE={name}\n{ORTHO_12_13_23}", SKEW), turned(tensor(ORTHO, ABAQUS), TURN))
        for name in ("ORTHOTROPIC", "ORTHO")
    },
    "basic axes": (deck(ENGINEERING), C),
    "rectangular": (deck(ENGINEERING, SKEW), turned(C, TURN)),
    "turned by 0": (deck(ENGINEERING, SKEW, turn="\n1, 0."), turned(C, TURN)),
    **{
        f"turned about {i}": (deck(ENGINEERING, SKEW, turn=f"\n{i}, 35."), turned(C, TURN @ about(i, 35)))
        for i in (1, 2, 3)
    },
    "z rectangular": (
        deck(ENGINEERING, orientation(", SYSTEM=Z RECTANGULAR", TURN[:, 2], TURN[:, 0] + 0.3 * TURN[:, 2])), turned(C, TURN),
    ),
    "cylindrical": (deck(ENGINEERING, AROUND), turned(C, TURN)),
    "cylindrical, turned": (deck(ENGINEERING, AROUND, turn="\n1, 30."), turned(C, TURN @ about(1, 30))),
}


@pytest.mark.parametrize("name", ELASTIC)
def test_anisotropic_solid_energy_matches_tensor(read, name):
    check(read, *ELASTIC[name], rtol=1e-3 if "cylindrical" in name else 1e-8)


def test_orientation_rotates_with_instance(read):
    lines = deck(ENGINEERING, SKEW).replace("\n\n", "\n").split("\n")
    at = lines.index("*MATERIAL, NAME=M")
    material, section = lines[at : at + 6], [*lines[:at], *lines[at + 6 :]]
    part = ["*PART, NAME=P", *filter(None, section), "*END PART", "*ASSEMBLY, NAME=A", "*INSTANCE, NAME=I, PART=P"]
    placed = ["1., 2., 3.", "1., 2., 3., 1., 2., 4., 90.", "*END INSTANCE", "*END ASSEMBLY"]
    text = "\n".join([*part, *placed, *material, ""])
    about_z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mesh = check(read, text, turned(inverse(flexibility(*CONSTANTS)), about_z @ TURN))
    assert mesh.regions[1].material in mesh.anisotropic
    plain = text.replace(", ORIENTATION=O", "")
    with pytest.raises(DeckError, match="anisotropic solids of a rotated instance need an ORIENTATION"):
        read(plain)


TRUSS = "ELEMENT, TYPE=T3D2, ELSET=ALL\n1, 1, 2\n*MATERIAL"
test_errors_have_remedy = refusal_table(deck(ENGINEERING, SKEW).replace, [
    (SKEW, "*ORIENTATION, NAME=O\nDIST", "the distribution 'DIST' is not supported"),
    (SKEW, SKEW + "\n4, 30.", r"the rotation axis of the \*ORIENTATION is 4"),
    ("3.0000000000e-01", "4.", "smallest eigenvalue"),
    ("ELEMENT, TYPE=C3D8, ELSET=ALL\n1, 1, 2, 3, 4, 5, 6, 7, 8\n*MATERIAL", TRUSS, "is a truss, but its material is anisotropic"),
], placed=False)


def arc(orientation):
    """A clamped arc of C3D20, 60° of a ring of 0.1 × 0.1 and a mean radius of 1."""

    def place(u, v, w):
        r, angle = 0.95 + 0.1 * u, np.radians(60) * v / 8
        return r * np.cos(angle), r * np.sin(angle), 0.1 * w

    mesh = body("hex20", (1, 8, 1), place)
    material = "\n".join([ENGINEERING, "*DENSITY\n1600.", *orientation])
    return bricks(mesh, mesh.position[:, 1] == 0, material, ", ORIENTATION=O") + "*STEP\n*FREQUENCY\n8\n*END STEP\n"


ARC = {
    "rectangular": ["*ORIENTATION, NAME=O", numbers([*TURN[:, 0], *TURN[:, 1]], 6)],
    "cylindrical": ["*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL", "0., 0., 0., 0., 0., 1."],
    "turned": ["*ORIENTATION, NAME=O", numbers([*TURN[:, 0], *TURN[:, 1]], 6), "3, 25."],
}


@needs_calculix
@pytest.mark.parametrize("name", list(ARC))
def test_frequencies_match_calculix(tmp_path, read, name):
    """Both integrate C3D20 with 27 points, and turn the axes at each: they agree to the digits that CalculiX prints."""
    text = arc(ARC[name])
    (tmp_path / "arc.inp").write_text(text)
    expected = printed_frequencies(tmp_path / "arc.inp", 8)
    np.testing.assert_allclose(frequencies(read(text), 8), expected, rtol=1e-6)


# *SOLID SECTION, COMPOSITE, against tensors with four indices; errors with file, line and remedy.
MIDDLES = np.array(
    [
        0.5 * (CORNERS[a] + CORNERS[b])
        for a, b in ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
    ]
)
WHOLE = "1, " + ", ".join(map(str, range(1, 21)))
G = 2e11 / 2.6
STEEL = tensor(G * np.diag([2.0, 2, 2, 1, 1, 1]) + 1.5 * G * np.pad(np.ones((3, 3)), (0, 3)))
CARBON = C


def layered_deck(lines, section=", ORIENTATION=O", axis="3, 0.", cells=WHOLE, kind="C3D20", more=""):
    nodes = "\n".join(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(np.vstack([CORNERS, MIDDLES]), start=1))
    return f"""*NODE
{nodes}
*ELEMENT, TYPE={kind}, ELSET=ALL
{cells}
*MATERIAL, NAME=Carbon
{ENGINEERING}
*DENSITY
1600.
*MATERIAL, NAME=STEEL
*ELASTIC
2.e11, .3
*DENSITY
7800.
*MATERIAL, NAME=PLY
*ELASTIC, TYPE=LAMINA
1.4e11, 1e10, .3, 5e9, 4e9, 3e9
{SKEW}
{axis}
{more}*SOLID SECTION, ELSET=ALL, COMPOSITE{section}
{lines}
""".replace("\n\n", "\n")


def test_composite_layers_are_weighted_and_rotated(read):
    mesh = read(layered_deck("2., 3, CARBON, 30., Ply-1\n6., , steel\n2., 1, Carbon, -45."))
    layers = (0.2, about(3, 30)), (0.2, about(3, -45))
    check_layers(mesh, 0.6 * STEEL + sum(share * turned(CARBON, TURN @ turn) for share, turn in layers))
    mass, centre = mass_properties(mesh)
    assert mass == pytest.approx(0.4 * 1600 + 0.6 * 7800, rel=1e-12)
    np.testing.assert_allclose(centre, 0.5, rtol=1e-12)


ACROSS = np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]])
LAYERS = {
    **{
        f"angle beside that of the second line, {axis}": (
            layered_deck("1., , CARBON, 30.\n3., , CARBON", axis=f"{axis}, 20."),
            0.25 * turned(CARBON, TURN @ about(axis, 50)) + 0.75 * turned(CARBON, TURN @ about(axis, 20)),
        )
        for axis in (1, 2, 3)
    },
    "symmetric": (
        layered_deck("1., , STEEL\n3., , CARBON, 20.", section=", SYMMETRIC, ORIENTATION=O"),
        0.25 * STEEL + 0.75 * turned(CARBON, TURN @ about(3, 20)),
    ),
    "an orientation of a layer": (
        layered_deck("1., , CARBON, ACROSS\n1., , CARBON", more="*ORIENTATION, NAME=ACROSS\n0., 0., 1., 0., 1., 0.\n"),
        0.5 * turned(CARBON, ACROSS) + 0.5 * turned(CARBON, TURN),
    ),
    "basic axes": (layered_deck("1., , STEEL\n1., , CARBON, 0.", section=""), 0.5 * STEEL + 0.5 * CARBON),
}


@pytest.mark.parametrize("name", LAYERS)
def test_layer_axes_follow_orientation_and_angle(read, name):
    mesh = read(LAYERS[name][0])
    check_layers(mesh, LAYERS[name][1])
    assert len(mesh.composites[1].layers) == (4 if name == "symmetric" else 2)


@pytest.mark.parametrize(
    ("named", "along"), [("", 2), (", STACK DIRECTION=3", 2), (", STACK DIRECTION=1", 0), (", STACKDIRECTION=2", 1)]
)
def test_first_layer_is_at_start_of_stack_direction(read, named, along):
    """Isoparametric directions of Abaqus: 1 from node 1 to 2, 2 from 1 to 4, 3 from 1 to 5; the heavier end is the first."""
    mesh = read(layered_deck("1., , STEEL\n3., , CARBON, 0., Ply-2", section=named + ", ORIENTATION=O, LAYUP=L"))
    _, centre = mass_properties(mesh)
    expected = np.full(3, 0.5)
    expected[along] = (0.25 * 7800 * 0.125 + 0.75 * 1600 * 0.625) / (0.25 * 7800 + 0.75 * 1600)
    np.testing.assert_allclose(centre, expected, rtol=1e-12)
    assert mesh.composites[1].direction == along


test_errors_have_file_line_and_remedy = refusal_table(lambda lines, more: layered_deck(lines, **more), [
    ("1., , STEEL\n0., , STEEL", {}, "the thickness of layer 2 is 0, not positive", 43),
    ("1., 3", {}, "layer 1 has no material", 42),
    ("1., , PLY", {}, "material 'PLY' has TYPE=LAMINA, which does not define the stiffness of solids", 42),
    ("1., , CARBON, 5.", {"section": ""}, "layer 1 is anisotropic and rotated by 5°, but its section has no", 42),
    ("1., , CARBON, 5.", {"axis": ""}, "layer 1 is rotated by 5°, but the ORIENTATION at", 41),
    ("1., , STEEL", {"kind": "C3D4", "cells": "1, 1, 2, 4, 5"}, "C3D4 1 cannot have layers", 41),
    ("1., , STEEL", {"kind": "C3D6", "cells": "1, 1, 2, 3, 5, 6, 7", "section": ", STACK DIRECTION=1"}, "in direction 1", 41),
])


def test_layers_rotate_with_instance(read):
    text = layered_deck("1., , CARBON, 30.\n1., , STEEL")
    head, tail = text.split("*MATERIAL", 1)
    materials, rest = ("*MATERIAL" + tail).split("*ORIENTATION", 1)
    instance = "*INSTANCE, NAME=I, PART=P\n0., 0., 0.\n0., 0., 0., 0., 0., 1., 90.\n*END INSTANCE"
    part = f"*PART, NAME=P\n{head}*ORIENTATION{rest}*END PART"
    whole = f"{part}\n*ASSEMBLY, NAME=A\n{instance}\n*END ASSEMBLY\n{materials}"
    C = 0.5 * turned(CARBON, about(3, 90) @ TURN @ about(3, 30)) + 0.5 * STEEL
    check_layers(read(whole), C)
    with pytest.raises(DeckError, match="layer 1 is anisotropic and in a rotated instance, but its section has no"):
        read(whole.replace(", ORIENTATION=O", "").replace("CARBON, 30.", "CARBON"))

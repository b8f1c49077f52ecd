"""*SOLID SECTION, COMPOSITE, against tensors with four indices; errors with file, line and remedy."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.checks import check_mesh
from strainsight.fem.mass import mass_properties

from ...anisotropy import CONSTANTS, TURN, flexibility, strains, tensor, turned, work, works_of
from .test_anisotropic import CORNERS, ENGINEERING, SKEW, inverse

MIDDLES = np.array(
    [
        0.5 * (CORNERS[a] + CORNERS[b])
        for a, b in ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7))
    ]
)
WHOLE = "1, " + ", ".join(map(str, range(1, 21)))
G = 2e11 / 2.6
STEEL = tensor(G * np.diag([2.0, 2, 2, 1, 1, 1]) + 1.5 * G * np.pad(np.ones((3, 3)), (0, 3)))
CARBON = inverse(flexibility(*CONSTANTS))


def deck(
    lines,
    section=", ORIENTATION=O",
    axis="3, 0.",
    cells=WHOLE,
    kind="C3D20",
    more="",
):
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


def about(axis, degrees):
    """Columns: axes turned about one of them, 1, 2 or 3."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    R, a, b = np.eye(3), axis % 3, (axis + 1) % 3
    R[[a, a, b, b], [a, b, a, b]] = c, -s, s, c
    return R


def check(mesh, C):
    check_mesh(mesh)
    found = works_of(assemble_stiffness(mesh), mesh.position)
    np.testing.assert_allclose(found, [work(C, own) for own in strains()], rtol=1e-8)


def test_layers_count_by_their_share_and_turn_about_the_axis_of_the_section(read):
    mesh = read(deck("2., 3, CARBON, 30., Ply-1\n6., , steel\n2., 1, Carbon, -45."))
    layers = (0.2, about(3, 30)), (0.2, about(3, -45))
    check(mesh, 0.6 * STEEL + sum(share * turned(CARBON, TURN @ turn) for share, turn in layers))
    mass, centre = mass_properties(mesh)
    assert mass == pytest.approx(0.4 * 1600 + 0.6 * 7800, rel=1e-12)
    np.testing.assert_allclose(centre, 0.5, rtol=1e-12)


@pytest.mark.parametrize("axis", [1, 2, 3])
def test_the_angle_is_added_to_the_turn_of_the_second_line(read, axis):
    mesh = read(deck("1., , CARBON, 30.\n3., , CARBON", axis=f"{axis}, 20."))
    parts = 0.25 * turned(CARBON, TURN @ about(axis, 50)) + 0.75 * turned(CARBON, TURN @ about(axis, 20))
    check(mesh, parts)


@pytest.mark.parametrize(
    ("named", "along"), [("", 2), (", STACK DIRECTION=3", 2), (", STACK DIRECTION=1", 0), (", STACKDIRECTION=2", 1)]
)
def test_the_first_layer_is_where_the_direction_begins(read, named, along):
    """Isoparametric directions of Abaqus: 1 from node 1 to 2, 2 from 1 to 4, 3 from 1 to 5; the heavier end is the first."""
    mesh = read(deck("1., , STEEL\n3., , CARBON, 0., Ply-2", section=named + ", ORIENTATION=O, LAYUP=L"))
    _, centre = mass_properties(mesh)
    expected = np.full(3, 0.5)
    expected[along] = (0.25 * 7800 * 0.125 + 0.75 * 1600 * 0.625) / (0.25 * 7800 + 0.75 * 1600)
    np.testing.assert_allclose(centre, expected, rtol=1e-12)
    assert mesh.composites[1].direction == along


def test_symmetric_layers_are_mirrored(read):
    mesh = read(deck("1., , STEEL\n3., , CARBON, 20.", section=", SYMMETRIC, ORIENTATION=O"))
    assert [own.thickness for own in mesh.composites[1].layers] == [1, 3, 3, 1]
    check(mesh, 0.25 * STEEL + 0.75 * turned(CARBON, TURN @ about(3, 20)))


def test_a_layer_may_have_an_orientation_of_its_own(read):
    """Whatever that of the section is."""
    other = "*ORIENTATION, NAME=ACROSS\n0., 0., 1., 0., 1., 0.\n"
    mesh = read(deck("1., , CARBON, ACROSS\n1., , CARBON", more=other))
    across = np.array([[0, 0, -1.0], [0, 1, 0], [1, 0, 0]])
    check(mesh, 0.5 * turned(CARBON, across) + 0.5 * turned(CARBON, TURN))


def test_isotropic_layers_need_no_axes(read):
    check(read(deck("1., , STEEL, 45.\n1., , STEEL, 0.", section="")), STEEL)


def test_along_the_basic_axes_without_an_orientation(read):
    check(read(deck("1., , STEEL\n1., , CARBON, 0.", section="")), 0.5 * STEEL + 0.5 * CARBON)


@pytest.mark.parametrize("kind", ["C3D8", "C3D8R", "C3D8I", "C3D20R", "C3D6", "C3D15"])
def test_the_elements_that_may_have_layers(read, kind):
    own = {"C3D8": [*range(1, 9)], "C3D6": [1, 2, 3, 5, 6, 7], "C3D15": None}.get(
        kind[:4] if kind[3] == "8" else kind, [*range(1, 21)]
    )
    text = deck("1., , STEEL\n1., , STEEL", section="", kind=kind)
    if own is None:
        own = [1, 2, 3, 5, 6, 7, 9, 10, 21, 13, 14, 22, 17, 18, 19]
        text = text.replace("*ELEMENT", "21, .5, .5, 0.\n22, .5, .5, 1.\n*ELEMENT")
    cells = "1, " + ", ".join(map(str, own))
    mesh = read(text.replace(WHOLE, cells))
    check_mesh(mesh)
    assert mass_properties(mesh)[0] == pytest.approx(7800 * (0.5 if len(own) in (6, 15) else 1.0), rel=1e-9)


@pytest.mark.parametrize(
    ("lines", "options", "what", "line", "remedy"),
    [
        ("1., , STEEL\n0., , STEEL", {}, "the thickness of layer 2 is 0, not positive", 1, "positive thickness"),
        ("-1., , STEEL", {}, "the thickness of layer 1 is -1, not positive", 0, "positive thickness"),
        (", , STEEL", {}, "the thickness of layer 1", 0, ""),
        ("1., , STEEL\n1., , IRON", {}, "material 'IRON' is not in the deck", 1, "add the"),
        ("1., 3", {}, "layer 1 has no material", 0, "third entry"),
        ("1., , PLY", {}, "TYPE=LAMINA, which does not say what solids resist across", 0, "ENGINEERING CONSTANTS"),
        ("1., , CARBON, NONE", {}, "orientation 'NONE' is not in the deck", 0, "add the"),
        ("1., , CARBON, 5.", {"section": ""}, "turned by 5°, and its section has no ORIENTATION", 0, "second line"),
        ("1., , CARBON, 5.", {"axis": ""}, "does not say about which of its axes", 0, "1, 2 or 3, and the angle 0"),
        ("1., , STEEL", {"section": ", STACK DIRECTION=4"}, "STACK DIRECTION=4 is none", -1, "1, 2 or 3"),
        ("1., , STEEL", {"section": ", STACK DIRECTION=Z"}, "STACK DIRECTION=Z is none", -1, "1, 2 or 3"),
        ("1., , STEEL", {"section": ", MATERIAL=STEEL"}, "it is COMPOSITE and has a MATERIAL", -1, "one of them"),
        ("1., , STEEL", {"kind": "C3D4", "cells": "1, 1, 2, 4, 5"}, "C3D4 1 can have no layers", -1, "hexahedra"),
        (
            "1., , STEEL",
            {"kind": "C3D6", "cells": "1, 1, 2, 3, 5, 6, 7", "section": ", STACK DIRECTION=1"},
            "no direction 1",
            -1,
            "=3",
        ),
        ("", {}, "no data line follows", -1, ""),
    ],
)
def test_what_is_wrong_is_named_with_file_line_and_remedy(read, lines, options, what, line, remedy):
    text = deck(lines, **options)
    with pytest.raises(DeckError, match=what) as error:
        read(text)
    first = 2 + text[: text.index("*SOLID SECTION")].count("\n")
    assert error.value.where.endswith(f":{first + line}")
    assert remedy in error.value.remedy


def test_layers_of_an_instance_turn_with_it(read):
    """A part turned by 90° about z: its orientation too; without one an anisotropic layer is refused."""
    text = deck("1., , CARBON, 30.\n1., , STEEL")
    head, tail = text.split("*MATERIAL", 1)
    materials, rest = ("*MATERIAL" + tail).split("*ORIENTATION", 1)
    instance = "*INSTANCE, NAME=I, PART=P\n0., 0., 0.\n0., 0., 0., 0., 0., 1., 90.\n*END INSTANCE"
    part = f"*PART, NAME=P\n{head}*ORIENTATION{rest}*END PART"
    whole = f"{part}\n*ASSEMBLY, NAME=A\n{instance}\n*END ASSEMBLY\n{materials}"
    C = 0.5 * turned(CARBON, about(3, 90) @ TURN @ about(3, 30)) + 0.5 * STEEL
    check(read(whole), C)
    with pytest.raises(DeckError, match="of an instance that is turned, and its section has no ORIENTATION"):
        read(whole.replace(", ORIENTATION=O", "").replace("CARBON, 30.", "CARBON"))

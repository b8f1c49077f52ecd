"""*ELASTIC of anisotropic solids along *ORIENTATION, against tensors with four indices and CalculiX; errors with their remedy."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.checks import check_mesh
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes

from ...anisotropy import CONSTANTS, TURN, flexibility, strains, tensor, triclinic, turned, work, works_of

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


def check(read, text, C, rtol=1e-8):
    """The work of every strain of a unit cube is that of the tensor."""
    mesh = read(text.replace("\n\n", "\n"))
    check_mesh(mesh)
    found = works_of(assemble_stiffness(mesh), mesh.position)
    np.testing.assert_allclose(found, [work(C, own) for own in strains()], rtol=rtol)
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


def test_anisotropic_is_written_by_columns(read):
    D = triclinic()
    values = [D[i, j] for j in range(6) for i in range(j + 1)]
    check(read, deck("*ELASTIC, TYPE=ANISOTROPIC\n" + numbers(values), SKEW), turned(tensor(D, ABAQUS), TURN))


@pytest.mark.parametrize("name", ["ORTHOTROPIC", "ORTHO"])
def test_orthotropic_states_12_13_23(read, name):
    D = np.diag([9.0, 8, 7, 1, 2, 3]) * 1e9
    D[:3, :3] += 1e9 * np.array([[0, 3, 2], [3, 0, 1], [2, 1, 0]])
    values = [D[0, 0], D[0, 1], D[1, 1], D[0, 2], D[1, 2], D[2, 2], D[3, 3], D[4, 4], D[5, 5]]
    check(read, deck(f"*ELASTIC, TYPE={name}\n" + numbers(values), SKEW), turned(tensor(D, ABAQUS), TURN))


@pytest.mark.parametrize(
    ("turn", "more"),
    [("", np.eye(3)), ("\n1, 0.", np.eye(3))]
    + [(f"\n{i}, 35.", Rotation.from_rotvec(np.radians(35) * np.eye(3)[i - 1]).as_matrix()) for i in (1, 2, 3)],
)
def test_engineering_constants_along_an_orientation_that_is_turned(read, turn, more):
    """The angle of the second line turns the axes about that axis, right-handed."""
    C = turned(inverse(flexibility(*CONSTANTS)), TURN @ more)
    check(read, deck(ENGINEERING, SKEW, turn=turn), C)


def test_without_orientation_the_axes_are_the_basic_ones(read):
    check(read, deck(ENGINEERING), inverse(flexibility(*CONSTANTS)))


def test_z_rectangular_has_its_first_point_on_z(read):
    text = "*ORIENTATION, NAME=O, SYSTEM=Z RECTANGULAR\n" + numbers([*TURN[:, 2], *(TURN[:, 0] + 0.3 * TURN[:, 2])], 6)
    check(read, deck(ENGINEERING, text), turned(inverse(flexibility(*CONSTANTS)), TURN))


def test_cylindrical_is_radial_tangential_axial_and_turns_about_them(read):
    """A cube far away from the axis, to the angle that it spans."""
    far = 2e4
    a = np.array([0.5, 0.5, 0.5]) - far * TURN[:, 0]
    text = "*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL\n" + numbers([*a, *(a + TURN[:, 2])], 6)
    C = inverse(flexibility(*CONSTANTS))
    check(read, deck(ENGINEERING, text), turned(C, TURN), rtol=1e-3)
    more = Rotation.from_rotvec([np.radians(30), 0, 0]).as_matrix()
    check(read, deck(ENGINEERING, text, turn="\n1, 30."), turned(C, TURN @ more), rtol=1e-3)


def test_an_instance_that_is_turned_takes_its_orientation_with_it(read):
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
    with pytest.raises(DeckError, match="turned have no ORIENTATION"):
        read(plain)


@pytest.mark.parametrize(
    ("old", "new", "what", "remedy"),
    [
        (SKEW, "*ORIENTATION, NAME=O\nDIST", "'DIST' is a distribution", "orientation of its own"),
        (SKEW, "*ORIENTATION, NAME=O, SYSTEM=SPHERICAL\n0.,0.,0.,0.,0.,1.", "SYSTEM=SPHERICAL", "cylindrical"),
        (SKEW, "*ORIENTATION, NAME=O, DEFINITION=NODES\n1,2,3", "DEFINITION=NODES", "by coordinates"),
        (SKEW, SKEW + "\n4, 30.", "axis 4", "1, 2 or 3"),
        ("NAME=O", "NAME=P", "orientation 'O' is not in the deck", "ORIENTATION"),
        ("1.4000000000e+11", "-1.", "E1 is -1, not positive", "positive modulus"),
        ("3.0000000000e-01", "4.", "least eigenvalue is -", "E_i/E_j"),
        ("C3D8", "T3D2", "", ""),
    ],
)
def test_what_is_wrong_is_named_with_its_remedy(read, old, new, what, remedy):
    text = deck(ENGINEERING, SKEW)
    assert old in text
    text = text.replace(old, new)
    if new == "T3D2":
        text = text.replace("1, 1, 2, 3, 4, 5, 6, 7, 8", "1, 1, 2")
        what, remedy = "is a truss, and its material is anisotropic", "isotropic material"
    with pytest.raises(DeckError, match=what) as error:
        read(text)
    assert remedy in error.value.remedy


def test_lines_by_temperature_are_counted_in_pairs(read):
    two = ENGINEERING + ", 20.\n" + numbers(np.ravel(CONSTANTS)) + ", 90."
    assert "the first 2 of 4 lines of *ELASTIC count" in "".join(read(deck(two, SKEW)).notes)
    assert "lines" not in "".join(read(deck(ENGINEERING, SKEW)).notes)


def bar(orientation):
    """A clamped arc of C3D20, 60° of a ring of 0.1 × 0.1 and a mean radius of 1."""
    n, cells, at = [], [], {}
    radial, around = 1, 8

    def node(i, j, k):
        if (i, j, k) not in at:
            r, angle = 0.95 + 0.05 * i / radial, np.radians(60) * j / (2 * around)
            at[i, j, k] = len(at) + 1
            n.append((r * np.cos(angle), r * np.sin(angle), 0.05 * k))
        return at[i, j, k]

    corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
    for j in range(around):
        own = [node(a, b + 2 * j, c) for a, b, c in corners]
        own += [node(*((np.array(corners[a]) + corners[b]) // 2 + (0, 2 * j, 0)).tolist()) for a, b in edges]
        cells.append(own)
    held = [i for (_, j, _), i in at.items() if j == 0]
    lines = ["*NODE", *(f"{i}, {x:.12e}, {y:.12e}, {z:.12e}" for i, (x, y, z) in enumerate(n, start=1))]
    lines += ["*ELEMENT, TYPE=C3D20, ELSET=ALL"]
    for e, own in enumerate(cells, start=1):
        lines += [", ".join(map(str, [e, *own[:10]])) + ",", ", ".join(map(str, own[10:]))]
    lines += ["*MATERIAL, NAME=M", ENGINEERING, "*DENSITY", "1600.", *orientation]
    lines += ["*SOLID SECTION, ELSET=ALL, MATERIAL=M, ORIENTATION=O", "*BOUNDARY", *(f"{i}, 1, 3" for i in held)]
    return "\n".join([*lines, "*STEP", "*FREQUENCY", "8", "*END STEP", ""])


ARC = {
    "rectangular": ["*ORIENTATION, NAME=O", numbers([*TURN[:, 0], *TURN[:, 1]], 6)],
    "cylindrical": ["*ORIENTATION, NAME=O, SYSTEM=CYLINDRICAL", "0., 0., 0., 0., 0., 1."],
    "turned": ["*ORIENTATION, NAME=O", numbers([*TURN[:, 0], *TURN[:, 1]], 6), "3, 25."],
}


@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
@pytest.mark.parametrize("name", list(ARC))
def test_frequencies_are_those_of_calculix(tmp_path, read, name):
    """Both integrate C3D20 with 27 points, and turn the axes at each: they agree to the digits that CalculiX prints."""
    text = bar(ARC[name])
    (tmp_path / "arc.inp").write_text(text)
    subprocess.run(["ccx", "arc"], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL, timeout=60)
    rows = [line.split() for line in (tmp_path / "arc.dat").read_text().splitlines()]
    expected = [float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()][:8]
    model = build_model(read(text))
    found, _ = modes(model.stiffness.constant, model.mass.constant, 8)
    assert len(expected) == 8
    np.testing.assert_allclose(found, expected, rtol=1e-6)

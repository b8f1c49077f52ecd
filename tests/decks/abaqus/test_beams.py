"""Beams and trusses of Abaqus decks: axes, moments by integrals over the shape, offsets; errors with their remedy."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.decks.abaqus.deck import read_abaqus

from ...refusals import refusal_table
from ..programs import displacements, needs_calculix, printed_displacements

FRAME = """\
*NODE
1, 0., 0., 0.
2, 3., 4., 0.
3, 3., 4., 2.
*ELEMENT, TYPE=B31, ELSET=BAR
10, 1, 2
*ELEMENT, TYPE=T3D2, ELSET=ROD
11, 2, 3
*MATERIAL, NAME=STEEL
*ELASTIC
2.1e11, .3
*DENSITY
7850.
*BEAM SECTION, ELSET=BAR, MATERIAL=STEEL, SECTION=RECT
.2, .1
0., 0., 2.
*SOLID SECTION, ELSET=ROD, MATERIAL=STEEL
.03
"""


def changed(old, new):
    assert old in FRAME
    return FRAME.replace(old, new)


def test_beams_are_imported_with_axes_regions_and_lines(read):
    """t = (3, 4, 0)/5 and n1 = z, so that n2 = t × n1 = (4, −3, 0)/5."""
    mesh = read(FRAME)
    bar, rod = mesh.beams
    assert (bar.kind, bar.ids.tolist(), bar.nodes.tolist(), bar.region.tolist()) == ("beam", [10], [[0, 1]], [1])
    assert (rod.kind, rod.ids.tolist(), rod.nodes.tolist(), rod.region.tolist()) == ("rod", [11], [[1, 2]], [2])
    np.testing.assert_allclose(bar.axes[0].T, [[0.6, 0.8, 0], [0, 0, 1], [0.8, -0.6, 0]], atol=1e-15)
    np.testing.assert_allclose(rod.axes[0, :, 0], [0, 0, 1])
    assert not bar.offset.any()
    assert not bar.released.any()
    assert {i: (region.name, region.material) for i, region in mesh.regions.items()} == {1: ("BAR", 1), 2: ("ROD", 1)}
    assert mesh.sections[2].area == 0.03
    assert mesh.where("element", 11).endswith("deck.inp:8")
    assert mesh.element_sets["BAR"].tolist() == [10]
    assert mesh.blocks == mesh.shells == mesh.notes == ()
    assert mesh.ignored == {}


@pytest.mark.parametrize(
    ("lines", "n1"),
    [("", (0, 0, -1)), (",,\n", (0, 0, -1)), ("1., 0., 0.\n", (0.8, -0.6, 0)), ("0., 5., 0.\n", (-0.8, 0.6, 0))],
)
def test_n1_is_orthogonalised_with_default(read, lines, n1):
    axes = read(changed("0., 0., 2.\n", lines)).beams[0].axes[0]
    np.testing.assert_allclose(axes[:, 1], n1, atol=1e-15)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1)


def test_third_node_overrides_section_direction(read):
    text = changed("10, 1, 2", "10, 1, 2, 4").replace("3, 3., 4., 2.", "3, 3., 4., 2.\n4, 3., 0., 0.")
    mesh = read(text)
    np.testing.assert_allclose(mesh.beams[0].axes[0, :, 1], [0.8, -0.6, 0], atol=1e-15)
    assert mesh.beams[0].nodes.tolist() == [[0, 1]]


def test_beams_rotate_with_instance(read):
    part, rest = FRAME[: FRAME.index("*MATERIAL")], FRAME[FRAME.index("*BEAM") :].replace("0., 0., 2.", "0., 1., 0.")
    place = "*INSTANCE, NAME=A, PART=P\n0., 0., 0.\n0., 0., 0., 0., 0., 1., 90.\n*END INSTANCE\n"
    material = FRAME[FRAME.index("*MATERIAL") : FRAME.index("*BEAM")]
    mesh = read(f"*PART, NAME=P\n{part}{rest}*END PART\n*ASSEMBLY, NAME=S\n{place}*END ASSEMBLY\n{material}")
    np.testing.assert_allclose(mesh.beams[0].axes[0, :, :2].T, [[-0.8, 0.6, 0], [-0.6, -0.8, 0]], atol=1e-14)


N = 2001


def integrals(walls):
    """Area, centroid and moments about it (n1, n2) of rectangles (n1 from, to, n2 from, to), by the midpoint rule."""
    A, S, I = 0.0, np.zeros(2), np.zeros((2, 2))
    for a, b, c, d in walls:
        u, v = a + (np.arange(N) + 0.5) * (b - a) / N, c + (np.arange(N) + 0.5) * (d - c) / N
        area = (b - a) * (d - c)
        A, S = A + area, S + area * np.array([u.mean(), v.mean()])
        I = I + area * np.array([[np.mean(u * u), u.mean() * v.mean()], [u.mean() * v.mean(), np.mean(v * v)]])
    return A, S / A, I - np.outer(S, S) / A


I_SHAPE = [(-0.05, 0.05, -0.08, -0.06), (-0.01, 0.01, -0.06, 0.09), (-0.1, 0.1, 0.09, 0.12)]
SHAPES = {
    "RECT": (".2, .1", [(-0.1, 0.1, -0.05, 0.05)]),
    "BOX": (
        ".2, .1, .01, .02, .03, .04",
        [(0.09, 0.1, -0.05, 0.05), (-0.07, 0.09, 0.03, 0.05), (-0.1, -0.07, -0.05, 0.05), (-0.07, 0.09, -0.05, -0.01)],
    ),
    "I": (".08, .2, .1, .2, .02, .03, .02", I_SHAPE),
    "i ": (".08, .17, .1, 0., .02, 0., .02", I_SHAPE[:2]),
    "I  ": (".06, .18, 0., .2, 0., .03, .02", I_SHAPE[1:]),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_section_moments_match_integrals(read, shape):
    """The node is the origin of the shapes; of an I it lies l above its foot. T is an I with one flange."""
    dimensions, walls = SHAPES[shape]
    A, centroid, I = integrals(walls)
    mesh = read(changed("SECTION=RECT\n.2, .1", f"SECTION={shape}\n{dimensions}"))
    section, bar = mesh.sections[1], mesh.beams[0]
    assert section.area == pytest.approx(A)
    np.testing.assert_allclose(section.second, I, rtol=1e-6, atol=1e-9 * I.max())
    across = bar.axes[0, :, 1:]
    np.testing.assert_allclose(bar.offset[0], [across @ centroid] * 2, atol=1e-12)
    corners = np.array([[x, y] for a, b, c, d in walls for x in (a, b) for y in (c, d)]) - centroid
    for u, v in section.points + centroid:
        assert any(a - 1e-12 < u < b + 1e-12 and c - 1e-12 < v < d + 1e-12 for a, b, c, d in walls)
    assert np.ptp(section.points, axis=0) == pytest.approx(np.ptp(corners, axis=0))


def test_shear_factors_of_rectangle_and_web(read):
    assert read(FRAME).sections[1].shear == pytest.approx((5 / 6, 5 / 6))
    shear = read(changed("SECTION=RECT\n.2, .1", f"SECTION=I\n{SHAPES['I'][0]}")).sections[1].shear
    A = integrals(I_SHAPE)[0]
    assert shear == pytest.approx((5 / 6 * (0.1 * 0.02 + 0.2 * 0.03) / A, 0.15 * 0.02 / A))


@pytest.mark.parametrize(
    ("shape", "given", "inner"),
    [("CIRC", ".1", 0.0), ("CIRC", ".2, .2", 0.0), ("PIPE", ".1, .02", 0.08), ("THICK PIPE", ".1, .02", 0.08)],
)
def test_round_sections(read, shape, given, inner):
    section = read(changed("SECTION=RECT\n.2, .1", f"SECTION={shape}\n{given}")).sections[1]
    assert section.area == pytest.approx(np.pi * (0.1**2 - inner**2))
    np.testing.assert_allclose(section.second, np.pi * (0.1**4 - inner**4) / 4 * np.eye(2))
    assert section.torsion == pytest.approx(np.pi * (0.1**4 - inner**4) / 2)


@pytest.mark.parametrize(
    ("given", "expected"),
    [("OFFSET1=.5", (-0.1, 0)), ("OFFSET1=-.5, OFFSET2=1.", (0.1, -0.1)), ("OFFSET2=-.25", (0, 0.025))],
)
def test_calculix_offsets_are_in_thicknesses(read, given, expected):
    bar = read(changed("SECTION=RECT\n", f"SECTION=RECT, {given}\n")).beams[0]
    np.testing.assert_allclose(bar.offset[0], [bar.axes[0, :, 1:] @ expected] * 2, atol=1e-15)


GENERAL = "*BEAM GENERAL SECTION, ELSET=BAR, SECTION=GENERAL, DENSITY=7000.\n.02, 3.e-5, 1.e-5, 7.e-5, 9.e-5\n0., 0., 2.\n"


def general(lines):
    start, end = FRAME.index("*BEAM"), FRAME.index("*SOLID SECTION")
    return FRAME[:start] + lines + FRAME[end:]


def test_general_section_has_moments_and_material(read):
    """I11 resists bending about n1: it is the integral over n2²."""
    mesh = read(general(GENERAL + "2.e11, 8.e10\n"))
    section, material = mesh.sections[1], mesh.materials[mesh.regions[1].material]
    assert (section.area, section.torsion, section.shear) == (0.02, 9e-5, (1, 1))
    np.testing.assert_allclose(section.second, [[7e-5, 1e-5], [1e-5, 3e-5]])
    assert (material.youngs_modulus, material.poisson_ratio, material.density) == pytest.approx((2e11, 0.25, 7000))
    assert str(material) == "material of BAR"
    assert [note.partition(": ")[2] for note in mesh.notes] == [
        "I12 = 1e-05 is imported as ∫ x1 x2 dA, with x1 along n1 and x2 along n2"
    ]
    assert mesh.materials[mesh.regions[2].material].youngs_modulus == 2.1e11
    np.testing.assert_allclose(mesh.beams[0].axes[0, :, 1], [0, 0, 1], atol=1e-15)


def test_general_section_allows_default_n1_or_material(read):
    short = read(general(GENERAL.replace("0., 0., 2.\n", "") + "2.e11, 8.e10\n"))
    np.testing.assert_allclose(short.beams[0].axes[0, :, 1], [0, 0, -1], atol=1e-15)
    named = read(general(GENERAL.replace("DENSITY=7000.", "MATERIAL=STEEL")))
    assert len(named.materials) == 1
    np.testing.assert_allclose(named.beams[0].axes[0, :, 1], [0, 0, 1], atol=1e-15)
    shape = read(general("*BEAM GENERAL SECTION, ELSET=BAR, SECTION=RECT\n.2, .1\n0., 0., 1.\n2.e11, 8.e10\n"))
    assert shape.sections[1].area == pytest.approx(0.02)
    assert any("has no DENSITY" in note for note in shape.notes)


def test_inconsistent_shear_modulus_preserves_torsion_and_shear(read):
    mesh = read(general(GENERAL + "2.e11, 5.e10\n"))
    section, material = mesh.sections[1], mesh.materials[mesh.regions[1].material]
    G = material.youngs_modulus / (2 * (1 + material.poisson_ratio))
    assert G * section.torsion == pytest.approx(5e10 * 9e-5)
    assert G * section.shear[0] * section.area == pytest.approx(5e10 * 0.02)
    assert any("J and the shear factors are scaled" in note for note in mesh.notes)


def test_b33_does_not_shear(read):
    assert read(changed("TYPE=B31", "TYPE=B33")).sections[1].shear == (0, 0)
    assert read(changed("TYPE=B31", "TYPE=B31H")).sections[1].shear == pytest.approx((5 / 6, 5 / 6))


RECT = "SECTION=RECT\n.2, .1\n"


test_errors_have_file_and_line = refusal_table(changed, [
    ("10, 1, 2", "10, 1, 9", r"B31 10 refers to a node that is not in the deck \(position 2 in the node list", 6),
    ("3, 3., 4., 2.", "3, 3., 4., 0.", "T3D2 11 has no length", 8),
    ("0., 0., 2.", "3., 4., 0.", r"is parallel to the first axis n1 \(3, 4, 0\) of its section", 6),
    (RECT, "SECTION=RECT\n.2, -.1\n", "b of SECTION=RECT is -0.1", 15),
    (RECT, "SECTION=CIRC\n.2, .1\n", r"an elliptical section \(CalculiX\) is not supported", 15),
    (RECT, "SECTION=BOX\n.2, .1, .1, .1, .1, .1\n", r"the dimensions 0\.2, 0\.1, 0\.1, 0\.1, 0\.1, 0\.1 of SECTION=BOX are", 15),
    (RECT, "SECTION=I\n.1, .2, 0., 0., 0., 0., .01\n", "the I section has no flanges", 15),
    ("SECTION=RECT", "SECTION=RECT, NODAL THICKNESS", "tapered sections are not supported", 14),
    ("*BEAM SECTION, ELSET=BAR", "*SOLID SECTION, ELSET=BAR", "contains B31 10, to which this section does not apply", 14),
    ("\n.03\n", "\n-.03\n", "the area is -0.03", 18),
    ("B31, ELSET=BAR\n10, 1, 2", "B33, ELSET=BAR\n10, 1, 2\n*ELEMENT, TYPE=B31, ELSET=BAR\n12, 1, 3", "B31 and B33", 16),
])


test_invalid_general_sections_are_refused = refusal_table(
    lambda lines: general(f"*BEAM GENERAL SECTION, ELSET=BAR, SECTION=GENERAL\n{lines}"), [
    (".02, 3.e-5, 1.e-5, 7.e-5, 9.e-5\n", "the line with Young's modulus and shear modulus is missing"),
    (".02, 3.e-5, 1.e-4, 7.e-5, 9.e-5\n2.e11, 8.e10\n", r"I12 = 0\.0001 is too large for I11 = 3e-05 and I22 ="),
], placed=False)


@pytest.mark.slow
@needs_calculix
def test_cantilever_bending_matches_calculix(tmp_path):
    """CalculiX makes solids of the beams: deflections along n1 and n2, fivefold apart, agree to 0.1 %."""
    path = tmp_path / "beam.inp"
    lines = ["*NODE", *(f"{1 + i}, {0.06 * i}, {0.08 * i}, 0." for i in range(21)), "*NSET, NSET=END", "21,"]
    lines += ["*ELEMENT, TYPE=B31, ELSET=BAR", *(f"{1 + i}, {1 + i}, {2 + i}" for i in range(20))]
    lines += FRAME[FRAME.index("*MATERIAL") : FRAME.index("*SOLID")].replace("\n.2, .1", "\n.1, .04").splitlines()
    lines += ["*BOUNDARY", "1, 1, 6"]
    for c, force in (("3", "1.E4"), ("1", "8.E3")):
        lines += ["*STEP", "*STATIC", "*CLOAD, OP=NEW", f"21, {c}, {force}", *(["21, 2, -6.E3"] if c == "1" else [])]
        lines += ["*NODE PRINT, NSET=END", "U", "*END STEP"]
    path.write_text("\n".join([*lines, ""]))
    expected = printed_displacements(path)
    tip = [u[20] for u in displacements(read_abaqus(path), "CLOAD-1", "CLOAD-2")]
    np.testing.assert_allclose(tip, expected, rtol=0.002, atol=1e-9)

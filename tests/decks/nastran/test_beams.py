"""CBAR, CBEAM and rods: sections, axes, offsets and pins by their definitions; errors with their remedy."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.model import build_model
from strainsight.fem.shells_and_beams import thin_operators
from strainsight.mesh.units import rescaled
from strainsight.records.mesh import MeshColumns

from ...refusals import refusal_table

BAR = """\
GRID,1,,0.,0.,0.
GRID,2,,2.,0.,0.
GRID,3,,0.,1.,0.,6
GRID,4,,0.,3.,0.
CBAR,10,1,1,2,0.,0.,1.
PBAR,1,1,.01,2.-5,1.-5,3.-5,7.
MAT1,1,2.1+11,,.3,7850.
CORD2R,6,,0.,0.,0.,1.,0.,0.
,0.,0.,1.
"""
CARD, PBAR = "CBAR,10,1,1,2,0.,0.,1.", "PBAR,1,1,.01,2.-5,1.-5,3.-5,7."
"""System 6 has z along x, x along z and so y against y."""


def deck(card=CARD, pbar=PBAR, more=""):
    return BAR.replace(CARD, card).replace(PBAR, pbar) + more


def test_cbar_is_imported_with_section_ids_and_lines(read):
    mesh = read(deck(more="SET3,5,ELEM,10\n"))
    (block,) = mesh.beams
    assert (block.kind, block.ids.tolist(), block.nodes.tolist(), block.region.tolist()) == ("beam", [10], [[0, 1]], [1])
    np.testing.assert_allclose(block.axes[0], np.transpose([[1, 0, 0], [0, 0, 1], [0, -1, 0]]))
    assert not block.offset.any()
    assert not block.released.any()
    own = mesh.sections[1]
    np.testing.assert_allclose(own.second, [[2e-5, 0], [0, 1e-5]])
    assert (own.area, own.torsion, own.shear, own.nonstructural, own.at_b) == (0.01, 3e-5, (0.0, 0.0), 7.0, None)
    assert own.points.shape == (0, 2)
    assert (mesh.regions[1].name, mesh.regions[1].material) == ("PBAR 1", 1)
    assert mesh.where("element", 10).endswith(":5")
    assert mesh.element_sets["SET3-5"].tolist() == [10]
    assert mesh.ignored == {}


Z_AND_X = [[0, 1, 0], [np.sqrt(0.5), 0, np.sqrt(0.5)]]
"""(1, 0, 1) in system 6 is z + x of the basic one."""


@pytest.mark.parametrize(
    ("card", "x_and_y"),
    [
        ("CBAR          10       1       3       4      1.      0.      1.", Z_AND_X),
        ("CBAR*                 10               1               3               4\n"
         "*                     1.              0.              1.", Z_AND_X),
        ("CBEAM,10,1,3,4,1.,0.,1.", Z_AND_X),
        ("CBAR,10,1,3,4,1.,0.,0.,BGG", [[0, 1, 0], [1, 0, 0]]),
        ("CBAR,10,1,1,2,4", [[1, 0, 0], [0, 1, 0]]),
    ],
)  # fmt: skip
def test_bar_orientation_from_nodal_axes_basic_axes_or_node(read, card, x_and_y):
    axes = read(deck(card, PBAR if "BAR" in card else "PBEAM,1,1,.01,2.-5,1.-5,,3.-5")).beams[0].axes[0]
    np.testing.assert_allclose(axes[:, :2].T, x_and_y, atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1)


def test_bar_offsets_are_along_nodal_axes(read):
    """W of node 3 in system 6: (.2, .1, .4) is (.4, -.1, .2); node 1 has none."""
    block = read(deck("CBAR,10,1,3,1,1.,0.,0.,GGG\n,,,.2,.1,.4,.4,-.1,.2")).beams[0]
    np.testing.assert_allclose(block.offset[0], [[0.4, -0.1, 0.2], [0.4, -0.1, 0.2]])
    np.testing.assert_allclose(block.axes[0][:, 0], [0, -1, 0], atol=1e-15)
    turned = read(deck("CBAR,10,1,1,2,0.,0.,1.\n,,,,,,,2.")).beams[0]
    np.testing.assert_allclose(turned.axes[0][:, 0], [np.sqrt(0.5), np.sqrt(0.5), 0])


def test_pin_flags_release_motions_of_an_end(read):
    released = read(deck(CARD + "\n,456,5")).beams[0].released[0]
    assert released.tolist() == [[False] * 3 + [True] * 3, [False] * 4 + [True, False]]


def test_baror_and_beamor_fill_blank_fields(read):
    base = deck("CBAR,10,,1,2\nCBAR,11,1,1,3,0.,0.,1.\nBAROR,,1,,,4", more="CBEAM,12,,1,2,,,,\nBEAMOR,,3,,,0.,0.,1.\n")
    mesh = read(base + "PBEAM,3,1,.01,2.-5,1.-5\n")
    (block,) = mesh.beams
    assert dict(zip(block.ids.tolist(), block.region.tolist(), strict=True)) == {10: 1, 11: 1, 12: 3}
    along_y = {number: axes[:, 1] for number, axes in zip(block.ids.tolist(), block.axes, strict=True)}
    np.testing.assert_allclose([along_y[10], along_y[11], along_y[12]], [[0, 1, 0], [0, 0, 1], [0, 0, 1]], atol=1e-15)
    with pytest.raises(DeckError, match="is defined twice"):
        read(base + "PBEAM,3,1,.01,2.-5,1.-5\nBAROR,,1\n")


BEAM = "CBEAM,10,1,1,2,0.,0.,1."
ENDS = "PBEAM,1,1,.01,2.-5,1.-5,1.-6,3.-5,7.\n,.1,.2,-.1,.2\n"


LBEAM = "PBEAML,1,1,,TUBE\n,.03,.02,5."
LARGE = "PBARL*  {:>16}{:>16}{:>16}{:>16}\n*\n*       {:>16}{:>16}".format(1, 1, "MSCBML0", "BAR", ".03", ".05")
POINTS = [[0.1, 0.2], [-0.1, 0.2]]
OTHER_END = {"area": 0.02, "second": [[4e-5, 1e-6], [1e-6, 1e-5]], "torsion": 3e-5, "nonstructural": 9, "points": [[0.3, 0.4]]}
OTHER_END["shear"] = (0.8, 0.9)
BOX_AREA, BOX = 0.06 * 0.08 - 0.052 * 0.074, np.diag([0.06 * 0.08**3 - 0.052 * 0.074**3, 0.08 * 0.06**3 - 0.074 * 0.052**3]) / 12


def tube(R, r, mass):
    return {"area": np.pi * (R**2 - r**2), "torsion": np.pi / 2 * (R**4 - r**4), "nonstructural": mass}


SECTIONS = [
    # card, property, what the section has, and at end B: what is blank there is that of end A, between them it is on the line
    (CARD, PBAR + "\n,.1,.2,-.1,.2\n,.83,.7,1.-5", {"second": [[2e-5, 1e-5], [1e-5, 1e-5]], "points": POINTS}, None),
    (CARD, PBAR + "\n,,,,\n,.83,.7,1.-5", {"shear": (0.83, 0.7)}, None),
    (BEAM, ENDS, {"second": [[2e-5, 1e-6], [1e-6, 1e-5]], "points": POINTS, "shear": (1, 1)}, None),
    (BEAM, ENDS, {"area": 0.01, "torsion": 3e-5, "nonstructural": 7}, None),
    *(
        (BEAM, f"{ENDS}{between},YES,1.,.02,4.-5,,,,9.\n,.3,.4\n,.8,.9", {"area": 0.01, "shear": (0.8, 0.9)}, OTHER_END)
        for between in ("", ",NO,.5,.015,3.-5,,,,8.\n", ",NO,.25\n")
    ),
    (BEAM, ENDS + ",YESA,1.\n,0.,0.", {"shear": (0, 0)}, None),
    (BEAM, ENDS + ",YESA,1.,.02\n,0.,0.", {"points": POINTS, "shear": (0, 0)}, {"points": POINTS}),
    (CARD, "PBARL,1,1,,BOX\n,.06,.08,.003,.004,5.", {"area": BOX_AREA, "second": BOX, "nonstructural": 5}, None),
    (CARD, LARGE, {"second": np.diag([0.03 * 0.05**3, 0.05 * 0.03**3]) / 12, "nonstructural": 0}, None),
    (BEAM, LBEAM, tube(0.03, 0.02, 5), None),
    (BEAM, LBEAM + ",YES,1.", tube(0.03, 0.02, 5), None),
    (BEAM, LBEAM + ",YES,1.,.04,.03,7.", tube(0.03, 0.02, 5), tube(0.04, 0.03, 7)),
    (BEAM, LBEAM + ",,,.04", tube(0.03, 0.02, 5), tube(0.04, 0.02, 5)),
    (BEAM, LBEAM + ",NO,.5\n,NO,1.,.04,.03,7.", tube(0.03, 0.02, 5), tube(0.04, 0.03, 7)),
    (BEAM, ENDS + ",NO,1.,.02,,,,,9.\nPARAM,WTMASS,.5", {"nonstructural": 3.5}, {"nonstructural": 4.5, "area": 0.02}),
]


@pytest.mark.parametrize(("card", "pbar", "at_a", "at_b"), SECTIONS)
def test_beam_sections_match_their_cards(read, card, pbar, at_a, at_b):
    section = read(deck(card, pbar)).sections[1]
    assert (section.at_b is None) == (at_b is None)
    for end, values in ((section, at_a), (section.at_b, at_b or {})):
        for name, value in values.items():
            np.testing.assert_allclose(getattr(end, name), value, rtol=1e-12, atol=1e-20, err_msg=name)


ROD, PROD = "CROD,10,1,1,2", "PROD,1,1,.01,3.-5,,7."


def test_rods_and_tubes(read):
    """A tube of 40 by 5 mm: A = π (20² − 15²) mm², J = π/2 (20⁴ − 15⁴) mm⁴; without a wall a full circle."""
    mesh = read(deck(ROD, PROD, "CTUBE,11,2,1,4\nPTUBE,2,1,.04,.005,.5\nCTUBE,12,3,2,4\nPTUBE,3,1,.04\n"))
    (block,) = mesh.beams
    assert (block.kind, block.ids.tolist(), block.region.tolist()) == ("rod", [10, 11, 12], [1, 2, 3])
    np.testing.assert_allclose(block.axes[:, :, 0], [[1, 0, 0], [0, 1, 0], np.array([-2, 3, 0]) / np.sqrt(13)])
    np.testing.assert_allclose(np.linalg.det(block.axes), 1)
    np.testing.assert_allclose(block.axes.transpose(0, 2, 1) @ block.axes, [np.eye(3)] * 3, atol=1e-15)
    rod, tube, full = (mesh.sections[i] for i in (1, 2, 3))
    assert (rod.area, rod.torsion, rod.nonstructural) == (0.01, 3e-5, 7)
    assert (tube.area, tube.torsion) == pytest.approx((np.pi * 175e-6, np.pi / 2 * (20**4 - 15**4) * 1e-12))
    assert (full.area, full.torsion) == pytest.approx((np.pi * 400e-6, np.pi / 2 * 20**4 * 1e-12))
    assert not rod.second.any()


def test_equal_conrods_share_a_region(read):
    rods = "CONROD,21,1,4,1,.02\nCONROD,22,2,4,1,.02\nCONROD,23,1,3,1,.03,1.-6,,5.\n"
    mesh = read(deck(more=rods + "PROD,40,1,.5\n"))
    block = mesh.beams[1]
    assert block.ids.tolist() == [21, 22, 23]
    assert block.nodes.tolist() == [[0, 3], [1, 3], [0, 2]]
    assert block.region.tolist() == [41, 41, 42]
    assert [mesh.regions[i].name for i in (41, 42)] == ["CONROD 21", "CONROD 23"]
    own = mesh.sections[42]
    assert (own.area, own.torsion, own.nonstructural) == (0.03, 1e-6, 5)


@pytest.mark.parametrize(
    ("mat1", "E", "G", "nu"),
    [
        ("MAT1,1,2.+11,6.+10,.3", 2e11, 6e10, 0.3),  # with a shell of it
        ("MAT1,1,2.+11,6.+10", 2e11, 6e10, None),  # beams alone, of no Poisson's ratio below ½
        ("MAT1,1,2.+11,6.+10,.3", 2e11, 6e10, None),
    ],
)
def test_beam_torsion_and_shear_use_material_g(read, mat1, E, G, nu):
    """Whatever the Poisson's ratio beside it: EI, GJ and K G A are those of the card, and a shell has E and ν in its plane."""
    text = BAR.replace("MAT1,1,2.1+11,,.3,7850.", mat1)
    shell = "" if nu is None else "CTRIA3,11,2,1,2,3\nPSHELL,2,1,.1,1,,1\n"
    exact, mesh = read(BAR).sections[1], read(text + shell)
    own, material = mesh.sections[1], mesh.materials[1]
    used = material.youngs_modulus / (2 * (1 + material.poisson_ratio))
    assert material.youngs_modulus == E
    assert used * own.torsion == pytest.approx(G * exact.torsion, rel=1e-14)
    assert used * np.array(own.shear) == pytest.approx(G * np.array(exact.shear), rel=1e-14)
    np.testing.assert_array_equal(own.second, exact.second)
    if nu is not None:
        assert material.poisson_ratio == nu
        assert used * mesh.sections[2].shear == pytest.approx(5 / 6 * G, rel=1e-14)
        assert "G = 6e+10 is 0.78 times E/2(1 + NU)" in mesh.doubts[-1]


test_errors_have_file_and_line = refusal_table(lambda card, pbar: deck(card, pbar.replace("\n\n", "\n,,\n")), [
    ("CBAR,10,1,1,1,0.,0.,1.", PBAR, "both ends of the element are at the same node", 5),
    ("CBAR,10,1,1,2", PBAR, "the orientation is missing: G0, X1 to X3, or a", 5),
    ("CBAR,10,1,1,2,1.,0.,0.", PBAR, "the orientation G0 or X1 to X3 is parallel to the beam axis", 5),
    ("CBAR,10,1,1,2,0.,0.,1.\n,,,2.", PBAR, "both ends of the element coincide", 5),
    ("CBAR,10,1,1,2,0.,0.,1.\n,,123456", PBAR, "all components of end B are released", 5),
    ("CBEAM,10,1,1,2,0.,0.,1.", PBAR, "property 1 is a PBAR, but must be a PBEAM", 5),
    ("CROD,10,7,1,2", PBAR, r"property 7 has no PROD card in the deck", 5),
    (CARD, "PBAR,1,1,0.,1.,1.", "area is 0", 6),
    (CARD, "PBAR,1,1,1.,-1.,1.", "the section properties are inconsistent: I1 = -1, I2 = 1, I12 = 0, J = 0,", 6),
    (CARD, "PBAR,1,1,1.,1.,1.\n\n,,,2.", "only I12 may be negative, and I12² must not exceed I1 I2", 6),
    ("CTUBE,10,1,1,2", "PTUBE,1,1,.04,.03", r"the wall thickness is 0\.03, but the outer diameter is", 6),
    ("CTUBE,10,1,1,2", "PTUBE,1,1,.04,.01,,.05", "OD2 differs from OD: conical tubes are not supported", 6),
    (BEAM, ENDS + ",NO,.5,.02\n,NO,1.,.02", "A is 0.02 at X/XB = 0.5, but linear variation", 6),
    (CARD, "PBARL,1,1,,BOXES\n,1.,1.", "the section shape BOXES is unknown", 6),
    (CARD, "PBARL,1,1,,BAR\n,1.,-1.", "has impossible dimensions 1, -1", 6),
    (BEAM, "PBEAML,1,1,,T\n,.1,.1,.01,.01", "its shear centre, which differs from the centroid for T: not", 6),
    (BEAM, LBEAM + ",NO,.5,.03,.02\n,NO,1.,.05,.02", "A is 0.00157.* at X/XB = 0.5", 6),
])


def test_fixed_rotations_of_rods_have_no_effect(read):
    text = "GRID,1,,0.,0.,0.,,{0}\nGRID,2,,1.,0.,0.,,{0}\nCROD,1,1,1,2\nPROD,1,1,3.-4\nMAT1,1,2.1+11,,.3,7850.\n"
    text += "SPC1,1,123,1\nSPC1,1,23,2\nENDDATA\n"
    held, plain = (build_model(read(text.format(ps))) for ps in ("456", ""))
    np.testing.assert_allclose(held.stiffness.constant.toarray(), [[2.1e11 * 3e-4]], rtol=1e-14)
    np.testing.assert_allclose(plain.stiffness.constant.toarray(), held.stiffness.constant.toarray(), rtol=1e-14)


LENGTH, AREA, I1, I2, TORSION = 2.0, 3e-3, 5e-6, 2e-6, 4e-6


def offset_beam(axis: str, section: str = "", offsets: str = "", held: str = "123456") -> str:
    """A CBEAM from 1 to 2 along x, y along y, held at 1; axis: N1, N2, M1, M2 of a PBEAM and K1 = K2 = 0."""
    return (
        f"GRID,1,,0.,0.,0.\nGRID,2,,{LENGTH},0.,0.\nCBEAM,10,1,1,2,0.,1.,0.\n{offsets}"
        f"PBEAM,1,1,{AREA},{I1},{I2},0.,{TORSION},7.\n,,,,,,,,\n,NO,1.{section}\n,0.,0.\n{axis}"
        f"MAT1,1,2.1+11,,.3,7850.\nSPC1,1,{held},1\nENDDATA\n"
    )


def test_eccentric_tension_bends_beam(read):
    """P at the shear centre: u = P L/EA + P n² L/EI, and θ = P n L/EI of both planes; nothing shears or twists."""
    y, z, P, E = 0.03, -0.05, 1e4, 2.1e11
    mesh = read(offset_beam(f",0.,0.,0.,0.,{y},{z}\n"))
    assert mesh.sections[1].neutral == (y, z)
    assert mesh.sections[1].at_b is None  # blank at B: as at A
    model = build_model(mesh)
    u = np.linalg.solve(model.stiffness.constant.toarray(), P * np.eye(6)[0])
    theta = [-P * z * LENGTH / (E * I2), P * y * LENGTH / (E * I1)]
    wanted = [P * LENGTH / E * (1 / AREA + y**2 / I1 + z**2 / I2)]
    wanted += [theta[1] * LENGTH / 2, -theta[0] * LENGTH / 2, 0.0, *theta]
    np.testing.assert_allclose(u, wanted, rtol=1e-9, atol=1e-15)


def test_neutral_axis_offset_equals_beam_offset(read):
    """K and M of the motions u, w and θ_y, in the plane of x and z with N2 = M2 = 0.05, are those of WA = WB = (0, 0, 0.05)."""
    held = "SPC1,1,246,2\n"
    moved = offset_beam(",0.,0.05,0.,0.05,0.,0.05,0.,0.05\n").replace("ENDDATA", held + "ENDDATA")
    arms = offset_beam("", offsets=",,,0.,0.,.05,0.,0.,.05\n").replace("ENDDATA", held + "ENDDATA")
    one, two = (build_model(read(text)) for text in (moved, arms))
    for name in ("stiffness", "mass"):
        a, b = (getattr(own, name).constant.toarray() for own in (one, two))
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10 * np.abs(b).max())


def test_tapered_neutral_axis_beam_has_zero_rigid_body_energy(read):
    """N and M that differ at the ends, over a taper: K R = 0, and Rᵀ M R of the translations and of the turn about x."""
    section = ",.001,3.-6,1.-6,0.,2.-6,3."
    mesh = read(offset_beam(",.02,.01,-.03,.04,.03,-.02,.01,.05\n", section, held="1"))
    (region,) = mesh.sections
    end_a, end_b = mesh.sections[region], mesh.sections[region].at_b
    assert (end_b.neutral, end_b.beside) == ((0.01, 0.05), (-0.03, 0.04))
    K, M = (own.constant.toarray() for own in thin_operators(mesh))
    R = np.vstack([np.eye(6), np.eye(6)])
    R[7, 5], R[8, 4] = LENGTH, -LENGTH
    np.testing.assert_allclose(K @ R, 0, atol=1e-9 * np.abs(K).max())
    xi, w = np.polynomial.legendre.leggauss(6)
    xi, w = 0.5 * (1 + xi), 0.5 * LENGTH * w

    def line(name: str) -> np.ndarray:
        a, b = (np.asarray(getattr(end, name), dtype=float) for end in (end_a, end_b))
        return np.stack([(1 - t) * a + t * b for t in xi])

    own, more = 7850.0 * line("area"), line("nonstructural")
    inertia = w @ (own * np.sum(line("neutral") ** 2, axis=1) + more * np.sum(line("beside") ** 2, axis=1))
    inertia += 7850.0 * w @ (line("second")[:, 0, 0] + line("second")[:, 1, 1])
    rigid = R.T @ M @ R
    np.testing.assert_allclose(np.diagonal(rigid)[:3], w @ (own + more), rtol=1e-12)
    assert rigid[3, 3] == pytest.approx(inertia, rel=1e-3)
    first = (w * own) @ line("neutral") + (w * more) @ line("beside")
    np.testing.assert_allclose([rigid[2, 3], -rigid[1, 3]], first, rtol=1e-12)


def test_tapered_neutral_axis_matches_fine_mesh(read):
    ends = np.array([[0.03, -0.02], [0.01, 0.05]])
    one = build_model(read(offset_beam(",0.,0.,0.,0.,.03,-.02,.01,.05\n")))
    text, count = "", 100
    for i in range(count):
        y, z = ends[0] + (i + 0.5) / count * (ends[1] - ends[0])
        text += f"CBEAM,{i + 1},{i + 1},{i + 1},{i + 2},0.,1.,0.\nPBEAM,{i + 1},1,{AREA},{I1},{I2},0.,{TORSION}\n"
        text += f",,,,,,,,\n,NO,1.\n,0.,0.\n,0.,0.,0.,0.,{y:.9g},{z:.9g}\n"
    text += "".join(f"GRID,{i + 1},,{LENGTH * i / count:.9g},0.,0.\n" for i in range(count + 1))
    many = build_model(read(text + "MAT1,1,2.1+11,,.3,7850.\nSPC1,1,123456,1\nENDDATA\n"))
    flexible = [np.linalg.inv(own.stiffness.constant.toarray()) for own in (one, many)]
    rows = many.constraint.transform[[3 * count, 3 * count + 1, 3 * count + 2, *range(-3, 0)]].toarray()
    np.testing.assert_allclose(flexible[0], rows @ flexible[1] @ rows.T, rtol=2e-4, atol=2e-4 * np.abs(flexible[0]).max())


def test_pbeam_offsets_are_imported_in_length_units(read):
    mesh = read(offset_beam(",.02,.01,-.03,.04,.03,-.02,.01,.05\n", ",.001,3.-6,1.-6,0.,2.-6,3."))
    section = mesh.sections[1]
    small = rescaled(section, 1e-3, 1e3)
    np.testing.assert_allclose([small.neutral, small.at_b.beside], [[3e-5, -2e-5], [-3e-5, 4e-5]])
    kept = MeshColumns.of(mesh).restore().sections[1]
    assert (kept.neutral, kept.beside) == (section.neutral, section.beside)
    assert (kept.at_b.neutral, kept.at_b.beside) == (section.at_b.neutral, section.at_b.beside)


def test_neutral_axis_without_bending_stiffness_is_refused(read):
    with pytest.raises(DeckError, match=r"the neutral axis has an offset \(N1, N2\), but I1 or I2 is not positive"):
        read(offset_beam(",0.,0.,0.,0.,.03\n").replace(f"{I1},{I2}", "0.,0."))

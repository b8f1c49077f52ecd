"""Sections of shells and beams: by name, in other units, and of another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.fem.checks import check_geometry, check_materials
from strainsight.fem.mass import mass_properties
from strainsight.mesh.sanity import empty_regions, sanity_warnings, unused_nodes
from strainsight.mesh.section_shapes import SHAPES, section_of_shape
from strainsight.mesh.units import scaled

from ..refusals import expect_refusal

# Sections by name against integrals over their outlines, and J against the torsion function on a grid.
T = 2 * np.pi * np.arange(4000) / 4000


def circle(r):
    return np.stack([r * np.sin(T), r * np.cos(T)], axis=1)


# (z, y) around each shape; holes after the outline. Drawn from the figures, each with its dimensions in numbers.
OUTLINES = {
    ("ROD", (0.5,)): [circle(0.5)],
    ("TUBE", (0.5, 0.3)): [circle(0.5), circle(0.3)],
    ("TUBE2", (0.5, 0.2)): [circle(0.5), circle(0.3)],
    ("BAR", (2, 3)): [[(0, 0), (2, 0), (2, 3), (0, 3)]],
    ("BOX", (5, 7, 0.5, 0.25)): [
        [(0, 0), (5, 0), (5, 7), (0, 7)],
        [(0.25, 0.5), (4.75, 0.5), (4.75, 6.5), (0.25, 6.5)],
    ],
    ("BOX1", (5, 7, 0.5, 0.75, 0.25, 1)): [
        [(0, 0), (5, 0), (5, 7), (0, 7)],
        [(1, 0.75), (4.75, 0.75), (4.75, 6.5), (1, 6.5)],
    ],
    ("I", (10, 6, 4, 0.5, 1, 0.75)): [
        [
            (-3, 0), (3, 0), (3, 1), (0.25, 1), (0.25, 9.25), (2, 9.25), (2, 10), (-2, 10), (-2, 9.25), (-0.25, 9.25),
            (-0.25, 1), (-3, 1),
        ]
    ],
    ("I1", (4, 1, 6, 8)): [
        [(0, 0), (5, 0), (5, 1), (3, 1), (3, 7), (5, 7), (5, 8), (0, 8), (0, 7), (2, 7), (2, 1), (0, 1)]
    ],
    ("T", (6, 8, 1, 0.5)): [[(-3, 8), (-3, 7), (-0.25, 7), (-0.25, 0), (0.25, 0), (0.25, 7), (3, 7), (3, 8)]],
    ("T1", (6, 7, 1, 0.5)): [[(0, -0.25), (7, -0.25), (7, -3), (8, -3), (8, 3), (7, 3), (7, 0.25), (0, 0.25)]],
    ("T2", (6, 8, 1, 0.5)): [[(-3, 0), (3, 0), (3, 1), (0.25, 1), (0.25, 8), (-0.25, 8), (-0.25, 1), (-3, 1)]],
    ("L", (5, 8, 1, 0.5)): [[(0, 0), (5, 0), (5, 1), (0.5, 1), (0.5, 8), (0, 8)]],
    ("CHAN", (4, 9, 0.5, 1)): [[(0, 0), (4, 0), (4, 1), (0.5, 1), (0.5, 8), (4, 8), (4, 9), (0, 9)]],
    ("CHAN1", (3, 1, 6, 8)): [[(0, 0), (4, 0), (4, 1), (1, 1), (1, 7), (4, 7), (4, 8), (0, 8)]],
    ("CHAN2", (0.5, 1, 4, 9)): [[(0, 0), (9, 0), (9, 4), (8.5, 4), (8.5, 1), (0.5, 1), (0.5, 4), (0, 4)]],
    ("H", (5, 2, 8, 0.5)): [
        [(0, 0), (1, 0), (1, 3.75), (6, 3.75), (6, 0), (7, 0), (7, 8), (6, 8), (6, 4.25), (1, 4.25), (1, 8), (0, 8)]
    ],
    ("CROSS", (4, 1, 8, 0.5)): [
        [
            (2, 0), (3, 0), (3, 3.75), (5, 3.75), (5, 4.25), (3, 4.25), (3, 8), (2, 8), (2, 4.25), (0, 4.25), (0, 3.75),
            (2, 3.75),
        ]
    ],
    ("HEXA", (1, 6, 3)): [[(1, 0), (5, 0), (6, 1.5), (5, 3), (1, 3), (0, 1.5)]],
    ("Z", (3, 1, 6, 8)): [[(3, 0), (7, 0), (7, 1), (4, 1), (4, 8), (0, 8), (0, 7), (3, 7)]],
    ("HAT", (6, 0.5, 5, 2)): [
        [
            (0, 0), (2.5, 0), (2.5, 5.5), (6.5, 5.5), (6.5, 0), (9, 0), (9, 0.5), (7, 0.5), (7, 6), (2, 6), (2, 0.5),
            (0, 0.5),
        ]
    ],
}


def integrals(polygon):
    """∫ 1, z, y, z², zy, y² dA over a polygon (z, y) by Green's theorem."""
    p = np.array(polygon, float)
    q = np.roll(p, -1, axis=0)
    c = p[:, 0] * q[:, 1] - q[:, 0] * p[:, 1]
    s = p + q
    mixed = p[:, 0] * q[:, 1] + 2 * p[:, 0] * p[:, 1] + 2 * q[:, 0] * q[:, 1] + q[:, 0] * p[:, 1]
    squares = (p**2 + p * q + q**2) * c[:, None]
    found = np.array(
        [
            c.sum() / 2,
            *(s * c[:, None]).sum(0) / 6,
            squares[:, 0].sum() / 12,
            (mixed * c).sum() / 24,
            squares[:, 1].sum() / 12,
        ]
    )
    return found * np.sign(found[0])


def whole(outlines):
    return integrals(outlines[0]) - sum((integrals(hole) for hole in outlines[1:]), np.zeros(6))


def test_every_shape_is_drawn():
    assert {kind for kind, _ in OUTLINES} == set(SHAPES)


@pytest.mark.parametrize(("kind", "dimensions"), OUTLINES)
def test_area_and_moments_are_those_of_the_outline(kind, dimensions):
    own = section_of_shape(kind, dimensions)
    A, z, y, zz, zy, yy = whole(OUTLINES[kind, dimensions])
    exact = np.array([[yy - y * y / A, zy - z * y / A], [zy - z * y / A, zz - z * z / A]])
    assert own.area == pytest.approx(A, rel=3e-6)
    np.testing.assert_allclose(own.second, exact, rtol=5e-6, atol=1e-12 * exact.max())


@pytest.mark.parametrize(("kind", "dimensions"), OUTLINES)
def test_points_lie_on_the_outline_at_its_ends(kind, dimensions):
    own, outline = section_of_shape(kind, dimensions), np.array(OUTLINES[kind, dimensions][0], float)
    A, z, y, *_ = whole(OUTLINES[kind, dimensions])
    edge = outline[:, ::-1] - [y / A, z / A]
    ends = np.roll(edge, -1, axis=0)
    for point in own.points:
        along = ends - edge
        s = np.clip(((point - edge) * along).sum(1) / (along**2).sum(1), 0, 1)
        assert np.linalg.norm(edge + s[:, None] * along - point, axis=1).min() < 1e-6
    np.testing.assert_allclose([own.points.min(0), own.points.max(0)], [edge.min(0), edge.max(0)], atol=1e-6)


def torsion_on_grid(outlines, step):
    """J = 2 ∫ φ dA with ∇²φ = −2, φ = 0 on the outline (Prandtl), five-point stencil; no holes."""
    polygon = np.array(outlines[0], float)
    low, high = polygon.min(0), polygon.max(0)
    axes = [np.arange(a, b + step / 2, step) for a, b in zip(low, high, strict=True)]
    z, y = np.meshgrid(*axes, indexing="ij")
    inside = np.zeros(z.shape, bool)
    for (z0, y0), (z1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if y0 != y1:
            crosses = (y0 > y + 1e-9) != (y1 > y + 1e-9)
            inside ^= crosses & (z < z0 + (y - y0) * (z1 - z0) / (y1 - y0) - 1e-9)
    # points on an edge are outside
    for (z0, y0), (z1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        cross = (z - z0) * (y1 - y0) - (y - y0) * (z1 - z0)
        between = ((z - z0) * (z1 - z0) + (y - y0) * (y1 - y0)) * ((z - z1) * (z1 - z0) + (y - y1) * (y1 - y0)) <= 1e-9
        inside &= ~((np.abs(cross) < 1e-9) & between)
    number = np.full(z.shape, -1)
    number[inside] = np.arange(inside.sum())
    n = int(inside.sum())
    matrix = 4 * sparse.eye_array(n, format="csr")
    for axis in (0, 1):
        near, far = np.moveaxis(number, axis, 0)[:-1].ravel(), np.moveaxis(number, axis, 0)[1:].ravel()
        both = (near >= 0) & (far >= 0)
        link = sparse.csr_array((np.ones(both.sum()), (near[both], far[both])), shape=(n, n))
        matrix = matrix - link - link.T
    return 2 * step**2 * spsolve(matrix.tocsc(), np.full(n, 2 * step**2)).sum()


THIN_L = [[(0, 0), (5, 0), (5, 0.5), (0.25, 0.5), (0.25, 8), (0, 8)]]
THIN_CHAN = [[(0, 0), (4, 0), (4, 0.5), (0.25, 0.5), (0.25, 8.5), (4, 8.5), (4, 9), (0, 9)]]

TORSION = {  # kind, dimensions: step, share by which the formula may be off, outline
    ("BAR", (2, 3)): (1 / 32, 0.0002, None),
    ("HEXA", (1, 6, 3)): (1 / 16, 0.05, None),
    ("L", (5, 8, 0.5, 0.25)): (1 / 64, 0.05, THIN_L),
    ("CHAN", (4, 9, 0.25, 0.5)): (1 / 64, 0.05, THIN_CHAN),
    ("HAT", (6, 0.5, 5, 2)): (1 / 32, 0.05, None),
    ("Z", (3, 1, 6, 8)): (1 / 16, 0.05, None),
    ("I1", (4, 1, 6, 8)): (1 / 16, 0.05, None),
}


@pytest.mark.parametrize(("kind", "dimensions"), TORSION)
def test_torsion_is_near_the_torsion_function(kind, dimensions):
    """Of thin walls: those of (5, 8, 1, 0.5) are off by 8 % (L), of (4, 9, 0.5, 1) by 10 % (CHAN)."""
    step, share, outline = TORSION[kind, dimensions]
    exact = torsion_on_grid(outline or OUTLINES[kind, dimensions], step)
    assert section_of_shape(kind, dimensions).torsion == pytest.approx(exact, rel=share)


def test_round_and_closed_sections_have_their_closed_forms():
    assert section_of_shape("ROD", (0.5,)).torsion == pytest.approx(np.pi * 0.5**4 / 2)
    assert section_of_shape("TUBE", (0.5, 0.3)).torsion == pytest.approx(np.pi * (0.5**4 - 0.3**4) / 2)
    # the formula of the NX Element Library: 2 t₂ t₁ (b − t₂)² (h − t₁)² / (b t₂ + h t₁ − t₂² − t₁²)
    b, h, t1, t2 = 5, 7, 0.5, 0.25
    exact = 2 * t2 * t1 * (b - t2) ** 2 * (h - t1) ** 2 / (b * t2 + h * t1 - t2**2 - t1**2)
    assert section_of_shape("BOX", (b, h, t1, t2)).torsion == pytest.approx(exact)


def test_shear_factors_are_shares_of_the_area():
    for kind, dimensions in OUTLINES:
        assert all(0 <= share <= 1 for share in section_of_shape(kind, dimensions).shear)
    assert section_of_shape("BAR", (2, 3)).shear == pytest.approx((5 / 6, 5 / 6))
    A = 6 * 1 + 4 * 0.75 + 8.25 * 0.5
    assert section_of_shape("I", (10, 6, 4, 0.5, 1, 0.75)).shear == pytest.approx((4.125 / A, 9 / 1.2 / A))


@pytest.mark.parametrize(
    ("kind", "dimensions", "what"),
    [
        ("HAT1", (1, 1, 1, 1, 1), "HAT1 is unknown"),
        ("BAR", (1, 2, 3), "number of dimensions of the section BAR is 3 .* not 2"),
        ("ROD", (0,), "has impossible dimensions 0"),
        ("ROD", (1e200,), "has impossible dimensions 1e.200: not positive, too large"),
        ("TUBE", (1, 1), "impossible"),
        ("BOX", (5, 7, 3.5, 1), "impossible"),
        ("CHAN", (4, 2, 0.5, 1), "impossible"),
        ("CHAN2", (5, 1, 4, 9), "impossible"),
    ],
)
def test_impossible_shapes_are_refused(kind, dimensions, what):
    with expect_refusal(DeckError, what, remedy=""):
        section_of_shape(kind, dimensions)


# Shells and beams in other units and of another size; what a mesh of them has to have.
IN_METRES = """\
GRID,1,,0.,0.,0.
GRID,2,,2.,0.,0.
GRID,3,,2.,1.,0.
GRID,4,,0.,1.,0.
GRID,5,,0.,0.,1.
CQUAD4,10,1,1,2,3,4,,.05
CBEAM,11,2,1,5,1.,0.,0.
,45,,.01,.02,.03
CONROD,12,2,5,3,1.-4,2.-9,,.3
PSHELL,1,3,.02,3,1.5,3,,8.
PBEAM,2,3,1.-3,2.-7,3.-7,1.-7,4.-7,5.
,.01,.02
,NO,1.,2.-3,4.-7,,,,6.
MAT1,3,2.1+11,,.3,7850.
SPC1,1,123456,1
MPC,1,2,3,2.,4,6,.5
,,5,5,.25
RBAR,20,2,3,1236,35
"""
@pytest.fixture
def metres(tmp_path):
    (tmp_path / "m.bdf").write_text(IN_METRES)
    return read_mesh(tmp_path / "m.bdf")


POWER = {"thickness": 1, "area": 2, "second": 4, "torsion": 4, "points": 1, "neutral": 1, "beside": 1, "bending": 0, "shear": 0}
"""Of the length, in the sizes of sections."""


def test_sizes_of_a_deck_in_millimetres_and_tonnes_are_in_metres_and_kilograms(metres, tmp_path):
    other = read_mesh(tmp_path / "m.bdf", "mm", "t")
    np.testing.assert_allclose(other.position, metres.position / 1e3)
    for own, same in zip((*metres.shells, *metres.beams), (*other.shells, *other.beams), strict=True):
        np.testing.assert_allclose(same.offset, own.offset / 1e3)
    np.testing.assert_allclose(other.beams[0].axes, metres.beams[0].axes)
    pairs = [(own, other.sections[region]) for region, own in metres.sections.items()]
    pairs += [(own.at_b, same.at_b) for own, same in pairs if getattr(own, "at_b", None)]
    assert len(pairs) == 4
    for own, same in pairs:
        for name in POWER.keys() & vars(own).keys():
            np.testing.assert_allclose(getattr(same, name), 1e-3 ** POWER[name] * np.array(getattr(own, name)), rtol=1e-12)
        assert same.nonstructural == pytest.approx(own.nonstructural * (1e9 if hasattr(own, "thickness") else 1e6))


def test_rotation_coefficient_of_a_relation_is_scaled_as_a_length(metres, tmp_path):
    assert metres.relations[-1].value.tolist() == [2.0, 0.5, 0.25]
    assert len(metres.relations) == 7
    for own, same in zip(metres.relations, read_mesh(tmp_path / "m.bdf", "mm", "t").relations, strict=True):
        expected = own.value / np.where(own.component < 3, 1.0, 1e3)
        np.testing.assert_allclose(same.value / same.value[0], expected / expected[0], rtol=1e-12)
    assert scaled(metres, 0.5).relations[-1].value.tolist() == [2.0, 0.25, 0.125]


def test_mass_grows_with_the_cube_of_the_size_and_stiffness_of_sections_with_the_fourth_power(metres):
    half = scaled(metres, 0.5)
    assert mass_properties(half)[0] == pytest.approx(mass_properties(metres)[0] / 8, rel=1e-14)
    for region in (2, 13):
        np.testing.assert_allclose(half.sections[region].second, metres.sections[region].second / 16)
        np.testing.assert_allclose(half.sections[region].torsion, metres.sections[region].torsion / 16)
    assert half.sections[1].thickness == metres.sections[1].thickness / 2
    assert half.sections[1].bending == metres.sections[1].bending
    np.testing.assert_allclose(half.sections[2].at_b.second, metres.sections[2].at_b.second / 16)


def test_nodes_and_regions_of_shells_and_beams_are_in_use(metres):
    assert unused_nodes(metres).size == 0
    assert empty_regions(metres) == ()
    assert sanity_warnings(metres) == ()
    assert unused_nodes(replace(metres, shells=(), relations=())).tolist() == [2, 3]
    assert unused_nodes(replace(metres, beams=())).size == 0  # node 5 is in a relation
    assert unused_nodes(replace(metres, beams=(), relations=())).tolist() == [4]
    assert empty_regions(replace(metres, shells=())) == (1,)


def test_regions_of_shells_and_beams_need_materials_and_sections_of_their_kind(metres):
    check_geometry(metres)
    check_materials(metres)
    with pytest.raises(DeckError, match=r"region 1 \(PSHELL 1\) refers to material 3, which does not exist"):
        check_materials(replace(metres, materials={}))
    sections = dict(metres.sections)
    with pytest.raises(DeckError, match=r"region 1 \(PSHELL 1\) of quad4 element 10 has a section of another") as caught:
        check_geometry(replace(metres, sections={**sections, 1: sections[2]}))
    assert caught.value.entity == ("element", 10)
    with pytest.raises(DeckError, match=r"of beam element 11 has no section"):
        check_geometry(replace(metres, sections={1: sections[1]}))
    with pytest.raises(DeckError, match="element 11 refers to region 2, which does not exist"):
        check_geometry(replace(metres, regions={1: metres.regions[1]}))

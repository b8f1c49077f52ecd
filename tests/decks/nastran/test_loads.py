"""Point masses, forces, pressures and coordinate systems of Nastran decks."""

from __future__ import annotations

import io

import numpy as np
import pytest
from pyyeti import nastran
from scipy.spatial import ConvexHull, Delaunay

from ...refusals import refusal_table
from ...solids import SOLIDS
from ..conftest import TETRAHEDRON

# cylinder about the line x = 1, y = 2; its r at (1, 4, ·) is the y axis, its θ the −x axis
CYLINDER = "CORD2C,6,,1.,2.,3.,1.,2.,4.\n+,2.,2.,3.\n"
TURNED = "CORD2R,7,,1.,2.,3.,2.,2.,3.\n+,1.,3.,3.\n"  # its z is x, its x is y, so its y is z
RIGID = "GRID,50,,1.,4.,5.\nRBE2,99,50,123456,4\nENDDATA\n"


def mass(read, tetrahedron, card):
    (point,) = read(CYLINDER + TURNED + tetrahedron + card + "\n" + RIGID).point_masses
    return point


@pytest.mark.parametrize(
    ("cid", "given", "offset"),
    [
        ("", ".1,.2,.3", (0.1, 0.2, 0.3)),
        ("6", ".1,.2,.3", (-0.2, 0.1, 0.3)),
        ("7", ".1,.2,.3", (0.3, 0.1, 0.2)),
        ("-1", "1.1,4.2,5.3", (0.1, 0.2, 0.3)),
    ],
)
def test_conm2_offset_is_along_its_system(read, tetrahedron, cid, given, offset):
    point = mass(read, tetrahedron, f"CONM2,90,50,{cid},3.,{given}")
    assert (point.id, point.node, point.mass) == (90, 4, 3.0)
    np.testing.assert_allclose(point.offset, offset, atol=1e-15)
    assert not point.inertia.any()


@pytest.mark.parametrize(("cid", "axes"), [("", np.eye(3)), ("7", np.eye(3)[:, [1, 2, 0]]), ("-1", np.eye(3))])
def test_conm2_inertia_matches_rigid_body(read, tetrahedron, cid, axes):
    """I11 = ∫(x₂² + x₃²) dm, I21 = ∫ x₁x₂ dm of a few particles; the tensor is Σ m (r² I − r rᵀ)."""
    rng = np.random.default_rng(1)
    r, m = rng.normal(size=(5, 3)), rng.uniform(0.5, 2, 5)
    x = r @ axes
    moments = [np.sum(m * (x[:, (i + 1) % 3] ** 2 + x[:, (i + 2) % 3] ** 2)) for i in range(3)]
    products = {(i, j): np.sum(m * x[:, i] * x[:, j]) for i, j in ((1, 0), (2, 0), (2, 1))}
    values = (moments[0], products[1, 0], moments[1], products[2, 0], products[2, 1], moments[2])
    fields = ",".join(f"{value:.12f}" for value in values)
    point = mass(read, tetrahedron, f"CONM2,90,50,{cid},3.\n+,{fields}")
    expected = sum(mi * (ri @ ri * np.eye(3) - np.outer(ri, ri)) for mi, ri in zip(m, r, strict=True))
    np.testing.assert_allclose(point.inertia, expected, atol=1e-11)


def test_wtmass_scales_inertia_but_not_offset(read, tetrahedron):
    point = mass(read, tetrahedron, "PARAM,WTMASS,.5\nCONM2,90,50,,3.,.1\n+,2.,,2.,,,2.")
    assert point.mass == 1.5
    np.testing.assert_array_equal(point.inertia, np.eye(3))
    np.testing.assert_array_equal(point.offset, [0.1, 0, 0])


test_masses_and_forces_that_cannot_be_taken_are_named = refusal_table(lambda card: f"{TETRAHEDRON}{card}\n{RIGID}", [
    ("CONM2,90,50,8,3.", "coordinate system 8 is not a CORD1 or CORD2 of the deck", 9),
    ("CONM2,90,50,,3.\n+,1.,2.,1.,,,1.", "correct the inertia so that no moment is negative; specify I21, I31 and", 9),
    ("FORCE,1,77,,1.,1.", "node 77 is not in the deck", 9),
])


def test_forces_of_a_load_set_are_summed(read, tetrahedron):
    cards = "FORCE,3,50,,2.,1.,0.,-1.\nFORCE,3,50,6,3.,1.,2.,3.\nFORCE,3,4,7,1.,1.\nFORCE,12,4,,5.,,1.\n"
    mesh = read(CYLINDER + TURNED + tetrahedron + cards + RIGID)
    assert list(mesh.loads) == ["FORCE-3", "FORCE-12"]
    found = dict(zip(mesh.loads["FORCE-3"].nodes.tolist(), mesh.loads["FORCE-3"].force, strict=True))
    np.testing.assert_allclose(found[4], [2 - 6, 3, -2 + 9], atol=1e-14)
    np.testing.assert_allclose(found[3], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(mesh.loads["FORCE-12"].force, [[0, 5, 0]])
    assert mesh.ignored == {}


# Static loads of a deck by their resultant and moment, which statics knows without any mesh.
RHO_G = 9810.0


def facets(kind):
    """Corners of the facets of a convex solid, each in the sense whose normal points outward, by its planes alone."""
    x, corners = SOLIDS[kind].points(()), []
    for *n, d in np.unique(ConvexHull(x).equations.round(9), axis=0):
        on = np.flatnonzero(np.abs(x @ n + d) < 1e-6)
        r = x[on] - x[on].mean(axis=0)
        corners.append(on[np.argsort(np.arctan2(r @ np.cross(n, r[0]), r @ r[0]))].tolist())
    return corners


def volume_and_centre(kind):
    corners = SOLIDS[kind].points(())[Delaunay(SOLIDS[kind].points(())).simplices]
    parts = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    return parts.sum(), parts @ corners.mean(axis=1) / parts.sum()


def deck(kind, loads):
    solid = SOLIDS[kind]
    x = solid.points(solid.nastran_edges)
    fields = ["7", "1", *(str(i + 1) for i in range(len(x)))]
    element = "\n+,".join(",".join(fields[i : i + 8]) for i in range(0, len(fields), 8))
    grids = "".join(f"GRID,{i + 1},,{a!r},{b!r},{c!r}\n" for i, (a, b, c) in enumerate(x.tolist()))
    return f"{grids}{solid.nastran},{element}\nPSOLID,1,1\nMAT1,1,2.1+11,,.3,7850.\n{loads}ENDDATA\n"


def totals(mesh, name):
    load = mesh.loads[name]
    x = mesh.position[load.nodes]
    moment = np.zeros(3) if load.moment is None else load.moment.sum(axis=0)
    return load.force.sum(axis=0), np.cross(x, load.force).sum(axis=0) + moment


def as_a_card_names_it(facet, corners, turn):
    """The corners of a facet of a solid of so many corners, G1 first, and G3 or G4; turn: which of the possible ones."""
    if len(facet) == 3 and corners == 5:  # a pyramid, of which an edge on the base is named
        base = [i for i in facet if i < 4]
        start, other = base[turn], base[1 - turn]
    else:
        start = facet[turn]
        opposite = facet[(turn + 2) % 4] if len(facet) == 4 else None
        other = next(iter(set(range(4)) - set(facet))) if corners == 4 else opposite
    at = facet.index(start)
    return [*facet[at:], *facet[:at]], other


@pytest.mark.parametrize("kind", list(SOLIDS))
@pytest.mark.parametrize("turn", [0, 1])
def test_hydrostatic_pressure_gives_buoyancy(read, kind, turn):
    """PLOAD4 on every face, ρg(2 − z) at its corners: Archimedes, ρgV at the centre of the volume, whatever corner is G1."""
    x, cards = SOLIDS[kind].points(()), ""
    for facet in facets(kind):
        f, other = as_a_card_names_it(facet, len(x), turn)
        p = [f"{RHO_G * (2 - x[i, 2]):.9e}" for i in f] + [""] * (4 - len(f))
        cards += f"PLOAD4,3,7,{','.join(p)},{f[0] + 1},{'' if other is None else other + 1}\n"
    force, moment = totals(read(deck(kind, cards)), "LOAD-3")
    volume, centre = volume_and_centre(kind)
    np.testing.assert_allclose(force, [0, 0, RHO_G * volume], atol=1e-9 * RHO_G)
    np.testing.assert_allclose(moment, np.cross(centre, force), atol=1e-9 * RHO_G)


def test_pload4_vector_defines_load_direction(read):
    """In a cylinder about z through the middle of the face: e_θ by the right-hand rule, ∫ e_θ dA turns and does not push."""
    base = deck("hex8", "CORD2C,6,,.5,.625,0.,.5,.625,1.\n+,2.,.625,0.\nPLOAD4,1,7,3.,,,,5,7\n+,,0.,-2.,0.\n"
                "PLOAD4,2,7,3.,,,,5,7\n+,6,0.,1.,0.\n")
    mesh = read(base)
    force, _ = totals(mesh, "LOAD-1")
    np.testing.assert_allclose(force, [0, -3 * 1.25, 0], atol=1e-12)
    force, _ = totals(mesh, "LOAD-2")
    load = mesh.loads["LOAD-2"]
    turn = np.cross(mesh.position[load.nodes] - [0.5, 0.625, 1.5], load.force).sum(axis=0)
    np.testing.assert_allclose(force, 0, atol=1e-12)
    assert turn[2] > 0
    np.testing.assert_allclose(turn[:2], 0, atol=1e-12)


@pytest.mark.parametrize(
    ("cards", "sign"),
    [
        ("PLOAD,1,2.,5,6,7,8\n", 1),
        ("PLOAD,1,2.,8,7,6,5\n", -1),
        ("CQUAD4,40,9,8,7,6,5\nPLOAD2,1,2.,40\n", -1),
        ("CQUAD4,40,9,6,7,8,5\nCQUAD4,41,9,1,2,3,4\nPLOAD4,1,40,2.,,,,THRU,40\n", 1),
    ],
)
def test_plate_pressure_follows_right_hand_rule(read, cards, sign):
    force, moment = totals(read(deck("hex8", cards), ignore=["CQUAD4"]), "LOAD-1")
    np.testing.assert_allclose(force, [0, 0, sign * 2 * 1.25], atol=1e-12)
    np.testing.assert_allclose(moment, np.cross([0.5, 0.625, 1.5], force), atol=1e-12)


def test_force_directions_from_nodes(read):
    cards = "FORCE1,1,1,4.,1,3\nFORCE2,2,1,4.,1,2,1,4\nMOMENT,3,2,,2.,0.,3.,0.\nMOMENT1,4,2,5.,1,5\nMOMENT2,5,2,5.,1,2,1,4\n"
    mesh = read(deck("hex8", cards))
    along = np.array([1, 1.25, 0]) / np.hypot(1, 1.25)
    for name, force, moment in (
        ("LOAD-1", 4 * along, [0, 0, 0]),
        ("LOAD-2", [0, 0, 4], [0, 0, 0]),
        ("LOAD-3", [0, 0, 0], [0, 6, 0]),
        ("LOAD-4", [0, 0, 0], [0, 0, 5]),
        ("LOAD-5", [0, 0, 0], [0, 0, 5]),
    ):
        np.testing.assert_allclose(totals(mesh, name)[0], force, atol=1e-14)
        np.testing.assert_allclose(totals(mesh, name)[1], moment, atol=1e-14)
    (note,) = (note for note in mesh.notes if "MOMENT" in note)
    assert note.startswith("MOMENT: node 2 has no rotations")


def test_load_card_combines_sets_with_factors(read):
    cards = "FORCE,1,2,,1.,1.\nFORCE,2,2,,1.,,1.\nMOMENT,2,3,,1.,,,1.\nGRAV,3,,9.81,,,-1.\nLOAD,9,2.,3.,1,.5,2,4.,3\n"
    mesh = read(deck("hex8", cards))
    assert list(mesh.loads) == ["FORCE-1", "LOAD-2", "LOAD-3", "LOAD-9"]
    load = mesh.loads["LOAD-9"]
    np.testing.assert_allclose(load.force, [[6, 1, 0], [0, 0, 0]])
    np.testing.assert_allclose(load.moment, [[0, 0, 0], [0, 0, 1]])
    (body,) = load.body
    assert body.factor == 8
    np.testing.assert_allclose(body.acceleration, [0, 0, -9.81])


def test_gravity_and_rotation_are_read_in_their_systems(read):
    cards = "CORD2R,7,,1.,2.,3.,2.,2.,3.\n+,1.,3.,3.\nGRAV,1,7,2.,0.,0.,3.\nRFORCE,2,3,7,.5,0.,0.,2.\n"
    mesh = read(deck("hex8", cards))
    (weight,), (spin,) = mesh.loads["LOAD-1"].body, mesh.loads["LOAD-2"].body
    np.testing.assert_allclose(weight.acceleration, [6, 0, 0], atol=1e-14)
    np.testing.assert_allclose(spin.rotation, [2 * np.pi, 0, 0], atol=1e-14)
    np.testing.assert_allclose(spin.centre, [1, 1.25, 0])


test_invalid_loads_are_refused = refusal_table(lambda cards: deck("hex8", cards), [
    ("PLOAD4,1,9,2.,,,,5,7\n", "element 9 is not a solid or shell of the deck"),
    ("PLOAD4,1,7,2.,,,,5,6\n", "specify two opposite corners as G1 and G3; tetrahedron: specify a corner"),
    ("PLOAD,1,2.,1,2,7\n", "no solid or shell has a face with the corners 1, 2, 7"),
    ("PLOAD2,1,2.,7\n", "element 7 is not a shell"),
    ("RFORCE,1,,,1.,0.,0.,1.\n+,2.\n", r"angular acceleration \(RACC\) is not supported"),
    ("LOAD,9,1.,1.,4\n", "set 4 contains no imported load"),
    ("CORD2C,6,,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\nGRAV,1,6,1.,1.\n", "the coordinate system CID is not rectangular"),
], placed=False)


# Points and directions in the systems of a deck are what other programs make of them.
SYSTEMS = """\
CORD2R,1,0,1.,2.,3.,1.,2.,4.
+,2.,3.,3.
CORD2C,2,1,.1,.2,.3,.4,.1,1.
+,1.,.5,.2
CORD2S,3,2,1.,30.,.5,1.,40.,2.
+,2.,10.,.3
"""


def test_nested_coordinate_systems_match_pyyeti(read, tetrahedron):
    local = {1: (0.3, -0.2, 0.7), 2: (1.5, 40.0, -0.3), 3: (2.0, 70.0, -25.0)}
    grids = "".join(f"GRID,{100 + c},{c},{x},{y},{z}\n" for c, (x, y, z) in local.items())
    mesh = read(SYSTEMS + grids + tetrahedron)
    uset, _ = nastran.bulk2uset(io.StringIO(SYSTEMS + grids))
    for c in local:
        expected = uset.loc[(100 + c, 1), "x":"z"].to_numpy(dtype=float)
        np.testing.assert_allclose(mesh.position[mesh.node_index(100 + c)], expected, atol=1e-13)


@pytest.mark.parametrize(("shape", "middle"), [("C", (0.0, 0.0, 0.7)), ("S", (0.0, 0.0, -0.7)), ("S", (0.0, 0.0, 0.0))])
def test_axes_on_system_axis_are_rectangular(read, tetrahedron, shape, middle):
    system = f"CORD2{shape},4,,.1,.2,.3,.4,.1,1.\n+,1.,.5,.2\n"
    frame = read(system.replace(f"CORD2{shape}", "CORD2R") + "GRID,9,,9.,9.,9.,4\n" + tetrahedron).axes[0]
    point = np.array([0.1, 0.2, 0.3]) + frame @ middle
    lost = "e_r and e_θ" if shape == "C" else "e_θ and e_φ"
    mesh = read(system + "GRID,9,,{:.12f},{:.12f},{:.12f},4\n".format(*point) + tetrahedron + "ENDDATA\n")
    np.testing.assert_allclose(mesh.axes[0], frame, atol=1e-10)
    assert mesh.notes == (
        f"nodes with CD = 4 on the axis of this coordinate system (1 in total, first node 9): {lost} are undefined there, "
        "so the rectangular axes of the system are used",
    )


@pytest.mark.parametrize("shape", "RCS")
def test_cord1_equals_cord2_through_same_points(read, tetrahedron, shape):
    nodes = "GRID,31,2,.5,30.,.1\nGRID,32,3,1.5,50.,20.\nGRID,33,8,.2,.3,-.4\n"
    other = "CORD1R,8,31,32,4\n"
    probe = "GRID,40,7,.6,35.,-.25,7\nGRID,41,6,.6,35.,-.25\n"
    by_nodes = read(f"CORD1{shape},7,31,32,33,6,32,33,31\n" + probe + other + nodes + SYSTEMS + tetrahedron)
    points = [by_nodes.position[by_nodes.node_index(i)] for i in (31, 32, 33)]

    def by_points(cid, points):
        a, b, c = ([f"{x:.14f}" for x in point] for point in points)
        return f"CORD2{shape},{cid},,{','.join([*a, *b])}\n+,{','.join(c)}\n"

    cards = by_points(7, points) + by_points(6, (points[1], points[2], points[0])) + probe
    uset, _ = nastran.bulk2uset(io.StringIO(cards))
    rigid = nastran.rbgeom_uset(uset, [0, 0, 0])
    for number in (40, 41):
        expected = uset.loc[(number, 1), "x":"z"].to_numpy(dtype=float)
        np.testing.assert_allclose(by_nodes.position[by_nodes.node_index(number)], expected, atol=1e-12)
    np.testing.assert_allclose(by_nodes.axes[by_nodes.node_index(40)].T, rigid[:3, :3], atol=1e-12)


def test_grdset_fills_blank_fields_only(read, tetrahedron):
    system = "CORD2R,5,,1.,0.,0.,1.,0.,1.\n+,1.,1.,0.\n"
    deck = system + "GRDSET,,5,,,,5,12\n" + tetrahedron.replace("GRID,4,,0.,0.,1.", "GRID,4,0,0.,0.,1.,0,0")
    mesh = read(deck)
    # x' = y, y' = −x, about a point at x = 1
    np.testing.assert_allclose(mesh.position, [[1, 0, 0], [1, 1, 0], [0, 0, 0], [0, 0, 1]], atol=1e-15)
    assert sorted(mesh.axes) == [0, 1, 2]
    np.testing.assert_allclose(mesh.axes[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)
    permanent = read(deck.replace("SPC1,1,123,1,2,3\n", "")).fixed
    assert permanent.tolist() == [[0, 0], [0, 1], [1, 0], [1, 1], [2, 0], [2, 1]]


test_coordinate_systems_that_define_nothing_are_refused = refusal_table(lambda card: f"{card}\n{TETRAHEDRON}", [
    ("CORD2R,1,,0.,0.,0.,0.,0.,1.\n+,0.,0.,2.", "one line"),
    ("CORD2R,1,2,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.", "system 2, which is not in the deck"),
    ("CORD2R,1,2,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.\nCORD2R,2,1,0.,0.,0.,0.,0.,1.\n+,1.,0.,0.", "the reference systems RID form a"),
    ("CORD1R,1,1,2,9", "node 9 is not in the deck"),
    ("CORD1R,1,1,2,60\nGRID,60,1,0.,1.,0.", "the reference systems RID form a"),
    ("CORD1R,1,1,2,60\nGRID,60,7,0.,1.,0.", "system 7, which is not in the deck"),
], placed=False)

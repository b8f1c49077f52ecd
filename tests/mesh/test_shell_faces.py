"""Faces of shells and sides of beams: where they lie, and what a gauge on them reads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.fem.constraints import constraint_transform
from strainsight.fem.equations import turning_nodes
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.mesh.facets import LOWER, UPPER, exterior_facets
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.section_shapes import section_of_shape
from strainsight.mesh.thin import BeamSection, ShellBlock, ShellSection
from strainsight.mesh.thin_faces import lines_without_sides, with_faces, with_sides
from strainsight.sensors.candidates import candidates
from strainsight.sensors.edges import sharp_edges
from strainsight.sensors.faces import faces_of
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.surface_paths import skin_of, walk
from strainsight.sensors.zones import OnElements, ShellFace, inside

from ..fem.shell_models import shells
from ..fem.test_thin import NU, E, L, line, straight
from ..structures import hexahedra

# Faces of shells: where their nodes lie, which elements share them, and that their motion is that of a plate's surface.
T = 0.01


def plate(nodes, x, offset=0.0, sections=None, region=(1,)):
    """Quadrilaterals on nodes (e, 4) at x."""
    mesh = shells("quad4", x, nodes, ShellSection(T), Material(1, 2e11, 0.3, 7850.0), offset)
    block = replace(mesh.shells[0], ids=9 + mesh.shells[0].ids, region=np.resize(region, len(nodes)))
    sections = sections or mesh.sections
    regions = {i: Region(i, f"PSHELL {i}", 1) for i in sections}
    return with_faces(replace(mesh, node_ids=99 + mesh.node_ids, shells=(block,), sections=sections, regions=regions))


def strip(fold=0.0):
    """Two squares side by side, the second turned up about their common side by an angle [deg]."""
    c, s = np.cos(np.deg2rad(fold)), np.sin(np.deg2rad(fold))
    x = [[0, 0, 0], [1, 0, 0], [1 + c, 0, s], [0, 1, 0], [1, 1, 0], [1 + c, 1, s]]
    return [[0, 1, 4, 3], [1, 2, 5, 4]], x


def heights(mesh):
    """z of the nodes on the upper and lower face of each element (e, 2, 4)."""
    return mesh.position[mesh.shells[0].on_faces][..., 2]


def test_plate_faces_lie_half_a_thickness_from_nodes():
    mesh = plate(*strip())
    assert (len(mesh.arms), mesh.own_nodes) == (2 * 6, 6)
    np.testing.assert_array_equal(mesh.node_ids[mesh.arms[:, 0]], mesh.node_ids[mesh.arms[:, 1]])
    facets = exterior_facets(mesh)
    found = candidates(mesh, facets, axis=(1.0, 0.2, 0.1))
    side = np.where(facets.facet == UPPER, 1.0, -1.0)
    np.testing.assert_allclose(found.normal, side[:, None] * [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(found.position[:, 2], side * T / 2)


def test_flipped_shell_shares_opposite_face():
    (first, second), x = strip()
    mesh = plate([first, second[::-1]], x)
    np.testing.assert_allclose(heights(mesh)[1, 0], -T / 2)
    assert len(mesh.arms) == 2 * 6


def test_offsets_move_both_faces_along_the_normal_of_the_element():
    mesh = plate(*strip(), offset=0.3 * T)
    np.testing.assert_allclose(heights(mesh)[:, 0], 0.8 * T)
    np.testing.assert_allclose(heights(mesh)[:, 1], -0.2 * T)
    (first, second), x = strip()
    mesh = plate([first, second[::-1]], x, offset=[0.3 * T, -0.3 * T])  # the same plane, seen from below
    assert len(mesh.arms) == 2 * 6


@pytest.mark.parametrize(("fold", "shared"), [(0.0, 2), (15.0, 2), (25.0, 0), (90.0, 0), (150.0, 0)])
def test_faces_are_split_at_folds_only(fold, shared):
    first, second = plate(*strip(fold)).shells[0].on_faces
    assert len(np.intersect1d(first[0], second[0])) == shared


def test_faces_are_split_at_thickness_steps():
    nodes, x = strip()
    mesh = plate(nodes, x, sections={1: ShellSection(T), 2: ShellSection(2 * T)}, region=[1, 2])
    np.testing.assert_allclose(heights(mesh)[:, 0], [[T / 2] * 4, [T] * 4])


def test_faces_lie_a_half_thickness_from_a_cylinder():
    n, R = 36, 0.5
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.column_stack([R * np.cos(angle), R * np.sin(angle), np.zeros(n)])
    x = np.vstack([ring, ring + np.array([0, 0, 0.1])])
    i = np.arange(n)
    mesh = plate(np.column_stack([i, (i + 1) % n, n + (i + 1) % n, n + i]), x)
    radius = np.linalg.norm(mesh.position[mesh.shells[0].on_faces][..., :2], axis=-1)
    np.testing.assert_allclose(radius[:, 0], R + T / 2, rtol=1e-12)
    np.testing.assert_allclose(radius[:, 1], R - T / 2, rtol=1e-12)


def test_a_gauge_reads_the_strain_of_a_bent_and_stretched_plate():
    """u = (a x, b y, 0) − z ∇w and w = ½ (k x² + l y²) + m x y:  ε = (a − k z) cos² + (b − l z) sin² − 2 m z sin cos."""
    a, b, k, l, m = 1e-4, -3e-5, 0.02, -0.05, 0.03
    nodes, x = strip()
    own = plate(nodes, np.array(x) * 0.1, offset=0.2 * T)
    T_ = constraint_transform(own, rotations=turning_nodes(own)).transform
    constraint = constraint_transform(own, rotations=turning_nodes(own))
    x, y, _ = own.position[:6].T
    motion = np.zeros((T_.shape[0], 1))
    motion[:18, 0] = np.column_stack([a * x, b * y, 0.5 * (k * x**2 + l * y**2) + m * x * y]).ravel()
    turn = np.column_stack([l * y + m * x, -(k * x + m * y), np.zeros(6)])  # w,y and −w,x
    motion[constraint.rotations(np.arange(6)), 0] = turn
    # every motion is free, so that the columns of T are those rows
    field = T_[: 3 * len(own.position)] @ motion[constraint.free_rows]
    every = candidates(own, exterior_facets(own), axis=(1.0, 0.0, 0.0), angles=(0.0, 30.0, 90.0))
    d, z = every.direction, every.position[:, 2]
    expected = (a - k * z) * d[:, 0] ** 2 + (b - l * z) * d[:, 1] ** 2 - 2 * m * z * d[:, 0] * d[:, 1]
    np.testing.assert_allclose(channel_rows(own.position, every, field)[:, 0], expected, rtol=1e-9)


def test_face_nodes_inherit_supports_and_sets():
    mesh = replace(plate(*strip()), fixed=np.array([(0, c) for c in range(6)]))
    chosen = np.zeros(len(mesh.position), dtype=bool)
    chosen[mesh.held] = True
    assert np.count_nonzero(mesh.above(chosen)) == 3


def test_zones_select_shell_faces():
    mesh = plate(*strip())
    facets = exterior_facets(mesh)
    every = candidates(mesh, facets, axis=(1.0, 0.0, 0.0))
    upper = inside(ShellFace(UPPER), mesh, facets, every.position, every.normal)
    np.testing.assert_array_equal(upper, every.position[:, 2] > 0)
    assert inside(OnElements("shells"), mesh, facets, every.position, every.normal).all()
    assert not inside(OnElements("solids"), mesh, facets, every.position, every.normal).any()


def cube_with(shells):
    """Eight bricks of 1 m on a grid of 3 × 3 × 4 nodes, the last layer of which they lack, and shells on nodes (x, y, z)."""
    x, number, cells = hexahedra((2, 2, 3))
    block = CellBlock("hex8", 1 + np.arange(8), cells[:, :, :2].reshape(-1, 8), np.full(8, 2))
    blocks, first = [], 50
    for kind, corners in (("quad4", 4), ("tri3", 3)):
        nodes = np.array([[number[node] for node in own] for own in shells if len(own) == corners], dtype=int)
        if e := len(nodes):
            blocks.append(ShellBlock(kind, first + np.arange(e), nodes, np.ones(e, int), np.zeros(e), np.full((e, 3), np.nan)))
            first += e
    regions = {1: Region(1, "PSHELL 1", 1), 2: Region(2, "PSOLID 2", 1)}
    own = {"regions": regions, "materials": {1: Material(1, 2e11, 0.3, 7850.0)}, "sections": {1: ShellSection(T)}}
    return with_faces(Mesh(1 + np.arange(len(x)), x.astype(float), (block,), shells=tuple(blocks), **own))


def outside_of(mesh):
    """Element and local number of its exterior facets of shells, and how many it has of solids."""
    facets = exterior_facets(mesh)
    thin = facets.of(mesh.shells)
    return list(zip(facets.element_id[thin].tolist(), facets.facet[thin].tolist(), strict=True)), np.count_nonzero(
        ~thin
    )


def test_shell_inside_solids_has_no_faces():
    """A fin along y = 1 m that ends one brick deep: as quadrilaterals, and as triangles, whose corners are those of no facet."""
    low = [((0, 1, 1), (1, 1, 1), (1, 1, 2), (0, 1, 2))]
    high = [((0, 1, 2), (1, 1, 2), (1, 1, 3), (0, 1, 3))]
    assert outside_of(cube_with(low + high)) == ([(51, UPPER), (51, LOWER)], 24)
    a, b, c, d = low[0]
    assert outside_of(cube_with([(a, b, c), (a, c, d), *high])) == ([(50, UPPER), (50, LOWER)], 24)


@pytest.mark.parametrize("turned", [False, True])
def test_skin_on_solid_has_one_exterior_face(turned):
    around = ((0, 0, 2), (1, 0, 2), (1, 1, 2), (0, 1, 2))
    skin = [around[::-1] if turned else around]
    seen = LOWER if turned else UPPER
    assert outside_of(cube_with(skin)) == ([(50, seen)], 23)
    a, b, c, d = skin[0]
    for triangles in ([(a, b, c), (a, c, d)], [(b, c, d), (d, a, b)]):
        assert outside_of(cube_with(triangles)) == ([(50, seen), (51, seen)], 23)


# Sides of beams: where they lie, and what a gauge on them reads of a stretched, bent and twisted beam.
H, B = 0.03, 0.02
"""Along z and y."""
POINTS = np.array([[B / 2, H / 2], [-B / 2, H / 2], [-B / 2, -H / 2], [B / 2, -H / 2]])
SECTION = BeamSection(B * H, np.diag([H * B**3, B * H**3]) / 12, 1e-8, points=POINTS)


def tip_loaded(beam, **load):
    """A cantilever under a load on its last node, its field, and all candidates along the beam at some angles."""
    mesh = with_sides(beam)
    model = build_model(mesh)
    S = input_shape(model, [PointLoad("f", node_id=int(beam.node_ids[-1]), **load)])
    z = nodal(model, spsolve(model.stiffness.constant.tocsc(), S[:, 0])[:, None])
    along = tuple(beam.beams[0].axes[0][:, 0])
    return mesh, z, candidates(mesh, exterior_facets(mesh), axis=along, angles=(0.0, 30.0, 90.0), on_constraints=True)


def test_sides_are_those_of_the_box_about_the_points_of_the_section_and_look_outward():
    mesh = with_sides(straight(2, section=SECTION, offset=(0.0, 0.01, 0.0)))
    every = candidates(mesh, exterior_facets(mesh), axis=(1.0, 0.0, 0.0), on_constraints=True)
    np.testing.assert_allclose(every.normal, [[0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1]] * 2, atol=1e-12)
    expected = [[0, B / 2], [1, H / 2], [0, -B / 2], [1, -H / 2]]
    for (axis, height), x in zip(expected * 2, every.position[:, 1:], strict=True):
        assert x[axis] == pytest.approx(height + (0.01 if axis == 0 else 0.0))


def test_sides_without_points_are_those_of_a_square():
    mesh = with_sides(straight(1, section=replace(SECTION, points=np.zeros((0, 2)))))
    np.testing.assert_allclose(np.ptp(mesh.position[mesh.arms[:, 0]], axis=0)[1:], np.sqrt(B * H))


def test_rods_and_released_beams_have_no_sides():
    assert not len(with_sides(straight(2, kind="rod", section=SECTION)).arms)
    beam = straight(2, section=SECTION)
    released = beam.beams[0].released.copy()
    released[0, 1, 4] = True
    mesh = with_sides(replace(beam, beams=(replace(beam.beams[0], released=released),)))
    assert len(mesh.arms) == 16
    assert (mesh.beams[0].on_sides[0] == -1).all()


def test_line_elements_without_sides_are_named_by_region():
    """Of five beams those with released ends, three of them by id, or those among some ids; of rods all."""
    beam = straight(5, section=SECTION)
    block = beam.beams[0]
    released = block.released.copy()
    released[1:, 0, 5] = True
    mesh = with_sides(replace(beam, beams=(replace(block, released=released),)))
    name, ids = beam.regions[int(block.region[0])].name, block.ids
    assert lines_without_sides(mesh) == f"4 line elements ({name}: {ids[1]}, {ids[2]}, {ids[3]}, …)"
    assert lines_without_sides(mesh, ids[:2]) == f"1 line element ({name}: {ids[1]})"
    assert lines_without_sides(with_sides(beam)) == ""
    assert lines_without_sides(with_sides(straight(2, kind="rod", section=SECTION))).startswith("2 line elements (")


@pytest.mark.parametrize("along", [(1.0, 0.0, 0.0), (0.3, -0.2, 0.5)])
@pytest.mark.parametrize(("axis", "I"), [(2, B * H**3 / 12), (1, H * B**3 / 12)])
def test_a_gauge_reads_bending_as_its_theory_has_it_at_any_angle(axis, I, along):
    """ε = −M c/(E I) along the beam, −ν ε across it."""
    x = np.linspace(0, L, 9)[:, None] * along / np.linalg.norm(along)
    axes = line(x, section=SECTION).beams[0].axes[0]
    mesh, z, every = tip_loaded(line(x, section=SECTION), direction=tuple(axes[:, axis]))
    s, *across = axes.T @ every.position.T
    strain = -(L - s) * across[axis - 1] / (E * I)
    cos, sin = np.cos(np.deg2rad(every.angle)), np.sin(np.deg2rad(every.angle))
    read = channel_rows(mesh.position, every, z)[:, 0]
    np.testing.assert_allclose(read, strain * (cos**2 - NU * sin**2), atol=1e-9 * np.abs(strain).max())


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.0, 0.02, -0.01)])
def test_side_gauge_measures_axial_strain_and_offset_bending(offset):
    mesh, z, every = tip_loaded(straight(8, section=SECTION, offset=offset), direction=(1, 0, 0))
    _, y, h = every.position.T
    # the force acts at the node, off the middle of the section by the offset
    bend = 12 * offset[1] * (y - offset[1]) / (H * B**3) + 12 * offset[2] * (h - offset[2]) / (B * H**3)
    strain = (1 / (B * H) - bend) / E
    read = channel_rows(mesh.position, every, z)[:, 0]
    own = every.angle == 0
    np.testing.assert_allclose(read[own], strain[own], rtol=1e-8)


def test_beam_sides_continue_up_to_a_knee():
    """Six beams in line are four faces from end to end, and a grid walks over their joints; a knee of 90° parts them."""
    mesh = with_sides(straight(6, section=SECTION))
    facets = exterior_facets(mesh)
    faces = faces_of(mesh.position, facets)
    np.testing.assert_allclose(np.sort(faces.area), [L * B, L * B, L * H, L * H])
    assert [faces.of[facets.facet == side].tolist() for side in (1, 2, 3, 4)] == [[f] * 6 for f in faces.of[:4]]
    along = np.array([[1.0, 0.0, 0.0]])
    start = np.array([[0.5 * L / 6, 0.0, H / 2]])
    trail = walk(
        skin_of(mesh.position, facets), np.array([1]), start, np.array([[0.0, 0.0, 1.0]]), along, np.array([0.7 * L])
    )
    assert trail.reached.all()
    assert facets.element_id[trail.last[0]] == mesh.beams[0].ids[4]
    # across the beam nothing is nearer than its edges along it and its ends
    ends = sharp_edges(mesh.position, facets)
    across = np.ptp(ends[:, :, 0], axis=1) == 0
    np.testing.assert_allclose(np.unique(ends[across][:, 0, 0]), [0, L], atol=1e-12)
    x = np.array([[0, 0, 0], [L / 2, 0, 0], [L, 0, 0], [L, L / 2, 0], [L, L, 0.0]])
    knee = with_sides(line(x, section=SECTION))
    assert len(faces_of(knee.position, exterior_facets(knee)).area) == 8


@pytest.mark.parametrize(
    ("shape", "dimensions", "sides"),
    [
        ("BAR", (0.02, 0.03), "+y +z -y -z"),
        ("TUBE", (0.02, 0.018), "+y +z -y -z"),
        ("BOX", (0.04, 0.06, 0.002, 0.003), "+y +z -y -z"),
        ("I", (0.1, 0.05, 0.06, 0.004, 0.005, 0.006), "+y -y"),
        ("H", (0.04, 0.01, 0.05, 0.004), "+z -z"),
        ("CHAN", (0.04, 0.08, 0.004, 0.005), "+y -y -z"),
        ("CHAN2", (0.004, 0.005, 0.06, 0.04), "+z -y -z"),
        ("L", (0.04, 0.06, 0.004, 0.005), "-y -z"),
        ("T", (0.05, 0.06, 0.004, 0.005), "+y -y"),
        ("HAT", (0.04, 0.003, 0.03, 0.02), "+y"),
        ("HEXA", (0.01, 0.05, 0.03), "+y -y"),
        ("Z", (0.03, 0.004, 0.06, 0.07), "+y -y"),
        ("CROSS", (0.03, 0.005, 0.05, 0.004), "+y +z -y -z"),
    ],
)
def test_section_sides_agree_with_its_shape(shape, dimensions, sides):
    section = section_of_shape(shape, dimensions)
    found = [name for name, there in zip(("+y", "+z", "-y", "-z"), section.sides, strict=True) if there]
    assert found == sides.split()
    mesh = with_sides(straight(2, section=section))
    assert exterior_facets(mesh).facet.tolist() == 2 * [1 + ["+y", "+z", "-y", "-z"].index(name) for name in found]
    assert len(mesh.arms) == 2 * 4 * len(found)

"""Faces of a part by the drawing, their curvature, and on which of them it stands."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.decks.reader import read_mesh
from strainsight.errors import UserError
from strainsight.mesh.additions import with_rigid_element
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import Springs
from strainsight.sensors.access import contact_faces
from strainsight.sensors.edges import bend_radius, sides, tight
from strainsight.sensors.faces import Pick, faces_of, facet_vectors, picked
from strainsight.sensors.surface import facet_centres

from ..bodies import body, held
from ..fem.test_thin import strip as strip_of_shells
from .conftest import KINDS, plate, surface, tube

TURNED = Rotation.random(random_state=4).as_matrix()
SHIFT = np.array([3.0, -1.0, 2.0])


def bent_strip(u, v, w):
    """A plate of 2 × 1 × 0.1 m that goes on around a quarter of a bend of radius 0.5 m and 1 m straight down."""
    z = 0.1 * v
    if u <= 4:
        x = np.array([0.5 * u, -w / 2, 0.5 + z])
    elif u <= 10:
        phi = (u - 4) / 6 * np.pi / 2
        x = np.array([2 + (0.5 + z) * np.sin(phi), -w / 2, (0.5 + z) * np.cos(phi)])
    else:
        x = np.array([2.5 + z, -w / 2, -0.5 * (u - 10)])
    return TURNED @ x + SHIFT


@pytest.fixture(scope="module", params=["hex8", pytest.param("tet10", marks=pytest.mark.slow)])
def strip(request):
    mesh = body(request.param, (12, 1, 2), bent_strip)
    facets = exterior_facets(mesh)
    return request.param, mesh, facets, faces_of(mesh.position, facets)


def test_a_bent_plate_has_the_ten_faces_of_its_drawing(strip):
    faces = strip[3]
    flat = faces.normal.any(axis=1)
    assert (np.count_nonzero(flat), len(flat)) == (8, 10)
    areas = np.sort(faces.area[flat])
    chords = 12 * np.sin(np.pi / 24)  # six of 15°, over the radius
    side = 0.1 * (2 + 1) + 0.5 * 6 * np.sin(np.pi / 12) * (0.6**2 - 0.5**2)
    np.testing.assert_allclose(areas, [0.1, 0.1, side, side, 1, 1, 2, 2], rtol=1e-9)
    bent = ~flat
    np.testing.assert_allclose(np.sort(faces.radius[bent]), [0.5, 0.6], rtol=1e-9)
    np.testing.assert_allclose(np.sort(faces.area[bent]), chords * np.array([0.5, 0.6]), rtol=1e-9)
    np.testing.assert_allclose(np.abs(faces.axis[bent] @ TURNED[:, 1]), 1, atol=1e-9)
    assert faces.hollow[bent].tolist() == (faces.radius[bent] < 0.55).tolist()


def test_areas_of_all_faces_are_the_surface_and_their_vectors_close_it(strip):
    _, mesh, facets, faces = strip
    vector = facet_vectors(mesh.position, facets)
    np.testing.assert_allclose(vector.sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(faces.area.sum(), np.linalg.norm(vector, axis=1).sum(), rtol=1e-12)
    assert np.all(np.diff(faces.area) <= 1e-6 * faces.area[0])


def test_the_point_of_every_face_means_that_face(strip):
    _, mesh, facets, faces = strip
    for face, point in [*enumerate(faces.point)][::2]:
        chosen = picked(Pick(near=(tuple(point),)), faces, mesh.position, facets)
        np.testing.assert_array_equal(chosen, np.flatnonzero(faces.of == face))


def test_the_axis_of_a_bend_means_its_inner_face_and_a_radius_both_of_that_radius(strip):
    _, mesh, facets, faces = strip
    axis = TURNED @ [2.0 + 1e-3, -0.5, 1e-3] + SHIFT
    inner = np.flatnonzero(np.abs(faces.radius - 0.5) < 1e-6)
    for pick in (Pick(near=(tuple(axis),)), Pick(radius=0.505)):
        np.testing.assert_array_equal(
            picked(pick, faces, mesh.position, facets), np.flatnonzero(np.isin(faces.of, inner))
        )


@pytest.mark.parametrize("sense", [1, -1])
def test_of_two_faces_as_near_the_normal_reports_which(strip, sense):
    _, mesh, facets, faces = strip
    up = tuple(TURNED @ [0.0, 0.0, float(sense)])
    middle = tuple(TURNED @ [1.0, -0.5, 0.55] + SHIFT)
    with pytest.raises(UserError, match="equally near to two faces"):
        picked(Pick(near=(middle,)), faces, mesh.position, facets)
    chosen = picked(Pick(near=(middle,), normal=up, angle=1), faces, mesh.position, facets)
    (face,) = set(faces.of[chosen].tolist())
    np.testing.assert_array_equal(chosen, np.flatnonzero(faces.of == face))
    np.testing.assert_allclose(facet_vectors(mesh.position, facets)[chosen].sum(axis=0), 2 * np.array(up), atol=1e-9)


@pytest.mark.parametrize(
    ("pick", "what"),
    [
        (Pick(near=((3000.0, 0.0, 0.0),)), "away from a part that is"),
        (Pick(near=(tuple(TURNED @ [0.0, 0.0, 0.55] + SHIFT),)), "equally near to two faces"),
        (Pick(radius=0.3), "no face has a radius of 0.3 m"),
        (Pick(normal=(0, 0, 1), box=((50, 50, 50), (51, 51, 51))), "no facet of the surface is selected"),
    ],
)
def test_what_means_no_face_or_two_is_refused(strip, pick, what):
    _, mesh, facets, faces = strip
    with pytest.raises(UserError, match=what):
        picked(pick, faces, mesh.position, facets)


def test_a_very_finely_meshed_bend_is_not_flat():
    def chart(u, v, w):
        return (1 + 0.1 * v) * np.cos(u / 286.5), (1 + 0.1 * v) * np.sin(u / 286.5), -w

    mesh = body("hex8", (450, 1, 2), chart)
    faces = faces_of(mesh.position, exterior_facets(mesh))
    np.testing.assert_allclose(np.sort(faces.radius[faces.radius > 0]), [1.0, 1.1], rtol=1e-6)


def test_a_coarse_cylinder_meshed_without_order_is_one_all_the_same():
    rng = np.random.default_rng(3)
    shift = {}

    def chart(u, v, w):
        z = w + shift.setdefault((u, w), 0.3 * rng.uniform(-1, 1) if 0 < w < 4 else 0.0)
        return TURNED @ [(1 + v) * np.cos(np.pi / 8 * u), (1 + v) * np.sin(np.pi / 8 * u), -z] + SHIFT

    mesh = body("tet4", (12, 1, 4), chart)
    faces = faces_of(mesh.position, exterior_facets(mesh))
    round_ = faces.radius > 0
    np.testing.assert_allclose(np.sort(faces.radius[round_]), [1, 2], rtol=1e-9)
    np.testing.assert_allclose(np.abs(faces.axis[round_] @ TURNED[:, 2]), 1, atol=1e-12)
    assert faces.hollow[round_].tolist() == (faces.radius[round_] < 1.5).tolist()


def test_every_listed_point_means_its_face_on_a_thin_part_far_from_the_origin():
    mesh = body("hex8", (4, 4, 1), lambda u, v, w: (12.3456 + u / 4, v / 4, 2.3456 + 6e-4 * w))
    facets = exterior_facets(mesh)
    faces = faces_of(mesh.position, facets)
    assert len(faces.area) == 6
    for face in range(0, 6, 2):
        point = tuple(json.loads(faces.near(face)))
        chosen = picked(Pick(near=(point,)), faces, mesh.position, facets)
        np.testing.assert_array_equal(chosen, np.flatnonzero(faces.of == face))


LUG = Path(__file__).parents[2] / "meshes" / "lug.bdf.gz"


def half_disc(rise, kind="hex8"):
    """Half a disc, radius 1 to 5 m, 2 m thick, with a bore along z; `rise` cells of 1 m on its outer ring, above it."""

    def chart(u, v, w):
        return (1 + u) * np.cos(np.pi * v / 12), (1 + u) * np.sin(np.pi * v / 12), w

    return body(kind, (4, 12, 2 + rise), chart, keep=lambda i, j, k: k < 2 or i == 3)


def of(mesh):
    """Normal, bores and places of every face that lies on something."""
    facets = exterior_facets(mesh)
    faces = faces_of(mesh.position, facets)
    found = contact_faces(mesh, facets, faces)
    return {
        tuple(faces.normal[face].round(6).tolist()): (int(found.bores[i]), int(found.places[i]))
        for i, face in enumerate(found.face)
    }


def radius(mesh):
    return np.linalg.norm(mesh.position[:, :2], axis=1)


DOWN, UP = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)


def instead(mesh):
    """Normals (of a face, of the one in place of which it may be that on which the part lies)."""
    facets = exterior_facets(mesh)
    faces = faces_of(mesh.position, facets)
    found = contact_faces(mesh, facets, faces)
    pairs = zip(found.face, found.instead_of, strict=True)
    return {tuple(map(tuple, faces.normal[[a, b]].round(6).tolist())) for a, b in pairs if b >= 0}


def test_of_both_sides_of_a_plate_one_is_in_place_of_the_other_unless_it_is_known():
    plate, higher = half_disc(0), half_disc(2)
    bolted = held(plate, radius(plate) < 1.01)
    ((first, other),) = instead(bolted)
    assert {first, other} == {UP, DOWN}
    assert instead(held(higher, radius(higher) < 1.01)) == set()
    for level, side in ((0.0, DOWN), (2.0, UP)):
        foot = (np.abs(plate.position[:, 2] - level) < 0.01) & (radius(plate) > 3.9)
        assert instead(held(bolted, foot)) == {(UP if side == DOWN else DOWN, side)}
    both = held(bolted, (np.abs(plate.position[:, 2] - 1.0) > 0.9) & (radius(plate) > 3.9))
    assert instead(both) == set()
    assert set(of(both)) == {UP, DOWN}


@pytest.mark.parametrize("kind", ["hex8", "tet10"])
@pytest.mark.parametrize(("rise", "faces"), [(0, {DOWN: (1, 0), UP: (1, 0)}), (2, {DOWN: (1, 0)})])
def test_bolted_plate_may_have_contact_on_both_sides(rise, faces, kind):
    mesh = half_disc(rise, kind)
    assert of(held(mesh, radius(mesh) < 1.01)) == faces


@pytest.mark.parametrize("of_what", ["a rim", "a tie", "springs"])
def test_contact_face_does_not_depend_on_bolt_model(of_what):
    mesh = half_disc(2)
    bore = radius(mesh) < 1.01
    nodes = np.flatnonzero(bore)
    if of_what == "a rim":
        found = held(mesh, bore & (mesh.position[:, 2] < 0.01))
    elif of_what == "springs":
        n, zero = len(nodes), np.zeros(len(nodes), dtype=int)
        found = replace(mesh, springs=(Springs("s", np.full(n, 1e6), np.arange(n), nodes, zero, np.ones(n)),))
    else:
        more = replace(
            mesh,
            node_ids=np.append(mesh.node_ids, len(mesh.node_ids) + 1),
            position=np.vstack([mesh.position, [0.0, 0.0, 1.0]]),
        )
        tied = with_rigid_element(more, len(mesh.node_ids), nodes, (0, 1, 2), "bolt")
        assert of(tied) == {}
        found = held(tied, np.arange(len(more.position)) == len(mesh.node_ids))
    assert of(found) == {DOWN: (1, 0)}


def test_symmetry_plane_through_bore_is_not_a_bolt():
    mesh = half_disc(2)
    cut = held(mesh, np.abs(mesh.position[:, 1]) < 1e-9, components=(1,))
    assert of(cut) == {}


def test_partly_supported_face_is_a_contact_face():
    mesh = half_disc(2)
    below = mesh.position[:, 2] < 0.01
    assert of(held(mesh, below & (radius(mesh) > 3.9))) == {DOWN: (0, 12)}
    assert of(held(mesh, below)) == {}
    assert of(mesh) == {}


@pytest.mark.slow
def test_the_lug_has_its_bores_and_stands_on_its_underside():
    """meshes/make_lug.py: a bore of 30 mm, four holes of 18 mm through 12 mm, a rounded ear of 30 mm."""
    mesh = read_mesh(LUG, "mm", "t")
    faces = faces_of(mesh.position, exterior_facets(mesh))
    assert sorted(np.round(faces.radius[faces.hollow], 6)) == [0.009] * 4 + [0.015]
    np.testing.assert_allclose(faces.area[np.isclose(faces.radius, 0.009)], 2 * np.pi * 0.009 * 0.012, rtol=0.01)
    assert np.round(faces.radius[(faces.radius > 0) & ~faces.hollow], 6).tolist() == [0.03]
    assert of(mesh) == {DOWN: (4, 0)}
    turned = replace(mesh, position=mesh.position @ np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]) + 7.0)
    assert set(of(turned).values()) == {(4, 0)}


def test_partly_supported_shell_has_no_contact_face():
    mesh = strip_of_shells(clamped=False)
    patch = np.flatnonzero(mesh.position[: mesh.own_nodes, 0] < 0.35)
    mesh = replace(mesh, fixed=np.array([(node, c) for node in patch for c in range(3)]))
    facets = exterior_facets(mesh)
    assert not len(contact_faces(mesh, facets, faces_of(mesh.position, facets)).face)


R = 3.0


@pytest.mark.parametrize("kind", KINDS)
def test_a_tube_bends_by_its_radius(kind):
    """Of any mesh: 1/R is the curvature around, and 0 that along. The mean of normals at a node is radial by symmetry."""
    position, facets = tube(kind, 24, 4, R)
    np.testing.assert_allclose(bend_radius(position, facets), R, rtol=0.005)


@pytest.mark.parametrize(("kind", "within"), [("tri3", 1.4), ("quad4", 1.25), ("tri6", 1.07), ("quad8", 1.07)])
def test_bend_radius_on_irregular_mesh(kind, within):
    position, facets = tube(kind, 24, 6, R, shake=0.15)
    found = bend_radius(position, facets) / R
    assert 1 / within < found.min() < found.max() < within
    assert np.median(found) == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_plane_has_no_curvature(kind):
    position, facets = plate(kind, 4, 3, shake=0.2)
    assert np.isinf(bend_radius(position, facets)).all()


def test_a_sphere_bends_by_its_radius_in_every_direction():
    step = 2 * np.pi / 36
    position, facets = surface(
        "quad4", 36, 6,
        lambda u, v: R * np.array([np.cos(step * u) * np.cos(step * (v - 3)), np.sin(step * u) * np.cos(step * (v - 3)),
                                   np.sin(step * (v - 3))]),
        closed=True,
    )  # fmt: skip
    found = bend_radius(position, facets).reshape(36, 6)
    np.testing.assert_allclose(found[:, 1:-1], R, rtol=1e-3)
    np.testing.assert_allclose(found, R, rtol=0.025)


@pytest.mark.parametrize(("fold", "bends"), [(25.0, True), (35.0, False)])
def test_a_fold_of_more_than_30_degrees_is_an_edge_and_no_bend(fold, bends):
    slope = np.deg2rad(fold / 2)
    position, facets = surface("quad4", 6, 2, lambda u, v: (u * np.cos(slope), v, -abs(u - 3) * np.sin(slope)))
    centre, _ = facet_centres(position, facets.kind, facets.nodes)
    beside = np.abs(centre[:, 0] / np.cos(slope) - 3) < 1
    found = bend_radius(position, facets)
    np.testing.assert_array_equal(np.isfinite(found), beside & bends)
    if bends:  # half the fold over a cell
        np.testing.assert_allclose(found[beside], 0.5 / np.sin(slope / 2), rtol=0.01)


def test_facets_below_a_bend_radius_are_detected():
    position, facets = tube("quad8", 24, 4, R)
    assert not tight(position, facets, 0.97 * R).any()
    assert tight(position, facets, 1.03 * R).all()
    chosen = np.arange(len(facets.kind)) == 5
    own = position[facets.nodes[5, :4]]
    found = sides(position, facets, chosen)
    assert found.shape == (6, 2, 3)
    assert {tuple(x) for x in found.reshape(-1, 3)} == {tuple(x) for x in own}
    assert sides(position, facets, ~chosen).shape == (6 * (len(chosen) - 1), 2, 3)
    assert sides(position, facets, chosen & ~chosen).shape == (0, 2, 3)

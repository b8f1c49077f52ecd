"""Faces are those of the drawing, whatever meshes them, and a face is what a point, a normal, a box or a radius means."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.decks.reader import read_mesh
from strainsight.errors import UserError
from strainsight.gauges.faces import Pick, faces_of, facet_vectors, picked
from strainsight.mesh.facets import exterior_facets

from ..bodies import body

MESHES = Path(__file__).parents[2] / "meshes"
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


@pytest.fixture(scope="module", params=["tet4", "tet10", "hex8", "wedge15"])
def strip(request):
    mesh = body(request.param, (12, 1, 2), bent_strip)
    facets = exterior_facets(mesh)
    return request.param, mesh, facets, faces_of(mesh.position, facets)


def test_a_bent_plate_has_the_ten_faces_of_its_drawing(strip):
    faces = strip[3]
    flat = faces.normal.any(axis=1)
    assert (np.count_nonzero(flat), len(flat)) == (8, 10)
    # two long flats of 2 m², two short ones of 1 m², two sides, two ends of 0.1 m²
    areas = np.sort(faces.area[flat])
    chords = 12 * np.sin(np.pi / 24)  # six of 15°, over the radius
    side = 0.1 * (2 + 1) + 0.5 * 6 * np.sin(np.pi / 12) * (0.6**2 - 0.5**2)
    np.testing.assert_allclose(areas, [0.1, 0.1, side, side, 1, 1, 2, 2], rtol=1e-9)
    bent = ~flat
    np.testing.assert_allclose(np.sort(faces.radius[bent]), [0.5, 0.6], rtol=1e-9)
    np.testing.assert_allclose(np.sort(faces.area[bent]), chords * np.array([0.5, 0.6]), rtol=1e-9)
    np.testing.assert_allclose(np.abs(faces.axis[bent] @ TURNED[:, 1]), 1, atol=1e-9)
    assert faces.hollow[bent].tolist() == (faces.radius[bent] < 0.55).tolist()


def test_normals_of_flat_faces_point_outward_along_the_drawing(strip):
    _, _, _, faces = strip
    top = np.argmax((faces.point - SHIFT) @ TURNED[:, 2])
    np.testing.assert_allclose(faces.normal[top] @ TURNED, [0, 0, 1], atol=1e-9)


def test_areas_of_all_faces_are_the_surface_and_their_vectors_close_it(strip):
    _, mesh, facets, faces = strip
    vector = facet_vectors(mesh.position, facets)
    np.testing.assert_allclose(vector.sum(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(faces.area.sum(), np.linalg.norm(vector, axis=1).sum(), rtol=1e-12)
    assert np.all(np.diff(faces.area) <= 1e-6 * faces.area[0])


def test_the_point_of_every_face_means_that_face(strip):
    _, mesh, facets, faces = strip
    for face, point in enumerate(faces.point):
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


def test_a_normal_and_a_box_hold_together(strip):
    _, mesh, facets, faces = strip
    down = tuple(TURNED @ [0, 0, -1])
    every = picked(Pick(normal=down, angle=1), faces, mesh.position, facets)
    low, high = mesh.position.min(axis=0) - 1, mesh.position.max(axis=0) + 1
    within = picked(Pick(normal=down, angle=1, box=(tuple(low), tuple(high))), faces, mesh.position, facets)
    assert within.tolist() == every.tolist()
    area = np.linalg.norm(facet_vectors(mesh.position, facets)[every], axis=1).sum()
    np.testing.assert_allclose(area, 2 + 0.1, rtol=1e-9)  # the long flat from below, and the end that looks down


@pytest.mark.parametrize("sense", [1, -1])
def test_of_two_faces_as_near_the_normal_says_which(strip, sense):
    """A point halfway between both sides of the plate, as one on a contact is of both parts."""
    _, mesh, facets, faces = strip
    up = tuple(TURNED @ [0.0, 0.0, float(sense)])
    middle = tuple(TURNED @ [1.0, -0.5, 0.55] + SHIFT)
    with pytest.raises(UserError, match="as near to one face"):
        picked(Pick(near=(middle,)), faces, mesh.position, facets)
    chosen = picked(Pick(near=(middle,), normal=up, angle=1), faces, mesh.position, facets)
    (face,) = set(faces.of[chosen].tolist())
    np.testing.assert_array_equal(chosen, np.flatnonzero(faces.of == face))
    np.testing.assert_allclose(facet_vectors(mesh.position, facets)[chosen].sum(axis=0), 2 * np.array(up), atol=1e-9)


@pytest.mark.parametrize(
    ("pick", "what"),
    [
        (Pick(near=((3000.0, 0.0, 0.0),)), "away from a part that is"),
        (Pick(near=(tuple(TURNED @ [0.0, 0.0, 0.55] + SHIFT),)), "as near to one face"),
        (Pick(radius=0.3), "no face has a radius of 0.3 m"),
        (Pick(normal=(0, 0, 1), box=((50, 50, 50), (51, 51, 51))), "no facet of the surface is meant"),
    ],
)
def test_what_means_no_face_or_two_is_refused(strip, pick, what):
    _, mesh, facets, faces = strip
    with pytest.raises(UserError, match=what):
        picked(pick, faces, mesh.position, facets)


def test_a_very_finely_meshed_bend_is_not_flat():
    """Neighbours of 0.2° lie in one plane by themselves, all of them together do not."""
    def chart(u, v, w):
        return (1 + 0.1 * v) * np.cos(u / 286.5), (1 + 0.1 * v) * np.sin(u / 286.5), -w

    mesh = body("hex8", (450, 1, 2), chart)
    faces = faces_of(mesh.position, exterior_facets(mesh))
    np.testing.assert_allclose(np.sort(faces.radius[faces.radius > 0]), [1.0, 1.1], rtol=1e-6)


def test_a_coarse_cylinder_meshed_without_order_is_one_all_the_same():
    """Sixteen chords a turn, nodes shifted along the axis at random: normals of the triangles are tilted."""
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


def test_the_lug_has_its_bores():
    """meshes/make_lug.py: a bore of 30 mm, four holes of 18 mm through 12 mm, a rounded ear of 30 mm."""
    mesh = read_mesh(MESHES / "lug.bdf.gz", "mm", "t")
    faces = faces_of(mesh.position, exterior_facets(mesh))
    assert sorted(np.round(faces.radius[faces.hollow], 6)) == [0.009] * 4 + [0.015]
    np.testing.assert_allclose(faces.area[np.isclose(faces.radius, 0.009)], 2 * np.pi * 0.009 * 0.012, rtol=0.01)
    assert np.round(faces.radius[(faces.radius > 0) & ~faces.hollow], 6).tolist() == [0.03]


def test_every_listed_point_means_its_face_on_a_thin_part_far_from_the_origin():
    """0.6 mm thick, 12 m away: with four digits its rims and its underside would be named by points of its top."""
    mesh = body("hex8", (4, 4, 1), lambda u, v, w: (12.3456 + u / 4, v / 4, 2.3456 + 6e-4 * w))
    facets = exterior_facets(mesh)
    faces = faces_of(mesh.position, facets)
    assert len(faces.area) == 6
    for face in range(6):
        point = tuple(json.loads(faces.near(face)))
        chosen = picked(Pick(near=(point,)), faces, mesh.position, facets)
        np.testing.assert_array_equal(chosen, np.flatnonzero(faces.of == face))

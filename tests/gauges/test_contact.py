"""A part stands on the face into which its bolts run, and on what is held in places; not on a plane of symmetry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.gauges.contact import contact_faces
from strainsight.gauges.faces import faces_of
from strainsight.mesh.additions import with_rigid_element
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import Springs

from ..bodies import body, held
from ..fem.test_thin import strip

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
    """A bore that ends on something higher, facets that are held: what lies there is known, and the other side is in doubt."""
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
def test_a_bolted_plate_may_lie_on_both_sides_and_what_stands_on_it_says_which(rise, faces, kind):
    mesh = half_disc(rise, kind)
    assert of(held(mesh, radius(mesh) < 1.01)) == faces


@pytest.mark.parametrize("of_what", ["a rim", "a tie", "springs"])
def test_however_the_bolt_is_modelled(of_what):
    """Held on the rim of its bore alone, by a tie to a held node, on springs; a tie to a node that is not held is a load."""
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


def test_a_plane_of_symmetry_that_cuts_a_bore_is_no_bolt():
    mesh = half_disc(2)
    cut = held(mesh, np.abs(mesh.position[:, 1]) < 1e-9, components=(1,))
    assert of(cut) == {}


def test_a_face_that_is_held_in_places_lies_on_something_and_one_held_as_a_whole_has_no_room():
    mesh = half_disc(2)
    below = mesh.position[:, 2] < 0.01
    assert of(held(mesh, below & (radius(mesh) > 3.9))) == {DOWN: (0, 12)}
    assert of(held(mesh, below)) == {}
    assert of(mesh) == {}


def test_the_lug_stands_on_its_underside_and_not_on_the_top_of_its_base():
    mesh = read_mesh(LUG, "mm", "t")
    assert of(mesh) == {DOWN: (4, 0)}
    turned = replace(mesh, position=mesh.position @ np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]) + 7.0)
    assert set(of(turned).values()) == {(4, 0)}


def test_a_plate_of_shells_that_is_held_in_places_lies_on_neither_of_its_faces():
    """Its nodes are held, not one of its faces: both would go, and no gauge had a place."""
    mesh = strip(clamped=False)
    patch = np.flatnonzero(mesh.position[: mesh.own_nodes, 0] < 0.35)
    mesh = replace(mesh, fixed=np.array([(node, c) for node in patch for c in range(3)]))
    facets = exterior_facets(mesh)
    assert not len(contact_faces(mesh, facets, faces_of(mesh.position, facets)).face)

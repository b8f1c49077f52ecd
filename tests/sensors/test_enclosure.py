"""Views of the outside against closed forms and brute force; bores against fillets and grooves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.mesh.facets import CODE, Facets, exterior_facets
from strainsight.mesh.thin_faces import with_faces
from strainsight.sensors.access import on_bores
from strainsight.sensors.candidates import candidates
from strainsight.sensors.enclosure import all_directions, ray_tree, sees_outside, unobstructed
from strainsight.sensors.faces import faces_of
from strainsight.sensors.surface import facet_centres
from strainsight.sensors.surface_paths import skin_of

from .. import parts
from ..bodies import body, held

NONE = np.zeros(0, dtype=np.int64)


def quads(x):
    """Nodes and facets of separate quadrilaterals (f, 4, 3)."""
    nodes = np.full((len(x), 8), -1)
    nodes[:, :4] = np.arange(4 * len(x)).reshape(-1, 4)
    ones = np.ones(len(x), dtype=np.int64)
    return x.reshape(-1, 3), Facets(np.arange(len(x)), ones, CODE["quad4"] * ones, nodes, ones)


def factors(x, facets, of, steps=200):
    """View factors of facets, by bisection of the least."""
    tree = ray_tree(x, facets)
    _, normal = facet_centres(x, facets.kind, facets.nodes)
    low, directions = np.zeros(len(of)), all_directions()
    for least in np.arange(1, steps) / steps:
        sees = sees_outside(tree, of, tree.centre[of], normal[of], directions, least)
        low = np.where(sees, least, low)
    return low


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0), (1, 2, 3)])
def test_view_factor_in_a_closed_tube_is_that_of_its_open_end(axis):
    """Wall element at depth z in a tube of diameter D: F = (Z² + ½)/√(Z² + 1) − Z with Z = z/D (Howell, factor B-32)."""
    around, along, long = 48, 60, 6.0
    turn, z = np.linspace(0, 2 * np.pi, around + 1), np.linspace(0, long, along + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(np.arange(around), np.arange(along), indexing="ij"))
    corners = [(u, v), (u, v + 1), (u + 1, v + 1), (u + 1, v)]
    wall = np.stack([np.stack([np.cos(turn[a]) / 2, np.sin(turn[a]) / 2, z[b]], 1) for a, b in corners], 1)
    lid = long * np.eye(3)[2] + np.array([[[-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]]])
    third = np.array(axis) / np.linalg.norm(axis)
    first = np.cross(third, [0.3, 0.5, 0.1]) / np.linalg.norm(np.cross(third, [0.3, 0.5, 0.1]))
    x, facets = quads(np.concatenate([wall, lid]) @ np.stack([first, np.cross(third, first), third]))
    for k in (0, 2, 5, 9, 12, 20):
        of = np.flatnonzero(v == k)
        Z = (k + 0.5) * long / along
        exact = (Z**2 + 0.5) / np.sqrt(Z**2 + 1) - Z
        found = factors(x, facets, of)
        assert np.mean(found) == pytest.approx(exact, abs=0.02)
        np.testing.assert_allclose(found, exact, atol=0.09)


def test_view_factor_on_the_floor_of_a_groove():
    """Middle of the floor of an endless groove of width w and depth h: F = sin(atan(w/2h))."""
    far, depth = 1e3, 2.0
    walls = [[[y, -far, 0], [y, far, 0], [y, far, depth], [y, -far, depth]] for y in (-0.5, 0.5)]
    floor = [[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]
    found = factors(*quads(np.array([floor, *walls])), np.array([0]))
    assert found[0] == pytest.approx(np.sin(np.arctan(0.25)), abs=0.03)


def test_the_tree_finds_what_every_triangle_by_itself_finds():
    """Rays at 400 quadrilaterals of many sizes, each of two triangles: x + t d = a + u e + v f solved for all of them."""
    rng = np.random.default_rng(5)
    size = 10.0 ** rng.uniform(-2, 0, 400)
    e, f = (rng.normal(size=(400, 3)) * size[:, None] for _ in range(2))
    low = rng.normal(size=(400, 3))
    x, facets = quads(np.stack([low, low + e, low + e + f, low + f], axis=1))
    tree, every = ray_tree(x, facets), np.arange(400)
    directions = rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for d in directions:
        n = np.tile(d, (400, 1))
        start = low + 0.5 * (e + f)
        A = np.stack([e, f, np.tile(-d, (400, 1))], axis=2)
        u, v, t = np.moveaxis(np.linalg.solve(A[None], (start[:, None] - low)[..., None])[..., 0], 2, 0)
        meets = (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1) & (t > 0) & ~np.eye(400, dtype=bool)
        np.testing.assert_array_equal(sees_outside(tree, every, tree.centre, n, d[None], 1.0), ~meets.any(axis=1))


def test_mirrored_parts_have_mirrored_views():
    rng = np.random.default_rng(2)
    low, e, f = rng.normal(size=(3, 60, 3))
    x = np.stack([low, low + e, low + e + f, low + f], axis=1)
    one, facets = quads(x)
    for mirror in ([-1, 1, 1], [1, -1, 1], [1, 1, -1]):
        other, turned = quads((x * mirror)[:, ::-1])
        np.testing.assert_array_equal(factors(one, facets, np.arange(60), 40), factors(other, turned, np.arange(60), 40))


def test_a_void_in_a_solid_is_enclosed_and_its_outside_is_not():
    mesh = body("hex8", (5, 5, 5), lambda *u: u, lambda *cell: cell != (2, 2, 2))
    facets = exterior_facets(mesh)
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    every, tree = np.arange(len(centre)), ray_tree(mesh.position, facets)
    inside = np.all(np.abs(centre - 2.5) < 1, axis=1)
    assert np.count_nonzero(inside) == 6
    np.testing.assert_array_equal(sees_outside(tree, every, tree.centre, normal, all_directions()), ~inside)


def test_no_ray_leaves_a_welded_box_through_its_walls(tmp_path, monkeypatch):
    """Shells as large as thick: centres of facets at the edges lie exactly on the faces of the next wall."""
    monkeypatch.setattr(parts, "CELL", parts.WALL)
    (tmp_path / "frame.bdf").write_text(parts.frame(), encoding="ascii")
    mesh = with_faces(read_mesh(tmp_path / "frame.bdf", "mm", "t"))
    facets = exterior_facets(mesh)
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    tree = ray_tree(mesh.position, facets)
    sees = sees_outside(tree, np.arange(len(centre)), tree.centre, normal, all_directions(), 1e-6)
    np.testing.assert_array_equal(sees, ~parts.in_box(centre, normal))


def test_a_gauge_is_seen_along_its_normal_or_not():
    mesh = body("hex8", (5, 5, 5), lambda *u: u, lambda *cell: cell != (2, 2, 2))
    gauges = candidates(mesh, exterior_facets(mesh), (1, 0.1, 0.2))
    outside = unobstructed(skin_of(mesh.position, exterior_facets(mesh)), gauges)
    np.testing.assert_array_equal(outside, np.abs(gauges.position - 2.5).max(axis=1) > 1)


def ring(part, radius, kind="hex20", cells=(24, 2, 3), depth=0.03):
    """A ring of twice its bore's radius, of which `part` of the circle is there."""

    def chart(u, v, w):
        r, turn = radius * (1 + v / cells[1]), -2 * np.pi * part * u / cells[0]
        return (r * np.cos(turn), r * np.sin(turn), depth * w / cells[2])

    mesh = body(kind, cells, chart)
    if part == 1:
        _, first, same = np.unique(np.round(mesh.position, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
        block = replace(mesh.blocks[0], nodes=same.ravel()[mesh.blocks[0].nodes])
        return replace(mesh, node_ids=np.arange(1, len(first) + 1), position=mesh.position[first], blocks=(block,))
    return mesh


def bores(mesh, loaded=NONE):
    """Facets on bores, and those at the inner radius of a ring."""
    facets = exterior_facets(mesh)
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    inner = (np.sum(centre[:, :2] * normal[:, :2], axis=1) < 0) & (np.abs(normal[:, 2]) < 0.5)
    inner &= np.hypot(*centre[:, :2].T) < 1.1 * np.hypot(*mesh.position[:, :2].T).min()
    return on_bores(mesh, facets, faces_of(mesh.position, facets), loaded), inner


@pytest.mark.parametrize(("radius", "narrow"), [(0.0295, True), (0.03, False)])
def test_a_bore_is_excluded_if_no_hand_fits_or_if_it_holds_something(radius, narrow):
    """60 mm are the limit; a pin loads or supports a node inside, the support of an end face only those of a rim."""
    mesh = ring(1, radius)
    found, inner = bores(mesh)
    assert np.count_nonzero(inner) == 24 * 3
    np.testing.assert_array_equal(found, inner & narrow)
    wall = np.flatnonzero(np.abs(np.hypot(*mesh.position[:, :2].T) - radius) < 1e-6)
    inside = wall[np.abs(mesh.position[wall, 2] - 0.015) < 0.014][:1]
    for full in (bores(mesh, inside)[0], bores(held(mesh, np.arange(len(mesh.position)) == inside))[0]):
        np.testing.assert_array_equal(full, inner)
    end = mesh.position[:, 2] < 1e-9
    for rim in (bores(mesh, np.flatnonzero(end))[0], bores(held(mesh, end))[0]):
        np.testing.assert_array_equal(rim, inner & narrow)


def test_a_linear_mesh_without_nodes_inside_a_bore_shows_a_pin_by_a_loaded_facet():
    mesh = ring(1, 0.04, "hex8", (24, 2, 1))
    turn = np.arctan2(mesh.position[:, 1], mesh.position[:, 0])
    wall = np.hypot(*mesh.position[:, :2].T) < 0.0401
    found, inner = bores(mesh, np.flatnonzero(wall & (np.abs(turn) < 0.3)))
    assert np.count_nonzero(inner) == 24
    np.testing.assert_array_equal(found, inner)


@pytest.mark.parametrize("part", [0.25, 0.5])
def test_fillets_and_round_grooves_are_no_bores(part):
    mesh = ring(part, 0.01)
    wall = np.flatnonzero(np.abs(np.hypot(*mesh.position[:, :2].T) - 0.01) < 1e-6)
    found, inner = bores(mesh, wall)
    assert inner.any()
    assert not found.any()

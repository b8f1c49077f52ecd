"""Faces of shells: where their nodes lie, which elements share them, and that their motion is that of a plate's surface."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.fem.constraints import constraint_transform
from strainsight.fem.turning import turning_nodes
from strainsight.gauges.candidates import candidates
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.zones import OnElements, ShellFace, inside
from strainsight.mesh.facets import LOWER, UPPER, exterior_facets
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.shell_faces import with_faces
from strainsight.mesh.thin import ShellBlock, ShellSection

T = 0.01


def plate(nodes, x, offset=0.0, sections=None, region=None):
    """Quadrilaterals of one thickness on nodes (e, 4) at x."""
    e = len(nodes)
    block = ShellBlock(
        "quad4",
        10 + np.arange(e),
        np.array(nodes),
        np.ones(e, dtype=int) if region is None else np.array(region),
        np.broadcast_to(offset, e).astype(float),
        np.full((e, 3), np.nan),
    )
    sections = sections or {1: ShellSection(T)}
    return with_faces(
        Mesh(
            100 + np.arange(len(x)),
            np.array(x, dtype=float),
            (),
            {i: Region(i, f"PSHELL {i}", 1) for i in sections},
            {1: Material(1, 2e11, 0.3, 7850.0)},
            np.zeros((0, 2), dtype=int),
            shells=(block,),
            sections=sections,
        )
    )


def strip(fold=0.0):
    """Two squares side by side, the second turned up about their common side by an angle [deg]."""
    c, s = np.cos(np.deg2rad(fold)), np.sin(np.deg2rad(fold))
    x = [[0, 0, 0], [1, 0, 0], [1 + c, 0, s], [0, 1, 0], [1, 1, 0], [1 + c, 1, s]]
    return [[0, 1, 4, 3], [1, 2, 5, 4]], x


def heights(mesh):
    """z of the nodes on the upper and lower face of each element (e, 2, 4)."""
    return mesh.position[mesh.shells[0].on_faces][..., 2]


def test_a_plate_has_a_face_at_half_its_thickness_on_either_side_and_its_nodes_once():
    mesh = plate(*strip())
    np.testing.assert_allclose(heights(mesh)[:, 0], T / 2)
    np.testing.assert_allclose(heights(mesh)[:, 1], -T / 2)
    assert len(mesh.arms) == 2 * 6
    np.testing.assert_array_equal(mesh.node_ids[mesh.arms[:, 0]], mesh.node_ids[mesh.arms[:, 1]])
    assert mesh.own_nodes == 6


def test_its_facets_look_away_from_the_shell():
    facets = exterior_facets(plate(*strip()))
    centre, normal = candidates_of(plate(*strip()))
    np.testing.assert_allclose(normal[facets.facet == UPPER], [[0, 0, 1]] * 2, atol=1e-15)
    np.testing.assert_allclose(normal[facets.facet == LOWER], [[0, 0, -1]] * 2, atol=1e-15)
    np.testing.assert_allclose(centre[:, 2], np.where(facets.facet == UPPER, T / 2, -T / 2))


def candidates_of(mesh):
    found = candidates(mesh, exterior_facets(mesh), axis=(1.0, 0.2, 0.1))
    return found.position, found.normal


def test_an_element_that_is_turned_over_shares_the_other_face():
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
def test_a_fold_parts_the_faces_and_a_bend_does_not(fold, shared):
    first, second = plate(*strip(fold)).shells[0].on_faces
    assert len(np.intersect1d(first[0], second[0])) == shared


def test_faces_of_another_thickness_part():
    nodes, x = strip()
    mesh = plate(nodes, x, sections={1: ShellSection(T), 2: ShellSection(2 * T)}, region=[1, 2])
    np.testing.assert_allclose(heights(mesh)[:, 0], [[T / 2] * 4, [T] * 4])


def test_faces_lie_a_half_thickness_from_a_cylinder():
    """On nodes of a cylinder the mean normal is the radius, so that faces lie on cylinders."""
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


def test_nodes_that_follow_are_held_and_chosen_with_their_own():
    mesh = replace(plate(*strip()), fixed=np.array([(0, c) for c in range(6)]))
    chosen = np.zeros(len(mesh.position), dtype=bool)
    chosen[mesh.held] = True
    assert np.count_nonzero(mesh.above(chosen)) == 3


def test_zones_take_one_face_of_the_shells_or_what_is_no_shell():
    mesh = plate(*strip())
    facets = exterior_facets(mesh)
    every = candidates(mesh, facets, axis=(1.0, 0.0, 0.0))
    upper = inside(ShellFace(UPPER), mesh, facets, every.position, every.normal)
    np.testing.assert_array_equal(upper, every.position[:, 2] > 0)
    assert inside(OnElements("shells"), mesh, facets, every.position, every.normal).all()
    assert not inside(OnElements("solids"), mesh, facets, every.position, every.normal).any()


def cube_with(shells):
    """Eight bricks of 1 m on a grid of 3 × 3 × 4 nodes, the last layer of which they lack, and shells on nodes (x, y, z)."""
    x = np.stack(np.meshgrid(*(np.arange(n) for n in (3, 3, 4)), indexing="ij"), axis=-1).reshape(-1, 3)
    number = {tuple(own): i for i, own in enumerate(x.tolist())}
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
    start = x[(x < 2).all(axis=1)]
    bricks = [[number[tuple((own + np.array(c)).tolist())] for c in corners] for own in start]
    block = CellBlock("hex8", 1 + np.arange(8), np.array(bricks), np.full(8, 2))
    kinds = {"quad4": [own for own in shells if len(own) == 4], "tri3": [own for own in shells if len(own) == 3]}
    blocks = []
    for kind, own in kinds.items():
        first = 50 + sum(len(each.ids) for each in blocks)
        nodes = np.array([[number[node] for node in each] for each in own], dtype=int)
        e = len(own)
        blocks += [
            ShellBlock(kind, first + np.arange(e), nodes, np.ones(e, int), np.zeros(e), np.full((e, 3), np.nan))
        ] * (e > 0)
    regions = {1: Region(1, "PSHELL 1", 1), 2: Region(2, "PSOLID 2", 1)}
    material = {1: Material(1, 2e11, 0.3, 7850.0)}
    return with_faces(
        Mesh(
            1 + np.arange(len(x)), x.astype(float), (block,), regions, material, np.zeros((0, 2), int),
            shells=tuple(blocks), sections={1: ShellSection(T)},
        )
    )  # fmt: skip


def outside_of(mesh):
    """Element and local number of its exterior facets of shells, and how many it has of solids."""
    facets = exterior_facets(mesh)
    thin = facets.of(mesh.shells)
    return list(zip(facets.element_id[thin].tolist(), facets.facet[thin].tolist(), strict=True)), np.count_nonzero(
        ~thin
    )


def test_a_shell_inside_of_solids_has_no_faces_and_one_that_stands_on_them_has_both():
    """A fin along y = 1 m that ends one brick deep: as quadrilaterals, and as triangles, whose corners are those of no facet."""
    low = [((0, 1, 1), (1, 1, 1), (1, 1, 2), (0, 1, 2))]
    high = [((0, 1, 2), (1, 1, 2), (1, 1, 3), (0, 1, 3))]
    assert outside_of(cube_with(low + high)) == ([(51, UPPER), (51, LOWER)], 24)
    a, b, c, d = low[0]
    assert outside_of(cube_with([(a, b, c), (a, c, d), *high])) == ([(50, UPPER), (50, LOWER)], 24)


@pytest.mark.parametrize("turned", [False, True])
def test_of_a_skin_on_a_solid_one_face_is_seen_and_what_it_lies_on_is_not(turned):
    around = ((0, 0, 2), (1, 0, 2), (1, 1, 2), (0, 1, 2))
    skin = [around[::-1] if turned else around]
    seen = LOWER if turned else UPPER
    assert outside_of(cube_with(skin)) == ([(50, seen)], 23)
    a, b, c, d = skin[0]
    for triangles in ([(a, b, c), (a, c, d)], [(b, c, d), (d, a, b)]):
        assert outside_of(cube_with(triangles)) == ([(50, seen), (51, seen)], 23)

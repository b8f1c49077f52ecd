"""Hot spots of strain, and the dimensions of gauges at edges."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.mesh.facets import exterior_facets
from strainsight.sensors.candidates import candidates
from strainsight.sensors.edges import angle_from, edge_dimensions
from strainsight.sensors.hot_spots import hot_spots
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.zones import NormalCone

from ..bodies import NU, E, body, held, moved
from .conftest import surface, tube

SHARE = 0.05


def gauges_at(mesh, places, normal, axis, within=10.0):
    """The facets, of those that face along the normal within some degrees, whose centres are nearest."""
    every = candidates(mesh, exterior_facets(mesh), axis, include=[NormalCone(normal, within)], on_constraints=True)
    behind = every.normal @ np.array(normal) < 0
    apart = [np.linalg.norm(every.position - np.array(place), axis=1) + 1e3 * behind for place in places]
    return every.take(np.array([int(np.argmin(each)) for each in apart]))


def found(mesh, field, gauges, loaded=(), pressed=()):
    return hot_spots(mesh, gauges, field, np.eye(1), np.array(loaded, dtype=int), np.array(pressed, dtype=int))


def cantilever(kind, n):
    """1 × 0.1 × 0.1 m, n elements high, held at x = 0; the force at its end is shared by all nodes there."""
    mesh = body(kind, (10 * n, n, n), lambda u, v, w: (0.1 * u / n, 0.1 * v / n, 0.1 * w / n))
    mesh = held(mesh, mesh.position[:, 0] < 1e-9)
    end = np.flatnonzero(mesh.position[:, 0] > 1 - 1e-9)
    force = np.zeros((len(mesh.position), 3))
    force[end, 2] = 1000 / len(end)
    return mesh, moved(mesh, force), end


@pytest.mark.parametrize(("kind", "n"), [("hex8", 2), ("tet10", 1)])
def test_a_beam_at_mid_span_is_no_hot_spot(kind, n):
    mesh, field, end = cantilever(kind, n)
    own = found(mesh, field, gauges_at(mesh, [(0.45, 0.05, 0.1), (0.55, 0.0, 0.1)], (0, 0, 1), (1, 0, 0)), end)
    assert np.abs(own.refined).max() < SHARE
    assert np.abs(own.spread).max() < 1e-3


@pytest.mark.parametrize("kind", ["hex8", pytest.param("tet10", marks=pytest.mark.slow)])
def test_uniform_traction_keeps_uniform_strain(kind):
    """Patch test: u = σ/E (−νx, −νy, z), by a traction on its top; forces at nodes of parts would be another load."""
    size = np.array([0.3, 0.2, 0.1])
    mesh = body(kind, (3, 2, 2), lambda u, v, w: size * (u / 3, v / 2, w / 2))
    x, y, z = mesh.position.T
    mesh, top = held(mesh, z < 1e-9), np.flatnonzero(z > 0.1 - 1e-9)
    field = 1e-3 * np.column_stack([-NU * x, -NU * y, z]).reshape(-1, 1)
    on_top = gauges_at(mesh, [(0.15, 0.06, 0.1)], (0, 0, 1), (1, 0, 0))
    beside = gauges_at(mesh, [(0.3, 0.16, 0.09)], (1, 0, 0), (0, 0, 1))
    for gauges in (on_top, beside):
        own = found(mesh, field, gauges, top, top)
        assert np.abs(own.refined).max() < 1e-10
        assert np.abs(own.spread).max() < 1e-10
    assert np.abs(found(mesh, field, on_top, top).refined).max() > SHARE


@pytest.mark.parametrize("kind", ["hex8", pytest.param("tet10", marks=pytest.mark.slow)])
def test_exactly_represented_field_does_not_change(kind):
    rng = np.random.default_rng(3)
    shift = {}

    def chart(u, v, w):
        inside = 0 < u < 2 and 0 < v < 2 and 0 < w < 2 and float(u).is_integer()
        free = inside and kind in ("hex8", "tet4", "wedge6")
        return np.array([u, v, w]) + shift.setdefault((u, v, w), rng.uniform(-0.1, 0.1, 3) if free else np.zeros(3))

    mesh = body(kind, (2, 2, 2), chart)
    field = (mesh.position @ np.array([[1.0, 0.3, 0.2], [0.1, -0.4, 0.5], [0.2, 0.7, 0.6]]) * 1e-3).reshape(-1, 1)
    facets = exterior_facets(mesh)
    surface = np.zeros(len(mesh.position), dtype=bool)
    surface[facets.nodes[facets.nodes >= 0]] = True
    gauges = candidates(mesh, facets, None)
    own = found(held(mesh, surface), field, gauges.take(np.arange(0, len(gauges), len(gauges) // 3)))
    assert np.abs(own.refined).max() < 1e-9


def bracket(kind, n, thick=1):
    """An L of 0.2 × 0.2 m without its quarter x > 0, y < 0, held below and pushed up at its right end; n elements in 0.1 m."""
    size = 0.1 / n
    mesh = body(
        kind,
        (2 * n, 2 * n, thick),
        lambda u, v, w: (size * (u - n), size * (v - n), size * w),
        keep=lambda i, j, k: i < n or j >= n,
    )
    mesh = held(mesh, mesh.position[:, 1] < -0.1 + 1e-9)
    right = mesh.position[:, 0] > 0.1 - 1e-9
    force = np.zeros((len(mesh.position), 3))
    force[right, 1] = 1000 / np.count_nonzero(right)
    return mesh, moved(mesh, force)


@pytest.mark.parametrize(("kind", "sizes"), [("hex8", (4, 8)), pytest.param("hex20", (4, 8), marks=pytest.mark.slow)])
def test_a_reentrant_corner_is_a_hot_spot_however_fine_the_mesh(kind, sizes):
    """Strain grows as r^−0.4555 (Williams 1952): beside it on every mesh, half the leg away on none."""
    beside, away = [], []
    for n in sizes:
        mesh, field = bracket(kind, n)
        own = found(mesh, field, gauges_at(mesh, [(0, -0.05 / n, 0), (0, -0.06, 0)], (1, 0, 0), (0, 1, 0))).change
        beside.append(abs(own[0]))
        away.append(abs(own[1]))
    assert min(beside) > SHARE
    assert beside[-1] > 0.9 * beside[0]
    assert max(away[1:]) < SHARE


def slope(mesh, field, place, axis, size):
    """Strain along an axis at a node between two elements, the mean of what they have there, by differences of displacements."""
    u, axis = field.reshape(-1, 3), np.array(axis, dtype=float)

    def at(steps):
        apart = np.linalg.norm(mesh.position - (place + steps * size * axis), axis=1)
        assert apart.min() < 1e-9
        return u[int(np.argmin(apart))] @ axis

    if mesh.blocks[0].kind == "hex8":
        return (at(1) - at(-1)) / (2 * size)
    return (4 * (at(0.5) - at(-0.5)) - (at(1) - at(-1))) / (2 * size)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "n"), [("hex8", 4), ("hex20", 4)])
def test_submodel_change_predicts_global_refinement(kind, n):
    """Whole meshes of half and a quarter of the size: signs, and the change that decides within a factor of two."""
    mesh, field = bracket(kind, n)
    own = gauges_at(mesh, [(0, -0.05 / n, 0)], (1, 0, 0), (0, 1, 0))
    expected = found(mesh, field, own)
    real = []
    before = channel_rows(mesh.position, own, field)[0, 0]
    for times in (2, 4):
        finer, moves = bracket(kind, n * times, times)
        real.append(slope(finer, moves, own.position[0], (0, 1, 0), 0.1 / n / times) / before - 1)
    np.testing.assert_array_equal(np.sign(expected.refined[0]), np.sign(real))
    assert 0.5 < expected.change[0] / real[int(np.argmax(np.abs(expected.refined[0])))] < 2


def loaded_block(kind, n):
    """A block of 0.2 × 0.2 × 0.1 m with a force on the node in the middle of its top."""
    size = 0.1 / n
    mesh = body(kind, (2 * n, 2 * n, n), lambda u, v, w: (size * (u - n), size * (v - n), size * w))
    mesh = held(mesh, mesh.position[:, 2] < 1e-9)
    node = int(np.argmin(np.linalg.norm(mesh.position - [0, 0, 0.1], axis=1)))
    force = np.zeros((len(mesh.position), 3))
    force[node, 2] = -1000
    return mesh, moved(mesh, force), node


@pytest.mark.parametrize(("kind", "n"), [("hex8", 4), pytest.param("tet10", 4, marks=pytest.mark.slow)])
def test_nodal_load_makes_a_local_hot_spot(kind, n):
    """Saint-Venant: 0.4 and 1.2 elements away it matters how the force is spread, five elements away it does not."""
    mesh, field, node = loaded_block(kind, n)
    size = 0.1 / n
    places = [(0.5 * size, 0.5 * size, 0.1), (1.5 * size, 0.5 * size, 0.1), ((n - 0.5) * size, 0.5 * size, 0.1)]
    own = found(mesh, field, gauges_at(mesh, places, (0, 0, 1), (1, 0, 0)), [node])
    assert abs(own.spread[0]) > SHARE
    assert abs(own.change[0]) > SHARE
    assert np.maximum(np.abs(own.spread), np.abs(own.change))[1] > SHARE
    assert abs(own.spread[2]) < 1e-3


def plate(n):
    """A quarter of a plate of 0.1 × 0.1 × 0.01 m with a hole of 10 mm radius, n elements about the quarter of the hole and as
    many outwards, pulled along x at x = 0.1 m; held in thickness on one side alone."""
    count, radius, half = n, 0.01, 0.1

    def chart(u, v, w):
        angle, out = (
            0.5 * np.pi * (1 - u / count),
            np.interp(v, np.arange(count + 1), (np.arange(count + 1) / count) ** 2),
        )
        way = np.array([np.cos(angle), np.sin(angle)])
        outer = half * way / np.abs(way).max()
        return *((1 - out) * radius * way + out * outer), 0.01 * w / 1

    mesh = body("hex20", (count, count, 1), chart)
    x, y, _ = mesh.position.T
    for axis, where in ((0, x < 1e-9), (1, y < 1e-9), (2, mesh.position[:, 2] < 1e-9)):
        mesh = held(mesh, where, (axis,))
    facets = exterior_facets(mesh)
    force = np.zeros((len(mesh.position), 3))
    weight = np.array([-1 / 12] * 4 + [1 / 3] * 4)  # a uniform traction on a rectangle of eight nodes
    for nodes in facets.nodes:
        if np.all(x[nodes] > half - 1e-9):
            force[nodes, 0] += 1e8 * np.ptp(y[nodes]) * 0.01 * weight
    return mesh, moved(mesh, force), np.flatnonzero(force[:, 0])


def test_the_side_of_a_hole_is_a_hot_spot_on_a_coarse_mesh_and_none_on_a_fine_one():
    """Kirsch: on the bore at 90° to the load three times the strain far away, hardly less in a plate of ten radii."""
    changes = []
    for n in (2, 12):
        mesh, field, end = plate(n)
        own = gauges_at(mesh, [(0.0, 0.01, 0.005)], (0, -1, 0), (1, 0, 0), within=40.0)
        changes.append(found(mesh, field, own, end).change[0])
        angle = np.arctan2(own.position[0, 1], own.position[0, 0])
        strain = channel_rows(mesh.position, own, field)[0, 0]
    assert abs(changes[0]) > SHARE
    assert abs(changes[-1]) < 0.5 * SHARE
    assert strain == pytest.approx(1e8 / E * (1 - 2 * np.cos(2 * angle)), rel=0.05)


L, W, H = 1.0, 0.3, 0.2
TOP = np.array([0.0, 0.0, 1.0])


def on_top(mesh, points, directions):
    """Dimensions of points on the facet of the top below the first of them: every facet of a face has the same edges."""
    facets = exterior_facets(mesh)
    corners = mesh.position[facets.nodes[:, :4]]
    top = np.flatnonzero(np.all(corners[..., 2] == H, axis=1))[0]
    points, directions = np.array(points, dtype=float), np.array(directions, dtype=float)
    return edge_dimensions(
        mesh.position, facets, np.full(len(points), facets.key[top]), points, directions, np.tile(TOP, (len(points), 1))
    )


def test_edge_dimensions_of_a_box(box_mesh):
    rng = np.random.default_rng(1)
    xy = rng.uniform(0.05, 0.95, (40, 2)) * [L, W]
    found = on_top(box_mesh, np.column_stack([xy, np.full(40, H)]), np.tile([1.0, 0, 0], (40, 1)))
    sides = np.minimum(xy, np.array([L, W]) - xy)
    np.testing.assert_allclose(found.distance, np.sort(sides, axis=1), rtol=1e-12)
    nearest = np.argmin(sides, axis=1)
    # The side that bounds x runs along y, at 90° to a gauge along x.
    np.testing.assert_allclose(found.angle[:, 0], np.where(nearest == 0, 90.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(found.angle[:, 1], np.where(nearest == 0, 0.0, 90.0), atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(found.foot - np.column_stack([xy, np.full(40, H)])[:, None], axis=2), found.distance, rtol=1e-12
    )


@pytest.mark.parametrize("turn", [-89.0, -30.0, 0.0, 17.0, 90.0])
def test_the_angle_is_counter_clockwise_as_seen_from_outside(box_mesh, turn):
    d = [np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn)), 0.0]
    found = on_top(box_mesh, [[0.5, 0.02, H], [0.5, W - 0.02, H]], [d, d])
    np.testing.assert_allclose(found.angle[:, 0], turn, atol=1e-9)
    back = on_top(box_mesh, [[0.5, 0.02, H]], [-np.array(d)])
    assert back.angle[0, 0] == pytest.approx(found.angle[0, 0], abs=1e-9)
    assert angle_from(np.array([-1.0, 0, 0]), np.array(d), TOP) == pytest.approx(turn, abs=1e-9)


def test_a_direction_along_the_normal_has_distances_and_no_angle(box_mesh):
    found = on_top(box_mesh, [[0.5, 0.02, H]] * 3, [TOP, -TOP, [0.5, 0.5, 2**-0.5]])
    assert np.isfinite(found.distance).all()
    assert np.isnan(found.angle[:2]).all()
    np.testing.assert_allclose(found.angle[2], [45.0, -45.0], atol=1e-9)


def test_edges_of_other_faces_are_ignored(box_mesh):
    thin = box_mesh.position * [1, 1, 1e-3]
    facets = exterior_facets(box_mesh)
    own = np.all(box_mesh.position[facets.nodes[:, :4]][..., 2] == H, axis=1)
    found = edge_dimensions(
        thin,
        facets,
        facets.key[own][:1],
        np.array([[0.5, 0.1, 0.0]]),  # as if pressed through to the other side
        np.array([[1.0, 0, 0]]),
        TOP[None],
    )
    np.testing.assert_allclose(found.foot[0, 0], [0.5, 0.0, 1e-3 * H], atol=1e-12)


@pytest.mark.parametrize("kind", ["quad4", "quad8", "tri3", "tri6"])
def test_a_tube_has_the_rims_at_its_ends_and_no_edge_across(kind):
    position, facets = tube(kind, 24, 5, 2.0)
    place, normal = np.array([[2.0, 0.0, 1.3]]), np.array([[1.0, 0.0, 0.0]])
    found = edge_dimensions(position, facets, facets.key[:1], place, np.array([[0.0, 0.0, 1.0]]), normal)
    assert found.distance[0, 0] == pytest.approx(1.3, rel=1e-6)
    assert abs(found.angle[0, 0]) == pytest.approx(90.0, abs=1e-6)
    assert np.isnan(found.distance[0, 1])


@pytest.mark.parametrize(("half", "there"), [(50.0, True), (70.0, False)])
def test_edge_across_a_curved_face_is_ignored(half, there):
    step = np.deg2rad(half) / 10
    chart = lambda u, v: (2 * np.cos(step * (u - 10)), 2 * np.sin(step * (u - 10)), v)  # noqa: E731
    position, facets = surface("quad8", 20, 8, chart)
    place, along = np.array([[2.0, 0.0, 0.5]]), np.array([[0.0, 1.0, 0.0]])
    found = edge_dimensions(position, facets, facets.key[:1], place, along, np.array([[1.0, 0.0, 0.0]]))
    assert found.distance[0, 0] == pytest.approx(0.5)
    if there:
        assert found.distance[0, 1] == pytest.approx(4 * np.sin(np.deg2rad(half / 2)), rel=1e-6)
    else:
        assert np.isnan(found.distance[0, 1])

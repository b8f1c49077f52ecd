"""Grids of gauges over facets, and gauges bonded at the nearest point of a surface."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import fsolve

from strainsight.errors import InfeasibleError, UserError
from strainsight.mesh.facets import Facets, by_kind, exterior_facets
from strainsight.mesh.kinds import FACETS
from strainsight.sensors.bonded import BondedEntry, bonded
from strainsight.sensors.candidates import Candidates, candidates
from strainsight.sensors.strain_operator import channel_matrix, channel_rows, fits
from strainsight.sensors.surface_paths import locate, project, skin_of

from ..refusals import expect_refusal
from .conftest import KINDS, bare, plate, tube


def long(gauges: Candidates, length) -> Candidates:
    return replace(gauges, length=np.broadcast_to(np.asarray(length, dtype=float), len(gauges)).copy())


def displacement_at(position, facets, z, point) -> np.ndarray:
    """z at a point of a plate, by the facet whose shape functions reach it: brute force over all facets."""
    for kind, _, nodes in by_kind(facets.kind, facets.nodes):
        for own in nodes:
            x = position[own]
            if np.linalg.norm(x.mean(axis=0) - point) > 1.2:
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                xi = fsolve(lambda xi, x=x, N=kind.shape: (N(xi)[0] @ x - point)[:2], kind.centre, xtol=1e-13)
            miss = np.abs(kind.shape(xi)[0] @ x - point).max()
            inside = min(xi.min(), 1 - xi.sum()) if kind.corners == 3 else 1 - np.abs(xi).max()
            if miss < 1e-9 and inside > -1e-7:
                return kind.shape(xi)[0] @ z[own]
    raise AssertionError(point)


def waves(x: np.ndarray) -> np.ndarray:
    """A field of half a wavelength in about four cells, its slopes up to about 1."""
    return np.column_stack([np.sin(0.8 * x[:, 0] + 0.3 * x[:, 1]), np.cos(0.7 * x[:, 1]), x[:, 0] * x[:, 1] / 10])


@pytest.mark.parametrize(
    ("kind", "shake"), [("tri3", 0.2), pytest.param("tri6", 0.2, marks=pytest.mark.slow), ("quad8", 0.2)]
)
def test_on_a_plate_the_mean_strain_is_the_stretch_of_the_grid_over_its_length(kind, shake):
    """∫ d·(∂z/∂s) ds = d·(z(end) − z(begin)) whatever the field; through corners of cells (45°) and along their edges, too."""
    position, facets = plate(kind, 7, 5, shake)
    rough = shake == 0 or kind == "tri3"
    z = np.random.default_rng(1).standard_normal(position.shape) if rough else waves(position)
    gauges = candidates(bare(position), facets, (1, 0, 0), (0.0, 45.0, 72.0))
    for length in (0.1, 1.0, 3.3):
        wide = long(gauges, length)
        ok = np.flatnonzero(fits(position, wide, facets))
        assert len(ok) > 10
        own = wide.take(ok[:: max(1, len(ok) // 6)])
        rows = channel_rows(position, own, z.reshape(-1, 1), facets=facets)[:, 0]
        for i in range(len(own)):
            ends = [
                displacement_at(position, facets, z, own.position[i] + s * length / 2 * own.direction[i])
                for s in (1, -1)
            ]
            stretch = own.direction[i] @ (ends[0] - ends[1])
            # Two Gauss points a facet are exact for the polynomials of straight facets, not for the quotients of bent ones.
            assert rows[i] == pytest.approx(stretch / length, abs=1e-9 if rough else 1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_grid_fits_where_its_ends_are_on_the_plate(kind):
    position, facets = plate(kind, 6, 4, 0.2)
    gauges = long(candidates(bare(position), facets, (1, 0, 0), (0.0, 30.0, 90.0)), 1.7)
    ends = gauges.position[:, None] + np.array([0.85, -0.85])[:, None] * gauges.direction[:, None]
    on = np.all((ends[..., :2] >= 0) & (ends[..., :2] <= [6, 4]), axis=(1, 2))
    assert 0 < np.count_nonzero(on) < len(on)
    np.testing.assert_array_equal(fits(position, gauges, facets), on)
    with pytest.raises(
        InfeasibleError, match=rf"{np.count_nonzero(~on)} of {len(on)} channels have a measuring grid that crosses a sharp edge"
    ) as e:
        channel_rows(position, gauges, np.zeros((3 * len(position), 1)), facets=facets)
    assert "near_edges: 0.85" in e.value.remedy


def test_the_grids_of_a_rosette_fit_together_or_not_at_all():
    position, facets = plate("quad8", 5, 3)
    gauges = candidates(bare(position), facets, (1, 0, 0), (0.0, 45.0, 90.0), rosette=True, length=2.0)
    one = fits(position, replace(gauges, gauge=np.arange(len(gauges))), facets).reshape(-1, 3)
    np.testing.assert_array_equal(fits(position, gauges, facets), np.repeat(one.all(axis=1), 3))
    assert 0 < one.all(axis=1).sum() < one.any(axis=1).sum()


@pytest.mark.parametrize("kind", ["quad8", pytest.param("tri6", marks=pytest.mark.slow)])
def test_round_a_tube_a_grid_reads_the_hoop_strain_and_half_of_it_askew(kind):
    """z = r̂ strains 1/R round the tube and nothing along it: sin²α/R at the angle α from the axis, all along the grid."""
    R = 2.0
    position, facets = tube(kind, 32, 6, R, 0.1)
    gauges = candidates(bare(position), facets, (0, 0, 1), (0.0, 30.0, 90.0))
    gauges = gauges.take(np.flatnonzero(np.abs(gauges.position[:, 2] - 3) < 1.6))
    radial = position * [1, 1, 0] / R
    expected = np.sin(np.deg2rad(gauges.angle)) ** 2 / R
    for length in (0.1, 0.6):
        rows = channel_rows(position, long(gauges, length), radial.reshape(-1, 1), facets=facets)[:, 0]
        np.testing.assert_allclose(rows, expected, atol=0.015 / R)


def test_a_grid_does_not_climb_over_a_sharp_edge_and_not_far_round_a_smooth_one():
    """Edges of 45° and 22.5°: over the latter a grid runs to the second side, and ends where the third (67.5°) begins."""
    for sides, over in ((8, 0), (16, 2)):
        position, facets = tube("quad4", sides, 3, 1.0)
        step = 2 * np.pi / sides
        reach = np.sin(step / 2 + over * step)
        gauges = candidates(bare(position), facets, (0, 0, 1), (90.0,))
        assert fits(position, long(gauges, 2 * 0.999 * reach), facets).all()
        assert not fits(position, long(gauges, 2 * 1.001 * reach), facets).any()


def test_a_rigid_motion_strains_no_grid():
    position, facets = tube("quad8", 12, 4, 1.0, 0.1)
    gauges = long(candidates(bare(position), facets, (0, 0, 1), (0.0, 50.0)), 0.5)
    gauges = gauges.take(np.flatnonzero(fits(position, gauges, facets)))
    shift, spin = np.random.default_rng(0).standard_normal((2, 3))
    z = np.stack([np.tile(shift, (len(position), 1)), np.cross(spin, position)], axis=-1)
    np.testing.assert_allclose(channel_rows(position, gauges, z.reshape(-1, 2), facets=facets), 0.0, atol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_units_of_length_do_not_matter(scale):
    position, facets = tube("tri6", 10, 3, 1.0, 0.1)
    z = np.random.default_rng(4).standard_normal((3 * len(position), 2))
    gauges = long(candidates(bare(position), facets, (0, 0, 1), (0.0, 40.0)), 0.8)
    large = long(candidates(bare(scale * position), facets, (0, 0, 1), (0.0, 40.0)), 0.8 * scale)
    ok = fits(position, gauges, facets)
    np.testing.assert_array_equal(fits(scale * position, large, facets), ok)
    at = np.flatnonzero(ok)
    a, b = channel_matrix(position, gauges.take(at), facets), channel_matrix(scale * position, large.take(at), facets)
    np.testing.assert_allclose(scale * (b @ z), a @ z, rtol=1e-7, atol=1e-9)


FACET_KINDS = {kind.name: kind for kind in FACETS if not len(kind.read_at)}


def sampled(name: str, n: int) -> np.ndarray:
    """A fine lattice of the reference facet, its borders included."""
    line = np.linspace(0, 1, n)
    u, v = (grid.ravel() for grid in np.meshgrid(line, line))
    return np.column_stack([u, v * (1 - u)]) if name.startswith("tri") else 2 * np.column_stack([u, v]) - 1


@pytest.mark.parametrize("name", FACET_KINDS)
def test_on_one_bent_facet_no_sample_is_nearer(name):
    """Points in the facet's plane, above it, beside it, far away; the facet shaken by 10 % of its size in all directions."""
    rng = np.random.default_rng(0)
    kind = FACET_KINDS[name]
    plane = kind.nodes
    corners = np.column_stack([plane, np.zeros(len(plane))]) + 0.1 * rng.uniform(-1, 1, (len(plane), 3))
    points = rng.uniform(-1, 1, (40, 3)) * np.repeat([0.3, 1.0, 2.0, 10.0], 10)[:, None] + corners.mean(axis=0)
    xi, x = project(kind, np.broadcast_to(corners, (40, *corners.shape)), points)
    np.testing.assert_allclose(kind.shape(xi) @ corners, x, atol=1e-13)
    if name.startswith("tri"):
        assert xi.min() >= -1e-15
        assert xi.sum(axis=1).max() <= 1 + 1e-15
    else:
        assert np.abs(xi).max() <= 1
    lattice = kind.shape(sampled(name, 101)) @ corners
    brute = np.linalg.norm(lattice[None] - points[:, None], axis=2).min(axis=1)
    own = np.linalg.norm(x - points, axis=1)
    assert np.all(own <= brute * (1 + 1e-12))
    assert np.all(own >= brute - 0.03)


@pytest.mark.parametrize("kind", FACET_KINDS)
def test_points_on_a_surface_are_found_where_they_are(kind):
    position, facets = tube(kind, 12, 3, 1.5, 0.15)
    skin = skin_of(position, facets)
    rng = np.random.default_rng(0)
    which = rng.integers(0, len(facets.kind), 80)
    xi = rng.uniform(0.02, 0.98, (80, 2))
    xi = np.column_stack([xi[:, 0], xi[:, 1] * (1 - xi[:, 0])]) if kind.startswith("tri") else 2 * xi - 1
    nodes = facets.nodes[which][:, : len(FACET_KINDS[kind].nodes)]
    points = np.einsum("pk,pkc->pc", FACET_KINDS[kind].shape(xi), position[nodes])
    found = locate(skin, points)
    np.testing.assert_allclose(found.distance, 0, atol=1e-12)
    np.testing.assert_allclose(found.point, points, atol=1e-12)
    np.testing.assert_array_equal(found.facet, which)
    np.testing.assert_allclose(found.local, xi, atol=1e-9)


@pytest.mark.parametrize("kind", ["tri3", pytest.param("quad8", marks=pytest.mark.slow)])
def test_locate_agrees_with_projection_on_every_facet(kind):
    position, facets = plate(kind, 6, 2, 0.2)
    position = position * [1, 1, 1] + np.column_stack([np.zeros((len(position), 2)), 0.2 * np.sin(3 * position[:, 0])])
    position[:, 0] = position[:, 0] ** 3 / 10
    points = np.random.default_rng(2).uniform([-2, -2, -2], [24, 4, 2], (16, 3))
    found = locate(skin_of(position, facets), points)
    least = np.full(16, np.inf)
    for nodes in facets.nodes[:, : len(FACET_KINDS[kind].nodes)]:
        _, x = project(FACET_KINDS[kind], np.broadcast_to(position[nodes], (16, len(nodes), 3)), points)
        least = np.minimum(least, np.linalg.norm(x - points, axis=1))
    np.testing.assert_allclose(found.distance, least, rtol=1e-8, atol=1e-10)


def test_a_bonded_gauge_lies_on_the_surface_along_its_direction():
    R = 1.0
    position, facets = tube("quad8", 40, 4, R)
    entries = [
        BondedEntry((1.001, 0.0, 2.1), (0.2, 0.0, 3.0), 0.05),
        BondedEntry((0.0, 0.999, 1.3), (1.0, 0.3, 0.0), 0.0, (0.0, 45.0, 90.0)),
    ]
    pool, distance = bonded(bare(position), facets, entries, 0.005)
    np.testing.assert_allclose(distance, 0.001, atol=1e-5)
    np.testing.assert_array_equal(pool.gauge, [0, 1, 1, 1])
    np.testing.assert_array_equal(pool.angle, [0, 0, 45, 90])
    np.testing.assert_array_equal(pool.length, [0.05, 0, 0, 0])
    assert pool.bonded.all()
    np.testing.assert_allclose(pool.position[:2], [[R, 0, 2.1], [0, R, 1.3]], atol=1e-4)
    expected = [[0, 0, 1], [1, 0, 0], np.array([1, 0, -1]) / np.sqrt(2), [0, 0, -1]]
    np.testing.assert_allclose(pool.direction, expected, atol=2e-3)
    assert np.abs(pool.local).max() > 0.1
    G = np.random.default_rng(0).standard_normal((3, 3))
    rows = channel_rows(position, pool, (position @ G.T).reshape(-1, 1), facets=facets)
    d = pool.direction
    np.testing.assert_allclose(rows[:, 0], np.einsum("mi,ij,mj->m", d, G, d), atol=2e-3)


def test_bonded_gauge_at_candidate_equals_it(box_mesh):
    facets = exterior_facets(box_mesh)
    pool = candidates(box_mesh, facets, (1, 0.2, 0.4), (30.0,))
    entries = [BondedEntry(x + 1e-4 * n, d) for x, n, d in zip(pool.position, pool.normal, pool.direction, strict=True)]
    found, distance = bonded(box_mesh, facets, entries, 1e-3)
    np.testing.assert_allclose(distance, 1e-4, rtol=1e-6)
    for name in ("element", "facet", "nodes"):
        np.testing.assert_array_equal(getattr(found, name), getattr(pool, name))
    for name in ("position", "direction", "normal", "local"):
        np.testing.assert_allclose(getattr(found, name), getattr(pool, name), atol=1e-12)


GOOD = BondedEntry((0.45, 0.12, 0.2), (1, 0, 0))


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        (replace(GOOD, position=(0.45, 0.12, 0.206)), "gauge 2: the position is 0.006 m from the surface .*, more than 0.005 m"),
        (replace(GOOD, direction=(0.1, 0, 1)), "bonded gauge 2: the direction is at 5.71° to the surface normal"),
        (replace(GOOD, direction=(0, 0, 0)), "bonded gauge 2: the direction .* all are zero"),
        (replace(GOOD, position=(0.45, np.nan, 0.2)), "bonded gauge 2: the position .* is not finite"),
        (
            replace(GOOD, position=(0.45, 0.297, 0.2), direction=(0, 1, 0), length=0.01),
            "bonded gauge 2: the measuring grid of 0.01 m",
        ),
        (
            replace(GOOD, position=(0.45, 0.12, 0.201), direction=(-2, 0, 0)),
            "gauge 2: gauge 1 has the same position and direction",
        ),
    ],
)
def test_invalid_bonded_gauges_are_refused(entry, says, box_mesh):
    with expect_refusal(UserError, says, key="gauges.fixed.1"):
        bonded(box_mesh, exterior_facets(box_mesh), [GOOD, entry], 0.005)


def test_facets_of_several_kinds_lie_side_by_side():
    position = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0.0], [1.5, 0, 0], [1.5, 0.5, 0], [1, 0.5, 0]]
    )
    nodes = np.array([[0, 1, 2, 3, -1, -1, -1, -1], [1, 4, 2, 5, 6, 7, -1, -1]])
    ones = np.ones(2, dtype=int)
    facets = Facets(element_id=np.array([1, 2]), facet=ones, kind=np.array([2, 1]), nodes=nodes, region=ones)
    found = locate(skin_of(position, facets), np.array([[0.4, 0.4, 1.0], [1.3, 0.2, -2.0], [3, 0, 0]]))
    np.testing.assert_array_equal(found.facet, [0, 1, 1])
    np.testing.assert_allclose(found.distance, [1, 2, 1], atol=1e-12)

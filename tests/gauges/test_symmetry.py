"""Mirror images among gauges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.gauges.bonded import BondedEntry, bonded
from strainsight.gauges.candidates import DISPLACEMENT, candidates, concatenate
from strainsight.gauges.given import given_pool
from strainsight.gauges.motion import motion_candidates
from strainsight.gauges.symmetry import mirror_partners
from strainsight.mesh.facets import exterior_facets

MIDDLE = (0.0, 0.15, 0.0)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e4])
def test_on_a_beam_every_gauge_along_it_has_the_one_across(scale, box_mesh):
    mesh = replace(box_mesh, position=scale * box_mesh.position)
    pool = candidates(mesh, exterior_facets(mesh), (1, 0, 0))
    partner = mirror_partners(pool, scale * np.array(MIDDLE), (0, -3, 0))
    expected = pool.position * [1, -1, 1] + [0, 0.3 * scale, 0]
    np.testing.assert_allclose(pool.position[partner], expected, atol=1e-9 * scale)
    own = np.isclose(pool.position[:, 1], 0.15 * scale)
    assert 0 < own.sum() < len(pool)
    np.testing.assert_array_equal(partner == np.arange(len(pool)), own)


def test_oblique_directions_mirror_into_those_of_the_other_sense(box_mesh):
    """On the top, 30° right-handed has its image at −30°; 0° and 90° are their own up to sign."""
    facets = exterior_facets(box_mesh)
    pool = candidates(box_mesh, facets, (1, 0, 0), (0.0, 30.0, -30.0, 90.0))
    partner = mirror_partners(pool, MIDDLE, (0, 1, 0))
    assert np.all(partner >= 0)
    for a, b in ((0, 0), (30, -30), (-30, 30), (90, 90)):
        np.testing.assert_array_equal(pool.angle[partner][pool.angle == a], b)
    odd = candidates(box_mesh, facets, (1, 0, 0), (30.0,))
    np.testing.assert_array_equal(mirror_partners(odd, MIDDLE, (0, 1, 0)), -1)


def test_rosettes_mirror_as_wholes(box_mesh):
    """±45° with 0° is its own image turned over; 0/45/90 is not: its 45° grid has none."""
    facets = exterior_facets(box_mesh)
    even = candidates(box_mesh, facets, (1, 0, 0), (-45.0, 0.0, 45.0), rosette=True)
    partner = mirror_partners(even, MIDDLE, (0, 1, 0))
    np.testing.assert_array_equal(partner[partner], np.arange(even.gauges))
    odd = candidates(box_mesh, facets, (1, 0, 0), (0.0, 45.0, 90.0), rosette=True)
    np.testing.assert_array_equal(mirror_partners(odd, MIDDLE, (0, 1, 0)), -1)
    single = candidates(box_mesh, facets, (1, 0, 0), (0.0,))
    mixed = concatenate([single, even])
    where = mirror_partners(mixed, MIDDLE, (0, 1, 0))
    np.testing.assert_array_equal(where[single.gauges :] - single.gauges, partner)
    assert np.all(where[: single.gauges] < single.gauges)


def test_only_the_like_are_images_of_one_another(box_mesh):
    facets = exterior_facets(box_mesh)
    strain = candidates(box_mesh, facets, (1, 0, 0))
    motion = motion_candidates(box_mesh, facets, DISPLACEMENT, ((1, 0, 0),))
    fixed, _ = bonded(box_mesh, facets, [BondedEntry(strain.position[0], (1, 0, 0))], 1e-3)
    pool = concatenate([fixed, strain, motion])
    partner = mirror_partners(pool, MIDDLE, (0, 1, 0))
    assert partner[0] == -1
    first = pool.first
    there = partner >= 0
    for name in ("quantity", "array", "bonded"):
        value = getattr(pool, name)[first]
        np.testing.assert_array_equal(value[partner[there]], value[there])
    assert there[1:].all()
    longer = replace(strain, length=np.where(strain.position[:, 1] > 0.15, 0.01, 0.0))
    alone = mirror_partners(longer, MIDDLE, (0, 1, 0))
    np.testing.assert_array_equal(alone >= 0, np.isclose(strain.position[:, 1], 0.15))


def test_a_plane_that_is_none_of_the_mesh_pairs_nothing(box_mesh):
    pool = candidates(box_mesh, exterior_facets(box_mesh), (1, 0, 0))
    np.testing.assert_array_equal(mirror_partners(pool, (0, 0.151, 0), (0, 1, 0)), -1)
    half = mirror_partners(pool, (0.3, 0, 0), (1, 0, 0))
    np.testing.assert_array_equal(half >= 0, pool.position[:, 0] < 0.46)
    with pytest.raises(UserError, match="normal"):
        mirror_partners(pool, MIDDLE, (0, 0, 0))


def test_pairs_are_those_of_a_plain_double_loop():
    """Random places and directions, each with its image to 1e-7, and as many without."""
    rng = np.random.default_rng(0)
    n = rng.standard_normal(3)
    n /= np.linalg.norm(n)
    p = rng.standard_normal(3)
    x, d = rng.uniform(-1, 1, (40, 3)), rng.standard_normal((40, 3))
    d /= np.linalg.norm(d, axis=1)[:, None]
    y, e = x - 2 * ((x - p) @ n)[:, None] * n, -(d - 2 * (d @ n)[:, None] * n)
    e[30:] = np.roll(e[30:], 1, axis=0)
    x, d = np.vstack([x, y + 1e-7 * rng.uniform(-1, 1, (40, 3))]), np.vstack([d, e])
    order = rng.permutation(80)
    x, d = x[order], d[order]
    partner = mirror_partners(given_pool(np.arange(80), x, d), p, 2 * n)
    expected = np.full(80, -1)
    for i in range(80):
        for j in range(80):
            near = np.linalg.norm(x[i] - 2 * ((x[i] - p) @ n) * n - x[j]) < 1e-5
            if near and abs(abs((d[i] - 2 * (d[i] @ n) * n) @ d[j]) - 1) < 1e-9:
                expected[i] = j
    np.testing.assert_array_equal(partner, expected)
    assert np.count_nonzero(partner >= 0) == 60

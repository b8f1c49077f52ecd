"""How tightly a surface bends: tubes, a sphere, a plane, and what is an edge."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.gauges.curvature import bend_radius, sides, tight
from strainsight.gauges.surface import facet_centres

from .conftest import KINDS, surface

R = 3.0


@pytest.mark.parametrize("kind", KINDS)
def test_a_tube_bends_by_its_radius(tube, kind):
    """Of any mesh: 1/R is the curvature around, and 0 that along. The mean of normals at a node is radial by symmetry."""
    position, facets = tube(kind, 24, 4, R)
    np.testing.assert_allclose(bend_radius(position, facets), R, rtol=0.005)


@pytest.mark.parametrize(("kind", "within"), [("tri3", 1.4), ("quad4", 1.25), ("tri6", 1.07), ("quad8", 1.07)])
def test_of_a_shaken_mesh_it_is_found_within_a_share(tube, kind, within):
    position, facets = tube(kind, 24, 6, R, shake=0.15)
    found = bend_radius(position, facets) / R
    assert 1 / within < found.min() < found.max() < within
    assert np.median(found) == pytest.approx(1, rel=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_a_plane_does_not_bend(plate, kind):
    position, facets = plate(kind, 4, 3, shake=0.2)
    assert np.isinf(bend_radius(position, facets)).all()


def test_a_sphere_bends_by_its_radius_in_every_direction():
    """A belt of 60° around it; at its ends half of what it bends along is seen."""
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
    """A roof of cells of 1 m: its ridge is seen from the cells beside it, and from no other."""
    slope = np.deg2rad(fold / 2)
    position, facets = surface("quad4", 6, 2, lambda u, v: (u * np.cos(slope), v, -abs(u - 3) * np.sin(slope)))
    centre, _ = facet_centres(position, facets.kind, facets.nodes)
    beside = np.abs(centre[:, 0] / np.cos(slope) - 3) < 1
    found = bend_radius(position, facets)
    np.testing.assert_array_equal(np.isfinite(found), beside & bends)
    if bends:  # half the fold over a cell
        np.testing.assert_allclose(found[beside], 0.5 / np.sin(slope / 2), rtol=0.01)


def test_what_is_tighter_than_a_radius_is_that_and_its_sides_lie_on_it(tube):
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

"""What a draughtsman would draw of a box and of a tube."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.gauges.outline import edge_lines, seen_from
from strainsight.mesh.facets import exterior_facets

SIZE = np.array([1.0, 0.3, 0.2])


def length(segments):
    return np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [1, -1])
def test_of_a_box_the_far_face_is_behind(box_mesh, axis, side):
    """Twelve edges: the four of the far face behind, the other eight in view."""
    lines = edge_lines(box_mesh.position, exterior_facets(box_mesh))
    toward = side * np.eye(3)[axis]
    seen, hidden = seen_from(lines, toward)
    rest = np.delete(SIZE, axis)
    assert length(hidden) == pytest.approx(2 * rest.sum())
    assert length(seen) == pytest.approx(2 * rest.sum() + 4 * SIZE[axis])
    far = 0.0 if side > 0 else SIZE[axis]
    np.testing.assert_allclose(hidden[..., axis], far, atol=1e-12)


def test_from_aslant_three_edges_of_a_box_are_behind(box_mesh):
    """Those that meet in the corner farthest away."""
    lines = edge_lines(box_mesh.position, exterior_facets(box_mesh))
    seen, hidden = seen_from(lines, np.array([1.0, 2.0, 3.0]))
    assert length(hidden) == pytest.approx(SIZE.sum())
    assert np.sum(~hidden.reshape(-1, 3).any(axis=1)) == 3
    assert length(seen) == pytest.approx(3 * SIZE.sum())


@pytest.mark.parametrize("kind", ["quad4", "quad8", "tri6"])
def test_a_tube_seen_across_is_bounded_where_its_skin_turns_away(tube, kind):
    """At y = ±r, as far as an edge of the mesh lies there, and by its rims at both ends."""
    radius, along, around = 2.0, 5, 48
    lines = edge_lines(*tube(kind, around, along, radius))
    seen, _ = seen_from(lines, np.array([1.0, 0.0, 0.0]))
    straight = seen[np.abs(seen[:, 0, 2] - seen[:, 1, 2]) > 1e-9]
    # of triangles the diagonals, too, where the skin turns between two of one cell
    assert np.abs(straight[..., 1]).min() > radius * np.cos(2 * np.pi / around) - 1e-9
    np.testing.assert_allclose(length(straight), 2 * along, rtol=0.05)
    rims = seen[np.abs(seen[:, 0, 2] - seen[:, 1, 2]) < 1e-9]
    assert set(np.round(rims[..., 2].ravel(), 9)) >= {0.0, float(along)}

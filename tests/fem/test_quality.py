"""Shape of elements against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.fem.quality import element_quality
from strainsight.mesh.kinds import ELEMENTS

from ..solids import REGULAR, SOLIDS

KINDS = tuple(kind.name for kind in ELEMENTS)


def regular(kind: str) -> np.ndarray:
    return np.array(REGULAR[SOLIDS[kind].corners], dtype=float)


@pytest.fixture
def one(mesh_of, midsides):
    """An element of straight sides on these corners."""

    def element(kind: str, corners: np.ndarray):
        cells = np.arange(len(corners))[None]
        if SOLIDS[kind].edges:
            corners, cells = midsides(corners, cells, kind)
        return mesh_of(corners, [(kind, cells, 1)])

    return element


@pytest.mark.parametrize("kind", KINDS)
def test_a_regular_element_has_shape_one_whatever_its_size_and_place(kind, one):
    rotation = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    corners = 1e-3 * regular(kind) @ rotation.T + 7.0
    (quality,) = element_quality(one(kind, corners))
    assert quality.shape[0] == pytest.approx(1.0, abs=1e-10)
    assert quality.curvature[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_mirrored_element_has_the_negative_shape(kind, one):
    (quality,) = element_quality(one(kind, regular(kind) * [1, 1, -1]))
    assert quality.shape[0] == pytest.approx(-1.0, abs=1e-12)


@pytest.mark.parametrize("kind", ELEMENTS, ids=lambda kind: kind.name)
def test_every_corner_has_its_sides_along_edges_of_facets(kind):
    along = {frozenset(pair) for facet, local in kind.facets for pair in _ring(local[: facet.corners])}
    assert {frozenset((corner, other)) for corner, *others in kind.sides for other in others} == along
    assert all(len(set(sides)) == 4 for sides in kind.sides)


def _ring(corners):
    return zip(corners, (*corners[1:], corners[0]), strict=True)


@pytest.mark.parametrize("angle", [30.0, 60.0, 85.0])
def test_a_sheared_cube_has_the_sine_of_its_angle(angle, one):
    corners = regular("hex8")
    corners[:, 0] += corners[:, 2] / np.tan(np.radians(angle))
    (quality,) = element_quality(one("hex8", corners))
    assert quality.shape[0] == pytest.approx(np.sin(np.radians(angle)), rel=1e-12)


@pytest.mark.parametrize("height", [1e-3, 1.0, 50.0])
def test_a_corner_of_three_right_angles_has_the_shape_of_its_worst_corner(height, one):
    """Corners (0, a, b, h): |J| = a b h; the products of the sides that meet at each corner by hand."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, height]], float)
    slant, top = 2**0.5, (1 + height**2) ** 0.5
    least = min(height / height, height / (1 * slant * top), height / (height * top * top)) * 2**0.5
    (quality,) = element_quality(one("tet4", corners))
    assert quality.shape[0] == pytest.approx(least, rel=1e-10)


def test_a_mid_side_node_off_the_middle_shows_in_the_curvature(one):
    mesh = one("tet10", regular("tet10"))
    mesh.position[4] += 0.2 * (mesh.position[1] - mesh.position[0])
    (quality,) = element_quality(mesh)
    assert quality.shape[0] == pytest.approx(1.0)
    assert quality.curvature[0] < 0.8

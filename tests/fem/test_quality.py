"""Quality measures of elements, and lumped masses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.config.mesh import MeshFile
from strainsight.errors import ConfigError
from strainsight.experiment.structure.mesh import mesh_of
from strainsight.fem.assembly import assemble
from strainsight.fem.checks import element_quality
from strainsight.fem.mass import mass_properties
from strainsight.mesh.kinds import ELEMENTS
from strainsight.records.mesh import MeshColumns

from ..edges.beam import bricks
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


LUMPED = {"tet4": (1 / 4, 0), "tet10": (1 / 36, 4 / 27), "hex8": (1 / 8, 0), "hex20": (7 / 248, 16 / 248)}
"""Share of a corner and of a middle of a side (HRZ: Zienkiewicz and Taylor, appendix on lumped mass)."""


@pytest.mark.parametrize("kind", LUMPED)
def test_lumped_masses_are_those_that_are_published(kind, one):
    consistent = one(kind, regular(kind))
    lumped = replace(consistent, lumped=True)
    (mass, centre), (expected, middle) = mass_properties(lumped), mass_properties(consistent)
    assert mass == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(centre, middle, atol=1e-12)
    M = assemble(lumped)[1].constant.toarray()
    np.testing.assert_allclose(M, np.diag(np.diag(M)), atol=1e-12 * M.max())
    share = np.repeat(LUMPED[kind], [len(regular(kind)), len(SOLIDS[kind].edges)])
    np.testing.assert_allclose(np.diag(M), np.repeat(mass * share, 3), rtol=1e-12)


def deck(path, more):
    path.write_text(bricks((1, 1, 1)).replace("ENDDATA", f"{more}\nENDDATA"))
    return path


@pytest.mark.parametrize(
    ("value", "choice", "by"),
    [("-1", None, "PARAM,COUPMASS"), ("-1", "consistent", ""), ("1", "lumped", "mesh.mass"), ("1", None, "")],
)
def test_a_note_says_that_mass_is_lumped_and_by_what_and_no_other(tmp_path, value, choice, by):
    path = deck(tmp_path / "a.bdf", f"PARAM,COUPMASS,{value}")
    mesh = mesh_of(MeshFile(file="a.bdf", mass=choice), path)
    said = [note for note in mesh.notes if "lumped" in note]
    assert [note.partition(":")[0] for note in said] == ([f"the mass matrix of solids is lumped ({by})"] if by else [])
    assert mesh.lumped == MeshColumns.of(mesh).restore().lumped == bool(by)


def test_shells_are_not_lumped(tmp_path):
    path = deck(tmp_path / "a.bdf", "CTRIA3,99,9,1,2,3\nPSHELL,9,1,.1,1")
    with pytest.raises(ConfigError, match="lumped mass is not supported for shells"):
        mesh_of(MeshFile(file="a.bdf", mass="lumped"), path)

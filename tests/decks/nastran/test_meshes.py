"""The committed cantilever, lug bracket and wing are what their scripts write, and what they are said to be."""

from __future__ import annotations

import gzip
import hashlib
import runpy
from math import acos, hypot, pi, sqrt
from pathlib import Path

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.mesh.sanity import sanity_warnings
from strainsight.mesh.units import to_si

# The committed cantilever is what its script writes, and what it says it is.
MESHES = Path(__file__).parents[3] / "meshes"


@pytest.fixture(scope="module")
def mesh():
    return read_mesh(MESHES / "cantilever.bdf")


def test_the_script_writes_the_committed_decks_byte_for_byte(tmp_path):
    runpy.run_path(str(MESHES / "make_cantilever.py"))["main"](tmp_path)
    for name in ("cantilever.bdf", "cantilever-coarse.bdf", "SHA256SUMS"):
        assert (tmp_path / name).read_bytes() == (MESHES / name).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("part", ["lug", "hinge", "wing"])
def test_the_script_writes_the_committed_deck(tmp_path, part):
    """The packed bytes depend on the version of zlib, what is in them does not."""
    runpy.run_path(str(MESHES / f"make_{part}.py"))["main"](tmp_path)
    written, committed = (gzip.decompress((folder / f"{part}.bdf.gz").read_bytes()) for folder in (tmp_path, MESHES))
    assert written == committed
    for folder in (tmp_path, MESHES):
        digest, name = (folder / f"{part}.sha256").read_text().split()
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_it_is_a_steel_bar_held_at_the_root_with_a_rigid_tip(mesh):
    x = mesh.position
    np.testing.assert_allclose(x.min(axis=0), [0, -0.125, -0.095], atol=1e-15)
    np.testing.assert_allclose(x.max(axis=0), [2, 0.125, 0.095], atol=1e-15)
    assert [(block.kind, len(block.ids)) for block in mesh.blocks] == [("hex20", 640)]
    assert (mesh.materials[1].youngs_modulus, mesh.materials[1].poisson_ratio, mesh.materials[1].density) == (
        2.1e11, 0.3, 7850,
    )
    tip = mesh.node_index(2)
    np.testing.assert_array_equal(x[tip], [2, 0, 0])
    root = np.flatnonzero(x[:, 0] == 0)
    held = {0: root, 1: root[np.abs(x[root, 1]) < 0.04], 2: root[np.abs(x[root, 2]) < 0.03]}
    assert {tuple(pair) for pair in mesh.fixed} == {(node, c) for c, nodes in held.items() for node in nodes}
    (rigid,) = mesh.rigid
    assert rigid.reference == tip
    assert set(rigid.nodes) == set(np.flatnonzero(x[:, 0] == 2)) - {tip}
    assert mesh.ignored == {"EIGRL": 1}
    assert sanity_warnings(mesh) == ()


# The committed lug bracket is what its script writes, and what it says it is.
T, LEG, BOLT, BORE, EYE, CENTRE, FOOT = 12.0, 6.0, 9.0, 15.0, 30.0, 90.0, 50.0
"""Of meshes/README.md [mm]."""
ARM = hypot(FOOT, CENTRE - T - LEG)
TANGENT = sqrt(ARM**2 - EYE**2)
"""From the upper end of the foot to the eye's centre, and along the side to where it touches the eye."""


@pytest.fixture(scope="module")
def lug_mesh():
    return read_mesh(MESHES / "lug.bdf.gz")


def touch():
    """(x, z) where the side touches the eye: the foot of the perpendicular from its centre, Pythagoras in components."""
    to_foot = np.array([FOOT, T + LEG - CENTRE])
    return EYE**2 / ARM**2 * to_foot + EYE * TANGENT / ARM**2 * np.array([-to_foot[1], to_foot[0]]) + (0, CENTRE)


def face_of_upright():
    """Area [mm²] of one face: rectangle, trapezoid and the segment of a circle above it, less the bore."""
    x, z = touch()
    angle = 2 * acos((z - CENTRE) / EYE)
    return 2 * FOOT * LEG + (FOOT + x) * (z - T - LEG) + EYE**2 / 2 * (angle - np.sin(angle)) - pi * BORE**2, angle


@pytest.mark.slow
def test_it_is_a_steel_bracket_clamped_in_its_bolt_holes_and_loaded_in_its_bore(lug_mesh):
    x, y, z = lug_mesh.position.T
    np.testing.assert_allclose(lug_mesh.position.min(axis=0), [-100, -60, 0], atol=1e-12)
    np.testing.assert_allclose(lug_mesh.position.max(axis=0), [100, 60, 120], atol=1e-6)
    assert {block.kind for block in lug_mesh.blocks} == {"hex20", "wedge15"}
    steel = lug_mesh.materials[1]
    assert (steel.youngs_modulus, steel.poisson_ratio, steel.density) == (2.1e5, 0.3, 7.85e-9)
    bolts = (z <= T) & np.isclose(np.hypot(np.abs(x) - 78, np.abs(y) - 36), BOLT, atol=1e-5)
    bore = (z > T) & np.isclose(np.hypot(x, z - CENTRE), BORE, atol=1e-5)
    assert {tuple(pair) for pair in lug_mesh.fixed} == {(n, c) for n in np.flatnonzero(bolts) for c in range(3)}
    (averaging,) = lug_mesh.averaging
    assert averaging.reference == lug_mesh.node_index(2)
    assert set(averaging.nodes) == set(np.flatnonzero(bore))
    np.testing.assert_array_equal(lug_mesh.position[averaging.reference], [0, 0, CENTRE])
    for number, chosen in ((21, bolts), (22, bore)):
        assert set(lug_mesh.node_sets[f"SET1-{number}"]) == set(lug_mesh.node_ids[chosen])
    assert lug_mesh.ignored == {"EIGRL": 1}
    assert sanity_warnings(to_si(lug_mesh, "mm", "t")) == ()


@pytest.mark.slow
def test_its_mass_is_that_of_the_bracket_with_its_holes(lug_mesh):
    """Straight sides between corners would miss a bolt hole by 1.1 %, all of it by 4e-4."""
    plate = (200 * 120 - 4 * pi * BOLT**2) * T
    weld = LEG**2 / 2 * (4 * FOOT + 2 * T)
    mass, centre = mass_properties(lug_mesh)
    assert mass == pytest.approx(7.85e-9 * (plate + face_of_upright()[0] * T + weld), rel=1e-6)
    np.testing.assert_allclose(centre[:2], 0, atol=1e-6)


# meshes/wing.bdf.gz: what its script writes, and what it is.
@pytest.fixture(scope="module")
def wing_mesh():
    return read_mesh(MESHES / "wing.bdf.gz", "mm", "t")


def test_it_weighs_the_sum_of_its_parts(wing_mesh):
    """Area × thickness of the shells, length × section of the stringers, and the store."""
    (quads,), (bars,) = wing_mesh.shells, wing_mesh.beams
    x = wing_mesh.position[quads.nodes]
    area = 0.5 * np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]), axis=1)
    t = np.array([0, 2.5e-3, 3e-3, 2e-3])[quads.region]
    length = np.linalg.norm(np.diff(wing_mesh.position[bars.nodes], axis=1), axis=2).sum()
    # warped quadrangles have the area of their mean plane
    assert mass_properties(wing_mesh)[0] == pytest.approx(2800 * (area @ t + 60e-6 * length) + 5.0, rel=1e-5)


@pytest.mark.slow
def test_its_first_modes_are_those_that_its_readme_states(wing_mesh):
    model = build_model(wing_mesh)
    frequency, _ = modes(model.stiffness.constant, model.mass.constant, 3)
    np.testing.assert_allclose(frequency, [8.16, 23.5, 38.4], rtol=2e-3)

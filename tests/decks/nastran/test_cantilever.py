"""The committed cantilever is what its script writes, and what it says it is."""

from __future__ import annotations

import hashlib
import runpy
from pathlib import Path

import meshio
import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.sanity import sanity_warnings

MESHES = Path(__file__).parents[3] / "meshes"


@pytest.fixture(scope="module")
def mesh():
    return read_mesh(MESHES / "cantilever.bdf")


def test_the_script_writes_the_committed_decks_byte_for_byte(tmp_path):
    runpy.run_path(str(MESHES / "make_cantilever.py"))["main"](tmp_path)
    for name in ("cantilever.bdf", "cantilever-coarse.bdf", "SHA256SUMS"):
        assert (tmp_path / name).read_bytes() == (MESHES / name).read_bytes()


def test_the_checksums_are_those_of_the_decks():
    for line in (MESHES / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split()
        assert hashlib.sha256((MESHES / name).read_bytes()).hexdigest() == digest


def test_it_is_a_steel_bar_held_at_the_root_with_a_rigid_tip(mesh):
    x = mesh.position
    np.testing.assert_allclose(x.min(axis=0), [0, -0.125, -0.095], atol=1e-15)
    np.testing.assert_allclose(x.max(axis=0), [2, 0.125, 0.095], atol=1e-15)
    assert [(block.kind, len(block.ids)) for block in mesh.blocks] == [("hex20", 640)]
    assert (mesh.materials[1].youngs_modulus, mesh.materials[1].poisson_ratio, mesh.materials[1].density) == (
        2.1e11,
        0.3,
        7850,
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


def test_its_surface_is_that_of_the_bar(mesh):
    facets = exterior_facets(mesh)
    assert len(facets.facet) == 2 * (40 * 4 + 40 * 4 + 4 * 4)
    corner = mesh.position[facets.nodes[:, :4]]
    area = np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1]) / 2
    assert np.linalg.norm(area, axis=1).sum() == pytest.approx(2 * (2 * 0.25 + 2 * 0.19 + 0.25 * 0.19))
    assert np.sum(corner.mean(axis=1) * area) / 3 == pytest.approx(2 * 0.25 * 0.19)


def test_meshio_reads_the_same_elements(mesh):
    other = meshio.read(MESHES / "cantilever.bdf", file_format="nastran")
    cells = next(block.data for block in other.cells if block.type == "hexahedron20")
    np.testing.assert_array_equal(other.points[cells], mesh.position[mesh.blocks[0].nodes])

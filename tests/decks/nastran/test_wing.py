"""meshes/wing.bdf.gz: what its script writes, and what it is."""

from __future__ import annotations

import gzip
import hashlib
import runpy

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.fem.shells import shell_axes

from ...shared import ROOT

MESHES = ROOT / "meshes"


@pytest.fixture(scope="module")
def mesh():
    return read_mesh(MESHES / "wing.bdf.gz", "mm", "t")


def test_the_script_writes_the_committed_deck(tmp_path):
    """The packed bytes depend on the version of zlib, what is in them does not."""
    runpy.run_path(str(MESHES / "make_wing.py"))["main"](tmp_path)
    written, committed = (gzip.decompress((folder / "wing.bdf.gz").read_bytes()) for folder in (tmp_path, MESHES))
    assert written == committed
    for folder in (tmp_path, MESHES):
        digest, name = (folder / "wing.sha256").read_text().split()
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_it_is_a_closed_box_of_shells_with_stringers_whose_normals_point_outward(mesh):
    (quads,), (bars,) = mesh.shells, mesh.beams
    assert (quads.kind, len(quads.ids), bars.kind, len(bars.ids)) == ("quad4", 1920, "beam", 192)
    assert not mesh.ignored
    assert not mesh.unsupported
    x = mesh.position[quads.nodes]
    normal = shell_axes(x, quads.ids)[:, :, 2]
    outside = quads.region < 3
    middle = np.column_stack(
        [np.interp(x[:, :, 1].mean(axis=1), [0, 3], [0.225, 0.5125]), x[:, :, 1].mean(axis=1), 0 * normal[:, 0]]
    )
    assert np.all(np.sum(normal * (x.mean(axis=1) - middle), axis=1)[outside] > 0)


def test_it_weighs_the_sum_of_its_parts(mesh):
    """Area × thickness of the shells, length × section of the stringers, and the store."""
    (quads,), (bars,) = mesh.shells, mesh.beams
    x = mesh.position[quads.nodes]
    area = 0.5 * np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]), axis=1)
    t = np.array([0, 2.5e-3, 3e-3, 2e-3])[quads.region]
    length = np.linalg.norm(np.diff(mesh.position[bars.nodes], axis=1), axis=2).sum()
    # warped quadrangles have the area of their mean plane
    assert mass_properties(mesh)[0] == pytest.approx(2800 * (area @ t + 60e-6 * length) + 5.0, rel=1e-5)


def test_its_first_modes_are_those_that_its_readme_states(mesh):
    model = build_model(mesh)
    frequency, _ = modes(model.stiffness.constant, model.mass.constant, 3)
    np.testing.assert_allclose(frequency, [8.16, 23.5, 38.4], rtol=2e-3)

"""The committed meshes are what their scripts write, and the wing weighs and swings as its README states."""

from __future__ import annotations

import gzip
import hashlib
import runpy
from pathlib import Path

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.fem.mass import mass_properties

from ..programs import frequencies

MESHES = Path(__file__).parents[3] / "meshes"


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
    np.testing.assert_allclose(frequencies(wing_mesh, 3), [8.16, 23.5, 38.4], rtol=2e-3)

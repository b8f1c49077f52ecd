"""Placement from modes and static responses of another program: the same layout and σ as from the deck."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from strainsight.config.load import load_config
from strainsight.decks.reader import read_mesh
from strainsight.errors import StrainsightError
from strainsight.records.placed import Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced

from ..frd import calculix, solved, write_frd
from .conftest import ROOT, SHORT, UNSTUDIED, finished, job_of

DECK = ROOT / "meshes" / "cantilever-coarse.bdf"
TIP, MODES = 2, 12
FORCES = [[(TIP, (0.0, 0.0, 1.0))]]
EXACT = ("tolerances.load_angle=0", "tolerances.load_position=0")
"""Of a load that acts beside its place, results have what their own coordinates hold, and a deck all."""
FEW = (*SHORT, *UNSTUDIED, *EXACT, "screen.keep=20", "place.certificate=false")
OF_RESULTS = "mesh.results={file: found.frd, loads: {tip: {step: 1}}}"


@pytest.fixture(scope="module")
def mesh():
    return read_mesh(DECK)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, config, mesh):
    """A config beside its deck, and modes and the response of the tip that SciPy found, in double precision."""
    place = tmp_path_factory.mktemp("beam")
    (place / "beam.yaml").write_text(config.read_text().replace("../meshes/cantilever.bdf", "beam.bdf"))
    shutil.copy(DECK, place / "beam.bdf")
    write_frd(place / "found.frd", mesh, solved(mesh, FORCES, MODES), form=3)
    return place


def placed(folder, name, *overrides, until="place"):
    from ..shared import stages_of

    job = job_of(folder / "beam.yaml", folder / "results", *FEW, *overrides, f"name={name}")
    return {stage: own[2] for stage, own in finished(job, stages_of(job, until)).items()}


@pytest.fixture(scope="module")
def of_deck(folder):
    return placed(folder, "deck")


def sigma(artefacts):
    """Places of the layout [m], σ of E by the criterion, and as it is expected along the run [Pa]."""
    found = read(Placed, artefacts["place"])
    return found.gauge.position, found.std["E"], artefacts["place"].summary


def test_the_layout_and_sigma_of_the_deck(folder, of_deck):
    """The same file of results in double precision; σ to 1e-6, as the residual of the load is exact with the mesh's mass."""
    own = placed(folder, "results", OF_RESULTS)
    a, b = read(Placed, of_deck["place"]), read(Placed, own["place"])
    print({k: v for k, v in of_deck["place"].summary.items()})
    assert np.array_equal(a.gauge.position, b.gauge.position)

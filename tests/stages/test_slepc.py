"""`solver: slepc`: whatever the number of processes, frequencies and gauges are those of PARDISO."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.fem.mpi.programs import LAUNCHER
from strainsight.records.placed import Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced

from ..mpi import needs_slepc, over
from ..shared import slowly, stages_of
from .conftest import ROOT, SHORT, UNSTUDIED, finished, job_of

FEW = (*SHORT, *UNSTUDIED, "screen.keep=20", "place.certificate=false")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, config):
    place = tmp_path_factory.mktemp("slepc")
    (place / "beam.yaml").write_text(config.read_text().replace("../meshes/cantilever.bdf", "beam.bdf"))
    shutil.copy(ROOT / "meshes" / "cantilever-coarse.bdf", place / "beam.bdf")
    return place


def placed(folder, name, *overrides, until="place"):
    """In a results folder of its own: nothing is taken over from another run."""
    job = job_of(folder / "beam.yaml", folder / name, *FEW, *overrides, f"name={name}")
    return {stage: own[2] for stage, own in finished(job, stages_of(job, until)).items()}


@pytest.fixture(scope="module")
def by_pardiso(folder):
    return placed(folder, "pardiso")


@needs_slepc
@pytest.mark.parametrize("processes", [2, *slowly(1, 4)])
def test_the_same_frequencies_and_the_same_gauges(folder, by_pardiso, monkeypatch, processes):
    for name, value in over(processes).items():
        monkeypatch.setenv(name, value)
    own = placed(folder, f"slepc-{processes}", "solver=slepc")
    reduced, known = read(Reduced, own["rom"]), read(Reduced, by_pardiso["rom"])
    assert np.allclose(reduced.frequency, known.frequency, rtol=1e-9, atol=0)
    assert np.allclose(reduced.static, known.static, rtol=0, atol=1e-9 * np.abs(known.static).max())
    layout, there = read(Placed, own["place"]), read(Placed, by_pardiso["place"])
    for part in ("element", "facet", "nodes"):
        assert np.array_equal(getattr(layout.final, part), getattr(there.final, part))
    assert layout.expected_std["E"] == pytest.approx(there.expected_std["E"], rel=1e-6)


def test_a_config_names_no_program(folder, monkeypatch):
    """Launcher and interpreter are the environment's; without them the error has the key and the remedy."""
    monkeypatch.setenv(LAUNCHER, "no-such-mpiexec")
    with pytest.raises(UserError, match="no program no-such-mpiexec") as caught:
        placed(folder, "none", "solver=slepc", until="modes")
    assert caught.value.key == "solver"

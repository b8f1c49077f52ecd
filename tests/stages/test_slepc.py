"""`solver: slepc`: whatever the number of processes, frequencies and gauges are those of PARDISO."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.fem.mpi.programs import LAUNCHER
from strainsight.records.record import read
from strainsight.records.reduced import Reduced

from ..mpi import needs_slepc, over
from .test_results import DECK, placed, project_in, same


@pytest.fixture(scope="module")
def folder(tmp_path_factory, config):
    return project_in(tmp_path_factory.mktemp("slepc"), config, DECK.read_text())


@needs_slepc
@pytest.mark.slow
@pytest.mark.parametrize("processes", [1, 2, 4])
def test_the_same_frequencies_and_the_same_gauges(folder, monkeypatch, processes):
    by_pardiso = placed(folder, "pardiso")
    for name, value in over(processes).items():
        monkeypatch.setenv(name, value)
    own = placed(folder, f"slepc-{processes}", "solver=slepc", results=f"slepc-{processes}")
    same(by_pardiso, own, 1e-6)
    reduced, known = read(Reduced, own["rom"]), read(Reduced, by_pardiso["rom"])
    assert np.allclose(reduced.frequency, known.frequency, rtol=1e-9, atol=0)
    assert np.allclose(reduced.static, known.static, rtol=0, atol=1e-9 * np.abs(known.static).max())


def test_a_config_names_no_program(folder, monkeypatch):
    """Launcher and interpreter are the environment's; without them the error has the key and the remedy."""
    monkeypatch.setenv(LAUNCHER, "no-such-mpiexec")
    with pytest.raises(UserError, match="no program no-such-mpiexec") as caught:
        placed(folder, "none", "solver=slepc", until="modes")
    assert caught.value.key == "solver"

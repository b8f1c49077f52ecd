"""A factor in the processes of MPI: modes against closed forms, whatever their number, and clear words where there is none."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from strainsight.contrib.mpi import session
from strainsight.contrib.mpi.session import LAUNCHER, PYTHON, OverMpi
from strainsight.errors import NumericalError, UserError
from strainsight.fem.modes import modes

from ..mpi import needs_slepc, over
from ..shared import slowly

SIDE = 9


def lattice(n=SIDE):
    """K, M of n³ masses of 2 kg in a cube between walls, units far from 1 N/m, and its frequencies: sums of three of a line's,
    ω² = 4 sin²(kπ/(2n + 2)), most of them three or six times."""
    K = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    own = 4 * np.sin(np.arange(1, n + 1) * np.pi / (2 * n + 2)) ** 2
    one, stiff = sparse.eye_array(n), 1e9
    whole = sum(sparse.kron(sparse.kron(*pair[:2]), pair[2]) for pair in ((K, one, one), (one, K, one), (one, one, K)))
    exact = np.sort((own[:, None, None] + own[None, :, None] + own[None, None, :]).ravel())
    M = sparse.csr_array(2.0 * sparse.eye_array(n**3))
    return sparse.csr_array(stiff * whole), M, np.sqrt(stiff * exact / 2) / (2 * np.pi)


@pytest.fixture
def start(monkeypatch):
    """start(processes): who factorises from now on."""

    def started(processes):
        for name, value in over(processes).items():
            monkeypatch.setenv(name, value)
        return OverMpi()

    return started


@pytest.mark.slow
@needs_slepc
@pytest.mark.parametrize("processes", [1, 2])
def test_modes_and_responses_are_those_of_the_closed_form(start, processes, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    K, M, exact = lattice()
    said = []
    factor = OverMpi(said.append)(K) if start(processes) else None
    frequency, shapes = modes(K, M, 8, factor=factor)
    assert f"in {processes} processes: the factorisation with {SIDE**3} degrees of freedom used" in said[0]
    assert np.allclose(frequency, exact[:8], rtol=1e-11)
    assert np.allclose(shapes.T @ (M @ shapes), np.eye(8), atol=1e-11)
    assert np.allclose(shapes, modes(K, M, 8)[1], atol=1e-9 * np.abs(shapes).max())
    B = np.random.default_rng(3).normal(size=(SIDE**3, 45))
    assert np.allclose(K @ factor.solve(B), B, atol=1e-11)
    assert factor.solve(B[:, 0]).shape == (SIDE**3,)
    assert factor.solve(B[:, :0]).shape == (SIDE**3, 0)
    del factor
    assert list(tmp_path.iterdir()) == []


@needs_slepc
def test_an_indefinite_matrix_is_refused(start):
    K, _, _ = lattice()
    with pytest.raises(NumericalError, match="a pivot of its factorisation is not positive"):
        start(2)(sparse.csr_array(K - 1e9 * sparse.eye_array(SIDE**3)))


@needs_slepc
def test_too_little_memory_is_refused_before_it_is_taken(start, monkeypatch):
    K, _, _ = lattice(12)
    monkeypatch.setattr(session, "available_memory", lambda: 1e6)
    with pytest.raises(UserError, match=r"too little memory for the factorised matrix.*estimated") as caught:
        start(2)(K)
    assert caught.value.key == "solver"


@needs_slepc
def test_a_process_that_dies_ends_the_others_and_is_named(start, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    factor = start(2)(lattice()[0])
    os.kill(workers(tmp_path)[0], signal.SIGKILL)
    with pytest.raises(
        NumericalError, match=r"an MPI process died: `mpiexec -n 2` ended with exit code 137"
    ) as caught:
        factor.solve(np.ones(SIDE**3))
    assert "memory ran out" in caught.value.remedy
    del factor, caught
    assert gone(tmp_path)


@needs_slepc
def test_more_entries_than_indices_of_32_bits_count(start, monkeypatch):
    K, _, _ = lattice()
    far = np.arange(SIDE**3 + 1) * (3 * 10**9 // SIDE**3)
    monkeypatch.setattr(
        session, "scaled_upper", lambda A, scale: type("Upper", (), {"indptr": far, "indices": far, "data": far})
    )
    with pytest.raises(UserError, match="32-bit indices") as caught:
        start(1)(K)
    assert "more processes" in caught.value.remedy


@needs_slepc
@pytest.mark.parametrize("ending", [*slowly(signal.SIGINT, signal.SIGKILL), signal.SIGTERM], ids=lambda number: number.name)
def test_a_run_that_is_ended_leaves_no_process_and_no_file(tmp_path, ending):
    script = (
        "import time\n"
        "from scipy import sparse\n"
        "from strainsight_cli.failures import reported\n"
        "from strainsight.contrib.mpi.session import OverMpi\n"
        "with reported():\n"
        "    factor = OverMpi()(sparse.csr_array(sparse.eye_array(500)))\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(60)\n"
    )
    command = [sys.executable, "-c", script]
    with subprocess.Popen(command, env={**over(2), "TMPDIR": str(tmp_path)}, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        assert len(workers(tmp_path)) == 2
        process.send_signal(ending)
        process.wait()
    assert gone(tmp_path)


def workers(folder):
    """Processes that work in a folder below this one."""
    found = []
    for command in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            words = command.read_bytes().decode(errors="replace").split("\0")
        except OSError:
            continue
        if any(word.startswith(f"{folder}/") for word in words) and any(
            word.endswith("worker.py") for word in words[:3]
        ):
            found.append(int(command.parent.name))
    return found


def gone(folder, limit=20.0):
    """Whether the processes end and the folder becomes empty, within a limit [s]."""
    until = time.monotonic() + limit
    while workers(folder) or list(folder.iterdir()):
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


STUB = """
import numpy as np
from types import SimpleNamespace as N
class PETSc:
    COMM_WORLD = N(rank=0, size=1, barrier=lambda: None)
    ScalarType = {scalar}
    Sys = N(popErrorHandler=lambda: 0, pushErrorHandler=lambda name: 0, getVersion=lambda: (9, 9, 9))
    Sys.hasExternalPackage = lambda name: {mumps}
"""


def pretend(folder, monkeypatch, scalar="np.float64", mumps=True, slepc=True, launcher="env"):
    """Modules petsc4py and slepc4py that say so of themselves, started without MPI."""
    (folder / "petsc4py.py").write_text(STUB.format(scalar=scalar, mumps=mumps))
    if slepc:
        (folder / "slepc4py.py").write_text("from petsc4py import PETSc as SLEPc\n")
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.setenv(PYTHON, sys.executable)
    monkeypatch.setenv(LAUNCHER, launcher)
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
    return lattice()[0]


def test_no_answer_in_time(tmp_path, monkeypatch):
    waiting = tmp_path / "waiting"
    waiting.write_text("#!/bin/sh\necho no host answers\nexec sleep 60\n")
    waiting.chmod(0o755)
    K = pretend(tmp_path, monkeypatch, launcher=str(waiting))
    monkeypatch.setattr(session, "START_LIMIT", 1.0)
    with pytest.raises(UserError, match=r"were not connected after 1 s \| no host answers"):
        OverMpi()(K)


@pytest.mark.parametrize(
    ("stub", "environment", "said", "remedy"),
    [
        ({"scalar": "np.complex128"}, {}, "PETSc 9.9.9 is built for complex numbers", ""),
        ({"mumps": False}, {}, "PETSc 9.9.9 is built without MUMPS", ""),
        # the launcher of another MPI starts several, each of which believes to be alone
        ({}, {LAUNCHER: "env PMI_SIZE=2"}, "starts 2 processes that are not connected", ""),
        ({}, {LAUNCHER: "no-such-mpiexec -n 2"}, "the MPI launcher no-such-mpiexec was not found", "apt install openmpi-bin"),
        ({}, {LAUNCHER: "mpiexec '-n 2"}, "is not a valid command", "quotes"),
        ({}, {LAUNCHER: "false"}, "`false` ended with exit code 1", "OMPI_ALLOW_RUN_AS_ROOT=1"),
        ({}, {PYTHON: "no-such-python"}, "no-such-python: the interpreter does not run", "pip install"),
        ({}, {PYTHON: "false"}, "false: the interpreter does not run", "python3-slepc4py"),
        ({"slepc": False}, {PYTHON: sys.executable}, f"{sys.executable}: no slepc4py", ""),
    ],
)
def test_unsuitable_installation_is_refused(tmp_path, monkeypatch, stub, environment, said, remedy):
    K = pretend(tmp_path, monkeypatch, **stub)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(UserError, match=said) as caught:
        OverMpi()(K)
    assert caught.value.key == "solver"
    assert remedy in caught.value.remedy

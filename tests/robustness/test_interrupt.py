"""Ctrl-C, a polite kill and a closed terminal: over at once, with the right code, and nothing and nobody left behind."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from strainsight.runner.artefact import Artefact

from .processes import of_session, until
from .whole import LOG, compared, names

AT_ONCE = 2.0
"""[s] from Ctrl-C to the end."""
SAYS = "interrupted; finished stages are kept\n"
STAGES = [
    *(("beam", stage) for stage in ("import", "modes", "rom", "train", "screen", "observe", "place", "estimate")),
    *(("beam", stage) for stage in ("spectrum", "validate", "report")),
    *(("bench", stage) for stage in ("import", "reduce", "place", "simulate", "estimate", "field", "report")),
]
SWEEPS = f"validate.sweeps.process_noise={[round(0.1 + 0.01 * i, 2) for i in range(400)]}"
LONG = """
import sys
import numpy as np
from scipy import sparse
from strainsight.fem.factorisation import factorise
from strainsight_cli.failures import reported

line = sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(48, 48))
one = sparse.eye_array(48)
kron = sparse.kron
A = kron(kron(line, one), one) + kron(kron(one, line), one) + kron(kron(one, one), line)
A = sparse.csr_array(A)
factorise(sparse.csr_array(line))
with reported():
    print("starts", flush=True)
    factorise(A)
    print("ends", flush=True)
"""
WORKERS = """
import math, os, sys, time
from strainsight import parallel

def task(folder, point):
    if point:
        open(os.path.join(folder, str(os.getpid())), "w").close()
        time.sleep(600)

parallel.WORTH = 0.0
parallel.in_processes(2, lambda: math.inf)(task, range(9), sys.argv[1])
"""
APART = """
import sys
from strainsight.measurements import reader
from strainsight_cli.failures import reported

reader.COMMAND = [sys.executable, "-c", "import time; print('ready', flush=True); time.sleep(60)"]
with reported():
    print("starts", flush=True)
    reader.read_binary("mat", __import__("pathlib").Path(reader.__file__), ["a"], time="t")
"""
LOCKED = """
import gc, os, signal, time
import h5py
from strainsight_cli.failures import reported

file = h5py.File("none", "w", driver="core", backing_store=False)
gc.disable()
for i in range(100):
    ring = [file.create_group(str(i))]
    ring.append(ring)
gc.set_threshold(1)
with reported():
    print("starts", flush=True)
    with h5py._objects.phil:
        gc.enable()
        time.sleep(600)
"""


@pytest.fixture
def results(undisturbed, tmp_path) -> Path:
    shutil.copytree(undisturbed, tmp_path / "results")
    return tmp_path / "results"


def ended(launcher, number: int, everybody: bool = False) -> float:
    """Send the signal to the process, or to all that it has started too as a terminal does; how long its end takes [s]."""
    start = time.perf_counter()
    (os.killpg if everybody else os.kill)(launcher.pid, number)
    code = launcher.end()
    spent = time.perf_counter() - start
    assert code == 128 + number
    assert spent < AT_ONCE
    assert until(lambda: not of_session(launcher.pid), AT_ONCE), of_session(launcher.pid)
    assert list(launcher.scratch.iterdir()) == []
    shared = [
        path.name for path in Path("/dev/shm").glob("*") if str(launcher.pid) in path.name.replace("-", "_").split("_")
    ]
    assert shared == []
    return spent


@pytest.mark.slow
def test_in_every_stage(project, undisturbed, results, launcher):
    spent = {}
    for run, stage in STAGES:
        log, says = results / run / LOG, project / "says"
        before = log.stat().st_size
        launcher.start([stage, str(project / f"{run}.yaml"), "--results", str(results), "--force"], says)
        assert until(lambda: launcher.has_ended() or b" starts: " in log.read_bytes()[before:])  # noqa: B023
        spent[run, stage] = ended(launcher, signal.SIGINT)
        assert says.read_text().endswith(SAYS)
        assert log.read_text().endswith(f" {launcher.pid} {SAYS}")
    for run in ("beam", "bench"):
        assert set(compared(results / run, undisturbed / run)) >= names(undisturbed / run)
    print("longest", *max((seconds, at) for at, seconds in spent.items()))


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_while_other_processes_sweep(project, results, launcher, number):
    words = ["validate", str(project / "beam.yaml"), "--results", str(results), "--jobs", "2", "--set", SWEEPS]
    launcher.start(words, project / "says")
    assert until(
        lambda: launcher.has_ended() or any("popen_loky" in said for said in of_session(launcher.pid).values())
    )
    time.sleep(0.5)
    ended(launcher, number)
    said = (project / "says").read_text()
    assert said.endswith(SAYS if number == signal.SIGINT else "terminated by a signal; finished stages are kept\n")
    assert "Traceback" not in said
    assert "leaked" not in said
    assert Artefact(results / "beam" / "validate.h5")


def test_whoever_works_for_a_killed_process_ends_with_it(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", WORKERS, str(tmp_path)], start_new_session=True, stderr=subprocess.DEVNULL
    )
    assert until(lambda: len(list(tmp_path.iterdir())) == 2)
    process.kill()
    process.wait()
    assert until(lambda: not of_session(process.pid), AT_ONCE), of_session(process.pid)


@pytest.mark.parametrize("code", [LONG, APART, LOCKED])
def test_inside_a_library(code):
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "starts\n"
    time.sleep(0.4)
    start = time.perf_counter()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, out, err) == (130, "", SAYS)
    assert time.perf_counter() - start < AT_ONCE


OPENMP = """
import os, pathlib
from strainsight_cli import failures

registered = failures.SHARED / f"__KMP_REGISTERED_LIB_{os.getpid()}_0"
registered.touch()
print(registered, flush=True)
failures._leave(7)
"""


@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="no memory files on this system")
def test_what_openmp_keeps_in_memory_goes_with_the_process():
    done = subprocess.run([sys.executable, "-c", OPENMP], capture_output=True, text=True, check=False)
    assert done.returncode == 7
    assert not Path(done.stdout.strip()).exists()

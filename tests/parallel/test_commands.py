"""`--jobs` and `--dask` on the command line: the same artefacts under the same keys, and an end at once when interrupted."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight import parallel
from strainsight.experiment.structure import reduction
from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from ..edges.beam import TIP, bricks
from ..robustness.processes import of_session, until

STAGES = ("import", "modes", "rom", "train", "screen", "observe", "place", "spectrum", "validate")


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    return write_project(tmp_path_factory.mktemp("beam"))


def run(config: Path, results: str, *options: str):
    folder = config.parent / results
    return CliRunner().invoke(app, ["validate", str(config), "--results", str(folder), *options])


def artefacts(config: Path, results: str) -> dict[str, tuple[str, str]]:
    found = {stage: Artefact(config.parent / results / "beam" / f"{stage}.h5") for stage in STAGES}
    return {stage: (artefact.header.key, artefact.digest) for stage, artefact in found.items()}


@pytest.fixture(scope="module")
def alone(config) -> dict[str, tuple[str, str]]:
    done = run(config, "alone", "--jobs", "1")
    assert done.exit_code == 0, done.output
    return artefacts(config, "alone")


@pytest.mark.slow
def test_two_processes_write_the_same_artefacts(config, alone, eager, monkeypatch):
    spread, sent, in_threads = parallel._spread, [], reduction.in_threads

    def seen(task, points, shared, count, keep):
        sent.append(task.__name__)
        spread(task, points, shared, count, keep)

    def counted(count):
        def asked():
            sent.append(f"{count()} threads")
            return count()

        return in_threads(asked)

    monkeypatch.setattr(reduction, "in_threads", counted)
    monkeypatch.setattr(parallel, "_spread", seen)
    done = run(config, "two", "--jobs", "2")
    assert done.exit_code == 0, done.output
    assert artefacts(config, "two") == alone
    # else nothing would have been compared; the pool is solved with exact gauges, and with two weights of installation errors
    assert sent == ["2 threads", "2 threads", *["solve_named_pool"] * 3, "_batch", "_swept"]


@pytest.mark.slow
def test_a_cluster_writes_the_same_artefacts_and_is_no_reason_to_run_again(config, alone, cluster):
    done = run(config, "dask", "--dask", cluster.address)
    assert done.exit_code == 0, done.output
    assert artefacts(config, "dask") == alone
    again = run(config, "dask", "--jobs", "1")
    assert again.output.count("up to date") == len(STAGES), again.output


def test_a_wrong_address_ends_with_two_before_anything_is_computed(config):
    done = run(config, "nowhere", "--dask", "127.0.0.1:port")
    assert done.exit_code == 2
    assert "--dask: no Dask scheduler at 127.0.0.1:port" in done.output
    assert "Traceback" not in done.output
    assert not list((config.parent / "nowhere").glob("**/*.h5"))


@pytest.mark.parametrize("jobs", ["0", "-1", "two"])
def test_a_number_of_processes_is_one(config, jobs):
    assert run(config, "none", "--jobs", jobs).exit_code == 2


CODE = """
import sys
from strainsight.runner.sweep_location import Where, opened
from strainsight_cli.failures import reported
import sweep_tasks
with reported(), opened(Where(dask=sys.argv[1])) as sweep:
    sweep(sweep_tasks.slow, list(range(40)), None, lambda share: print(share, flush=True))
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
def test_interrupted_it_ends_at_once_and_the_cluster_forgets_it(cluster):
    here = Path(__file__).parent
    process = subprocess.Popen(
        [sys.executable, "-c", CODE, cluster.address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": str(here)},
        start_new_session=True,
    )
    try:
        for _ in range(2):
            assert float(process.stdout.readline()) < 0.5
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
        start = time.monotonic()
        _, said = process.communicate(timeout=20)
        assert time.monotonic() - start < 2
        assert process.returncode == 130
        assert said.strip() == "interrupted; finished stages are kept"
        assert until(lambda: not of_session(process.pid), 10)
        assert until(lambda: _tasks(cluster.address) == 0, 10)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _tasks(address: str) -> int:
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        return int(client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)))


CONFIG = f"""
kind: placement
name: beam
seed: 1
mesh: {{file: beam.bdf, length_unit: m, mass_unit: kg}}
parameters:
  E: {{property: youngs_modulus, region: 1, guess: 1.9e+11, range: [1.6e+11, 2.4e+11], process_noise_scale: 0.05}}
  E2: {{property: youngs_modulus, region: 2, guess: 7.0e+10, range: [6.0e+10, 8.0e+10], process_noise_scale: 0.05}}
loads:
  tip: {{node: {TIP}, direction: [0, 0, 1], known: true, signal: {{type: sine, frequency: 20.0, amplitude: 1.0e+3}}}}
damping: {{type: modal, ratio: 0.01}}
rom: {{modes: 3, parameter_samples: 4, tolerance: 1.0e-8}}
train: {{duration: 0.05, time_step: 1.0e-3}}
gauges:
  direction: {{type: axis, axis: [1, 0, 0], angles: [0]}}
  noise_std: {{relative_to_strongest: 0.01}}
screen: {{keep: 20, minimum_spacing: 0.02}}
place: {{estimate: [E], keep: 3, instants: 3, parameter_samples: 2}}
validate:
  truth: {{model: modes, parameters: {{E: 2.1e+11}}, modes: 6}}
  time_step: 1.0e-3
  duration: 0.05
  initial_std: {{E: 0.1}}
  random_sets: 2
  repeats: 64
  sweeps: {{time_steps: [2.0e-3], process_noise: [0.1, 10.0]}}
"""


def write_project(folder: Path) -> Path:
    deck = bricks((8, 2, 2))
    for e in range(17, 33):
        deck = deck.replace(f"CHEXA,{e},1,", f"CHEXA,{e},2,")
    second = "PSOLID,1,1\nPSOLID,2,2\nMAT1,2,7.0+10,,0.33,2700."
    (folder / "beam.bdf").write_text(deck.replace("PSOLID,1,1", second), encoding="ascii")
    (folder / "beam.yaml").write_text(CONFIG, encoding="utf-8")
    return folder / "beam.yaml"

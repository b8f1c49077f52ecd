"""The command line: what it prints, what it returns, what it leaves alone."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.stages.bench.pipeline import ON_DEMAND
from strainsight.stages.placement import stages_for
from strainsight_cli import pipelines
from strainsight_cli.failures import failure_of
from strainsight_cli.main import app

from ..shared import slowly

ROOT = Path(__file__).parents[2]
CONFIG = str(ROOT / "configs" / "cantilever-youngs-modulus.yaml")


@pytest.fixture
def call(tmp_path):
    def called(*words: str):
        return CliRunner().invoke(app, [*words, "--results", str(tmp_path / "results")])

    return called


def test_import_then_up_to_date_then_forced(call):
    first = call("import", CONFIG)
    assert first.exit_code == 0
    assert first.stdout.startswith("import    done")
    assert "up to date" in call("import", CONFIG).output
    assert "done" in call("import", CONFIG, "--force").output


def test_json_is_one_object_a_stage(call):
    lines = call("import", CONFIG, "--json").stdout.splitlines()
    (event,) = (json.loads(line) for line in lines)
    assert set(event) == {"stage", "status", "reason", "seconds", "artefact", "summary"}
    assert event["stage"] == "import"
    assert event["summary"]["elements"] == 640
    assert Path(event["artefact"]).is_file()


def test_json_is_alone_on_standard_output(tmp_path):
    """Notes and warnings go to standard error, here that the same run is in results/ beside the config."""
    config = tmp_path / "beam.yaml"
    shutil.copy(ROOT / "meshes" / "cantilever.bdf", tmp_path)
    config.write_text(Path(CONFIG).read_text(encoding="utf-8").replace("../meshes/", ""), encoding="utf-8")
    first = CliRunner().invoke(app, ["import", str(config), "--json", "--results", str(tmp_path / "results")])
    assert (first.exit_code, first.stderr) == (0, "")
    again = CliRunner().invoke(app, ["import", str(config), "--json", "--results", str(tmp_path / "other")])
    assert [json.loads(line)["status"] for line in again.stdout.splitlines()] == ["done"]
    assert again.stderr.startswith("note: nothing is computed in")


def test_a_dry_run_and_status_write_nothing(call, tmp_path):
    for words in (("run", CONFIG, "--dry-run"), ("status", CONFIG)):
        done = call(*words)
        assert done.exit_code == 0
        assert done.output.count("never run") == len(stages_of_example("cantilever-youngs-modulus"))
    assert not (tmp_path / "results").exists()


def test_init_takes_a_deck_not_a_config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text("kind: placement\n", encoding="utf-8")
    for words in (("own.yaml",), ("own.yaml", "--force"), ("own.yaml", "-o", "new.yaml")):
        done = CliRunner().invoke(app, ["init", *words])
        assert done.exit_code == 2
        assert done.stderr.startswith("own.yaml  a config, not a deck\n    to compute it: strainsight run own.yaml;")
    assert [path.name for path in tmp_path.iterdir()] == ["own.yaml"]
    assert (tmp_path / "own.yaml").read_text(encoding="utf-8") == "kind: placement\n"


def test_a_folder_that_cannot_be_written_is_reported_with_the_option_for_another():
    found = failure_of(PermissionError(13, "Permission denied", "results"))
    assert found.code == 2
    assert found.message.startswith("results  Permission denied\n")
    assert "--results FOLDER" in found.message


def test_what_init_says_to_run_next_can_be_copied(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Träger 1.bdf").write_bytes((ROOT / "meshes" / "cantilever.bdf").read_bytes())
    done = CliRunner().invoke(app, ["init", "Träger 1.bdf"])
    assert shlex.split(done.output.rpartition("then: ")[2]) == ["strainsight", "run", "Träger 1.yaml"]


def test_an_estimate_without_its_section_says_what_to_add(call, tmp_path):
    (tmp_path / "m.csv").write_text("time,G1\n0,1\n1,2\n", encoding="utf-8")
    plain, given = call("estimate", CONFIG), call("estimate", CONFIG, "--measurements", str(tmp_path / "m.csv"))
    assert (plain.exit_code, given.exit_code) == (2, 2)
    assert "add a section `estimate: {channels: [{gauge: G1, channel: NAME, unit: um/m}]}`" in plain.stderr
    assert given.stderr.startswith("--measurements  estimate.channels: missing\n")
    assert "no section `estimate` yet" in given.stderr


def test_init_writes_a_config_that_status_accepts_and_does_not_overwrite(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my deck.bdf").write_bytes((ROOT / "meshes" / "cantilever.bdf").read_bytes())
    runner = CliRunner()
    load = ["--load", "node 2", "--direction", "0 0 1", "--amplitude", "1e4", "--frequency", "20"]
    assert runner.invoke(app, ["init", "my deck.bdf", "-o", "own.yaml", *load]).exit_code == 0
    assert runner.invoke(app, ["status", "own.yaml"]).exit_code == 0
    again = runner.invoke(app, ["init", "my deck.bdf", "-o", "own.yaml"])
    assert again.exit_code == 2
    assert "--force" in again.output + (again.stderr or "")
    assert runner.invoke(app, ["init", "none.bdf"]).exit_code == 2


def test_schema_prints_the_schema():
    done = CliRunner().invoke(app, ["schema"])
    kinds = [entry["$ref"].rpartition("/")[2] for entry in json.loads(done.stdout)["oneOf"]]
    assert kinds == ["PlacementConfig", "BenchConfig", "BearingConfig", "SuiteConfig"]


@pytest.mark.parametrize("name", pipelines.STAGES)
def test_every_stage_has_a_command(name):
    assert CliRunner().invoke(app, [name, "--help"]).exit_code == 0


def stages_of_example(name: str, *overrides: str) -> list[str]:
    return [stage.name for stage in pipelines.stages_of(load_config(ROOT / "configs" / f"{name}.yaml", overrides).data)]


def test_the_stages_of_the_command_line_are_those_of_the_pipelines():
    placement = stages_of_example("cantilever-youngs-modulus")
    bench = stages_of_example("bench/gauges", "estimate.truth.model=other")
    assert [name for name in pipelines.STAGES if name in placement] == placement
    assert [name for name in pipelines.STAGES if name in bench] == bench
    tested = [stage.name for stage in stages_for(True, "modes")]
    assert [name for name in pipelines.STAGES if name in tested] == tested
    assert set(pipelines.STAGES) == {*placement, *bench, *tested, *ON_DEMAND}


def test_a_users_mistake_is_two_and_an_internal_failure_one_without_a_traceback(call, monkeypatch):
    assert call("run", str(ROOT / "configs" / "none.yaml")).exit_code == 2
    assert call("run", CONFIG, "--set", "place.keep=0").exit_code == 2

    def broken(*_, **__):
        raise RuntimeError("a bug")

    monkeypatch.setattr(pipelines, "loaded_config", broken)
    done = call("run", CONFIG)
    assert done.exit_code == 1
    message = done.output + (done.stderr or "")
    assert "internal error: RuntimeError: a bug" in message
    assert "Traceback" not in message


def test_memory_that_runs_out_is_two_and_says_what_was_asked_for(call, monkeypatch):
    def greedy(*_, **__):
        np.empty(2**59)

    monkeypatch.setattr(pipelines, "loaded_config", greedy)
    done = call("run", CONFIG)
    assert done.exit_code == 2
    message = done.output + (done.stderr or "")
    assert "there is not enough memory: Unable to allocate 4.00 EiB" in message
    assert "coarser mesh" in message
    assert "internal error" not in message


def test_a_folder_that_cannot_be_written_is_two(tmp_path):
    (tmp_path / "results").write_text("a file where the folder should be")
    done = CliRunner().invoke(app, ["import", CONFIG, "--results", str(tmp_path / "results")])
    assert done.exit_code == 2


@pytest.mark.parametrize("delay", [0.7, *slowly(0.0, 1.4, 2.1)])
def test_an_interrupt_ends_with_130_and_keeps_what_was_finished(tmp_path, delay):
    """Whatever library the interrupt meets: one that comes in a callback of C code is forgotten by Python."""
    command = [sys.executable, "-m", "strainsight_cli.main", "run", CONFIG, "--results", str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    finished = tmp_path / "cantilever-youngs-modulus" / "import.h5"
    for _ in range(600):
        if finished.exists():
            break
        time.sleep(0.05)
    time.sleep(delay)
    os.kill(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "finished stages are kept" in said
    assert finished.exists()


def test_help_loads_nothing_heavy():
    code = (
        "import sys, strainsight_cli.main; "
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'numpy', 'scipy', 'h5py', 'pydantic', 'pyvista', 'matplotlib'}))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == "[]"

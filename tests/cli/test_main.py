"""The command line: what it prints, what it returns, what it leaves alone."""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import sys
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

from ..robustness.small import write_project

ROOT = Path(__file__).parents[2]
CONFIG = str(ROOT / "configs" / "cantilever-youngs-modulus.yaml")


@pytest.fixture
def call(tmp_path):
    """A function: words → how the command ended in a folder that holds the small beam."""
    write_project(tmp_path)

    def called(*words: str, results: str = "results"):
        return CliRunner().invoke(app, [*words, "--results", str(tmp_path / results)])

    called.config = str(tmp_path / "beam.yaml")
    return called


def test_import_runs_once_and_again_by_force_and_json_is_one_object_a_stage(call):
    first = call("import", call.config, "--json")
    assert (first.exit_code, first.stderr) == (0, "")
    (event,) = (json.loads(line) for line in first.stdout.splitlines())
    assert set(event) == {"stage", "status", "reason", "seconds", "artefact", "summary"}
    assert (event["stage"], event["status"], event["summary"]["elements"]) == ("import", "done", 32)
    assert Path(event["artefact"]).is_file()
    assert "up to date" in call("import", call.config).output
    assert call("import", call.config, "--force").stdout.startswith("import    done")


def test_a_dry_run_and_status_write_nothing(call, tmp_path):
    for words in (("run", call.config, "--dry-run"), ("status", call.config)):
        done = call(*words)
        assert done.exit_code == 0
        assert done.output.count("never run") == len(pipelines.stages_of(load_config(Path(call.config)).data))
    assert not (tmp_path / "results").exists()


def test_what_init_says_to_run_next_can_be_copied_and_its_config_is_not_overwritten(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.move("beam.bdf", "Träger 1.bdf")
    load = ["--load", "node 1000", "--direction", "0 0 1", "--amplitude", "1e4", "--frequency", "20"]
    done = CliRunner().invoke(app, ["init", "Träger 1.bdf", *load])
    assert shlex.split(done.output.rpartition("then: ")[2]) == ["strainsight", "run", "Träger 1.yaml"]
    assert CliRunner().invoke(app, ["status", "Träger 1.yaml"]).exit_code == 0
    again = CliRunner().invoke(app, ["init", "Träger 1.bdf"])
    assert again.exit_code == 2
    assert "--force" in again.output + (again.stderr or "")
    assert CliRunner().invoke(app, ["init", "none.bdf"]).exit_code == 2


def test_an_estimate_without_its_section_says_what_to_add(call, tmp_path):
    plain = call("estimate", CONFIG)
    assert plain.exit_code == 2
    assert "add a section `estimate: {channels: [{gauge: G1, channel: NAME, unit: um/m}]}`" in plain.stderr


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


def test_a_users_mistake_is_two_and_an_internal_failure_one_without_a_traceback(call, tmp_path, monkeypatch):
    assert call("run", str(ROOT / "configs" / "none.yaml")).exit_code == 2
    assert call("run", CONFIG, "--set", "place.keep=0").exit_code == 2
    (tmp_path / "file").write_text("a file where the folder should be")
    assert call("import", CONFIG, results="file").exit_code == 2

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
    assert "internal error" not in message


def test_a_folder_that_cannot_be_written_is_reported_with_the_option_for_another():
    failure = failure_of(PermissionError(13, "Permission denied", "results"))
    assert failure.code == 2
    assert failure.message.startswith("results  Permission denied\n")
    assert "--results FOLDER" in failure.message


def test_help_loads_nothing_heavy():
    code = (
        "import sys, strainsight_cli.main; "
        "print(sorted({m.split('.')[0] for m in sys.modules} & {'numpy', 'scipy', 'h5py', 'pydantic', 'pyvista', 'matplotlib'}))"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert loaded.strip() == "[]"

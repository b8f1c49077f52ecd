"""The command line: what it prints, what it returns, what it leaves alone, without streams, folder or memory."""

from __future__ import annotations

import errno
import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight.stages.bench.pipeline import ON_DEMAND
from strainsight.stages.placement import stages_for
from strainsight_cli import pipelines
from strainsight_cli.failures import failure_of
from strainsight_cli.main import app

from ..robustness.small import write_project
from ..shared import slowly

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


def test_command_printed_by_init_runs_and_config_is_not_overwritten(call, tmp_path, monkeypatch):
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


def test_estimate_without_section_has_remedy(call, tmp_path):
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
    bench = stages_of_example("bench/gauges", "estimate.truth.model=independent")
    assert [name for name in pipelines.STAGES if name in placement] == placement
    assert [name for name in pipelines.STAGES if name in bench] == bench
    tested = [stage.name for stage in stages_for(True, "modes")]
    assert [name for name in pipelines.STAGES if name in tested] == tested
    assert set(pipelines.STAGES) == {*placement, *bench, *tested, *ON_DEMAND}


def test_exit_code_is_2_for_user_error_and_1_for_internal_error(call, tmp_path, monkeypatch):
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


def test_memory_error_has_exit_code_2_and_requested_size(call, monkeypatch):
    def greedy(*_, **__):
        np.empty(2**59)

    monkeypatch.setattr(pipelines, "loaded_config", greedy)
    done = call("run", CONFIG)
    assert done.exit_code == 2
    message = done.output + (done.stderr or "")
    assert "not enough memory: Unable to allocate 4.00 EiB" in message
    assert "internal error" not in message


def test_read_only_results_folder_has_remedy():
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


COMMAND = [sys.executable, "-m", "strainsight_cli.main"]
posix = pytest.mark.skipif(os.name != "posix", reason="the shell and the limits of POSIX")


def shell(line, folder, *words):
    return subprocess.run(["sh", "-c", line, "sh", *COMMAND, *words], cwd=folder, capture_output=True, text=True, timeout=60)


@posix
@pytest.mark.parametrize("closed", ["<&- >&- 2>&-", *slowly(">&-", "2>&-", ">&- 2>&-")])
def test_a_process_without_streams_does_its_work(closed, tmp_path):
    assert shell(f'"$@" {closed}', tmp_path, "status", "nothing.yaml").returncode == 2


@posix
def test_missing_working_folder_is_reported(tmp_path):
    (tmp_path / "gone").mkdir()
    done = shell('cd gone && rmdir ../gone && "$@"', tmp_path, "status", "c.yaml")
    assert done.returncode == 2
    assert done.stderr.startswith("the working folder does not exist, or cannot be read\n    change to")


@posix
def test_low_address_space_limit_is_reported_before_imports(tmp_path):
    done = shell('ulimit -v 300000 && "$@"', tmp_path, "status", "c.yaml")
    assert done.returncode == 2
    assert "the address space limit is 293 MiB" in done.stderr
    assert "ulimit -v 1048576" in done.stderr


@posix
def test_pipe_as_config_is_refused(tmp_path):
    os.mkfifo(tmp_path / "c.yaml")
    with pytest.raises(ConfigError, match="is not a regular file"):
        load_config(tmp_path / "c.yaml")


def test_too_many_open_files_differ_from_full_disk():
    for number in (errno.EMFILE, errno.ENFILE):
        for error in (OSError(number, os.strerror(number)), OSError(number, os.strerror(number), "results/a.h5")):
            failure = failure_of(error)
            assert failure.code == 2
            assert "ulimit -n" in failure.message


@posix
def test_closed_output_pipe_is_no_failure(tmp_path):
    done = shell('{ "$@" 2>&1; echo $? >&3; } 3>code | true', tmp_path, "status", "nothing.yaml")
    assert (tmp_path / "code").read_text() == "2\n"
    assert done.stderr == ""


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")
@pytest.mark.parametrize("words", [("schema",), ("--help",)])
def test_output_that_cannot_be_written_is_a_failure(tmp_path, words):
    done = shell('unset PYTHONUNBUFFERED; "$@" >/dev/full', tmp_path, *words)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


@posix
def test_closed_streams_are_reserved(tmp_path):
    code = "from strainsight_cli.printing import prepare_streams as p; p(); "
    code += "open('n', 'w').write(str(open('a', 'w').fileno()))"
    line = f'{sys.executable} -c "{code}" <&- >&- 2>&-'
    assert subprocess.run(["sh", "-c", line], cwd=tmp_path, timeout=60).returncode == 0
    assert int((tmp_path / "n").read_text()) > 2

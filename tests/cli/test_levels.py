"""-q, -v and --log-level: what goes to the terminal; JSON, a failure and run.log stay whole."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight_cli.levels import Level, now
from strainsight_cli.main import app

from ..robustness.small import PLACEMENT, write_project

ON_ONE_NODE = "acts on node 1 of a solid alone"


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    """The small beam with a load that is warned of."""
    folder = tmp_path_factory.mktemp("project")
    write_project(folder)
    (folder / "beam.yaml").write_text(PLACEMENT.replace("node: 1000", "node: 1"), encoding="utf-8")
    return folder


@pytest.fixture
def call(project, tmp_path):
    words = (str(project / "beam.yaml"), "--results", str(tmp_path / "results"))
    return lambda *more, stage="import": CliRunner().invoke(app, [stage, *words, *more])


@pytest.mark.parametrize("words", [("-q",), ("--quiet",), ("--log-level", "error")])
def test_quiet_says_nothing_and_the_log_says_all(call, tmp_path, words):
    done = call(*words)
    assert (done.exit_code, done.stdout, done.stderr) == (0, "", "")
    log = (tmp_path / "results" / "beam" / "run.log").read_text(encoding="utf-8")
    assert "import done after" in log
    assert ON_ONE_NODE in log
    assert now() is Level.INFO


def test_a_number_outside_its_plausible_range_is_warned_of_with_its_place(call, project, tmp_path):
    text = (project / "beam.yaml").read_text(encoding="utf-8")
    config = project / "odd.yaml"
    config.write_text(text.replace("ratio: 0.01", "ratio: 0.5").replace("name: beam", "name: odd"), encoding="utf-8")
    line = next(i for i, words in enumerate(text.splitlines(), start=1) if "ratio: 0.01" in words)
    words = (str(config), "--results", str(tmp_path / "results"), "--set", "screen.minimum_spacing=2")
    said = f"odd.yaml:{line}:31  damping.ratio: 0.5 is outside the plausible range of 1e-05 to 0.2; if 0.5 is in per cent, write"
    small = "screen.minimum_spacing: 2 m is more than the size of the structure, 1.0"
    for stage, more in (("import", ()), ("modes", ()), ("status", ()), ("modes", ("--log-level", "warning"))):
        done = CliRunner().invoke(app, [stage, *words, *more])
        assert done.exit_code == 0, done.stderr
        assert (done.stderr.count(said), done.stderr.count(small)) == (1, 1)
    log = (tmp_path / "results" / "odd" / "run.log").read_text(encoding="utf-8")
    assert (log.count("damping.ratio: 0.5 is"), log.count(small)) == (3, 3)
    strict = CliRunner().invoke(app, ["import", *words, "--strict"])
    assert strict.exit_code == 2
    assert "--strict takes none" in strict.stderr
    assert "damping.ratio: 0.5 is" in strict.stderr.partition("--strict takes none")[2]


def test_a_failure_is_printed_in_any_case(call):
    done = call("-q", "--set", "loads.tip.node=77777")
    assert (done.exit_code, done.stdout) == (2, "")
    assert "loads.tip" in done.stderr
    assert "77777" in done.stderr


def test_warning_keeps_warnings_and_no_stages(call):
    done = call("--log-level", "warning")
    assert done.stdout == ""
    assert ON_ONE_NODE in done.stderr
    plain = call("--log-level", "info", "--force")
    assert plain.stdout.startswith("import    done")
    assert ON_ONE_NODE in plain.stderr
    assert "(--force)" not in plain.stdout
    assert call("--log-level", "debug", "--force").stdout.splitlines()[0].endswith("(--force)")
    assert call("-v", "--force").stdout.splitlines()[0].endswith("(--force)")


def test_what_was_asked_for_stays(call):
    done = call("-q", "--json")
    (event,) = (json.loads(line) for line in done.stdout.splitlines())
    assert (event["stage"], event["status"], done.stderr) == ("import", "done", "")
    assert call("-q", "--dry-run").stdout.startswith("stage")


def test_two_levels_contradict_each_other(call, tmp_path):
    for words in (("-q", "-v"), ("-q", "--log-level", "info")):
        done = call(*words)
        assert done.exit_code == 2
        assert done.stderr.endswith("contradict each other\n    give one: -q is --log-level error, -v is --log-level debug\n")
    assert not (tmp_path / "results").exists()
    assert call("--log-level", "loud").exit_code == 2


def test_every_command_prints_the_warnings_of_its_model_once(call, tmp_path):
    log = tmp_path / "results" / "beam" / "run.log"
    for count, stage in enumerate(("modes", "modes", "import"), start=1):  # computed, then up to date
        done = call(stage=stage)
        assert (done.exit_code, done.stderr.count(ON_ONE_NODE)) == (0, 1)
        assert log.read_text(encoding="utf-8").count(ON_ONE_NODE) == count
    assert call(stage="status").stderr.count(ON_ONE_NODE) == 1
    assert call("--dry-run", stage="run").stderr.count(ON_ONE_NODE) == 1
    done = call("--json", stage="modes")
    assert [json.loads(line)["stage"] for line in done.stdout.splitlines()] == ["import", "modes"]
    assert done.stderr.count(ON_ONE_NODE) == 1
    assert call("-q", stage="modes").stderr == ""

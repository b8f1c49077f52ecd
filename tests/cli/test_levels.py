"""-q, -v, --log-level and run.log: what goes to the terminal and what stands in the log."""

from __future__ import annotations

import json
import re
import socket
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.errors import InfeasibleError
from strainsight.runner.output import Dataset, Output
from strainsight.runner.plan import Job
from strainsight.runner.stage import Stage
from strainsight_cli import runlog
from strainsight_cli.main import app
from strainsight_cli.printing import Level, now
from strainsight_cli.runlog import append, placeless
from strainsight_cli.work import Work, bring_up_to_date

from ..robustness.small import PLACEMENT, write_project
from ..shared import slowly

ON_ONE_NODE = "force on node 1 of a solid"


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


@pytest.mark.parametrize("words", [("-q",), *slowly((("--quiet",),), (("--log-level", "error"),))])
def test_quiet_prints_nothing_and_log_is_complete(call, tmp_path, words):
    done = call(*words)
    assert (done.exit_code, done.stdout, done.stderr) == (0, "", "")
    log = (tmp_path / "results" / "beam" / "run.log").read_text(encoding="utf-8")
    assert "import done after" in log
    assert ON_ONE_NODE in log
    assert now() is Level.INFO


def test_warning_keeps_warnings_and_no_stages(call):
    done = call("--log-level", "warning")
    assert done.stdout == ""
    assert ON_ONE_NODE in done.stderr


def test_two_log_levels_are_refused(call, tmp_path):
    for words in (("-q", "-v"), ("-q", "--log-level", "info")):
        done = call(*words)
        assert done.exit_code == 2
        assert done.stderr.endswith("exclude each other\n    use one of them: -q is --log-level error, -v is --log-level debug\n")
    assert not (tmp_path / "results").exists()
    assert call("--log-level", "loud").exit_code == 2


@pytest.mark.slow
def test_every_command_prints_the_warnings_of_its_model_once(call, tmp_path):
    log = tmp_path / "results" / "beam" / "run.log"
    for count in (1, 2):  # computed, then up to date
        done = call()
        assert (done.exit_code, done.stderr.count(ON_ONE_NODE)) == (0, 1)
        assert log.read_text(encoding="utf-8").count(ON_ONE_NODE) == count
    assert call(stage="status").stderr.count(ON_ONE_NODE) == 1
    done = call("--json")
    assert json.loads(done.stdout)["stage"] == "import"
    assert done.stderr.count(ON_ONE_NODE) == 1
    quiet = call("-q", "--json")
    assert (json.loads(quiet.stdout)["stage"], quiet.stderr) == ("import", "")


LINE = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ \d+ \S.*|\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ \d+   \| .*")
def good(context) -> Output:
    warnings.warn("\x1b[2Jlook at this", stacklevel=1)
    return Output({"/x": Dataset(np.ones(3), "m", "x")}, {}, "three numbers")


def bad(context) -> Output:
    raise InfeasibleError("too much", where=f"{Path.cwd()}/own.yaml:1:1", remedy="use less")


def crash(context) -> Output:
    return open("/no such/folder of mine/x.bdf")  # type: ignore[return-value]


@pytest.fixture
def work(tmp_path):
    def made(*functions) -> Work:
        stages = tuple(Stage(f.__name__, 1, (), (), (), f) for f in functions)
        return Work(stages, Job({"name": "toy"}, tmp_path, tmp_path / "results", str))

    return made


def run(work: Work, forced=()) -> str:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = lambda *_, **__: None
        try:
            bring_up_to_date(work, forced, False, False, lambda _: None, lambda *_: None, lambda _: None)
        finally:
            text = (work.job.folder / "run.log").read_text(encoding="utf-8")
    return text


def texts(log: str) -> list[str]:
    assert all(LINE.fullmatch(line) for line in log.splitlines()), log
    return [line.split(" ", 2)[2] for line in log.splitlines()]


def test_a_line_a_start_and_an_end_with_time_memory_message_and_warnings(work):
    begins, starts, warning, done, ends = texts(run(work(good)))
    assert begins.startswith("run begins: toy, good; strainsight ")
    assert starts == "good starts: never run"
    assert warning == "warning: �[2Jlook at this"
    assert re.fullmatch(r"good done after \d+\.\d s, peak memory \d+\.\d\d GiB: three numbers", done)
    assert re.fullmatch(r"finished after \d\.\d s, peak memory \d+\.\d\d GiB", ends)


@pytest.mark.parametrize(("function", "error"), [(bad, InfeasibleError), (crash, FileNotFoundError)])
def test_a_failure_has_its_traceback_and_no_place_of_this_machine(work, function, error, monkeypatch):
    with pytest.raises(error):
        run(work(good, function))
    log = (work(good).job.folder / "run.log").read_text(encoding="utf-8")
    said = texts(log)
    assert re.match(rf"{function.__name__} failed after \d\.\d s", next(text for text in said if " failed after " in text))
    assert any('File "strainsight/runner/runner.py", line ' in text for text in said)
    assert any(error.__name__ in text for text in said)
    assert not re.search(r"(?<![\w.…)/])/\w", log), log
    for place in (Path.cwd(), Path.home(), Path(sys.prefix)):
        assert f"{place}/" not in log
    assert "folder of mine" not in log
    assert socket.gethostname() not in log


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/none/of these", "…/of these"),
        ("'/none/with space/x.bdf': gone", "'…/x.bdf': gone"),
        ("x.bdf is missing, 71.5 µm/m, 3/4, a//b", "x.bdf is missing, 71.5 µm/m, 3/4, a//b"),
        ("/ONE/own.yaml:3:1  place.keep: 0", "own.yaml:3:1  place.keep: 0"),
        ("in /ONE, or /ONE/", "in ., or ."),
        ("/ONE-two/x", "…/x"),
        ("meshes/ONE/x", "meshes/nowhere/one/x"),
    ],
)
def test_paths_are_relative_or_only_a_name(text, expected):
    one = Path("/nowhere/one")
    assert placeless(text.replace("/ONE", str(one)), [one]) == expected


def test_a_log_that_cannot_be_written_is_no_reason_to_fail(work):
    one = work(good)
    (one.job.folder / "run.log").mkdir(parents=True)
    with pytest.raises(IsADirectoryError):  # of reading it here; the run itself went through
        run(one)
    assert (one.job.folder / "good.h5").exists()


def test_log_keeps_last_lines_within_size_limit(tmp_path):
    path = tmp_path / "run.log"
    for i in range(40):
        append(path, f"{i} {'x' * 98}\n" * 500)
        assert path.stat().st_size <= runlog.MOST
    lines = path.read_text().splitlines()
    assert lines[-1].startswith("39 ")
    assert len({line.partition(" ")[2] for line in lines}) == 1
    assert path.stat().st_size > runlog.KEPT // 2

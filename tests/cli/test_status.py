"""The table of status: what is up to date, why the rest is not, how long it took; colours only where they are wanted."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.plan import Job
from strainsight.workflow.runner import run
from strainsight.workflow.stage import Stage
from strainsight_cli.status import show_plan
from strainsight_cli.work import Work

from ..shared import slowly

KEYS = ("a", "b", "c", "d", "e")


def ones(context) -> Output:
    return Output({"/x": Dataset(np.ones(3), "m", "x")}, {}, "three numbers")


@pytest.fixture
def work(tmp_path):
    """A function: values of five keys → the work of two stages, of which the second reads them all."""

    def made(**changed) -> Work:
        config = {"name": "toy", **dict.fromkeys(KEYS, 1), **changed}
        stages = (Stage("first", 1, (), (), (), ones), Stage("second", 1, KEYS, ("first",), (), ones))
        return Work(stages, Job(config, tmp_path, tmp_path / "results", lambda key: f"own.yaml:{KEYS.index(key)}:1"))

    return made


@pytest.fixture
def table(work, capsys):
    """A function: changed keys → lines of the table after a run without them."""
    list(run(work().stages, work().job))

    def made(verbose: bool = False, **changed) -> list[str]:
        show_plan(work(**changed), (), False, verbose)
        return capsys.readouterr().out.splitlines()

    return made


def test_a_row_says_what_came_out_and_how_long_it_took(table):
    head, first, second, _, sum_of = table()
    assert head.split()[:3] == ["stage", "status", "took"]
    assert first.split() == ["first", "up", "to", "date", "0.0", "s", "three", "numbers"]
    assert second.startswith("second")
    assert sum_of == "2 of 2 stages up to date"


def test_a_row_says_why_it_will_run_and_what_that_took_before(table):
    *_, second, _, sum_of = table(b=2)
    assert second.split()[1:5] == ["will", "run", "0.0", "s"]
    assert second.endswith("b 1 → 2 (own.yaml:1)")
    assert sum_of == "1 of 2 stages up to date; the other took 0.0 s when last run"


def test_more_than_three_reasons_are_counted_and_all_shown_on_request(table):
    changed = dict.fromkeys(KEYS, 2)
    assert table(**changed)[2].endswith("c 1 → 2 (own.yaml:2) and 2 more")
    assert table(verbose=True, **changed)[2].count("1 → 2") == 5


def test_a_damaged_artefact_is_a_reason_without_a_time(table, work):
    (work().job.folder / "second.h5").write_bytes(b"nothing")
    *_, second, _, sum_of = table()
    assert "damaged" in second
    assert sum_of == "1 of 2 stages up to date"


def test_a_terminal_does_not_obey_what_a_config_holds(table):
    (line,) = [line for line in table(a="\x1b[2Jx") if line.startswith("second")]
    assert "\x1b" not in line
    assert "\\x1b[2Jx" in line


@pytest.mark.parametrize(
    ("environment", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False), *slowly(({"TERM": "dumb"}, False))]
)
def test_colours_on_a_terminal_unless_they_are_declined(tmp_path, environment, coloured):
    said = on_a_terminal(["status", str(CONFIG), "--results", str(tmp_path)], environment)
    assert "will run" in said
    assert ("\x1b[" in said) == coloured


def test_no_colour_and_no_spaces_at_the_end_in_a_pipe(table):
    for line in table(b=2):
        assert "\x1b" not in line
        assert line == line.rstrip()


CONFIG = Path(__file__).parents[2] / "configs" / "cantilever-youngs-modulus.yaml"


def on_a_terminal(words: list[str], environment: dict[str, str]) -> str:
    """What the command writes to a terminal of its own."""
    own, its = pty.openpty()
    clean = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "FORCE_COLOR", "COLUMNS")}
    command = [sys.executable, "-m", "strainsight_cli.main", *words]
    process = subprocess.Popen(
        command, stdout=its, stderr=its, stdin=its, env={**clean, "TERM": "xterm", **environment}
    )
    os.close(its)
    said = b""
    while True:
        try:
            part = os.read(own, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        said += part
    os.close(own)
    assert process.wait(timeout=60) == 0
    return said.decode()

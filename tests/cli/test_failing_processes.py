"""What the user is told when a run in another process fails, is killed or waits; the table of status."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer

from strainsight.errors import StrainsightError
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.plan import Job
from strainsight.workflow.runner import run
from strainsight.workflow.stage import Stage
from strainsight_cli.failures import reported
from strainsight_cli.status import show_plan
from strainsight_cli.suites import _all_runs
from strainsight_cli.timing import timing_table
from strainsight_cli.work import Work

TOYS = """
import os, signal, time
import numpy as np
from strainsight.errors import InfeasibleError
from strainsight.workflow.output import Dataset, Output

def good(context):
    return Output({"/x": Dataset(np.ones(3), "m", "x")}, {}, "three numbers")

def slow(context):
    for i in range(2000):  # more than the pipe holds
        context.progress("at it, and saying a lot about it, again and again", i / 2000)
    time.sleep(1.0)
    return good(context)

def refuses(context):
    raise InfeasibleError("too much", where="own.yaml:1:1", remedy="take less")

def crashes(context):
    return {}["nothing"]

def dies(context):
    time.sleep(0.3)
    os.kill(os.getpid(), signal.SIGKILL)
"""
INTERRUPTED = """
import os
from strainsight_cli.side_by_side import _processes
if __name__ == "__main__":
    with _processes(2, False) as (pool, moves):
        pool.submit(os.getpid).result()
        os._exit(130)
"""


@pytest.fixture
def works(tmp_path, monkeypatch):
    """A function: names of toy stages → a run each, all on the same config where `by` is given."""
    (tmp_path / "toys_of_a_test.py").write_text(TOYS, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    import toys_of_a_test

    def made(*names: str, by: int | None = None) -> list[Work]:
        return [
            Work(
                (Stage("toy", 1, ("by",), (), (), getattr(toys_of_a_test, name)),),
                Job({"name": f"{name}{i}", "by": by or i}, tmp_path, tmp_path / "results", str),
                f"{name}{i}",
                f"run {i} of {len(names)} {name}{i}",
            )
            for i, name in enumerate(names, start=1)
        ]

    return made


def failed(works, verbose=False, as_json=False, moved=lambda *_: None) -> int:
    with pytest.raises(typer.Exit) as caught, reported(verbose):
        _all_runs(works, 2, False, as_json, verbose, moved)
    return caught.value.exit_code


def test_a_failure_is_reported_at_once_and_the_run_beside_it_ends(works, capfd):
    said = []

    def moved(run: str, *_) -> None:
        said.append((run, capfd.readouterr().err))

    assert failed(works("slow", "refuses", "good"), moved=moved) == 2
    out = capfd.readouterr()
    text = "".join(err for _, err in said)
    assert text.count("run 2 of 3 refuses2 failed:\nown.yaml:1:1  too much\n    take less") == 1
    assert "too much" not in out.err
    assert "Traceback" not in text
    assert sum(run == "run 1 of 3 slow1" for run, _ in said) > 1000
    assert "three numbers" in out.out
    assert "good3" not in out.out


@pytest.mark.slow
def test_json_has_the_lines_of_every_run_that_was_at_work(works, capsys):
    assert failed(works("slow", "refuses"), as_json=True) == 2
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(entry["run"], entry["status"]) for entry in found] == [("refuses2", "failed"), ("slow1", "done")]


@pytest.mark.slow
def test_the_traceback_of_a_process_is_shown_on_request(works, capsys):
    assert failed(works("crashes", "good"), verbose=True) == 1
    said = capsys.readouterr().err
    assert "internal error: KeyError: 'nothing'" in said
    assert 'return {}["nothing"]' in said


def test_a_killed_process_is_named_with_what_to_do(works, capsys):
    assert failed(works("dies", "slow")) == 1
    said = capsys.readouterr().err
    assert "run 1 of 2 dies1" in said
    assert "a process was killed, probably for lack of memory: --set jobs=1" in said
    assert "report them" not in said


def test_an_interrupted_suite_leaves_no_word_about_semaphores(tmp_path):
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED, encoding="utf-8")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (130, "")


def test_the_table_names_the_run_that_computed_a_stage(works):
    first, second = works("good", "good", by=1)
    (*_, late) = run(second.stages, second.job)
    (*_, taken) = run(first.stages, first.job)
    assert taken.artefact.source == "good2"
    found = [[taken.artefact], [late.artefact]]
    rows = timing_table(["good1", "good2"], found, late.artefact).rows
    assert [row[2] for row in rows[:2]] == ["↩ 2", "0.0"]
    (*_, later) = run(first.stages, first.job)
    rows = timing_table(["good1", "good2"], [[later.artefact], [late.artefact]], late.artefact).rows
    assert [row[2] for row in rows[:2]] == ["0.0", "↩ 1"]


@pytest.mark.parametrize(("own", "found"), [("suite", "import.h5"), ("import", "suite.h5")])
def test_a_suite_and_a_run_do_not_share_a_folder(works, own, found):
    (work,) = works("good")
    work = replace(work, stages=(replace(work.stages[0], name=own),))
    work.job.folder.mkdir(parents=True)
    (Path(work.job.folder) / found).touch()
    with pytest.raises(StrainsightError, match=r"report\.html .* would overwrite"):
        _all_runs([work], 1, False, False, False, lambda *_: None)


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

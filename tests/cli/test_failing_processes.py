"""What the user is told when a run in another process fails or is killed."""

from __future__ import annotations

import subprocess
import sys

import pytest
import typer

from strainsight.runner.plan import Job
from strainsight.runner.stage import Stage
from strainsight_cli.failures import reported
from strainsight_cli.suites import _all_runs
from strainsight_cli.work import Work

TOYS = """
import os, signal, time
import numpy as np
from strainsight.errors import InfeasibleError
from strainsight.runner.output import Dataset, Output

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
from strainsight_cli.suites import _processes
if __name__ == "__main__":
    with _processes(2, False) as (pool, moves):
        pool.submit(os.getpid).result()
        os._exit(130)
"""


@pytest.fixture
def works(tmp_path, monkeypatch):
    """A function: names of toy stages → a run each."""
    (tmp_path / "toys_of_a_test.py").write_text(TOYS, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    import toys_of_a_test

    def made(*names: str) -> list[Work]:
        return [
            Work(
                (Stage("toy", 1, ("by",), (), (), getattr(toys_of_a_test, name)),),
                Job({"name": f"{name}{i}", "by": i}, tmp_path, tmp_path / "results", str),
                f"{name}{i}",
                f"run {i} of {len(names)} {name}{i}",
            )
            for i, name in enumerate(names, start=1)
        ]

    return made


def failed(works, verbose=False, moved=lambda *_: None) -> int:
    with pytest.raises(typer.Exit) as caught, reported(verbose):
        _all_runs(works, 2, False, False, verbose, moved)
    return caught.value.exit_code


def test_failure_is_reported_and_parallel_run_ends(works, capfd):
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
def test_the_traceback_of_a_process_is_shown_on_request(works, capsys):
    assert failed(works("crashes", "good"), verbose=True) == 1
    said = capsys.readouterr().err
    assert "internal error: KeyError: 'nothing'" in said
    assert 'return {}["nothing"]' in said


def test_killed_process_is_reported_with_remedy(works, capsys):
    assert failed(works("dies", "slow")) == 1
    said = capsys.readouterr().err
    assert "run 1 of 2 dies1" in said
    assert "a process was killed, probably for lack of memory; compute one run at a time with --set jobs=1" in said
    assert "report the details" not in said


def test_an_interrupted_suite_leaves_no_word_about_semaphores(tmp_path):
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED, encoding="utf-8")
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (130, "")

"""Two processes at the same results: one refuses, waits or takes over, and says whom it met. A held process makes it certain."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from contextlib import contextmanager
from pathlib import Path

import pytest

from ..shared import slowly
from .processes import PATIENCE, of_session, until
from .small import PLACEMENT, command
from .whole import LOG, compared, names

SCREENED = {f"{stage}.h5" for stage in ("import", "modes", "rom", "train", "screen")} | {"import.vtkhdf", "rom.vtkhdf"}


@pytest.fixture
def results(undisturbed, tmp_path) -> Path:
    """Results up to the reduced model, so that both runs have the same to do from there."""
    results = tmp_path / "results"
    shutil.copytree(undisturbed / "beam", results / "beam")
    for path in (results / "beam").iterdir():
        if path.stem not in ("import", "modes"):
            path.unlink()
    return results


@contextmanager
def held(launcher, project: Path, results: Path, stage: str):
    """A run of beam.yaml that stands still in a stage, its lock in hand."""
    pid = launcher.start(["screen", str(project / "beam.yaml"), "--results", str(results)], project / "says")
    log = results / "beam" / LOG
    assert until(lambda: launcher.has_ended() or (log.exists() and f"{stage} starts" in log.read_text()))
    # That it is said to start is no word yet on the lock.
    assert until(lambda: launcher.has_ended() or f"POSIX  ADVISORY  WRITE {pid} " in Path("/proc/locks").read_text())
    os.kill(pid, signal.SIGSTOP)
    try:
        yield pid
    finally:
        if launcher.runs:
            os.kill(pid, signal.SIGKILL)
            launcher.end()


def other_of(project: Path) -> Path:
    """The same config under another name."""
    path = project / "other.yaml"
    path.write_text(PLACEMENT.replace("name: beam", "name: other"), encoding="utf-8")
    return path


def screen(config: Path, results: Path, *more: str) -> subprocess.CompletedProcess[str]:
    words = command(config, results, *more, stage="screen")
    return subprocess.run(words, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_a_second_run_on_a_folder_names_the_first_and_a_killed_one_is_reported(project, undisturbed, results, launcher):
    with held(launcher, project, results, "rom") as pid:
        before = {path: path.read_bytes() for path in (results / "beam").glob("*.h5")}
        second = screen(project / "beam.yaml", results)
        assert second.returncode == 2
        assert second.stderr.startswith(f"{results / 'beam'}  another run (process {pid}) is writing to this folder\n")
        assert "wait until it has ended, or give another folder with --results DIR" in second.stderr
        assert {path: path.read_bytes() for path in (results / "beam").glob("*.h5")} == before
        looked = screen(project / "beam.yaml", results, "--dry-run")
        assert looked.returncode == 0
        os.kill(pid, signal.SIGKILL)
        assert launcher.end() == -signal.SIGKILL
        assert (results / "beam" / ".lock").read_text() == f"{pid}\n"
        third = screen(project / "beam.yaml", results)
        assert third.returncode == 0
        said = f"an earlier run (process {pid}) was stopped in {results / 'beam'}; its finished stages are kept"
        assert third.stderr == f"note: {said}\n"
    assert set(compared(results / "beam", undisturbed / "beam")) == names(results / "beam") == SCREENED


@pytest.mark.parametrize("killed", [True, *slowly(False)])
def test_runs_that_share_stages_wait_for_each_other(project, undisturbed, results, launcher, killed):
    """What one is at, the other does not begin; where the one is killed, the other does it."""
    with held(launcher, project, results, "rom") as pid:
        words = command(other_of(project), results, stage="screen")
        other = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        log = results / "other" / LOG
        waits = "other waits for another process that computes rom"
        assert until(lambda: other.poll() is not None or (log.exists() and waits in log.read_text()))
        assert other.poll() is None
        os.kill(pid, signal.SIGKILL if killed else signal.SIGCONT)
        _, err = other.communicate(timeout=PATIENCE)
        assert other.returncode == 0, err
        assert f"note: {waits}\n" in err
        assert launcher.end() == (-signal.SIGKILL if killed else 0)
    assert set(compared(results / "other", undisturbed / "beam")) == names(results / "other") == SCREENED
    if not killed:
        assert set(compared(results / "beam", undisturbed / "beam")) == names(results / "beam") == SCREENED
        assert os.path.samefile(results / "beam" / "rom.h5", results / "other" / "rom.h5")
    assert not of_session(other.pid)

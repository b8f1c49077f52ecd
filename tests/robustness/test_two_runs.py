"""Several processes at the same results, and SIGKILL at any moment: nothing half-written, and the next run goes on."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import time
from collections import Counter
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from strainsight.runner.artefact import header_of
from strainsight.writing import TEMPORARY

from .processes import PATIENCE, Launcher, of_session, until
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
        assert "wait until the other run has finished, or use another folder with --results DIR" in second.stderr
        assert {path: path.read_bytes() for path in (results / "beam").glob("*.h5")} == before
        looked = screen(project / "beam.yaml", results, "--dry-run")
        assert looked.returncode == 0
        os.kill(pid, signal.SIGKILL)
        assert launcher.end() == -signal.SIGKILL
        assert (results / "beam" / ".lock").read_text() == f"{pid}\n"
        third = screen(project / "beam.yaml", results)
        assert third.returncode == 0
        said = f"an earlier run (process {pid}) was interrupted in {results / 'beam'}; its finished stages are kept"
        assert third.stderr == f"note: {said}\n"
    assert set(compared(results / "beam", undisturbed / "beam")) == names(results / "beam") == SCREENED


@pytest.mark.slow
@pytest.mark.parametrize("killed", [True, False])
def test_runs_that_share_stages_wait_for_each_other(project, undisturbed, results, launcher, killed):
    with held(launcher, project, results, "rom") as pid:
        words = command(other_of(project), results, stage="screen")
        other = subprocess.Popen(
            words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        log = results / "other" / LOG
        waits = "other waits for another process to compute rom"
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


KILLS = int(os.environ.get("STRAINSIGHT_KILLS", "18"))
SEED = 10
MOST_DELAY = 0.015
"""[s] after the first byte of a file, within which it is written, synced and renamed."""


@dataclass(frozen=True)
class Moment:
    """When to kill: this long [s] after the stage began, or after a file of it has appeared."""

    run: str
    stage: str
    at_file: bool
    seconds: float


def moments(undisturbed: Path, count: int) -> list[Moment]:
    """Seeded, of all stages in their order: one in each, by turns while it computes and while it writes, then one of the other
    kind, then more, in long stages more often."""
    rng = np.random.default_rng(SEED)
    stages = [
        (run, stage, header_of(undisturbed / run / f"{stage}.h5").seconds)
        for run in ("beam", "bench")
        for stage in re.findall(r" (\w+) starts: ", (undisturbed / run / LOG).read_text())
    ]
    every = range(len(stages))
    drawn = [*((i, i % 2 == 0) for i in every), *((i, i % 2 == 1) for i in every)]
    weight = np.sqrt([seconds for _, _, seconds in stages])
    more = max(0, count - len(drawn))
    drawn += [(i, place % 2 == 0) for place, i in enumerate(rng.choice(len(stages), more, p=weight / weight.sum()))]
    found = []
    for i, at_file in sorted(drawn[:count]):
        run, stage, seconds = stages[i]
        most = MOST_DELAY * (rng.random() < 0.7) if at_file else seconds
        found.append(Moment(run, stage, at_file, rng.uniform(0, most)))
    return found


def kill(launcher: Launcher, moment: Moment, project: Path, results: Path) -> int:
    """Run until that moment; how often it took the stage from its start, because it was done before."""
    for late in range(9):
        if _killed(launcher, moment, project, results):
            return late
        (results / moment.run / f"{moment.stage}.h5").unlink()
        moment = replace(moment, seconds=moment.seconds / 2)
    raise AssertionError(f"no way to hit {moment}")


def _killed(launcher: Launcher, moment: Moment, project: Path, results: Path) -> bool:
    log = results / moment.run / LOG
    before = log.stat().st_size if log.exists() else 0
    pid = launcher.start(["run", str(project / f"{moment.run}.yaml"), "--results", str(results)], project / "says")

    def starts() -> bool:
        return log.exists() and f" {moment.stage} starts: ".encode() in log.read_bytes()[before:]

    assert until(lambda: launcher.has_ended() or starts())
    if moment.at_file:
        until(lambda: launcher.has_ended() or any(name.startswith(TEMPORARY) for name in os.listdir(log.parent)))
    time.sleep(moment.seconds)
    if not launcher.has_ended():
        os.kill(pid, signal.SIGKILL)
    # A busy machine may have gone on to the next stage; one that waits for a file may then have seen that of the next.
    return launcher.end() == -signal.SIGKILL and (moment.at_file or started(log) == moment.stage)


def started(log: Path) -> str:
    return str(re.findall(r" (\w+) starts: ", log.read_text())[-1])


@pytest.mark.slow
def test_whatever_moment_it_is_killed_at_nothing_is_half_and_the_next_run_ends_the_same(
    project, undisturbed, launcher, tmp_path
):
    at, left, late = Counter(), 0, 0
    aims = moments(undisturbed, KILLS)
    for moment in aims:
        folder = tmp_path / moment.run
        late += kill(launcher, moment, project, tmp_path)
        set(compared(folder, undisturbed / moment.run))
        at[moment.run, started(folder / LOG)] += 1
        left += any(path.name.startswith(TEMPORARY) for path in folder.iterdir())
    for run in ("beam", "bench"):
        launcher.start(["run", str(project / f"{run}.yaml"), "--results", str(tmp_path)], project / "says")
        assert launcher.end() == 0, (project / "says").read_text()
        assert set(compared(tmp_path / run, undisturbed / run)) == names(tmp_path / run) == names(undisturbed / run)
    print(f"{KILLS} kills ({late} moments came late), {left} left a file unfinished, in {dict(at)}")
    assert at.total() == KILLS
    assert left >= 0.2 * KILLS
    assert {(aim.run, aim.stage) for aim in aims if not aim.at_file} <= set(at)

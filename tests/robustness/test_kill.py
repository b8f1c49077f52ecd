"""SIGKILL at any moment: what stands under its name is whole, and the next run goes on from there to the same results.

STRAINSIGHT_KILLS=50 pytest tests/robustness/test_kill.py: as many kills as that; without it one in every stage.
"""

from __future__ import annotations

import os
import re
import signal
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from strainsight.workflow.artefact import header_of
from strainsight.writing import TEMPORARY

from .processes import Launcher, until
from .whole import LOG, compared, names

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
    """The stage that was started last."""
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

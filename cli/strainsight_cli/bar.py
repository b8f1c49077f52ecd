"""A progress bar with the remaining time for every active run."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from strainsight.errors import printable
from strainsight_cli.clock import RemainingTime
from strainsight_cli.printing import Level, shown
from strainsight_cli.work import Progress


@contextmanager
def progress_bar(wanted: bool) -> Iterator[Progress]:
    """Progress bars, on a terminal only; yields the callback that updates them: (run, stage, activity, fraction, left)."""
    if not (wanted and shown(Level.INFO) and sys.stderr.isatty()):
        yield lambda run, stage, activity, share, left: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, ProgressColumn, Task, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars
    from rich.text import Text

    class TimeLeft(ProgressColumn):
        """Count down between two updates."""

        max_refresh = 1.0

        def render(self, task: Task) -> Text:
            return Text(task.fields["left"].text(time.time()))

    columns = (
        TextColumn("{task.fields[run]}", markup=False),
        TextColumn("{task.fields[stage]:<9}"),
        BarColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
        TimeLeft(),
    )
    with Bars(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, tuple[str, Any]] = {}

        def move(run: str, stage: str, activity: str, share: float, left: RemainingTime) -> None:
            if not stage:
                bars.remove_task(tasks.pop(run)[1])
                return
            if run in tasks and tasks[run][0] != stage:
                bars.remove_task(tasks[run][1])
            if tasks.get(run, ("",))[0] != stage:
                tasks[run] = stage, bars.add_task("", total=1.0, stage=stage, run=printable(run), left=left)
            bars.update(tasks[run][1], completed=min(max(share, 0.0), 1.0), description=printable(activity), left=left)

        yield move

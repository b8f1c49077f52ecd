"""Remaining time of a stage and of those that follow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from strainsight.errors import ArtefactError

if TYPE_CHECKING:
    from strainsight.runner.stage import Stage

LEAST_SHARE, LEAST_SECONDS = 0.1, 2.0
"""Smallest fraction done and run time [s] for an estimate of the remaining time."""


@dataclass(frozen=True)
class RemainingTime:
    """until: expected end of the stage [s since the epoch]; after: last run time of the following stages [s]. None: unknown."""

    until: float | None = None
    after: float | None = None

    def text(self, now: float) -> str:
        """`about 0:12 of run time left, 1:30 for the next stages`, or nothing."""
        if self.until is None or self.until <= now:
            return ""
        then = f", {spelt(self.after)} for the next stages" if self.after is not None and self.after >= 1.0 else ""
        return f"about {spelt(self.until - now)} of run time left{then}"


def ends_at(started: float, now: float, share: float, last: float | None) -> float | None:
    """Expected end of a stage: from its last run time, or if that is exceeded or unknown, from the fraction done.

    started, now and the result are seconds of the same clock; last [s]."""
    spent = now - started
    if last is not None and spent < last:
        return started + last
    if share < LEAST_SHARE or spent < LEAST_SECONDS:
        return None
    return started + spent / min(share, 1.0)


def seconds_for(artefact: Path) -> float | None:
    """Run time of the stage for the existing file [s]; None without one."""
    from strainsight.runner.artefact import header_of

    try:
        return header_of(artefact).seconds
    except (ArtefactError, OSError):
        return None


def after(stages: Sequence[Stage], at: str, last: Mapping[str, float]) -> float | None:
    """Last run time of the stages after `at` [s]; None if one of them has no file."""
    changed = {at}
    total = 0.0
    names = [stage.name for stage in stages]
    for stage in stages[names.index(at) + 1 :]:
        if stage.name not in last:
            return None
        if changed.intersection(stage.upstream):
            changed.add(stage.name)
            total += last[stage.name]
    return total


def spelt(seconds: float) -> str:
    """`0:12`, `1:02:03`"""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"

"""What a computation gets beside its config: input files, a way to say how far it is, processes for its sweeps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

from strainsight.parallel import Sweep


class Resources(Protocol):
    """files: dotted key of the config ("mesh.file") → path; progress: progress("elimination", 0.4); notice: a sentence for
    the user, at once; sweep: many calls of one function."""

    @property
    def files(self) -> Mapping[str, Path]: ...
    @property
    def progress(self) -> Callable[[str, float], None]: ...
    @property
    def notice(self) -> Callable[[str], None]: ...
    @property
    def sweep(self) -> Sweep: ...


def silent(doing: str, share: float) -> None:
    """Say nothing."""


def of_steps(
    progress: Callable[[str, float], None], doing: str, steps: int, *, first: int = 0, share: float = 1.0
) -> Callable[[int], None]:
    """Called with the number of a step, counted from `first`, reports every fiftieth; share of the whole that all steps are."""

    def report(step: int) -> None:
        if step % 50 == 0:
            progress(doing, share * (first + step) / steps)

    return report

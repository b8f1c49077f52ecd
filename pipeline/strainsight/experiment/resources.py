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

"""What an experiment needs: a system, a reduced structure or a bench with its filter, and resources beside its config."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Protocol

import numpy as np

from strainsight.config.base import Section
from strainsight.parallel import Sweep
from strainsight.sensors.installation import InstallationStd


class TestedSystem(Protocol):
    """A filter on the measurements of one record or several, all with the same m channels.

    measured: of every record (T, ..., m); available (m,): channels that the filter has; parts: channels that can only be left out
    together, as all grids of a gauge.
    """

    @property
    def labels(self) -> Sequence[str]:
        """Of the channels (m,)."""
        ...

    @property
    def available(self) -> np.ndarray: ...

    @property
    def parts(self) -> Sequence[np.ndarray]: ...

    @property
    def measured(self) -> Sequence[np.ndarray]: ...

    def by_others(self, part: np.ndarray) -> tuple[Sequence[tuple[np.ndarray, np.ndarray]], str]:
        """What all other channels say that those of a part (k,) read, and σ of that, (T, ..., k) in every record; or none, and
        why they cannot, in words."""
        ...


def installation_std(tolerances: Section | None) -> InstallationStd:
    """σ of how gauges are installed, in SI units and rad, by the tolerances of a config; 0 of what it does not state."""
    names = [field.name for field in fields(InstallationStd)]
    std = {name: float(value) for name, value in dict(tolerances or {}).items() if name in names}
    return InstallationStd(**std | {"angle": float(np.deg2rad(std.get("angle", 0.0)))})


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

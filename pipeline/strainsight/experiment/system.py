"""Interfaces of experiments: a tested system with its filter, and the resources of a run."""

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
    """A filter on the measurements of one or more records with the same m channels.

    measured: (T, ..., m) of every record; available (m,): channels that the filter uses; parts: groups of channels that are left
    out together, as all grids of a gauge."""

    @property
    def labels(self) -> Sequence[str]:
        """Labels of the channels (m,)."""
        ...

    @property
    def available(self) -> np.ndarray: ...

    @property
    def parts(self) -> Sequence[np.ndarray]: ...

    @property
    def measured(self) -> Sequence[np.ndarray]: ...

    def by_others(self, part: np.ndarray) -> tuple[Sequence[tuple[np.ndarray, np.ndarray]], str]:
        """Predict the channels of a part (k,) from all others: mean and σ (T, ..., k) of every record; or empty, and the
        reason."""
        ...


def installation_std(tolerances: Section | None) -> InstallationStd:
    """σ of gauge installation from the tolerances of a config, in SI units and rad; unset tolerances are 0."""
    names = [field.name for field in fields(InstallationStd)]
    std = {name: float(value) for name, value in dict(tolerances or {}).items() if name in names}
    return InstallationStd(**std | {"angle": float(np.deg2rad(std.get("angle", 0.0)))})


class Resources(Protocol):
    """files: dotted config key ("mesh.file") → path; progress: called as progress("elimination", 0.4); notice: prints a sentence
    at once; sweep: maps a function over many arguments."""

    @property
    def files(self) -> Mapping[str, Path]: ...
    @property
    def progress(self) -> Callable[[str, float], None]: ...
    @property
    def notice(self) -> Callable[[str], None]: ...
    @property
    def sweep(self) -> Sweep: ...


def silent(activity: str, share: float) -> None:
    """Ignore progress."""


def of_steps(
    progress: Callable[[str, float], None], activity: str, steps: int, *, first: int = 0, share: float = 1.0
) -> Callable[[int], None]:
    """Return a callback that reports every fiftieth step; first: offset of the step number; share: of all steps in the whole."""

    def report(step: int) -> None:
        if step % 50 == 0:
            progress(activity, share * (first + step) / steps)

    return report

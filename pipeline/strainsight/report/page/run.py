"""A run as a page of several shows it, whatever it is of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

Scalar = float | int | str | bool


@dataclass(frozen=True)
class Run:
    """One run: name of its config; label, note, study and group as in the suite; at: the value of the key that its study
    varies; reached: its last stage; page: relative link to its own page or None; numbers: stage → its summary; seeds:
    numbers of its estimates that there are once a seed, each (seeds,); warnings: sentences."""

    name: str
    label: str = ""
    note: str = ""
    study: str = ""
    group: str = ""
    at: float | None = None
    reached: str = ""
    page: str | None = None
    numbers: Mapping[str, Mapping[str, Scalar]] = field(default_factory=dict)
    seeds: Mapping[str, np.ndarray] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    @property
    def summary(self) -> Mapping[str, Scalar]:
        """The numbers of its estimates, none where nothing was estimated."""
        return self.numbers.get("validate", {})

    def number(self, name: str) -> float | None:
        """A number of its estimates; None where there is none of that name, true as 1."""
        value = self.summary.get(name)
        return None if value is None or isinstance(value, str) else float(value)

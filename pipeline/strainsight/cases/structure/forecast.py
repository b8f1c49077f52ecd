"""How long the estimate of a long record will take, before it starts, and how far it is by the clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from strainsight.cases.resources import Resources
from strainsight.cases.structure.filtered_test import Filtering, Wants, filtered
from strainsight.errors import NumericalError
from strainsight.sweep.sweep import Sweep

FEW, TRIED = 20, 1000
"""Samples that are filtered before, and that are timed."""
LONG = 20_000
"""Steps from which on a forecast is made; shorter records are done within a minute or so."""
CHECKED, FILTERED, LATER, HELD = 0.4, 0.6, 0.7, 0.95
"""Shares of a short record where channels are checked, where filter and smoother begin and end, and where every gauge has been
left out."""


CHECK, REST = 0.15, 0.45
"""What the checks of channels before a filter and smoother take, and fields and files after it, over these."""


@dataclass(frozen=True)
class Paced:
    """`Resources` whose progress is one by the clock, where the plain shares are those of a short record: `plain` shares, as they
    are stated, are `by_clock` of the way."""

    under: Resources
    plain: tuple[float, ...]
    by_clock: tuple[float, ...]

    @property
    def files(self) -> Mapping[str, Path]:
        return self.under.files

    @property
    def notice(self) -> Callable[[str], None]:
        return self.under.notice

    @property
    def sweep(self) -> Sweep:
        return self.under.sweep

    def progress(self, doing: str, share: float) -> None:
        """Say it by the clock."""
        self.under.progress(doing, float(np.interp(share, self.plain, self.by_clock)))


def paced(using: Resources, spent: float, seconds: float, passes: int, hold_out: bool) -> Paced:
    """By the time spent before the channels are checked, and `seconds` of filter and smoother, of which there are `passes`."""
    parts = [spent, CHECK * seconds, seconds, (passes - 1) * seconds + REST * seconds]
    plain: tuple[float, ...] = (0.0, CHECKED, FILTERED, LATER, 1.0)
    if hold_out:
        parts[3:] = [(passes - 1) * seconds, REST * seconds]
        plain = (0.0, CHECKED, FILTERED, LATER, HELD, 1.0)
    by_clock = np.concatenate([[0.0], np.cumsum(parts) / sum(parts)])
    return Paced(using, plain, tuple(by_clock.tolist()))


def forecast_of(each: Sequence[Filtering], wanted: Wants) -> float | None:
    """Seconds that filter and smoother take of records, once, by those of the first samples; None where it is not long."""
    steps = sum(len(own.test.known) for own in each)
    if steps < LONG:
        return None
    few, first = (replace(each[0], test=each[0].test.first(count)) for count in (FEW, TRIED))
    try:
        filtered(few, wanted=wanted)  # what is compiled is not timed
        before = time.perf_counter()
        filtered(first, wanted=wanted)
    except (NumericalError, np.linalg.LinAlgError):  # the estimate itself says what it cannot follow
        return None
    return (time.perf_counter() - before) * steps / len(first.test.known)


def forecast_in_words(each: Sequence[Filtering], seconds: float) -> str:
    """The same as a sentence."""
    steps = sum(len(own.test.known) for own in each)
    return f"filter and smoother of {steps} steps take about {_in_words(seconds)}, by the first {TRIED} of them"


def _in_words(seconds: float) -> str:
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"

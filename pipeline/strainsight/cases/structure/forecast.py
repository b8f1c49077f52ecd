"""How long the estimate of a long record will take, before it starts."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from strainsight.cases.structure.filtered_test import Filtering, Wants, filtered
from strainsight.errors import NumericalError

FEW, TRIED = 20, 1000
"""Samples that are filtered before, and that are timed."""
LONG = 20_000
"""Steps from which on a forecast is made; shorter records are done within a minute or so."""


def forecast_in_words(each: Sequence[Filtering], passes: int, wanted: Wants) -> str:
    """How long filter and smoother take of records, `passes` times, by those of the first samples; empty where it is not long."""
    steps = sum(len(own.test.known) for own in each)
    if steps < LONG:
        return ""
    few, first = (replace(each[0], test=each[0].test.first(count)) for count in (FEW, TRIED))
    try:
        filtered(few, wanted=wanted)  # what is compiled is not timed
        before = time.perf_counter()
        filtered(first, wanted=wanted)
    except (NumericalError, np.linalg.LinAlgError):  # the estimate itself says what it cannot follow
        return ""
    seconds = passes * (time.perf_counter() - before) * steps / len(first.test.known)
    return f"filter and smoother of {steps} steps take about {_in_words(seconds)}, by the first {len(first.test.known)} of them"


def _in_words(seconds: float) -> str:
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 1.5 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} s"

"""The time of a recording: a signal of every sample, the one interval between them, or a stated rate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.records import Recording
from strainsight.measurements.units import RATES, spelling, time_factor

_COUNTER = re.compile(
    r"#|n|i|k|no\.?|nr\.?|idx|index|(data ?)?points?|row|line|counter|count|(sample|scan|record)s?( ?(no|nr|number|index)\.?)?"
)
"""Names in small letters of columns that count samples."""


def recording_of(
    found: Sequence[tuple[np.ndarray, str | None]],
    channels: Sequence[str],
    path: Path,
    where: str,
    time_unit: str | None,
    rate: float | None = None,
) -> Recording:
    """The recording of signals and their units, that of the time first; where: the place of the time; rate: of the samples [Hz],
    in place of the first signal.

    Raises UserError where the time has no unit or a sample none.
    """
    t, unit = found[0] if rate is None else (np.arange(len(found[0][0])) / rate, "s")
    factor = time_factor(time_unit, unit, where)
    if not np.isfinite(t).all():
        raise UserError(
            f"sample {int(np.argmin(np.isfinite(t))) + 1} of the time is missing",
            where=where,
            remedy="give every sample its time, or drop it",
        )
    units = {name: said for name, (_, said) in zip(channels, found[1:], strict=True)}
    values = {name: read for name, (read, _) in zip(channels, found[1:], strict=True)}
    return Recording(t * factor, values, units, str(path))


def check_no_counter(time: np.ndarray, name: str, unit: str | None, where: str) -> None:
    """Raises UserError where a column without a unit counts samples by its name and its values."""
    if unit is None and _COUNTER.fullmatch(name.strip().lower()) and np.all(np.diff(time) == 1):
        raise UserError(
            f"{name!r} counts samples: {time[0]:g}, {time[0] + 1:g}, … is no time",
            where=where,
            remedy="state the sampling rate in its place: `time: {rate: 100, unit: Hz}`",
        )


def counted(
    scalar: float, samples: int, name: str, time_unit: str | None, found: str | None, where: str
) -> tuple[np.ndarray, str]:
    """Time (samples,) from 0 and its unit, "s", of one number: the interval between samples, or in Hz or kHz their rate.

    name: of the number, for which a word of rates is refused where its unit is one of time.
    """
    if not 0 < scalar < np.inf:
        raise UserError(
            f"{name!r} is {scalar:g}", where=where, remedy="name the interval between samples, or their rate"
        )
    stated = [unit for unit in (time_unit, found) if unit is not None]
    rates = [spelling(unit) for unit in stated if spelling(unit) in RATES]
    if rates and len(rates) == len(stated) and len(set(rates)) == 1:
        return np.arange(samples) / (scalar * RATES[rates[0]]), "s"
    words = name.lower().rpartition(".")[2]
    if rates or words in ("fs", "f_s", "sr", "hz") or any(word in words for word in ("rate", "freq")):
        raise UserError(
            f"the one number {name!r}, {scalar:g}, is taken for the interval between samples in {' and '.join(stated) or 's'}",
            where=where,
            remedy="state `unit: Hz` where it is the sampling rate",
        )
    return scalar * np.arange(samples) * time_factor(time_unit, found, where), "s"

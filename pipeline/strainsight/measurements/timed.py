"""The time of a recording: a signal of every sample, or the one interval between them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.records import Recording
from strainsight.measurements.units import RATES, spelling, time_factor


def recording_of(
    found: Sequence[tuple[np.ndarray, str | None]],
    channels: Sequence[str],
    path: Path,
    where: str,
    time_unit: str | None,
) -> Recording:
    """The recording of signals and their units, that of the time first; where: the place of the time.

    Raises UserError where the time has no unit or a sample none.
    """
    t, unit = found[0]
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

"""Uniform clock of a record: step, gaps, and the step of the filter."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.records import RATES, Recording, spelling, time_factor

JITTER = 0.05
"""Largest deviation of a time stamp from the uniform clock, relative to the step."""
MOST_ODD = 0.01
"""Largest share of time stamps that are corrected, each between two correct ones."""
MOST_FILLED = 10
"""Largest ratio of samples with filled gaps to samples in the file."""
SAME_STEP = 1e-5
"""Largest relative difference of equal steps: quartz accuracy, and the six digits of a UFF58 file."""
FIXED_RATE = (
    "if the logger sampled at a fixed rate and only the time stamps are inexact, specify the rate instead "
    "(`time: {rate: 100, unit: Hz}`, without channel); otherwise resample the record to a uniform clock"
)
FURTHEST = 1e11
"""Largest time [s]."""


@dataclass(frozen=True)
class Clock:
    """t_k = start + k step, k = 0 … count − 1 [s]; row (T,): k of every sample; notes: one sentence for each gap."""

    start: float
    step: float
    count: int
    row: np.ndarray
    notes: tuple[str, ...] = ()

    @property
    def time(self) -> np.ndarray:
        """(count,) [s]."""
        return self.start + self.step * np.arange(self.count)

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Samples (T,) on the clock (count,), NaN between them."""
        if len(values) == self.count:
            return values
        out = np.full(self.count, np.nan)
        out[self.row] = values
        return out


def uniform_clock(recording: Recording) -> Clock:
    """Uniform clock of the time stamps of a record.

    The step is that of a line through the time stamps, initially the mean of the intervals close to their median.
    Longer intervals are gaps: a whole number of steps, within twice JITTER, is filled with rows without samples. A
    single wrong time stamp between two correct ones is corrected with a note. Other intervals, backward steps,
    repeated times, and stamps that deviate by more than JITTER raise UserError with file:line, time and size."""
    _check_range(recording)
    recording, corrected = _without_odd_stamps(recording)
    t = recording.time
    between = np.diff(t)
    _check_order(recording, between)
    median = _median(between)
    # The median of rounded times is rounded too, their mean is not.
    step = float(np.mean(between[np.abs(between - median) <= 2 * JITTER * median]))
    with np.errstate(over="ignore", invalid="ignore"):
        steps = between / step
        whole = np.rint(steps)
        bad = (np.abs(steps - whole) > 2 * JITTER) | (whole < 1)
    if bad.any():
        i, many = int(np.argmax(bad)), bool(np.mean(bad) > 0.01)
        raise UserError(
            f"the time increases by {t[i + 1] - t[i]:.6g} s from {t[i]:.9g} to {t[i + 1]:.9g} s, which is "
            f"{steps[i]:.4g} steps of {step:.6g} s instead of a whole number of steps"
            + ("; many other intervals are irregular too" if many else ""),
            where=recording.place(i + 1),
            remedy=FIXED_RATE if many else "cut the record at this time, or correct the time stamps",
        )
    if (count := float(whole.sum()) + 1) > MOST_FILLED * t.size:
        worst = int(np.argmax(whole))
        raise UserError(
            f"filling the gaps would extend the record from {t.size} to {count:.4g} samples (limit: {MOST_FILLED} "
            f"times as many); the longest gap begins at {t[worst]:.9g} s and lasts {between[worst]:.6g} s",
            where=recording.place(worst + 1),
            remedy="cut the record at the gap, or correct the time stamp after the gap",
        )
    gaps = np.flatnonzero(whole > 1)
    notes = corrected + tuple(
        f"rows without samples were inserted after {t[i]:.9g} s ({int(whole[i]) - 1} in total, {recording.place(int(i) + 1)})"
        for i in gaps[:10]
    )
    if gaps.size > 10:
        notes += (
            f"rows without samples were also inserted in the later gaps (number of gaps: {gaps.size - 10}, number of rows: "
            f"{np.sum(whole[gaps[10:]] - 1):.0f})",
        )
    row = np.concatenate([[0], np.cumsum(whole.astype(np.int64))])
    start, step = _fit_line(t, row)
    _check_stamps(recording, t - (start + step * row), step)
    return Clock(start, step, int(row[-1]) + 1, row, notes)


def to_step(clock: Clock, step: float) -> tuple[Clock, np.ndarray, tuple[str, ...]]:
    """Clock with the step of the filter [s], the samples (k,) on it, and notes.

    Only integer ratios are allowed: a finer step leaves rows without samples between those of the record, a coarser one uses
    every k-th sample unchanged, without averaging, because a measurement is instantaneous. Nothing is interpolated. Raises
    UserError if the ratio is not an integer within SAME_STEP, or within JITTER of a step at the end of the record."""
    ratio = step / clock.step
    k = round(max(ratio, 1 / ratio))
    if abs(max(ratio, 1 / ratio) / k - 1) > max(SAME_STEP, JITTER / clock.count):
        near = clock.step * k if ratio >= 1 else clock.step / k
        raise UserError(
            f"the time step {step:.9g} s of the filter is not an integer multiple or fraction of the sampling interval "
            f"{clock.step:.9g} s of the record (ratio {ratio:.7g})",
            remedy=f"set `estimate.time_step` to an integer multiple or fraction such as {near:.9g}, or resample the record",
        )
    ppm = 1e6 * (max(ratio, 1 / ratio) / k - 1)
    notes = (
        (
            f"the sampling interval differs from the time step {step:g} s of the filter by {abs(ppm):.2g} ppm (neglected)",
        )
        if abs(ppm) > 0.1
        else ()
    )
    if ratio < 1 or k == 1:
        if k > 1:
            note = (
                f"rows without samples were inserted between consecutive samples ({k - 1} each), because the sampling interval "
                f"is {clock.step:g} s and the time step of the filter {step:g} s"
            )
            notes = (*notes, note)
        return Clock(clock.start, step, (clock.count - 1) * k + 1, clock.row * k), np.arange(len(clock.row)), notes
    used = np.flatnonzero(clock.row % k == 0)
    note = f"one in {k} samples of the record was used: frequencies above {0.5 / step:g} Hz cause aliasing"
    return Clock(clock.start, step, (clock.count - 1) // k + 1, clock.row[used] // k), used, (*notes, note)


def _check_range(recording: Recording) -> None:
    furthest = int(np.argmax(np.abs(recording.time)))
    if abs(recording.time[furthest]) > FURTHEST:
        raise UserError(
            f"the time {recording.time[furthest]:.6g} s is more than 3000 years",
            where=recording.place(furthest),
            remedy="correct the time stamp, or the unit of time",
        )


def _median(between: np.ndarray) -> float:
    """Lower median, which is an interval of the record."""
    middle = (len(between) - 1) // 2
    return float(np.partition(between, middle)[middle])


def _without_odd_stamps(recording: Recording) -> tuple[Recording, tuple[str, ...]]:
    """Correct single wrong time stamps whose neighbours are two steps apart to the middle; one note for each."""
    t = recording.time
    between, two = np.diff(t), t[2:] - t[:-2]
    step = _median(between)
    off = (np.abs(between - step) > 2 * JITTER * step) & (between > 0)
    odd = np.flatnonzero(off[:-1] & off[1:] & (np.abs(two - 2 * step) <= 2 * JITTER * step)) + 1
    if not odd.size or odd.size > MOST_ODD * t.size or np.any(np.diff(odd) == 1):
        return recording, ()
    time = t.copy()
    time[odd] = (t[odd - 1] + t[odd + 1]) / 2
    notes = tuple(
        f"the time {t[i]:.9g} s ({recording.place(int(i))}) is not on the uniform clock, so {time[i]:.9g} s was used"
        for i in odd[:10]
    )
    return replace(recording, time=time), notes


def _check_order(recording: Recording, between: np.ndarray) -> None:
    if not (wrong := np.flatnonzero(between <= 0)).size:
        return
    i = int(wrong[0])
    t, where = recording.time, recording.place(i + 1)
    more = f"; {wrong.size} time stamps are not later than the previous one" if wrong.size > 1 else ""
    if between[i] == 0:
        raise UserError(
            f"the time {t[i]:.9g} s occurs twice{more}",
            where=where,
            remedy=f"write the time with more digits; {FIXED_RATE}"
            if wrong.size > 1
            else "remove the repeated sample, or write the time with more digits",
        )
    raise UserError(
        f"the time decreases by {-between[i]:.6g} s, from {t[i]:.9g} to {t[i + 1]:.9g} s{more}",
        where=where,
        remedy="sort the record, or cut it where the clock was reset",
    )


def _fit_line(t: np.ndarray, row: np.ndarray) -> tuple[float, float]:
    """Start and step of the least-squares line through the time stamps."""
    middle, centre = row.mean(), t.mean()
    step = float(np.dot(row - middle, t - centre) / np.dot(row - middle, row - middle))
    return float(centre - step * middle), step


def _check_stamps(recording: Recording, off: np.ndarray, step: float) -> None:
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) > JITTER * step:
        raise UserError(
            f"the time {recording.time[worst]:.9g} s deviates by {100 * abs(off[worst]) / step:.3g} % of a step "
            f"(limit {100 * JITTER:g} %) from the uniform clock with step {step:.6g} s",
            where=recording.place(worst),
            remedy=f"write the time with more digits; {FIXED_RATE}",
        )


_INSTANT = re.compile(
    r"(?:(?P<date>[\w./-]+(?: [A-Za-z]{3,9}\.? \d{2,4})?)(?:T|\s+|(?<=\d)_))?"
    r"(?P<hour>\d{1,2}):(?P<minute>\d{2}):(?P<second>\d{2})(?:[.,](?P<fraction>\d{1,12})|:(?P<milli>\d{3}))?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|[+-]\d{2}:?\d{2})?"
)
_YEAR_FIRST = re.compile(r"(\d{4})([-/.])(\d{1,2})\2(\d{1,2})")
SECOND, DAY = 10**9, 86400 * 10**9
"""[ns]."""


class ClockTimes:
    """Seconds since the first time of a column, with nanosecond resolution.

    Supported are 2024-05-03T10:00:00.01+02:00, 2024/5/3 10:00:00,01, 03.05.2024 10:00:00 and 10:00:00.01 PM. If day and month
    are ambiguous, only a change of the date is used: together with a clock time that passes midnight it means the next day."""

    def __init__(self) -> None:
        self._first: int | None = None
        self._date, self._of_day, self._day = "", 0, 0

    @property
    def started(self) -> bool:
        """Whether a time has been read."""
        return self._first is not None

    def seconds(self, cell: str) -> float | None:
        """Seconds of one cell; None if it is not a time, or its date does not follow the previous cell."""
        match = _INSTANT.fullmatch(cell)
        if match is None or (of_day := _time_of_day(match)) is None:
            return None
        text = match["date"] or ""
        year_first = _YEAR_FIRST.fullmatch(text)
        midnight = self.started and self._of_day - of_day > DAY // 2
        if year_first:
            try:
                day = date(*(int(year_first[i]) for i in (1, 3, 4))).toordinal()
            except ValueError:
                return None
        else:
            if self.started and text and (text != self._date) != midnight:
                return None
            day = self._day + midnight
        zone = match["zone"] or "Z"
        east = 0 if zone == "Z" else int(zone[0] + "1") * (int(zone[1:3]) * 60 + int(zone[-2:]))
        instant = day * DAY + of_day - east * 60 * SECOND
        self._date, self._of_day, self._day = text, of_day, day
        if self._first is None:
            self._first = instant
        return (instant - self._first) / SECOND


def _time_of_day(match: re.Match[str]) -> int | None:
    """Time [ns] since midnight; None if it is not valid."""
    hour, minute, second = (int(match[name]) for name in ("hour", "minute", "second"))
    if match["half"]:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + 12 * (match["half"][0] in "Pp")
    if hour > 23 or minute > 59 or second > 60:
        return None
    fraction = (match["fraction"] or match["milli"] or "").ljust(9, "0")[:9]
    return ((hour * 60 + minute) * 60 + second) * SECOND + int(fraction)


_COUNTER = re.compile(
    r"#|n|i|k|no\.?|nr\.?|idx|index|(data ?)?points?|row|line|counter|count|(sample|scan|record)s?( ?(no|nr|number|index)\.?)?"
)
"""Names, in small letters, of columns that count samples."""


def recording_of(
    signals: Sequence[tuple[np.ndarray, str | None]],
    channels: Sequence[str],
    path: Path,
    where: str,
    time_unit: str | None,
    rate: float | None = None,
    lines: np.ndarray | None = None,
) -> Recording:
    """Recording of signals and their units, the time first; where: place of the time; rate: sampling rate [Hz] instead of the
    first signal; lines: as in `Recording`. Raises UserError if the time has no unit or a sample has no time."""
    t, unit = signals[0] if rate is None else (np.arange(len(signals[0][0])) / rate, "s")
    factor = time_factor(time_unit, unit, where)
    if not np.isfinite(t).all():
        raise UserError(
            f"sample {int(np.argmin(np.isfinite(t))) + 1} has no time",
            where=where,
            remedy="specify a time for every sample, or remove the sample",
        )
    units = {name: unit_in_file for name, (_, unit_in_file) in zip(channels, signals[1:], strict=True)}
    values = {name: read for name, (read, _) in zip(channels, signals[1:], strict=True)}
    no_lines = np.zeros((0, 2), np.int64)
    return Recording(t * factor, values, units, str(path), no_lines if lines is None else lines)


def check_no_counter(time: np.ndarray, name: str, unit: str | None, where: str) -> None:
    """Raise UserError if a column without unit counts samples, according to its name and values."""
    if unit is None and _COUNTER.fullmatch(name.strip().lower()) and np.all(np.diff(time) == 1):
        raise UserError(
            f"column {name!r} counts samples ({time[0]:g}, {time[0] + 1:g}, …) instead of defining the time",
            where=where,
            remedy="specify the sampling rate instead: `time: {rate: 100, unit: Hz}`",
        )


def time_from_number(
    scalar: float, samples: int, name: str, time_unit: str | None, unit_in_file: str | None, where: str
) -> tuple[np.ndarray, str]:
    """Time (samples,) from 0 and its unit "s", from one number: the sampling interval, or, with unit Hz or kHz, the sampling
    rate. name: name of the number; a name that suggests a rate is refused with a unit of time."""
    if not 0 < scalar < np.inf:
        raise UserError(
            f"{name!r}, the sampling interval or sampling rate, is {scalar:g}, not positive",
            where=where,
            remedy="correct this number in the file",
        )
    units = [unit for unit in (time_unit, unit_in_file) if unit is not None]
    rates = [spelling(unit) for unit in units if spelling(unit) in RATES]
    if rates and len(rates) == len(units) and len(set(rates)) == 1:
        return np.arange(samples) / (scalar * RATES[rates[0]]), "s"
    words = name.lower().rpartition(".")[2]
    if rates or words in ("fs", "f_s", "sr", "hz") or any(word in words for word in ("rate", "freq")):
        raise UserError(
            f"{name!r} = {scalar:g} may be a sampling rate or a sampling interval: its unit is "
            f"{' and '.join(units) or 'missing'}",
            where=where,
            remedy="set `time: {unit: Hz}` for a sampling rate; otherwise correct the name or the unit in the file",
        )
    return scalar * np.arange(samples) * time_factor(time_unit, unit_in_file, where), "s"


WHOLE = 0.01
"""Largest deviation of a delay from a whole number of samples, in samples, due to rounding."""


@dataclass(frozen=True)
class Delay:
    """Delay of a channel, samples + seconds; negative values mean early."""

    samples: int = 0
    seconds: float = 0.0

    def steps(self, step: float, count: int) -> int:
        """Delay in samples of a channel with `count` samples and time step [s]. Raises UserError if it is not an
        integer, or leaves no sample."""
        exact = self.samples + self.seconds / step
        if abs(exact) >= count:
            raise UserError(
                f"the delay is {exact:.6g} samples, but the record has only {count} samples",
                remedy="set a `delay` shorter than the record",
            )
        whole = round(exact)
        if abs(exact - whole) > WHOLE:
            raise UserError(
                f"a delay of {self.seconds:g} s is {exact:.4g} samples of {step:.6g} s, but must be a "
                "whole number of samples",
                remedy=f"set `delay: {{seconds: {whole * step:.6g}}}` or `delay: {{samples: {whole}}}`",
            )
        return whole


NO_DELAY = Delay()


def shifted(values: np.ndarray, n: int) -> np.ndarray:
    """Shift a channel (T,) that is n samples late to its correct time: v(t + n), NaN outside the record."""
    result = np.full(len(values), np.nan)
    if n >= 0:
        result[: len(values) - n] = values[n:]
    else:
        result[-n:] = values[:n]
    return result

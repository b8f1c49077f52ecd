"""Convert a recording with channel settings to SI signals on the clock of the filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strainsight.errors import UserError, blame, did_you_mean
from strainsight.measurements.calibration import ChannelSettings, calibrate
from strainsight.measurements.clock import shifted, to_step, uniform_clock
from strainsight.measurements.records import Recording, check_no_infinity, missing_error, quote

STRETCH = 20
"""Number of consecutive missing samples from which a note has their place."""
FEWEST = 10
"""Smallest number of value changes from which their spacing is evaluated."""
MOST = 0.95
"""Share of the changes that must be at multiples of one interval, or of one and the next."""
USUAL = 0.5
"""Share of the runs that must have this interval, and of the changes that must exceed the resolution of the channel."""


@dataclass(frozen=True)
class Signals:
    """time (K,) [s], uniform; values (K, c) [SI], NaN without sample; names and quantities (c,); notes."""

    time: np.ndarray
    values: np.ndarray
    names: tuple[str, ...]
    quantities: tuple[str, ...]
    notes: tuple[str, ...]


def assemble(recording: Recording, settings: Mapping[str, ChannelSettings], step: float | None = None) -> Signals:
    """Channels in the order of `settings`, calibrated and on a uniform clock: that of the file, or one with `step` [s].

    Raises UserError for a missing channel, a wrong unit, and a clock that is not uniform; `key` is the channel name
    for errors in its settings or values."""
    clock = written = uniform_clock(recording)
    notes = list(clock.notes)
    used = np.arange(len(clock.row))
    if step is not None:
        clock, used, step_notes = to_step(clock, step)
        notes.extend(step_notes)
    values = np.empty((clock.count, len(settings)))
    for column, (name, channel_settings) in enumerate(settings.items()):
        if name not in recording.channels:
            raise UserError(
                f"channel {name!r} not found",
                where=recording.source,
                remedy=did_you_mean(name, recording.channels, f"the file contains {', '.join(recording.channels)}"),
            )
        with blame(name):
            calibrated, done = calibrate(recording, name, channel_settings)
            if not channel_settings.override:
                calibrated, more = remove_repeated_samples(name, calibrated, written.step)
                notes.extend(more)
        if (missing := np.isnan(calibrated)).any():
            notes.append(f"{name}: missing samples in the file: {missing.sum()} of {missing.size}")
            notes.extend(_stretch(name, missing, recording.time))
        notes.extend(done)
        with blame(name):
            late = channel_settings.delay.steps(written.step, written.count)
        if late:
            on_clock = shifted(written.spread(calibrated), late)
            notes.append(
                f"{name}: a {'delay' if late > 0 else 'lead'} of {abs(late)} sample{'s' * (abs(late) != 1)} was corrected; the "
                f"{'last' if late > 0 else 'first'} {abs(late) * written.step:.6g} s have no samples"
            )
            values[:, column] = on_clock if step is None else clock.spread(on_clock[written.row[used]])
        else:
            values[:, column] = clock.spread(calibrated[used])
    names = tuple(settings)
    return Signals(clock.time, values, names, tuple(settings[name].quantity for name in names), tuple(notes))


def _stretch(name: str, missing: np.ndarray, time: np.ndarray) -> tuple[str, ...]:
    """Note on the longest run of missing samples, if it is long."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    first, behind = ends[::2], ends[1::2]
    longest = int(np.argmax(behind - first))
    if (count := int(behind[longest] - first[longest])) < STRETCH:
        return ()
    start, end = time[first[longest]], time[behind[longest] - 1]
    return (
        f"{name}: all {count} samples from {start:.9g} to {end:.9g} s are missing; in this "
        "interval, only the other channels are used",
    )


@dataclass(frozen=True)
class RepeatedSamples:
    """fresh (T,): samples without repetitions; interval between them, in samples; regular: whether all intervals are equal."""

    fresh: np.ndarray
    interval: int
    regular: bool


def find_repeated_samples(values: np.ndarray) -> RepeatedSamples | None:
    """Repeated samples of a channel (T,), NaN where missing, or None if every sample is new.

    Even in a channel that is constant for a while, most changes are multiples of the interval apart. A channel that
    changes by its resolution from sample to sample is not one with repetitions."""
    present = np.flatnonzero(np.isfinite(values))
    if len(present) < FEWEST or present[-1] + 1 - present[0] > len(present) / MOST:
        return None
    # a missing sample in between is not a change
    filled = values[present[np.maximum(np.searchsorted(present, np.arange(len(values)), side="right") - 1, 0)]]
    change = np.diff(filled)
    at = np.flatnonzero(change) + 1
    if len(at) < FEWEST:
        return None
    runs, size = np.diff(at), np.abs(change[at - 1])
    interval = int(np.argmax(np.bincount(runs)))
    if interval < 2 or np.mean(size > 1.5 * size.min()) < USUAL:
        return None
    phase = int(np.argmax(np.bincount(at % interval)))
    fresh = np.zeros(len(values), dtype=bool)
    if np.mean(at % interval == phase) >= MOST and np.mean(runs == interval) >= USUAL:
        fresh[phase::interval] = True
        return RepeatedSamples(fresh, interval, True)
    near = np.bincount(np.concatenate([runs, runs + 1]))
    interval = int(np.argmax(near)) - 1
    if interval >= 2 and np.mean((runs == interval) | (runs == interval + 1)) >= MOST:
        fresh[at] = True
        return RepeatedSamples(fresh, interval, False)
    return None


def remove_repeated_samples(name: str, values: np.ndarray, step: float) -> tuple[np.ndarray, tuple[str, ...]]:
    """Replace repeated samples of a channel (T,) with time step `step` [s] by NaN; returns values and a note. Raises UserError
    if the intervals between samples differ."""
    if (repeated := find_repeated_samples(values)) is None:
        return values, ()
    n = repeated.interval
    if not repeated.regular:
        raise UserError(
            f"channel {name!r} contains every sample {n} or {n + 1} times: it was sampled at {1 / (step * (n + 1)):.4g} "
            f"to {1 / (step * n):.4g} Hz and written at a higher rate, so the delays of its samples differ",
            remedy="export all channels at one rate, resampled after an anti-aliasing filter; if the repeated values "
            "are real, set `override: true` for this channel",
        )
    note = (
        f"{name}: the file contains every sample {n} times, so the channel was sampled at {1 / (step * n):.4g} Hz and has a "
        f"mean delay of {(n - 1) / 2:g} samples. The first of {n} equal samples is used; the others are marked as missing"
    )
    return np.where(repeated.fresh, values, np.nan), (note,)


SAME_RATE = 1e-6
"""Largest difference of time stamps of one clock, relative to the step."""


class Place(NamedTuple):
    """Place of a channel: group, name, and group number from 0."""

    group: str
    name: str
    number: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channel in a config: "G1", "rig/G1", "0/G1"."""
        longer = (f"{self.group}/{self.name}",) if self.group else ()
        return (self.name, *longer, f"{self.number}/{self.name}")


def find_channel(name: str, places: Sequence[Place], path: Path) -> int:
    """Index of the channel with this name, with or without its group in front. Raises UserError if there is no such channel, or
    several."""
    for length in range(3):
        matches = [i for i, place in enumerate(places) if name in place.names[length : length + 1]]
        if len(matches) == 1:
            return matches[0]
        if matches:
            groups = [places[i].group for i in matches]
            alone = [g and groups.count(g) == 1 for g in groups]
            full_names = [places[i].names[1 if one else -1] for i, one in zip(matches[:10], alone, strict=False)]
            raise UserError(
                f"{len(matches)} channels have the name {name!r}",
                where=str(path),
                remedy=f"specify group and channel: {' or '.join(map(quote, full_names))}{' …' if len(matches) > 10 else ''}",
            )
    known = list(dict.fromkeys(word for place in places for word in place.names[:2]))
    raise missing_error("channel", name, known, str(path), [place.names[0] for place in places])


def check_one_clock(clocks: Mapping[str, np.ndarray], path: Path) -> None:
    """Raise UserError unless all channels, name → times (T,) [s], have the same time."""
    first, *others = clocks.values()
    if all(_same(first, other) for other in others):
        return
    rates: dict[str, list[str]] = {}
    for name, t in clocks.items():
        rate = (len(t) - 1) / (t[-1] - t[0]) if len(t) > 1 and t[-1] > t[0] else 0.0
        rates.setdefault(f"{rate:.6g} Hz", []).append(quote(name))
    if len(rates) > 1:
        listed_rates = ", ".join(
            f"{rate} ({', '.join(names[:8])}{', …' * (len(names) > 8)})" for rate, names in rates.items()
        )
        raise UserError(
            f"the channels have {len(rates)} different sampling rates: {listed_rates}",
            where=str(path),
            remedy="use channels with the same sampling rate, or export the record with all channels resampled to one rate",
        )
    name, t = next((name, t) for name, t in clocks.items() if not _same(first, t))
    two = {next(iter(clocks)): first, name: t}
    spans = [
        f"{quote(channel)} has {len(time)} samples from {_at(time, 0)} to {_at(time, -1)} s"
        for channel, time in two.items()
    ]
    raise UserError(
        "the channels have different sampling times: " + ", ".join(spans),
        where=str(path),
        remedy="use channels with the same sampling times, or export the record with all channels cut and resampled to them",
    )


def _same(t: np.ndarray, other: np.ndarray) -> bool:
    if t is other:
        return True
    if t.shape != other.shape:
        return False
    return not t.size or bool(np.allclose(t, other, rtol=0, atol=SAME_RATE * abs(t[-1] - t[0]) / t.size))


def _at(t: np.ndarray, index: int) -> str:
    return f"{t[index]:g}" if len(t) else "nowhere"


def numbers(values: np.ndarray, name: str, where: str) -> np.ndarray:
    """The samples of a channel as numbers (T,). Raises UserError if they are not finite numbers."""
    if values.dtype.kind not in "iuf" or values.ndim != 1:
        kind = values.dtype.kind
        special = "dates and times" if kind == "M" else "text or objects" if kind == "O" else "text"
        other = f"values of shape {values.shape[1:]}" if values.ndim != 1 else f"values of type {values.dtype}"
        description = special if kind in "MOSU" else other
        raise UserError(
            f"channel {name!r} contains {description} instead of numbers",
            where=where,
            remedy="use a channel with one real number per sample",
        )
    samples = values.astype(float)
    check_no_infinity(samples, name, where)
    return samples

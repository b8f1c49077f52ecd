"""A recording and what its channels are → SI signals on the clock of the filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strainsight.errors import UserError, blame, did_you_mean
from strainsight.measurements.calibration import ChannelSettings, calibrate
from strainsight.measurements.clock import shifted, to_step, uniform_clock
from strainsight.measurements.records import Recording, check_no_infinity, missing, plain

STRETCH = 20
"""Samples missing in a row of which the record says where they are."""
FEWEST = 10
"""Changes of a value from which their spacing shows."""
MOST = 0.95
"""Share of the changes that is at multiples of one interval, or of one and the next."""
USUAL = 0.5
"""Share of the runs that is as long as that interval, and of the changes that are larger than the resolution of the channel."""


@dataclass(frozen=True)
class Signals:
    """time (K,) [s], uniform; values (K, c) [SI], NaN where no sample is; names and quantities (c,); notes: sentences."""

    time: np.ndarray
    values: np.ndarray
    names: tuple[str, ...]
    quantities: tuple[str, ...]
    notes: tuple[str, ...]


def assemble(
    recording: Recording,
    settings: Mapping[str, ChannelSettings],
    step: float | None = None,
) -> Signals:
    """Channels in the order of `settings`, calibrated and on a uniform clock: that of the file, or one of `step` [s].

    Raises UserError where a channel is not in the recording, its unit is another one,
    or the clock is not uniform; `key` is the name of the channel where the fault is in its settings or values.
    """
    clock = written = uniform_clock(recording)
    notes = list(clock.notes)
    taken = np.arange(len(clock.row))
    if step is not None:
        clock, taken, said = to_step(clock, step)
        notes.extend(said)
    values = np.empty((clock.count, len(settings)))
    for column, (name, stated) in enumerate(settings.items()):
        if name not in recording.channels:
            raise UserError(
                f"no channel {name!r}",
                where=recording.source,
                remedy=did_you_mean(name, recording.channels, f"it has {', '.join(recording.channels)}"),
            )
        with blame(name):
            calibrated, done = calibrate(recording, name, stated)
            if not stated.override:
                calibrated, more = release(name, calibrated, written.step)
                notes.extend(more)
        missing = np.isnan(calibrated)
        if missing.any():
            notes.append(f"{name}: {np.count_nonzero(missing)} of {len(calibrated)} samples are missing")
            notes.extend(_stretch(name, missing, recording.time))
        notes.extend(done)
        with blame(name):
            late = stated.delay.steps(written.step, written.count)
        if late:
            on_clock = shifted(written.spread(calibrated), late)
            notes.append(
                f"{name}: {abs(late)} samples {'late' if late > 0 else 'early'}, put at its own time: it has none for the "
                f"{'last' if late > 0 else 'first'} {abs(late) * written.step:.6g} s"
            )
            values[:, column] = on_clock if step is None else clock.spread(on_clock[written.row[taken]])
        else:
            values[:, column] = clock.spread(calibrated[taken])
    names = tuple(settings)
    return Signals(clock.time, values, names, tuple(settings[name].quantity for name in names), tuple(notes))


def _stretch(name: str, missing: np.ndarray, time: np.ndarray) -> tuple[str, ...]:
    """A sentence on the longest stretch of samples that are missing, if it is long."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    first, behind = ends[::2], ends[1::2]
    longest = int(np.argmax(behind - first))
    if (count := int(behind[longest] - first[longest])) < STRETCH:
        return ()
    start, end = time[first[longest]], time[behind[longest] - 1]
    return (
        f"{name}: {count} of them in a row, from {start:.9g} to {end:.9g} s, where the other channels have to do without it",
    )


@dataclass(frozen=True)
class Held:
    """fresh (T,): samples that are no repetition; interval: between them, in samples; regular: whether it is the same for all."""

    fresh: np.ndarray
    interval: int
    regular: bool


def held_samples(values: np.ndarray) -> Held | None:
    """Of a channel (T,), NaN where missing, whose values come in runs; None of one that has a value of its own at every sample.

    Of a channel that stands still for a while most changes are still a multiple of the interval apart. One that moves by its
    resolution, sample by sample, is none that is held.
    """
    there = np.flatnonzero(np.isfinite(values))
    if len(there) < FEWEST or there[-1] + 1 - there[0] > len(there) / MOST:
        return None
    # a sample that is missing in between is no change
    filled = values[there[np.maximum(np.searchsorted(there, np.arange(len(values)), side="right") - 1, 0)]]
    change = np.diff(filled)
    at = np.flatnonzero(change) + 1
    if len(at) < FEWEST:
        return None
    runs, size = np.diff(at), np.abs(change[at - 1])
    interval = int(np.argmax(np.bincount(runs)))
    coarse = np.mean(size > 1.5 * size.min()) < USUAL
    if interval < 2 or coarse:
        return None
    phase = int(np.argmax(np.bincount(at % interval)))
    fresh = np.zeros(len(values), dtype=bool)
    if np.mean(at % interval == phase) >= MOST and np.mean(runs == interval) >= USUAL:
        fresh[phase::interval] = True
        return Held(fresh, interval, True)
    near = np.bincount(np.concatenate([runs, runs + 1]))
    interval = int(np.argmax(near)) - 1
    if interval >= 2 and np.mean((runs == interval) | (runs == interval + 1)) >= MOST:
        fresh[at] = True
        return Held(fresh, interval, False)
    return None


def release(name: str, values: np.ndarray, step: float) -> tuple[np.ndarray, tuple[str, ...]]:
    """A channel (T,) sampled every `step` [s] without repetitions of its last value, NaN in their place, and a sentence on it.

    Raises UserError where the intervals between its samples differ.
    """
    held = held_samples(values)
    if held is None:
        return values, ()
    n = held.interval
    if not held.regular:
        raise UserError(
            f"the samples of {name!r} come in runs of {n} and {n + 1} equal ones: a channel of {1 / (step * (n + 1)):.4g} to "
            f"{1 / (step * n):.4g} Hz whose last value is repeated, each by another time late",
            remedy="write the channels at one rate, resampled behind an anti-aliasing filter; of a channel that did read this, "
            "state `override: true`",
        )
    note = (
        f"{name}: its samples come in runs of {n} equal ones, a channel of {1 / (step * n):.4g} Hz whose last value is repeated, "
        f"(n − 1)/2 = {(n - 1) / 2:g} samples late on average; the first of each run was taken, the others are missing"
    )
    return np.where(held.fresh, values, np.nan), (note,)


SAME_RATE = 1e-6
"""Share of a step by which time stamps of one clock may differ."""


class Place(NamedTuple):
    """Where a channel is: group and name, and the number of its group, from 0."""

    group: str
    name: str
    number: int

    @property
    def names(self) -> tuple[str, ...]:
        """What it may be asked for by: "G1", "rig/G1", "0/G1"."""
        longer = (f"{self.group}/{self.name}",) if self.group else ()
        return (self.name, *longer, f"{self.number}/{self.name}")


def chosen(name: str, places: Sequence[Place], path: Path) -> int:
    """Which of the places a name means: that of a channel alone, where one has it, or with its group in front.

    Raises UserError where there is none, or several.
    """
    for length in range(3):
        found = [i for i, place in enumerate(places) if name in place.names[length : length + 1]]
        if len(found) == 1:
            return found[0]
        if found:
            groups = [places[i].group for i in found]
            alone = [g and groups.count(g) == 1 for g in groups]
            said = [places[i].names[1 if one else -1] for i, one in zip(found[:10], alone, strict=False)]
            raise UserError(
                f"{len(found)} channels are called {name!r}",
                where=str(path),
                remedy=f"name the group too: {' or '.join(map(plain, said))}{' …' if len(found) > 10 else ''}",
            )
    known = list(dict.fromkeys(word for place in places for word in place.names[:2]))
    raise missing("channel", name, known, str(path), [place.names[0] for place in places])


def check_one_clock(clocks: Mapping[str, np.ndarray], path: Path) -> None:
    """Raise UserError unless all channels, name → times (T,) [s], have one and the same time."""
    first, *others = clocks.values()
    if all(_same(first, other) for other in others):
        return
    rates: dict[str, list[str]] = {}
    for name, t in clocks.items():
        rate = (len(t) - 1) / (t[-1] - t[0]) if len(t) > 1 and t[-1] > t[0] else 0.0
        rates.setdefault(f"{rate:.6g} Hz", []).append(plain(name))
    if len(rates) > 1:
        said = ", ".join(f"{rate} ({', '.join(names[:8])}{', …' * (len(names) > 8)})" for rate, names in rates.items())
        raise UserError(
            f"the channels have {len(rates)} sampling rates: {said}",
            where=str(path),
            remedy="take channels of one rate, or export the record with all of them resampled to one",
        )
    name, t = next((name, t) for name, t in clocks.items() if not _same(first, t))
    two = {next(iter(clocks)): first, name: t}
    spans = [f"{plain(n)} has {len(x)} samples from {_at(x, 0)} to {_at(x, -1)} s" for n, x in two.items()]
    raise UserError(
        ", ".join(spans),
        where=str(path),
        remedy="take channels of one clock, or export the record with all of them cut and resampled to one",
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
    """The samples of a channel as numbers (T,). Raises UserError where they are none, or infinite."""
    if values.dtype.kind not in "iuf" or values.ndim != 1:
        held = {"O": "text or objects", "S": "text", "U": "text", "M": "times of the day"}.get(values.dtype.kind)
        said = held or (
            f"values of the shape {values.shape[1:]} each" if values.ndim != 1 else f"values of type {values.dtype}"
        )
        raise UserError(
            f"{name!r} holds {said}, not numbers", where=where, remedy="take a channel with one real number a sample"
        )
    found = values.astype(float)
    check_no_infinity(found, name, where)
    return found

"""A recording and what its channels are → SI signals on the clock of the filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.errors import UserError, blame, did_you_mean
from strainsight.measurements.calibration import ChannelSettings, calibrate
from strainsight.measurements.clock import to_step, uniform_clock
from strainsight.measurements.delay import shifted
from strainsight.measurements.held import release
from strainsight.measurements.records import Recording

STRETCH = 20
"""Samples missing in a row of which the record says where they are."""


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

"""Known loads of a test between their samples: as the filter holds them, and how far that may be off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from strainsight.errors import ConfigError
from strainsight.measurements.assemble import Signals
from strainsight.signals.histories import quadratic_hold
from strainsight.signals.interpolation import fill_gaps, interpolate, join_by_lines, share_above

LONGEST_GAP = 10
"""Samples of a known load that may be missing in a row, or twice as many as are missing as a rule, as in a table of two rates."""
BAND = 0.3
"""Of the sampling rate of a load: up to there the samples determine what is between them to 2e-3."""
HELD, FINEST = 0.1, 3
"""Of the rate of the filter's steps: up to there the polynomial that holds a load within a step is off by 2e-3 of it at most,
and what modes near that rate make of it does not matter. And the most steps a sample for it, which BAND asks for."""
SLIGHT, LARGEST = 0.05, 0.25
"""RMS of a load beyond BAND or HELD, over all of it, from which it matters, and is refused."""


def common_part(signals: Signals, first: int, moved: Sequence[bool], start: str) -> Signals:
    """The record from the first to the last instant at which all known loads, its columns from `first` on, have a sample, where
    they lack a few at its ends, as in a table of two rates, or were moved in time. start: of the config.

    Raises ConfigError where a structure at rest does not begin so.
    """
    count, begin, end = len(signals.time), 0, len(signals.time)
    for values, delayed in zip(signals.values[:, first:].T, moved, strict=True):
        there = np.flatnonzero(np.isfinite(values))
        if len(there) < 2:
            return signals
        if delayed or max(there[0], count - 1 - there[-1]) <= LONGEST_GAP:
            begin, end = max(begin, int(there[0])), min(end, int(there[-1]) + 1)
    if end - begin in (count, 0, 1):
        return signals
    if start == "rest" and begin:
        raise ConfigError(
            f"the first {signals.time[begin] - signals.time[0]:g} s are cut off, where a known load has no sample, and what is "
            "left does not begin at rest",
            key="estimate.start",
            remedy="take moving",
        )
    note = f"{count - (end - begin)} samples were cut off at the ends, where a known load has none"
    return replace(
        signals, time=signals.time[begin:end], values=signals.values[begin:end], notes=(*signals.notes, note)
    )


def steps_a_sample(loads: np.ndarray) -> int:
    """Steps of the filter that hold loads (T + 1, n), NaN where missing, well enough: 1 to FINEST a sample."""
    filled = [fill_gaps(own) for own in loads.T]
    enough = (k for k in range(1, FINEST) if all(share_above(own, k * HELD) <= SLIGHT for own in filled))
    return next(enough, FINEST)


def hold_known_loads(
    signals: Signals, loads: np.ndarray, known: Sequence[str], key: str, every: int
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Hold coefficients (T·every, HOLD, 2n) of n loads (T + 1, n), NaN where missing, with those of their interpolation errors
    behind them; and what was done, a sentence each.

    Between samples a load is the spline through them. Its error is unknown; as large as the difference of that spline from
    straight lines, and of its shape, it is a constant that the filter considers (`tolerated_loads.BETWEEN`).

    Raises ConfigError, below `key`, where a load has a long gap, or moves too fast for its samples.
    """
    curves, lines, notes = [], [], []
    for name, values in zip(known, loads.T, strict=True):
        filled = fill_gaps(values) if (spacing := _spacing(signals, name, values, f"{key}.{name}")) > 1 else values
        rate = 1 / (spacing * (signals.time[1] - signals.time[0]))
        missing = int(np.isnan(values).sum())
        if missing:
            notes.append(f"{name}: {missing} missing samples were interpolated, by a spline through the others")
        share = share_above(filled, BAND / spacing)
        fast = (
            f"{100 * share:.2g} % of the RMS of '{name}' is beyond {BAND * rate:.4g} Hz, {BAND:g} of its sampling rate"
        )
        if share > LARGEST:
            raise ConfigError(
                f"{fast}: its samples do not determine it in between",
                key=f"{key}.{name}",
                remedy="record it at a higher rate, behind a filter that takes away what is faster, or estimate this load",
            )
        if share > SLIGHT:
            notes.append(f"{fast}: record it at a higher rate, the estimate depends on what is between its samples")
        curves.append(interpolate(filled, 2 * every))
        lines.append(join_by_lines(values, 2 * every))
    size = 2 * every * (len(loads) - 1) + 1
    curve, line = (np.column_stack(own) if own else np.zeros((size, 0)) for own in (curves, lines))
    return quadratic_hold(np.hstack([curve, line - curve])), tuple(notes)


def _spacing(signals: Signals, name: str, values: np.ndarray, key: str) -> int:
    """The longest interval between samples of a load (T + 1,), in samples of the record. Raises ConfigError for one that is too
    long."""
    there = np.flatnonzero(np.isfinite(values))
    apart = np.diff(there)
    at_ends = not len(there) or there[0] > 0 or there[-1] < len(values) - 1
    if at_ends or not len(apart) or apart.max() - 1 > max(LONGEST_GAP, 2 * (np.median(apart) - 1)):
        longest = int(np.argmax(apart)) if len(apart) else 0
        raise ConfigError(
            f"the known load '{name}' lacks {np.isnan(values).sum()} samples, "
            + (
                "at an end of the record"
                if at_ends
                else f"{apart[longest] - 1} in a row, the first at {signals.time[there[longest] + 1]:g} s"
            ),
            key=key,
            remedy="cut the record, or estimate this load",
        )
    return int(apart.max())

"""Channels of a slower clock in the table of a faster one, with their last value repeated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import UserError

FEWEST = 10
"""Changes of a value from which their spacing shows."""
MOST = 0.95
"""Share of the changes that is at multiples of one interval, or of one and the next."""
USUAL = 0.5
"""Share of the runs that is as long as that interval, and of the changes that are larger than the resolution of the channel."""


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

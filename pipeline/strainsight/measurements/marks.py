"""Numbers that stand for a missing sample, as loggers write them: -9999 among strains of some 100 um/m."""

from __future__ import annotations

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.records import Recording

MARKS = np.array(
    [999, 999.25, 999.99, 9999, 9999.99, 99999, 99999.99, 999999, 9999999, 9.96920996838687e36], dtype=float
)
"""What a logger puts where it has no sample, of either sign."""
LEAST = -32768.0
"""The least whole number of 16 bits."""
BEYOND = 1e20
"""No reading of anything: 1e20, 1e30, 1e38."""
ROUNDING = 1e-5
"""Of itself: as of 9.96921e36, or of a number in single precision."""
OUTSIDE, JUMPS = 0.5, 3.0
"""A mark is beyond the others by this share of their range; or it jumps from a neighbour by so many times their largest step."""


def check_marks(recording: Recording, name: str, unit: str, remedy: str = "", negative: bool = False) -> None:
    """Raises UserError, at its line, for a channel with samples that are a mark of a missing value: the very number, far beyond
    all others, or between neighbours from which it jumps. negative: of the positive ones only those that no reading reaches."""
    values = recording.channels[name]
    for mark in np.unique(values[_marks(values, negative)]):
        at = np.flatnonzero(values == mark)
        others = values[np.isfinite(values) & ~_marks(values, False)]
        if not len(others) or not _apart(values, float(mark), at, others):
            continue
        raise UserError(
            f"{name!r} reads {mark:g} {unit} in {len(at)} of {len(values)} samples, and {others.min():.4g} to "
            f"{others.max():.4g} in others: it stands for a missing value",
            where=recording.place(int(at[0])),
            remedy=remedy
            or f'name it as the file writes it, `text: {{missing: ["{mark:g}"]}}`, or leave the samples empty (NaN)',
        )


def _marks(values: np.ndarray, negative: bool) -> np.ndarray:
    """Which samples are the very number."""
    size = np.abs(values)
    nines = (np.abs(size[:, None] / MARKS - 1) < ROUNDING).any(axis=1) & ((values < 0) | (not negative))
    return nines | (values == LEAST) | (size >= BEYOND)


def _apart(values: np.ndarray, mark: float, at: np.ndarray, others: np.ndarray) -> bool:
    if max(mark - others.max(), others.min() - mark) > OUTSIDE * (others.max() - others.min()):
        return True
    there = np.where(_marks(values, False), np.nan, values)
    steps = np.abs(np.diff(there))
    largest = np.nanmax(steps, initial=0.0) if np.isfinite(steps).any() else 0.0
    beside = np.concatenate([there[at[at > 0] - 1], there[at[at < len(there) - 1] + 1]])
    beside = beside[np.isfinite(beside)]
    return bool(np.any(np.abs(beside - mark) > JUMPS * largest))

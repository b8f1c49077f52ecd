"""Numbers that stand for a missing sample, as loggers write them: -9999 among strains of some 100 um/m."""

from __future__ import annotations

import numpy as np

from strainsight.errors import UserError
from strainsight.measurements.records import Recording

MARKS = (999.0, 9999.0, 99999.0, 999999.0, 9.999e6, 1e10, 1e20, 1e30, 9.96921e36, 1e38)
"""Sizes of what a logger puts where it has no sample."""
ELSEWHERE = 0.2
"""Of a mark that other samples of a channel may reach: a reading that happens to be 999 has others beside it."""
NEAR = 1e-3
"""Of itself that a mark may be off: -9999.99 is one too."""


def check_marks(recording: Recording, name: str, unit: str, remedy: str = "") -> None:
    """Raises UserError, at its line, for a channel some of whose samples are all one of the `MARKS`, far beyond the others."""
    values = recording.channels[name]
    size = np.abs(values)
    largest = float(np.nanmax(size, initial=0.0))
    if not any(abs(largest / mark - 1) < NEAR for mark in MARKS):
        return
    marked = size == largest
    others = np.nanmax(size[~marked], initial=0.0)
    if marked.all() or others > ELSEWHERE * largest or len(np.unique(values[marked])) > 1:
        return
    first = int(np.argmax(marked))
    value = f"{values[first]:g}"
    raise UserError(
        f"{name!r} reads {value} {unit} in {np.count_nonzero(marked)} of {len(values)} samples, and at most {others:.4g} in all "
        "others: it stands for a missing value",
        where=recording.place(first),
        remedy=remedy
        or f'name it as the file writes it, `text: {{missing: ["{value}"]}}`, or leave the samples empty (NaN); of a channel '
        "that did read this, state `override: true`",
    )

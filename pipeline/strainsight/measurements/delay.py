"""Channels that are written late or early, put at their own time: by whole samples, nothing is interpolated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.errors import UserError

WHOLE = 0.01
"""Of a sample that a delay in seconds may be off a whole number of them: as far as a printed one is rounded."""


@dataclass(frozen=True)
class Delay:
    """samples + seconds that a channel is late by, negative: early."""

    samples: int = 0
    seconds: float = 0.0

    def steps(self, step: float, count: int) -> int:
        """Samples that a channel of `count` samples, one every step [s], is late by. Raises UserError where that is no whole
        number, or leaves no sample."""
        exact = self.samples + self.seconds / step
        if abs(exact) >= count:
            raise UserError(
                f"a delay of {exact:.6g} samples, the record has {count}",
                remedy="give a shorter one, in samples of the file",
            )
        whole = round(exact)
        if abs(exact - whole) > WHOLE:
            raise UserError(
                f"a delay of {self.seconds:g} s is {exact:.4g} samples of {step:.6g} s, and nothing is interpolated",
                remedy=f"give {whole * step:.6g} s, or a whole number of samples",
            )
        return whole


NO_DELAY = Delay()


def shifted(values: np.ndarray, n: int) -> np.ndarray:
    """What was written n samples late (T,), at its own time: v(t + n), NaN where the record ends."""
    own = np.full(len(values), np.nan)
    if n >= 0:
        own[: len(values) - n] = values[n:]
    else:
        own[-n:] = values[:n]
    return own

"""What a structure that follows its loads without inertia leaves out, and where one with inertia is not needed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strainsight.config.placement import Train
from strainsight.errors import InfeasibleError
from strainsight.records.training import Training

NOTED, MOST = 0.01, 0.1
"""Share of the reading that inertia would add: from the first on it is warned of, beyond the second refused."""
SAMPLES = 4
"""A period of the first mode, below which a record does not show how it swings."""


def inertia_problems(train: Train, training: Training, first: float) -> Iterator[str]:
    """What to say of the training: that inertia is left out and matters, or that it is there and cannot be seen.

    first: frequency of the first mode [Hz]. Raises InfeasibleError where inertia would add more than a tenth.
    """
    if train.model == "static":
        share = left_out(training, first)
        said = (
            f"inertia, which train.model: static leaves out, adds up to {100 * share:.2g} % to what these loads strain (first "
            f"mode {first:.4g} Hz)"
        )
        if share > MOST:
            raise InfeasibleError(said, key="train.model", remedy="train.model: dynamic, or slower loads")
        if share > NOTED:
            yield f"{said[0].upper()}{said[1:]}: σ does not know of it."
    elif first * train.time_step * SAMPLES > 1:
        yield (
            f"A step of {train.time_step:g} s is {first * train.time_step:.2g} periods of the first mode, {first:.4g} Hz: "
            "readings do not show how the structure swings, and the filter allows for any swinging. If the loads are "
            "slow, train.model: static knows them better; if not, take shorter steps."
        )


def left_out(training: Training, first: float) -> float:
    """RMS of q̈ over that of ω₁² q, the largest of all runs [-]: what inertia adds to the first mode, more than to others.

    Accelerations are second differences of the coordinates, whose lengths count the energy of a motion.
    """
    shares = [0.0]
    for run in training.motions:
        q, h = run.coordinate, run.time[1] - run.time[0]
        if len(q) > 2 and np.any(q):
            shares.append(
                np.linalg.norm(np.diff(q, 2, axis=0)) / h**2 / np.linalg.norm(q[1:-1]) / (2 * np.pi * first) ** 2
            )
    return float(max(shares))

"""Whether a bench and its gauges are of sizes that a ranking of gauges can work with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.errors import InfeasibleError
from strainsight.multibody.inverse.linear import LinearBench

FELT = (1e-6, 1e6)
"""σ of its noise by which one increment of an input moves the gauge that feels it most. Beyond, the Riccati equation has no
digits left, at 1e-8 and 1e8."""
PERIODS = (1e-6, 1e6)
"""Periods in a step: where the last mode has less nothing springs back, where the first has more nothing swings."""


def refuse_sizes(linear: LinearBench, response: np.ndarray, noise: float, inputs: Sequence[str]) -> None:
    """Raise InfeasibleError where gauges feel nothing of an input, or next to no noise; or where nothing moves in a step.

    response (m, nu) strain per unit of every unknown input, at rest; noise σ [strain]; inputs: their names.
    """
    felt = np.abs(response).max(axis=0) * linear.increment[: len(inputs)] / noise
    for name, share in zip(inputs, felt, strict=True):
        if not FELT[0] <= share <= FELT[1]:
            raise InfeasibleError(
                f"{noise:g}: one increment of {name} moves the gauge that feels it most by {share:.2g} times that, which is "
                f"outside {FELT[0]:g} to {FELT[1]:g}",
                key="place.noise",
                remedy=f"check its unit (1 µm/m is 1e-6), estimate.inputs.{name}.increment and the moduli",
            )
    first, last = np.sqrt(np.maximum(linear.stiffness[[0, -1]], 0.0)) / (2 * np.pi)
    for name, mode, bad in (
        ("last", last, last * linear.h < PERIODS[0]),
        ("first", first, first * linear.h > PERIODS[1]),
    ):
        if bad and mode:
            raise InfeasibleError(
                f"the {name} mode of the bench at rest has {mode:.3g} Hz, a step of {linear.h:g} s is {mode * linear.h:.2g} of "
                f"its periods, which is outside {PERIODS[0]:g} to {PERIODS[1]:g}",
                key="bodies",
                remedy="check length and mass units, moduli and densities, and the time step [s]",
            )

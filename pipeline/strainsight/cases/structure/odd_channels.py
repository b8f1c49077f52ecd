"""What of a record is more likely a fault of its channels than meant, in sentences for a warning before anything runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.config.loads import MultiSine, Sine, Sweep
from strainsight.config.placement import PlacementConfig
from strainsight.estimation.faults import at_limit
from strainsight.measurements.assemble import Signals

STILL = 0.1
"""Share of samples between the limits that are as the one before: amplifiers that are clipped have none."""


def odd_channels(
    config: PlacementConfig, signals: Signals, keys: Sequence[str], noise: Sequence[float | None] = ()
) -> tuple[str, ...]:
    """Of the channels (c,) of a record, by their keys in the config: gauges that read one value, or less than their noise [unit
    of the reading], channels that stand at a limit, and a clock that is too slow for the loads that the config states."""
    found = []
    gauges = len(keys) - sum(".inputs." in key for key in keys)
    for i, (name, key) in enumerate(zip(signals.names, keys, strict=True)):
        own = signals.values[:, i]
        there = own[np.isfinite(own)]
        if i < gauges and len(there) > 1 and there.min() == there.max():
            found.append(
                f"{name} reads one value in all of its {len(there)} samples: it is not connected, or dead ({key})"
            )
        elif i < gauges and (count := int(at_limit(own).sum())) and not _in_steps(own):
            found.append(
                f"{name} is clipped: {count} of {len(own)} samples stand in rows at its largest or least value, where the range "
                f"of the amplifier may end ({key})"
            )
        if i < len(noise) and len(there) and (std := noise[i] or 0.0) > (largest := float(np.abs(there).max())):
            found.append(
                f"the noise of {name}, {std:.3g}, exceeds its largest reading, {largest:.3g} ({key}.noise_std)"
            )
    step = float(signals.time[1] - signals.time[0])
    for name, load in config.loads.items():
        fastest = _fastest(load.signal)
        if fastest >= 0.5 / step:
            found.append(
                f"the record has a sample every {step:.4g} s and holds nothing above {0.5 / step:.4g} Hz, and loads.{name} is "
                f"stated with {fastest:.4g} Hz, which folds back: record faster, or check estimate.time.unit"
            )
    return tuple(found)


def _in_steps(values: np.ndarray) -> bool:
    """Whether a channel stands still elsewhere than at its largest and least value, too: a test in steps, or coarse digits."""
    known = values[np.isfinite(values)]
    inside = (known[1:] > known.min()) & (known[1:] < known.max())
    return bool(inside.any()) and float(np.mean(np.diff(known)[inside] == 0)) > STILL


def _fastest(signal: object) -> float:
    """The highest frequency of a stated signal [Hz], 0 where none is stated."""
    if isinstance(signal, Sine):
        return signal.frequency
    if isinstance(signal, Sweep):
        return max(signal.start_frequency, signal.end_frequency)
    if isinstance(signal, MultiSine):
        return signal.highest
    return 0.0

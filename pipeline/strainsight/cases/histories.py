"""Load histories that a config states."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from strainsight.cases.recorded import recorded
from strainsight.config.bench.connections import Constant as StatedConstant
from strainsight.config.loads import MultiSine as StatedMultiSine
from strainsight.config.loads import Recorded
from strainsight.config.loads import Sine as StatedSine
from strainsight.config.loads import Sweep as StatedSweep
from strainsight.signals.histories import Constant, MultiSine, Signal, Sine, Sweep

StatedSignal = StatedConstant | StatedSine | StatedSweep | StatedMultiSine | Recorded
"""A load history, as a config states it."""


def signal_of(name: str, config: StatedSignal, files: Mapping[str, Path], section: str = "loads") -> Signal:
    """A load history, of the entry `name` of a section of the config."""
    if config.type == "constant":
        return Constant(config.value)
    if config.type == "sine":
        return Sine(config.frequency, config.amplitude, config.phase)
    if config.type == "sweep":
        return Sweep(config.start_frequency, config.end_frequency, config.duration, config.amplitude)
    if config.type == "multisine":
        return MultiSine(config.lowest, config.highest, config.count, config.amplitude, config.seed)
    key = f"{section}.{name}.signal"
    return recorded(key, config, files[f"{key}.file"])

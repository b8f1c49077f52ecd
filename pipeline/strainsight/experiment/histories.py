"""Load histories that a config states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from strainsight.config.bench.connections import Constant as StatedConstant
from strainsight.config.bench.connections import Ramp as StatedRamp
from strainsight.config.loads import MultiSine as StatedMultiSine
from strainsight.config.loads import Recorded
from strainsight.config.loads import Sine as StatedSine
from strainsight.config.loads import Sweep as StatedSweep
from strainsight.experiment.recorded import LOADS, recorded
from strainsight.loads.histories import Constant, MultiSine, Ramp, Signal, Sine, Sweep

StatedSignal = StatedConstant | StatedRamp | StatedSine | StatedSweep | StatedMultiSine | Recorded
"""A load history, as a config states it."""


def signal_of(name: str, config: StatedSignal, files: Mapping[str, Path], section: str = "loads") -> Signal:
    """A load history, of the entry `name` of a section of the config."""
    return signal_at(f"{section}.{name}.signal", config, files)


def signal_at(key: str, config: StatedSignal, files: Mapping[str, Path], of: Sequence[str] = LOADS) -> Signal:
    """The history that stands at a key of the config; of: the quantities that a file may hold of it."""
    if config.type == "constant":
        return Constant(config.value)
    if config.type == "sine":
        return Sine(config.frequency, config.amplitude, config.phase)
    if config.type == "sweep":
        return Sweep(config.start_frequency, config.end_frequency, config.duration, config.amplitude)
    if config.type == "multisine":
        return MultiSine(config.lowest, config.highest, config.count, config.amplitude, config.seed)
    if config.type == "ramp":
        return Ramp(config.start, config.end, config.begin, config.duration)
    return recorded(key, config, files[f"{key}.file"], of)

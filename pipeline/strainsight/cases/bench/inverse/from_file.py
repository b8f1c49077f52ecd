"""What the sensors of a bench read in a test, from a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from strainsight.cases.recorded_channels import signals_of
from strainsight.config.bench.bench import AccelerationSensor, MotionSensor, RelativeSensor, Sensor
from strainsight.config.bench.estimate import FromFile
from strainsight.config.estimate import Channel
from strainsight.errors import ConfigError

SECTION = "estimate.measured"
QUANTITY = {"position": "displacement", "velocity": "velocity"}
"""Of a motion; of the direction of an axis a ratio."""


def from_file(
    path: Path, settings: FromFile, own: Mapping[str, tuple[Sensor, int]], h: float, steps: int
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Readings at 0, h, … (T + 1, components) of every sensor, NaN where nothing was measured, and what was done to them.

    own: sensors of the filter with their number of components; the first sample of the file is the start. Raises ConfigError for
    a channel of another quantity, a sensor with another number of components, and a file that ends before the estimate.
    """
    wanted: dict[str, Channel] = {}
    for name, (_, count) in own.items():
        entries, key = settings.channels[name], f"{SECTION}.channels.{name}"
        if len(entries) != count:  # of a placed layout nobody knew before
            raise ConfigError(
                f"{len(entries)} channels for {count} components",
                key=key,
                remedy="give a channel for each, in their order; null where one was not measured",
            )
        wanted |= {f"{key}.{i}": entry for i, entry in enumerate(entries) if entry is not None}
    signals = signals_of(settings, SECTION, path, wanted, step=h)
    if len(signals.time) <= steps:
        end = signals.time[-1] - signals.time[0]
        raise ConfigError(
            f"the file ends after {end:.6g} s, the estimate after {h * steps:.6g} s",
            key=f"{SECTION}.file",
            remedy=f"set estimate.duration to at most {end:.6g}",
        )
    read = {name: np.full((steps + 1, count), np.nan) for name, (_, count) in own.items()}
    for (key, entry), found, values in zip(wanted.items(), signals.quantities, signals.values.T, strict=True):
        name, component = key.removeprefix(f"{SECTION}.channels.").rsplit(".", 1)
        if found != (should := _quantity(own[name][0], int(component))):
            raise ConfigError(
                f"the channel is in {entry.unit}, {found}, but component {int(component) + 1} of {name} is of the kind {should}",
                key=f"{key}.unit",
                remedy="check the unit, and the order of the components",
            )
        read[name][:, int(component)] = values[: steps + 1]
    more = len(signals.time) - 1 - steps
    notes = [f"{more} samples of the file behind the end of the estimate were left out"] if more else []
    return read, (*signals.notes, *notes)


def _quantity(sensor: Sensor, component: int) -> str:
    """What a component is."""
    if isinstance(sensor, RelativeSensor):
        return "displacement" if component < 3 else "angle"
    if isinstance(sensor, AccelerationSensor):
        return "acceleration"
    return QUANTITY.get(sensor.quantity, "ratio") if isinstance(sensor, MotionSensor) else "strain"

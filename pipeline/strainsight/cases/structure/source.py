"""The file of a test, and what was done to every channel of it: what its page says of where the numbers come from."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strainsight.cases.recorded_channels import delay_in_seconds
from strainsight.config.estimate import Channel, Estimate
from strainsight.measurements.reader import format_of
from strainsight.records.estimated import Source
from strainsight.workflow.artefact import sha256_of


def source_of(settings: Estimate, path: Path, labels: tuple[str, ...], known: tuple[str, ...], step: float) -> Source:
    """labels: what the channels of `settings` measure; known: loads whose channels were used, behind them; step [s] of the
    file."""
    entries: list[Channel] = [*settings.channels, *(settings.inputs[name] for name in known)]
    bridges = [entry.bridge for entry in entries]
    nothing = (np.nan, np.nan)
    return Source(
        file=path.name,
        sha256=sha256_of(path),
        bytes=path.stat().st_size,
        format=format_of(path) if settings.format == "auto" else settings.format,
        date=settings.date or "",
        channel=tuple(entry.channel for entry in entries),
        measures=(*labels, *known),
        unit=tuple(entry.unit for entry in entries),
        bridge=tuple("" if bridge is None else bridge.arrangement for bridge in bridges),
        gauge_factor=np.array([np.nan if bridge is None else bridge.gauge_factor for bridge in bridges]),
        poisson_ratio=np.array([np.nan if b is None or b.poisson_ratio is None else b.poisson_ratio for b in bridges]),
        sign=np.array([entry.sign for entry in entries]),
        scale=np.array([entry.scale for entry in entries]),
        offset=np.array([entry.offset for entry in entries]),
        drift=np.array([entry.drift for entry in entries]),
        delay=np.array([delay_in_seconds(entry.delay, step) for entry in entries]),
        zero=np.array([nothing if entry.zero is None else entry.zero for entry in entries], dtype=float).reshape(-1, 2),
    )

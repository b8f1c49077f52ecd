"""The records of a test, each as a test of one file would state it, and what its page says of where its numbers come from."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.config.estimate import Channel, Estimate
from strainsight.errors import StrainsightError
from strainsight.experiment.recorded import delay_in_seconds
from strainsight.measurements.reader import format_of
from strainsight.records.estimated import Source
from strainsight.runner.artefact import sha256_of


@dataclass(frozen=True)
class RecordSettings:
    """name: empty of a test that is one file; settings: as of a test of this file alone; file: key of the file; section: key
    below which what is put right for this record alone stands; channels, inputs: keys of the channels."""

    name: str
    settings: Estimate
    file: str
    section: str
    channels: str
    inputs: str


def records_of(settings: Estimate) -> tuple[RecordSettings, ...]:
    """Of `estimate.file` or `estimate.records`; none where neither is stated. What a record does not state is that of all."""
    keys = "estimate.channels", "estimate.inputs"
    if settings.file is not None:
        return (RecordSettings("", settings, "estimate.file", "estimate", *keys),)
    found = []
    for i, own in enumerate(settings.records):
        changes = ("file", "date", "format", "text", "time", "channels", "inputs")
        stated = {name: value for name in changes if (value := getattr(own, name)) is not None}
        section = f"estimate.records.{i}"
        if len(settings.records) == 1:
            # what one channel of the one record needs stands with all others
            section = "estimate" if own.channels is None else section
        channels, inputs = (
            f"estimate.records.{i}.{name}" if name in stated else f"estimate.{name}" for name in ("channels", "inputs")
        )
        alone = settings.model_copy(update={**stated, "records": ()})
        found.append(RecordSettings(own.name, alone, f"estimate.records.{i}.file", section, channels, inputs))
    return tuple(found)


@contextmanager
def in_record(name: str) -> Iterator[None]:
    """Name the record that an error is of; nothing where the name is empty."""
    try:
        yield
    except StrainsightError as error:
        if name:
            error.what = f"record '{name}': {error.what}"
        raise


def source_of(settings: Estimate, path: Path, labels: tuple[str, ...], known: tuple[str, ...], step: float) -> Source:
    """The file of a record, and what was done to every channel of it.

    labels: what the channels of `settings` measure; known: loads whose channels were used, behind them; step [s] of the file.
    """
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

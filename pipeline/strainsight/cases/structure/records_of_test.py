"""The records of a test, each as a test of one file would state it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from strainsight.config.estimate import Estimate
from strainsight.errors import StrainsightError


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

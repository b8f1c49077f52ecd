"""Gauges that a config says are bonded already, in the config itself and in a file, with their names."""

from __future__ import annotations

from pathlib import Path

from strainsight.cases.structure.bonded_file import STRAIN_KINDS, BondedPlace, read_bonded
from strainsight.config.gauges import Gauges
from strainsight.errors import ConfigError, blame
from strainsight.gauges.bonded import BondedEntry

FILE = "gauges.fixed_file"


def fixed_gauges(gauges: Gauges, file: Path | None) -> list[BondedEntry]:
    """All of them, those of the config itself first; file: that of `gauges.fixed_file`.

    Raises ConfigError for a name that is there twice, and for a line of the file that is no strain gauge.
    """
    entries = [
        BondedEntry(e.position, e.direction, _length(gauges, e.length), e.angles, e.name or "", f"gauges.fixed.{i}")
        for i, e in enumerate(gauges.fixed)
    ]
    if file is not None:
        with blame(FILE):
            entries += [_entry(gauges, file, name, place) for name, place in read_bonded(file).items()]
    names = [entry.name for entry in entries]
    for i, entry in enumerate(entries):
        if entry.name and entry.name in names[:i]:
            raise ConfigError(f"two bonded gauges are called {entry.name}", key=entry.key, remedy="rename one of them")
    return entries


def _entry(gauges: Gauges, file: Path, name: str, place: BondedPlace) -> BondedEntry:
    if place.kind not in STRAIN_KINDS:
        raise ConfigError(
            f"{name} is of the kind '{place.kind}' ({file.name}:{place.line}), and only strain gauges can be bonded beforehand",
            key=FILE,
            remedy="remove its line",
        )
    return BondedEntry(
        place.position.tolist(), place.direction[0].tolist(), _length(gauges, place.length), place.angles, name, FILE
    )


def _length(gauges: Gauges, stated: float | None) -> float:
    return float(gauges.grid_length if stated is None else stated)

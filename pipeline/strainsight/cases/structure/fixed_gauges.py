"""Gauges that a config says are bonded already, in the config itself and in a file, with their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from strainsight.cases.structure.bonded_file import STRAIN_KINDS, BondedPlace, read_bonded
from strainsight.config.gauges import BondedBridge, Gauges, NamedGauge
from strainsight.errors import ConfigError, blame
from strainsight.gauges.bonded import BondedEntry

FILE = "gauges.fixed_file"


def fixed_gauges(gauges: Gauges, file: Path | None) -> list[BondedEntry]:
    """All of them, those of the config itself first; file: that of `gauges.fixed_file`.

    Raises ConfigError for a name that is there twice, and for a line of the file that is no strain gauge.
    """
    entries = [_stated(gauges, i, entry) for i, entry in enumerate(gauges.fixed)]
    if file is not None:
        with blame(FILE):
            entries += [_entry(gauges, file, name, place) for name, place in read_bonded(file).items()]
    names = [entry.name for entry in entries]
    for i, entry in enumerate(entries):
        if entry.name and entry.name in names[:i]:
            raise ConfigError(
                f"two bonded gauges are called {entry.name}",
                key=entry.key.partition(".arms")[0],
                remedy="rename one of them",
            )
    return entries


def _stated(gauges: Gauges, i: int, entry: NamedGauge | BondedBridge) -> BondedEntry:
    key, name = f"gauges.fixed.{i}", entry.name or ""
    if isinstance(entry, NamedGauge):
        return BondedEntry(entry.position, entry.direction, _length(gauges, entry.length), entry.angles, name, key)
    arms = [
        (BondedEntry(arm.position, arm.direction, _length(gauges, arm.length), key=f"{key}.arms.{k}"), arm.sign)
        for k, arm in enumerate(entry.arms)
    ]
    return bridge_of(arms, name, name or str(i + 1))


def bridge_of(arms: Sequence[tuple[BondedEntry, int]], name: str, said: str) -> BondedEntry:
    """A bridge of arms with their signs, one of them 1 at least, the first of which becomes its place; said: what messages call
    it."""
    named = [(replace(arm, name=f"{said}, arm {k + 1},"), sign) for k, (arm, sign) in enumerate(arms)]
    (first, _), *others = sorted(named, key=lambda arm: -arm[1])
    return replace(first, name=name, arms=others)


def _entry(gauges: Gauges, file: Path, name: str, place: BondedPlace) -> BondedEntry:
    if place.kind not in STRAIN_KINDS:
        raise ConfigError(
            f"{name} is of the kind '{place.kind}' ({file.name}:{place.line}), and only strain gauges can be bonded beforehand",
            key=FILE,
            remedy="remove its line",
        )
    if place.arms:
        arms = [
            (
                BondedEntry(arm.position.tolist(), arm.direction.tolist(), _length(gauges, arm.length), key=FILE),
                arm.sign,
            )
            for arm in place.arms
        ]
        return bridge_of(arms, name, name)
    return BondedEntry(
        place.position.tolist(), place.direction[0].tolist(), _length(gauges, place.length), place.angles, name, FILE
    )


def _length(gauges: Gauges, stated: float | None) -> float:
    return float(gauges.grid_length if stated is None else stated)

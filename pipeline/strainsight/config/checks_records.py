"""What the records of a campaign demand of each other, and of the rest of a config."""

from __future__ import annotations

from collections.abc import Iterator

from strainsight.config.estimate import Estimate, GaugeChannel
from strainsight.config.placement import PlacementConfig
from strainsight.config.problem import Problem

ONE = "or estimate one record with estimate.file"


def record_problems(config: PlacementConfig, settings: Estimate) -> Iterator[Problem]:
    """Every contradiction of `estimate.records`."""
    records = settings.records
    if not records:
        return
    if settings.file is not None:
        yield Problem(
            "estimate.records",
            f"'file' ({settings.file}) and 'records' are both given",
            "give one file, or a list of records",
            at_key=True,
        )
    names, files = [own.name.lower() for own in records], [own.file for own in records]
    for i, own in enumerate(records):
        key = f"estimate.records.{i}"
        if own.name.lower() in names[:i]:
            yield Problem(f"{key}.name", f"'{own.name}' is named twice", "give every record a name of its own")
        if own.file in files[:i]:
            yield Problem(f"{key}.file", f"{own.file} is named twice: it would count twice", "leave one of them out")
        if own.channels is not None:
            yield from _other_channels(f"{key}.channels", settings.channels, own.channels)
    if len(records) > 1:
        yield from _not_of_several(config, settings)


def _other_channels(key: str, shared: tuple[GaugeChannel, ...], own: tuple[GaugeChannel, ...]) -> Iterator[Problem]:
    remedy = "name the same gauges and grids in the same order, with the same bias"
    if len(own) != len(shared):
        yield Problem(key, f"{len(own)} channels, estimate.channels has {len(shared)}", remedy)
        return
    for i, (one, other) in enumerate(zip(own, shared, strict=True)):
        for field in ("gauge", "grid", "bias"):
            here, there = getattr(one, field), getattr(other, field)
            if here != there:
                yield Problem(f"{key}.{i}", f"{field} {here}, estimate.channels.{i} has {there}", remedy)


def _not_of_several(config: PlacementConfig, settings: Estimate) -> Iterator[Problem]:
    """What holds for one record alone."""
    method = config.filter.method
    if method != "bank":
        yield Problem(
            "estimate.records",
            f"filter.method: {method} knows no constants that several records share",
            f"set filter.method: bank, {ONE}",
            at_key=True,
        )
    if config.filter.compare:
        yield Problem(
            "filter.compare", "the other filters take one record", f"leave it out with estimate.records, {ONE}"
        )
    if settings.tune.parts:
        yield Problem(
            "estimate.tune.parts",
            "noises are tuned on one record",
            f"tune on one with estimate.file and state what comes out, {ONE}",
        )
    if settings.field is not None:
        yield Problem("estimate.field", "the surface in time is of one record", f"leave it out, {ONE}")

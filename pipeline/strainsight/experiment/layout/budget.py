"""What the variance of an estimate is made of, as a table and in a sentence."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from strainsight.ordering import first_of_largest
from strainsight.records.budget import Budget
from strainsight.runner.output import Table

REMEDY = {
    "noise": "quieter channels, or more of them",
    "process noise": "a smaller process noise, if loads, parameters and the model change or err less than it allows",
    "start": "a longer run",
    "position": "gauges placed more exactly, or where the strain changes less from place to place",
    "angle": "gauges aligned more exactly",
    "gain": "channels calibrated more exactly",
    "transverse sensitivity": "gauges of known transverse sensitivity",
    "offset": "channels zeroed more exactly",
    "drift": "channels that hold their zero, or a shorter record",
    "temperature": "a steady temperature, or gauges beside on a part without load",
    "load direction": "loads aligned more exactly, or their components across among the unknowns",
    "load point": "loads put on more exactly",
    "load gain": "load cells calibrated more exactly",
    "load between samples": "known loads recorded at a higher rate",
    "damping": "damping measured mode by mode",
    "frequency": "natural frequencies measured, and the model corrected by them, or slow loads, which do not depend on them",
    "stiffness": "a stiffness known more exactly, or a modulus among the unknowns",
}
"""Source of variance → what makes it smaller."""


def budget_table(budget: Mapping[str, Mapping[str, float]], of: str = "budget") -> Table:
    """Unknowns by source, in % of the variance."""
    sources = list(dict.fromkeys(source for shares in budget.values() for source in shares))
    rows = tuple((name, *(f"{100 * shares[source]:.1f} %" for source in sources)) for name, shares in budget.items())
    return Table(of, ("variance of", *sources), rows)


def budget_tables(budget: Budget | None, without: Sequence[str] = ()) -> tuple[Table, ...]:
    """Of a filter that has run, with what would help most, and why an unknown has none; none of nothing."""
    sentences = tuple((sentence,) for sentence in (*helps({} if budget is None else budget.shares), *without))
    table = () if budget is None else (budget_table(budget.shares, "budget of the filtered estimates"),)
    return (*table, *([Table("what would help", ("",), sentences)] if sentences else []))


def helps(budget: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """What would lower σ of every unknown most, those with the same source in one sentence."""
    led: dict[str, list[str]] = {}
    for name, shares in budget.items():
        largest = list(shares)[first_of_largest(np.array(list(shares.values())))]
        led.setdefault(largest, []).append(name)
    for source, names in led.items():
        much = _listed([f"{100 * budget[name][source]:.0f} % of the variance of {name}" for name in names])
        yield f"What would help {_listed(names)} most: {REMEDY[source]} ({source}: {much})."


def _listed(words: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))

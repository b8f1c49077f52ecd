"""Numbers of benches as tables: an unknown a row, columns only for what is there."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from html import escape

import numpy as np

from strainsight.estimation.decision import FAULTS, UNTESTED, WEAK
from strainsight.pages import text
from strainsight.pages.bench.data import BenchPlacement, BenchRun, BenchUnknown
from strainsight.pages.page.markup import (
    AXES,
    axes,
    block,
    cell,
    data,
    decimals,
    grouped_table,
    measure,
    plain,
    table,
    verdict_mark,
)
from strainsight.pages.text import number
from strainsight.runner.output import Scalar

Cell = Callable[[BenchRun, BenchUnknown], str]


def ratio(value: float | None, digits: int = 2) -> str:
    """A ratio in per cent, as a plain number where it is tiny; a dash for none."""
    if value is None:
        return "–"
    return data(value, text.ratio(value, digits))


def _share(key: str) -> Cell:
    return lambda run, unknown: ratio(run.number(f"{key}.{unknown.name}"))


def _plain(key: str, digits: int = 4) -> Cell:
    def cell(run: BenchRun, unknown: BenchUnknown) -> str:
        value = run.number(f"{key}.{unknown.name}")
        return "–" if value is None else plain(value, digits)

    return cell


def _quantity(key: str) -> Cell:
    return lambda run, unknown: measure(
        run.number(f"{key}.{unknown.name}"), unknown.history.unit.replace("N m", "N·m"), 4
    )


def _range(run: BenchRun, unknown: BenchUnknown) -> str:
    low, high = (run.number(f"ratio_{key}.{unknown.name}") for key in ("low", "high"))
    return "–" if low is None or high is None else f"{plain(low)} to {plain(high)}"


def _yes(run: BenchRun, unknown: BenchUnknown) -> str:
    value = run.summary.get(f"identified.{unknown.name}")
    if value is None:
        return "–"
    return '<strong class="good">yes</strong>' if value else '<strong class="bad">no</strong>'


def _verdict(run: BenchRun, unknown: BenchUnknown) -> str:
    word = run.summary.get(f"verdict.{unknown.name}", run.summary.get(f"claim.{unknown.name}"))
    if not isinstance(word, str):
        return "–"
    return word if word == UNTESTED else verdict_mark(word, word not in (*FAULTS, WEAK))


COLUMNS: tuple[tuple[str, Cell], ...] = (
    ("error", _share("error")),
    ("largest error", _share("largest_error")),
    ("claimed σ", _share("std")),
    ("error / σ, all runs", _plain("ratio", 3)),
    ("verdict", _verdict),
    ("identified", _yes),
    ("slope", _plain("slope", 5)),
    ("offset", _quantity("offset")),
    ("load ratio: slope", _plain("ratio_slope", 5)),
    ("its offset", _quantity("ratio_offset")),
    ("mean ratio", _plain("ratio_mean", 5)),
    ("its range", _range),
)
"""Heading, what stands in the cell."""
MEANINGS = {
    "error": "Errors and claimed σ of loads: RMS over the second half of the run, of the largest true load; of parameters: at "
    "the end, of the true value.",
    "slope": "Slope and offset: estimate = slope · truth + offset.",
    "load ratio": "Load ratio: this bench's load over the other's, as an affine fit, and where the other is above 0.3 of its "
    "maximum.",
    "mismatch": "Mismatch: RMS of measured − estimated over RMS of measured, of the worst component of the sensors that the "
    "filter was given, and of those that it was not.",
    "NIS": "NIS: normalised innovation squared over the number of channels.",
}
"""What columns mean, by the beginning of their headings."""


def _mismatch(used: bool) -> Callable[[BenchRun], str]:
    def cell(run: BenchRun) -> str:
        found = [run.number(f"mismatch.{sensor.name}") for sensor in run.sensors if sensor.used == used]
        known = [value for value in found if value is not None]
        return ratio(max(known)) if known else ""

    return cell


def _nis(run: BenchRun) -> str:
    nis, expected = run.number("nis"), run.number("expected_nis")
    if nis is None or nis < 0:
        return ""
    return plain(nis, 3) + ("" if expected is None else f" ({plain(expected, 3)})")


def _count(key: str) -> Callable[[BenchRun], str]:
    def cell(run: BenchRun) -> str:
        value = run.number(key)
        return plain(value, 3) if value else ""

    return cell


def _lost(run: BenchRun) -> str:
    lost, runs = run.number("lost"), run.number("runs")
    if not lost:
        return ""
    return f'<strong class="bad">{number(lost)}{"" if runs is None else f" of {number(runs)}"}</strong>'


SHARED: tuple[tuple[str, Callable[[BenchRun], str]], ...] = (
    ("mismatch", _mismatch(used=True)),
    ("of others", _mismatch(used=False)),
    ("NIS (expected)", _nis),
    ("iterations", _count("iterations")),
    ("lost", _lost),
)
"""What stands once for a run; empty where it is not there."""


def runs_table(name: str, entries: Sequence[tuple[str, BenchRun]], *, explained: bool = True) -> str:
    """A block a run, a row an unknown, columns that say something of any of the runs; entries: heading as HTML, run.

    name: as of `markup.table`; explained: whether a sentence before the table says what its columns mean.
    """
    estimated = [run for _, run in entries if run.estimate is not None]
    columns = [
        (heading, cell)
        for heading, cell in COLUMNS
        if any(_says(cell(run, unknown)) for run in estimated for unknown in run.unknowns)
    ]
    shared = [(heading, cell) for heading, cell in SHARED if any(_says(cell(run)) for run in estimated)]
    names = [heading for heading, _ in columns] + [heading for heading, _ in shared]
    bodies = [
        _block(heading, run, [cell for _, cell in columns], [cell for _, cell in shared]) for heading, run in entries
    ]
    note = " ".join(words for key, words in MEANINGS.items() if any(heading.startswith(key) for heading in names))
    head = ("run", "unknown", *names)
    return grouped_table(name, head, bodies, caption=note * explained, numeric=range(2, len(head)))


def _says(cell: str) -> bool:
    """Whether there is anything in a cell but a dash."""
    return re.sub("<[^>]*>", "", cell) not in ("", "–")


def _block(heading: str, run: BenchRun, cells: Sequence[Cell], shared: Sequence[Callable[[BenchRun], str]]) -> str:
    """The rows of a run, its own cells once beside those of its unknowns."""
    if run.estimate is None:
        ends = f"not estimated (ends after {escape(run.reached)})" if run.reached else "not estimated"
        return block(heading, [[cell(ends, across=len(cells) + len(shared) + 1)]])
    rows = [[cell(escape(own.name)), *(cell(of(run, own), right=True) for of in cells)] for own in run.unknowns]
    return block(heading, rows, [of(run) or "–" for of in shared], len(cells) + 1)


def mismatch_table(run: BenchRun) -> str:
    """Every sensor with its mismatch, component by component."""
    rows = []
    for sensor in run.sensors:
        parts = [(name, run.number(f"mismatch.{sensor.name}.{i}")) for i, name in enumerate(sensor.components, start=1)]
        listed = ", ".join(f"{escape(name)} {ratio(value)}" for name, value in parts if value is not None)
        given = "given to the filter" if sensor.used else "only compared"
        rows.append([escape(sensor.name), given, ratio(run.number(f"mismatch.{sensor.name}")), listed or "–"])
    caption = "RMS of measured − estimated over RMS of measured."
    head = ("sensor", "use", "worst", "by component")
    return table("sensors", head, rows, caption=caption, numeric=(2,)) if rows else ""


def placement_table(placement: BenchPlacement, numbers: Mapping[str, Scalar]) -> str:
    """The layout's expected standard deviations beside those of random layouts, and where the gauges go; numbers: the summary of
    place."""
    placed, units = placement.placed, placement.units
    best, random = placed.placed, placed.random_std
    rows = []
    for i, (name, unit) in enumerate(units.items()):
        drawn = random[~np.isnan(random[:, i]), i].tolist()
        cells = [measure(min(drawn), unit, 3), measure(max(drawn), unit, 3)] if drawn else ["–", "–"]
        rows.append([escape(name), measure(float(best.std[i]), unit, 3), *cells])
    head = ("load", "expected σ", "best random layout", "worst")
    loads = table("loads", head, rows, numeric=(1, 2, 3)) if rows else ""
    places, symbol = decimals(best.position), escape(placement.trend.metric.symbol)
    gauges = [
        [
            escape(label),
            *axes(best.position[i], places),
            f'<span class="whole">{" ".join(axes(best.direction[i], 3))}</span>',
            plain(float(placed.loss[i]), 4),
            *(measure(float(std), unit, 3) for std, unit in zip(best.without[i], units.values(), strict=True)),
        ]
        for i, label in enumerate(placement.labels)
    ]
    without = [f"σ({escape(name)}) without it" for name in units]
    columns = ["gauge", *AXES, "direction", f"{symbol} if it fails", *without]
    caption, gap = f"{symbol} of the layout: {plain(placement.trend.final, 4)}.", placement.trend.gap
    if gap is not None:
        of = f" of all {every} candidates" if (every := numbers.get("bounded")) else ""
        caption += f" No other layout within the limits{of} is lower by more than {ratio(max(gap, 0.0))}."
    if "proven" in numbers:
        caption += " Proven: none is better." if numbers["proven"] else " The time was too short for a proof."
    return loads + table("gauges", columns, gauges, caption=caption, numeric=[1, 2, 3, *range(5, len(columns))])

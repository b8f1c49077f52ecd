"""Numbers of benches as tables: an unknown a row, columns only for what is there."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from html import escape

import numpy as np

from strainsight.estimation.decision import FAULTS, OVERCONFIDENT, UNTESTED, WEAK
from strainsight.pages import text
from strainsight.pages.bench.data import BenchMotion, BenchPlacement, BenchRun, BenchStress, BenchUnknown
from strainsight.pages.page.markup import (
    AXES,
    axes,
    block,
    cell,
    count,
    data,
    decimals,
    grouped_table,
    measure,
    plain,
    share,
    table,
    verdict_mark,
)
from strainsight.pages.placement.first import accused
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


def bench_answer(run: BenchRun) -> str:
    """What does not hold, what was found, up to which frequency, and how near the stress comes to the allowable."""
    text = "Nothing was simulated."
    if run.estimate is not None:
        text = run_answer(run)
    elif run.motion is not None:
        text = _moved(run.motion)
    band = run.numbers.get("simulate", {}).get("band")
    if isinstance(band, int | float):
        shown = data(float(band), f"{number(float(band), 3)}\u00a0Hz", "Hz")
        text += f" The time step follows loads up to {shown}."
    if (stress := run.stress) is None:
        return text
    if stress.share is not None and stress.share > 1:
        return f'<strong class="bad">Stress on {escape(stress.body)}: {_stressed(stress)}.</strong> {text}'
    return f"{text} Von Mises stress on {escape(stress.body)}: {_stressed(stress)}."


def too_high(run: BenchRun) -> list[tuple[str, list[str]]]:
    """The stress, where it is beyond the allowable, as `headline` takes it."""
    beyond = run.stress is not None and run.stress.share is not None and run.stress.share > 1
    return [("stress", ["beyond the allowable"])] * beyond


def run_answer(run: BenchRun) -> str:
    """What does not hold, then what the filter made of the unknowns, of a load relative to its largest true value."""
    estimate = run.estimate
    if estimate is None:
        return ""
    parts = [_estimated(run, unknown) for unknown in estimate.unknowns]
    channels = run.number("channels")
    given = sum(len(s.components) for s in estimate.sensors if s.used) if channels is None else int(channels)
    text = f"{count(given)} channels tell {', '.join(parts) or 'nothing'}."
    elsewhere = [unknown.name for unknown in estimate.unknowns if unknown.there is not None]
    if elsewhere and all(run.number(f"error.{name}") is None for name in elsewhere):
        off = {sensor.name: run.number(f"mismatch.{sensor.name}") for sensor in estimate.sensors if sensor.used}
        listed = [f"{escape(name)} to {ratio(value)}" for name, value in off.items() if value is not None]
        text = f"These loads make the bench read as the one that was measured, {', '.join(listed)}: {', '.join(parts)}."
    return _leading(run) + text


def _leading(run: BenchRun) -> str:
    """What does not hold, as HTML."""
    lost = run.number("lost")
    text = f'<strong class="bad">{number(lost)} run{"s" * (lost != 1)} lost.</strong> ' if lost else ""
    for unknown in run.unknowns:
        claim = run.claim(unknown.name)
        over = OVERCONFIDENT if claim is None else claim.words(plain)
        text += accused(unknown.name, [over if one == OVERCONFIDENT else one for one in run.faults(unknown.name)])
    return text


def _estimated(run: BenchRun, unknown: BenchUnknown) -> str:
    name = f"<strong>{escape(unknown.name)}</strong>"
    error, std = run.number(f"error.{unknown.name}"), run.number(f"std.{unknown.name}")
    if error is not None:
        return f"{name} to {ratio(error)}" + (f" at a claimed σ of {ratio(std)}" if std is not None else "")
    history = unknown.history
    late = history.mean[len(history.mean) // 2 :]
    unit = history.unit.replace("N m", "N·m")
    if unknown.kind == "parameter":
        return f"{name} as {measure(float(history.mean[-1]), unit)}"
    return f"{name} as at most {measure(float(np.max(np.abs(late), initial=0.0)), unit)} in the second half"


def _stressed(stress: BenchStress) -> str:
    """The largest stress beside the allowable."""
    largest = f"at most {measure(float(np.max(stress.largest)), 'Pa')}"
    if stress.allowable is None or stress.share is None:
        return largest
    return f"{largest}, {share(stress.share)} of the allowable {measure(stress.allowable, 'Pa')}"


def _moved(motion: BenchMotion) -> str:
    steps = len(motion.time) - 1
    length = float(motion.time[-1] - motion.time[0])
    text = f"{number(length)} s in {steps} steps"
    highest = {name: float(np.max(ring.pressure, initial=0.0)) for name, ring in motion.bearings.items()}
    if highest:
        worst = max(highest, key=lambda name: highest[name])
        text += f"; the highest contact pressure is {measure(highest[worst], 'Pa')}, in {escape(worst)}"
    return f"{text}."

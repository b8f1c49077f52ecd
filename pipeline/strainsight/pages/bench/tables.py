"""Tables of bench results: one row per unknown, with columns only for existing numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from html import escape

import numpy as np

from strainsight import text
from strainsight.estimation.decision import FAULTS, NOT_TESTED, OVERCONFIDENT, WEAK
from strainsight.pages.bench.data import BenchPageRun, BenchStress, BenchUnknown, PlacedGauges
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
    result_mark,
    share,
    table,
)
from strainsight.pages.page.problems import problem_text
from strainsight.records.bench import Simulated
from strainsight.runner.output import Scalar
from strainsight.text import number

Cell = Callable[[BenchPageRun, BenchUnknown], str]


def ratio(value: float | None, digits: int = 2) -> str:
    """Ratio as a percentage, a small one as a number; a dash for None."""
    return "–" if value is None else data(value, text.ratio(value, digits))


def _unit(unknown: BenchUnknown) -> str:
    return unknown.unit.replace("N m", "N·m")


def _shown(key: str, shown: Callable[[float], str]) -> Cell:
    """Number of an unknown, or a dash."""

    def cell(run: BenchPageRun, unknown: BenchUnknown) -> str:
        value = run.number(f"{key}.{unknown.name}")
        return "–" if value is None else shown(value)

    return cell


def _offset(key: str) -> Cell:
    return lambda run, unknown: measure(run.number(f"{key}.{unknown.name}"), _unit(unknown))


def _range(run: BenchPageRun, unknown: BenchUnknown) -> str:
    low, high = (run.number(f"ratio_{key}.{unknown.name}") for key in ("low", "high"))
    return "–" if low is None or high is None else f"{plain(low)} to {plain(high)}"


def _consistency(run: BenchPageRun, unknown: BenchUnknown) -> str:
    word = run.summary.get(f"verdict.{unknown.name}", run.summary.get(f"claim.{unknown.name}"))
    if not isinstance(word, str):
        return "–"
    return word if word == NOT_TESTED else result_mark(word, word not in (*FAULTS, WEAK))


YES_NO = ('<strong class="bad">no</strong>', '<strong class="good">yes</strong>')
COLUMNS: tuple[tuple[str, Cell], ...] = (
    ("error", _shown("error", ratio)),
    ("largest error", _shown("largest_error", ratio)),
    ("claimed σ", _shown("std", ratio)),
    ("RMS of error / σ, all filter runs", _shown("ratio", lambda value: plain(value, 3))),
    ("consistency", _consistency),
    ("identified", _shown("identified", lambda value: YES_NO[bool(value)])),
    ("slope", _shown("slope", lambda value: plain(value, 5))),
    ("offset", _offset("offset")),
    ("load ratio: slope", _shown("ratio_slope", lambda value: plain(value, 5))),
    ("load ratio: offset", _offset("ratio_offset")),
    ("load ratio: mean", _shown("ratio_mean", lambda value: plain(value, 5))),
    ("load ratio: range", _range),
)
"""Heading, content of the cell."""
MEANINGS = {
    "error": "Errors and claimed σ of loads are RMS over the second half of the run, relative to the largest true load. Errors "
    "and claimed σ of parameters are final values, relative to the true value.",
    "slope": "Slope and offset: linear fit estimate = slope · true value + offset.",
    "load ratio": "Load ratio: load on this bench divided by the load on the measured bench (the run in estimate.measured.from). "
    "Slope and offset: linear fit load on this bench = slope · load on the measured bench + offset. "
    "Mean and range: over the instants at which the load on the measured bench exceeds 0.3 times its maximum.",
    "mismatch": "Mismatch: RMS of the residual (measured − estimated) divided by RMS of the measured reading. The table "
    "shows the largest value of all components, separately for the sensors used by the filter and the unused sensors.",
    "NIS": "NIS: normalised innovation squared divided by the number of channels.",
}
"""Beginning of a column heading → its meaning."""


def _mismatch(used: bool) -> Callable[[BenchPageRun], str]:
    def cell(run: BenchPageRun) -> str:
        numbers = [run.number(f"mismatch.{sensor.name}") for sensor in run.sensors if sensor.used == used]
        known = [value for value in numbers if value is not None]
        return ratio(max(known)) if known else ""

    return cell


def _nis(run: BenchPageRun) -> str:
    nis, expected = run.number("nis"), run.number("expected_nis")
    if nis is None or nis < 0:
        return ""
    return plain(nis, 3) + ("" if expected is None else f" ({plain(expected, 3)})")


def _lost(run: BenchPageRun) -> str:
    lost, runs = run.number("lost"), run.number("runs")
    many = "" if runs is None else f" of {number(runs)}"
    return f'<strong class="bad">{number(lost)}{many}</strong>' if lost else ""


SHARED: tuple[tuple[str, Callable[[BenchPageRun], str]], ...] = (
    ("mismatch", _mismatch(used=True)),
    ("mismatch of unused sensors", _mismatch(used=False)),
    ("NIS (expected)", _nis),
    ("diverged runs", _lost),
)
"""Columns with one cell per run, empty without a number."""


def runs_table(name: str, entries: Sequence[tuple[str, BenchPageRun]], *, explained: bool = True) -> str:
    """Table with a block per run and a row per unknown; entries: heading as HTML, run.

    name: as in `markup.table`; explained: whether a caption explains the columns. Columns without any number are omitted."""
    estimated = [run for _, run in entries if run.is_estimated]
    columns = [
        (heading, of)
        for heading, of in COLUMNS
        if any(_is_filled(of(run, unknown)) for run in estimated for unknown in run.unknowns)
    ]
    shared = [(heading, of) for heading, of in SHARED if any(_is_filled(of(run)) for run in estimated)]
    head = ["run", "unknown", *(heading for heading, _ in (*columns, *shared))]
    bodies = []
    for heading, run in entries:
        if not run.is_estimated:
            ends = f"not estimated (run ends after stage {escape(run.reached)})" if run.reached else "not estimated"
            bodies.append(block(heading, [[cell(ends, across=len(head) - 1)]]))
            continue
        rows = [
            [cell(escape(unknown.name)), *(cell(of(run, unknown), right=True) for _, of in columns)]
            for unknown in run.unknowns
        ]
        bodies.append(block(heading, rows, [of(run) or "–" for _, of in shared], len(columns) + 1))
    meanings = [words for key, words in MEANINGS.items() if any(heading.startswith(key) for heading in head[2:])]
    return grouped_table(name, head, bodies, caption=" ".join(meanings) * explained, numeric=range(2, len(head)))


def _is_filled(cell: str) -> bool:
    """Whether a cell has content other than a dash."""
    return re.sub("<[^>]*>", "", cell) not in ("", "–")


def mismatch_table(run: BenchPageRun) -> str:
    """Mismatch of every sensor by component."""
    rows = []
    for sensor in run.sensors:
        parts = [(name, run.number(f"mismatch.{sensor.name}.{i}")) for i, name in enumerate(sensor.components, start=1)]
        listed = ", ".join(f"{escape(name)} {ratio(value)}" for name, value in parts if value is not None)
        use = "used by the filter" if sensor.used else "not used by the filter"
        rows.append([escape(sensor.name), use, ratio(run.number(f"mismatch.{sensor.name}")), listed or "–"])
    caption = "Mismatch: RMS of the residual (measured − estimated) divided by RMS of the measured reading."
    head = ("sensor", "use", "largest mismatch", "mismatch by component")
    return table("sensors", head, rows, caption=caption, numeric=(2,)) if rows else ""


def placement_table(placement: PlacedGauges, numbers: Mapping[str, Scalar]) -> str:
    """Expected standard deviations of the layout and of random layouts, and positions of the gauges; numbers: summary of
    place."""
    placed, units = placement.placed, placement.units
    best, rows = placed.placed, []
    for (name, unit), std, random in zip(units.items(), best.std.tolist(), placed.random_std.T, strict=True):
        known = random[~np.isnan(random)]
        ends = [measure(float(end), unit, 3) for end in (known.min(), known.max())] if len(known) else ["–", "–"]
        rows.append([escape(name), measure(std, unit, 3), *ends])
    head = ("load", "expected σ", "expected σ, best random layout", "expected σ, worst random layout")
    loads = table("loads", head, rows, numeric=(1, 2, 3)) if rows else ""
    places, symbol, gauges = decimals(best.position), escape(placement.trend.metric.symbol), []
    for i, label in enumerate(placement.labels):
        direction = f'<span class="whole">{" ".join(axes(best.direction[i], 3))}</span>'
        without = [measure(std, unit, 3) for std, unit in zip(best.without[i].tolist(), units.values(), strict=True)]
        place = axes(best.position[i], places)
        gauges.append([escape(label), *place, direction, plain(float(placed.loss[i]), 4), *without])
    columns = [
        "gauge",
        *AXES,
        "direction",
        f"{symbol} if this gauge fails",
        *(f"σ({escape(name)}) without gauge" for name in units),
    ]
    caption, gap = f"{symbol} of the layout: {plain(placement.trend.final, 4)}.", placement.trend.gap
    if gap is not None:
        of = f" from all {every} candidates" if (every := numbers.get("bounded")) else ""
        caption += f" No allowed layout{of} reduces {symbol} by more than {ratio(max(gap, 0.0))}."
    if "proven" in numbers:
        caption += (
            " The layout is proven optimal."
            if numbers["proven"]
            else " The time limit did not permit a proof of optimality."
        )
    return loads + table("gauges", columns, gauges, caption=caption, numeric=[1, 2, 3, *range(5, len(columns))])


def bench_answer(run: BenchPageRun) -> str:
    """Problems, results, frequency limit, and stress relative to the allowable."""
    text = _simulated_text(run.simulated) if run.simulated is not None else "The bench was not simulated."
    if run.is_estimated:
        text = run_answer(run)
    band = run.numbers.get("simulate", {}).get("band")
    if isinstance(band, int | float):
        shown = data(float(band), f"{number(float(band), 3)}\u00a0Hz", "Hz")
        text += f" The time step resolves load frequencies up to {shown}."
    if (stress := run.stress) is None:
        return text
    words = f"on {escape(stress.body)}: {stress_words(stress, measure, share)}."
    if stress.too_high:
        return f'<strong class="bad">Largest von Mises stress {words}</strong> {text}'
    return f"{text} Largest von Mises stress {words}"


def run_answer(run: BenchPageRun) -> str:
    """Problems, then errors of the unknowns; those of a load relative to its largest true value."""
    if not run.is_estimated:
        return ""
    parts, channels = [_estimated(run, unknown) for unknown in run.unknowns], run.number("channels")
    used = sum(len(s.components) for s in run.sensors if s.used) if channels is None else int(channels)
    text = f"{count(used)} channels estimate {', '.join(parts) or 'no unknowns'}."
    elsewhere = [unknown.name for unknown in run.unknowns if unknown.unscaled is not None]
    if elsewhere and all(run.number(f"error.{name}") is None for name in elsewhere):
        off = {sensor.name: run.number(f"mismatch.{sensor.name}") for sensor in run.sensors if sensor.used}
        listed = [f"{escape(name)} {ratio(value)}" for name, value in off.items() if value is not None]
        text = f"Loads that reproduce the measured readings (RMS residual/RMS reading: {', '.join(listed)}): {', '.join(parts)}."
    return _problems(run) + text


def _problems(run: BenchPageRun) -> str:
    """Problems as HTML."""
    lost = run.number("lost")
    text = f'<strong class="bad">{number(lost)} run{"s" * (lost != 1)} diverged.</strong> ' if lost else ""
    for unknown in run.unknowns:
        claim = run.claim(unknown.name)
        over = OVERCONFIDENT if claim is None else claim.words(plain)
        text += problem_text(
            unknown.name, [over if fault == OVERCONFIDENT else fault for fault in run.faults(unknown.name)]
        )
    return text


def _estimated(run: BenchPageRun, unknown: BenchUnknown) -> str:
    name, mean = f"<strong>{escape(unknown.name)}</strong>", unknown.mean
    error, std = run.number(f"error.{unknown.name}"), run.number(f"std.{unknown.name}")
    if error is not None:
        return f"{name} with an error of {ratio(error)}" + (f" (claimed σ {ratio(std)})" if std is not None else "")
    if unknown.kind == "parameter":
        return f"{name} = {measure(float(mean[-1]), _unit(unknown))}"
    largest = np.max(np.abs(mean[len(mean) // 2 :]), initial=0.0)
    return f"{name}, largest value {measure(float(largest), _unit(unknown))} in the second half of the run"


def stress_words(
    stress: BenchStress, shown: Callable[[float, str], str], share: Callable[[float], str], where: str = ""
) -> str:
    """Largest stress, its position, and its ratio to the allowable; shown, share: format a number and a ratio."""
    text = f"{shown(float(np.max(stress.largest)), 'Pa')}{where}"
    if stress.allowable is None or stress.share is None:
        return text
    return f"{text}, {share(stress.share)} of the allowable stress {shown(stress.allowable, 'Pa')}"


def _simulated_text(motion: Simulated) -> str:
    steps = len(motion.time) - 1
    length = float(motion.time[-1] - motion.time[0])
    text = f"Simulation of {number(length)} s in {steps} time steps"
    highest = {name: float(np.max(ring.pressure, initial=0.0)) for name, ring in motion.bearings.items()}
    if highest:
        worst = max(highest, key=lambda name: highest[name])
        text += f"; the highest contact pressure is {measure(highest[worst], 'Pa')}, in bearing {escape(worst)}"
    return f"{text}."

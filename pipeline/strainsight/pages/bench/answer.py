"""What the page of a bench begins with: what does not hold, what was found, and how near the stress is to the allowable."""

from __future__ import annotations

from html import escape

import numpy as np

from strainsight.estimation.decision import OVERCONFIDENT
from strainsight.pages.bench.data import BenchMotion, BenchRun, BenchStress, BenchUnknown
from strainsight.pages.bench.tables import ratio
from strainsight.pages.page.markup import count, data, measure, plain, share
from strainsight.pages.placement.verdicts import accused
from strainsight.pages.text import number


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

"""What a run of a suite comes to, unknown by unknown: the error to show, the σ that belongs to it, and a verdict in words."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.verdict import CONSISTENT, DIVERGED, OVERCONFIDENT, TOO_CAUTIOUS, Claim
from strainsight.report.arrays import rms
from strainsight.report.bench.answer import run_faults
from strainsight.report.bench.data import BenchRun
from strainsight.report.placement.data import Unknown
from strainsight.report.placement.verdicts import BEYOND, CONTRADICTED, LOST, WITHHELD, faults
from strainsight.report.suite.data import PlacementRun, Suite, SuiteRun

NOT_ESTIMATED, UNKNOWN = "not estimated", "not judged"
RED = (DIVERGED, BEYOND, WITHHELD, LOST, CONTRADICTED, OVERCONFIDENT)
WORDS = (*RED, CONSISTENT, TOO_CAUTIOUS, UNKNOWN, NOT_ESTIMATED)
"""What a run may come to, what does not hold first."""


@dataclass(frozen=True)
class Result:
    """One unknown of one run, all relative.

    error, std: of the filtered parameter, of the smoothed load (`smoothed`; the filtered one where no smoothed is there);
    rms, worst: error over the repeats, which are filtered: RMS of those that ended, worst of all, ∞ where one was lost;
    repeats: how many, lost: how many of them diverged; verdicts: what is wrong with it, empty where nothing is. None is
    what was not computed.
    """

    unknown: Unknown
    smoothed: bool
    error: float | None
    std: float | None
    rms: float | None
    worst: float | None
    repeats: int
    lost: int
    verdicts: tuple[str, ...]

    @property
    def claim(self) -> Claim | None:
        """The claim that decides."""
        return next(iter(self.unknown.claims), None)

    @property
    def verdict(self) -> str:
        """All of them in words; "" where it was not estimated."""
        if self.error is None:
            return ""
        return ", ".join(self.verdicts) or (self.claim.verdict if self.claim else "no claim")

    @property
    def sigmas(self) -> float | None:
        """The error in units of the σ that was claimed for it."""
        return None if self.error is None or not self.std else self.error / self.std


def results_of(run: PlacementRun) -> tuple[Result, ...]:
    """Every unknown of the run, in its order."""
    return tuple(_result(run, unknown) for unknown in run.unknowns)


def is_estimated(run: SuiteRun) -> bool:
    if isinstance(run, BenchRun):
        return run.estimate is not None
    return any(unknown.error is not None for unknown in run.unknowns)


def counts(report: Suite) -> dict[str, list[int]]:
    """Numbers of the runs, from 1, by what they came to, in the order of WORDS; a run may have several faults."""
    found: dict[str, list[int]] = {word: [] for word in WORDS}
    for index, run in enumerate(report.runs, start=1):
        for word in _words(run):
            found[word].append(index)
    return {word: places for word, places in found.items() if places}


def without_benefit(report: Suite) -> list[int]:
    """Numbers of the runs, from 1, in which random layouts estimate every unknown as well as the placed one."""
    return [
        index
        for index, run in report.placements
        if run.unknowns and all(own.benefit is not None and own.benefit.verdict == "none" for own in run.unknowns)
    ]


def _words(run: SuiteRun) -> tuple[str, ...]:
    """What is wrong with a run, each once; else whether its σ hold."""
    if not is_estimated(run):
        return (NOT_ESTIMATED,)
    if isinstance(run, BenchRun):
        wrong, held = run_faults(run), {run.summary.get(f"claim.{unknown.name}") for unknown in run.unknowns}
    else:
        results = results_of(run)
        wrong = tuple(dict.fromkeys(verdict for result in results for verdict in result.verdicts))
        held = {result.claim.verdict for result in results if result.claim is not None}
    return wrong or ((TOO_CAUTIOUS,) if TOO_CAUTIOUS in held else (CONSISTENT,) if CONSISTENT in held else (UNKNOWN,))


def _result(run: PlacementRun, unknown: Unknown) -> Result:
    repeats = next((entry for entry in run.repeats if entry.name == unknown.name), None)
    smoothed = unknown.kind == "input" and unknown.smoothed_error is not None
    error, std = (unknown.smoothed_error, unknown.smoothed_std) if smoothed else (unknown.error, unknown.std)
    typical = worst = None
    many = lost = 0
    if repeats is not None and len(repeats.error):
        size = np.abs(repeats.error)
        many, lost = len(size), int(np.count_nonzero(~np.isfinite(size)))
        typical, worst = rms(size), math.inf if lost else float(np.max(size))
    diverged = bool(lost) or (error is not None and not math.isfinite(error))
    verdicts = faults(unknown, repeats is not None and repeats.verdict == LOST, diverged)
    return Result(unknown, smoothed, error, std, typical, worst, many, lost, verdicts)

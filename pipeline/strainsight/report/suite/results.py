"""What a run of a suite comes to, unknown by unknown: the error to show, the σ that belongs to it, and a verdict in words."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from strainsight.report.placement.data import FloatArray, History, Unknown
from strainsight.report.suite.data import SuiteReport, SuiteRun

BEYOND = 3.0
"""Claimed σ beyond which an error is no bad luck."""
WRONG, LOST, DIVERGED, CLAIMED = "sure and wrong", "not identified", "diverged", "as claimed"


@dataclass(frozen=True)
class Result:
    """One unknown of one run, all relative.

    error, std: of the filtered parameter, of the smoothed load (`smoothed`; the filtered one where no smoothed is there);
    rms, worst: error over the repeats, which are filtered: RMS of those that ended, worst of all, ∞ where one was lost;
    ratio: RMS of error over claimed σ; repeats: how many, lost: how many of them diverged; verdicts: what is wrong with
    it, empty where nothing is. None is what was not computed.
    """

    unknown: Unknown
    smoothed: bool
    error: float | None
    std: float | None
    rms: float | None
    worst: float | None
    ratio: float | None
    repeats: int
    lost: int
    verdicts: tuple[str, ...]

    @property
    def verdict(self) -> str:
        """All of them in words; "" where it was not estimated."""
        if self.error is None:
            return ""
        return ", ".join(self.verdicts) or (CLAIMED if self.sigmas is not None else "no claim")

    @property
    def sigmas(self) -> float | None:
        """The error in units of the σ that was claimed for it."""
        return None if self.error is None or not self.std else self.error / self.std

    @property
    def filtered_sigmas(self) -> float | None:
        """The same of the filtered estimate."""
        error, std = self.unknown.error, self.unknown.std
        return None if error is None or not std else error / std


def results_of(run: SuiteRun) -> tuple[Result, ...]:
    """Every unknown of the run, in its order."""
    return tuple(_result(run, unknown) for unknown in run.unknowns)


def is_estimated(run: SuiteRun) -> bool:
    return any(unknown.error is not None for unknown in run.unknowns)


def verdicts_of(run: SuiteRun) -> tuple[str, ...]:
    """What is wrong with a run, each said once."""
    return tuple(dict.fromkeys(verdict for result in results_of(run) for verdict in result.verdicts))


def counts(report: SuiteReport) -> dict[str, list[int]]:
    """Numbers of the runs, from 1, by what they came to: "as claimed", every verdict, "not estimated"."""
    found: dict[str, list[int]] = {}
    for index, run in enumerate(report.runs, start=1):
        for word in (verdicts_of(run) or (CLAIMED,)) if is_estimated(run) else ("not estimated",):
            found.setdefault(word, []).append(index)
    return found


def _result(run: SuiteRun, unknown: Unknown) -> Result:
    history = next((entry for entry in run.histories if entry.name == unknown.name), None)
    repeats = next((entry for entry in run.repeats if entry.name == unknown.name), None)
    smoothed = unknown.kind == "input" and unknown.smoothed_error is not None
    error = unknown.smoothed_error if smoothed else unknown.error
    std = _smoothed_std(unknown, history) if smoothed else unknown.std
    rms = worst = ratio = None
    many = lost = 0
    if repeats is not None and len(repeats.error):
        size, claimed = np.abs(repeats.error), repeats.claimed_std
        many, lost = len(size), int(np.count_nonzero(~np.isfinite(size)))
        rms, worst = _rms(size), math.inf if lost else float(np.max(size))
        ratio = _rms(size / np.where(claimed > 0, claimed, np.nan))
    verdicts = []
    if lost or (error is not None and not math.isfinite(error)):
        verdicts.append(DIVERGED)
    result = Result(unknown, smoothed, error, std, rms, worst, ratio, many, lost, ())
    if any(off is not None and off > BEYOND for off in (result.sigmas, result.filtered_sigmas, ratio)):
        verdicts.append(WRONG)
    if repeats is not None and repeats.verdict == LOST:
        verdicts.append(LOST)
    return replace(result, verdicts=tuple(verdicts))


def _smoothed_std(unknown: Unknown, history: History | None) -> float | None:
    """The smoothed σ relative to what the filtered one is relative to: after the first tenth, RMS over RMS."""
    if history is None or history.smoothed_std is None or unknown.std is None:
        return None
    late = slice(len(history.time) // 10, None)
    filtered = _rms(history.std[late])
    return unknown.std * _rms(history.smoothed_std[late]) / filtered if filtered > 0 else None


def _rms(values: FloatArray) -> float:
    """Of the finite ones; NaN where there is none."""
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan

"""Why there is no σ of consistent measurements: parameters outside the range of the reduced model, and two estimates of one
record that exclude each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import NONE, StatedTolerances, tolerances_of
from strainsight.estimation.decision import out_of_range
from strainsight.estimation.model import physical
from strainsight.experiment.structure.filtered_test import Filtered, Filtering, banks_of
from strainsight.experiment.structure.problem import Problem
from strainsight.experiment.structure.settings import unknown_units
from strainsight.records.estimated import Compared

EXCLUDED = 5.0
"""Of the σ of both together: two estimates that are farther apart exclude each other."""
Values = Mapping[str, tuple[float, float]]
"""Parameter → value and σ [SI]."""


def beyond_ranges(config: PlacementConfig, problem: Problem, values: Mapping[str, float]) -> dict[str, str]:
    """Parameter → a sentence, of those whose values [SI] are beyond `parameters.*.range`.

    Modes and static responses of `rom` span the range; a damping factor multiplies C within the reduced model and is exact
    anywhere.
    """
    free = [name for name in problem.unknowns.parameters if name != problem.model.damping.parameter]
    ranges = {name: config.parameters[name].range for name in free}
    return out_of_range(values, ranges, unknown_units(config), "rom")


def widen(beyond: Mapping[str, str]) -> str:
    """What to do about parameters beyond their ranges."""
    return f"widen {' and '.join(f'parameters.{name}.range' for name in beyond)}"


def last_values(given: Filtering, mean: np.ndarray, std: np.ndarray) -> Values:
    """Of the unknowns, from the augmented state (n,)."""
    return {name: (float(value), float(own)) for name, (value, own) in physical(given.model, mean, std).items()}


def excluded_by_comparison(tolerances: StatedTolerances, given: Filtering, found: Filtered) -> tuple[str, str]:
    """Why there is no σ, and a note, each empty where there is nothing to say.

    The bank beside the estimate has no tolerances, and an unknown start. Where tolerances are stated, the estimate stands against
    it, unless the start is settled and a bank with the same tolerances and an unknown start excludes the estimate, too.
    """
    ends = last_values(given, found.smoothed.mean[-1, 0], found.smoothed.std[-1, 0])
    words = excluded(ends, by_bank(found.compared))
    if not words or tolerances_of(tolerances) == NONE:
        return excluded_in_words(words, given.settled is not None, "estimate.start"), ""
    if given.settled is not None:
        run = banks_of([replace(given, settled=None)])[0].run
        moving = last_values(given, run.mean[-1, 0], run.std[-1, 0])
        if otherwise := excluded(ends, {name: moving[name] for name in given.model.unknowns.parameters}):
            return excluded_in_words(otherwise, True, "estimate.start"), ""
    return "", f"the comparison takes tolerances for exact, which this record excludes: {words}, with and without them"


def excluded(found: Values, other: Values) -> str:
    """Which parameters two estimates give values that exclude each other, in words; empty where none."""
    words = []
    for name, (b, t) in other.items():
        a, s = found[name]
        if abs(np.log(a / b)) > EXCLUDED * np.hypot(s / a, t / b):
            words.append(f"{name} is {a:.4g} ± {100 * s / a:.2g} % or {b:.4g} ± {100 * t / b:.2g} %")
    return "; ".join(words)


def by_bank(beside: Compared | None) -> dict[str, tuple[float, float]]:
    """By the bank of a comparison; empty where nothing was compared."""
    if beside is None:
        return {}
    return {name: (float(value[0]), float(beside.std[name][0])) for name, value in beside.estimate.items()}


def excluded_in_words(words: str, settled: bool, key: str) -> str:
    """Why there is no σ, by the words of `excluded`; settled: whether the start of the estimate is, as `key` says."""
    remedy = (
        f"with a settled and with an unknown start: check {key}" if settled else "by two searches: report this record"
    )
    return f"two estimates exclude each other: {words}, {remedy}" if words else ""

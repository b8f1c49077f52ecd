"""Claims and comparisons of a suite, measured in the summaries of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from strainsight.config.suite_runs import all_of
from strainsight.errors import ConfigError, did_you_mean
from strainsight.report.suite.data import Comparison, Statement, SuiteRun

OF_SEEDS = "estimate"
"""The stage that has numbers once a seed."""


def statements_of(claims: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[Statement, ...]:
    """Raises ConfigError for every claim about a number that its run does not have."""
    return tuple(all_of(claims, lambda claim: _statement(claim.measure, claim.text, claim.why, runs)))


def comparisons_of(rows: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[Comparison, ...]:
    """Raises ConfigError for every row about a number that its run does not have."""
    return tuple(all_of(rows, lambda row: _comparison(row, runs)))


def _comparison(row: Any, runs: Sequence[SuiteRun]) -> Comparison:
    as_printed, ours = (
        None if own is None else _statement(own, row.says, "", runs) for own in (row.as_printed, row.ours)
    )
    return Comparison(row.source, row.says, row.printed, as_printed, ours, row.why)


def _statement(measure: Any, text: str, why: str, runs: Sequence[SuiteRun]) -> Statement:
    values = []
    for place in measure.runs:
        for name in measure.number:
            found = measure.times * _numbers(measure, runs[place], name, "number")
            if measure.against is not None:
                key = "number" if measure.against_number is None else "against_number"
                divisor = _numbers(measure, runs[measure.against], measure.against_number or name, key)
                # seed by seed, where both have as many
                divisor = divisor if len(divisor) == len(found) else divisor[:1]
                found = np.divide(found, divisor, out=np.full(len(found), np.nan), where=divisor != 0)
            values += [(int(place), str(name), float(value)) for value in found]
    compared = ""
    if measure.against is not None:
        compared = f"{runs[measure.against].label}" + (f", {measure.against_number}" if measure.against_number else "")
    return Statement(text, tuple(values), measure.above, measure.below, measure.equals, measure.unit, compared, why)


def _numbers(measure: Any, run: SuiteRun, name: str, key: str) -> np.ndarray:
    """A number of the estimate once a seed, where it has several, else that of the run's summary (1,)."""
    if measure.stage == OF_SEEDS and name in run.seeds:
        return np.asarray(run.seeds[name], dtype=float)
    return np.array([_number(measure, run, name, key)])


def _number(measure: Any, run: SuiteRun, name: str, key: str) -> float:
    """A number of the run's summary; NaN for one that is not there because a filter diverged."""
    numbers = run.numbers[measure.stage]
    value = numbers.get(name)
    if isinstance(value, bool | int | float):
        if isinstance(value, bool) != (measure.equals is not None):
            what = f"'{name}' is {'true or false' if isinstance(value, bool) else 'a number'} in '{run.name}'"
            remedy = "give equals: true or false" if isinstance(value, bool) else "give above or below"
            raise ConfigError(what, key=measure.key, remedy=remedy)
        return float(value)
    if value is None and numbers.get("lost"):
        return float("nan")
    known = [own for own, there in numbers.items() if not isinstance(there, str)]
    what = f"no number '{name}' in the stage '{measure.stage}' of '{run.name}'"
    raise ConfigError(what, key=f"{measure.key}.{key}", remedy=did_you_mean(name, known, f"it has {', '.join(known)}"))

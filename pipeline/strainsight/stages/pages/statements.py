"""The claims of a suite, measured in the summaries of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from strainsight.config.suite_runs import all_of
from strainsight.errors import ConfigError, did_you_mean
from strainsight.report.suite.data import Statement, SuiteRun

OF_SEEDS = "estimate"
"""The stage that has numbers once a seed."""


def statements_of(claims: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[Statement, ...]:
    """Raises ConfigError for every claim about a number that its run does not have."""
    return tuple(all_of(range(len(claims)), lambda i: _statement(i, claims[i], runs)))


def _statement(i: int, claim: Any, runs: Sequence[SuiteRun]) -> Statement:
    values = []
    for place in claim.runs:
        for name in claim.number:
            found = claim.times * _numbers(i, claim, runs[place], name, "number")
            if claim.against is not None:
                key = "number" if claim.against_number is None else "against_number"
                divisor = _numbers(i, claim, runs[claim.against], claim.against_number or name, key)
                # seed by seed, where both have as many
                divisor = divisor if len(divisor) == len(found) else divisor[:1]
                found = np.divide(found, divisor, out=np.full(len(found), np.nan), where=divisor != 0)
            values += [(int(place), str(name), float(value)) for value in found]
    compared = ""
    if claim.against is not None:
        compared = f"{runs[claim.against].label}" + (f", {claim.against_number}" if claim.against_number else "")
    return Statement(claim.text, tuple(values), claim.above, claim.below, claim.equals, claim.unit, compared, claim.why)


def _numbers(i: int, claim: Any, run: SuiteRun, name: str, key: str) -> np.ndarray:
    """A number of the estimate once a seed, where it has several, else that of the run's summary (1,)."""
    if claim.stage == OF_SEEDS and name in run.seeds:
        return np.asarray(run.seeds[name], dtype=float)
    return np.array([_number(i, claim, run, name, key)])


def _number(i: int, claim: Any, run: SuiteRun, name: str, key: str) -> float:
    """A number of the run's summary; NaN for one that is not there because a filter diverged."""
    numbers = run.numbers[claim.stage]
    value = numbers.get(name)
    if isinstance(value, bool | int | float):
        if isinstance(value, bool) != (claim.equals is not None):
            what = f"'{name}' is {'true or false' if isinstance(value, bool) else 'a number'} in '{run.name}'"
            remedy = "give equals: true or false" if isinstance(value, bool) else "give above or below"
            raise ConfigError(what, key=f"claims.{i}", remedy=remedy)
        return float(value)
    if value is None and numbers.get("lost"):
        return float("nan")
    known = [own for own, there in numbers.items() if not isinstance(there, str)]
    what = f"no number '{name}' in the stage '{claim.stage}' of '{run.name}'"
    raise ConfigError(what, key=f"claims.{i}.{key}", remedy=did_you_mean(name, known, f"it has {', '.join(known)}"))

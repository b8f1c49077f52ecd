"""The claims of a suite, measured in the summaries of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from strainsight.config.suite_runs import all_of
from strainsight.errors import ConfigError, did_you_mean
from strainsight.report.suite.data import Statement, SuiteRun


def statements_of(claims: Sequence[Any], runs: Sequence[SuiteRun]) -> tuple[Statement, ...]:
    """Raises ConfigError for every claim about a number that its run does not have."""
    return tuple(all_of(range(len(claims)), lambda i: _statement(i, claims[i], runs)))


def _statement(i: int, claim: Any, runs: Sequence[SuiteRun]) -> Statement:
    values = []
    for place in claim.runs:
        for name in claim.number:
            value = claim.times * _number(i, claim, runs[place], name, "number")
            if claim.against is not None:
                key = "number" if claim.against_number is None else "against_number"
                divisor = _number(i, claim, runs[claim.against], claim.against_number or name, key)
                value = value / divisor if divisor else float("nan")
            values.append((int(place), str(name), float(value)))
    compared = ""
    if claim.against is not None:
        compared = f"{runs[claim.against].label}" + (f", {claim.against_number}" if claim.against_number else "")
    return Statement(claim.text, tuple(values), claim.above, claim.below, claim.equals, claim.unit, compared)


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

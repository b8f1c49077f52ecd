"""Numbers of runs that a suite judges: statements, and what a source says beside what comes out here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated

from pydantic import Field

from strainsight.config.base import Section, Text
from strainsight.config.plausible import COMPARED
from strainsight.config.problem import Problem

Texts = Annotated[tuple[Text, ...], Field(min_length=1)]


class Measure(Section):
    """Numbers of runs, and the bounds that all of them have to be within."""

    run: Text | Texts = Field(
        description="Name of the run, before the suite's suffix, or a list: it has to hold in each."
    )
    number: Text | Texts = Field(description="Number of the stage's summary, as in slope.Fz, or a list.")
    stage: Text | None = Field(
        None, description="Stage that the number comes from; null: `estimate` of a bench, `validate` of a placement."
    )
    times: Annotated[float, COMPARED] = Field(1.0, description="The number is multiplied by it first [-].")
    against: Text | None = Field(None, description="Name of another run: the number is divided by that one's.")
    against_number: Text | None = Field(None, description="Number to divide by; null: the same as number.")
    above: Annotated[float | None, COMPARED] = Field(None, description="It has to be larger than this.")
    below: Annotated[float | None, COMPARED] = Field(None, description="It has to be smaller than this.")
    equals: bool | None = Field(None, description="For a number that is true or false: which of them it has to be.")
    unit: str = Field("", description="What stands behind the number on the page, as in N or of the weight.")


class Claim(Measure):
    """A statement about numbers of runs: confirmed where all of them are within the bounds, contradicted otherwise."""

    text: Text = Field(description="The statement.")
    why: str = Field(
        "",
        description="Why it holds or does not, in words that the page shows below the verdict; where it does not, the "
        "page marks that none is given.",
    )


class Comparison(Section):
    """What a source says, what comes out under its settings, and what under ours."""

    source: Text = Field(description="Where it stands, as in figure 2.4.")
    says: Text = Field(description="What it says there.")
    printed: str = Field("", description="Its number, in words.")
    as_printed: Measure | None = Field(None, description="Numbers of runs under the settings of the source.")
    ours: Measure | None = Field(None, description="Numbers of runs under settings of our own.")
    why: str = Field(
        "",
        description="Why it holds or does not, or why nothing is measured, in words that the page shows below the verdict; "
        "where it does not hold, the page marks that none is given.",
    )


def as_texts(value: str | Sequence[str]) -> tuple[str, ...]:
    """One text or a list as a tuple."""
    return (value,) if isinstance(value, str) else tuple(value)


def measures_of(claims: Sequence[Claim], comparisons: Sequence[Comparison]) -> dict[str, Measure]:
    """Dotted key → every measure of a suite: its claims, then both sides of its comparisons."""
    found: dict[str, Measure] = {f"claims.{i}": claim for i, claim in enumerate(claims)}
    for i, row in enumerate(comparisons):
        sides = {"as_printed": row.as_printed, "ours": row.ours}
        found |= {f"comparisons.{i}.{side}": own for side, own in sides.items() if own is not None}
    return found


def measure_problems(claims: Sequence[Claim], comparisons: Sequence[Comparison]) -> Iterator[Problem]:
    """What is wrong with them by themselves."""
    for key, own in measures_of(claims, comparisons).items():
        yield from _problems(key, own)
    for i, row in enumerate(comparisons):
        if row.as_printed is None and row.ours is None and not row.why:
            yield Problem(
                f"comparisons.{i}",
                "nothing is measured, and nothing says why",
                "give as_printed or ours, or why there is nothing to measure",
                at_key=True,
            )


def _problems(key: str, own: Measure) -> Iterator[Problem]:
    bounds = [value for value in (own.above, own.below) if value is not None]
    if own.equals is None and not bounds:
        yield Problem(key, "has no bound", "give above, below or both, or equals: true or false", at_key=True)
    elif own.equals is not None and (bounds or own.against is not None or own.times != 1):
        yield Problem(f"{key}.equals", "goes with no other bound and no ratio", "leave one of them out")
    elif len(bounds) == 2 and not bounds[0] < bounds[1]:
        yield Problem(f"{key}.above", f"{bounds[0]:g} is not smaller than below, {bounds[1]:g}", "swap them")
    if own.against_number is not None and own.against is None:
        what = "there is no run to compare with"
        yield Problem(f"{key}.against_number", what, "give against: RUN, or leave it out", at_key=True)

"""What a suite asks of its runs: studies that share figures, and statements that hold or do not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated

from pydantic import Field

from strainsight.config.base import Section, Text
from strainsight.config.problem import Problem

Texts = Annotated[tuple[Text, ...], Field(min_length=1)]


class Study(Section):
    """A question that several runs answer together; what is not listed here is a study by its name in runs[].study alone."""

    name: Text = Field(description="Name of the study, as in runs[].study; the heading on the page.")
    note: str = Field("", description="A sentence that the page shows below the heading.")
    over: Text | None = Field(
        None,
        description="Dotted key of the runs' configs whose number they vary, as in estimate.time_step: figures over it, a line a "
        "group.",
    )
    numbers: tuple[Text, ...] = Field(
        (),
        description="Numbers of `estimate`, of a placement `validate`, that are drawn over it, as in slope.Fz; without any: the "
        "error of every unknown beside its claimed standard deviation.",
    )


class Claim(Section):
    """A statement about numbers of runs: confirmed where all of them are within the bounds, contradicted otherwise."""

    text: Text = Field(description="The statement.")
    run: Text | Texts = Field(
        description="Name of the run, before the suite's suffix, or a list: it has to hold in each."
    )
    number: Text | Texts = Field(description="Number of the stage's summary, as in slope.Fz, or a list.")
    stage: Text | None = Field(
        None, description="Stage that the number comes from; null: `estimate` of a bench, `validate` of a placement."
    )
    times: float = Field(1.0, description="The number is multiplied by it first [-].")
    against: Text | None = Field(None, description="Name of another run: the number is divided by that one's.")
    against_number: Text | None = Field(None, description="Number to divide by; null: the same as number.")
    above: float | None = Field(None, description="It has to be larger than this.")
    below: float | None = Field(None, description="It has to be smaller than this.")
    equals: bool | None = Field(None, description="For a number that is true or false: which of them it has to be.")
    why: str = Field(
        "",
        description="Why it holds or does not, in words that the page shows below the verdict; needed where it does not.",
    )
    unit: str = Field("", description="What stands behind the number on the page, as in N or of the weight.")


def as_texts(value: str | Sequence[str]) -> tuple[str, ...]:
    """One text or a list as a tuple."""
    return (value,) if isinstance(value, str) else tuple(value)


def study_problems(studies: Sequence[Study], named: Sequence[str]) -> Iterator[Problem]:
    """What is wrong with the studies; named: those of the runs."""
    for i, study in enumerate(studies):
        if study.name in [other.name for other in studies[:i]]:
            yield Problem(f"studies.{i}.name", f"'{study.name}' is listed twice", "list every study once")
        elif study.name not in named:
            yield Problem(f"studies.{i}.name", f"no run is of the study '{study.name}'", "name it in runs[].study")
        if study.numbers and study.over is None:
            yield Problem(f"studies.{i}.numbers", "there is nothing to draw them over", "give over: KEY", at_key=True)


def claim_problems(claims: Sequence[Claim]) -> Iterator[Problem]:
    """What is wrong with the claims by themselves."""
    for i, claim in enumerate(claims):
        key = f"claims.{i}"
        bounds = [value for value in (claim.above, claim.below) if value is not None]
        if claim.equals is None and not bounds:
            yield Problem(key, "has no bound", "give above, below or both, or equals: true or false", at_key=True)
        elif claim.equals is not None and (bounds or claim.against is not None or claim.times != 1):
            yield Problem(f"{key}.equals", "goes with no other bound and no ratio", "leave one of them out")
        elif len(bounds) == 2 and not bounds[0] < bounds[1]:
            yield Problem(f"{key}.above", f"{bounds[0]:g} is not smaller than below, {bounds[1]:g}", "swap them")
        if claim.against_number is not None and claim.against is None:
            what = "there is no run to compare with"
            yield Problem(f"{key}.against_number", what, "give against: RUN, or leave it out", at_key=True)

"""Studies of a suite: questions that several runs answer together, with figures of their own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pydantic import Field

from strainsight.config.base import Section, Text
from strainsight.config.problem import Problem


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


def study_problems(studies: Sequence[Study], named: Sequence[str]) -> Iterator[Problem]:
    """What is wrong with the studies; named: those of the runs."""
    for i, study in enumerate(studies):
        if study.name in [other.name for other in studies[:i]]:
            yield Problem(f"studies.{i}.name", f"'{study.name}' is listed twice", "list every study once")
        elif study.name not in named:
            yield Problem(f"studies.{i}.name", f"no run is of the study '{study.name}'", "name it in runs[].study")
        if study.numbers and study.over is None:
            yield Problem(f"studies.{i}.numbers", "there is nothing to draw them over", "give over: KEY", at_key=True)

"""The config of `kind: suite`: a list of ordinary configs and one page about all of them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field, JsonValue

from strainsight.config.base import COMPARED, Problem, RunName, Section, Text, expert, section_problems

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

    def problems(self) -> Iterator[Problem]:
        bounds = [value for value in (self.above, self.below) if value is not None]
        if self.equals is None and not bounds:
            yield Problem("", "has no bound", "give above, below or both, or equals: true or false", at_key=True)
        elif self.equals is not None and (bounds or self.against is not None or self.times != 1):
            yield Problem("equals", "goes with no other bound and no ratio", "leave one of them out")
        elif len(bounds) == 2 and not bounds[0] < bounds[1]:
            yield Problem("above", f"{bounds[0]:g} is not smaller than below, {bounds[1]:g}", "swap them")
        if self.against_number is not None and self.against is None:
            what = "there is no run to compare with"
            yield Problem("against_number", what, "give against: RUN, or leave it out", at_key=True)


class WithReason(Section):
    """What may need a reason."""

    why: str = Field(
        "",
        description="Why it holds or does not, or why nothing is measured, in words that the page shows below the verdict; "
        "where it does not hold, the page marks that none is given.",
    )


class Noted(Section):
    """What may have a note."""

    note: str = Field("", description="A sentence that the page shows with it.")


class ClaimSection(Measure, WithReason):
    """A statement about numbers of runs: confirmed where all of them are within the bounds, contradicted otherwise."""

    text: Text = Field(description="The statement.")


class ComparisonSection(WithReason):
    """What a source says, what comes out under its settings, and what under ours."""

    source: Text = Field(description="Where it stands, as in figure 2.4.")
    says: Text = Field(description="What it says there.")
    printed: str = Field("", description="Its number, in words.")
    as_printed: Measure | None = Field(None, description="Numbers of runs under the settings of the source.")
    ours: Measure | None = Field(None, description="Numbers of runs under settings of our own.")

    def problems(self) -> Iterator[Problem]:
        if self.as_printed is None and self.ours is None and not self.why:
            remedy = "give as_printed or ours, or why there is nothing to measure"
            yield Problem("", "nothing is measured, and nothing says why", remedy, at_key=True)


def as_texts(value: str | Sequence[str]) -> tuple[str, ...]:
    """One text or a list as a tuple."""
    return (value,) if isinstance(value, str) else tuple(value)


def measures_of(claims: Sequence[ClaimSection], comparisons: Sequence[ComparisonSection]) -> dict[str, Measure]:
    """Dotted key → every measure of a suite: its claims, then both sides of its comparisons."""
    measures: dict[str, Measure] = {f"claims.{i}": claim for i, claim in enumerate(claims)}
    for i, row in enumerate(comparisons):
        sides = {"as_printed": row.as_printed, "ours": row.ours}
        measures |= {f"comparisons.{i}.{side}": measure for side, measure in sides.items() if measure is not None}
    return measures


class StudySection(Noted):
    """A question that several runs answer together; what is not listed here is a study by its name in runs[].study alone."""

    name: Text = Field(description="Name of the study, as in runs[].study; the heading on the page.")
    over: Text | None = Field(
        None,
        description="Dotted key of the runs' configs whose number they vary, as in estimate.time_step: figures over it, a line a "
        "group.",
    )
    numbers: tuple[Text, ...] = expert(
        (),
        description="Numbers of `estimate`, of a placement `validate`, that are drawn over it, as in slope.Fz; without any: the "
        "error of every unknown beside its claimed standard deviation.",
    )


def study_problems(studies: Sequence[StudySection], named: Sequence[str]) -> Iterator[Problem]:
    """What is wrong with the studies; named: those of the runs."""
    for i, study in enumerate(studies):
        if study.name in [other.name for other in studies[:i]]:
            yield Problem(f"studies.{i}.name", f"'{study.name}' is listed twice", "list every study once")
        elif study.name not in named:
            yield Problem(f"studies.{i}.name", f"no run is of the study '{study.name}'", "name it in runs[].study")
        if study.numbers and study.over is None:
            yield Problem(f"studies.{i}.numbers", "there is nothing to draw them over", "give over: KEY", at_key=True)


DOTTED = re.compile(r"[\w-]+(\.[\w-]+)*")
"""A dotted key, as in --set place.keep=6."""
OWN = {"name": "give name: NAME beside config:", "kind": "the kind of a config is its own"}


class Overriding(Section):
    """What is put over a config."""

    overrides: dict[str, JsonValue] = Field(
        {}, alias="set", description="Dotted key → value, put over the config of the run, or of every run, as by --set."
    )


class SuiteRun(Overriding, Noted):
    """One run of a suite."""

    config: Text = Field(description="Config of the run, from the folder of the suite's file.")
    label: Text = Field(description="What the page calls the run.")
    name: RunName | None = Field(None, description="Name of the run in place of its config's own.")
    until: Text = Field("report", description="Last stage to run.")
    study: Text | None = Field(None, description="Name of the study; its runs share a heading and their figures.")
    group: str = Field("", description="Runs of one group are one line in figures over a varied key.")


class SuiteConfig(Overriding):
    """Runs that belong together: each is brought up to date, then one page shows them side by side."""

    kind: Literal["suite"] = Field(description="Which pipeline.")
    name: RunName = Field(description="Name of the suite; its page and numbers go to results/NAME.")
    title: Text = Field(description="Title of the page.")
    suffix: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]*$", max_length=50)] = expert(
        "", description="Put behind the name of every run: letters, digits, - and _."
    )
    jobs: int = Field(
        1, ge=1, le=64, description="Runs at a time [-]: two halve the time where the memory is enough for both."
    )
    runs: Annotated[tuple[SuiteRun, ...], Field(min_length=1)] = Field(
        description="The runs, in order: placements and benches."
    )
    studies: tuple[StudySection, ...] = Field(
        (), description="What more there is to say of studies named in runs[].study."
    )
    claims: tuple[ClaimSection, ...] = Field(
        (), description="Statements that the page calls confirmed or contradicted."
    )
    comparisons: tuple[ComparisonSection, ...] = Field(
        (), description="What a source says, row by row, beside what comes out under its settings and under ours."
    )


def suite_problems(config: SuiteConfig) -> Iterator[Problem]:
    """What is wrong with a suite by itself, before any config of its runs is read."""
    yield from _lines({"title": config.title})
    yield from _overrides("set", config.overrides)
    for i, run in enumerate(config.runs):
        texts = {"label": run.label, "note": run.note, "study": run.study or "", "group": run.group}
        yield from _lines({f"runs.{i}.{key}": text for key, text in texts.items()})
        yield from _overrides(f"runs.{i}.set", run.overrides)
    for i, study in enumerate(config.studies):
        yield from _lines({f"studies.{i}.name": study.name, f"studies.{i}.note": study.note})
    for i, claim in enumerate(config.claims):
        yield from _lines({f"claims.{i}.{key}": getattr(claim, key) for key in ("text", "why")})
    for i, row in enumerate(config.comparisons):
        yield from _lines({f"comparisons.{i}.{key}": getattr(row, key) for key in ("source", "says", "printed", "why")})
    yield from _lines(
        {f"{key}.unit": measure.unit for key, measure in measures_of(config.claims, config.comparisons).items()}
    )
    yield from study_problems(config.studies, [run.study for run in config.runs if run.study is not None])
    yield from section_problems(config)


def _lines(texts: Mapping[str, str]) -> Iterator[Problem]:
    """What is printed has to be one line without anything that a terminal acts upon."""
    for key, text in texts.items():
        if bad := next((c for c in text if unicodedata.category(c) in ("Cc", "Zl", "Zp")), None):
            what = "a line break" if bad in "\n\r\u2028\u2029" else f"the control character U+{ord(bad):04X}"
            yield Problem(key, f"holds {what}", "write plain text on one line; a folded block begins with >-")


def _overrides(section: str, overrides: dict[str, JsonValue]) -> Iterator[Problem]:
    for key in overrides:
        if not DOTTED.fullmatch(key):
            yield Problem(
                f"{section}.{key}", f"'{key}' is not a dotted key", "write it as in --set: place.keep: 6", at_key=True
            )
        elif key in OWN:
            yield Problem(f"{section}.{key}", f"a suite cannot set '{key}'", OWN[key], at_key=True)

"""The config of `kind: suite`: a list of ordinary configs and one page about all of them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator, Mapping
from typing import Annotated, Literal

from pydantic import Field, JsonValue

from strainsight.config.base import RunName, Section, Text
from strainsight.config.problem import Problem
from strainsight.config.suite_measures import Claim, Comparison, measure_problems, measures_of
from strainsight.config.suite_studies import Study, study_problems

DOTTED = re.compile(r"[\w-]+(\.[\w-]+)*")
"""A dotted key, as in --set place.keep=6."""
OWN = {"name": "give name: NAME beside config:", "kind": "the kind of a config is its own"}


class SuiteRun(Section):
    """One run of a suite."""

    config: Text = Field(description="Config of the run, from the folder of the suite's file.")
    label: Text = Field(description="What the page calls the run.")
    name: RunName | None = Field(None, description="Name of the run in place of its config's own.")
    overrides: dict[str, JsonValue] = Field(
        {}, alias="set", description="Dotted key → value, put over the config as by --set."
    )
    until: Text = Field("report", description="Last stage to run.")
    note: str = Field("", description="A sentence that the page shows with the run.")
    study: Text | None = Field(None, description="Name of the study; its runs share a heading and their figures.")
    group: str = Field("", description="Runs of one group are one line in figures over a varied key.")


class SuiteConfig(Section):
    """Runs that belong together: each is brought up to date, then one page shows them side by side."""

    kind: Literal["suite"] = Field(description="Which pipeline.")
    name: RunName = Field(description="Name of the suite; its page and numbers go to results/NAME.")
    title: Text = Field(description="Title of the page.")
    overrides: dict[str, JsonValue] = Field(
        {}, alias="set", description="Dotted key → value, put over the config of every run as by --set."
    )
    suffix: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]*$", max_length=50)] = Field(
        "", description="Put behind the name of every run: letters, digits, - and _."
    )
    jobs: int = Field(
        1, ge=1, le=64, description="Runs at a time [-]: two halve the time where the memory is enough for both."
    )
    runs: Annotated[tuple[SuiteRun, ...], Field(min_length=1)] = Field(
        description="The runs, in order: placements and benches."
    )
    studies: tuple[Study, ...] = Field((), description="What more there is to say of studies named in runs[].study.")
    claims: tuple[Claim, ...] = Field((), description="Statements that the page calls confirmed or contradicted.")
    comparisons: tuple[Comparison, ...] = Field(
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
    yield from _lines({f"{key}.unit": own.unit for key, own in measures_of(config.claims, config.comparisons).items()})
    yield from study_problems(config.studies, [run.study for run in config.runs if run.study is not None])
    yield from measure_problems(config.claims, config.comparisons)


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

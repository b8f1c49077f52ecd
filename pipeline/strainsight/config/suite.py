"""Config of `kind: suite`: a list of configs with one common page."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field, JsonValue

from strainsight.config.base import DOTTED, READING, Problem, RunName, Section, Text, expert, section_problems

Texts = Annotated[tuple[Text, ...], Field(min_length=1)]


class Measure(Section):
    """A result of one or several runs, with limits."""

    run: Text | Texts = Field(
        description="Name of the run without the suffix of the suite, or a list of names; the limits apply to each run."
    )
    number: Text | Texts = Field(
        description="Name of the result in the group `summary` of the HDF5 file of the stage, or a list of names. Example: "
        "slope.Fz, the slope of the estimated over the true load Fz."
    )
    stage: Text | None = Field(
        None, description="Stage that computes the result; null: `estimate` for a bench, `validate` for a placement."
    )
    times: Annotated[float, READING] = Field(
        1.0, description="Factor by which the result is multiplied before the comparison with the limits [-]."
    )
    against: Text | None = Field(
        None, description="Name of a reference run; the result is divided by the result of the reference run."
    )
    against_number: Text | None = Field(
        None, description="Name of the result of the reference run; null: the name in `number`."
    )
    above: Annotated[float | None, READING] = Field(None, description="Lower limit of the result.")
    below: Annotated[float | None, READING] = Field(None, description="Upper limit of the result.")
    equals: bool | None = Field(None, description="Required value of a result that is true or false.")
    unit: str = Field(
        "", description="Unit or text after the result on the page of the suite, such as `N` or `of the weight`."
    )

    def problems(self) -> Iterator[Problem]:
        bounds = [value for value in (self.above, self.below) if value is not None]
        if self.equals is None and not bounds:
            yield Problem(
                "", "no limit is set", "set `above`, `below` or both; or set `equals` to true or false", at_key=True
            )
        elif self.equals is not None and (bounds or self.against is not None or self.times != 1):
            yield Problem(
                "equals", "cannot be combined with above, below, against or times", "remove `equals` or the other keys"
            )
        elif len(bounds) == 2 and not bounds[0] < bounds[1]:
            what = f"the lower limit {bounds[0]:g} is not smaller than the upper limit {bounds[1]:g} (`below`)"
            yield Problem("above", what, "exchange the values of `above` and `below`")
        if self.against_number is not None and self.against is None:
            what = "the reference run is missing"
            yield Problem("against_number", what, "set `against: RUN`, or remove `against_number`", at_key=True)


class WithReason(Section):
    """A claim or comparison with an explanation."""

    why: str = Field(
        "",
        description="Explanation of the result, or of a missing result, printed on the page of the suite. A claim that is "
        "not confirmed and has no explanation is marked on the page.",
    )


class Noted(Section):
    """A run or study with a note."""

    note: str = Field("", description="Note on this run or study, printed on the page of the suite.")


class ClaimSection(Measure, WithReason):
    """A claim on results of runs; it is confirmed if all results are within the limits."""

    text: Text = Field(description="Text of the claim.")


class ComparisonSection(WithReason):
    """A comparison of a published result with two kinds of runs: with the published settings, and with other settings."""

    source: Text = Field(description="Location in the publication, such as figure 2.4.")
    statement: Text = Field(description="Finding of the publication that is compared with the runs, in words.")
    published: str = Field("", description="Reference value exactly as printed in the publication, as text.")
    published_settings: Measure | None = Field(
        None, description="Results of runs with the settings of the publication."
    )
    other_settings: Measure | None = Field(
        None, description="Results of runs with settings other than those of the publication."
    )

    def problems(self) -> Iterator[Problem]:
        if self.published_settings is None and self.other_settings is None and not self.why:
            remedy = (
                "set `published_settings` or `other_settings`, or explain under `why` that no result can be computed"
            )
            yield Problem("", "no result and no explanation is set", remedy, at_key=True)


def as_texts(value: str | Sequence[str]) -> tuple[str, ...]:
    """One text or a list, as a tuple."""
    return (value,) if isinstance(value, str) else tuple(value)


def measures_of(claims: Sequence[ClaimSection], comparisons: Sequence[ComparisonSection]) -> dict[str, Measure]:
    """Every measure of a suite by dotted key: its claims, then both columns of its comparisons."""
    measures: dict[str, Measure] = {f"claims.{i}": claim for i, claim in enumerate(claims)}
    for i, row in enumerate(comparisons):
        sides = {"published_settings": row.published_settings, "other_settings": row.other_settings}
        measures |= {f"comparisons.{i}.{side}": measure for side, measure in sides.items() if measure is not None}
    return measures


class StudySection(Noted):
    """A study: runs with a common heading and common figures on the page. runs[].study assigns the runs to the study."""

    name: Text = Field(description="Name of the study, as in runs[].study; the page has a heading with this name.")
    over: Text | None = Field(
        None,
        description="Dotted key that the runs vary, such as estimate.time_step. The figures show the values of this key on the "
        "horizontal axis, with one line for each group.",
    )
    numbers: tuple[Text, ...] = expert(
        (),
        description="Results to plot, such as slope.Fz, from the group `summary` of estimate.h5 (for a placement, "
        "of validate.h5). Default: error and standard deviation of every unknown.",
    )


def study_problems(studies: Sequence[StudySection], named: Sequence[str]) -> Iterator[Problem]:
    """Yield the problems of the studies; named: studies of the runs."""
    for i, study in enumerate(studies):
        if study.name in [other.name for other in studies[:i]]:
            yield Problem(f"studies.{i}.name", f"'{study.name}' appears twice", "remove one of the two studies")
        elif study.name not in named:
            what = f"no run belongs to the study '{study.name}'"
            yield Problem(f"studies.{i}.name", what, "set `study` of a run to this name, or remove the study")
        if study.numbers and study.over is None:
            remedy = "set `over` to the key that the runs vary, or remove `numbers`"
            yield Problem(f"studies.{i}.numbers", "the figures have no horizontal axis (`over`)", remedy, at_key=True)


OWN = {
    "name": "set `name` in each entry of `runs`, next to `config`",
    "kind": "remove `kind`; the config of each run defines its kind",
}


class Overriding(Section):
    """Overrides of keys in a config."""

    overrides: dict[str, JsonValue] = Field(
        {},
        alias="set",
        description="Overrides of config keys, as with --set: dotted key and value, such as place.keep: 6. In an entry of "
        "`runs`, they apply to this run; in the suite itself, to every run.",
    )


class SuiteRun(Overriding, Noted):
    """One run of a suite."""

    config: Text = Field(description="Config of the run, relative to the folder of the suite.")
    label: Text = Field(description="Label of the run on the page of the suite.")
    name: RunName | None = Field(None, description="Name of the run; null: the name in its config.")
    until: Text = Field("report", description="Last stage of the run to compute.")
    study: Text | None = Field(None, description="Name of the study; runs of one study share a heading and figures.")
    group: str = Field("", description="Group of the run; runs of one group form one line in the figures.")


class SuiteConfig(Overriding):
    """A suite of runs. A suite updates each run, and then compares the runs on one page."""

    kind: Literal["suite"] = Field(description="Kind of config: suite of runs.")
    name: RunName = Field(description="Name of the suite; its page and results are written to results/NAME.")
    title: Text = Field(description="Title of the page of the suite.")
    suffix: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]*$", max_length=50)] = expert(
        "", description="Suffix that is added to the name of every run: letters, digits, - and _."
    )
    jobs: int = Field(
        1,
        ge=1,
        le=64,
        description="Number of simultaneous runs [-]; 2 simultaneous runs halve the time if the memory is sufficient.",
    )
    runs: Annotated[tuple[SuiteRun, ...], Field(min_length=1)] = Field(
        description="Runs of the suite (placements and benches), in the order of computation."
    )
    studies: tuple[StudySection, ...] = Field(
        (), description="Notes, horizontal axes and plotted results of the studies named in runs[].study."
    )
    claims: tuple[ClaimSection, ...] = Field(
        (), description="Claims that the page reports as confirmed or not confirmed."
    )
    comparisons: tuple[ComparisonSection, ...] = Field(
        (),
        description="Comparisons of published results with two kinds of runs: with the published settings, and with other "
        "settings.",
    )


def suite_problems(config: SuiteConfig) -> Iterator[Problem]:
    """Yield the problems of a suite, before the configs of its runs are read."""
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
        yield from _lines(
            {f"comparisons.{i}.{key}": getattr(row, key) for key in ("source", "statement", "published", "why")}
        )
    yield from _lines(
        {f"{key}.unit": measure.unit for key, measure in measures_of(config.claims, config.comparisons).items()}
    )
    yield from study_problems(config.studies, [run.study for run in config.runs if run.study is not None])
    yield from section_problems(config)


def _lines(texts: Mapping[str, str]) -> Iterator[Problem]:
    """Yield a problem for printed text with line breaks or control characters."""
    for key, text in texts.items():
        if bad := next((c for c in text if unicodedata.category(c) in ("Cc", "Zl", "Zp")), None):
            what = "a line break" if bad in "\n\r\u2028\u2029" else f"the control character U+{ord(bad):04X}"
            yield Problem(
                key, f"the text contains {what}", "write plain text on one line; in YAML, >- joins several lines"
            )


def _overrides(section: str, overrides: dict[str, JsonValue]) -> Iterator[Problem]:
    for key in overrides:
        if not DOTTED.fullmatch(key):
            yield Problem(
                f"{section}.{key}",
                f"'{key}' is not a dotted key",
                "write the key as after --set, such as place.keep: 6",
                at_key=True,
            )
        elif key in OWN:
            yield Problem(f"{section}.{key}", f"a suite cannot set '{key}'", OWN[key], at_key=True)

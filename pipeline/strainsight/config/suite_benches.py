"""What a suite of benches demands of the configs of its runs, and what its page is told of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from strainsight.config.keys import place_in
from strainsight.config.suite import SuiteConfig
from strainsight.config.suite_studies import Study, as_texts
from strainsight.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from strainsight.config.load import LoadedConfig
    from strainsight.config.suite_runs import PlannedRun

SHOWN = ("simulate", "estimate", "place", "report")
"""Stages whose artefacts the page is made of."""
STAGE = "estimate"
"""Stage of a claim that says none."""


def refused(
    suite: LoadedConfig, model: SuiteConfig, runs: Sequence[PlannedRun], names: Sequence[str]
) -> Iterator[ConfigError]:
    """What is wrong with runs of several kinds, with studies and with claims, each with its place.

    runs under their final names; names: before the suffix, as claims say them.
    """
    kind = runs[0].config.data["kind"]
    mixed = [run for run in runs if run.config.data["kind"] != kind]
    for run in mixed:
        yield _wrong(
            suite,
            f"runs.{run.place}.config",
            f"{run.config.path.name} is a {run.config.data['kind']}, runs[0] a {kind}",
            "a page is about placements or about benches: make two suites",
        )
    if mixed:
        return
    if kind == "placement":
        yield from _only_benches(suite, model)
        return
    for run in runs:
        study = study_of(model, run)
        if study is not None and study.over is not None and value_over(run.config.data, study.over) is None:
            yield _wrong(
                suite,
                f"studies.{model.studies.index(study)}.over",
                f"{study.over} is no number in runs[{run.place}], '{run.config.data['name']}'",
                "name a key that is a number in every run of the study, or set it there",
            )
    for i, claim in enumerate(model.claims):
        said = [("run", name) for name in as_texts(claim.run)]
        said += [("against", claim.against)] if claim.against is not None else []
        for key, name in said:
            if name not in names:
                known = f"its runs are {', '.join(names)}"
                yield _wrong(
                    suite, f"claims.{i}.{key}", f"no run '{name}' in this suite", did_you_mean(name, names, known)
                )


def study_of(model: SuiteConfig, run: PlannedRun) -> Study | None:
    """What the suite says more of the study of a run."""
    return next((study for study in model.studies if study.name == run.entry.study), None)


def value_over(config: Mapping[str, Any], key: str) -> float | None:
    """The number at a dotted key, places of lists counted from 0; None where there is none."""
    value: Any = config
    for part in key.split("."):
        if isinstance(value, Mapping):
            value = value.get(part)
        elif isinstance(value, list) and (place := place_in(part, len(value))) is not None:
            value = value[place]
        else:
            return None
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def told_of(suite: LoadedConfig, runs: Sequence[PlannedRun], stages: Sequence[Sequence[str]]) -> list[dict[str, Any]]:
    """What the page is told of every run: names, texts, the number that its study varies, its artefacts.

    stages: those that each run is brought through.
    """
    model = suite.model
    assert isinstance(model, SuiteConfig)
    wanted = {*SHOWN, *(claim.stage for claim in model.claims)}
    told = []
    for run, reached in zip(runs, stages, strict=True):
        name, study = run.config.data["name"], study_of(model, run)
        told.append(
            {
                "name": name,
                "label": run.entry.label,
                "note": run.entry.note,
                "study": run.entry.study or "",
                "group": run.entry.group,
                "at": None if study is None or study.over is None else value_over(run.config.data, study.over),
                "reached": reached[-1],
                "artefacts": {stage: f"{name}/{stage}.h5" for stage in reached if stage in wanted},
            }
        )
    return told


def claims_of(suite: LoadedConfig, runs: Sequence[PlannedRun], stages: Sequence[Sequence[str]]) -> list[dict[str, Any]]:
    """The claims with places of runs for their names. Raises ConfigError for a stage that a run does not come to."""
    model = suite.model
    assert isinstance(model, SuiteConfig)
    places = {str(run.config.data["name"]).removesuffix(model.suffix): run.place for run in runs}
    told = []
    for i, claim in enumerate(model.claims):
        own = [places[name] for name in as_texts(claim.run)]
        other = None if claim.against is None else places[claim.against]
        for place in [*own, *([] if other is None else [other])]:
            if claim.stage not in stages[place]:
                raise _wrong(
                    suite,
                    f"claims.{i}.stage" if claim.stage != STAGE else f"claims.{i}.run",
                    f"runs[{place}], '{runs[place].config.data['name']}', has no stage '{claim.stage}': it goes through "
                    f"{', '.join(stages[place])}",
                    "name a stage that it goes through, or take `until` out",
                )
        told.append(
            claim.model_dump(mode="json", exclude={"run", "against"})
            | {"runs": own, "against": other, "number": list(as_texts(claim.number))}
        )
    return told


def _only_benches(suite: LoadedConfig, model: SuiteConfig) -> Iterator[ConfigError]:
    given = [("studies", bool(model.studies)), ("claims", bool(model.claims))]
    for i, run in enumerate(model.runs):
        given += [(f"runs.{i}.study", run.study is not None), (f"runs.{i}.group", bool(run.group))]
    for key, there in given:
        if there:
            yield _wrong(suite, key, "the runs of this suite are placements", "leave it out: it is for benches")


def _wrong(suite: LoadedConfig, key: str, what: str, remedy: str) -> ConfigError:
    first, *rest = key.split(".")
    shown = f"{first}[{rest[0]}].{rest[1]}" if len(rest) == 2 else key
    return ConfigError(what, key=shown, where=suite.locate(key), remedy=remedy)

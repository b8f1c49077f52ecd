"""The runs of a suite, each as the checked config that it stands for."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from strainsight.config.base import leaves, shown_key
from strainsight.config.keys import MISSING, Override, place_in
from strainsight.config.load import LoadedConfig, kind_of, load_config
from strainsight.config.suite import StudySection, SuiteConfig, SuiteRun, as_texts, measures_of
from strainsight.errors import ConfigError, StrainsightError, did_you_mean

Of = TypeVar("Of")
Made = TypeVar("Made")


@dataclass(frozen=True)
class PlannedRun:
    """A run of a suite: its entry and its place in the list, from 0; its config under its final name."""

    entry: SuiteRun
    place: int
    config: LoadedConfig


def runs_of(suite: LoadedConfig) -> tuple[PlannedRun, ...]:
    """The configs of a suite's runs, in order: its `set` put over each, then the run's own, then name and suffix.

    What is taken `from` a run of the suite follows that run's suffix. Raises ConfigError with every problem of every run;
    what `set` made wrong is placed in the suite's file.
    """
    model = suite.model
    assert isinstance(model, SuiteConfig)
    plain = all_of(range(len(model.runs)), lambda i: PlannedRun(model.runs[i], i, _plain(suite, model, i)))
    names = [run.config.model.name for run in plain]
    final = all_of(plain, lambda run: _final(suite, model, run, names))
    all_of(final, lambda run: _refuse_taken(suite, model, final[: run.place], run))
    all_of(_refused(suite, model, final, names), _raise)
    return tuple(final)


def _raise(error: ConfigError) -> None:
    raise error


def all_of(items: Iterable[Of], make: Callable[[Of], Made]) -> list[Made]:
    """What is made of every item; raises the problems of all of them at once, each once."""
    made: list[Made] = []
    problems: dict[str, ConfigError] = {}
    for item in items:
        try:
            made.append(make(item))
        except ConfigError as error:
            listed = [problem for problem in (error, *error.others) if isinstance(problem, ConfigError)]
            error.others = ()
            # A config that several runs share has the same problem in each.
            problems |= {str(problem): problem for problem in listed}
    if problems:
        first, *others = problems.values()
        first.others = tuple(others)
        raise first
    return made


def study_of(model: SuiteConfig, run: PlannedRun) -> StudySection | None:
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


def _plain(suite: LoadedConfig, model: SuiteConfig, i: int) -> LoadedConfig:
    """The config of the i-th run, before the suffix."""
    entry = model.runs[i]
    path = suite.path.parent / entry.config
    key, where = f"runs[{i}].config", suite.locate(f"runs.{i}.config")
    if not _is_file(path):
        raise ConfigError(f"no such file: {path}", key=key, where=where, remedy="paths start from the suite's folder")
    kind = kind_of(path)
    if kind == "suite":
        raise ConfigError(f"{path} is a suite itself", key=key, where=where, remedy="list its runs one by one")
    if kind == "bearing":
        what = f"{path} is a bearing alone: the page of a suite is about placements or benches"
        raise ConfigError(what, key=key, where=where, remedy=f"run it by itself: strainsight run {path}")
    overrides = [
        Override(key, value, suite.locate(f"{section}.{key}"))
        for section, values in (("set", model.overrides), (f"runs.{i}.set", entry.overrides))
        for key, value in values.items()
    ]
    if entry.name is not None:
        overrides.append(Override("name", entry.name, suite.locate(f"runs.{i}.name")))
    try:
        return load_config(path, overrides)
    except ConfigError as error:
        for problem in (error, *error.others):
            _explain_replaced(problem, overrides)
        raise


def _is_file(path: Path) -> bool:
    """Whether it is one; a name that no file can have is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _explain_replaced(problem: StrainsightError, overrides: Sequence[Override]) -> None:
    """Where a key is missing because a whole section was put over the config's own, say how to put only its keys."""
    for override in overrides:
        if (
            problem.what == MISSING
            and isinstance(override.value, dict)
            and str(problem.key).startswith(f"{override.key}.")
        ):
            keys = ", ".join(f"{key}: {json.dumps(value)}" for key, value in leaves(override.key, override.value))
            problem.remedy = f"`set` replaced all of {override.key}: write {keys or 'its keys one by one'}"


def _final(suite: LoadedConfig, model: SuiteConfig, run: PlannedRun, names: Sequence[str]) -> PlannedRun:
    """The run with its suffix; names: of all runs before that."""
    more = list(_taken(run, names, model.suffix))
    if model.suffix:
        more.append(Override("name", names[run.place] + model.suffix, suite.locate("suffix")))
    if not more:
        return run
    return PlannedRun(run.entry, run.place, load_config(run.config.path, (*run.config.overrides, *more)))


def _taken(run: PlannedRun, names: Sequence[str], suffix: str) -> Iterator[Override]:
    """What comes from runs of the suite, under the names that these have here."""
    for key, source in leaves("", run.config.data):
        if not key.endswith(".from") or not isinstance(source, str):
            continue
        where = run.config.locate(key)
        if source in names[: run.place]:
            if suffix:
                yield Override(key, source + suffix, where)
        elif source in names:
            what = "the guess" if ".guess." in key else "it"
            raise ConfigError(
                f"{what} comes from '{source}', which the suite runs later",
                key=key,
                where=where,
                remedy="list that run before this one",
            )


def _refuse_taken(suite: LoadedConfig, model: SuiteConfig, before: Sequence[PlannedRun], run: PlannedRun) -> None:
    name = run.config.model.name
    taken = {model.name: "the suite itself"} | {other.config.model.name: f"runs[{other.place}]" for other in before}
    if name in taken:
        raise ConfigError(
            f"the run is named '{name}', as is {taken[name]}",
            key=f"runs[{run.place}].name",
            where=suite.locate(f"runs.{run.place}.name"),
            remedy="give it another name beside its config: name: NAME",
        )


def _refused(
    suite: LoadedConfig, model: SuiteConfig, runs: Sequence[PlannedRun], names: Sequence[str]
) -> Iterator[ConfigError]:
    """What is wrong with studies and with measures, each with its place; names: before the suffix,
    as measures say them."""
    for run in runs:
        study = study_of(model, run)
        if study is not None and study.over is not None and value_over(run.config.data, study.over) is None:
            yield wrong(
                suite,
                f"studies.{model.studies.index(study)}.over",
                f"{study.over} is no number in runs[{run.place}], '{run.config.data['name']}'",
                "name a key that is a number in every run of the study, or set it there",
            )
    for place, measure in measures_of(model.claims, model.comparisons).items():
        named = [("run", name) for name in as_texts(measure.run)]
        named += [("against", measure.against)] if measure.against is not None else []
        for key, name in named:
            if name not in names:
                known = f"its runs are {', '.join(names)}"
                yield wrong(suite, f"{place}.{key}", f"no run '{name}' in this suite", did_you_mean(name, names, known))


def wrong(suite: LoadedConfig, key: str, what: str, remedy: str) -> ConfigError:
    """An error at a dotted key of the suite."""
    return ConfigError(what, key=shown_key(key), where=suite.locate(key), remedy=remedy)

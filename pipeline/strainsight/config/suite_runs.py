"""The runs of a suite, each as a checked config."""

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
    """A run of a suite: its entry, its index in the list, and its config under the final name."""

    entry: SuiteRun
    place: int
    config: LoadedConfig


def runs_of(suite: LoadedConfig) -> tuple[PlannedRun, ...]:
    """Configs of the runs of a suite, in order. The `set` of the suite applies first, then that of the run, then name and suffix.

    A `from` that names another run of the suite gets its suffix. Raises ConfigError with every problem of every run; problems
    caused by `set` are located in the file of the suite."""
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
    """Apply `make` to every item; raise the problems of all items at once, without duplicates."""
    results: list[Made] = []
    problems: dict[str, ConfigError] = {}
    for item in items:
        try:
            results.append(make(item))
        except ConfigError as error:
            listed = [problem for problem in (error, *error.others) if isinstance(problem, ConfigError)]
            error.others = ()
            # A config that several runs share has the same problem in each.
            problems |= {str(problem): problem for problem in listed}
    if problems:
        first, *others = problems.values()
        first.others = tuple(others)
        raise first
    return results


def study_of(model: SuiteConfig, run: PlannedRun) -> StudySection | None:
    """Entry of the study of a run, or None."""
    return next((study for study in model.studies if study.name == run.entry.study), None)


def number_at(config: Mapping[str, Any], key: str) -> float | None:
    """Number at a dotted key (list indices from 0), or None."""
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
    """Config of the i-th run, without the suffix."""
    entry = model.runs[i]
    path = suite.path.parent / entry.config
    key, where = f"runs[{i}].config", suite.locate(f"runs.{i}.config")
    if not _is_file(path):
        raise ConfigError(
            f"file not found: {path}", key=key, where=where, remedy="paths are relative to the folder of the suite"
        )
    kind = kind_of(path)
    if kind == "suite":
        raise ConfigError(f"{path} is a suite", key=key, where=where, remedy="list the runs of that suite instead")
    if kind == "bearing":
        what = f"{path} is a bearing config; a suite can contain placements and benches only"
        raise ConfigError(what, key=key, where=where, remedy=f"run it separately: strainsight run {path}")
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
    """Whether the path is an existing file; invalid names are not."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _explain_replaced(problem: StrainsightError, overrides: Sequence[Override]) -> None:
    """Add a hint if a key is missing because an override replaced its whole section."""
    for override in overrides:
        if (
            problem.what == MISSING
            and isinstance(override.value, dict)
            and str(problem.key).startswith(f"{override.key}.")
        ):
            keys = ", ".join(f"{key}: {json.dumps(value)}" for key, value in leaves(override.key, override.value))
            problem.remedy = (
                f"`set` replaced the whole section {override.key}; set single keys there: {keys or 'KEY: VALUE'}"
            )


def _final(suite: LoadedConfig, model: SuiteConfig, run: PlannedRun, names: Sequence[str]) -> PlannedRun:
    """The run with its suffix; names: names of all runs without suffix."""
    more = list(_renamed_sources(run, names, model.suffix))
    if model.suffix:
        more.append(Override("name", names[run.place] + model.suffix, suite.locate("suffix")))
    if not more:
        return run
    return PlannedRun(run.entry, run.place, load_config(run.config.path, (*run.config.overrides, *more)))


def _renamed_sources(run: PlannedRun, names: Sequence[str], suffix: str) -> Iterator[Override]:
    """Overrides of `from` keys that refer to runs of this suite."""
    for key, source in leaves("", run.config.data):
        if not key.endswith(".from") or not isinstance(source, str):
            continue
        where = run.config.locate(key)
        if source in names[: run.place]:
            if suffix:
                yield Override(key, source + suffix, where)
        elif source in names:
            what = "the guess" if ".guess." in key else "this key"
            raise ConfigError(
                f"{what} uses the result of run '{source}', but the suite runs '{source}' later",
                key=key,
                where=where,
                remedy=f"move run '{source}' before this run",
            )


def _refuse_taken(suite: LoadedConfig, model: SuiteConfig, before: Sequence[PlannedRun], run: PlannedRun) -> None:
    name = run.config.model.name
    owners = {model.name: "the suite"} | {other.config.model.name: f"runs[{other.place}]" for other in before}
    if name in owners:
        raise ConfigError(
            f"the run name '{name}' is already the name of {owners[name]}",
            key=f"runs[{run.place}].name",
            where=suite.locate(f"runs.{run.place}.name"),
            remedy="set `name` of this entry of `runs` to another name",
        )


def _refused(
    suite: LoadedConfig, model: SuiteConfig, runs: Sequence[PlannedRun], names: Sequence[str]
) -> Iterator[ConfigError]:
    """Yield the errors of studies and measures; names: run names without suffix, as in measures."""
    for run in runs:
        study = study_of(model, run)
        if study is not None and study.over is not None and number_at(run.config.data, study.over) is None:
            yield wrong(
                suite,
                f"studies.{model.studies.index(study)}.over",
                f"{study.over} is not a number in the config of run '{run.config.model.name}' (runs[{run.place}])",
                f"use a key that is a number in every run of the study, or set {study.over} under runs[{run.place}].set",
            )
    for place, measure in measures_of(model.claims, model.comparisons).items():
        named = [("run", name) for name in as_texts(measure.run)]
        named += [("against", measure.against)] if measure.against is not None else []
        for key, name in named:
            if name not in names:
                known = f"known runs: {', '.join(names)}"
                yield wrong(
                    suite, f"{place}.{key}", f"unknown run '{name}' in this suite", did_you_mean(name, names, known)
                )


def wrong(suite: LoadedConfig, key: str, what: str, remedy: str) -> ConfigError:
    """Error at a dotted key of the suite."""
    return ConfigError(what, key=shown_key(key), where=suite.locate(key), remedy=remedy)

"""The runs of a suite, each as the checked config that it stands for."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from strainsight.config.load import LoadedConfig, Override, kind_of, load_config
from strainsight.config.suite import SuiteConfig, SuiteRun
from strainsight.errors import ConfigError

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

    A guess that comes from a run of the suite follows that run's suffix. Raises ConfigError with every problem of every
    run; what `set` made wrong is placed in the suite's file.
    """
    model = suite.model
    assert isinstance(model, SuiteConfig)
    plain = _each(range(len(model.runs)), lambda i: PlannedRun(model.runs[i], i, _plain(suite, model, i)))
    names = [run.config.model.name for run in plain]
    found = _each(plain, lambda run: _final(suite, model, run, names))
    _each(found, lambda run: _refuse_taken(suite, model, found[: run.place], run))
    return tuple(found)


def _each(items: Iterable[Of], make: Callable[[Of], Made]) -> list[Made]:
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


def _plain(suite: LoadedConfig, model: SuiteConfig, i: int) -> LoadedConfig:
    """The config of the i-th run, before the suffix."""
    entry = model.runs[i]
    path = suite.path.parent / entry.config
    key, where = f"runs[{i}].config", suite.locate(f"runs.{i}.config")
    if not path.is_file():
        raise ConfigError(f"no such file: {path}", key=key, where=where, remedy="paths start from the suite's folder")
    if kind_of(path) == "suite":
        raise ConfigError(f"{path} is a suite itself", key=key, where=where, remedy="list its runs one by one")
    overrides = [
        Override(key, value, suite.locate(f"{section}.{key}"))
        for section, values in (("set", model.overrides), (f"runs.{i}.set", entry.overrides))
        for key, value in values.items()
    ]
    if entry.name is not None:
        overrides.append(Override("name", entry.name, suite.locate(f"runs.{i}.name")))
    return load_config(path, overrides)


def _final(suite: LoadedConfig, model: SuiteConfig, run: PlannedRun, names: Sequence[str]) -> PlannedRun:
    """The run with its suffix; names: of all runs before that."""
    more = list(_guesses(run, names, model.suffix))
    if model.suffix:
        more.append(Override("name", names[run.place] + model.suffix, suite.locate("suffix")))
    if not more:
        return run
    return PlannedRun(run.entry, run.place, load_config(run.config.path, (*run.config.overrides, *more)))


def _guesses(run: PlannedRun, names: Sequence[str], suffix: str) -> Iterator[Override]:
    """The guesses that come from runs of the suite, under the names that these have here."""
    for name, entry in run.config.data["parameters"].items():
        if not isinstance(entry["guess"], dict):
            continue
        source = str(entry["guess"]["from"])
        key = f"parameters.{name}.guess.from"
        where = run.config.locate(key)
        if source in names[: run.place]:
            if suffix:
                yield Override(key, source + suffix, where)
        elif source in names:
            raise ConfigError(
                f"the guess comes from '{source}', which the suite runs later",
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

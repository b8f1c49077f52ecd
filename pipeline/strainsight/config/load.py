"""Load and check a config file: all problems are reported at once, each with its location."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from strainsight.config.base import Problem, shown_key
from strainsight.config.keys import NO_VALUE, Override, explain_suite_key, explained, parsed, problems_of, put
from strainsight.config.yaml_text import LARGEST, Document, YamlProblem, parse
from strainsight.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from strainsight.config.bench.bench import BenchConfig
    from strainsight.config.bench.bodies import BearingConfig
    from strainsight.config.placement import PlacementConfig
    from strainsight.config.suite import SuiteConfig

    Config = PlacementConfig | BenchConfig | BearingConfig | SuiteConfig

KINDS = ("placement", "bench", "bearing", "suite")
"""Kinds of config."""


def model_and_check(kind: str) -> tuple[type[Config], Callable[[Any], Iterator[Problem]]]:
    """Model of a kind of config, and the check for inconsistencies between fields; other kinds are not imported."""
    if kind == "placement":
        from strainsight.config.checks import problems
        from strainsight.config.placement import PlacementConfig

        return PlacementConfig, problems
    if kind == "suite":
        from strainsight.config.suite import SuiteConfig, suite_problems

        return SuiteConfig, suite_problems
    from strainsight.config.bench.bench import BenchConfig
    from strainsight.config.bench.bodies import BearingConfig
    from strainsight.config.bench.checks import bearing_problems, bench_problems

    return (BenchConfig, bench_problems) if kind == "bench" else (BearingConfig, bearing_problems)


@dataclass(frozen=True)
class LoadedConfig:
    """A valid config with the location of each key.

    path       path of the file, as passed
    model      the checked config
    overrides  overrides of the file, in order
    """

    path: Path
    model: Config
    overrides: tuple[Override, ...] = ()
    _places: Mapping[str, str] = field(default_factory=dict, repr=False)

    @property
    def data(self) -> dict[str, Any]:
        """The config as JSON data, with defaults, and paths as written; absent sections are None."""
        return self.model.model_dump(mode="json", by_alias=True, warnings=False)

    def locate(self, key: str) -> str:
        """Location "file:line:column" of a key or of its nearest existing parent; "--set KEY" for an override."""
        return _locate(self._places, key)


def load_config(path: Path | str, overrides: Iterable[str | Override] = (), stage: str | None = None) -> LoadedConfig:
    """Read and check a config file with overrides; a text override is "KEY=VALUE", as after --set. stage: last stage to run, for
    a placement without the sections of later stages; None: the last of all.

    Raises ConfigError with every problem: file:line:column, key and remedy."""
    path = Path(path)
    put_over = tuple(parsed(text) if isinstance(text, str) else text for text in overrides)
    data, places, key_places, blank = _read(path)
    created: list[str] = []
    for override in put_over:
        sections, key = put(data, override), override.key
        created += sections
        for stale in [old for old in places if old == key or old.startswith(f"{key}.")]:
            del places[stale], key_places[stale]
        for new in (*sections, key):
            places[new] = key_places[new] = override.where
    _rename(data, places, key_places)
    model, wrong = _validated(data, stage)
    while model is None and (unfinished := _unfinished(data, wrong, blank, stage)):
        for section in unfinished:
            del data[section]
            warnings.warn(
                f"{_locate(key_places, section)}  {section}: the section has blank lines; `{stage}` does not need it.",
                UserWarning,
            )
        blank = [key for key in blank if key.split(".")[0] in data]
        model, wrong = _validated(data, stage)
    if model is None:
        reported = {problem.key for problem in wrong} | {override.key for override in put_over}
        for key in [key for key in blank if not {key, key.rpartition(".")[0]} & reported]:
            wrong.append(Problem(key, NO_VALUE, "fill in this line, or remove it", at_key=True))
        if data.get("kind") == "suite":
            wrong = [explain_suite_key(problem, put_over) for problem in wrong]
        elif isinstance(data.get("kind"), str) and data["kind"] in KINDS:
            wrong = [explained(problem, created, model_and_check(data["kind"])[0], data) for problem in wrong]
        first, *others = [_error_at(_locate(key_places if p.at_key else places, p.key), p) for p in wrong]
        first.others = tuple(others)
        raise first
    return LoadedConfig(path, model, put_over, places)


RENAMED_KEYS = {
    "gauges.given": "strain_operator",
    "estimate.accept": "accept_inconsistent",
    "estimate.allow_unfollowed": "allow_unresolved_steps",
    "estimate.loads_as_stated": "loads_follow_model",
    "mesh.results.loads.*.applied": "magnitude",
    "mesh.results.second.loads.*.applied": "magnitude",
    "joints.*.held": "fixed",
    "comparisons.*.says": "statement",
    "comparisons.*.printed": "published",
    "comparisons.*.as_printed": "published_settings",
    "comparisons.*.ours": "other_settings",
}
"""Old key → its new name. Old keys are accepted until the first release."""

RENAMED_VALUES = {
    "filter.method": {"bank": "grid"},
    "validate.truth.model": {"rich": "perturbed"},
    "estimate.method.parameters": {"bank": "grid"},
    "estimate.truth.model": {"own": "filter_step", "other": "independent", "walk": "sampled"},
}
"""Key → its old values and their new names. Old values are accepted until the first release."""


def _rename(data: dict[str, Any], *tables: dict[str, str]) -> None:
    """Replace old keys and values by new ones, with a warning; tables: locations by dotted key."""
    for key, name in RENAMED_KEYS.items():
        for section, above, old in list(_entries(data, key.split("."))):
            if name not in section:
                _warn_renamed(tables[0], f"{above}{old}", old, name)
                section[name] = section.pop(old)
                for table in tables:
                    for place in [place for place in table if f"{place}.".startswith(f"{above}{old}.")]:
                        table[f"{above}{name}{place.removeprefix(above + old)}"] = table.pop(place)
    for key, names in RENAMED_VALUES.items():
        for section, above, last in _entries(data, key.split(".")):
            value = section[last]
            if isinstance(value, str) and value in names:
                _warn_renamed(tables[0], f"{above}{last}", value, names[value])
                section[last] = names[value]


def _entries(node: Any, path: Sequence[str], above: str = "") -> Iterator[tuple[dict[str, Any], str, str]]:
    """Yield (section, dotted key above with a final dot, key) of every entry at a path; `*` is any key or list index."""
    first, *rest = path
    entries: dict[Any, Any] = (
        dict(enumerate(node)) if isinstance(node, list) else node if isinstance(node, dict) else {}
    )
    for key in entries if first == "*" else [first] if first in entries else []:
        if rest:
            yield from _entries(entries[key], rest, f"{above}{key}.")
        else:
            yield entries, above, str(key)


def _warn_renamed(places: Mapping[str, str], key: str, old: str, new: str) -> None:
    warnings.warn(
        f"{_locate(places, key)}  {key}: '{old}' is now called '{new}'. Write '{new}', since later versions do not "
        f"accept '{old}'.",
        UserWarning,
    )


def kind_of(path: Path | str) -> Any:
    """The value of `kind` in the file; the rest is not checked."""
    return _read(Path(path))[0].get("kind")


def _unfinished(
    data: Mapping[str, Any], wrong: Sequence[Problem], blank: Iterable[str], stage: str | None
) -> list[str]:
    """Sections of a placement with a problem and a blank line that neither the stage nor one before it needs."""
    if data.get("kind") != "placement":
        return []
    from strainsight.config.placement import later_sections

    faulty, open_ = ({key.split(".")[0] for key in keys} for keys in ((problem.key for problem in wrong), blank))
    return sorted(later_sections(stage) & faulty & open_)


def _validated(data: dict[str, Any], stage: str | None) -> tuple[Config | None, list[Problem]]:
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        known = ", ".join(KINDS)
        if kind is None:
            return None, [Problem("kind", "missing", f"set kind to one of {known}", at_key=True)]
        return None, [
            Problem(
                "kind", f"'{kind}' is not one of {known}", did_you_mean(str(kind), KINDS, f"set kind to one of {known}")
            )
        ]
    kind_model, check = model_and_check(kind)
    if kind == "placement":
        from strainsight.config.gauge_types import filled

        data = dict(filled(data))
    try:
        # As JSON, where a list may become a tuple but text never a number.
        model = kind_model.model_validate_json(json.dumps(data))
    except ValidationError as error:
        return None, problems_of(error, kind_model, data)
    wrong = list(check(model))
    if kind == "placement":
        from strainsight.config.checks import absent_problems

        wrong = [*absent_problems(data, stage), *wrong]
    return (None, wrong) if wrong else (model, [])


def _read(path: Path) -> tuple[dict[str, Any], dict[str, str], dict[str, str], list[str]]:
    """Data, the location of every value and of every key, and the keys without a value."""
    if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would be waited for
        remedy = "save the config in a file, and specify the path of this file"
        raise ConfigError("the config is not a regular file", where=str(path), remedy=remedy)
    try:
        with path.open("rb") as stream:
            raw = stream.read(LARGEST + 1)
        if len(raw) > LARGEST:
            raise ConfigError(
                f"the config is larger than {LARGEST // 1024} KiB",
                where=str(path),
                remedy="specify the path of a config, not of a mesh file",
            )
        text = raw.decode("utf-8-sig")
    except FileNotFoundError:
        raise ConfigError(
            "config file not found", where=str(path), remedy="create one with `strainsight init DECK`"
        ) from None
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise ConfigError("not UTF-8 text", where=f"{path}:{line}", remedy="save the file as UTF-8") from None
    except OSError as error:
        raise ConfigError(
            f"the config cannot be read: {error.strerror}",
            where=str(path),
            remedy="check the path and the permissions of the config file",
        ) from None
    try:
        document = parse(text)
    except YamlProblem as problem:
        raise _error_at(f"{path}:{problem.line}:{problem.column}", problem) from None
    if not isinstance(document.data, dict):
        raise ConfigError(
            "the file is not a mapping of keys to values",
            where=f"{path}:1:1",
            remedy="create a config with `strainsight init DECK`",
        )
    return document.data, *_places(path, document), [key for key, mark in document.marks.items() if mark.blank]


def _places(path: Path, document: Document) -> tuple[dict[str, str], dict[str, str]]:
    def place(spot: tuple[int, int]) -> str:
        return f"{path}:{spot[0]}:{spot[1]}"

    marks = document.marks.items()
    # A block below its key starts on a separate line, so the location is that of the key.
    values = {key: place(mark.value if mark.value[0] == mark.key[0] else mark.key) for key, mark in marks}
    return values, {key: place(mark.key) for key, mark in marks}


def _locate(places: Mapping[str, str], key: str) -> str:
    parts = key.split(".") if key else []
    for length in range(len(parts), 0, -1):
        if (prefix := ".".join(parts[:length])) in places:
            return places[prefix]
    return places[""]


def _error_at(where: str, problem: Problem | YamlProblem) -> ConfigError:
    return ConfigError(problem.what, where=where, key=shown_key(problem.key) or None, remedy=problem.remedy or None)

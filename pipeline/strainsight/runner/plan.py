"""Which stages are up to date, the reasons why others are not, and the digest of the code of a stage."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel

import strainsight
from strainsight.errors import ArtefactError, ConfigError, StrainsightError
from strainsight.runner.artefact import Artefact, digest_or_none, file_digest
from strainsight.runner.slices import canonical, differences, expand, look_up, prune
from strainsight.runner.stage import Stage

PACKAGE = "strainsight"
_IMPORT = re.compile(
    rb"^[ \t]*from[ \t]+(strainsight[\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|^[ \t]*import[ \t]+(strainsight[\w.]*)",
    re.M,
)
_NAME = re.compile(rb"\w+")
_NAMED = re.compile(rb"[\"'](strainsight(?:\.\w+)+)[\"']")
"""A module that is loaded by name, in this or another process."""
_PART = re.compile(rb"[\"']((?:\w+/)*\w+\.(?:css|js))[\"']")
"""Styles and scripts of a page."""
ROOT = Path(strainsight.__file__).parent


def code_of(stage: Stage) -> str:
    """First 16 digits of sha256 over the source of all modules of the package that the function of a stage imports or names, and
    of their styles and scripts. The versions of other packages are in the lock file."""
    sha = hashlib.sha256()
    for name in sorted(closure(stage.module)):
        sha.update(name.encode() + b"\0" + _digest(name))
    return sha.hexdigest()[:16]


@cache
def closure(module: str) -> frozenset[str]:
    """Names of the modules that one reaches, itself among them, and of styles and scripts, by their path in the package."""
    modules, open_ = {module}, [module]
    while open_:
        for name in _imports(open_.pop()) - modules:
            modules.add(name)
            open_.append(name)
    return frozenset(modules)


@cache
def _imports(module: str) -> frozenset[str]:
    mentioned = set()
    source = _source(module)
    for package, names, plain in _IMPORT.findall(source):
        base = (package or plain).decode()
        mentioned.add(base)
        mentioned |= {f"{base}.{name.decode()}" for name in _NAME.findall(names)}
    if b'"strainsight.' in source:
        mentioned |= {name.decode() for name in _NAMED.findall(source)}
    if b".css" in source or b".js" in source:
        mentioned |= {part for name in _PART.findall(source) if (part := _part(module, name.decode()))}
    return frozenset(name for name in mentioned if _file(name) is not None)


@cache
def _source(module: str) -> bytes:
    file = _file(module)
    return b"" if file is None else Path(file).read_bytes()


@cache
def _digest(module: str) -> bytes:
    return hashlib.sha256(_source(module)).digest()


def _part(module: str, name: str) -> str:
    """Path in the package of a file that a module names, from its folder or a parent; otherwise ""."""
    folder = module.replace(".", "/")
    while folder := folder.rpartition("/")[0]:
        path = f"{folder}/{name}".partition("/")[2]
        if path in _files():
            return path
    return ""


def _file(module: str) -> str | None:
    """File of a module, or of a part of the package by its path, or None."""
    return _files().get(module) or getattr(sys.modules.get(module), "__file__", None)


@cache
def _files() -> dict[str, str]:
    """Files of the package: name of a module, or path of another file from ROOT → path."""
    files = {}
    for folder, _, names in os.walk(ROOT):
        for name in names:
            path = os.path.join(folder, name)
            part = path[len(str(ROOT)) + 1 :].replace(os.sep, "/")
            module = f"{PACKAGE}.{part.removesuffix('.py').replace('/', '.')}".removesuffix(".__init__")
            files[module if name.endswith(".py") else part] = path
    return files


ESTIMATED, MEASURED = "validate", "simulate"
"""Stages with artefacts that another run starts from: `guess: {from: NAME}` without `stage`, and `measured: {from: NAME}`."""
UP_TO_DATE = "up to date"
WILL_RUN = "will run"
OTHER_CODE = (
    "result computed by different source code of the same stage version; use --force to compute the stage again"
)
"""Reason for an artefact of the same stage version from other code."""
NO_CODE = "result computed by an earlier release of strainsight; use --force to compute the stage again"
"""Reason for an artefact of an earlier release."""

Locate = Callable[[str], str | None]


@dataclass(frozen=True)
class Job:
    """What a run is about: a config as plain JSON data, where its paths start from, and where results go.

    config   canonical JSON data; "name" names the folder below `results`, "seed" the seed
    base     folder that relative input paths start from (the config file's)
    results  the results folder
    locate   dotted key → "file:line:column", for messages
    model    the same config as its frozen model, where it has one
    """

    config: Mapping[str, Any]
    base: Path
    results: Path
    locate: Locate = lambda key: None
    model: BaseModel | None = None

    @property
    def folder(self) -> Path:
        return self.results / str(self.config["name"])


@dataclass(frozen=True)
class Status:
    """Whether a stage is up to date; if not, all reasons; otherwise, whether other code of its version computed it.

    artefact: its file; result: the artefact if it is up to date."""

    stage: str
    status: str
    reasons: tuple[str, ...]
    artefact: Path
    result: Artefact | None = None

    @property
    def reason(self) -> str:
        """The first three reasons on one line."""
        shown = ", ".join(self.reasons[:3])
        return shown if len(self.reasons) <= 3 else f"{shown} and {len(self.reasons) - 3} more"


@dataclass(frozen=True)
class Inputs:
    """Inputs of a stage in their current state."""

    config: Mapping[str, Any]
    files: Mapping[str, Path]
    digests: Mapping[str, str]

    def key(self, stage: Stage, upstream: Mapping[str, str]) -> str:
        """sha256 of (stage, version, config slice, digests of upstream artefacts, digests of input files)."""
        parts = [stage.name, stage.version, self.config, upstream, self.digests]
        return hashlib.sha256(canonical(parts).encode()).hexdigest()


def plan(stages: Sequence[Stage], job: Job, forced: Collection[str] = ()) -> tuple[Status, ...]:
    """The status of every stage as the files stand; nothing is written.

    A stage below one that will run is taken to run too. When the run finds that the upstream artefact came out the
    same, it will not."""
    statuses: list[Status] = []
    pending: set[str] = set()
    finished: dict[str, Artefact] = {}
    for stage in stages:
        inputs = inputs_of(stage, job, required=False)
        status = judge(stage, job, inputs, finished, pending, stage.name in forced)
        statuses.append(status)
        if status.result is None:
            pending.add(stage.name)
        else:
            finished[stage.name] = status.result
    return tuple(statuses)


def judge(
    stage: Stage,
    job: Job,
    inputs: Inputs,
    finished: Mapping[str, Artefact],
    pending: Collection[str] = (),
    forced: bool = False,
) -> Status:
    """Compare what a stage's artefact was made from with what it would be made from now.

    finished: verified artefacts of the stages above; pending: stages above that will run."""
    path = job.folder / f"{stage.name}.h5"
    reasons = ["--force"] if forced else []
    artefact = None
    if not path.exists():
        reasons.append("never run")
    else:
        try:
            artefact = Artefact(path)
        except ArtefactError as error:
            reasons.append(f"{path.name}: {error.what}")
    if artefact is not None:
        reasons += _changes(stage, job, inputs, artefact, finished)
        reasons += [f"{name} changed" for name in stage.upstream if name in pending]
    reasons += [f"{_shown(file)} is missing" for key, file in inputs.files.items() if key not in inputs.digests]
    if artefact is None or reasons:
        return Status(stage.name, WILL_RUN, tuple(reasons), path)
    return Status(stage.name, UP_TO_DATE, tuple(filter(None, [other_code(stage, artefact)])), path, artefact)


def other_code(stage: Stage, artefact: Artefact) -> str:
    """Remark on the code of an artefact; empty if it is the current code."""
    if not artefact.header.code:
        return NO_CODE
    return "" if artefact.header.code == code_of(stage) else OTHER_CODE


def _changes(stage: Stage, job: Job, inputs: Inputs, artefact: Artefact, finished: Mapping[str, Artefact]) -> list[str]:
    header = artefact.header
    upstream = {name: finished[name].digest for name in stage.upstream if name in finished}
    reasons = []
    if header.version != stage.version or header.stage != stage.name:
        reasons.append(f"stage version {header.version} → {stage.version}")
    reasons += [_change(job, *change) for change in differences(header.config, inputs.config)]
    changed = [name for name, digest in upstream.items() if digest != header.upstream.get(name)]
    changed += [_shown(inputs.files[key]) for key, now in inputs.digests.items() if now != header.files.get(key)]
    found_files = {job.base / name: digest for name, digest in (header.resolved or {}).items()}
    changed += [_shown(path) for path, digest in found_files.items() if digest_or_none(path) != digest]
    reasons += [f"{name} changed" for name in changed]
    for name, digest in (header.side_files or {}).items():
        sibling = artefact.path.parent / name
        if digest_or_none(sibling) != digest:
            reasons.append(f"file {name} {'was altered' if sibling.exists() else 'is missing'}")
    complete = len(upstream) == len(stage.upstream) and len(inputs.digests) == len(inputs.files)
    # The comparison above is for people; the key decides. A header altered by hand is caught here.
    if not reasons and complete and inputs.key(stage, upstream) != header.key:
        reasons.append("the checksum in the results file does not match the config and the input files")
    return reasons


def inputs_of(stage: Stage, job: Job, required: bool = True) -> Inputs:
    """Config slice, input files and their digests. Raises ConfigError for a file that is missing, where `required`."""
    config = prune(job.config, stage.reads)
    files = files_of(stage, job)
    digests: dict[str, str] = {}
    for key, path in files.items():
        if path.is_file():
            try:
                digests[key] = file_digest(path)
            except StrainsightError:
                if required:
                    raise
        elif required:
            raise _no_such_file(key, str(look_up(job.config, key)), path, job)
    return Inputs(config, files, digests)


def files_of(stage: Stage, job: Job) -> dict[str, Path]:
    """Dotted key → input file, whether it is there or not."""
    config = prune(job.config, stage.reads)
    files: dict[str, Path] = {}
    for pattern in stage.files:
        for key in expand(job.config, pattern):
            if (value := look_up(job.config, key)) is None:
                continue
            if key not in expand(config, key):
                raise ValueError(
                    f"definition of the stage '{stage.name}': `files` contains the key '{key}', but `reads` does not"
                )
            files[key] = _input_path(key, str(value), job)
    return files


def _input_path(key: str, value: str, job: Job) -> Path:
    """A path as written, from the config's folder; a plain name under a key `from` is another run's artefact."""
    if key.endswith(".from") and "/" not in value and "." not in value:
        usual = MEASURED if key.endswith("measured.from") else ESTIMATED
        return job.results / value / f"{look_up(job.config, key.removesuffix('.from')).get('stage', usual)}.h5"
    return job.base / value


def _no_such_file(key: str, written: str, path: Path, job: Job) -> ConfigError:
    what, remedy = f"file not found: {_shown(path)}", "paths are relative to the folder of the config"
    if key.endswith(".from") and path.is_relative_to(job.results) and "/" not in written:
        what, remedy = (
            f"run '{written}' has no result ({_shown(path)})",
            f"first run the config with the name '{written}'",
        )
    elif path.is_dir():
        what, remedy = f"{_shown(path)} is a folder, not a file", "specify a file in the folder"
    return ConfigError(what, key=key, where=job.locate(key), remedy=remedy)


def _change(job: Job, key: str, old: Any, new: Any) -> str:
    if new is ...:
        return f"{key} removed"
    place = job.locate(key) or ""
    at = f" ({place.rpartition(':')[0] if place.count(':') > 1 else place})" if place else ""
    return f"{key} added{at}" if old is ... else f"{key} {_short(old)} → {_short(new)}{at}"


def _short(value: Any) -> str:
    text = value if isinstance(value, str) else canonical(value)
    # six digits where they say it all; every digit where they would hide the change
    if isinstance(value, float) and float(f"{value:g}") == value:
        text = f"{value:g}"
    return text if len(text) <= 40 else text[:37] + "..."


def _shown(path: Path) -> str:
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)

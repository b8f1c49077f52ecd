"""Small models that several tests use, and what the commands make of them: kept under a key of code and inputs (`shared`)."""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from .robustness.small import write_project
from .shared import made, once


@dataclass(frozen=True)
class Ended:
    """A command that has ended: exit code, what it printed, and the folder of its results."""

    code: int
    output: str
    stderr: str
    folder: Path

    @property
    def text(self) -> str:
        """Everything that it printed, in one line."""
        return " ".join((self.output + self.stderr).split())

    def artefact(self, stage: str) -> Artefact:
        assert self.code in (0, 3), self.output
        return Artefact(self.folder / f"{stage}.h5")


def project(config: str, files: Mapping[str, str] | None = None) -> Path:
    """Path of a config beside the beam of `robustness.small` and other files; not to be written to."""

    def make(folder: Path) -> None:
        write_project(folder)
        for name, text in (("own.yaml", config), *(files or {}).items()):
            (folder / name).write_text(text, encoding="utf-8")

    return once("project", json.dumps([config, files or {}]), make) / "own.yaml"


def ended(
    stage: str,
    config: str,
    *changes: str,
    files: Mapping[str, str] | None = None,
    beside: str = "",
    words: tuple[str, ...] = (),
) -> Ended:
    """A command on a config with some `--set` and other words. Commands on the same config, or with the same word beside, share
    their stages."""
    path = project(config, files)
    results = path.parent.with_name(beside or f"{path.parent.name}-results")
    name = "r" + hashlib.sha256("\n".join((str(results), str(path), stage, *changes, *words)).encode()).hexdigest()[:16]

    def make(folder: Path) -> None:
        sets = [word for change in (f"name={name}", *changes) for word in ("--set", change)]
        done = CliRunner().invoke(app, [stage, str(path), "--results", str(results), *sets, *words], env={"COLUMNS": "200"})
        ending = [done.exit_code, done.output, done.stderr or ""]
        (folder / "ending.json").write_text(json.dumps(ending), encoding="utf-8")

    kept = once("command", name, make) / "ending.json"
    code, output, stderr = json.loads(kept.read_text(encoding="utf-8"))
    return Ended(code, output, stderr, results / name)


def artefacts(
    config: str,
    *changes: str,
    until: str = "",
    only: tuple[str, ...] = (),
    beside: str = "",
    files: Mapping[str, str] | None = None,
) -> dict[str, Artefact]:
    """stage → Artefact of a run of a config (`made`). Runs of the same config, or with the same word beside, share stages."""
    path = project(config, files)
    return made(path, *changes, until=until, only=only, beside=beside or f"{path.parent.name}-results")


def compute_once(function: Callable[..., Any], *arguments: Any) -> Any:
    """The value of a function of the package for these arguments, computed once for a version of the code."""

    def make(folder: Path) -> None:
        (folder / "value").write_bytes(pickle.dumps(function(*arguments)))

    content = hashlib.sha256(pickle.dumps(arguments)).hexdigest()
    return pickle.loads((once("value", f"{function.__module__}.{function.__qualname__} {content}", make) / "value").read_bytes())

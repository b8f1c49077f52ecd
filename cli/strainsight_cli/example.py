"""Examples of the package: a config and its files, ready to run in the working directory."""

from __future__ import annotations

import os
import posixpath
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from strainsight.errors import UserError, did_you_mean
from strainsight.writing import write_file
from strainsight_cli.failures import reported
from strainsight_cli.printing import say

HERE = Path(__file__).parent
SHIPPED = HERE / "shipped"
"""Folder of the files in the package (`force-include` in pyproject.toml), with the same paths as in the repository."""


@dataclass(frozen=True)
class Example:
    """about: one line; config, files: paths in the repository."""

    about: str
    config: str
    files: tuple[str, ...]


EXAMPLES = {
    "cantilever": Example(
        "four gauges on a steel cantilever: Young's modulus from a known force (run time half a minute)",
        "configs/cantilever-youngs-modulus.yaml",
        ("meshes/cantilever.bdf",),
    ),
    "lug": Example(
        "six gauges on a lug bracket with bolt holes: three unknown loads at the eye (run time two minutes)",
        "configs/lug/lug-input.yaml",
        ("meshes/lug.bdf.gz",),
    ),
    "test": Example(
        "a test record of four gauges on the cantilever: force and strain (run time half a minute)",
        "docs/examples/test.yaml",
        ("docs/examples/test.csv", "docs/examples/bonded.csv", "meshes/cantilever.bdf"),
    ),
}


def example(
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Name of the example; without a name, the examples are listed."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
) -> None:
    """The command."""
    with reported():
        if name is None:
            for known, entry in EXAMPLES.items():
                say(f"{known:<12}{entry.about}")
            say("", "copy an example into this folder: strainsight example NAME")
            return
        if name not in EXAMPLES:
            otherwise = f"known examples: {', '.join(EXAMPLES)}"
            raise UserError(
                f"unknown example '{name}'",
                remedy=did_you_mean(name, EXAMPLES, otherwise),
            )
        written = write(name, Path(), force)
        say(f"wrote {', '.join(map(str, written))}", f"next: strainsight run {name}.yaml")


def write(name: str, folder: Path, force: bool) -> list[Path]:
    """Copy the files of an example into a folder; the config refers to them by name.

    Raises UserError, before anything is written, if a file exists with other content."""
    contents = {folder / file: text for file, text in contents_of(name).items()}
    other = [
        path
        for path, text in contents.items()
        if os.path.lexists(path) and not (path.is_file() and not path.is_symlink() and path.read_bytes() == text)
    ]
    if other and not force:
        raise UserError(
            f"the file{'s' * (len(other) > 1)} already exist{'s' * (len(other) == 1)} with other content; nothing was written",
            where=", ".join(map(str, other)),
            remedy="use an empty folder, or overwrite existing files with --force",
        )
    for path, text in contents.items():
        write_file(path, text)
    return list(contents)


def contents_of(name: str) -> dict[str, bytes]:
    """File name → content; the config refers to local file names, and its results have the name of the example."""
    entry = EXAMPLES[name]
    root = SHIPPED if SHIPPED.is_dir() else HERE.parents[1]  # of an editable installation
    text = (root / entry.config).read_text(encoding="utf-8")
    for file in entry.files:
        text = text.replace(posixpath.relpath(file, posixpath.dirname(entry.config)), posixpath.basename(file))
    text = re.sub(r"^name: .*$", f"name: {name}", text, count=1, flags=re.MULTILINE)
    others = {posixpath.basename(file): (root / file).read_bytes() for file in entry.files}
    return {f"{name}.yaml": text.encode(), **others}

"""Examples that come with the package: a config and its files, made ready to run in the working directory."""

from __future__ import annotations

import os
import posixpath
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from strainsight_cli.failures import reported
from strainsight_cli.printing import say

HERE = Path(__file__).parent
SHIPPED = HERE / "shipped"
"""Where the build puts the files (`force-include` in pyproject.toml), below the same paths as in the repository."""
REPOSITORY = HERE.parents[1]
"""Where they are for an installation that uses the sources as they stand."""


@dataclass(frozen=True)
class Example:
    """about: in one line; config, files: what it consists of, paths of the repository."""

    about: str
    config: str
    files: tuple[str, ...]


EXAMPLES = {
    "cantilever": Example(
        "four gauges on a steel cantilever, for its modulus from a known force (half a minute)",
        "configs/cantilever-youngs-modulus.yaml",
        ("meshes/cantilever.bdf",),
    ),
    "lug": Example(
        "six gauges on a lug bracket with bolt holes, for three unknown loads at its eye (two minutes)",
        "configs/lug/lug-input.yaml",
        ("meshes/lug.bdf.gz",),
    ),
    "test": Example(
        "a record of four gauges on that cantilever: force and strain from a test (half a minute)",
        "docs/examples/test.yaml",
        ("docs/examples/test.csv", "docs/examples/bonded.csv", "meshes/cantilever.bdf"),
    ),
}


def example(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="Which; without one they are listed.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
) -> None:
    """The command."""
    with reported():
        if name is None:
            for known, entry in EXAMPLES.items():
                say(f"{known:<12}{entry.about}")
            say("", "strainsight example NAME writes one into this folder")
            return
        from strainsight.errors import UserError, did_you_mean

        if name not in EXAMPLES:
            otherwise = f"there are {', '.join(EXAMPLES)}"
            raise UserError(
                f"no example '{name}'",
                remedy=f"{did_you_mean(name, EXAMPLES, otherwise)} `strainsight example` lists them",
            )
        written = write(name, Path(), force)
        say(f"wrote {', '.join(map(str, written))}", f"then: strainsight run {name}.yaml")


def write(name: str, folder: Path, force: bool) -> list[Path]:
    """The files of an example in a folder, its config with their names and its own.

    Raises UserError, before anything is written, where a file is there that holds something else.
    """
    from strainsight.errors import UserError
    from strainsight.writing import write_file

    contents = {folder / file: text for file, text in contents_of(name).items()}
    other = [
        path
        for path, text in contents.items()
        if os.path.lexists(path) and not (path.is_file() and not path.is_symlink() and path.read_bytes() == text)
    ]
    if other and not force:
        raise UserError(
            "the file exists, and nothing was written",
            where=", ".join(map(str, other)),
            remedy="go to an empty folder, or overwrite it with --force",
        )
    for path, text in contents.items():
        write_file(path, text)
    return list(contents)


def contents_of(name: str) -> dict[str, bytes]:
    """File name → content; the config names the files beside it, and its results stand under the example's name."""
    entry = EXAMPLES[name]
    root = SHIPPED if SHIPPED.is_dir() else REPOSITORY
    text = (root / entry.config).read_text(encoding="utf-8")
    for file in entry.files:
        text = text.replace(posixpath.relpath(file, posixpath.dirname(entry.config)), posixpath.basename(file))
    text = re.sub(r"^name: .*$", f"name: {name}", text, count=1, flags=re.MULTILINE)
    others = {posixpath.basename(file): (root / file).read_bytes() for file in entry.files}
    return {f"{name}.yaml": text.encode(), **others}

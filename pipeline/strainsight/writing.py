"""Write files and folders under their names, never through links.
A folder of another user may contain links. A written file replaces a link without a change of its target; a folder that is a link
is an error."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from strainsight.errors import UserError

TEMPORARY = ".part-"  # prefix of unfinished files; a kill may leave one, the next run removes it
NO_LINK = getattr(os, "O_NOFOLLOW", 0)
"""For `os.open`: a link to another file is not opened; Windows cannot ask for that."""


def make_folder(folder: Path) -> None:
    """Create a folder if it does not exist. Raises UserError if it is a link; parent folders may be links."""
    if folder.is_symlink() or getattr(os.path, "isjunction", lambda _: False)(folder):
        raise UserError(
            f"the folder is a link to {os.readlink(folder)}, and results are not written through links",
            where=str(folder),
            remedy="remove the link, or use another results folder with --results DIR",
        )
    folder.mkdir(parents=True, exist_ok=True)


def write_file(path: Path, content: bytes) -> None:
    """Write the file, complete or not at all. Raises UserError for a folder, a pipe or a device of that name."""
    if path.exists() and not path.is_file():
        raise UserError("the path is not a regular file", where=str(path), remedy="use another file name")
    part = temporary(path, partial(Path.write_bytes, data=content))
    try:
        replace_file(part, path)
    finally:
        part.unlink(missing_ok=True)


def open_file(path: Path, flags: int) -> int:
    """Open a file, created if it does not exist; a link with its name is removed."""
    if path.is_symlink():
        path.unlink()
    return os.open(path, flags | os.O_CREAT | NO_LINK, 0o666)


def temporary(path: Path, write: Callable[[Path], Any]) -> Path:
    """A finished, synced temporary file in the folder of `path`."""
    handle, name = tempfile.mkstemp(prefix=f"{TEMPORARY}{path.name}-", dir=path.parent)
    part = Path(name)
    try:
        os.close(handle)
        write(part)
        with part.open("r+b") as stream:  # Windows syncs only what may be written
            os.fsync(stream.fileno())
        part.chmod(0o666 & ~umask())
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return part


def replace_file(part: Path, path: Path) -> None:
    """Move a finished file to its name, replacing an existing file."""
    os.replace(part, path)
    if os.name == "nt":  # a folder cannot be opened there
        return
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def umask() -> int:
    """Permission bits that new files do not get; reading them requires setting them."""
    current = os.umask(0)
    os.umask(current)
    return current

"""Whether what stands in a folder is whole, and what an undisturbed run wrote."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from strainsight.runner.artefact import Artefact
from strainsight.writing import TEMPORARY

LOG, LOCK = "run.log", ".lock"


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {LOG}


def compared(folder: Path, undisturbed: Path) -> Iterator[str]:
    """The names of what is there; every file is whole and the undisturbed run's, but for how long the stages took."""
    for path in folder.iterdir():
        if path.name.startswith(TEMPORARY) or path.name in (LOG, LOCK):
            continue
        yield path.name
        reference = undisturbed / path.name
        if path.suffix != ".h5":
            assert _untimed(path) == _untimed(reference), path.name
            continue
        own, other = Artefact(path), Artefact(reference)
        assert own.paths() == other.paths()
        for name in own.paths():
            np.testing.assert_array_equal(own[name], other[name], err_msg=f"{path.name}:{name}", strict=True)
        assert (own.digest, own.key) == (other.digest, other.key)
        for name, digest in own.header.side_files.items():
            assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def _untimed(path: Path) -> bytes:
    """A file without the times that a page tells."""
    return re.sub(rb'<data value="[^"]*"( data-unit="s")?>[^<]*</data>', b"", path.read_bytes())

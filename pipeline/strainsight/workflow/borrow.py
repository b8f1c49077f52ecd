"""A stage that another run in the same results folder has already done on the same inputs is taken over, not repeated."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from strainsight.errors import ArtefactError
from strainsight.workflow.artefact import Artefact, file_digest
from strainsight.workflow.plan import Job
from strainsight.workflow.stage import Stage
from strainsight.workflow.store import TEMPORARY


def borrowed(stage: Stage, job: Job, key: str) -> tuple[Artefact, str] | None:
    """The artefact of a run beside this one that was made from exactly the same, copied here, and that run's name.

    key: of the stage as it would run now. It has to agree, and so has every file that the stage found while running; a file
    written beside it is copied too, its sha256 checked. An artefact that is damaged is passed over: its own run will notice.
    """
    for path in sorted(job.results.glob(f"*/{stage.name}.h5")):
        if path.parent == job.folder:
            continue
        try:
            other = Artefact(path)
        except ArtefactError:
            continue
        header = other.header
        found = (header.found or {}).items()
        if header.key != key or any(_digest(job.base / name) != digest for name, digest in found):
            continue
        beside = header.beside or {}
        if any(_digest(path.parent / name) != digest for name, digest in beside.items()):
            continue
        for name in (*beside, path.name):
            _copy(path.parent / name, job.folder / name)
        return Artefact(job.folder / path.name), path.parent.name
    return None


def _copy(source: Path, target: Path) -> None:
    """Under its name only once it is complete; where the disk can, the same file under a second name, because artefacts are
    replaced and never written into."""
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f"{TEMPORARY}{target.name}-", dir=target.parent)
    os.close(handle)
    try:
        os.unlink(name)
        try:
            os.link(source, name)
        except OSError:
            shutil.copyfile(source, name)
            shutil.copymode(source, name)
        os.replace(name, target)
    finally:
        Path(name).unlink(missing_ok=True)


def _digest(path: Path) -> str | None:
    return file_digest(path) if path.is_file() else None

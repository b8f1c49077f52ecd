"""A stage that another run in the same results folder has already done on the same inputs is reused, not repeated."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from strainsight.errors import ArtefactError
from strainsight.workflow.artefact import Artefact, Header, digest_or_none, header_of, sha256_of
from strainsight.workflow.plan import Job
from strainsight.workflow.stage import Stage
from strainsight.workflow.store import TEMPORARY, former, named_together


def reused(stage: Stage, job: Job, key: str) -> Artefact | None:
    """The artefact of a run beside this one that was made from exactly the same, reused here; `source` is that run.

    key: of the stage as it would run now. It has to agree, and so has every file that the stage found while running; a file
    written beside it is copied too, its sha256 checked. An artefact that is damaged is passed over: its own run will notice.
    """
    for path in sorted(job.results.glob(f"*/{stage.name}.h5")):
        if path.parent == job.folder:
            continue
        try:
            header = header_of(path)
            found = (header.found or {}).items()
            if header.key != key or any(digest_or_none(job.base / name) != digest for name, digest in found):
                continue
            taken = _taken(path, job.folder, header, stage.records)
        except (ArtefactError, OSError):  # damaged, or replaced by its run at this moment
            continue
        taken.source = path.parent.name
        return taken
    return None


def _taken(source: Path, folder: Path, header: Header, records: tuple[str, ...]) -> Artefact:
    """The artefact of that header and what lies beside it, under their names only once all is here and was checked here. What
    records said before stays."""
    folder.mkdir(parents=True, exist_ok=True)
    with named_together() as parts:
        parts.append((_part(source, folder), folder / source.name))
        own = Artefact(parts[0][0])
        if own.header != header:
            raise ArtefactError("replaced while it was copied", where=str(source))
        for name, digest in (own.header.beside or {}).items():
            parts.append((_part(source.parent / name, folder), folder / name))
            if Path(name).name != name or sha256_of(parts[-1][0]) != digest:
                raise ArtefactError(f"{name} beside it was altered", where=str(source))
            if name in records:
                parts += former(folder / name, parts[-1][0].read_bytes())
    own.path = folder / source.name
    return own


def _part(source: Path, folder: Path) -> Path:
    """A file as a temporary one in `folder`. An artefact is replaced and never written into: where the disk can, it gets a
    second name and no copy. People write into what lies beside it."""
    handle, name = tempfile.mkstemp(prefix=f"{TEMPORARY}{source.name}-", dir=folder)
    os.close(handle)
    part = Path(name)
    try:
        if source.suffix != ".h5" or not _linked(source, part):
            shutil.copyfile(source, part)
            shutil.copymode(source, part)
    except OSError:
        part.unlink(missing_ok=True)
        raise
    return part


def _linked(source: Path, part: Path) -> bool:
    part.unlink()
    try:
        os.link(source.resolve(), part)
    except OSError:
        return False
    return True

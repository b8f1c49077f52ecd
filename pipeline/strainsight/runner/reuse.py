"""A stage that another run in the same results folder has already done on the same inputs is reused, not repeated."""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
from functools import partial
from pathlib import Path

from strainsight.errors import ArtefactError
from strainsight.runner.artefact import Artefact, Header, digest_or_none, header_of
from strainsight.runner.plan import Job
from strainsight.runner.stage import Stage
from strainsight.runner.store import former, named_together
from strainsight.writing import NO_LINK, TEMPORARY, make_folder, temporary, umask

NO_WAIT, BINARY = getattr(os, "O_NONBLOCK", 0), getattr(os, "O_BINARY", 0)
"""A pipe is opened without waiting for its other end; Windows alters the ends of lines if it is not asked for bytes."""
BLOCK = 1 << 20
"""[bytes] copied at a time."""
LARGEST, PACKING = 1 << 30, 100
"""[bytes] A larger file whose place on the disk is a hundredth of its size is mostly holes, and can state any size."""


def reused(stage: Stage, job: Job, key: str) -> Artefact | None:
    """The artefact of a run beside this one that was made from exactly the same, reused here; `source` is that run.

    key: of the stage as it would run now. It has to agree, and so has every file that the stage found while running; a file
    written beside it is copied too: a plain file of that name, of the size and sha256 that the artefact states. An artefact that
    is damaged is passed over: its own run will notice.
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
    make_folder(folder)
    with named_together() as parts:
        parts.append((_shared(source, folder), folder / source.name))
        own = Artefact(parts[0][0])
        if own.header != header:
            raise ArtefactError("replaced while it was copied", where=str(source))
        for name, digest in (own.header.beside or {}).items():
            size = (own.header.sizes or {}).get(name, -1)
            parts.append(
                (temporary(folder / name, partial(_beside, source.parent / name, size, digest)), folder / name)
            )
            if name in records:
                parts += former(folder / name, digest)
    own.path = folder / source.name
    return own


def _beside(path: Path, size: int, digest: str, part: Path) -> None:
    """Copy a file beside an artefact to `part`. Raises ArtefactError where it is none of that size and sha256, or no plain file:
    a link may lead anywhere, and a device has no end."""
    found, copied = hashlib.sha256(), 0
    with open(os.open(path, os.O_RDONLY | NO_LINK | NO_WAIT | BINARY), "rb") as stream, part.open("wb") as copy:
        if as_stated := _as_stated(os.fstat(stream.fileno()), size, shutil.disk_usage(part.parent).free):
            while (block := stream.read(BLOCK)) and copied <= size:
                copied += copy.write(block)
                found.update(block)
    if not as_stated or copied != size or found.hexdigest() != digest:
        raise ArtefactError(f"{path.name} is not the file that was written beside it", where=str(path))


def _as_stated(found: os.stat_result, size: int, free: int) -> bool:
    """Is it a plain file of that size, for which the disk has room, and not mostly holes?"""
    on_disk = 512 * getattr(found, "st_blocks", size)  # Windows does not say
    holes = size > LARGEST and PACKING * on_disk < size
    return stat.S_ISREG(found.st_mode) and found.st_size == size <= free and not holes


def _shared(source: Path, folder: Path) -> Path:
    """An artefact as a temporary file in `folder`. It is replaced and never written into: where the disk can, it gets a second
    name and no copy. People write into what lies beside it."""
    handle, name = tempfile.mkstemp(prefix=f"{TEMPORARY}{source.name}-", dir=folder)
    os.close(handle)
    part = Path(name)
    try:
        if not _linked(source, part):
            shutil.copyfile(source, part)
            part.chmod(0o666 & ~umask())
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

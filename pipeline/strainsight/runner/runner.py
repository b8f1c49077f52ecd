"""Run the stages that are not up to date, under a lock, or reuse what another run has done."""

from __future__ import annotations

import hashlib
import os
import shutil
import stat
import tempfile
import time
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from strainsight.errors import ArtefactError, StrainsightError, UserError
from strainsight.file_lock import lock_byte, lock_file
from strainsight.parallel import Sweep, serial
from strainsight.runner.artefact import Artefact, ArtefactHeader, digest_or_none, file_digest, header_of
from strainsight.runner.output import warnings_table
from strainsight.runner.plan import UP_TO_DATE, Inputs, Job, code_of, inputs_of, judge, other_code
from strainsight.runner.slices import attributes_of, declared
from strainsight.runner.stage import Context, Stage
from strainsight.runner.store import former, replace_together, write_artefact
from strainsight.writing import NO_LINK, TEMPORARY, make_folder, open_file, temporary, umask

NAME = ".lock"
COMPUTING = ".computing"


@contextmanager
def locked(folder: Path) -> Iterator[int | None]:
    """Hold the lock of `folder` (made if need be); yields the pid of a run that died with the lock in hand, else None.

    The kernel drops the lock with the process that holds it, so that a killed run never blocks the next one.
    Raises UserError naming the process that holds it."""
    make_folder(folder)
    handle = _acquire(folder / NAME)
    try:
        left_by = _pid(handle)
        with suppress(OSError):  # a full disk: the lock holds without the name of who holds it
            os.ftruncate(handle, 0)
            os.lseek(handle, 0, os.SEEK_SET)
            os.write(handle, f"{os.getpid()}\n".encode())
        yield left_by
    finally:
        removed = _removed(folder / NAME)
        os.close(handle)
        if not removed:
            _removed(folder / NAME)


@contextmanager
def computing(results: Path, key: str, waits: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Wait until no other process computes the stage of this key (hex sha256), and hold others off meanwhile.

    A byte of one file in `results` stands for the key; the kernel drops the lock with the process. waits: called where
    there is another one to wait for. On a disk without locks nobody waits: at worst the same is computed twice."""
    results.mkdir(parents=True, exist_ok=True)
    handle = open_file(results / COMPUTING, os.O_RDWR)
    byte = int(key[:15], 16)
    try:
        with suppress(OSError):
            try:
                lock_byte(handle, byte, wait=False)
            except BlockingIOError:
                waits()
                lock_byte(handle, byte, wait=True)
        yield
    finally:
        os.close(handle)


def _acquire(path: Path) -> int:
    while True:
        handle = open_file(path, os.O_RDWR)
        try:
            lock_file(handle, wait=False)
        except BlockingIOError:
            pid = _pid(handle)
            os.close(handle)
            raise UserError(
                f"another run{f' (process {pid})' if pid else ''} is writing to this folder",
                where=str(path.parent),
                remedy="wait until the other run has finished, or use another folder with --results DIR",
            ) from None
        # The holder before us may have removed the file between our open and our lock: then we hold a lock on nothing.
        try:
            if os.stat(path).st_ino == os.fstat(handle).st_ino:
                return handle
        except FileNotFoundError:
            pass
        os.close(handle)


def _removed(path: Path) -> bool:
    """Remove the file, if possible: Windows keeps open files, and a folder may be read-only."""
    with suppress(OSError):
        path.unlink(missing_ok=True)
        return True
    return False


def _pid(handle: int) -> int | None:
    os.lseek(handle, 0, os.SEEK_SET)
    text = os.read(handle, 32).decode(errors="replace").strip()
    return int(text) if text.isdigit() else None


NO_WAIT, BINARY = getattr(os, "O_NONBLOCK", 0), getattr(os, "O_BINARY", 0)
"""Flags to open a pipe without waiting, and binary files on Windows."""
BLOCK = 1 << 20
"""[bytes] Block size of a copy."""
LARGEST, PACKING = 1 << 30, 100
"""[bytes] A larger file that uses less than a hundredth of its size on the disk is mostly holes."""


def reused(stage: Stage, job: Job, key: str) -> Artefact | None:
    """Reuse the artefact of another run in the same results folder with the same inputs; `source` is that run.
    key: of the stage as it would run now. The key and all files found during the run have to agree. Files next to the artefact
    are copied too, if they are plain files of the stored size and sha256. Damaged artefacts are skipped."""
    for path in sorted(job.results.glob(f"*/{stage.name}.h5")):
        if path.parent == job.folder:
            continue
        try:
            header = header_of(path)
            inputs = (header.resolved or {}).items()
            if header.key != key or any(digest_or_none(job.base / name) != digest for name, digest in inputs):
                continue
            artefact = _copied(path, job.folder, header, stage.records)
        except (ArtefactError, OSError):  # damaged, or replaced by its run at this moment
            continue
        artefact.source = path.parent.name
        return artefact
    return None


def _copied(source: Path, folder: Path, header: ArtefactHeader, records: tuple[str, ...]) -> Artefact:
    """Copy an artefact and its files; they get their names after all are complete and verified. Files of `records` stay."""
    make_folder(folder)
    with replace_together() as parts:
        parts.append((_shared(source, folder), folder / source.name))
        artefact = Artefact(parts[0][0])
        if artefact.header != header:
            raise ArtefactError("not reused, because another run replaced the results file", where=str(source))
        for name, digest in (artefact.header.side_files or {}).items():
            size = (artefact.header.sizes or {}).get(name, -1)
            parts.append(
                (temporary(folder / name, partial(_copy_sibling, source.parent / name, size, digest)), folder / name)
            )
            if name in records:
                parts += former(folder / name, digest)
    artefact.path = folder / source.name
    return artefact


def _copy_sibling(path: Path, size: int, digest: str, part: Path) -> None:
    """Copy a file next to an artefact to `part`. Raises ArtefactError if its size or sha256 differs, or if it is not a plain
    file."""
    checksum, copied = hashlib.sha256(), 0
    with open(os.open(path, os.O_RDONLY | NO_LINK | NO_WAIT | BINARY), "rb") as stream, part.open("wb") as copy:
        if as_stated := _as_stated(os.fstat(stream.fileno()), size, shutil.disk_usage(part.parent).free):
            while (block := stream.read(BLOCK)) and copied <= size:
                copied += copy.write(block)
                checksum.update(block)
    if not as_stated or copied != size or checksum.hexdigest() != digest:
        raise ArtefactError(
            f"not reused, because {path.name} differs from the file that the stage wrote", where=str(path)
        )


def _as_stated(status: os.stat_result, size: int, free: int) -> bool:
    """Whether it is a plain file of that size, not mostly holes, that fits on the disk."""
    on_disk = 512 * getattr(status, "st_blocks", size)  # Windows does not say
    holes = size > LARGEST and PACKING * on_disk < size
    return stat.S_ISREG(status.st_mode) and status.st_size == size <= free and not holes


def _shared(source: Path, folder: Path) -> Path:
    """An artefact as a temporary file in `folder`: a second name if the disk permits, otherwise a copy. Artefacts are replaced,
    never modified; files next to them may be modified by users."""
    handle, name = tempfile.mkstemp(prefix=f"{TEMPORARY}{source.name}-", dir=folder)
    os.close(handle)
    part = Path(name)
    part.unlink()
    try:
        with suppress(OSError):
            os.link(source.resolve(), part)
            return part
        shutil.copyfile(source, part)
        part.chmod(0o666 & ~umask())
    except OSError:
        part.unlink(missing_ok=True)
        raise
    return part


RUNNING = "running"
DONE = "done"

Progress = Callable[[str, str, float], None]


@dataclass(frozen=True)
class Event:
    """Something happened to a stage: "running" as it starts, then "done"; or "up to date" alone.

    reason    why it runs; seconds: how long it took; artefact: its file, verified ("done" and "up to date")
    """

    stage: str
    status: str
    reason: str = ""
    seconds: float = 0.0
    artefact: Artefact | None = None


def run(
    stages: Sequence[Stage],
    job: Job,
    *,
    forced: Collection[str] = (),
    progress: Progress = lambda *_: None,
    notice: Callable[[str], None] = lambda text: None,
    sweep: Sweep = serial,
) -> Iterator[Event]:
    """Bring `stages` (in order, upstream first) up to date, yielding events.

    All input files are searched before anything is written, and checked (`Stage.check`) before the first stage runs. The lock
    of the results folder is kept until the iterator ends. A failed stage writes nothing, and its StrainsightError gets the
    location of its config key. `forced` names stages that run in any case. A stage stays up to date if its upstream ran
    again with the same result. Artefacts of other runs with the same inputs are reused, also from a process still running."""
    # Digests are taken before a stage reads its files: a file that changes meanwhile is noticed by the next run.
    with _placed(job):
        inputs = {stage.name: inputs_of(stage, job) for stage in stages}
    with locked(job.folder) as left_by:
        if left_by is not None:
            notice(f"an earlier run (process {left_by}) was interrupted in {job.folder}; its finished stages are kept")
        for part in job.folder.glob(f"{TEMPORARY}*"):  # of a run that was killed
            part.unlink(missing_ok=True)
        finished: dict[str, Artefact] = {}
        checked = False
        for stage in stages:
            status = judge(stage, job, inputs[stage.name], finished, forced=stage.name in forced)
            if status.result is not None:
                finished[stage.name] = status.result
                yield Event(stage.name, UP_TO_DATE, status.reason, artefact=status.result)
                continue
            for each in () if checked else stages:  # what is wrong with files is known before a stage takes an hour
                if each.check is not None and job.model is not None:
                    with _placed(job):
                        each.check(job.model, job.base)
            checked = True
            yield Event(stage.name, RUNNING, status.reason)
            start = time.perf_counter()
            reason = status.reason
            key = inputs[stage.name].key(stage, {name: finished[name].digest for name in stage.upstream})
            waits = f"{job.config['name']} waits for another process to compute {stage.name}"
            with computing(job.results, key, partial(notice, waits)):
                copy = None if stage.name in forced else reused(stage, job, key)
                if copy is not None:
                    finished[stage.name] = copy
                    reason += f", reused from {copy.source}"
                    if other := other_code(stage, copy):
                        reason += f" ({other})"
                else:
                    with _placed(job):
                        finished[stage.name] = _execute(
                            stage, job, inputs[stage.name], key, finished, progress, notice, sweep
                        )
            yield Event(stage.name, DONE, reason, time.perf_counter() - start, finished[stage.name])


def _execute(
    stage: Stage,
    job: Job,
    inputs: Inputs,
    key: str,
    finished: Mapping[str, Artefact],
    progress: Progress,
    notice: Callable[[str], None],
    sweep: Sweep,
) -> Artefact:
    upstream = {name: finished[name] for name in stage.upstream}
    context = Context(
        config=attributes_of(inputs.config) if job.model is None else declared(job.model, inputs.config),
        upstream=upstream,
        files=inputs.files,
        progress=lambda activity, share: progress(stage.name, activity, share),
        sweep=sweep,
        notice=notice,
        base=job.base,
    )
    start = time.perf_counter()
    with _warned() as texts:
        output = stage.run(context)
    output = replace(output, tables=(*output.tables, *warnings_table(tuple(texts))))
    seconds = time.perf_counter() - start
    header = ArtefactHeader(
        stage=stage.name,
        version=stage.version,
        key=key,
        config=inputs.config,
        upstream={name: artefact.digest for name, artefact in upstream.items()},
        files=inputs.digests,
        seed=inputs.config.get("seed"),
        resolved={os.path.relpath(path, job.base): file_digest(Path(path)) for path in output.inputs},
        seconds=seconds,
        code=code_of(stage),
    )
    return write_artefact(job.folder / f"{stage.name}.h5", output, header, stage.records)


@contextmanager
def _warned() -> Iterator[dict[str, None]]:
    """The texts of each UserWarning, which is shown as well; those of subclasses depend on the machine (`MachineWarning`)."""
    texts: dict[str, None] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        show = warnings.showwarning

        def keep(message: Warning | str, category: type[Warning], *rest: Any, **named: Any) -> None:
            if category is UserWarning:
                texts[str(message)] = None
            show(message, category, *rest, **named)

        warnings.showwarning = keep
        yield texts


@contextmanager
def _placed(job: Job) -> Iterator[None]:
    """Give an error that names a config key the place of that key."""
    try:
        yield
    except StrainsightError as error:
        for problem in (error, *error.others):
            if problem.key and problem.where is None:
                problem.where = job.locate(problem.key)
        raise

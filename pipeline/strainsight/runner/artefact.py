"""Read artefacts, after a check of checksum and header.

The check does not use the HDF5 library, which can hang on a file with a single flipped metadata byte. The checksum is in a user
block at the start of the file, which HDF5 and ParaView skip."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from strainsight.errors import ArtefactError
from strainsight.runner.output import (
    Entry,
    Scalar,
    Table,
    attributes_of,
    content_digest,
    damaged,
    read_contents,
    warning_texts,
)

BLOCK = 512
"""Size of the user block [B], the smallest that HDF5 permits."""
MAGIC = b"strainsight sha256 "


def seal(path: Path) -> None:
    """Write the sha256 of the HDF5 part into the user block."""
    with Path(path).open("r+b") as stream:
        stream.seek(BLOCK)
        line = MAGIC + hashlib.file_digest(stream, "sha256").hexdigest().encode() + b"\n"
        stream.seek(0)
        stream.write(line.ljust(BLOCK, b"\0"))


def is_sealed(path: Path) -> bool:
    """Whether the file begins like an artefact."""
    with Path(path).open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC


FORMAT = "strainsight"
FORMAT_VERSION = 1
MAPPINGS = ("config", "upstream", "files", "resolved", "side_files", "sizes")
"""Header fields stored as JSON."""
GRID = ".vtkhdf"
"""File extension of a grid file next to an artefact, for ParaView and PyVista."""
SETTLED = 2_000_000_000
"""[ns] Age above which the modification time of a file is reliable."""
_VERIFIED: set[tuple[int, ...]] = set()
"""Checksums of files read by this process, independent of their names."""
_INTACT: set[tuple[int, ...]] = set()
"""Files with a verified checksum."""


@dataclass(frozen=True)
class ArtefactHeader:
    """Inputs of an artefact; `key` is the sha256 of all of them except the seed.

    stage     name of the stage
    version   version of the stage
    key       hex sha256 of (stage, version, config slice, upstream digests, file digests)
    config    the declared slice of the config, as JSON data
    upstream  stage → content digest of its artefact
    files     dotted key → digest of that input file
    seed      seed of the run, if the stage reads it
    resolved  input files found while running (path relative to the config's folder → digest)
    side_files additional file of the stage → sha256
    sizes     the same files → their length [bytes]
    seconds   run time of the stage [s]; not part of key or digest
    code      digest of the code of the stage (`workflow.code`), or ""; not part of key or digest
    """

    stage: str
    version: int
    key: str
    config: Mapping[str, Any]
    upstream: Mapping[str, str]
    files: Mapping[str, str]
    seed: int | None = None
    resolved: Mapping[str, str] | None = None
    side_files: Mapping[str, str] | None = None
    sizes: Mapping[str, int] | None = None
    seconds: float | None = None
    code: str = ""


class Artefact:
    """A finished, verified results file.

    artefact["/frequency"]                 → ndarray (text as str arrays)
    artefact.children("/reduced/mass")     → {"constant": ndarray, "E": ndarray}
    artefact.summary, .tables, .message    results of the stage; .warnings are those in the tables
    artefact.key, .digest, .header         its inputs, and the sha256 of its content
    artefact.attributes("/augmented")      attributes of a group or dataset
    artefact.source                        the other run from which it was just reused, or ""

    Raises ArtefactError for a file that is missing, cut short, altered, of another format version, or that points
    outside itself."""

    def __init__(self, path: Path):
        self.path = Path(path)
        self.source = ""
        known = _identity(self.path)
        with _checked(self.path) as file:
            self.header, self.digest, self.message = _header(file, self.path)
            self._contents = read_contents(file)
            if known not in _VERIFIED:
                digest = content_digest(file, self._contents, self.message)
                if digest != self.digest:
                    raise damaged(
                        self.path, f"the checksum of the content is {digest[:12]} instead of {self.digest[:12]}"
                    )
            self.summary: dict[str, Scalar] = self.attributes("/summary")
            self.tables = tuple(
                Table(t["title"], tuple(t["columns"]), tuple(tuple(row) for row in t["rows"]), t.get("answer", False))
                for t in json.loads(bytes(file["tables"][()]).decode())
            )
        if known is not None:
            _VERIFIED.add(known)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the stage, also printed if the artefact is up to date."""
        return warning_texts(self.tables)

    @property
    def key(self) -> str:
        return self.header.key

    def __getitem__(self, path: str) -> np.ndarray:
        entry = self._entry(path)
        if not entry.dataset:
            raise self._absent("dataset", path)
        array = entry.array
        if array is None:
            with _opened(self.path) as file:
                array = np.asarray(file[path][()])
        return np.char.decode(array, "utf-8") if h5py.check_string_dtype(array.dtype) else array.copy()

    def __contains__(self, path: str) -> bool:
        return path in self._contents

    def children(self, path: str) -> dict[str, np.ndarray]:
        """Datasets of a group, by name."""
        return {name: self[f"{path}/{name}"] for name, entry in self._below(path).items() if entry.dataset}

    def groups(self, path: str) -> tuple[str, ...]:
        """Names of the subgroups of a group."""
        return tuple(name for name, entry in self._below(path).items() if not entry.dataset)

    def paths(self) -> tuple[str, ...]:
        """All datasets of the file except tables."""
        return tuple(path for path, entry in self._contents.items() if entry.dataset and path != "/tables")

    def attributes(self, path: str) -> dict[str, Any]:
        """Attributes of a group or dataset."""
        return {name: _plain(value) for name, value in self._entry(path).attributes.items()}

    def _entry(self, path: str) -> Entry:
        if path not in self._contents:
            raise self._absent("entry", path)
        return self._contents[path]

    def _below(self, path: str) -> dict[str, Entry]:
        if self._entry(path).dataset:
            raise self._absent("group", path)
        names = [name for name in self._contents if name.rpartition("/")[0] == path]
        return {name.removeprefix(f"{path}/"): self._contents[name] for name in names}

    def _absent(self, what: str, path: str) -> ArtefactError:
        return ArtefactError(
            f"{what} {path} not found in this results file of the stage '{self.header.stage}' "
            f"(stage version {self.header.version})",
            where=str(self.path),
            remedy=f"run the stage again: strainsight {self.header.stage} CONFIG --force",
        )


def is_plain_name(name: str) -> bool:
    """Whether a file with that name can be next to an artefact: no folder, no hidden file, no artefact."""
    return Path(name).name == name and not name.startswith(".") and not name.endswith(".h5")


def missing_stages(folder: Path, stages: Iterable[str]) -> list[str]:
    """Stages without an artefact in the folder of a run."""
    return [stage for stage in stages if not (folder / f"{stage}.h5").is_file()]


def header_of(path: Path) -> ArtefactHeader:
    """Header of an artefact, after a check of its bytes. Raises ArtefactError."""
    with _checked(path) as file:
        return _header(file, path)[0]


def file_digest(path: Path) -> str:
    """sha256 of an input file; for an artefact of another run, its content digest."""
    return Artefact(path).digest if path.suffix == ".h5" and is_sealed(path) else sha256_of(path)


def digest_or_none(path: Path) -> str | None:
    """The same, None where there is no file."""
    return file_digest(path) if path.is_file() else None


def sha256_of(path: Path) -> str:
    """sha256 of the bytes of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _identity(path: Path) -> tuple[int, ...] | None:
    """Identity of a file state; None if the file was written too recently for its modification time to be reliable."""
    try:
        status = path.stat()
    except OSError:
        return None
    if time.time_ns() - status.st_mtime_ns < SETTLED:
        return None
    # not the time of its last change of any kind: another name for the same file is one
    return (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)


@contextmanager
def _checked(path: Path) -> Iterator[h5py.File]:
    """The open file, after its checksum was verified; raises ArtefactError for this and all later errors."""
    known = _identity(path)
    if known not in _INTACT:
        _refuse_damaged(path)
    if known is not None:
        _INTACT.add(known)
    try:
        with _opened(path) as file:
            yield file
    except ArtefactError:
        raise
    except Exception as error:  # whatever HDF5 or the decoding makes of altered bytes
        raise damaged(path, f"the file cannot be read to the end ({type(error).__name__})") from error


def _refuse_damaged(path: Path) -> None:
    if not path.is_file():
        raise ArtefactError("results file not found", where=str(path), remedy="run the stage that writes this file")
    if path.stat().st_size < BLOCK:
        raise damaged(path, f"the file has only {path.stat().st_size} bytes, less than its header")
    if not is_sealed(path):
        raise ArtefactError(
            "the file is not a strainsight results file", where=str(path), remedy="use an .h5 file from results/NAME"
        )
    with path.open("rb") as stream:
        block = stream.read(BLOCK)
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    if block != (MAGIC + digest.encode() + b"\n").ljust(BLOCK, b"\0"):
        raise damaged(path, "the checksum does not match the content")


def _opened(path: Path) -> h5py.File:
    try:
        return h5py.File(path, "r")
    except OSError as error:
        raise damaged(path, "the HDF5 file is incomplete") from error


def _header(file: h5py.File, path: Path) -> tuple[ArtefactHeader, str, str]:
    attributes = attributes_of(file)
    if attributes.get("format") != FORMAT:
        raise ArtefactError(
            "the HDF5 file is not a strainsight results file",
            where=str(path),
            remedy="use an .h5 file from results/NAME",
        )
    written = _plain(attributes.get("format_version"))
    if written != FORMAT_VERSION:
        writer = attributes.get("package_version")
        by = "" if writer is None else f", by strainsight {_plain(writer)}"
        raise ArtefactError(
            f"the file has format version {written!r}{by}; this version of strainsight reads version {FORMAT_VERSION}",
            where=str(path),
            remedy="run the stage again with --force, or use the version of strainsight that wrote the file",
        )
    header = ArtefactHeader(
        stage=str(attributes["stage"]),
        version=int(attributes["stage_version"]),
        key=str(attributes["key"]),
        seed=int(attributes["seed"]) if "seed" in attributes else None,
        seconds=float(attributes["seconds"]) if "seconds" in attributes else None,
        code=str(attributes.get("code", "")),
        **{name: json.loads(attributes.get(name, "{}")) for name in MAPPINGS},
    )
    if foreign := [name for name in header.side_files or {} if not is_plain_name(name)]:
        raise damaged(path, f"the header of the results file lists a file with an invalid name, {foreign[0]!r}")
    return header, str(attributes["digest"]), str(attributes["message"])


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray) and value.dtype.kind == "S":
        return np.char.decode(value, "utf-8")
    return value.decode() if isinstance(value, bytes) else value

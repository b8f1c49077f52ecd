"""Reading an artefact: checked whole before a single number is handed out."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from strainsight.errors import ArtefactError
from strainsight.workflow.output import Scalar, Table, warnings_in
from strainsight.workflow.seal import BLOCK, is_intact, is_sealed
from strainsight.workflow.slices import canonical

FORMAT = "strainsight"
FORMAT_VERSION = 1
GRID = ".vtkhdf"
"""Ending of the file beside an artefact with a grid, by which ParaView and PyVista open that grid."""
MAX_DEPTH, MAX_OBJECTS = 12, 1 << 16
CHUNK = 1 << 24  # bytes hashed at a time
SETTLED = 2_000_000_000
"""[ns] Age from which the time of a file tells whether it was written to again."""
_VERIFIED: set[tuple[int, ...]] = set()
"""Files that this process has read through once, whatever their names: siblings share large artefacts."""
_INTACT: set[tuple[int, ...]] = set()
"""Files whose checksum this process has found right."""
# Attributes that h5py writes for dimension scales: object references, whose bytes depend on where the file put things.
SCALE_ATTRIBUTES = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "DIMENSION_LABELS"}


@dataclass(frozen=True)
class Header:
    """What an artefact was made from; `key` is the sha256 of all of it but the seed.

    stage     name of the stage
    version   version of the stage
    key       hex sha256 of (stage, version, config slice, upstream digests, file digests)
    config    the declared slice of the config, as JSON data
    upstream  stage → content digest of its artefact
    files     dotted key → digest of that input file
    seed      the run's seed where the stage reads it
    found     input files found while running (path relative to the config's folder → digest)
    beside    file written beside the artefact → sha256
    sizes     the same files → their length [bytes]
    seconds   how long the stage took when it was computed [s]; neither part of the key nor of the digest
    code      digest of the code of the stage (`workflow.code`), "" where none is recorded; no part of them either
    """

    stage: str
    version: int
    key: str
    config: Mapping[str, Any]
    upstream: Mapping[str, str]
    files: Mapping[str, str]
    seed: int | None = None
    found: Mapping[str, str] | None = None
    beside: Mapping[str, str] | None = None
    sizes: Mapping[str, int] | None = None
    seconds: float | None = None
    code: str = ""


class Artefact:
    """A finished, verified results file. Arrays are read when asked for.

    artefact["/frequency"]                 → ndarray (text comes back as str arrays)
    artefact.children("/reduced/mass")     → {"constant": ndarray, "E": ndarray}
    artefact.summary, .tables, .message    what the stage said; .warnings are those in the tables
    artefact.key, .digest, .header         what it was made from, and the sha256 of what it holds
    artefact.attributes("/augmented")      attributes of a group or dataset
    artefact.source                        the run beside this one that it has just been reused from, or ""

    Raises ArtefactError for a file that is missing, cut short, altered, of another format version, or that points
    outside itself.
    """

    def __init__(self, path: Path):
        self.path = Path(path)
        self.source = ""
        known = _identity(self.path)
        with _checked(self.path) as file:
            self._read(file, known in _VERIFIED)
        if known is not None:
            _VERIFIED.add(known)

    def _read(self, file: h5py.File, verified: bool) -> None:
        self.header, self.digest, self.message = _header(file, self.path)
        if not verified:
            _refuse_foreign_contents(file, self.path)
            found = content_digest(file)
            if found != self.digest:
                raise _damaged(self.path, f"its content digest is {found[:12]}, written was {self.digest[:12]}")
        self.summary: dict[str, Scalar] = {name: _plain(value) for name, value in file["summary"].attrs.items()}
        self.tables = tuple(
            Table(t["title"], tuple(t["columns"]), tuple(tuple(row) for row in t["rows"]))
            for t in json.loads(bytes(file["tables"][()]).decode())
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the stage warned of; commands print it also where the artefact is up to date."""
        return warnings_in(self.tables)

    @property
    def key(self) -> str:
        return self.header.key

    def __getitem__(self, path: str) -> np.ndarray:
        with _opened(self.path) as file:
            return _array(self._object(file, path, h5py.Dataset))

    def __contains__(self, path: str) -> bool:
        with _opened(self.path) as file:
            return path in file

    def children(self, path: str) -> dict[str, np.ndarray]:
        """The datasets directly under a group, by name."""
        with _opened(self.path) as file:
            group = self._object(file, path, h5py.Group)
            return {name: _array(item) for name, item in group.items() if isinstance(item, h5py.Dataset)}

    def groups(self, path: str) -> tuple[str, ...]:
        """Names of the groups directly under a group."""
        with _opened(self.path) as file:
            group = self._object(file, path, h5py.Group)
            return tuple(name for name, item in group.items() if isinstance(item, h5py.Group))

    def paths(self) -> tuple[str, ...]:
        """Every dataset of the file but the tables."""
        with _opened(self.path) as file:
            return tuple(p for p, item in _walk(file) if isinstance(item, h5py.Dataset) and p != "/tables")

    def attributes(self, path: str) -> dict[str, Any]:
        """Attributes of a group or dataset."""
        with _opened(self.path) as file:
            item = self._object(file, path, h5py.Group | h5py.Dataset)
            return {name: _plain(item.attrs[name]) for name in _attribute_names(item)}

    def _object(self, file: h5py.File, path: str, kind: Any) -> Any:
        if path not in file or not isinstance(file[path], kind):
            what = "group" if kind is h5py.Group else "dataset" if kind is h5py.Dataset else "entry"
            raise ArtefactError(
                f"no {what} {path} in this {self.header.stage} artefact, of stage version {self.header.version}",
                where=str(self.path),
                remedy=f"run it again: strainsight {self.header.stage} CONFIG --force",
            )
        return file[path]


def plain_name(name: str) -> bool:
    """Whether a file of that name can lie beside an artefact: no folder, nothing hidden, no other artefact."""
    return Path(name).name == name and not name.startswith(".") and not name.endswith(".h5")


def header_of(path: Path) -> Header:
    """What an artefact was made from, its bytes checked but not what they say. Raises ArtefactError."""
    with _checked(path) as file:
        return _header(file, path)[0]


def content_digest(file: h5py.File) -> str:
    """sha256 over every entry in path order: path, dtype, shape, bytes, attributes. The header stays outside.

    Two files that hold the same have the same digest, whatever their layout on disk.
    """
    digest = hashlib.sha256()
    for path, item in _walk(file):
        attributes = {name: _for_digest(item.attrs[name]) for name in _attribute_names(item)}
        digest.update(canonical([path, attributes]).encode())
        if isinstance(item, h5py.Dataset):
            digest.update(
                canonical([item.dtype.str if item.dtype.names is None else item.dtype.descr, item.shape]).encode()
            )
            for part in _parts(item):
                digest.update(np.ascontiguousarray(part).tobytes())
    digest.update(str(file.attrs["message"]).encode())
    return digest.hexdigest()


def file_digest(path: Path) -> str:
    """sha256 of an input file; of the content where the file is an artefact of another run."""
    return Artefact(path).digest if path.suffix == ".h5" and is_sealed(path) else sha256_of(path)


def digest_or_none(path: Path) -> str | None:
    """The same, None where there is no file."""
    return file_digest(path) if path.is_file() else None


def sha256_of(path: Path) -> str:
    """sha256 of the bytes of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _parts(item: h5py.Dataset) -> Iterator[np.ndarray]:
    if item.ndim == 0 or item.size == 0:
        yield np.asarray(item[()])
        return
    rows = max(1, CHUNK * item.shape[0] // max(1, item.size * item.dtype.itemsize))
    for start in range(0, item.shape[0], rows):
        yield item[start : start + rows]


def _identity(path: Path) -> tuple[int, ...] | None:
    """What changes with any writing to a file; None where it was written so lately that the clock may not tell."""
    try:
        found = path.stat()
    except OSError:
        return None
    if time.time_ns() - found.st_mtime_ns < SETTLED:
        return None
    # not the time of its last change of any kind: another name for the same file is one
    return (found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns)


@contextmanager
def _checked(path: Path) -> Iterator[h5py.File]:
    """The file, opened only if it is as it was sealed; raises ArtefactError for it and for all that goes wrong inside."""
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
        raise _damaged(path, f"it cannot be read to the end ({type(error).__name__})") from error


def _refuse_damaged(path: Path) -> None:
    if not path.is_file():
        raise ArtefactError("no such results file", where=str(path), remedy="run the stage that writes it")
    if path.stat().st_size < BLOCK:
        raise _damaged(path, f"it ends after {path.stat().st_size} bytes")
    if not is_sealed(path):
        raise ArtefactError(
            "this file was not written by strainsight", where=str(path), remedy="give a file from results/"
        )
    if not is_intact(path):
        raise _damaged(path, "its checksum is not the one it was written with")


def _opened(path: Path) -> h5py.File:
    try:
        return h5py.File(path, "r")
    except OSError as error:
        raise _damaged(path, "it is not a complete HDF5 file") from error


def _damaged(path: Path, why: str) -> ArtefactError:
    return ArtefactError(
        f"the results file is damaged: {why}", where=str(path), remedy="run again: a damaged artefact is written anew"
    )


def _header(file: h5py.File, path: Path) -> tuple[Header, str, str]:
    attributes = file.attrs
    _refuse_foreign_attributes(file, path)
    if attributes.get("format") != FORMAT:
        raise ArtefactError(
            "this HDF5 file was not written by strainsight", where=str(path), remedy="give a file from results/"
        )
    written = _plain(attributes.get("format_version"))
    if written != FORMAT_VERSION:
        raise ArtefactError(
            f"format version {written!r}{_by(attributes)}; this one reads version {FORMAT_VERSION}",
            where=str(path),
            remedy="run again with --force, or read it with the strainsight that wrote it",
        )
    header = Header(
        stage=str(attributes["stage"]),
        version=int(attributes["stage_version"]),
        key=str(attributes["key"]),
        config=json.loads(attributes["config"]),
        upstream=json.loads(attributes["upstream"]),
        files=json.loads(attributes["files"]),
        seed=int(attributes["seed"]) if "seed" in attributes else None,
        found=json.loads(attributes["found"]),
        beside=json.loads(attributes["beside"]),
        sizes={name: int(size) for name, size in json.loads(attributes.get("sizes", "{}")).items()},
        seconds=float(attributes["seconds"]) if "seconds" in attributes else None,
        code=str(attributes.get("code", "")),
    )
    if foreign := [name for name in header.beside or {} if not plain_name(name)]:
        raise _damaged(path, f"it names {foreign[0]!r} as a file beside it")
    return header, str(attributes["digest"]), str(attributes["message"])


def _by(attributes: Mapping[str, Any]) -> str:
    """By which strainsight, where that stands there."""
    return f", by strainsight {_plain(attributes['package_version'])}" if "package_version" in attributes else ""


def _walk(file: h5py.File) -> Iterator[tuple[str, Any]]:
    """Every group and dataset below the root, in path order; no object under two names, and no link to elsewhere."""
    seen = {_address(file)}

    def below(group: Any, path: str, depth: int) -> Iterator[tuple[str, Any]]:
        for name in sorted(group):
            link = group.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise _damaged(file.filename, f"{path}/{name} is a link to elsewhere, which is not followed")
            item = group[name]
            if (address := _address(item)) in seen or len(seen) > MAX_OBJECTS:
                what = "is another name of an object above" if address in seen else f"follows {MAX_OBJECTS} others"
                raise _damaged(file.filename, f"{path}/{name} {what}")
            seen.add(address)
            yield f"{path}/{name}", item
            if isinstance(item, h5py.Group):
                if depth >= MAX_DEPTH:
                    raise _damaged(file.filename, f"groups nested deeper than {MAX_DEPTH} at {path}/{name}")
                yield from below(item, f"{path}/{name}", depth + 1)

    yield from below(file, "", 1)


def _address(item: Any) -> int:
    """Where in the file an object lies, whatever its names."""
    return int(h5py.h5o.get_info(item.id).addr)


def _attribute_names(item: Any) -> list[str]:
    """Of an object, without those of its scales."""
    return [name for name in sorted(item.attrs) if name not in SCALE_ATTRIBUTES]


def _refuse_foreign_attributes(item: Any, path: Path) -> int:
    """Bytes of its attributes; raises ArtefactError for arrays of text, each entry of which may be the whole file again."""
    held, size = 0, Path(path).stat().st_size
    for name in _attribute_names(item):
        identifier = item.attrs.get_id(name)
        text = h5py.check_string_dtype(identifier.dtype)
        if identifier.dtype.hasobject and (text is None or identifier.shape != ()):
            raise _damaged(path, f"attribute {name} of {item.name} is not stored as it was written")
        if identifier.get_storage_size() <= size:
            value = item.attrs[name]
            held += len(value) if isinstance(value, str) else np.asarray(value).nbytes
        if identifier.get_storage_size() > size or held > size:
            raise _damaged(path, f"the attributes of {item.name} claim more bytes than the file holds")
    return held


def _refuse_foreign_contents(file: h5py.File, path: Path) -> None:
    """Links out of the file, storage out of the file, and shapes that the file does not hold the bytes for."""
    size = Path(path).stat().st_size
    held = 0
    for name, item in _walk(file):
        held += _refuse_foreign_attributes(item, path)
        if held > size:
            raise _damaged(path, f"{name} and what is above it claim more bytes than the file holds")
        if not isinstance(item, h5py.Dataset):
            continue
        stored = item.id.get_storage_size()
        claimed = item.size * item.dtype.itemsize if item.shape is not None else -1
        if item.is_virtual or item.external:
            raise _damaged(path, f"{name} keeps its data in another file, which is not followed")
        if item.dtype.hasobject or stored != claimed or stored > size:
            raise _damaged(path, f"{name} claims {claimed} bytes and the file holds {min(stored, size)}")
        # A small file can unpack to a piece of any size, or be read as often as it has entries.
        held += stored
        if item.chunks is not None or held > size:
            raise _damaged(path, f"{name} is not stored as it was written")
    missing = [name for name in ("summary", "tables") if name not in file]
    if missing:
        raise _damaged(path, f"it has no /{missing[0]}")


def _array(item: h5py.Dataset) -> np.ndarray:
    text = h5py.check_string_dtype(item.dtype)
    array = np.asarray(item[()])
    return np.char.decode(array, "utf-8") if text is not None else array


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, np.ndarray) and value.dtype.kind == "S":
        return np.char.decode(value, "utf-8")
    return value.decode() if isinstance(value, bytes) else value


def _for_digest(value: Any) -> Any:
    array = np.asarray(value)
    return [array.dtype.kind, array.shape, [repr(item) for item in array.ravel().tolist()]]

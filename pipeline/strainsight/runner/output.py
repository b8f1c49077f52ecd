"""Result of a stage: arrays with units, scalars, a message; and its reading from a file.
A file has about a hundred small datasets, which the low-level interface of h5py reads six times faster."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5g, h5l, h5o, h5s

from strainsight.errors import ArtefactError
from strainsight.runner.slices import canonical

Scalar = float | int | str | bool


@dataclass(frozen=True)
class Dataset:
    """One array of an artefact.

    array        numbers, booleans or strings, any shape
    unit         "m", "Hz", "strain", "1" for dimensionless; "" only under /VTKHDF
    description  one line, axes named: "strain of every candidate (time × candidate)"
    scales       path of the dataset that labels each axis, "" for an axis without one: ("/time", "")
    """

    array: np.ndarray
    unit: str
    description: str
    scales: tuple[str, ...] = ()


@dataclass(frozen=True)
class InMemory:
    """The datasets of a stage by path, from which records are read as from its artefact."""

    datasets: Mapping[str, Dataset]

    def __getitem__(self, path: str) -> np.ndarray:
        return np.asarray(self.datasets[path].array)

    def __contains__(self, path: str) -> bool:
        return path in self.datasets or any(name.startswith(f"{path}/") for name in self.datasets)

    def children(self, path: str) -> dict[str, np.ndarray]:
        """The datasets directly under a group, by name."""
        below = {full.removeprefix(f"{path}/"): full for full in self.datasets if full.startswith(f"{path}/")}
        return {name: self[full] for name, full in below.items() if "/" not in name}

    def groups(self, path: str) -> tuple[str, ...]:
        """Names of the groups directly under a group."""
        below = (full.removeprefix(f"{path}/") for full in self.datasets if full.startswith(f"{path}/"))
        return tuple(dict.fromkeys(name.partition("/")[0] for name in below if "/" in name))

    def attributes(self, path: str) -> dict[str, str]:
        """Those of a dataset."""
        return {"units": self.datasets[path].unit}


@dataclass(frozen=True)
class Table:
    """A table for people; every cell is already text. answer: printed at the end of `run`, others by `show`."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    answer: bool = False

    @property
    def name(self) -> str:
        """Beginning of the title, up to a colon, semicolon or bracket."""
        return re.split(r"[:;(]", self.title)[0].strip()


WARNINGS = "warnings"
"""Title of the table of a stage's warnings."""


def warnings_table(texts: Sequence[str], title: str = WARNINGS, answer: bool = False) -> tuple[Table, ...]:
    """A table of warnings or other sentences, none for no texts."""
    return (Table(title, ("",), tuple((text,) for text in texts), answer),) if texts else ()


def warning_texts(tables: Iterable[Table]) -> tuple[str, ...]:
    """Texts of tables titled `WARNINGS`, and of rows that begin with "warning"."""
    return tuple(row[-1] for table in tables for row in table.rows if table.title == WARNINGS or row[0] == "warning")


@dataclass(frozen=True)
class Output:
    """Complete result of a stage; equal inputs must give an equal Output (no time, no paths).

    datasets    path ("/reduced/mass/constant") → Dataset
    summary     small scalars that --json prints
    message     one line: "100 → 4, gap 0.000 %, E ± 0.08 %"
    tables      printed by the command of the stage and by `show`
    attributes  group or dataset path → attributes; under /VTKHDF they are written exactly as given
    files       file name → content, written next to the artefact ("report.html")
    inputs      additional input files found by the stage (INCLUDE of a deck); a change runs it again
    """

    datasets: Mapping[str, Dataset]
    summary: Mapping[str, Scalar]
    message: str
    tables: tuple[Table, ...] = ()
    attributes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    files: Mapping[str, bytes] = field(default_factory=dict)
    inputs: tuple[Path, ...] = ()


MAX_DEPTH, MAX_OBJECTS = 12, 1 << 16
IN_MEMORY = 1 << 20
"""[bytes] File size above which arrays are read on access: a suite opens the artefacts of all its runs."""
CHUNK = 1 << 24  # bytes hashed at a time
# Attributes that h5py writes for dimension scales: object references, whose bytes depend on where the file put things.
SCALE_ATTRIBUTES = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "DIMENSION_LABELS"}


@dataclass(frozen=True)
class Entry:
    """A group or dataset of the file.

    attributes  without those of dimension scales
    dataset     whether it is one
    array       its array; None of a group, and of a dataset of a file larger than IN_MEMORY
    """

    attributes: Mapping[str, Any]
    dataset: bool = False
    array: np.ndarray | None = None


def read_contents(file: h5py.File) -> dict[str, Entry]:
    """Every group and dataset below the root, by path and in the order of paths.

    Raises ArtefactError for links, two names of one object, data stored in other files, and shapes or attributes that claim
    more bytes than the file holds."""
    return _Reading(file).contents()


def attributes_of(file: h5py.File) -> dict[str, Any]:
    """Attributes of the root. Raises ArtefactError as `read_contents` does."""
    return _Reading(file).attributes(h5g.open(file.id, b"/"), "/")


def content_digest(file: h5py.File, contents: Mapping[str, Entry], message: str) -> str:
    """sha256 over every entry in path order: path, attributes, dtype, shape, bytes; then the message.
    Files with equal content have equal digests, independent of their layout on disk."""
    digest = hashlib.sha256()
    for path, entry in contents.items():
        attributes = {}
        for name, value in sorted(entry.attributes.items()):
            array = np.asarray(value)
            attributes[name] = [array.dtype.kind, array.shape, [repr(item) for item in array.ravel().tolist()]]
        digest.update(canonical([path, attributes]).encode())
        if entry.dataset:
            item = file[path] if entry.array is None else entry.array
            digest.update(
                canonical([item.dtype.str if item.dtype.names is None else item.dtype.descr, item.shape]).encode()
            )
            for part in _parts(item):
                digest.update(np.ascontiguousarray(part).tobytes())
    digest.update(message.encode())
    return digest.hexdigest()


def damaged(path: Path | str, why: str) -> ArtefactError:
    """Error for a file that differs from what was written."""
    return ArtefactError(
        f"the results file is damaged: {why}", where=str(path), remedy="run the stage again to replace the file"
    )


class _Reading:
    """One pass over a file.

    size     [bytes] of the file
    claimed  [bytes] that attributes and datasets read so far claim: a small file can be read as often as it has entries
    seen     addresses of objects
    """

    def __init__(self, file: h5py.File):
        self.root = h5g.open(file.id, b"/")
        self.name = file.filename
        self.size = Path(file.filename).stat().st_size
        self.claimed = 0
        self.seen = {_address(self.root)}

    def contents(self) -> dict[str, Entry]:
        entries = dict(self._below(self.root, "", 1))
        missing = [path for path in ("/summary", "/tables") if path not in entries]
        if missing:
            raise damaged(self.name, f"{missing[0]} is missing")
        return entries

    def _below(self, group: h5g.GroupID, path: str, depth: int) -> Iterator[tuple[str, Entry]]:
        for encoded in sorted(group):
            name = f"{path}/{encoded.decode()}"
            if group.links.get_info(encoded).type != h5l.TYPE_HARD:
                raise damaged(self.name, f"{name} is a soft or external link, which is not supported")
            item = h5o.open(group, encoded)
            if (address := _address(item)) in self.seen or len(self.seen) > MAX_OBJECTS:
                what = (
                    "is a second link to an earlier object"
                    if address in self.seen
                    else f"exceeds the limit of {MAX_OBJECTS} objects"
                )
                raise damaged(self.name, f"{name} {what}")
            self.seen.add(address)
            if isinstance(item, h5d.DatasetID):
                yield name, Entry(self.attributes(item, name), True, self._array(item, name))
            else:
                yield name, Entry(self.attributes(item, name))
            if isinstance(item, h5g.GroupID):
                if depth >= MAX_DEPTH:
                    raise damaged(self.name, f"the groups at {name} are nested deeper than {MAX_DEPTH} levels")
                yield from self._below(item, name, depth + 1)

    def attributes(self, item: Any, name: str) -> dict[str, Any]:
        """Attributes by name. Arrays of text are refused: each entry may be the whole file again."""
        values = {}
        for number in range(h5a.get_num_attrs(item)):
            attribute = h5a.open(item, index=number)
            key = attribute.name.decode()
            if key in SCALE_ATTRIBUTES:
                continue
            dtype, shape = attribute.dtype, attribute.shape
            text = h5py.check_string_dtype(dtype)
            empty = attribute.get_space().get_simple_extent_type() == h5s.NULL
            if empty or (dtype.hasobject and (text is None or shape != ())):
                raise damaged(self.name, f"attribute {key} of {name} is not a number, a text or an array of numbers")
            if attribute.get_storage_size() > self.size:
                raise damaged(self.name, f"the attributes of {name} are larger than the file")
            array = np.empty(shape, dtype)
            attribute.read(array)
            value: Any = array[()]
            if dtype.hasobject:
                value = value.decode("utf-8", "surrogateescape") if isinstance(value, bytes) else str(value)
            self._claim(len(value) if isinstance(value, str) else array.nbytes)
            values[key] = value
        return values

    def _array(self, item: h5d.DatasetID, name: str) -> np.ndarray | None:
        plan, dtype, shape = item.get_create_plist(), item.dtype, item.shape
        stored = item.get_storage_size()
        claimed = -1 if shape is None else int(np.prod(shape, dtype=object)) * dtype.itemsize
        layout = plan.get_layout()
        if layout == h5d.VIRTUAL or plan.get_external_count():
            raise damaged(self.name, f"{name} has its data in another file, which is not supported")
        if dtype.hasobject or stored != claimed or stored > self.size:
            raise damaged(
                self.name, f"{name} requires {claimed} bytes, but the file contains only {min(stored, self.size)} bytes"
            )
        if layout == h5d.CHUNKED:  # can unpack to a piece of any size
            raise damaged(self.name, f"{name} is stored in chunks, which is not supported")
        self._claim(stored)
        if self.size > IN_MEMORY:
            return None
        array = np.empty(shape, dtype)
        if array.size:
            item.read(h5s.ALL, h5s.ALL, array)
        return array

    def _claim(self, size: int) -> None:
        self.claimed += size
        if self.claimed > self.size:
            raise damaged(self.name, f"attributes and datasets require more than the {self.size} bytes of the file")


def _address(item: Any) -> int:
    """Address of an object in the file, the same for all its names."""
    return int(h5o.get_info(item).addr)


def _parts(item: h5py.Dataset | np.ndarray) -> Iterator[np.ndarray]:
    if item.ndim == 0 or item.size == 0:
        yield np.asarray(item[()])
        return
    rows = max(1, CHUNK * item.shape[0] // max(1, item.size * item.dtype.itemsize))
    for start in range(0, item.shape[0], rows):
        yield item[start : start + rows]

"""Write artefacts atomically, with the environment of their computation."""

from __future__ import annotations

import errno
import hashlib
import io
import json
import os
import platform
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache, partial
from importlib import metadata
from pathlib import Path

import h5py
import numpy as np

import strainsight
from strainsight.errors import StrainsightError, UserError
from strainsight.runner.artefact import (
    BLOCK,
    FORMAT,
    FORMAT_VERSION,
    GRID,
    MAPPINGS,
    Artefact,
    ArtefactHeader,
    digest_or_none,
    header_of,
    is_plain_name,
    seal,
    sha256_of,
)
from strainsight.runner.output import Output, content_digest, read_contents
from strainsight.runner.slices import canonical
from strainsight.writing import make_folder, replace_file, temporary

ROOT = Path(strainsight.__file__).parent
CPU = Path("/proc/cpuinfo")
PACKAGES = ("scipy", "numba", "pypardiso", "mkl")
"""Read from installed metadata, without import of the packages."""


@cache
def provenance() -> dict[str, str]:
    """Attribute name → value, "" if unknown."""

    def commit_of_build() -> str:  # of an installation from a repository, as pip notes it
        text = metadata.distribution("strainsight").read_text("direct_url.json")
        return str(json.loads(text or "{}")["vcs_info"]["commit_id"])

    def processor() -> str:
        lines = CPU.read_text(encoding="utf-8", errors="replace").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))

    return {
        "package_version": strainsight.__version__,
        "commit": commit_of(ROOT.parents[1]) or _known(commit_of_build),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "h5py": h5py.__version__,
        **{name: _known(partial(metadata.version, name)) for name in PACKAGES},
        # as in "scipy-openblas 0.3.30"
        "blas": _known(lambda: "{name} {version}".format(**np.show_config("dicts")["Build Dependencies"]["blas"])),
        "processor": _known(processor) or platform.processor() or platform.machine(),
    }


def _known(ask: Callable[[], str]) -> str:
    """Result of a query, or "" if it fails."""
    with suppress(metadata.PackageNotFoundError, OSError, ValueError, KeyError, TypeError, StopIteration):
        return ask()
    return ""


def commit_of(checkout: Path) -> str:
    """Commit of a git checkout, read without git, or "". Later modifications are visible in the digest of the code."""
    with suppress(OSError, ValueError, IndexError):
        git = checkout / ".git"
        if git.is_file():  # a worktree: "gitdir: …"
            git = (checkout / git.read_text(encoding="utf-8").split(":", 1)[1].strip()).resolve()
        head = (git / "HEAD").read_text(encoding="utf-8").strip()
        if not head.startswith("ref: "):
            return head
        name = head.removeprefix("ref: ")
        common = git / "commondir"
        top = (git / common.read_text(encoding="utf-8").strip()).resolve() if common.is_file() else git
        for folder in (git, top):
            if (folder / name).is_file():
                return (folder / name).read_text(encoding="utf-8").strip()
        for line in (top / "packed-refs").read_text(encoding="utf-8").splitlines():
            if line.endswith(f" {name}"):
                return line.split()[0]
    return ""


ROOM, ROOM_EACH = 1 << 14, 1 << 11
"""[bytes] Size of a file and of each array in addition to the data: headers, attributes, heaps, scales."""
RAW = "/VTKHDF"


def write_artefact(path: Path, output: Output, header: ArtefactHeader, records: tuple[str, ...] = ()) -> Artefact:
    """Write `output` to `path`, read back and verified before it gets that name.
    Written to a temporary file, then moved: `path` has the old content or the new, never a part. Files next to it are replaced
    first, so that the sha256 values in an artefact are valid. Obsolete files next to it are removed, unless they were modified.
    Raises UserError for a full or read-only disk; ValueError for an invalid Output: object arrays, a dataset without unit, a
    missing scale. records: of the stage."""
    _check(output)
    if any(map(_raw, output.datasets)):
        output = replace(output, files={**output.files, f"{path.stem}{GRID}": _grid_of(path.name, output)})
    checksums = {name: hashlib.sha256(content).hexdigest() for name, content in output.files.items()}
    sizes = {name: len(content) for name, content in output.files.items()}
    header = replace(header, side_files=checksums, sizes=sizes, resolved=header.resolved or {})
    size = _most_bytes(output, header)

    def write(part: Path) -> None:
        _reserve(part, size)
        with h5py.File(part, "w", track_order=False, userblock_size=BLOCK):
            pass  # this gives back what was reserved
        _reserve(part, size)
        with h5py.File(part, "r+", track_order=False) as file:
            _write_content(file, output)
            _write_header(file, header, output.message)
            file.flush()
            file.attrs["digest"] = content_digest(file, read_contents(file), output.message)
        seal(part)

    obsolete: dict[str, str] = {}
    with suppress(StrainsightError):  # where it cannot be read nothing is known to be its own
        before = (header_of(path).side_files or {}) if path.is_file() else {}
        obsolete = {name: digest for name, digest in before.items() if name not in output.files}
    with kept_on_disk(path), replace_together() as parts:
        make_folder(path.parent)
        parts.append((temporary(path, write), path))
        written = Artefact(parts[0][0])
        for name, content in output.files.items():
            if name in records:
                parts += former(path.parent / name, checksums[name])
            parts.append((temporary(path.parent / name, partial(Path.write_bytes, data=content)), path.parent / name))
    written.path = path
    for name, digest in obsolete.items():
        with kept_on_disk(path.parent / name):
            if digest_or_none(path.parent / name) == digest:
                (path.parent / name).unlink()
    return written


def former(path: Path, digest: str) -> list[tuple[Path, Path]]:
    """Keep a copy of a file before it is replaced by another content, for work that was based on it."""
    if not path.is_file() or path.is_symlink() or (old := sha256_of(path)) == digest:
        return []
    backup = path.with_name(f"{path.stem}-{old[:8]}{path.suffix}")
    return [] if backup.exists() else [(temporary(backup, partial(shutil.copyfile, path)), backup)]


def _grid_of(artefact: str, output: Output) -> bytes:
    """Grid file for ParaView with links to the artefact; the array names contain the units, which ParaView does not show
    otherwise."""
    content = io.BytesIO()
    with h5py.File(content, "w", track_order=False) as file:
        for path in sorted(filter(_raw, output.datasets)):
            # "…/von_mises" → "…/von_mises [Pa]", of a grid's data and of where their steps begin
            data = path.replace("/Steps/PointDataOffsets/", "/PointData/").replace(
                "/Steps/CellDataOffsets/", "/CellData/"
            )
            unit = output.attributes.get(data, {}).get("units", "")
            file[f"{path} [{unit}]" if unit else path] = h5py.ExternalLink(artefact, path)
        for path, attributes in output.attributes.items():
            if _raw(path) and path not in output.datasets:
                file.require_group(path).attrs.update(attributes)
    return content.getvalue()


@contextmanager
def replace_together() -> Iterator[list[tuple[Path, Path]]]:
    """Collect an artefact and its files as (temporary file, name); on success all get their names, the artefact last. After an
    error, none does."""
    parts: list[tuple[Path, Path]] = []
    try:
        yield parts
        for part, target in reversed(parts):
            replace_file(part, target)
    finally:
        for part, _ in parts:
            part.unlink(missing_ok=True)


@contextmanager
def kept_on_disk(path: Path) -> Iterator[None]:
    """Raise UserError, with file and remedy, for errors of the disk or its permissions."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.errno in (errno.EMFILE, errno.ENFILE):  # no matter of room
            raise
        raise UserError(
            f"the file cannot be written: {os.strerror(error.errno)}",
            where=str(path),
            remedy="free some disk space, or use a writable folder with --results DIR; existing files are unchanged",
        ) from error


def _most_bytes(output: Output, header: ArtefactHeader) -> int:
    """Upper bound of the file size."""
    arrays = sum(_text(np.asarray(d.array)).nbytes for d in output.datasets.values())
    attributes = sum(len(repr(dict(entries))) for entries in output.attributes.values())
    names = sum(len(name) + len(d.description) for name, d in output.datasets.items())
    header_size = len(repr((output.summary, output.tables, output.message, header)).encode())
    return ROOM + arrays + ROOM_EACH * len(output.datasets) + 2 * (attributes + names + header_size)


def _reserve(path: Path, size: int) -> None:
    """Reserve the space of the file on the disk, since the HDF5 library ends the process on a full disk."""
    if hasattr(os, "posix_fallocate"):
        with path.open("r+b") as stream:
            os.posix_fallocate(stream.fileno(), 0, size)


def _check(output: Output) -> None:
    for path, dataset in output.datasets.items():
        if not path.startswith("/") or path.endswith("/") or "//" in path or path in ("/summary", "/tables"):
            raise ValueError(f"'{path}' is not a valid path of an HDF5 dataset")
        if not _raw(path) and not (dataset.unit and dataset.description):
            raise ValueError(f"the dataset {path} has no unit or no description")
        missing = [scale for scale in dataset.scales if scale and scale not in output.datasets]
        if missing:
            raise ValueError(f"{path}: the dimension scale {missing[0]} is not among the datasets of the stage")
        if len(dataset.scales) > np.ndim(dataset.array):
            raise ValueError(f"{path} has {np.ndim(dataset.array)} axes, but {len(dataset.scales)} dimension scales")
    for name in output.files:
        if not is_plain_name(name):
            raise ValueError(f"'{name}' is not permitted as name of a file next to the results file")


def _raw(path: str) -> bool:
    return path == RAW or path.startswith(RAW + "/")


def _write_content(file: h5py.File, output: Output) -> None:
    for path, dataset in sorted(output.datasets.items()):
        array = np.asarray(dataset.array)
        if array.dtype.kind == "O" and not all(isinstance(item, str) for item in array.ravel()):
            raise ValueError(f"{path} is an array of objects; only numbers, booleans and text can be stored")
        if array.dtype.kind in "UO":
            encoded = np.char.encode(_text(array), "utf-8")
            array = encoded.astype(h5py.string_dtype("utf-8", max(1, encoded.dtype.itemsize)))
        item = file.create_dataset(path, data=array)
        if not _raw(path):
            item.attrs["units"] = dataset.unit
            item.attrs["description"] = dataset.description
    for scale in sorted({scale for dataset in output.datasets.values() for scale in dataset.scales if scale}):
        file[scale].make_scale(scale.rsplit("/", 1)[-1])
    for path, dataset in output.datasets.items():
        for axis, scale in enumerate(dataset.scales):
            if scale:
                file[path].dims[axis].attach_scale(file[scale])
    for path, attributes in output.attributes.items():
        target = file[path] if path in file else file.create_group(path)
        for name, value in attributes.items():
            target.attrs[name] = value
    summary = file.create_group("summary")
    for name, scalar in output.summary.items():
        if not isinstance(scalar, str | bool | int | float | np.generic):
            raise ValueError(f"the summary value {name} is a {type(scalar).__name__}, not a number, boolean or text")
        summary.attrs[name] = scalar
    tables = [vars(table) for table in output.tables]
    # A dataset and not an attribute, which HDF5 limits to 64 KiB.
    file.create_dataset("tables", data=np.frombuffer(json.dumps(tables, ensure_ascii=False).encode(), dtype=np.uint8))


def _text(array: np.ndarray) -> np.ndarray:
    """Objects as text, four bytes a letter; other arrays as they are."""
    return array.astype(str) if array.dtype.kind == "O" else array


def _write_header(file: h5py.File, header: ArtefactHeader, message: str) -> None:
    attributes = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "stage": header.stage,
        "stage_version": header.version,
        "key": header.key,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        **provenance(),
        "seed": header.seed,
        "seconds": header.seconds,
        "code": header.code or None,
        **{name: canonical(getattr(header, name)) for name in MAPPINGS},
        "message": message,
    }
    for name, value in attributes.items():
        if value is not None:
            file.attrs[name] = value

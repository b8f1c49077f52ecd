"""Read a mesh with meshio and report its output as messages; meshio prints, exits the process and drops cells.

It runs in a child process, see `child_reader`, because damaged files can make meshio allocate any size or run forever."""

from __future__ import annotations

import contextlib
import io
import re
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from strainsight.child_reader import Message, answer, child_reader
from strainsight.decks.text import LARGEST, error_at
from strainsight.errors import DeckError
from strainsight.processes import limit_memory, python

NOT_HERE = ("nastran", "abaqus", "gmsh", "mdpa")
"""Formats with a separate reader, because meshio loses data; and one in which meshio takes numbers for positions."""
INSTEAD = "export the mesh as gmsh .msh 4.1, Abaqus .inp or VTU (text or zlib-compressed)"
HDF5 = ("med", "h5m", "hmf", "cgns")

# meshio knows these cells by name, but fails because it has no dimension for them.
_UNLISTED = {"wedge15": 3, "pyramid13": 3, "wedge12": 3, "hexahedron24": 3, "penta_prism": 3, "hexa_prism": 3}
_UNLISTED |= {"triangle7": 2, "quad6": 2, "pixel": 2, "voxel": 3}
_VOXEL = 11
"""VTK number of the axis-aligned hexahedron of `ImageData`, which meshio does not know."""
_DROPPED = re.compile(r"cannot handle \(type (\d+)\)")
_FLAT = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 21, 22, 23, 28, 30, 34, 35)
_INTEGERS = {"char": 8, "signed_char": 8, "short": 16, "int": 32, "long": 64} | {
    f"vtktypeint{size}": size for size in (8, 16, 32, 64)
}
"""VTK integer types and their bits; each of meshio's two VTK readers knows only some."""
_COUNTS = re.compile(rb"^(?:POINTS|CELLS|CELL_TYPES|POINT_DATA|CELL_DATA|LOOKUP_TABLE \S+|FIELD \S+) +(.*)", re.M)


class Loaded(NamedTuple):
    """Result of meshio: mesh, format name, printed output, and additional files."""

    mesh: Any
    format: str
    notes: str
    included: tuple[str, ...]


def load(path: Path, weigh: Callable[[int], None] = lambda size: None) -> Loaded:
    """Read a mesh with meshio. Raises DeckError for data that it cannot read or would drop. weigh: called before reading with
    the bytes of the file and of the files that it includes."""
    formats = _formats(path)
    if not path.is_file():
        raise error_at(path, "no such file", "correct the file name or the folder")
    if path.stat().st_size == 0:
        raise error_at(path, "the file is empty", "export the mesh again")
    name = formats[0]
    weigh(path.stat().st_size)
    included = _check_file(path, name)
    weigh(path.stat().st_size + sum(Path(file).stat().st_size for file in included))
    out, err = io.StringIO(), io.StringIO()
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            warnings.simplefilter("ignore")
            import meshio

            for kind, dimension in _UNLISTED.items():
                meshio._mesh.topological_dimension.setdefault(kind, dimension)
            meshio._vtk_common.vtk_to_meshio_type.setdefault(_VOXEL, "voxel")
            meshio._common.num_nodes_per_cell.setdefault("voxel", 8)
            meshio.vtu._vtu.vtu_to_numpy_type.setdefault("String", np.dtype(np.uint8))
            for reader in (meshio.vtk._vtk_42, meshio.vtk._vtk_51):
                for word, bits in _INTEGERS.items():
                    unsigned = word.replace("int", "uint") if word.startswith("vtk") else f"unsigned_{word}"
                    reader.vtk_to_numpy_dtype_name |= {word: f"int{bits}", unsigned: f"uint{bits}"}
            mesh = meshio.read(path, file_format=name)
    except (Exception, SystemExit) as error:
        raise _failure(path, name, error, f"{out.getvalue()} {err.getvalue()}") from None
    notes = " ".join(f"{out.getvalue()} {err.getvalue()}".split())
    lost = [int(number) for number in _DROPPED.findall(notes) if int(number) not in _FLAT]
    if lost:
        raise error_at(
            path, f"cells of VTK type {lost[0]} are not supported", "mesh with tetrahedra, hexahedra or wedges"
        )
    return Loaded(mesh, name, notes, included)


def _formats(path: Path) -> list[str]:
    import meshio

    suffixes = [suffix.lower() for suffix in path.suffixes]
    endings = ["".join(suffixes[i:]) for i in range(len(suffixes))]
    known = meshio.extension_to_filetypes
    formats = [name for ending in endings for name in known.get(ending, []) if name not in NOT_HERE]
    if not formats and endings[-1:] == [".gz"]:
        raise error_at(
            path,
            "compressed meshes of this format are not supported",
            "unpack the mesh (gunzip) and specify the unpacked file",
        )
    if not formats:
        raise error_at(path, f"the file name extension {path.suffix or '(none)'} is not supported for meshes", INSTEAD)
    return formats


def _failure(path: Path, name: str, error: BaseException, printed: str) -> DeckError:
    if isinstance(error, KeyError) and re.match("pyramid|wedge|hexa|penta|tetra|poly|VTK_", str(error.args[0])):
        return error_at(
            path,
            f"{error.args[0]} cells are not supported",
            "mesh with tetrahedra, hexahedra or wedges of first or second order",
        )
    if isinstance(error, ModuleNotFoundError):
        return error_at(
            path, f"reading {name} files requires the Python package {error.name}", f"install the package, or {INSTEAD}"
        )
    if isinstance(error, MemoryError):
        return error_at(
            path,
            f"reading the mesh requires more than 1 GiB of memory, although the file has only {path.stat().st_size} bytes",
            INSTEAD,
        )
    reason = " ".join((printed if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}").split())
    reason = re.sub(r" ?Error: Couldn't read file\s.*", "", reason) or "the content has another format or is damaged"
    return error_at(path, f"the file cannot be read as {name} ({reason[:300]})", INSTEAD)


def _check_file(path: Path, name: str) -> tuple[str, ...]:
    """Raise DeckError for data that meshio reads incorrectly or should not follow; returns additional files of the mesh."""
    try:
        if name == "vtk":
            _check_vtk(path)
        elif name == "vtu":
            if (pieces := path.read_bytes().count(b"<Piece")) > 1:
                raise error_at(
                    path,
                    f"the file has {pieces} <Piece> elements, but only one is supported",
                    "merge the pieces into one",
                )
        elif name == "xdmf":
            return _check_xdmf(path)
        elif name == "tetgen":
            pair = path.with_suffix(".node" if path.suffix.lower() == ".ele" else ".ele")
            if not pair.is_file():
                return ()
            if not pair.resolve().is_relative_to(path.resolve().parent):
                raise _outside_error(pair.name, path)
            return (str(pair),)
        elif name in HDF5:
            check_hdf5(path)
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise error_at(path, f"the file cannot be read as {name} ({error})", INSTEAD) from None
    return ()


def _check_vtk(path: Path) -> None:
    content = path.read_bytes()
    dataset = re.search(rb"^\s*DATASET\s+(\w+)", content[:5000], re.M | re.I)
    if dataset and dataset[1].upper() != b"UNSTRUCTURED_GRID":
        raise error_at(
            path, f"the VTK data set {dataset[1].decode()} is not supported", "convert it to UNSTRUCTURED_GRID"
        )
    for match in _COUNTS.finditer(content):
        for word in match[1].split():
            if word.isdigit() and int(word) > len(content):
                line = content.count(b"\n", 0, match.start()) + 1
                raise error_at(
                    f"{path}:{line}",
                    f"the line declares {int(word)} entries, but the file has only {len(content)} bytes",
                    "the file is damaged: export the mesh again",
                )


def _check_xdmf(path: Path) -> tuple[str, ...]:
    """Check that the data files of an XDMF file are in or below its folder."""
    folder, data_files = path.resolve().parent, dict[str, None]()
    for item in ElementTree.parse(path).iter("DataItem"):
        form, text = item.get("Format"), (item.text or "").strip()
        if form == "Binary":
            raise error_at(
                path, 'a DataItem with Format="Binary" is not supported', "export the data with Format HDF or XML"
            )
        if form == "HDF":
            target = folder / text.rpartition(":")[0]
            if not target.resolve().is_relative_to(folder):
                raise _outside_error(text, path)
            data_files[str(target)] = None
    for name in data_files:
        check_hdf5(Path(name))
    return tuple(data_files)


def _outside_error(name: str, path: Path) -> DeckError:
    return error_at(
        path,
        f"the data file {name!r} is outside the folder of the mesh",
        "move the data file into the folder of the mesh or below it",
    )


def check_hdf5(path: Path) -> None:
    """Raise DeckError for an HDF5 file that refers to other files or has an array of more than 4 GiB."""
    import h5py

    inside = "write the data into this file, without links to other files"
    problems: list[tuple[str, str]] = []

    def look(name: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            problems.append((f"the HDF5 object {name} is a link to another file ({link.filename})", inside))

    def weigh(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            if item.external or item.is_virtual:
                problems.append((f"dataset {name} refers to data in another file", inside))
            elif item.nbytes > LARGEST:
                problems.append(
                    (f"dataset {name} has {item.nbytes / 1024**3:.1f} GiB (limit: 4 GiB)", "export a smaller mesh")
                )

    try:
        with h5py.File(path, "r") as file:
            file.visititems_links(look)
            file.visititems(weigh)
    except Exception as error:  # h5py has no exception class for damaged files
        reason = f"the file cannot be read as HDF5: {' '.join(str(error).split())[:300]}"
        raise error_at(path, reason, INSTEAD) from None
    if problems:
        raise error_at(path, *problems[0])


TIME_LIMIT = 7.0
"""Time limit [s] for reading, plus one second for every 100 kB of the file."""
MEMORY_LIMIT = 1 << 30
"""Memory limit [bytes] for reading, plus MEMORY_A_BYTE for every byte of the file and its additional files."""
MEMORY_A_BYTE = 200
COMMAND = python("strainsight.decks.other.load")


def load_sandboxed(path: Path) -> Loaded:
    """`load` in a child process. Raises the same DeckError, and one if the process fails."""
    limit = TIME_LIMIT + path.stat().st_size / 1e5 if path.is_file() else TIME_LIMIT
    what = f"reading the file crashed or took too long (more than {limit:.0f} s)"
    failure = error_at(path, what, f"the file may be damaged: {INSTEAD}")
    with child_reader(COMMAND, str(path), failure) as receive:
        record, arrays = receive(limit)

    def get(number: int | None) -> Any:
        return None if number is None else arrays[number]

    mesh = SimpleNamespace(
        points=get(record["points"]),
        cells=[SimpleNamespace(type=kind, dim=dim, data=get(data)) for kind, dim, data in record["cells"]],
        **{key: {name: get(n) for name, n in numbers.items()} for key, numbers in record["single"].items()},
        **{key: {name: [*map(get, ns)] for name, ns in numbers.items()} for key, numbers in record["lists"].items()},
        **{key: dict(tags) for key, tags in record["tags"].items()},
    )
    return Loaded(mesh, record["format"], record["notes"], tuple(record["included"]))


def messages(path: Path) -> Iterator[Message]:
    """In the child process: the mesh data that `read_meshio` needs, with numbers for the arrays."""
    loaded = load(path, lambda size: limit_memory(MEMORY_LIMIT + MEMORY_A_BYTE * size))
    arrays: list[np.ndarray] = []

    def put(values: Any) -> int | None:
        if values is None:
            return None
        try:
            array = np.asarray(values)
        except ValueError:  # cells with different numbers of nodes, of which only the count is needed
            array = np.zeros((len(values), 0))
        arrays.append(array.astype(str) if array.dtype.hasobject else array)
        return len(arrays) - 1

    mesh = loaded.mesh
    record = {
        "format": loaded.format,
        "notes": loaded.notes,
        "included": loaded.included,
        "points": put(mesh.points),
        "cells": [(block.type, block.dim, put(block.data)) for block in mesh.cells],
        "single": {
            key: {str(name): put(values) for name, values in (getattr(mesh, key) or {}).items()}
            for key in ("point_data", "field_data", "point_sets")
        },
        "lists": {
            key: {str(name): [put(block) for block in blocks] for name, blocks in (getattr(mesh, key) or {}).items()}
            for key in ("cell_data", "cell_sets")
        },
        "tags": {
            key: [(int(tag), [str(name) for name in names]) for tag, names in (getattr(mesh, key, None) or {}).items()]
            for key in ("point_tags", "cell_tags")
        },
    }
    yield record, arrays


if __name__ == "__main__":
    answer(lambda path: messages(Path(path)), ("h5py", "meshio"))

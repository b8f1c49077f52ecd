"""Reading with meshio so that whatever it meets comes back as a message: it prints, exits and drops cells on its own.

In a child process, see `child_reader`: meshio makes room for what a file claims, and does not return from some damaged ones.
"""

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
"""Formats with a reader of their own, because meshio loses too much; and one in which it takes numbers for positions."""
INSTEAD = "write the mesh as gmsh .msh 4.1, Abaqus .inp or VTU (zlib or text)"
HDF5 = ("med", "h5m", "hmf", "cgns")

# meshio knows these cells by name and fails on them because it does not list their dimension.
_UNLISTED = {"wedge15": 3, "pyramid13": 3, "wedge12": 3, "hexahedron24": 3, "penta_prism": 3, "hexa_prism": 3}
_UNLISTED |= {"triangle7": 2, "quad6": 2, "pixel": 2, "voxel": 3}
_VOXEL = 11
"""VTK's number of an axis-aligned hexahedron, which meshio does not know and `ImageData` is made of."""
_DROPPED = re.compile(r"cannot handle \(type (\d+)\)")
_FLAT = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 21, 22, 23, 28, 30, 34, 35)
_INTEGERS = {"char": 8, "signed_char": 8, "short": 16, "int": 32, "long": 64} | {
    f"vtktypeint{size}": size for size in (8, 16, 32, 64)
}
"""VTK's names of integers and their bits, of which each of meshio's two readers of VTK knows some."""
_COUNTS = re.compile(rb"^(?:POINTS|CELLS|CELL_TYPES|POINT_DATA|CELL_DATA|LOOKUP_TABLE \S+|FIELD \S+) +(.*)", re.M)


class Loaded(NamedTuple):
    """What meshio read: its mesh, its name of the format, what it printed meanwhile, and files that belong to this one."""

    mesh: Any
    format: str
    notes: str
    included: tuple[str, ...]


def load(path: Path, weigh: Callable[[int], None] = lambda size: None) -> Loaded:
    """Read a mesh with meshio. Raises DeckError for whatever it cannot read or would drop.

    weigh: called before reading with the bytes of the file and of those that it includes.
    """
    formats = _formats(path)
    if not path.is_file():
        raise error_at(path, "no such file", "check the name and the folder")
    if path.stat().st_size == 0:
        raise error_at(path, "the file is empty", "write the mesh again")
    name = formats[0]
    weigh(path.stat().st_size)
    included = _checked(path, name)
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
            path, f"cells of VTK's type {lost[0]} are not supported", "mesh with tetrahedra, hexahedra or wedges"
        )
    return Loaded(mesh, name, notes, included)


def _formats(path: Path) -> list[str]:
    import meshio

    suffixes = [suffix.lower() for suffix in path.suffixes]
    endings = ["".join(suffixes[i:]) for i in range(len(suffixes))]
    known = meshio.extension_to_filetypes
    found = [name for ending in endings for name in known.get(ending, []) if name not in NOT_HERE]
    if not found and endings[-1:] == [".gz"]:
        raise error_at(path, "a packed mesh of this format is not supported", "unpack it (gunzip) and give the mesh")
    if not found:
        raise error_at(path, f"no mesh format that is known by its ending {path.suffix or '(none)'}", INSTEAD)
    return found


def _failure(path: Path, name: str, error: BaseException, printed: str) -> DeckError:
    if isinstance(error, KeyError) and re.match("pyramid|wedge|hexa|penta|tetra|poly|VTK_", str(error.args[0])):
        return error_at(
            path,
            f"{error.args[0]} cells are not supported",
            "mesh with tetrahedra, hexahedra or wedges of first or second order",
        )
    if isinstance(error, ModuleNotFoundError):
        return error_at(path, f"reading {name} needs the package {error.name}", f"install it, or {INSTEAD}")
    if isinstance(error, MemoryError):
        return error_at(path, f"{path.stat().st_size} bytes claim a mesh that takes more than a GiB to read", INSTEAD)
    reason = " ".join((printed if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}").split())
    reason = re.sub(r" ?Error: Couldn't read file .*", "", reason) or "its content is not that format's, or damaged"
    return error_at(path, f"cannot be read as {name}: {reason[:300]}", INSTEAD)


def _checked(path: Path, name: str) -> tuple[str, ...]:
    """Refuse what meshio would get wrong or should not follow; returns the files that the mesh takes in."""
    try:
        if name == "vtk":
            _check_vtk(path)
        elif name == "vtu":
            if (pieces := path.read_bytes().count(b"<Piece")) > 1:
                raise error_at(
                    path,
                    f"the file is in {pieces} pieces, of which only one would be read",
                    "merge the pieces and save them as one",
                )
        elif name == "xdmf":
            return _check_xdmf(path)
        elif name == "tetgen":
            pair = path.with_suffix(".node" if path.suffix.lower() == ".ele" else ".ele")
            if not pair.is_file():
                return ()
            if not pair.resolve().is_relative_to(path.resolve().parent):
                raise _elsewhere(pair.name, path)
            return (str(pair),)
        elif name in HDF5:
            check_hdf5(path)
    except (OSError, ElementTree.ParseError, ValueError) as error:
        raise error_at(path, f"cannot be read as {name}: {error}", INSTEAD) from None
    return ()


def _check_vtk(path: Path) -> None:
    content = path.read_bytes()
    dataset = re.search(rb"^\s*DATASET\s+(\w+)", content[:5000], re.M | re.I)
    if dataset and dataset[1].upper() != b"UNSTRUCTURED_GRID":
        raise error_at(path, f"a {dataset[1].decode()} is no mesh of elements", "convert it to an unstructured grid")
    for match in _COUNTS.finditer(content):
        for word in match[1].split():
            if word.isdigit() and int(word) > len(content):
                line = content.count(b"\n", 0, match.start()) + 1
                raise error_at(
                    f"{path}:{line}",
                    f"{int(word)} entries are claimed in a file of {len(content)} bytes",
                    "write the mesh again: the file is damaged",
                )


def _check_xdmf(path: Path) -> tuple[str, ...]:
    """The data files of an XDMF file lie in or below its folder."""
    folder, found = path.resolve().parent, dict[str, None]()
    for item in ElementTree.parse(path).iter("DataItem"):
        form, text = item.get("Format"), (item.text or "").strip()
        if form == "Binary":
            raise error_at(path, "raw binary data are not supported", "write the data as HDF or XML")
        if form == "HDF":
            target = folder / text.rpartition(":")[0]
            if not target.resolve().is_relative_to(folder):
                raise _elsewhere(text, path)
            found[str(target)] = None
    for name in found:
        check_hdf5(Path(name))
    return tuple(found)


def _elsewhere(name: str, path: Path) -> DeckError:
    return error_at(
        path, f"the data file {name!r} leaves the folder of the mesh", "move the data file beside or below the mesh"
    )


def check_hdf5(path: Path) -> None:
    """Raise DeckError for an HDF5 file that takes data from other files or claims more than 4 GiB in one array."""
    import h5py

    found: list[str] = []

    def look(name: str, link: Any) -> None:
        if isinstance(link, h5py.ExternalLink):
            found.append(f"{name} is a link to another file ({link.filename})")

    def weigh(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            if item.external or item.is_virtual:
                found.append(f"{name} takes its data from another file")
            elif item.nbytes > LARGEST:
                found.append(f"{name} claims {item.nbytes / 1024**3:.1f} GiB")

    try:
        with h5py.File(path, "r") as file:
            file.visititems_links(look)
            file.visititems(weigh)
    except Exception as error:  # the library has no class of its own for damaged files
        reason = f"cannot be read as HDF5: {' '.join(str(error).split())[:300]}"
        raise error_at(path, reason, INSTEAD) from None
    if found:
        raise error_at(path, found[0], "write the data into the file itself, without links")


TIME_LIMIT = 7.0
"""[s] to read, and one more for every 100 kB of the file."""
MEMORY_LIMIT = 1 << 30
"""[bytes] that reading may take, and MEMORY_A_BYTE more for every one of the file and of those that it takes in."""
MEMORY_A_BYTE = 200
COMMAND = python("strainsight.decks.other.load")


def load_sandboxed(path: Path) -> Loaded:
    """`load`, in a child process. Raises DeckError as that does, and where the process fails."""
    limit = TIME_LIMIT + path.stat().st_size / 1e5 if path.is_file() else TIME_LIMIT
    failure = error_at(path, "reading it crashed, or did not come to an end", f"the file is damaged: {INSTEAD}")
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
    """In the child process: all that `read_meshio` asks of a mesh, with numbers for its arrays."""
    loaded = load(path, lambda size: limit_memory(MEMORY_LIMIT + MEMORY_A_BYTE * size))
    arrays: list[np.ndarray] = []

    def put(values: Any) -> int | None:
        if values is None:
            return None
        try:
            array = np.asarray(values)
        except ValueError:  # cells with different numbers of nodes: only their count is asked for
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
    answer(lambda asked: messages(Path(asked)), ("h5py", "meshio"))

"""`load` in a child process, which may crash, hang, or want more memory than there is.

meshio makes room for what a file claims (192 GiB were seen for a TetGen file of 300 bytes) and does not return from some
damaged ones; the HDF5 library below it ends the whole process on others. In a child process with limits that costs the file
and not the run.
"""

from __future__ import annotations

import json
import sys
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, BinaryIO

import numpy as np

from strainsight.decks.other.load import INSTEAD, Loaded, load
from strainsight.errors import DeckError
from strainsight.processes import START_LIMIT, asked_of_reader, limit_memory, python, reader

TIME_LIMIT = 7.0
"""[s] to read, and one more for every 100 kB of the file."""
MEMORY_LIMIT = 1 << 30
"""[bytes] that reading may take, and MEMORY_A_BYTE more for every one of the file and of those that it takes in."""
MEMORY_A_BYTE = 200
COMMAND = python("strainsight.decks.other.sandbox")


def load_sandboxed(path: Path) -> Loaded:
    """`load`, in a child process. Raises DeckError as that does, and where the process fails."""
    limit = TIME_LIMIT + path.stat().st_size / 1e5 if path.is_file() else TIME_LIMIT
    with reader(COMMAND, str(path), START_LIMIT) as within:
        answer = within(limit, lambda stream: stream.read())
    if not answer:
        raise DeckError(
            "reading it crashed, or did not come to an end", where=str(path), remedy=f"the file is damaged: {INSTEAD}"
        )
    return _unpacked(answer)


def _packed(loaded: Loaded) -> bytes:
    """All that `read_meshio` asks of a mesh, as the content of an .npz file: "record" is JSON, with numbers for arrays."""
    arrays: dict[str, np.ndarray] = {}

    def put(values: Any) -> str | None:
        if values is None:
            return None
        try:
            array = np.asarray(values)
        except ValueError:  # cells with different numbers of nodes: only their count is asked for
            array = np.zeros((len(values), 0))
        arrays[str(len(arrays))] = array.astype(str) if array.dtype.hasobject else array
        return str(len(arrays) - 1)

    mesh = loaded.mesh
    record = {
        "format": loaded.format,
        "notes": loaded.notes,
        "included": loaded.included,
        "points": put(mesh.points),
        "cells": [(block.type, block.dim, put(block.data)) for block in mesh.cells],
        "arrays": {
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
    file = BytesIO()
    np.savez(file, record=np.frombuffer(json.dumps(record).encode(), np.uint8), **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def _unpacked(answer: bytes) -> Loaded:
    """The mesh, with the names that meshio's has. Raises DeckError where the answer is one."""
    with np.load(BytesIO(answer), allow_pickle=False) as arrays:
        record = json.loads(arrays["record"].tobytes())
        if "what" in record:
            raise DeckError(record["what"], where=record["where"], remedy=record["remedy"])

        def get(number: str | None) -> Any:
            return None if number is None else arrays[number]

        mesh = SimpleNamespace(
            points=get(record["points"]),
            cells=[SimpleNamespace(type=kind, dim=dim, data=get(data)) for kind, dim, data in record["cells"]],
            **{key: {name: get(n) for name, n in found.items()} for key, found in record["arrays"].items()},
            **{key: {name: [*map(get, ns)] for name, ns in found.items()} for key, found in record["lists"].items()},
            **{key: dict(found) for key, found in record["tags"].items()},
        )
    return Loaded(mesh, record["format"], record["notes"], tuple(record["included"]))


def _limit_memory(size: int) -> None:
    """From now on no more than is there, MEMORY_LIMIT and the share of a file of so many bytes, where the system can."""
    limit_memory(MEMORY_LIMIT + MEMORY_A_BYTE * size)


def _answer(out: BinaryIO) -> None:
    path = Path(asked_of_reader("h5py", "meshio"))
    try:
        out.write(_packed(load(path, _limit_memory)))
    except DeckError as error:
        record = {"what": error.what, "where": error.where, "remedy": error.remedy}
        file = BytesIO()
        np.savez(file, record=np.frombuffer(json.dumps(record).encode(), np.uint8))
        out.write(file.getvalue())


if __name__ == "__main__":
    _answer(sys.stdout.buffer)

"""What a .npz archive says that it holds, before anything of it is unpacked: some megabytes may stand for gigabytes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from zipfile import ZipFile, ZipInfo

from numpy.lib import format as npy

from strainsight.errors import DeckError
from strainsight.memory import require_memory

AT_ONCE = 2
"""Times what is unpacked that reading holds at once: the arrays, and the matrix that is made of them."""
ENDING = ".npy"
HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
"""Of arrays whose type has no names of columns; matrices have none."""


def require_room(path: Path, names: Iterable[str]) -> None:
    """Raise UserError where memory does not hold these arrays of an archive; DeckError where the two headers of one, that of the
    archive and its own, do not agree in its size."""
    with ZipFile(path) as archive:
        wanted = [info for info in archive.infolist() if info.filename.removesuffix(ENDING) in set(names)]
        unpacked = sum(_size(archive, info, path) for info in wanted)
    require_memory(
        AT_ONCE * unpacked,
        f"{path} ({path.stat().st_size / 1e6:.3g} MB) unpacks to {unpacked / 1e6:.4g} MB",
        "write it sparse",
    )


def _size(archive: ZipFile, info: ZipInfo, path: Path) -> int:
    """Bytes that an array unpacks to. Only its header is read, to which numpy sets a limit."""
    with archive.open(info) as stream:
        version = npy.read_magic(stream)
        if version not in HEADERS:
            raise DeckError(
                f"{info.filename} is of the version {version} of .npy", where=str(path), remedy="write plain numbers"
            )
        shape, _, dtype = HEADERS[version](stream)
        stated = stream.tell() + math.prod(shape) * dtype.itemsize
    if stated != info.file_size and not dtype.hasobject:
        raise DeckError(
            f"{info.filename} is {info.file_size} bytes by the archive and {stated} by its own header",
            where=str(path),
            remedy="write the matrix again: the file is damaged, or was made to fill memory",
        )
    return max(stated, info.file_size)

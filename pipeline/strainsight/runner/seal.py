"""A checksum of the whole file, in front of it.

It is checked before the HDF5 library is let near the file: a single flipped byte in its metadata can hold the library for
ever. HDF5 allows a block of one's own at the start of a file and looks for its own beginning behind it, as do ParaView's readers.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

BLOCK = 512
"""Bytes in front of the HDF5 file; the least that HDF5 allows."""
MAGIC = b"strainsight sha256 "


def seal(path: Path) -> None:
    """Write the sha256 of all that stands behind the block into the block."""
    with Path(path).open("r+b") as stream:
        stream.seek(BLOCK)
        line = MAGIC + hashlib.file_digest(stream, "sha256").hexdigest().encode() + b"\n"
        stream.seek(0)
        stream.write(line.ljust(BLOCK, b"\0"))


def is_sealed(path: Path) -> bool:
    """Whether the file begins as an artefact does."""
    with Path(path).open("rb") as stream:
        return stream.read(len(MAGIC)) == MAGIC


def is_intact(path: Path) -> bool:
    """Whether every byte of the file is as it was sealed."""
    with Path(path).open("rb") as stream:
        block = stream.read(BLOCK)
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return block == (MAGIC + digest.encode() + b"\n").ljust(BLOCK, b"\0")

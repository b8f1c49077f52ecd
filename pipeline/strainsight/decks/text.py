"""Lines of a text deck: reading, unpacking, and the files that a deck takes in."""

from __future__ import annotations

import gzip
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

from strainsight.errors import DeckError

LARGEST = 4 * 1024**3
"""[bytes] of a file, unpacked."""
PACKING, SMALL = 100, 1 << 26
"""No deck of more than SMALL bytes packs to a hundredth (one of numbers: to a fifth); what does was made to fill memory."""
DEEPEST, OFTENEST = 16, 100
"""Files that may be taken in by one another, and times that one may be."""
_WINDOWS = {i: bytes([i]).decode("cp1252", "ignore") or chr(i) for i in range(0x80, 0xA0)}
"""Where the code page of Windows differs from Latin-1; its five holes stay."""
UNPACKING = (gzip.BadGzipFile, EOFError, zlib.error)
"""What a damaged .gz raises."""


class Line(NamedTuple):
    """A line without comment and trailing blanks, and where it stands."""

    text: str
    file: str
    number: int

    @property
    def where(self) -> str:
        """file:line."""
        return f"{self.file}:{self.number}"


def text_lines(path: Path) -> list[str]:
    """The lines of a text file, which end in \\n, \\r\\n or \\r and in no other sign (str.splitlines knows eight more).

    Raises DeckError for a file that is missing, empty, binary, damaged or unpacks to more than 4 GiB.
    """
    return read_text(path).replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")


def read_text(path: Path) -> str:
    """The text of a deck in UTF-8, else in the code page 1252 of Windows; DeckError as for `text_lines`."""
    content = read_bytes(path)
    if b"\0" in content[:1_000_000]:
        raise DeckError(
            "a binary file, not a text deck",
            where=str(path),
            remedy="give the input deck (.bdf, .inp), not a results file (.op2, .odb, .h5)",
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1").translate(_WINDOWS)


def read_bytes(path: Path) -> bytes:
    """The content of a file, unpacked where its name ends in .gz.

    Raises DeckError for a file that is missing, empty, damaged, no plain one, or unpacks to more than 4 GiB.
    """
    try:
        check_plain(path)
        content = path.read_bytes() if path.suffix.lower() != ".gz" else _unpacked(path)
    except FileNotFoundError:
        raise DeckError("no such file", where=str(path), remedy="check the name and the folder") from None
    except UNPACKING as error:
        raise DeckError(f"cannot be unpacked: {error}", where=str(path), remedy="pack the deck again") from None
    except OSError as error:
        raise DeckError(
            f"cannot be read: {error.strerror}", where=str(path), remedy="check that it is a readable file"
        ) from None
    if not content.strip():
        raise DeckError("the file is empty", where=str(path), remedy="write the deck again")
    return content


def _unpacked(path: Path) -> bytes:
    parts: list[bytes] = []
    size = 0
    with opened(path) as file:
        while part := file.read(2**24):
            parts.append(part)
            size += len(part)
            if size > LARGEST:
                raise DeckError("more than 4 GiB", where=str(path), remedy="check that this is the deck")
            if size > max(SMALL, PACKING * path.stat().st_size):
                raise DeckError(
                    f"it unpacks to more than {PACKING} times its size",
                    where=str(path),
                    remedy="check that this is the deck; if it is, unpack it and give what comes out",
                )
    return b"".join(parts)


def check_plain(path: Path) -> None:
    """Raise DeckError for a pipe, which would be waited for, or a device, which has no end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise DeckError("is not a plain file", where=str(path), remedy="write it to a file, and give that")


def opened(path: Path) -> BinaryIO:
    """The file, open to read its bytes, unpacked where its name ends in .gz."""
    return cast(BinaryIO, gzip.open(path)) if path.suffix.lower() == ".gz" else path.open("rb")


def allowed(path: Path, include: Sequence[Path]) -> tuple[Path, ...]:
    """Folders from which a deck may take in files: its own, and those of `include`; links are followed."""
    return (path.resolve().parent, *(folder.resolve() for folder in include))


def included_file(
    name: str,
    word: str,
    path: Path,
    number: int,
    folders: tuple[Path, ...],
    parents: tuple[Path, ...],
    taken: Counter[Path],
) -> Path:
    """The file that line `number` of `path` takes in by `word` (INCLUDE, *INCLUDE).

    The name is one seen from the folder of `path`, or else from one of `folders`, the first of which is that of the whole deck.
    The file must lie in or below one of these once links and `..` are followed, and not be one of `parents`, which are being
    read; taken: how often each file has been taken in so far, this time is added.
    Raises DeckError where it does not, is not there, or the files multiply (thirty that each take in the next one twice are a
    thousand million).
    """
    where = f"{path}:{number}"
    found = [(folder / name, *_resolved(folder / name)) for folder in (path.parent, *folders)]
    outside = [resolved for _, resolved, _ in found if resolved and not _in_one(resolved, folders)]
    target, resolved = next(
        ((target, resolved) for target, resolved, there in found if resolved and there and _in_one(resolved, folders)),
        (path, None),
    )
    if resolved is None and outside:
        leaves = "the folder of the deck" + (" and those of mesh.include_dirs" if folders[1:] else "")
        raise DeckError(
            f"{word} {name!r} leaves {leaves}",
            where=where,
            remedy=f"move the included file beside or below the deck, or name its folder, {outside[0].parent}, as seen from the "
            "config: mesh.include_dirs: [FOLDER]",
        )
    if resolved is None:
        raise DeckError(f"{word} {name!r}: no such file", where=where, remedy="give the file, or remove the line")
    if resolved in parents:
        raise DeckError(f"{word} {name!r} includes itself", where=where, remedy="remove the circle")
    taken[resolved] += 1
    if len(parents) > DEEPEST or taken[resolved] > OFTENEST:
        what = f"{len(parents)} deep" if len(parents) > DEEPEST else f"{taken[resolved]} times"
        raise DeckError(f"{word} {name!r}: taken in {what}", where=where, remedy="write the deck into fewer files")
    return target


def _resolved(target: Path) -> tuple[Path | None, bool]:
    """The path without links and `..`, None where there can be none, and whether it is a file."""
    try:
        resolved = target.resolve()
        return resolved, resolved.is_file()
    except (OSError, RuntimeError, ValueError):  # too long a name, a zero in it, links in a circle
        return None, False


def _in_one(path: Path, folders: Sequence[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)

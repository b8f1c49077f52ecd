"""Lines and numbers of a text deck: reading, unpacking, parsing, and the files that a deck takes in."""

from __future__ import annotations

import gzip
import math
import re
import zlib
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple, cast

from strainsight.decks.faults import Doubt
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


AGAIN = "write the file again: it was cut short or altered"


def error_at(place: Path | str, what: str, remedy: str) -> DeckError:
    """A DeckError at a file, or a place in one, "file:line"."""
    return DeckError(what, where=str(place), remedy=remedy)


def damaged(what: str, where: str) -> DeckError:
    """A file that was cut short or altered."""
    return error_at(where, what, AGAIN)


class Line(NamedTuple):
    """A line without comment and trailing blanks, and where it stands."""

    text: str
    file: str
    number: int

    @property
    def where(self) -> str:
        """file:line."""
        return f"{self.file}:{self.number}"

    def error(self, what: str, remedy: str) -> DeckError:
        """A DeckError at this line."""
        return error_at(self.where, what, remedy)


def text_lines(path: Path) -> list[str]:
    """The lines of a text file, which end in \\n, \\r\\n or \\r and in no other sign (str.splitlines knows eight more).

    Raises DeckError for a file that is missing, empty, binary, damaged or unpacks to more than 4 GiB.
    """
    return read_text(path).replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")


def read_text(path: Path) -> str:
    """The text of a deck in UTF-8, else in the code page 1252 of Windows; DeckError as for `text_lines`."""
    content = read_bytes(path)
    if b"\0" in content[:1_000_000]:
        raise error_at(
            path,
            "a binary file, not a text deck",
            "give the input deck (.bdf, .inp), not a results file (.op2, .odb, .h5)",
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
        raise error_at(path, "no such file", "check the name and the folder") from None
    except UNPACKING as error:
        raise error_at(path, f"cannot be unpacked: {error}", "pack the deck again") from None
    except OSError as error:
        raise error_at(path, f"cannot be read: {error.strerror}", "check that it is a readable file") from None
    if not content.strip():
        raise error_at(path, "the file is empty", "write the deck again")
    return content


def _unpacked(path: Path) -> bytes:
    parts: list[bytes] = []
    size = 0
    with opened(path) as file:
        while part := file.read(2**24):
            parts.append(part)
            size += len(part)
            if size > LARGEST:
                raise error_at(path, "more than 4 GiB", "check that this is the deck")
            if size > max(SMALL, PACKING * path.stat().st_size):
                raise error_at(
                    path,
                    f"it unpacks to more than {PACKING} times its size",
                    "check that this is the deck; if it is, unpack it and give what comes out",
                )
    return b"".join(parts)


def check_plain(path: Path) -> None:
    """Raise DeckError for a pipe, which would be waited for, or a device, which has no end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise error_at(path, "is not a plain file", "write it to a file, and give that")


def opened(path: Path) -> BinaryIO:
    """The file, open to read its bytes, unpacked where its name ends in .gz."""
    return cast(BinaryIO, gzip.open(path)) if path.suffix.lower() == ".gz" else path.open("rb")


@dataclass
class Includes:
    """Files that a deck includes. folders: its own, and those of `mesh.include_dirs`, links followed; taken: how often each file
    was included; notes: names that fit two files, or none but for capitals."""

    folders: tuple[Path, ...]
    taken: Counter[Path] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, deck: Path, include: Sequence[Path]) -> Includes:
        """Those of a deck that may read from its folder and those of `include`."""
        return cls((deck.resolve().parent, *(folder.resolve() for folder in include)))

    def file(self, name: str, word: str, line: Line, parents: tuple[Path, ...], nearest: bool = False) -> Path:
        """The file that a line includes by `word` (INCLUDE, *INCLUDE).

        The name is relative to the folder of the whole deck, or else of the file of the line (nearest: the other way round), or
        else to one of `folders`; \\ counts as / where no file has it in its name, and capitals do not count where no file has
        them. The file must lie in or below one of `folders` once links and `..` are followed, and not be one of `parents`,
        which are being read.
        Raises DeckError where it does not, is not there, or the files multiply (thirty that each include the next one twice are
        a thousand million).
        """
        bases = list(dict.fromkeys([self.folders[0], Path(line.file).resolve().parent][:: -1 if nearest else 1]))
        bases += [folder for folder in self.folders if folder not in bases]
        targets = [base / spelling for spelling in dict.fromkeys([name, name.replace("\\", "/")]) for base in bases]
        files = [target for target in targets if _is_file(target)]
        if not files:
            files = [target for base in bases for target in _but_for_capitals(base, name.replace("\\", "/"))]
            self.notes += (
                [f"{word} {name!r} ({line.where}): {files[0]} was read, which other capitals spell"] if files else []
            )
        inside = [target for target in files if _in_one(target.resolve(), self.folders)]
        if not inside:
            outside = [*files, *(t for t in targets if _resolved(t) and not _in_one(t.resolve(), self.folders))]
            raise self._not_found(name, word, line, outside)
        target, resolved = inside[0], inside[0].resolve()
        near = [base / name for base in bases[:2]]
        if others := [other for other in inside if other in near and other.resolve() != resolved]:
            what = f"{word} {name!r} ({line.where}): {target} was read, and {others[0]} is another file of that name"
            self.notes.append(Doubt(f"{what}; rename one of them if that one is meant"))
        if resolved in parents:
            raise line.error(f"{word} {name!r} includes itself", "remove the circle")
        self.taken[resolved] += 1
        if len(parents) > DEEPEST or self.taken[resolved] > OFTENEST:
            what = f"{len(parents)} deep" if len(parents) > DEEPEST else f"{self.taken[resolved]} times"
            raise line.error(f"{word} {name!r}: taken in {what}", "write the deck into fewer files")
        return target

    def _not_found(self, name: str, word: str, line: Line, outside: Sequence[Path]) -> DeckError:
        if outside:
            leaves = "the folder of the deck" + (" and those of mesh.include_dirs" if self.folders[1:] else "")
            return line.error(
                f"{word} {name!r} leaves {leaves}",
                "move the included file beside or below the deck, or name its folder, "
                f"{outside[0].resolve().parent}, as seen from the config: mesh.include_dirs: [FOLDER]",
            )
        symbol = "; ~, variables and symbols before a colon are not replaced" if re.search(r"^~|[$%]|\w:", name) else ""
        return line.error(
            f"{word} {name!r}: no such file" + symbol,
            "correct the path, or name the folder of the file: mesh.include_dirs: [FOLDER]",
        )


def _resolved(target: Path) -> Path | None:
    """The path without links and `..`; None where there can be none: too long a name, a zero in it, links in a circle."""
    try:
        return target.resolve()
    except (OSError, RuntimeError, ValueError):
        return None


def _is_file(target: Path) -> bool:
    try:
        return target.is_file()
    except (OSError, RuntimeError, ValueError):
        return False


def _but_for_capitals(base: Path, name: str) -> list[Path]:
    """Files below a folder that have this path but for capitals, as on Windows."""
    try:
        levels = [base]
        for part in Path(name).parts:
            levels = [
                path
                for level in levels
                for path in (
                    [level / part] if part in ("/", "..") else sorted(level.iterdir()) if level.is_dir() else []
                )
                if path.name.lower() == part.lower() or part in ("/", "..")
            ]
        return [path for path in levels if path.is_file()]
    except OSError:
        return []


def _in_one(path: Path, folders: Sequence[Path]) -> bool:
    return any(path.is_relative_to(folder) for folder in folders)


_SHORT_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))[dD]?([+-]?\d+)")
_WHOLE = re.compile(r"[+-]?\d+")
LARGEST_ID = 10**12
"""Ids and other integers are smaller, so that those of many instances can be set apart in 64 bits."""


def parse_integer(token: str) -> int | None:
    """An integer below LARGEST_ID in size, or None."""
    if "_" in token or len(token) > 24:
        return None
    try:
        value = int(token)
    except ValueError:
        return None
    return value if abs(value) < LARGEST_ID else None


def is_whole(token: str) -> bool:
    """Is it written as an integer, however large?"""
    return _WHOLE.fullmatch(token) is not None


def no_integer(token: str) -> str:
    """Why `parse_integer` finds none, in words."""
    return f"is {token[:24]}, too large (the limit is 10^12)" if is_whole(token) else f"is {token!r}, not an integer"


def parse_real(token: str) -> float | None:
    """A finite real in any of Nastran's forms (1.7E-4, 1.7D-4, 1.7-4), or None."""
    if "_" in token or not token:
        return None
    try:
        value = float(token)
    except ValueError:
        short = _SHORT_REAL.fullmatch(token)
        if not short:
            return None
        value = float(f"{short[1]}e{short[2]}")
    return value if math.isfinite(value) else None


def entry(entries: Sequence[str], i: int) -> str:
    """Entry i from 0 of a card or line; "" where it is shorter."""
    return entries[i] if i < len(entries) else ""


class Entries(ABC):
    """Words and numbers of a card or a data line by the places of their entries, from 0."""

    __slots__ = ()
    WORD, FIRST = "entry", 1
    """What an entry is called, and the number of the first, in messages."""

    @property
    @abstractmethod
    def tokens(self) -> Sequence[str]:
        """The entries as they stand."""

    @abstractmethod
    def error(self, what: str, remedy: str = ...) -> DeckError:
        """A DeckError at this card or line."""

    def text(self, i: int) -> str:
        """Entry i; "" where there are fewer."""
        return entry(self.tokens, i)

    def integer(self, i: int, meaning: str, default: int | None = None) -> int:
        """Entry i as an integer; a blank one is `default`, or a DeckError."""
        token = entry(self.tokens, i)
        if not token and default is not None:
            return default
        value = parse_integer(token)
        if value is None:
            raise self.error(f"{meaning} ({self.WORD} {i + self.FIRST}) {no_integer(token)}")
        return value

    def component(self, i: int, default: int | None = None) -> int:
        """Entry i, which names one of the components 1 to 6 of a node, as 0 to 5."""
        value = self.integer(i, "the component", default)
        if not 1 <= value <= 6:
            raise self.error(
                f"component {value} ({self.WORD} {i + self.FIRST}) is not one of 1 to 6", "give one of 1 to 6"
            )
        return value - 1

    def real(self, i: int, meaning: str, default: float | None = None) -> float:
        """Entry i as a finite real, also in Nastran's short form 1.7-4; a blank one is `default`, or a DeckError."""
        token = entry(self.tokens, i)
        if not token and default is not None:
            return default
        value = parse_real(token)
        if value is None:
            raise self.error(f"{meaning} ({self.WORD} {i + self.FIRST}) is {token!r}, not a number")
        return value

    def positive(self, i: int, meaning: str, default: float | None = None) -> float:
        """The same above zero; meaning: "the thickness T"."""
        value = self.real(i, meaning, default)
        if not value > 0:
            raise self.error(f"{meaning} is {value:g}, not positive", f"give a positive {meaning.split()[1]}")
        return value

    def not_negative(self, i: int, meaning: str, default: float | None = None) -> float:
        """The same, zero or above."""
        value = self.real(i, meaning, default)
        if value < 0:
            raise self.error(f"{meaning} is {value:g}, negative", f"give a positive {meaning.split()[1]}")
        return value

"""Lines and numbers of a text deck: reading, unpacking, parsing, and included files."""

from __future__ import annotations

import gzip
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
from strainsight.text import parse_real as parse_real

LARGEST = 4 * 1024**3
"""Largest unpacked size of a file [bytes]."""
PACKING, SMALL = 100, 1 << 26
"""Decks compress to a fifth of their size. A file above SMALL bytes that compresses to a hundredth is refused,
because it may fill the memory."""
DEEPEST, OFTENEST = 16, 100
"""Largest depth of nested includes, and how often one file may be included."""
_WINDOWS = {i: bytes([i]).decode("cp1252", "ignore") or chr(i) for i in range(0x80, 0xA0)}
"""Characters in which Windows-1252 differs from Latin-1; its five undefined bytes are kept."""
UNPACKING = (gzip.BadGzipFile, EOFError, zlib.error)
"""Errors of a damaged .gz file."""


AGAIN = "the file is truncated or damaged: export it again"


def error_at(place: Path | str, what: str, remedy: str) -> DeckError:
    """A DeckError for a file or for "file:line"."""
    return DeckError(what, where=str(place), remedy=remedy)


def damage_error(what: str, where: str) -> DeckError:
    """Error for a truncated or damaged file."""
    return error_at(where, what, AGAIN)


class Line(NamedTuple):
    """A line without comment and trailing blanks, and its place in the file."""

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
    """Lines of a text file; only \\n, \\r\\n and \\r end a line (str.splitlines knows eight more).

    Raises DeckError for a file that is missing, empty, binary, damaged or unpacks to more than 4 GiB."""
    return read_text(path).replace("\r\n", "\n").replace("\r", "\n").removesuffix("\n").split("\n")


def read_text(path: Path) -> str:
    """Text of a deck in UTF-8 or else Windows-1252; DeckError as for `text_lines`."""
    content = read_bytes(path)
    if b"\0" in content[:1_000_000]:
        raise error_at(
            path,
            "the file is binary, not a text deck",
            "specify the input deck (.bdf, .inp), not a results file (.op2, .odb, .h5)",
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1").translate(_WINDOWS)


def read_bytes(path: Path) -> bytes:
    """Content of a file, unpacked if its name ends in .gz. Raises DeckError for a file that is missing, empty, damaged, not a
    plain file, or unpacks to more than 4 GiB."""
    try:
        check_plain(path)
        content = path.read_bytes() if path.suffix.lower() != ".gz" else _unpack(path)
    except FileNotFoundError:
        raise error_at(path, "no such file", "correct the file name or the folder") from None
    except UNPACKING as error:
        raise error_at(path, f"the file cannot be unpacked: {error}", "compress the deck again") from None
    except OSError as error:
        raise error_at(
            path, f"the file cannot be read: {error.strerror}", "check the permissions of the file"
        ) from None
    if not content.strip():
        raise error_at(path, "the file is empty", "export the deck again")
    return content


def _unpack(path: Path) -> bytes:
    parts: list[bytes] = []
    size = 0
    with open_file(path) as file:
        while part := file.read(2**24):
            parts.append(part)
            size += len(part)
            if size > LARGEST:
                raise error_at(path, "the unpacked file is larger than 4 GiB", "check that the file is the deck")
            if size > max(SMALL, PACKING * path.stat().st_size):
                raise error_at(
                    path,
                    f"the unpacked file is more than {PACKING} times larger than the .gz file",
                    "check that the file is the deck; if it is, unpack it first and specify the unpacked file",
                )
    return b"".join(parts)


def check_plain(path: Path) -> None:
    """Raise DeckError for a pipe or a device, which may never end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise error_at(
            path, "the path is a pipe or a device, not a file", "write the data to a file, and specify this file"
        )


def open_file(path: Path) -> BinaryIO:
    """Open a file for reading bytes, unpacked if its name ends in .gz."""
    return cast(BinaryIO, gzip.open(path)) if path.suffix.lower() == ".gz" else path.open("rb")


@dataclass
class Includes:
    """Files that a deck includes. folders: the folder of the deck and `mesh.include_dirs`, links resolved;
    include_count: how often each file was included; notes: ambiguous names, and names that differ only in capitals."""

    folders: tuple[Path, ...]
    include_count: Counter[Path] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, deck: Path, include: Sequence[Path]) -> Includes:
        """Includes of a deck that may read from its folder and those of `include`."""
        return cls((deck.resolve().parent, *(folder.resolve() for folder in include)))

    def file(self, name: str, word: str, line: Line, parents: tuple[Path, ...], nearest: bool = False) -> Path:
        """Path of the file that a line includes by `word` (INCLUDE, *INCLUDE).

        The name is relative to the folder of the main deck, then to that of the including file (nearest: the other way round),
        then to `folders`. \\ means / if no file has it in its name, and capitals are ignored if no file matches them. The file
        must be in or below one of `folders` after links and `..` are resolved, and must not be one of `parents`, which are being
        read. Raises DeckError if the file is missing or outside, or is included too often or too deeply."""
        bases = list(dict.fromkeys([self.folders[0], Path(line.file).resolve().parent][:: -1 if nearest else 1]))
        bases += [folder for folder in self.folders if folder not in bases]
        targets = [base / spelling for spelling in dict.fromkeys([name, name.replace("\\", "/")]) for base in bases]
        if not (files := [target for target in targets if _is_file(target)]):
            files = [target for base in bases for target in _but_for_capitals(base, name.replace("\\", "/"))]
            self.notes += (
                [f"{word} {name!r} ({line.where}): read from {files[0]}; the two names differ in upper and lower case"]
                if files
                else []
            )
        inside = [target for target in files if _in_one(target.resolve(), self.folders)]
        if not inside:
            outside = [*files, *(t for t in targets if _resolve(t) and not _in_one(t.resolve(), self.folders))]
            raise self._not_found(name, word, line, outside)
        target, resolved = inside[0], inside[0].resolve()
        near = [base / name for base in bases[:2]]
        if others := [other for other in inside if other in near and other.resolve() != resolved]:
            what = f"{word} {name!r} ({line.where}): read from {target}, but {others[0]} also fits this name"
            self.notes.append(Doubt(f"{what}; if {target} is the wrong file, rename one of the two files"))
        if resolved in parents:
            raise line.error(
                f"{word} {name!r}: the file includes itself, directly or through another file", f"remove one {word}"
            )
        self.include_count[resolved] += 1
        if len(parents) > DEEPEST or self.include_count[resolved] > OFTENEST:
            what = (
                f"nested {len(parents)} levels deep, but at most {DEEPEST} are allowed"
                if len(parents) > DEEPEST
                else f"included {self.include_count[resolved]} times, but at most {OFTENEST} are allowed"
            )
            raise line.error(f"{word} {name!r}: {what}", "combine the files of the deck into fewer files")
        return target

    def _not_found(self, name: str, word: str, line: Line, outside: Sequence[Path]) -> DeckError:
        if outside:
            leaves = "the folder of the deck" + (" and those of mesh.include_dirs" if self.folders[1:] else "")
            return line.error(
                f"{word} {name!r} is outside {leaves}",
                "move the included file into the folder of the deck or below it, or add its folder "
                f"{outside[0].resolve().parent} to the list mesh.include_dirs (relative to the config file)",
            )
        symbol = "; ~, variables and SYMBOL:file are not expanded" if re.search(r"^~|[$%]|\w:", name) else ""
        return line.error(
            f"{word} {name!r}: no such file" + symbol,
            "correct the path, or add the folder of the file to the list mesh.include_dirs",
        )


def _resolve(target: Path) -> Path | None:
    """Path with links and `..` resolved; None if it is invalid: too long, a null character, or circular links."""
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
    """Files below a folder whose path matches except for capitals, as on Windows."""
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


_WHOLE = re.compile(r"[+-]?\d+")
LARGEST_ID = 10**12
"""Limit of ids and other integers, so that ids of many instances stay distinct in 64 bits."""


def parse_integer(token: str) -> int | None:
    """An integer with magnitude below LARGEST_ID, or None."""
    if "_" in token or len(token) > 24:
        return None
    try:
        value = int(token)
    except ValueError:
        return None
    return value if abs(value) < LARGEST_ID else None


def is_whole(token: str) -> bool:
    """Whether a token is written as an integer of any size."""
    return _WHOLE.fullmatch(token) is not None


def describe_non_integer(what: str, token: str) -> str:
    """Reason why `parse_integer` returns None for the token of `what`."""
    if is_whole(token):
        return f"{what} is {token[:24]}, too large (the limit is 10^12)"
    return f"{what} is {repr(token) if token else 'blank'}, not an integer"


def entry(entries: Sequence[str], i: int) -> str:
    """Entry i (from 0) of a card or line; "" if it is missing."""
    return entries[i] if i < len(entries) else ""


class Entries(ABC):
    """Access to the entries of a card or data line as words and numbers, by position from 0."""

    __slots__ = ()
    WORD, FIRST = "entry", 1
    """Name of an entry, and the number of the first, in messages."""

    @property
    @abstractmethod
    def tokens(self) -> Sequence[str]:
        """The entries as written."""

    @abstractmethod
    def error(self, what: str, remedy: str = ...) -> DeckError:
        """A DeckError at this card or line."""

    def text(self, i: int) -> str:
        """Entry i; "" if it is missing."""
        return entry(self.tokens, i)

    def integer(self, i: int, meaning: str, default: int | None = None) -> int:
        """Entry i as an integer; a blank entry is `default`, or raises DeckError."""
        token = entry(self.tokens, i)
        if not token and default is not None:
            return default
        if (value := parse_integer(token)) is None:
            raise self.error(describe_non_integer(f"{meaning} ({self.WORD} {i + self.FIRST})", token))
        return value

    def component(self, i: int, default: int | None = None) -> int:
        """Entry i, a component 1 to 6 of a node, as 0 to 5."""
        value = self.integer(i, "the component", default)
        if not 1 <= value <= 6:
            raise self.error(
                f"component {value} ({self.WORD} {i + self.FIRST}) is not a degree of freedom",
                "write a component from 1 to 6",
            )
        return value - 1

    def real(self, i: int, meaning: str, default: float | None = None) -> float:
        """Entry i as a finite real, also in Nastran's short form 1.7-4; a blank one is `default`, or a DeckError."""
        token = entry(self.tokens, i)
        if not token and default is not None:
            return default
        if (value := parse_real(token)) is None:
            raise self.error(
                f"{meaning} ({self.WORD} {i + self.FIRST}) is {repr(token) if token else 'blank'}, not a number"
            )
        return value

    def positive(self, i: int, meaning: str, default: float | None = None) -> float:
        """The same above zero; meaning: "the thickness T"."""
        value = self.real(i, meaning, default)
        if not value > 0:
            raise self.error(f"{meaning} is {value:g}, not positive", "specify a value above 0")
        return value

    def not_negative(self, i: int, meaning: str, default: float | None = None) -> float:
        """The same, zero or above."""
        value = self.real(i, meaning, default)
        if value < 0:
            raise self.error(f"{meaning} is {value:g}, negative", "specify a value of at least 0")
        return value

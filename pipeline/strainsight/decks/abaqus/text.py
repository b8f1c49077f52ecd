"""Abaqus and CalculiX decks as keywords with their parameters and data lines; comments, continuations, included files.

Own, because meshio merges the instances of an assembly, loses materials and ends the process at elements it does not know.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strainsight.decks.text import LARGEST_ID, Entries, Includes, Line, error_at, parse_real, text_lines
from strainsight.errors import DeckError
from strainsight.mesh.model import FloatArray, IntArray

WITH_INPUT = (
    *("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "BOUNDARY", "CLOAD", "DLOAD", "DSLOAD", "ELASTIC"),
    *("DENSITY", "MASS", "SPRING", "MPC"),
)
"""Keywords that are imported and whose data may stand in a file of their own."""

_QUOTED = re.compile(r'"[^"]*"')
_COMMENT = re.compile(r"(^|\s)#(\s.*)?$")
"""A remark at the end of a line, behind a # that stands alone, as decks for CalculiX have it."""
_CORRECT = "correct the line and run again"


@dataclass(frozen=True)
class Keyword:
    """One keyword with its data.

    title as in "*SOLID SECTION"; name the same without asterisk and blanks; parameters in capitals without blanks → value
    ("" where it has none); file and line of the keyword; texts (n,) of the data lines, with their files and numbers.
    """

    title: str
    parameters: dict[str, str]
    file: str
    line: int
    texts: list[str] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)

    @property
    def name(self) -> str:
        """SOLIDSECTION for *SOLID SECTION."""
        return self.title[1:].replace(" ", "")

    @property
    def where(self) -> str:
        """file:line of the keyword."""
        return f"{self.file}:{self.line}"

    def where_data(self, i: int) -> str:
        """file:line of data line i."""
        return f"{self.files[i]}:{self.numbers[i]}"

    def error(self, what: str, remedy: str = _CORRECT) -> DeckError:
        """A DeckError at the keyword."""
        return DeckError(f"{self.title}: {what}", where=self.where, remedy=remedy)

    def needs(self, parameter: str) -> str:
        """The value of a parameter; DeckError where it is missing or empty."""
        value = self.parameters.get(parameter.replace(" ", ""), "")
        if not value:
            raise self.error(f"has no {parameter}", f"give {parameter}=…")
        return value

    def word(self, parameter: str, default: str = "") -> str:
        """The value of a parameter in capitals, `default` where it is missing."""
        return self.parameters.get(parameter, default).upper()

    def number(self, parameter: str, default: float, remedy: str) -> float:
        """The value of a parameter as a finite real, `default` where it is missing or empty; DeckError for no number."""
        text = self.parameters.get(parameter.replace(" ", ""), "")
        value = parse_real(text) if text else default
        if value is None:
            raise self.error(f"{parameter}={text} is no number", remedy)
        return value

    def rows(self, needed: bool = True) -> list[Row]:
        """The data lines; DeckError where there are none though they are needed."""
        if needed and not self.texts:
            raise self.error("no data line follows", "the deck may be cut off here: write it again")
        return [Row(self, i, split(text)) for i, text in enumerate(self.texts)]

    def flat(self) -> tuple[list[str], IntArray]:
        """All entries of all data lines, and how many each line has (trailing commas do not count)."""
        texts = [text.rstrip(", \t") for text in self.texts]
        return ",".join(texts).split(","), np.array([text.count(",") + 1 for text in texts], dtype=np.int64)


class Row(NamedTuple("_Row", [("keyword", Keyword), ("i", int), ("tokens", list[str])]), Entries):
    """A data line: its keyword, its number among the data lines from 0, and its entries."""

    __slots__ = ()

    @property
    def where(self) -> str:
        """file:line."""
        return self.keyword.where_data(self.i)

    def reals(self, count: int, meaning: str) -> FloatArray:
        """The first `count` entries, blank ones zero; DeckError for more than that."""
        if any(self.tokens[count:]):
            raise self.error(f"{len(self.tokens)} entries where {count} belong")
        return np.array([self.real(i, meaning, 0.0) for i in range(count)])

    def error(self, what: str, remedy: str = _CORRECT) -> DeckError:
        """A DeckError at this line."""
        return DeckError(f"{self.keyword.title}: {what}", where=self.where, remedy=remedy)


def split(text: str) -> list[str]:
    """Entries between commas, without blanks around them and without quotation marks (which protect commas)."""
    return [entry.strip('"') for entry in split_quoted(text)]


def integers(tokens: list[str]) -> IntArray | None:
    """All tokens as integers, or None where one is none."""
    try:
        values = np.array(list(map(int, tokens)), dtype=np.int64)
    except (ValueError, OverflowError):
        return None
    return None if np.abs(values).max() >= LARGEST_ID or any("_" in token for token in tokens) else values


def read_keywords(path: Path, include: Sequence[Path] = ()) -> tuple[list[Keyword], tuple[str, ...], int, list[str]]:
    """The keywords of a deck and of the files it includes, in their order; the names of these files; how many lines stand before
    the first keyword, which CalculiX passes over; notes on these files.

    A keyword line that ends in a comma goes on in the next one, where parameters stand there; otherwise the comma says nothing,
    as in CalculiX. *INCLUDE and INPUT= may leave the folder of the deck for those of `include` only.
    Raises DeckError for files that are missing, empty or binary, for one without a keyword, and for numbers before the first.
    """
    includes = Includes.of(path, include)
    keywords: list[Keyword] = []
    files: dict[str, None] = {}
    before: list[Line] = []
    for line in _lines(path, includes, ()):
        files.setdefault(line.file)
        if line.text[0] != "*":
            if keywords:
                _append(keywords[-1], line)
                continue
            before.append(line)
            if line.text[0] in "0123456789+-.":  # the head of the file is missing
                raise _no_keyword(line)
            continue
        keyword = _keyword(line)
        keywords.append(keyword)
        if "INPUT" in keyword.parameters and keyword.name in WITH_INPUT:
            above = (path.resolve(), Path(line.file).resolve())
            target = includes.file(keyword.needs("INPUT"), "INPUT", line, above)
            for own in _lines(target, includes, (*above, target.resolve())):
                files.setdefault(own.file)
                if own.text[0] == "*":
                    raise own.error(
                        f"{own.text[:24]!r} in a file that should hold the data of {keyword.title}",
                        "take the file in with *INCLUDE, or remove the keyword",
                    )
                _append(keyword, own)
    if not keywords and before:
        raise _no_keyword(before[0])
    if not keywords:
        raise error_at(path, "the deck holds no keyword", "check that this is the right file")
    return keywords, tuple(name for name in files if name != str(path)), len(before), includes.notes


def _no_keyword(line: Line) -> DeckError:
    return line.error(
        f"{line.text[:24]!r} stands before the first keyword",
        "an Abaqus or CalculiX deck begins with a line such as *HEADING or *NODE; a Nastran deck of this name is read "
        "with mesh.format: nastran",
    )


def _append(keyword: Keyword, line: Line) -> None:
    keyword.texts.append(line.text)
    keyword.files.append(line.file)
    keyword.numbers.append(line.number)


def _lines(path: Path, includes: Includes, parents: tuple[Path, ...]) -> Iterator[Line]:
    """Keyword lines, joined with their continuations, and data lines; neither comments nor blank lines."""
    file = str(path)
    pending: Line | None = None
    for number, raw in enumerate(text_lines(path), start=1):
        text = _COMMENT.sub("", raw).strip()
        if not text or text == "*" or text.startswith("**"):
            continue
        line = Line(text, file, number)
        if pending is not None:
            if text[0] == "*" or not _parameters(text):
                yield from _taken_in(pending, path, includes, parents)
            else:
                line = Line(f"{pending.text} {text}", file, pending.number)
            pending = None
        if line.text[0] != "*":
            yield line
        elif line.text[-1] == ",":
            pending = line
        else:
            yield from _taken_in(line, path, includes, parents)
    if pending is not None:
        yield from _taken_in(pending, path, includes, parents)


def _parameters(text: str) -> bool:
    """Whether a line holds parameters and no data: all its entries begin with a letter."""
    return all(part[:1].isalpha() for part in split_quoted(text.rstrip(", \t")))


def _taken_in(line: Line, path: Path, includes: Includes, parents: tuple[Path, ...]) -> Iterator[Line]:
    """The line itself, or, for *INCLUDE, the lines of the file."""
    if not line.text[1:].lstrip().upper().startswith("INCLUDE"):
        yield line
        return
    above = (*parents, path.resolve())
    target = includes.file(_keyword(line).needs("INPUT"), "*INCLUDE", line, above)
    yield from _lines(target, includes, above)


def _keyword(line: Line) -> Keyword:
    head, *entries = split_quoted(line.text.rstrip(", \t"))
    title = "*" + " ".join(head[1:].upper().split())
    if not title[1:2].isalpha():
        raise line.error(f"{line.text[:24]!r} is no keyword", "a comment begins with **")
    keyword = Keyword(title, {}, line.file, line.number)
    for part in entries:
        key, _, value = part.partition("=")
        key = "".join(key.upper().split())
        if not key:
            continue
        if not key[0].isalpha():
            raise keyword.error(f"{part!r} is no parameter", "a parameter is a name, or NAME=value")
        keyword.parameters[key] = value.strip().strip('"')
    return keyword


def split_quoted(text: str) -> list[str]:
    """Entries between commas that no quotation marks protect; the marks stay."""
    if '"' not in text:
        return [entry.strip() for entry in text.split(",")]
    masked = _QUOTED.sub(lambda match: match[0].replace(",", "\0"), text)
    return [entry.strip().replace("\0", ",") for entry in masked.split(",")]

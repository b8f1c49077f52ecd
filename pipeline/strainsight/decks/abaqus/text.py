"""Abaqus and CalculiX decks as keywords with parameters and data lines, with included files, by part, instance and step.

meshio is not used: it merges the instances of an assembly, loses materials and fails at unknown element types."""

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
"""Imported keywords whose data may be in a separate file."""

_QUOTED = re.compile(r'"[^"]*"')
_COMMENT = re.compile(r"(^|\s)#(\s.*)?$")
"""A comment at the end of a line after a separate #, as in CalculiX decks."""
_CORRECT = "correct the line"


@dataclass(frozen=True)
class Keyword:
    """One keyword with its data.

    title as in "*SOLID SECTION"; name without asterisk and blanks; parameters in capitals without blanks → value (""
    if it has no value); file and line of the keyword; texts (n,) of the data lines, with their files and numbers."""

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
        """Value of a parameter; DeckError if it is missing or empty."""
        if not (value := self.parameters.get(parameter.replace(" ", ""), "")):
            raise self.error(f"{parameter} is missing", f"add {parameter}=…")
        return value

    def word(self, parameter: str, default: str = "") -> str:
        """Value of a parameter in capitals; `default` if it is missing."""
        return self.parameters.get(parameter, default).upper()

    def number(self, parameter: str, default: float, remedy: str) -> float:
        """Value of a parameter as a finite real; `default` if it is missing or empty, DeckError if it is not a number."""
        text = self.parameters.get(parameter.replace(" ", ""), "")
        value = parse_real(text) if text else default
        if value is None:
            raise self.error(f"{parameter}={text} is not a number", remedy)
        return value

    def rows(self, needed: bool = True) -> list[Row]:
        """The data lines; DeckError if they are required and missing."""
        if needed and not self.texts:
            raise self.error("the data lines are missing", "add the data lines; the deck may be truncated here")
        return [Row(self, i, split(text)) for i, text in enumerate(self.texts)]

    def flat(self) -> tuple[list[str], IntArray]:
        """All entries of all data lines, and the number of entries of each line (trailing commas are ignored)."""
        texts = [text.rstrip(", \t") for text in self.texts]
        return ",".join(texts).split(","), np.array([text.count(",") + 1 for text in texts], dtype=np.int64)


class Row(NamedTuple("_Row", [("keyword", Keyword), ("i", int), ("tokens", list[str])]), Entries):
    """A data line: its keyword, its position among the data lines from 0, and its entries."""

    __slots__ = ()

    @property
    def where(self) -> str:
        """file:line."""
        return self.keyword.where_data(self.i)

    def reals(self, count: int, meaning: str) -> FloatArray:
        """The first `count` entries, zero if blank; DeckError if there are more."""
        if any(self.tokens[count:]):
            raise self.error(
                f"the line has {len(self.tokens)} entries, but at most {count} are allowed",
                f"remove all entries after entry {count}",
            )
        return np.array([self.real(i, meaning, 0.0) for i in range(count)])

    def error(self, what: str, remedy: str = _CORRECT) -> DeckError:
        """A DeckError at this line."""
        return DeckError(f"{self.keyword.title}: {what}", where=self.where, remedy=remedy)


def split(text: str) -> list[str]:
    """Entries between commas, without surrounding blanks and quotation marks (which protect commas)."""
    return [entry.strip('"') for entry in split_quoted(text)]


def integers(tokens: list[str]) -> IntArray | None:
    """All tokens as integers, or None if one is not an integer."""
    try:
        values = np.array(list(map(int, tokens)), dtype=np.int64)
    except (ValueError, OverflowError):
        return None
    return None if np.abs(values).max() >= LARGEST_ID or any("_" in token for token in tokens) else values


def read_keywords(path: Path, include: Sequence[Path] = ()) -> tuple[list[Keyword], tuple[str, ...], int, list[str]]:
    """Keywords of a deck and its included files, in order; names of the included files; number of lines before the
    first keyword, which CalculiX ignores; notes on the files.

    A keyword line that ends in a comma continues if the next line contains parameters; otherwise the comma is ignored, as in
    CalculiX. *INCLUDE and INPUT= may leave the folder of the deck only for the folders in `include`. Raises DeckError for files
    that are missing, empty, binary or without a keyword, and for numbers before the first keyword."""
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
            if line.text[0] in "0123456789+-.":  # the beginning of the file is missing
                raise _no_keyword(line)
            continue
        keyword = _keyword(line)
        keywords.append(keyword)
        if "INPUT" in keyword.parameters and keyword.name in WITH_INPUT:
            above = (path.resolve(), Path(line.file).resolve())
            target = includes.file(keyword.needs("INPUT"), "INPUT", line, above)
            for data_line in _lines(target, includes, (*above, target.resolve())):
                files.setdefault(data_line.file)
                if data_line.text[0] == "*":
                    raise data_line.error(
                        f"found {data_line.text[:24]!r} in a file that must contain only data lines of {keyword.title}",
                        "use *INCLUDE for this file, or remove the keyword from it",
                    )
                _append(keyword, data_line)
    if not keywords and before:
        raise _no_keyword(before[0])
    if not keywords:
        raise error_at(path, "the deck contains no keyword", "check that the file is the input deck")
    return keywords, tuple(name for name in files if name != str(path)), len(before), includes.notes


def _no_keyword(line: Line) -> DeckError:
    return line.error(
        f"found {line.text[:24]!r} before the first keyword",
        "start the deck with a keyword such as *HEADING or *NODE; for a Nastran deck set mesh.format: nastran",
    )


def _append(keyword: Keyword, line: Line) -> None:
    keyword.texts.append(line.text)
    keyword.files.append(line.file)
    keyword.numbers.append(line.number)


def _lines(path: Path, includes: Includes, parents: tuple[Path, ...]) -> Iterator[Line]:
    """Keyword lines, joined with their continuations, and data lines, without comments and blank lines."""
    file = str(path)
    pending: Line | None = None
    for number, raw in enumerate(text_lines(path), start=1):
        text = _COMMENT.sub("", raw).strip()
        if not text or text == "*" or text.startswith("**"):
            continue
        line = Line(text, file, number)
        if pending is not None:
            if text[0] == "*" or not _parameters(text):
                yield from _expand_include(pending, path, includes, parents)
            else:
                line = Line(f"{pending.text} {text}", file, pending.number)
            pending = None
        if line.text[0] != "*":
            yield line
        elif line.text[-1] == ",":
            pending = line
        else:
            yield from _expand_include(line, path, includes, parents)
    if pending is not None:
        yield from _expand_include(pending, path, includes, parents)


def _parameters(text: str) -> bool:
    """Whether a line contains only parameters: all its entries begin with a letter."""
    return all(part[:1].isalpha() for part in split_quoted(text.rstrip(", \t")))


def _expand_include(line: Line, path: Path, includes: Includes, parents: tuple[Path, ...]) -> Iterator[Line]:
    """The line itself or, for *INCLUDE, the lines of the included file."""
    if not line.text[1:].lstrip().upper().startswith("INCLUDE"):
        yield line
        return
    above = (*parents, path.resolve())
    yield from _lines(includes.file(_keyword(line).needs("INPUT"), "*INCLUDE", line, above), includes, above)


def _keyword(line: Line) -> Keyword:
    head, *entries = split_quoted(line.text.rstrip(", \t"))
    title = "*" + " ".join(head[1:].upper().split())
    if not title[1:2].isalpha():
        raise line.error(f"{line.text[:24]!r} is not a keyword", "correct the keyword; a comment line begins with **")
    keyword = Keyword(title, {}, line.file, line.number)
    for part in entries:
        key, _, value = part.partition("=")
        key = "".join(key.upper().split())
        if not key:
            continue
        if not key[0].isalpha():
            raise keyword.error(f"{part!r} is not a parameter", "write parameters as NAME or NAME=value")
        keyword.parameters[key] = value.strip().strip('"')
    return keyword


def split_quoted(text: str) -> list[str]:
    """Entries between commas outside quotation marks; the marks are kept."""
    if '"' not in text:
        return [entry.strip() for entry in text.split(",")]
    masked = _QUOTED.sub(lambda match: match[0].replace(",", "\0"), text)
    return [entry.strip().replace("\0", ",") for entry in masked.split(",")]


MESH = ("NODE", "ELEMENT")
SECTIONS = ("SOLIDSECTION", "SHELLSECTION", "SHELLGENERALSECTION", "BEAMSECTION", "BEAMGENERALSECTION")


INSIDE = {"PART": (), "ASSEMBLY": (), "INSTANCE": ("ASSEMBLY",), "STEP": ()}
"""Keyword that an *END closes → keywords that must enclose it."""


@dataclass(frozen=True)
class Step:
    """A *STEP and its keywords; number from 1."""

    number: int
    keyword: Keyword
    keywords: tuple[Keyword, ...]


def read_structure(
    keywords: list[Keyword],
) -> tuple[tuple[Keyword, ...], dict[str, tuple[Keyword, ...]], list[tuple[Keyword, tuple[Keyword, ...]]], list[Step]]:
    """Keywords of the model, of each part, of each instance with its *INSTANCE, and the steps."""
    model: list[Keyword] = []
    closed: dict[str, list[tuple[Keyword, tuple[Keyword, ...]]]] = {name: [] for name in INSIDE}
    named: set[tuple[str, str]] = set()
    opened: list[tuple[Keyword, list[Keyword]]] = []
    for keyword in keywords:
        name = keyword.name
        around = opened[-1][0] if opened else None
        if name in INSIDE:
            if tuple(k.name for k, _ in opened) != INSIDE[name]:
                raise keyword.error(
                    f"this keyword is not allowed inside {around.title} at {around.where}"
                    if around
                    else "this keyword is only allowed inside *ASSEMBLY",
                    f"write *END {around.name} before this line"
                    if around
                    else "move the lines between *ASSEMBLY and *END ASSEMBLY",
                )
            opened.append((keyword, []))
        elif name.startswith("END") and name[3:] in INSIDE:
            if around is None or around.name != name[3:]:
                raise keyword.error(f"*{name[3:]} is missing before this line", f"add *{name[3:]}, or remove this line")
            closed[around.name].append((around, tuple(opened.pop()[1])))
            if around.name in ("PART", "INSTANCE"):
                key = (around.name, around.needs("NAME").upper())
                if key in named:
                    what = f"{around.name.lower()} {around.parameters['NAME']!r} is defined twice"
                    raise around.error(what, f"use a unique name for every {around.name.lower()}")
                named.add(key)
        elif around is None or around.name == "ASSEMBLY":
            model.append(keyword)
        else:
            if around.name == "STEP" and name in (*MESH, *SECTIONS, "MATERIAL"):
                raise keyword.error(
                    "this keyword is not allowed inside a *STEP", "move the keyword before the first *STEP"
                )
            # Sets of a step are sets of the model.
            of_model = name in ("NSET", "ELSET", "SURFACE") and around.name == "STEP"
            (model if of_model else opened[-1][1]).append(keyword)
    if opened:
        start = opened[-1][0]
        raise start.error(
            f"*END {start.name} is missing",
            f"add the line *END {start.name}; if the deck is truncated, export it again",
        )
    if closed["PART"] and not closed["INSTANCE"]:
        raise closed["PART"][0][0].error(
            "the deck has parts, but no *INSTANCE", "add an *ASSEMBLY with an *INSTANCE of each part"
        )
    parts = {start.needs("NAME").upper(): part_keywords for start, part_keywords in closed["PART"]}
    steps = [
        Step(number, start, step_keywords) for number, (start, step_keywords) in enumerate(closed["STEP"], start=1)
    ]
    return tuple(model), parts, closed["INSTANCE"], steps

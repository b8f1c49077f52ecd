"""Nastran text as cards: sections, includes, comments, continuations and the three field formats, with file and line.

Own, because pyyeti's `rdcards` ends a card at a comment between its lines, drops the rest of a large-field card in free
format, reads past ENDDATA and knows no line numbers. pyyeti is the oracle of the tests.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strainsight.decks.faults import repeated
from strainsight.decks.nastran.replication import HEAD, repeated_fields, times
from strainsight.decks.numbers import entry, integer_entry, real_entry
from strainsight.decks.text import Line, allowed, included_file, text_lines
from strainsight.errors import DeckError
from strainsight.mesh.model import IntArray, Origin

_BEGIN = re.compile(r"\s*BEGIN\b", re.IGNORECASE)
_BEGIN_BULK = re.compile(r"\s*BEGIN\s*(BULK)?\s*$|\s*BEGIN\s+BULK\s*=\s*0*\s*$", re.IGNORECASE)
_ENDDATA = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
_INCLUDE = re.compile(r"\s*INCLUDE\s+(.*)$", re.IGNORECASE)
_CEND = re.compile(r"\s*CEND\b", re.IGNORECASE)
_CASE_CONTROL = re.compile(r"\s*(SOL\s+\w+\s*$|CEND\b|SUBCASE\b)", re.IGNORECASE)
_LONGEST_NAME = 8
"""Lines over which the name of an included file may go."""


class Card(NamedTuple):
    """One bulk-data entry: NAME (upper case, no asterisk), data fields (stripped), where its first line stands."""

    name: str
    fields: list[str]
    file: str
    line: int

    @property
    def where(self) -> str:
        """file:line."""
        return f"{self.file}:{self.line}"

    def text(self, i: int) -> str:
        """Data field i from 0; "" where the card is shorter."""
        return entry(self.fields, i)

    def integer(self, i: int, meaning: str, default: int | None = None) -> int:
        """Field i as an integer; a blank one is `default`, or a DeckError."""
        return integer_entry(self.fields, i, default, lambda what: self.error(f"{meaning} (field {i + 2}) {what}"))

    def real(self, i: int, meaning: str, default: float | None = None) -> float:
        """Field i as a finite real, also in Nastran's short form 1.7-4; a blank one is `default`, or a DeckError."""
        return real_entry(self.fields, i, default, lambda what: self.error(f"{meaning} (field {i + 2}) {what}"))

    def error(self, what: str, remedy: str = "correct the card and run again") -> DeckError:
        """A DeckError at this card."""
        return DeckError(f"{self.name} {self.text(0)}: {what}", where=self.where, remedy=remedy)


@dataclass(frozen=True)
class Deck:
    """cards by name in file order, the case-control lines, how many lines stand after ENDDATA, the files that are included,
    whether there is a BEGIN BULK, whether ENDDATA shows that the deck is whole, and its last line."""

    cards: dict[str, list[Card]]
    case_control: tuple[Line, ...]
    after_end: int
    included: tuple[str, ...]
    begun: bool
    ended: bool
    last: Line


def unique_ids(cards: Sequence[Card], what: str) -> IntArray:
    """First fields (n,) of the cards as ids; DeckError where one is not positive or stands twice."""
    ids = np.array([card.integer(0, f"the {what} id") for card in cards], dtype=np.int64)
    if ids.size and ids.min() < 1:
        raise cards[int(np.argmin(ids))].error(f"the {what} id must be positive")
    if twice := repeated(ids):
        first, second = (cards[i] for i in twice)
        raise DeckError(
            f"{what} id {second.fields[0]} stands twice (first at {first.where})",
            where=second.where,
            remedy=f"give every {what} its own id",
        )
    return ids


def origin(ids: IntArray, cards: Sequence[Card]) -> Origin:
    """Where the entities with these ids (n,) stand, one a card."""
    files = {file: i for i, file in enumerate(dict.fromkeys(card.file for card in cards))}
    line = np.array([card.line for card in cards], dtype=np.int64)
    return Origin(ids, line, np.array([files[card.file] for card in cards], dtype=np.int64), tuple(files))


def together(first: Origin, second: Origin) -> Origin:
    """Where the entities of both stand."""
    if not second.ids.size:
        return first
    return Origin(
        np.concatenate([first.ids, second.ids]),
        np.concatenate([first.line, second.line]),
        np.concatenate([first.file, second.file + len(first.files)]),
        (*first.files, *second.files),
    )


def read_deck(path: Path, include: Sequence[Path] = ()) -> Deck:
    """All cards of a deck and of what it includes.

    Without BEGIN BULK the whole file is bulk data. An INCLUDE may leave the folder of the deck for those of `include` only; one
    before CEND is passed over, as there is no model in it. ENDDATA may be missing: `Deck.ended`.
    Raises DeckError for a file that is missing, empty or binary, and for lines that are no card.
    """
    path = Path(path)
    everything = list(_lines(path, allowed(path, include), (), Counter()))
    included = tuple(dict.fromkeys(line.file for line in everything if line.file != str(path)))
    lines = [line for line in everything if line.text.strip()]
    begins = [i for i, line in enumerate(lines) if _BEGIN.match(line.text)]
    if len(begins) > 1 or (begins and not _BEGIN_BULK.match(lines[begins[0]].text)):
        line = lines[begins[-1]]
        raise DeckError(
            f"{line.text.strip()!r}: superelements are not supported",
            where=line.where,
            remedy="give the deck of one structure with one BEGIN BULK",
        )
    start = begins[0] + 1 if begins else 0
    if not begins:
        for line in lines:
            if _CASE_CONTROL.match(line.text):
                raise DeckError(
                    f"{line.text.strip()!r} without BEGIN BULK", where=line.where, remedy="add the line BEGIN BULK"
                )
    end = next((i for i in range(start, len(lines)) if _ENDDATA.match(lines[i].text)), len(lines))
    ended = end < len(lines)
    cards: dict[str, list[Card]] = {}
    for card in _cards(lines[start:end]):
        cards.setdefault(card.name, []).append(card)
    if not cards:
        raise DeckError("the deck holds no bulk data", where=str(path), remedy="check that this is the right file")
    case_control = tuple(lines[: begins[0]]) if begins else ()
    return Deck(cards, case_control, max(len(lines) - end - 1, 0), included, bool(begins), ended, lines[-1])


def _lines(
    path: Path, folders: tuple[Path, ...], parents: tuple[Path, ...], taken: Counter[Path]
) -> Generator[Line, None, bool]:
    """Lines of a file and, up to ENDDATA, of those it includes; returns whether ENDDATA was among them."""
    ended = False
    lines = text_lines(path)
    control = next(
        (i for i, line in enumerate(lines) if _CEND.match(line)), 0
    )  # lines of executive control: no model is in them
    passed = 0
    for number, raw in enumerate(lines, start=1):
        if number <= passed:  # the rest of a name
            continue
        if not ended and "INCLUDE" in raw[:40].upper() and (match := _INCLUDE.match(raw)):
            above = (*parents, path.resolve())
            name, more = _file_name(match[1], lines[number : number + _LONGEST_NAME], f"{path}:{number}")
            passed = number + more
            if number <= control:
                continue
            target = included_file(name, "INCLUDE", path, number, folders, above, taken)
            ended = yield from _lines(target, folders, above, taken)
            continue
        ended = ended or _ENDDATA.match(raw) is not None
        yield Line(raw.partition("$")[0].expandtabs().rstrip(), str(path), number)
    return ended


def _file_name(argument: str, following: Sequence[str], where: str) -> tuple[str, int]:
    """The name behind INCLUDE, and over how many of the following lines it goes on, up to its quotation mark."""
    whole = argument.strip()
    for more, line in enumerate(["", *following]):
        whole += line.strip()
        if quoted := re.match(r"""(['"])(.*?)\1|([^'"\s$]+)\s*(?:\$.*)?$""", whole):
            return (quoted[2] if quoted[1] else quoted[3]), more
        if whole[:1] not in ("'", '"'):
            break
    raise DeckError(
        f"INCLUDE {argument.strip()}: no complete file name", where=where, remedy="write INCLUDE 'file' on one line"
    )


def _cards(lines: list[Line]) -> Iterator[Card]:
    name, fields, first, mark, large = "", [], None, "", 0
    made = 0
    pattern: list[str] | None = None  # of the card before, where that repeats one itself
    for line in lines:
        head, data, next_mark, is_large = _cut(line)
        if not head or head[0] in "+*":
            if first is None:
                raise DeckError(
                    "a continuation with no card before it", where=line.where, remedy="correct the order of the lines"
                )
            if not _goes_on(mark, head):
                raise DeckError(
                    f"continuation {head!r} follows a line that ends in {mark!r}",
                    where=line.where,
                    remedy="sort the continuation lines after their cards",
                )
            if large % 2 and not is_large:
                fields += [""] * 4
            fields += data
            large = large + 1 if is_large else 0
        elif head[0] == "=":
            if first is None or len(fields) != 8 or (pattern is None and head != "="):
                raise DeckError(
                    f"{line.text.strip()[:24]!r} repeats no card that stands on one line before it",
                    where=line.where,
                    remedy="write repeated cards out",
                )
            pattern = data if head == "=" else pattern
            count = times(head, made, line)
            made += count
            for _ in range(count):
                yield Card(name, fields, first.file, first.number)
                fields, first = repeated_fields(fields, pattern or [], line), line
        else:
            pattern = None
            if first is not None:
                yield Card(name, fields, first.file, first.number)
            name, fields, first, large = head, data, line, int(is_large)
        mark = next_mark
    if first is not None:
        yield Card(name, fields, first.file, first.number)


def _goes_on(mark: str, head: str) -> bool:
    """Whether a line with this head follows one with this mark: a blank one fits all, and column 1 does not count."""
    own, other = head.lstrip("+*"), mark.lstrip("+*")
    return not own or not other or own == other or head[1:] == mark[1:]


def _cut(line: Line) -> tuple[str, list[str], str, bool]:
    """Name or continuation mark, data fields (8, or 4 in large format), mark of the next line, is the format large."""
    text = line.text
    if "," in text:
        tokens = [token.strip() for token in text.split(",")]
        if not text[:8].strip():  # a continuation whose first field is blank
            tokens = ["", *tokens]
        head = tokens[0].upper()
        large = "*" in head
        width = 5 if large else 9
        last = tokens[width] if len(tokens) > width else ""
        if any(tokens[width + 1 :]) or (last and last[0] not in "+*"):
            raise DeckError(
                f"{head}: more than {width - 1} data fields on one line",
                where=line.where,
                remedy="continue on a next line that begins with a comma",
            )
        data, mark = tokens[1:width], last.upper()
        data += [""] * (width - 1 - len(data))
    else:
        head = text[:8].strip().upper()
        large = "*" in head
        data = (
            [text[j : j + 16].strip() for j in (8, 24, 40, 56)]
            if large
            else [text[j : j + 8].strip() for j in range(8, 72, 8)]
        )
        mark = text[72:80].strip().upper()
        if head and text[0] == " " and head[0] not in "+*":
            raise DeckError(
                f"{head!r} does not begin in column 1",
                where=line.where,
                remedy="a card begins in column 1, a continuation with eight blanks, + or *",
            )
    if head and head[0] not in "+*":
        head = head.rstrip("*").rstrip()
        if not head[:1].isalpha() and not HEAD.fullmatch(head):
            raise DeckError(
                f"{text.strip()[:24]!r} is no bulk-data card", where=line.where, remedy="a card begins with its name"
            )
    return head, data, mark, large

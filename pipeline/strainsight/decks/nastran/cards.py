"""Nastran text as cards: sections, includes, comments, continuations and the three field formats, with file and line.

pyyeti's `rdcards` is used only in tests. It ends a card at a comment between its lines and drops the rest of a
large-field card in free format. It reads past ENDDATA and does not report line numbers."""

from __future__ import annotations

import re
from collections.abc import Collection, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strainsight.decks.faults import check_once
from strainsight.decks.text import Entries, Includes, Line, entry, error_at, parse_integer, parse_real, text_lines
from strainsight.errors import DeckError
from strainsight.mesh.model import IntArray, Origin

HEAD = re.compile(r"=(?:\((\d{1,9})\)|(\d{1,9}))?")
"""First field of a replication card."""
MOST = 1_000_000
"""Largest number of replicated cards; ten lines could otherwise fill the memory."""
_STEP = re.compile(r"\*(?:\((.+)\)|(.+))")


def repeat_count(head: str, card_count: int, line: Line) -> int:
    """Number of repetitions of =(n) or =n; 1 for =. Raises DeckError if there are more than MOST, including `card_count`."""
    match = HEAD.fullmatch(head)
    count = int(match[1] or match[2] or 1) if match else 1
    if card_count + count > MOST:
        raise line.error(
            f"{head} increases the number of replicated cards to {card_count + count}",
            f"reduce the number of replicated cards to at most {MOST}",
        )
    return count


def expand_fields(fields: Sequence[str], pattern: Sequence[str], line: Line) -> list[str]:
    """The eight fields of the next card: = copies a field of the previous card, *x adds x to it, a blank x repeats, == copies
    the rest. Raises DeckError if *x refers to a field that is not a number, or x is not a number."""
    result: list[str] = []
    for i in range(8):
        token, before = entry(pattern, i), entry(fields, i)
        if token == "==":
            return [*result, *(entry(fields, j) for j in range(i, 8))]
        if token == "=":
            result.append(before)
        elif step := _STEP.fullmatch(token):
            result.append(_sum(before, step[1] or step[2], f"{token} in field {i + 2}", line))
        else:
            result.append(token)
    return result


def _sum(before: str, step: str, entry: str, line: Line) -> str:
    before = before or "0"
    whole, more = parse_integer(before), parse_integer(step)
    if whole is not None and more is not None:
        return str(whole + more)
    x, h = parse_real(before), parse_real(step)
    if x is None or h is None:
        raise line.error(
            f"the increment {step!r} of {entry} cannot be added to {before!r}: both must be numbers",
            "write this card in full, without = and *",
        )
    return repr(x + h)


_BEGIN = re.compile(r"\s*BEGIN\b", re.IGNORECASE)
_BEGIN_BULK = re.compile(r"\s*BEGIN\s*(BULK)?\s*$|\s*BEGIN\s+BULK\s*=\s*0*\s*$", re.IGNORECASE)
_ENDDATA = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
_INCLUDE = re.compile(r"""\s*INCLUDE(?:\s*=\s*|\s+|(?=['"]))(.*)$""", re.IGNORECASE)
_CEND = re.compile(r"\s*CEND\b", re.IGNORECASE)
_CASE_CONTROL = re.compile(r"\s*(SOL\s+\w+\s*$|CEND\b|SUBCASE\b)", re.IGNORECASE)
_LONGEST_NAME = 8
"""Largest number of lines of an include file name."""


class Card(NamedTuple("_Card", [("name", str), ("tokens", list[str]), ("file", str), ("line", int)]), Entries):
    """One bulk-data entry: NAME (upper case, no asterisk), tokens of the data fields (stripped), file and line of its start."""

    __slots__ = ()
    WORD, FIRST = "field", 2

    @property
    def where(self) -> str:
        """file:line."""
        return f"{self.file}:{self.line}"

    def is_blank(self, i: int) -> bool:
        """Whether a field is blank, or 0, which means the same for an id."""
        return self.text(i) in ("", "0")

    def error(self, what: str, remedy: str = "correct the card") -> DeckError:
        """A DeckError at this card."""
        return DeckError(f"{self.name} {self.text(0)}: {what}", where=self.where, remedy=remedy)


class Cards(dict[str, list[Card]]):
    """Cards by name, in file order."""

    def of(self, *names: str) -> list[Card]:
        """The cards of these names, name by name."""
        return [card for name in names for card in self.get(name, [])]


@dataclass(frozen=True)
class Deck:
    """cards by name in file order, case-control lines, number of lines after ENDDATA, included files and notes on
    them, whether there is a BEGIN BULK, whether there is an ENDDATA, and the last line."""

    cards: Cards
    case_control: tuple[Line, ...]
    after_end: int
    included: tuple[str, ...]
    notes: tuple[str, ...]
    begun: bool
    ended: bool
    last: Line


def unique_ids(cards: Sequence[Card], what: str) -> IntArray:
    """First fields (n,) of the cards as ids; DeckError if one is not positive or not unique."""
    ids = np.array([card.integer(0, f"the {what} id") for card in cards], dtype=np.int64)
    if ids.size and ids.min() < 1:
        raise cards[int(np.argmin(ids))].error(f"the {what} id is {ids.min()}, not positive", "use ids of at least 1")
    check_once(ids, what, lambda i: cards[i].where)
    return ids


class Elements(NamedTuple):
    """Elements (n,): cards, ids and regions."""

    cards: Sequence[Card]
    ids: IntArray
    region: IntArray

    def of(self, names: Collection[str]) -> Elements:
        """The elements on cards of these names."""
        rows = np.flatnonzero([card.name in names for card in self.cards])
        return Elements([self.cards[i] for i in rows.tolist()], self.ids[rows], self.region[rows])


def origin(ids: IntArray, cards: Sequence[Card]) -> Origin:
    """File and line of the entities with these ids (n,), one a card."""
    return Origin.at(ids, [(card.file, card.line) for card in cards])


def read_deck(path: Path, include: Sequence[Path] = ()) -> Deck:
    """All cards of a deck and its included files.

    Without BEGIN BULK the whole file is bulk data. An INCLUDE may leave the folder of the deck only for the folders
    in `include`; an INCLUDE before CEND is skipped, because it contains no model. ENDDATA may be missing:
    `Deck.ended`. Raises DeckError for a file that is missing, empty or binary, and for lines that are not cards."""
    path = Path(path)
    includes = Includes.of(path, include)
    everything = list(_lines(path, includes, ()))
    included = tuple(dict.fromkeys(line.file for line in everything if line.file != str(path)))
    lines = [line for line in everything if line.text.strip()]
    begins = [i for i, line in enumerate(lines) if _BEGIN.match(line.text)]
    if len(begins) > 1 or (begins and not _BEGIN_BULK.match(lines[begins[0]].text)):
        line = lines[begins[-1]]
        raise line.error(
            f"{line.text.strip()!r}: superelements are not supported",
            "export the deck of one structure with one BEGIN BULK",
        )
    start = begins[0] + 1 if begins else 0
    if not begins:
        for line in lines:
            if _CASE_CONTROL.match(line.text):
                raise line.error(f"found {line.text.strip()!r}, but BEGIN BULK is missing", "add the line BEGIN BULK")
    end = next((i for i in range(start, len(lines)) if _ENDDATA.match(lines[i].text)), len(lines))
    ended = end < len(lines)
    cards = Cards()
    for card in _cards(lines[start:end]):
        cards.setdefault(card.name, []).append(card)
    if not cards:
        raise error_at(path, "the deck contains no bulk data", "check that the file is the input deck")
    case_control = tuple(lines[: begins[0]]) if begins else ()
    after = max(len(lines) - end - 1, 0)
    return Deck(cards, case_control, after, included, tuple(includes.notes), bool(begins), ended, lines[-1])


def _lines(path: Path, includes: Includes, parents: tuple[Path, ...]) -> Generator[Line, None, bool]:
    """Lines of a file and, up to ENDDATA, of its included files; returns whether ENDDATA was found.
    A name without a folder is relative to the including file, other names to the folder of the deck, as in MSC and
    NX Nastran; in OptiStruct decks (.fem) all names are relative to the including file."""
    ended = False
    lines = text_lines(path)
    control = next((i for i, line in enumerate(lines) if _CEND.match(line)), 0)  # executive control contains no model
    passed = 0
    for number, raw in enumerate(lines, start=1):
        if number <= passed:  # continuation of a file name
            continue
        if not ended and "INCLUDE" in raw[:40].upper() and (match := _INCLUDE.match(raw)):
            above = (*parents, path.resolve())
            name, more = _file_name(match[1], lines[number : number + _LONGEST_NAME], f"{path}:{number}")
            passed = number + more
            if number <= control:
                continue
            nearest = not re.search(r"[/\\]", name) or ".fem" in (suffix.lower() for suffix in above[0].suffixes)
            target = includes.file(name, "INCLUDE", Line(raw, str(path), number), above, nearest)
            ended = yield from _lines(target, includes, above)
            continue
        ended = ended or _ENDDATA.match(raw) is not None
        yield Line(raw.partition("$")[0].expandtabs().rstrip(), str(path), number)
    return ended


def _file_name(argument: str, following: Sequence[str], where: str) -> tuple[str, int]:
    """The file name after INCLUDE, and the number of following lines that it uses, up to its closing quotation mark."""
    whole = argument.strip()
    for more, line in enumerate(["", *following]):
        whole += line.strip()
        if quoted := re.match(r"""(['"])(.*?)\1|([^'"\s$]+)\s*(?:\$.*)?$""", whole):
            return (quoted[2] if quoted[1] else quoted[3]), more
        if whole[:1] not in ("'", '"'):
            break
    raise error_at(where, f"INCLUDE {argument.strip()}: incomplete file name", "write INCLUDE 'file' on one line")


class _Piece(NamedTuple):
    """A line of a card: its name or continuation mark; data fields; mark of its continuation; number of large-format
    lines, 0 in another format."""

    line: Line
    head: str
    data: list[str]
    mark: str
    large: int

    @property
    def continues(self) -> bool:
        return not self.head or self.head[0] in "+*"


def _cards(lines: list[Line]) -> Iterator[Card]:
    pieces = [_split_fields(line) for line in _join_lines(lines)]
    follower = _continuations(pieces)
    pattern: list[str] | None = None  # of the previous card, if it is a replication
    name, card_count = "", 0
    fields: list[str] = []
    for i, piece in enumerate(pieces):
        if piece.continues:
            continue
        line = piece.line
        if piece.head[0] == "=":
            if not name or len(fields) != 8 or (pattern is None and piece.head != "="):
                raise line.error(
                    f"{line.text.strip()[:24]!r} repeats the card before it, which must have exactly one line",
                    "write all repeated cards in full",
                )
            pattern = piece.data if piece.head == "=" else pattern
            count = repeat_count(piece.head, card_count, line)
            card_count += count
            for _ in range(count):
                fields = expand_fields(fields, pattern or [], line)
                yield Card(name, fields, line.file, line.number)
            continue
        pattern, name, fields, large, at = None, piece.head, [*piece.data], piece.large, follower.get(i)
        while at is not None:
            more = pieces[at]
            if large % 2 and not more.large:
                fields += [""] * 4
            fields += more.data
            large = large + more.large if more.large else 0
            at = follower.get(at)
        yield Card(name, fields, line.file, line.number)


def _join_lines(lines: list[Line]) -> Iterator[Line]:
    """Lines, where a free-format line that ends in a comma is joined with a next line that begins with a number."""
    before: Line | None = None
    for line in lines:
        if before and before.text[-1] == "," and line.text[0] in "0123456789.-":
            before = before._replace(text=before.text + line.text)
            continue
        if before:
            yield before
        before = line
    if before:
        yield before


def _continuations(pieces: list[_Piece]) -> dict[int, int]:
    """Line → its continuation: the next line if its mark matches or is blank, else the line with the same mark.
    Column 1 of a mark is ignored, and all marks are ignored if no line ends in a mark.
    Raises DeckError for an unmatched mark, an ambiguous mark, and two continuations of one line."""
    ending: dict[str, list[int]] = {}
    beginning: dict[str, list[int]] = {}
    for i, piece in enumerate(pieces):
        for key in {_key(piece.mark), piece.mark[1:]} - {""}:
            ending.setdefault(key, []).append(i)
        if piece.continues and _key(piece.head):
            beginning.setdefault(_key(piece.head), []).append(i)
    follower: dict[int, int] = {}
    for i, piece in enumerate(pieces):
        if not piece.continues:
            continue
        key = _key(piece.head)
        before = i - 1
        if key and ending and before not in ending.get(key, []):
            before = _other_end(pieces, i, ending.get(key, []), beginning[key])
        if before < 0 or pieces[before].head[:1] == "=":
            what = "the continuation has no preceding card"
            raise piece.line.error(what, "correct the order of the lines")
        if before in follower:
            raise piece.line.error(
                f"this line and {pieces[follower[before]].line.where} both continue the line {pieces[before].line.where}",
                "use a different continuation mark for each continued line",
            )
        follower[before] = i
    for i, piece in enumerate(pieces):
        if piece.mark[:1] in ("+", "*") and _key(piece.mark) and i not in follower:
            raise piece.line.error(
                f"this line ends in the continuation mark {piece.mark!r}, but no line begins with this mark",
                "add the continuation, or remove the mark if the card ends here",
            )
    return follower


def _other_end(pieces: list[_Piece], i: int, ending: list[int], beginning: list[int]) -> int:
    """The only line that ends in the mark at the beginning of line i."""
    piece = pieces[i]
    if len(ending) == 1 == len(beginning) and ending[0] != i:
        return ending[0]
    again = [pieces[j].line.where for j in sorted({*ending, *beginning} - {i})]
    raise piece.line.error(
        f"continuation mark {piece.head!r}: "
        + (f"the mark is also used at {', '.join(again[:3])}" if ending else "no line ends in this mark"),
        "move this line directly below the line that it continues, or use one unique mark for these two lines",
    )


def _key(mark: str) -> str:
    """The part of a mark that must match."""
    return mark.lstrip("+*").strip()


def _split_fields(line: Line) -> _Piece:
    """Parse a line into head, data fields (8 a line, or 4 in large format) and mark of the next line. In free format surplus
    fields belong to the next line, with or without marks between them: `…,6,+,+,7,8` and `…,6,7,8`."""
    text = line.text
    if "," in text:
        tokens = [token.strip() for token in text.split(",")]
        if not text[:8].strip():  # a continuation with a blank first field
            tokens = ["", *tokens]
        head = tokens[0].upper()
        large = int("*" in head)
        width = 4 if large else 8
        data, mark = _free_fields(tokens[1:], width, line)
        large *= len(data) // width
    else:
        head = text[:8].strip().upper()
        large = int("*" in head)
        data = (
            [text[j : j + 16].strip() for j in (8, 24, 40, 56)]
            if large
            else [text[j : j + 8].strip() for j in range(8, 72, 8)]
        )
        mark = text[72:80].strip().upper()
        if head and text[0] == " " and head[0] not in "+*":
            raise line.error(
                f"{head!r} does not begin in column 1",
                "start a card in column 1, and a continuation with eight blanks, + or *",
            )
    if head and head[0] not in "+*":
        head = head.rstrip("*").rstrip()
        if not head[:1].isalpha() and not HEAD.fullmatch(head):
            raise line.error(f"{text.strip()[:24]!r} is not a bulk-data card", "start each card with its name")
    return _Piece(line, head, data, mark, large)


def _free_fields(tokens: list[str], width: int, line: Line) -> tuple[list[str], str]:
    """Data fields of a line in free format, a multiple of `width`, and the mark after them."""
    data: list[str] = []
    while tokens and not tokens[-1]:
        tokens.pop()
    while True:
        data += tokens[:width] + [""] * (width - len(tokens))
        tokens = tokens[width:]
        if tokens and tokens[0][:1] in ("+", "*"):
            if len(tokens) == 1:
                return data, tokens[0].upper()
            if tokens[1][:1] in ("+", "*") and _key(tokens[0]) == _key(tokens[1]):
                tokens = tokens[2:]
            elif parse_real(tokens[0]) is None:
                raise line.error(
                    f"the continuation mark {tokens[0]!r} in field {width + 2} is followed by {tokens[1]!r} on the same line",
                    "start a new line after the mark, or remove the mark",
                )
        if not tokens:
            return data, ""

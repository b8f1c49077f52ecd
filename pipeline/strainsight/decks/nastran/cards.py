"""Nastran text as cards: sections, includes, comments, continuations and the three field formats, with file and line.

Own, because pyyeti's `rdcards` ends a card at a comment between its lines, drops the rest of a large-field card in free
format, reads past ENDDATA and knows no line numbers. pyyeti is the oracle of the tests.
"""

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
"""First field of such a card."""
MOST = 1_000_000
"""Cards that a deck may make so: nobody writes the rest of a model of this size by hand, and ten lines could fill the memory."""
_STEP = re.compile(r"\*(?:\((.+)\)|(.+))")


def times(head: str, made: int, line: Line) -> int:
    """How often =(n) or =n repeats; 1 of a plain =. Raises DeckError where that makes more than MOST, with those made before."""
    match = HEAD.fullmatch(head)
    count = int(match[1] or match[2] or 1) if match else 1
    if made + count > MOST:
        raise line.error(f"{head} makes {made + count} cards of the deck repeated ones", f"at most {MOST} may be")
    return count


def repeated_fields(fields: Sequence[str], pattern: Sequence[str], line: Line) -> list[str]:
    """The eight fields of the next card: = is that of the card before, *x the same plus x (blank: x), == all that are left.

    Raises DeckError where *x has no number before it, or is none.
    """
    made: list[str] = []
    for i in range(8):
        token, before = entry(pattern, i), entry(fields, i)
        if token == "==":
            return [*made, *(entry(fields, j) for j in range(i, 8))]
        if token == "=":
            made.append(before)
        elif step := _STEP.fullmatch(token):
            made.append(_sum(before, step[1] or step[2], f"{token} in field {i + 2}", line))
        else:
            made.append(token)
    return made


def _sum(before: str, step: str, what: str, line: Line) -> str:
    before = before or "0"
    whole, more = parse_integer(before), parse_integer(step)
    if whole is not None and more is not None:
        return str(whole + more)
    x, h = parse_real(before), parse_real(step)
    if x is None or h is None:
        raise line.error(
            f"{what} adds {step!r} to {before!r}, and both have to be numbers", "correct the card, or write it out"
        )
    return repr(x + h)


_BEGIN = re.compile(r"\s*BEGIN\b", re.IGNORECASE)
_BEGIN_BULK = re.compile(r"\s*BEGIN\s*(BULK)?\s*$|\s*BEGIN\s+BULK\s*=\s*0*\s*$", re.IGNORECASE)
_ENDDATA = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
_INCLUDE = re.compile(r"""\s*INCLUDE(?:\s*=\s*|\s+|(?=['"]))(.*)$""", re.IGNORECASE)
_CEND = re.compile(r"\s*CEND\b", re.IGNORECASE)
_CASE_CONTROL = re.compile(r"\s*(SOL\s+\w+\s*$|CEND\b|SUBCASE\b)", re.IGNORECASE)
_LONGEST_NAME = 8
"""Lines over which the name of an included file may go."""


class Card(NamedTuple("_Card", [("name", str), ("tokens", list[str]), ("file", str), ("line", int)]), Entries):
    """One bulk-data entry: NAME (upper case, no asterisk), tokens of the data fields (stripped), where its first line stands."""

    __slots__ = ()
    WORD, FIRST = "field", 2

    @property
    def where(self) -> str:
        """file:line."""
        return f"{self.file}:{self.line}"

    def is_blank(self, i: int) -> bool:
        """Whether a field is blank, or 0, which says the same where an id belongs."""
        return self.text(i) in ("", "0")

    def error(self, what: str, remedy: str = "correct the card and run again") -> DeckError:
        """A DeckError at this card."""
        return DeckError(f"{self.name} {self.text(0)}: {what}", where=self.where, remedy=remedy)


class Cards(dict[str, list[Card]]):
    """Cards by name, those of one name in file order."""

    def of(self, *names: str) -> list[Card]:
        """The cards of these names, one name after the other."""
        return [card for name in names for card in self.get(name, [])]


@dataclass(frozen=True)
class Deck:
    """cards by name in file order, the case-control lines, how many lines stand after ENDDATA, the files that are included and
    notes on them, whether there is a BEGIN BULK, whether ENDDATA shows that the deck is whole, and its last line."""

    cards: Cards
    case_control: tuple[Line, ...]
    after_end: int
    included: tuple[str, ...]
    notes: tuple[str, ...]
    begun: bool
    ended: bool
    last: Line


def unique_ids(cards: Sequence[Card], what: str) -> IntArray:
    """First fields (n,) of the cards as ids; DeckError where one is not positive or stands twice."""
    ids = np.array([card.integer(0, f"the {what} id") for card in cards], dtype=np.int64)
    if ids.size and ids.min() < 1:
        raise cards[int(np.argmin(ids))].error(f"the {what} id must be positive")
    check_once(ids, what, lambda i: cards[i].where)
    return ids


class Elements(NamedTuple):
    """Elements (n,): their cards, ids and regions."""

    cards: Sequence[Card]
    ids: IntArray
    region: IntArray

    def of(self, names: Collection[str]) -> Elements:
        """Those on cards of these names."""
        rows = np.flatnonzero([card.name in names for card in self.cards])
        return Elements([self.cards[i] for i in rows.tolist()], self.ids[rows], self.region[rows])


def origin(ids: IntArray, cards: Sequence[Card]) -> Origin:
    """Where the entities with these ids (n,) stand, one a card."""
    return Origin.at(ids, [(card.file, card.line) for card in cards])


def read_deck(path: Path, include: Sequence[Path] = ()) -> Deck:
    """All cards of a deck and of what it includes.

    Without BEGIN BULK the whole file is bulk data. An INCLUDE may leave the folder of the deck for those of `include` only; one
    before CEND is passed over, as there is no model in it. ENDDATA may be missing: `Deck.ended`.
    Raises DeckError for a file that is missing, empty or binary, and for lines that are no card.
    """
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
            "give the deck of one structure with one BEGIN BULK",
        )
    start = begins[0] + 1 if begins else 0
    if not begins:
        for line in lines:
            if _CASE_CONTROL.match(line.text):
                raise line.error(f"{line.text.strip()!r} without BEGIN BULK", "add the line BEGIN BULK")
    end = next((i for i in range(start, len(lines)) if _ENDDATA.match(lines[i].text)), len(lines))
    ended = end < len(lines)
    cards = Cards()
    for card in _cards(lines[start:end]):
        cards.setdefault(card.name, []).append(card)
    if not cards:
        raise error_at(path, "the deck holds no bulk data", "check that this is the right file")
    case_control = tuple(lines[: begins[0]]) if begins else ()
    after = max(len(lines) - end - 1, 0)
    return Deck(cards, case_control, after, included, tuple(includes.notes), bool(begins), ended, lines[-1])


def _lines(path: Path, includes: Includes, parents: tuple[Path, ...]) -> Generator[Line, None, bool]:
    """Lines of a file and, up to ENDDATA, of those it includes; returns whether ENDDATA was among them.

    A name without a folder is that of a file beside the one that it stands in, others are relative to the folder of the deck,
    as in MSC and NX Nastran; in decks of OptiStruct (.fem) all are relative to the file that they stand in.
    """
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
            nearest = not re.search(r"[/\\]", name) or ".fem" in (suffix.lower() for suffix in above[0].suffixes)
            target = includes.file(name, "INCLUDE", Line(raw, str(path), number), above, nearest)
            ended = yield from _lines(target, includes, above)
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
    raise error_at(where, f"INCLUDE {argument.strip()}: no complete file name", "write INCLUDE 'file' on one line")


class _Piece(NamedTuple):
    """A line of a card: its name, or the mark of a continuation; its data fields; the mark of the line that continues it; how
    many lines of the large format it makes, 0 in another format."""

    line: Line
    head: str
    data: list[str]
    mark: str
    large: int

    @property
    def continues(self) -> bool:
        return not self.head or self.head[0] in "+*"


def _cards(lines: list[Line]) -> Iterator[Card]:
    pieces = [_cut(line) for line in _joined(lines)]
    follower = _continuations(pieces)
    pattern: list[str] | None = None  # of the card before, where that repeats one itself
    name, made = "", 0
    fields: list[str] = []
    for i, piece in enumerate(pieces):
        if piece.continues:
            continue
        line = piece.line
        if piece.head[0] == "=":
            if not name or len(fields) != 8 or (pattern is None and piece.head != "="):
                raise line.error(
                    f"{line.text.strip()[:24]!r} repeats no card that stands on one line before it",
                    "write repeated cards out",
                )
            pattern = piece.data if piece.head == "=" else pattern
            count = times(piece.head, made, line)
            made += count
            for _ in range(count):
                fields = repeated_fields(fields, pattern or [], line)
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


def _joined(lines: list[Line]) -> Iterator[Line]:
    """Lines in free format that end in a comma, with the rest of their fields where the next line begins with a number."""
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
    """Line → the line that continues it: the next one where its mark fits or is blank, else the one with the same mark, wherever
    it stands. Column 1 of a mark does not count, and in a deck whose lines end in no marks no mark does.

    Raises DeckError for a mark without its other end, one that stands twice where lines are not in order, and two lines that
    continue the same one.
    """
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
            what = "a continuation with no card before it"
            raise piece.line.error(what, "correct the order of the lines")
        if before in follower:
            raise piece.line.error(
                f"a second continuation of line {pieces[before].line.where} (first at {pieces[follower[before]].line.where})",
                "give every line and its continuation a mark of their own",
            )
        follower[before] = i
    for i, piece in enumerate(pieces):
        if piece.mark[:1] in ("+", "*") and _key(piece.mark) and i not in follower:
            raise piece.line.error(
                f"no continuation has the mark {piece.mark!r} of this line",
                "add the continuation, or remove the mark if the card ends here",
            )
    return follower


def _other_end(pieces: list[_Piece], i: int, ending: list[int], beginning: list[int]) -> int:
    """The only line that ends in the mark with which line i begins."""
    piece = pieces[i]
    if len(ending) == 1 == len(beginning) and ending[0] != i:
        return ending[0]
    again = [pieces[j].line.where for j in sorted({*ending, *beginning} - {i})]
    raise piece.line.error(
        f"continuation {piece.head!r}: "
        + (f"its mark also stands at {', '.join(again[:3])}" if ending else "no line ends in its mark"),
        "put the continuation behind the line that it continues, or give both a mark of their own",
    )


def _key(mark: str) -> str:
    """What of a mark has to agree."""
    return mark.lstrip("+*").strip()


def _cut(line: Line) -> _Piece:
    """A line as head, data fields (8 a line, or 4 in large format) and mark of the next line.

    In free format what is beyond the fields of a line is on the next one; marks may stand between: `…,6,+,+,7,8` and `…,6,7,8`.
    """
    text = line.text
    if "," in text:
        tokens = [token.strip() for token in text.split(",")]
        if not text[:8].strip():  # a continuation whose first field is blank
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
                "a card begins in column 1, a continuation with eight blanks, + or *",
            )
    if head and head[0] not in "+*":
        head = head.rstrip("*").rstrip()
        if not head[:1].isalpha() and not HEAD.fullmatch(head):
            raise line.error(f"{text.strip()[:24]!r} is no bulk-data card", "a card begins with its name")
    return _Piece(line, head, data, mark, large)


def _free_fields(tokens: list[str], width: int, line: Line) -> tuple[list[str], str]:
    """Data fields of a line in free format, a multiple of `width`, and the mark behind them."""
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
                    f"the mark {tokens[0]!r} in field {width + 2} is followed by {tokens[1]!r} on the same line",
                    "begin a new line behind the mark, or remove it",
                )
        if not tokens:
            return data, ""

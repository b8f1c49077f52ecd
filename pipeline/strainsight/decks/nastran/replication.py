"""Cards that repeat the one before them: =, *(x) and == in its fields, =(n) for n more of the same."""

from __future__ import annotations

import re
from collections.abc import Sequence

from strainsight.decks.numbers import entry, parse_integer, parse_real
from strainsight.decks.text import Line
from strainsight.errors import DeckError

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
        raise DeckError(
            f"{head} makes {made + count} cards of the deck repeated ones",
            where=line.where,
            remedy=f"at most {MOST} may be",
        )
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
        raise DeckError(
            f"{what} adds {step!r} to {before!r}, and both have to be numbers",
            where=line.where,
            remedy="correct the card, or write it out",
        )
    return repr(x + h)

"""Numbers as decks write them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence

from strainsight.errors import DeckError

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


def integer_entry(entries: Sequence[str], i: int, default: int | None, error: Callable[[str], DeckError]) -> int:
    """Entry i as an integer; a blank one is `default`, or the error, made of what is wrong."""
    token = entry(entries, i)
    if not token and default is not None:
        return default
    value = parse_integer(token)
    if value is None:
        raise error(no_integer(token))
    return value


def real_entry(entries: Sequence[str], i: int, default: float | None, error: Callable[[str], DeckError]) -> float:
    """Entry i as a finite real, also in Nastran's short form 1.7-4; a blank one is `default`, or the error."""
    token = entry(entries, i)
    if not token and default is not None:
        return default
    value = parse_real(token)
    if value is None:
        raise error(f"is {token!r}, not a number")
    return value

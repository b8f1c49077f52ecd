"""Errors with their location, measured value and remedy."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from difflib import get_close_matches
from typing import Any


class StrainsightError(Exception):
    """A failure with its place and its remedy; `exit_code` is what the command line returns.

    what    one sentence with the measured value
    where   "file:line:column" or "file:line", when known
    key     dotted config key the request came from ("place.keep"); the command line turns it into a place
    remedy  what the user can do about it
    others  further problems of the same kind that were found with it (a config is checked whole)
    """

    exit_code = 1

    def __init__(self, what: str, *, where: str | None = None, key: str | None = None, remedy: str | None = None):
        super().__init__(what)
        self.what = what
        self.where = where
        self.key = key
        self.remedy = remedy
        self.others: tuple[StrainsightError, ...] = ()

    def __str__(self) -> str:
        where, key, what, remedy = (text and _cut(text) for text in (self.where, self.key, self.what, self.remedy))
        head = "  ".join(part for part in (where, key and f"{key}: {what}") if part)
        if not key:
            head = f"{where}  {what}" if where else what or ""
        message = f"{head}\n    {remedy}" if remedy else head
        return "\n".join([message, *map(str, self.others)])


LONGEST = 1500
"""Largest number of characters of a part of a message; the middle of longer texts is omitted."""
SPACES = "\u00a0\u202f"
"""Spaces between a number and its unit, and between thousands."""


def printable(text: str) -> str:
    """The text on one line, with control characters, line breaks and bidirectional marks as escapes."""
    return "".join(sign if sign.isprintable() or sign in SPACES else ascii(sign)[1:-1] for sign in text)


def _cut(text: str) -> str:
    """The text, cut to LONGEST characters."""
    return printable(text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} … {text[-LONGEST // 2 :]}")


def at_least(limit: float) -> str:
    """A limit for a remedy with two digits, rounded up, so that the printed value is accepted."""
    return f"{Context(2, ROUND_CEILING).create_decimal_from_float(limit):g}"


def at_most(limit: float) -> str:
    """A limit for a remedy with two digits, rounded down."""
    return f"{Context(2, ROUND_FLOOR).create_decimal_from_float(limit):g}"


class UserError(StrainsightError):
    """A failure that the user can correct: a config, a deck, an infeasible request."""

    exit_code = 2


class ConfigError(UserError):
    """An invalid config file or override."""


class DeckError(UserError):
    """A mesh file that cannot be imported.

    entity   faulty entity: ("node", id), ("element", id) or ("tie", id), to find its line in the file
    choices  alternatives among which the config has to choose
    """

    def __init__(
        self,
        what: str,
        *,
        where: str | None = None,
        key: str | None = None,
        remedy: str | None = None,
        entity: tuple[str, int] | None = None,
        choices: tuple[Any, ...] = (),
    ):
        super().__init__(what, where=where, key=key, remedy=remedy)
        self.entity = entity
        self.choices = choices


class ChoiceError(DeckError):
    """A deck with several support sets (key "spc"; choices: ids) or different steps (key "step"; choices: numbers), among which
    the config has to choose."""


class ContactError(DeckError):
    """A deck with contact pairs (choices: "A on B"); the config has to define their treatment."""


class MachineWarning(UserWarning):
    """A warning about the machine, such as a missing solver; it is printed, but not stored in results files."""


class InfeasibleError(UserError):
    """A request that no layout or estimate can satisfy."""


class InconsistentRecordError(UserError):
    """Measurements so inconsistent with the model that no filter can follow them."""

    exit_code = 3


class ArtefactError(UserError):
    """A results file that is missing, damaged or of another format version."""


class NumericalError(StrainsightError):
    """A computation that did not reach its accuracy."""


@contextmanager
def blame(key: str) -> Iterator[None]:
    """Set the config key of an error from a kernel that does not know it."""
    try:
        yield
    except StrainsightError as error:
        if error.key is None:
            error.key = key
        raise


SHORT = 5
"""Signs."""


def did_you_mean(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """A suggestion in words, or `otherwise`; in short words such as G5, half of the characters may differ."""
    spelt = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), spelt, n=1, cutoff=0.5 if len(word) <= SHORT else 0.6)
    return f"did you mean {spelt[close[0]]}?" if close else otherwise

"""Every error says what happened, where, the measured value, and the remedy."""

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
        own = f"{head}\n    {remedy}" if remedy else head
        return "\n".join([own, *map(str, self.others)])


LONGEST = 1500
"""Signs of a part of a message: of a number of five thousand digits the middle is left out."""
SPACES = "\u00a0\u202f"
"""Between a number and its unit, and between thousands."""


def printable(text: str) -> str:
    """One line of a text that may come from any file: what a terminal obeys (controls, line breaks, changes of the direction of
    writing) as escapes."""
    return "".join(sign if sign.isprintable() or sign in SPACES else ascii(sign)[1:-1] for sign in text)


def _cut(text: str) -> str:
    """What a message shows of a text: no more than LONGEST signs."""
    return printable(text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} … {text[-LONGEST // 2 :]}")


def at_least(limit: float) -> str:
    """A limit for a remedy in two digits, rounded up: what is taken from the message is accepted."""
    return f"{Context(2, ROUND_CEILING).create_decimal_from_float(limit):g}"


def at_most(limit: float) -> str:
    """The same, rounded down."""
    return f"{Context(2, ROUND_FLOOR).create_decimal_from_float(limit):g}"


class UserError(StrainsightError):
    """Something the user can correct: a config, a deck, an infeasible request."""

    exit_code = 2


class ConfigError(UserError):
    """A config file or an override that cannot be accepted."""


class DeckError(UserError):
    """A mesh file that cannot be imported as it stands.

    entity   ("node", id), ("element", id) or ("tie", id) that is at fault, for whoever knows the lines of the file
    choices  what the config can choose from, where it has to
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
    """A deck that states several sets of supports (key "spc"; choices: their ids), or steps that differ (key "step"; choices:
    their numbers), of which the config has to say which counts."""


class ContactError(DeckError):
    """A deck with surfaces in contact (choices: "A on B"), of which the config has to say whether they are joined."""


class MachineWarning(UserWarning):
    """A warning about the machine, such as a missing solver; it is printed and kept in no results file."""


class InfeasibleError(UserError):
    """A request that no layout or estimate can satisfy."""


class ContradictionError(UserError):
    """A record that contradicts the model so far that no filter can follow it."""

    exit_code = 3


class ArtefactError(UserError):
    """A results file that is missing, damaged or of another format version."""


class NumericalError(StrainsightError):
    """A computation that did not reach its accuracy."""


@contextmanager
def blame(key: str) -> Iterator[None]:
    """Name the config key that a kernel's error came from, where the kernel could not know it."""
    try:
        yield
    except StrainsightError as error:
        if error.key is None:
            error.key = key
        raise


SHORT = 5
"""Signs."""


def did_you_mean(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """A suggestion in words, or `otherwise`; of short words, as G5, one sign in two may be wrong."""
    spelt = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), spelt, n=1, cutoff=0.5 if len(word) <= SHORT else 0.6)
    return f"did you mean {spelt[close[0]]}?" if close else otherwise

"""Arithmetic formulas of MDF channels: parsed and evaluated here, so that no text of a file is compiled or executed."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

LONGEST = 1000
"""Characters of a formula."""
DEEPEST = 50
"""Parentheses, signs and powers within each other."""
FUNCTIONS: dict[str, np.ufunc] = {
    "abs": np.absolute,
    "exp": np.exp,
    "ln": np.log,
    "log": np.log,
    "log10": np.log10,
    "pow": np.power,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "arcsin": np.arcsin,
    "arccos": np.arccos,
    "arctan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
}
"""By their names in small letters; log is the natural logarithm, as in C and for asammdf."""
Value = np.float64 | NDArray[np.float64]
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)|(?P<word>[a-z_]\w*)|(?P<sign>\*\*|[-+*/^(),]))", re.A | re.I
)
_END = ("end", "")


def evaluate(formula: str, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (T,) of a formula of X or X1, the raw values (T,): numbers, + - * /, ^ or ** for powers, parentheses, FUNCTIONS.

    A power goes before a sign and from right to left, as in mathematics: -X^2 is -(X²). Overflow and undefined values are
    infinite and NaN. Raises ValueError for all that is no such formula.
    """
    if len(formula) > LONGEST:
        raise ValueError(f"it has {len(formula)} characters, at most {LONGEST} are read")
    tokens = list(_split(formula))
    with np.errstate(all="ignore"):
        value, behind = _evaluate_sum(tokens, 0, x, 0)
    if tokens[behind] != _END:
        raise ValueError(f"{tokens[behind][1]!r} is not expected there")
    return np.array(np.broadcast_to(value, x.shape))


def _split(formula: str) -> Iterator[tuple[str, str]]:
    """Kind and text in small letters of every token."""
    at = 0
    text = formula.rstrip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ValueError(f"{text[at:].lstrip()[:1]!r} is no part of an arithmetic formula")
        assert match.lastgroup is not None
        yield match.lastgroup, match[match.lastgroup].lower()
        at = match.end()
    yield _END


Tokens = list[tuple[str, str]]
# Each takes the tokens, the place of its first one, the raw values and its depth, and returns its value and the place behind it.


def _evaluate_sum(tokens: Tokens, at: int, x: Value, depth: int) -> tuple[Value, int]:
    value, at = _evaluate_product(tokens, at, x, depth)
    while (sign := tokens[at][1]) in ("+", "-"):
        term, at = _evaluate_product(tokens, at + 1, x, depth)
        value = value + term if sign == "+" else value - term
    return value, at


def _evaluate_product(tokens: Tokens, at: int, x: Value, depth: int) -> tuple[Value, int]:
    value, at = _evaluate_signed(tokens, at, x, depth)
    while (sign := tokens[at][1]) in ("*", "/"):
        factor, at = _evaluate_signed(tokens, at + 1, x, depth)
        value = value * factor if sign == "*" else value / factor
    return value, at


def _evaluate_signed(tokens: Tokens, at: int, x: Value, depth: int) -> tuple[Value, int]:
    """A power behind any number of signs."""
    if depth > DEEPEST:
        raise ValueError(f"it is nested more than {DEEPEST} deep")
    if (sign := tokens[at][1]) in ("+", "-"):
        value, at = _evaluate_signed(tokens, at + 1, x, depth + 1)
        return (-value if sign == "-" else value), at
    value, at = _evaluate_atom(tokens, at, x, depth + 1)
    if tokens[at][1] in ("^", "**"):
        exponent, at = _evaluate_signed(tokens, at + 1, x, depth + 1)
        value = np.power(value, exponent)
    return value, at


def _evaluate_atom(tokens: Tokens, at: int, x: Value, depth: int) -> tuple[Value, int]:
    """A number, the raw values, a function, or what stands in parentheses."""
    kind, text = tokens[at]
    if kind == "number":
        number = np.float64(text)
        if np.isinf(number):
            raise ValueError(f"the number {text} is too large")
        return number, at + 1
    if text in ("x", "x1"):
        return x, at + 1
    if text in FUNCTIONS and tokens[at + 1][1] == "(":
        return _apply(FUNCTIONS[text], text, tokens, at + 2, x, depth)
    if text == "(":
        value, at = _evaluate_sum(tokens, at + 1, x, depth)
        return value, _close(tokens, at)
    if kind == "word":
        raise ValueError(f"{text!r} is neither X1 nor a function with its arguments: {', '.join(sorted(FUNCTIONS))}")
    raise ValueError("it ends too early" if kind == "end" else f"{text!r} is not expected there")


def _apply(function: np.ufunc, name: str, tokens: Tokens, at: int, x: Value, depth: int) -> tuple[Value, int]:
    """The value of a function whose first argument is at this place."""
    arguments = []
    for number in range(function.nin):
        if number:
            if tokens[at][1] != ",":
                raise ValueError(f"{name} takes {function.nin} arguments")
            at += 1
        value, at = _evaluate_sum(tokens, at, x, depth)
        arguments.append(value)
    return function(*arguments), _close(tokens, at)


def _close(tokens: Tokens, at: int) -> int:
    if tokens[at][1] != ")":
        raise ValueError(
            "a parenthesis is not closed" if tokens[at] == _END else f"{tokens[at][1]!r} is not expected there"
        )
    return at + 1

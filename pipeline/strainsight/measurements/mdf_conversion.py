"""Conversion rules of MDF channels: raw value → physical value. Source: ASAM MDF 4.1, CCBLOCK; MDF 3.3, CCBLOCK."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strainsight.errors import UserError
from strainsight.measurements.records import quote

LONGEST = 1000
"""Largest length of a formula [characters]."""
DEEPEST = 50
"""Largest nesting depth of parentheses, signs and powers."""
FUNCTIONS: dict[str, np.ufunc] = {
    **{
        name: getattr(np, name) for name in ("exp", "log", "log10", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh")
    },
    **{f"{prefix}{name}": getattr(np, f"arc{name}") for name in ("sin", "cos", "tan") for prefix in ("a", "arc")},
    "abs": np.absolute,
    "ln": np.log,
    "pow": np.power,
}
"""Functions by name in small letters; log is the natural logarithm, as in C and asammdf."""
Value = np.float64 | NDArray[np.float64]
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)|(?P<word>[a-z_]\w*)|(?P<sign>\*\*|[-+*/^(),]))", re.A | re.I
)
_END = ("end", "")


def evaluate(formula: str, x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values (T,) of a formula of the raw values X or X1 (T,): numbers, + - * /, ^ or ** for powers, parentheses, FUNCTIONS.

    Powers bind stronger than signs and are evaluated from right to left: -X^2 is -(X²). Overflow gives infinity,
    undefined values NaN. Raises ValueError for an invalid formula."""
    if len(formula) > LONGEST:
        raise ValueError(f"the formula has {len(formula)} characters, more than the limit of {LONGEST}")
    tokens = list(_split(formula))
    with np.errstate(all="ignore"):
        value, behind = _evaluate_sum(tokens, 0, x, 0)
    if tokens[behind] != _END:
        raise ValueError(f"{tokens[behind][1]!r} is unexpected")
    return np.array(np.broadcast_to(value, x.shape))


def _split(formula: str) -> Iterator[tuple[str, str]]:
    """Kind and text, in small letters, of every token."""
    at = 0
    text = formula.rstrip()
    while at < len(text):
        if (match := _TOKEN.match(text, at)) is None:
            raise ValueError(f"{text[at:].lstrip()[:1]!r} is not allowed in an arithmetic formula")
        assert match.lastgroup is not None
        yield match.lastgroup, match[match.lastgroup].lower()
        at = match.end()
    yield _END


Tokens = list[tuple[str, str]]
# Each function returns the value and the next position, given tokens, position, raw values and depth.


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
    """A power, with any number of preceding plus and minus signs."""
    if depth > DEEPEST:
        raise ValueError(f"the formula is nested more than {DEEPEST} levels deep")
    if (sign := tokens[at][1]) in ("+", "-"):
        value, at = _evaluate_signed(tokens, at + 1, x, depth + 1)
        return (-value if sign == "-" else value), at
    value, at = _evaluate_atom(tokens, at, x, depth + 1)
    if tokens[at][1] in ("^", "**"):
        exponent, at = _evaluate_signed(tokens, at + 1, x, depth + 1)
        value = np.power(value, exponent)
    return value, at


def _evaluate_atom(tokens: Tokens, at: int, x: Value, depth: int) -> tuple[Value, int]:
    """A number, the raw values, a function, or an expression in parentheses."""
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
        raise ValueError(
            f"{text!r} is neither X1 (the raw value) nor a call of one of these functions: {', '.join(sorted(FUNCTIONS))}"
        )
    raise ValueError("the formula is incomplete" if kind == "end" else f"{text!r} is unexpected")


def _apply(function: np.ufunc, name: str, tokens: Tokens, at: int, x: Value, depth: int) -> tuple[Value, int]:
    """Value of a function whose first argument is at this position."""
    arguments = []
    for number in range(function.nin):
        if number:
            if tokens[at][1] != ",":
                raise ValueError(f"the function {name} requires {function.nin} arguments")
            at += 1
        value, at = _evaluate_sum(tokens, at, x, depth)
        arguments.append(value)
    return function(*arguments), _close(tokens, at)


def _close(tokens: Tokens, at: int) -> int:
    if tokens[at][1] != ")":
        raise ValueError("a parenthesis is not closed" if tokens[at] == _END else f"{tokens[at][1]!r} is unexpected")
    return at + 1


Values = NDArray[np.float64]
_ELEMENTARY = ("polynomial", "exponential", "logarithmic", "rational", "formula", "text", "text")
_TEXTS = ("ranges", "value-to-text", "range-to-text", "text", "text", "text")
_KINDS = {
    3: {65535: "none", 0: "linear", 1: "interpolated", 2: "table", **dict(enumerate(_ELEMENTARY, start=6))},
    4: dict(enumerate(("none", "linear", "rational", "formula", "interpolated", "table", *_TEXTS))),
}
"""Version → code of a rule → kind."""
_DEEPEST = 4
"""Largest nesting depth of rules."""
EXPORT = "export physical values of the channel, or raw values with a linear conversion rule"


def to_physical(raw: Values, rule: Any, version: int, integers: bool, name: str, where: str) -> Values:
    """Physical values (T,) of raw values (T,), NaN where those are NaN.

    rule: of asammdf, or None; version: 3 or 4; integers: whether the raw values are stored as integers. Raises
    UserError for text, for an invalid formula or rule, and for values without a physical value."""
    if rule is None:
        return raw
    valid = ~np.isnan(raw)
    result = np.full(raw.shape, np.nan)
    try:
        with np.errstate(all="ignore"):
            result[valid] = _convert(raw[valid], rule, version, integers, 0)
    except ValueError as error:
        raise UserError(f"channel {name!r}: {error}", where=where, remedy=EXPORT) from None
    if not np.isfinite(result[valid]).all():
        sample = int(np.argmax(valid & ~np.isfinite(result)))
        shown = quote(_formula_text(rule), 100) if rule.formula else "rule"
        raise UserError(
            f"channel {name!r} has no physical value at sample {sample + 1}: the conversion {shown} of the raw value "
            f"{raw[sample]:g} yields {result[sample]:g}",
            where=where,
            remedy="correct the conversion, or mark such samples as invalid in the file",
        )
    return result


def _formula_text(rule: Any) -> str:
    """Formula as in the file; asammdf changes some letters."""
    if (field := getattr(rule, "formula_field", None)) is not None:
        return str(field.decode("latin-1").split("\0")[0].strip())
    return str(rule.formula)


def _convert(x: Values, rule: Any, version: int, integers: bool, depth: int) -> Values:
    """Raises ValueError with the fault of the rule."""
    kind = _KINDS[version].get(rule.conversion_type)
    if depth > _DEEPEST:
        raise ValueError(f"the conversion rules are nested more than {_DEEPEST} levels deep")
    match kind:
        case "none":
            return x
        case "linear":
            return rule.a * x + rule.b
        case "rational":
            return _divide_parabolas(x, rule)
        case "polynomial":
            y = x - rule.P5 - rule.P6
            return (rule.P2 - rule.P4 * y) / (rule.P3 * y - rule.P1)
        case "formula":
            try:
                return evaluate(text := _formula_text(rule), x)
            except ValueError as error:
                reason = f"the conversion formula {quote(text, 100)} cannot be evaluated: {error}"
                raise ValueError(reason) from None
        case "interpolated" | "table":
            return _look_up(x, rule, version, kind == "interpolated")
        case "ranges":
            count = (rule.val_param_nr - 1) // 3
            row = _find_ranges(x, rule, count, integers)
            return np.append(_parameters(rule, "phys", count), rule.default)[row]
        case "value-to-text" | "range-to-text":
            return _convert_entries(x, rule, version, integers, depth)
        case "text":
            raise ValueError("the values are text instead of numbers")
    raise ValueError(f"the conversion rule is not supported: {kind or f'type {rule.conversion_type}'}")


def _parameters(rule: Any, name: str, count: int) -> Values:
    """Parameters name_0, name_1, … of a rule."""
    return np.array([getattr(rule, f"{name}_{i}") for i in range(count)], dtype=float)


def _divide_parabolas(x: Values, rule: Any) -> Values:
    """(P1 x² + P2 x + P3) / (P4 x² + P5 x + P6), with common factors x cancelled."""
    above, below = [rule.P1, rule.P2, rule.P3], [rule.P4, rule.P5, rule.P6]
    while above[-1] == below[-1] == 0 and len(above) > 1:
        above, below = above[:-1], below[:-1]
    return np.polyval(above, x) / np.polyval(below, x)


def _look_up(x: Values, rule: Any, version: int, interpolated: bool) -> Values:
    """Linear interpolation between entries, or the entry of the nearest (lower) raw value; the first or last entry outside."""
    count = rule.ref_param_nr if version == 3 else rule.val_param_nr // 2
    keys, values = _parameters(rule, "raw", count), _parameters(rule, "phys", count)
    if not count or not (np.diff(keys) > 0).all():
        raise ValueError("the raw values in the conversion table do not increase")
    if interpolated:
        return np.interp(x, keys, values)
    middles = keys[:-1] + np.diff(keys) / 2
    return values[np.searchsorted(middles, x)]


def _find_ranges(x: Values, rule: Any, count: int, integers: bool) -> NDArray[np.intp]:
    """Index of the range of each value, -1 outside all; the upper limit belongs to the range only for integers."""
    lower, upper = _parameters(rule, "lower", count), _parameters(rule, "upper", count)
    if not (np.diff(lower) > 0).all() or (upper < lower).any() or (upper[:-1] > lower[1:]).any():
        raise ValueError("the ranges in the conversion table overlap or do not increase")
    row = np.searchsorted(lower, x, side="right") - 1
    inside = row >= 0
    inside[inside] = x[inside] <= upper[row[inside]] if integers else x[inside] < upper[row[inside]]
    return np.where(inside, row, -1)


def _convert_entries(x: Values, rule: Any, version: int, integers: bool, depth: int) -> Values:
    """Values of a table whose entries are rules; raises ValueError if a sample has a text entry."""
    ranges = _KINDS[version][rule.conversion_type] == "range-to-text"
    count = rule.val_param_nr // 2 if ranges else rule.val_param_nr
    if ranges:
        row = _find_ranges(x, rule, count, integers)
    else:
        keys = _parameters(rule, "val", count)
        order = np.argsort(keys)
        near = order[np.minimum(np.searchsorted(keys[order], x), count - 1)] if count else np.zeros(x.shape, np.intp)
        row = np.where(keys[near] == x, near, -1) if count else near - 1
    result = np.empty(x.shape)
    for number in np.unique(row):
        here = row == number
        entry = rule.referenced_blocks.get("default_addr" if number < 0 else f"text_{number}")
        if entry is None or isinstance(entry, bytes | str):
            text = entry.decode("utf-8", "replace") if isinstance(entry, bytes) else entry or ""
            shown = f": the raw value {x[here][0]:g} means {quote(text.strip(chr(0)))}" if text else ""
            raise ValueError(f"the values are text instead of numbers{shown}")
        result[here] = _convert(x[here], entry, version, integers, depth + 1)
    return result

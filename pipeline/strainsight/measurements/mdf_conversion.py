"""Conversion rules of MDF channels: raw value → physical value. Source: ASAM MDF 4.1, CCBLOCK; MDF 3.3, CCBLOCK."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from strainsight.errors import UserError
from strainsight.measurements.mdf_formula import evaluate
from strainsight.measurements.records import plain

Values = NDArray[np.float64]
_KINDS = {
    3: {
        65535: "none",
        0: "linear",
        1: "interpolated",
        2: "table",
        6: "polynomial",
        7: "exponential",
        8: "logarithmic",
        9: "rational",
        10: "formula",
        11: "text",
        12: "text",
    },
    4: {
        0: "none",
        1: "linear",
        2: "rational",
        3: "formula",
        4: "interpolated",
        5: "table",
        6: "ranges",
        7: "values with text",
        8: "ranges with text",
        9: "text",
        10: "text",
        11: "text",
    },
}
"""Version → code of a rule → what it is."""
_DEEPEST = 4
"""Rules within each other."""
EXPORT = "export the channel with physical values, or as raw values with a linear rule"


def to_physical(raw: Values, rule: Any, version: int, integers: bool, name: str, where: str) -> Values:
    """Physical values (T,) of raw values (T,), NaN where those are NaN.

    rule: asammdf's, or None; version: 3 or 4; integers: whether the raw values are stored as integers.
    Raises UserError for text, for a formula or rule that cannot be evaluated, and for values without a physical one.
    """
    if rule is None:
        return raw
    there = ~np.isnan(raw)
    result = np.full(raw.shape, np.nan)
    try:
        with np.errstate(all="ignore"):
            result[there] = _convert(raw[there], rule, version, integers, 0)
    except ValueError as error:
        raise UserError(f"{name!r} {error}", where=where, remedy=EXPORT) from None
    if not np.isfinite(result[there]).all():
        sample = int(np.argmax(there & ~np.isfinite(result)))
        shown = plain(_formula_text(rule), 100) if rule.formula else "rule"
        raise UserError(
            f"{name!r} has no physical value at sample {sample + 1}: its conversion {shown} of the raw value "
            f"{raw[sample]:g} gives {result[sample]:g}",
            where=where,
            remedy="correct the conversion, or mark such samples as invalid where the file is written",
        )
    return result


def _formula_text(rule: Any) -> str:
    """As the file has it: asammdf changes some letters."""
    if (field := getattr(rule, "formula_field", None)) is not None:
        return str(field.decode("latin-1").split("\0")[0].strip())
    return str(rule.formula)


def _convert(x: Values, rule: Any, version: int, integers: bool, depth: int) -> Values:
    """Raises ValueError, with what is wrong with the channel."""
    kind = _KINDS[version].get(rule.conversion_type)
    if depth > _DEEPEST:
        raise ValueError(f"has conversion rules nested more than {_DEEPEST} deep")
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
                reason = f"has the conversion formula {plain(text, 100)}, which cannot be evaluated: {error}"
                raise ValueError(reason) from None
        case "interpolated" | "table":
            return _look_up(x, rule, version, kind == "interpolated")
        case "ranges":
            count = (rule.val_param_nr - 1) // 3
            row = _find_ranges(x, rule, count, integers)
            return np.append(_parameters(rule, "phys", count), rule.default)[row]
        case "values with text" | "ranges with text":
            return _convert_entries(x, rule, version, integers, depth)
        case "text":
            raise ValueError("holds text, not numbers")
    raise ValueError(f"has a conversion rule that is not supported, {kind or f'of type {rule.conversion_type}'}")


def _parameters(rule: Any, name: str, count: int) -> Values:
    """Parameters name_0, name_1, … of a rule."""
    return np.array([getattr(rule, f"{name}_{i}") for i in range(count)], dtype=float)


def _divide_parabolas(x: Values, rule: Any) -> Values:
    """(P1 x² + P2 x + P3) / (P4 x² + P5 x + P6), without a factor x of both."""
    above, below = [rule.P1, rule.P2, rule.P3], [rule.P4, rule.P5, rule.P6]
    while above[-1] == below[-1] == 0 and len(above) > 1:
        above, below = above[:-1], below[:-1]
    return np.polyval(above, x) / np.polyval(below, x)


def _look_up(x: Values, rule: Any, version: int, interpolated: bool) -> Values:
    """Between the entries by a line, or that of the nearest raw value, the lower of two; outside the first or the last entry."""
    count = rule.ref_param_nr if version == 3 else rule.val_param_nr // 2
    keys, values = _parameters(rule, "raw", count), _parameters(rule, "phys", count)
    if not count or not (np.diff(keys) > 0).all():
        raise ValueError("has a conversion table whose raw values do not increase")
    if interpolated:
        return np.interp(x, keys, values)
    middles = keys[:-1] + np.diff(keys) / 2
    return values[np.searchsorted(middles, x)]


def _find_ranges(x: Values, rule: Any, count: int, integers: bool) -> NDArray[np.intp]:
    """The range of each value, -1 outside all: with its upper limit for integers only."""
    lower, upper = _parameters(rule, "lower", count), _parameters(rule, "upper", count)
    if not (np.diff(lower) > 0).all() or (upper < lower).any() or (upper[:-1] > lower[1:]).any():
        raise ValueError("has a conversion table whose ranges overlap or do not increase")
    row = np.searchsorted(lower, x, side="right") - 1
    inside = row >= 0
    inside[inside] = x[inside] <= upper[row[inside]] if integers else x[inside] < upper[row[inside]]
    return np.where(inside, row, -1)


def _convert_entries(x: Values, rule: Any, version: int, integers: bool, depth: int) -> Values:
    """Values of a table whose entries are rules; those that are text are refused where a sample has one."""
    ranges = _KINDS[version][rule.conversion_type] == "ranges with text"
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
            shown = f": {x[here][0]:g} stands for {plain(text.strip(chr(0)))}" if text else ""
            raise ValueError(f"holds text, not numbers{shown}")
        result[here] = _convert(x[here], entry, version, integers, depth + 1)
    return result

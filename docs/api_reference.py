"""Docstrings as reStructuredText for the API reference: formulas as blocks, fields of records and dataclasses as a list."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

from strainsight.columns import columns_of

FIELD = re.compile(r"(\w+(?:, \w+)*) {2,}(\S.*)")


def escape(line: str) -> str:
    """A line of prose, with code in backticks as literals."""
    parts = line.split("`")
    return "``".join(re.sub(r"([*|_\\])", r"\\\1", part) if i % 2 == 0 else part for i, part in enumerate(parts))


def restructured(lines: list[str]) -> list[str]:
    """The lines of a docstring: indented blocks are formulas or code, lines `name  meaning` are fields."""
    result: list[str] = []
    literal = False
    for line in lines:
        indented = line.startswith("    ")
        if indented and not literal:
            result += ["", "::", ""]
        elif literal and not indented and line.strip():
            result.append("")
        literal = indented or (literal and not line.strip())
        if indented:
            result.append(line)
        elif field := FIELD.fullmatch(line):
            result.append(f":{field[1]}: {escape(field[2])}")
        else:
            result.append(escape(line))
    return result


def fields(kind: type) -> list[str]:
    """One line per documented field of a dataclass: shape, unit, meaning."""
    rows = []
    for field in dataclasses.fields(kind) if dataclasses.is_dataclass(kind) else ():
        column = field.metadata.get("place") or columns_of(kind)[field.name][1]
        if column is None:
            continue
        meaning = getattr(column, "meaning", "") or getattr(column, "what", "")
        axes = column.axes if isinstance(column.axes, str) else " × ".join(axis.rpartition("/")[2] for axis in column.axes)
        shape, unit = f" ({axes})" if axes else "", f" [{column.unit}]" if column.unit else ""
        if meaning:
            rows.append(f":{field.name}: {escape(meaning + shape + unit)}")
    return ["", *rows, ""] if rows else []


def process(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Replace the docstring that autodoc read."""
    lines[:] = restructured(lines) + (fields(value) if what == "class" else [])

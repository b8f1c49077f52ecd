"""The elements that gauges lie on, as sets of Nastran and Abaqus."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from strainsight.experiment.layout.workshop import Workshop

ALL = "GAUGES"
FIRST_SET = 9001
"""Number of the Nastran set of all gauges; those of single gauges follow."""
WIDTH = 72
A_LINE = 16
"""Numbers that a data line of Abaqus may hold."""
LONGEST = 80


def elements_of(shop: Workshop) -> dict[str, list[int]]:
    """Label of every gauge → ids of the elements below it, of a bridge below all its arms, ascending; none of what lies on no
    facet."""
    found = {}
    for i, label in enumerate(shop.listed.labels):
        ids = sorted({int(shop.lines[k].element) for k in shop.lines_of(i) if shop.lines[k].facet})
        if ids:
            found[label] = ids
    return found


def nastran_sets(elements: Mapping[str, Sequence[int]], run: str) -> bytes:
    """SET cards of the case control section: one of all, then one a gauge, each below a comment with its name."""
    lines = [
        f"$ Run {_ascii(run)}: elements below its gauges.",
        "$ For the case control section: INCLUDE this file there.",
    ]
    for number, (name, ids) in enumerate(_with_all(elements), start=FIRST_SET):
        lines += [f"$ {_ascii(name)}", *_wrapped(f"SET {number} = ", ids)]
    return ("\n".join(lines) + "\n").encode("ascii")


def abaqus_sets(elements: Mapping[str, Sequence[int]], run: str) -> bytes:
    """*ELSET of all gauges, then one a gauge, GAUGE_ and its name; in a deck of parts they belong below the part."""
    lines = [
        f"** Elements below the gauges of the run {_ascii(run)}. Model data: *INCLUDE this file behind the elements."
    ]
    taken: set[str] = set()
    for name, ids in _with_all(elements):
        own = name if name == ALL else _set_name(f"GAUGE_{name}", taken)
        taken.add(own.upper())
        lines.append(f"*ELSET, ELSET={own}")
        lines += [", ".join(map(str, ids[i : i + A_LINE])) for i in range(0, len(ids), A_LINE)]
    return ("\n".join(lines) + "\n").encode("ascii")


def _with_all(elements: Mapping[str, Sequence[int]]) -> list[tuple[str, list[int]]]:
    every = sorted({i for ids in elements.values() for i in ids})
    return [(ALL, every), *((name, list(ids)) for name, ids in elements.items())]


def _wrapped(head: str, ids: Sequence[int]) -> list[str]:
    """Lines of at most 72 characters, each but the last ending with a comma."""
    lines = [head]
    for i, number in enumerate(ids):
        word = f"{number}{',' if i + 1 < len(ids) else ''}"
        if len(lines[-1]) + len(word) > WIDTH:
            lines.append(" " * 8)
        lines[-1] += word
    return lines


def _set_name(name: str, taken: set[str]) -> str:
    """Letters, digits, _ and -, which begin with a letter; apart from others, as case does not count."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", name)[:LONGEST]
    own, count = plain, 2
    while own.upper() in taken:
        own, count = f"{plain}-{count}", count + 1
    return own


def _ascii(text: str) -> str:
    return " ".join(text.encode("ascii", "replace").decode().split())[:60]

"""What a page quotes of its commands: the blocks behind `<!-- run -->`, and whether a quoted line is one that was printed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

TOLERANCE = 0.05
"""Of a quoted number, relative: quoted are few digits, and equal gauges are distinguished by the last ones."""


def blocks(text: str) -> list[str]:
    """The console blocks of a page that are run."""
    return re.findall(r"<!-- run -->\n```console\n(.*?)```", text, re.DOTALL)


def commands(block: str) -> Iterator[tuple[str, list[str]]]:
    """(command, the lines quoted below it), in order. Raises ValueError where a block does not begin with a command."""
    parts = re.split(r"^\$ (.+)$", block, flags=re.MULTILINE)
    if parts[0].strip():
        raise ValueError(f"a block begins with a command, and not with {parts[0].strip()!r}")
    for command, quoted in zip(parts[1::2], parts[2::2], strict=True):
        yield command, [line.strip() for line in quoted.splitlines() if line.strip()]


def missing(quoted: list[str], printed: str) -> list[str]:
    """The quoted lines that were not printed."""
    return [line for line in quoted if not any(within(line, other) for other in printed.splitlines())]


def within(quoted: str, printed: str) -> bool:
    """Whether the words of a quoted line stand in a printed one, one behind the other; … stands for any words."""
    there = printed.split()
    start = 0
    for part in quoted.split("…"):
        words = part.split()
        places = [at for at in range(start, len(there) - len(words) + 1) if _alike(words, there[at : at + len(words)])]
        if not places:
            return False
        start = places[0] + len(words)
    return True


def _alike(words: list[str], others: list[str]) -> bool:
    return all(_same(word, other) for word, other in zip(words, others, strict=True))


def _same(word: str, other: str) -> bool:
    try:
        a, b = float(word.rstrip(",:;")), float(other.rstrip(",:;"))
    except ValueError:
        return word.rstrip(",:;") == other.rstrip(",:;")
    counted = word.rstrip(",:;").isdigit()
    return a == b if counted else math.isclose(a, b, rel_tol=TOLERANCE)

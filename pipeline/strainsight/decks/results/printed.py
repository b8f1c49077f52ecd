"""Natural frequencies, and shapes where they are, from what a program prints: .f06 of Nastran, .dat of CalculiX.

Source: Nastran Quick Reference Guide, "R E A L   E I G E N V A L U E S" and "R E A L   E I G E N V E C T O R   N O ."; CalculiX
manual, *FREQUENCY, "E I G E N V A L U E   O U T P U T".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from strainsight.decks.numbers import parse_real
from strainsight.decks.results.checks import AGAIN, check_motion, natural_frequency, unsupported
from strainsight.decks.results.response import Response
from strainsight.decks.text import opened
from strainsight.errors import DeckError

ROUNDING = 5e-7
"""Of a number with seven digits."""
_LONGEST = 4096
"""[bytes] read as one line."""
_VECTOR = re.compile(r"REALEIGENVECTORNO\.(\d+)")
_SUBCASE = re.compile(r"\bSUBCASE\s+(\d+)")
_OTHER = {"COMPLEXEIGENVALUE": "complex eigenvalues", "BUCKLING": "buckling loads"}


@dataclass
class _Step:
    """Mode → eigenvalue [1/s²] with its line; mode → ids and rows of motion."""

    number: int
    eigenvalue: dict[int, tuple[float, int]] = field(default_factory=dict)
    motion: dict[int, dict[int, list[float]]] = field(default_factory=dict)


def printed_modes(path: Path) -> Iterator[Response]:
    """Every mode of the file, step by step; without shapes it has no nodes.

    The step is the subcase of Nastran, or counts the frequency steps of CalculiX. Shapes of an .f06 are along the axes of each
    node (CD); scalar points are left out. Raises DeckError with the line for what cannot be read, and for a file without modes.
    """
    is_f06 = ".f06" in (ending.lower() for ending in path.suffixes)
    steps = _of_nastran(path) if is_f06 else _of_calculix(path)
    found = [step for step in steps if step.eigenvalue]
    if not found:
        what = "R E A L   E I G E N V A L U E S" if is_f06 else "E I G E N V A L U E   O U T P U T"
        raise DeckError(
            f"the file has no table {what}",
            where=str(path),
            remedy="give the .f06 of a SOL 103 run, or the .dat of a *FREQUENCY step of CalculiX",
        )
    for step in found:
        for mode, (eigenvalue, line) in sorted(step.eigenvalue.items()):
            rows = step.motion.get(mode, {})
            ids = np.array(list(rows), dtype=np.int64)
            motion = np.array(list(rows.values())).reshape(-1, 6)
            where = f"{path}:{line}, step {step.number}, mode {mode}"
            check_motion(ids, motion, where)
            frequency = natural_frequency(eigenvalue)
            kept = {"along_node_axes": is_f06, "rounding": ROUNDING, "where": where}
            yield Response("mode", step.number, mode, ids, motion, frequency, **kept)  # type: ignore[arg-type]


def _lines(path: Path) -> Iterator[tuple[int, str, str]]:
    """Number, text, and text without blanks in capitals of every line."""
    with opened(path) as file:
        number = 0
        while line := file.readline(_LONGEST):
            number += 1
            if b"\0" in line or len(line) == _LONGEST:
                raise DeckError("no line of printed output", where=f"{path}:{number}", remedy="give the text file")
            text = line.decode("latin-1")
            yield number, text, "".join(text.split()).upper()


def _of_nastran(path: Path) -> list[_Step]:
    """Tables go on over pages, each with its title again; a title of other kind ends one."""
    steps: dict[int, _Step] = {}
    step, vector, table = _Step(1), 0, False
    for number, text, packed in _lines(path):
        if match := _SUBCASE.search(text):
            step = steps.setdefault(int(match[1]), _Step(int(match[1])))
        if packed.startswith("1") and text[:1] == "1":  # a new page
            vector, table = 0, False
        if match := _VECTOR.search(packed):
            vector, table = int(match[1]), False
        elif "REALEIGENVALUES" in packed:
            vector, table = 0, True
        elif other := next((what for title, what in _OTHER.items() if title in packed), None):
            raise unsupported(other, f"{path}:{number}")
        words = text.split()
        if table and len(words) == 7 and words[0].isdigit() and words[1].isdigit():
            own = steps.setdefault(step.number, step)
            own.eigenvalue.setdefault(int(words[0]), (_real(words[2], path, number), number))
        elif vector and len(words) == 8 and words[0].isdigit() and words[1] == "G":
            own = steps.setdefault(step.number, step)
            own.motion.setdefault(vector, {})[int(words[0])] = [_real(word, path, number) for word in words[2:]]
    return list(steps.values())


def _of_calculix(path: Path) -> list[_Step]:
    steps: list[_Step] = []
    table = False
    for number, text, packed in _lines(path):
        if "EIGENVALUEOUTPUT" in packed or "EIGENVALUENUMBER" in packed:
            steps.append(_Step(len(steps) + 1))
            table = True
        elif packed.startswith(("PARTICIPATION", "EFFECTIVE", "TOTAL")):
            table = False
        words = text.split()
        if table and len(words) == 5 and words[0].isdigit():
            if _real(words[4], path, number) != 0 and _real(words[1], path, number) >= 0:
                raise unsupported("complex frequencies", f"{path}:{number}")
            steps[-1].eigenvalue[int(words[0])] = (_real(words[1], path, number), number)
    return steps


def _real(word: str, path: Path, line: int) -> float:
    value = parse_real(word)
    if value is None:
        raise DeckError(f"{word!r} is no finite number", where=f"{path}:{line}", remedy=AGAIN)
    return value

"""Modes and static displacements of a Nastran OUTPUT2 file (.op2).

Source: DMAP Programmer's Guide, data blocks OUG (displacements) and LAMA (eigenvalues). A table of displacements is pairs of
records: 146 words that say what it is, then the rows: ten times the id of a point and its device, its type, six components.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strainsight.decks.text import opened
from strainsight.errors import DeckError
from strainsight.foreign.results.checks import AGAIN, check_frequency, check_motion, natural_frequency, unsupported
from strainsight.foreign.results.op2_records import Op2File, Record
from strainsight.foreign.results.response import Response

_DISPLACEMENTS = re.compile(r"(B?)O(?:UGV?|PHIG)[12]?(PAT)?")
"""Names of the tables. With B or PAT they are along the basic axes, otherwise along those of each node."""
_EIGENVALUES = "LAMA"
_DISPLACEMENT, _EIGENVECTOR = 1, 7
"""Codes of a table; 10 and 11 are velocities and accelerations."""
_MODE = 2
_STATIC = (1, 7, 10, 11, 12)
"""Codes of an analysis: linear, before buckling, nonlinear (three)."""
_OTHERS = {5: "a frequency response", 6: "a transient response", 8: "a buckling shape", 9: "a complex mode"}
_COMPLEX, _BY_NODE, _RANDOM = 1, 2, 4
"""Bits of a table code, in thousands: complex numbers; all steps of a node together (SORT2); statistics of a random response."""
_NODE = 1
"""Type of a point; others are scalar, extra, modal and fluid points."""
_HEAD, _ROW, _EIGENVALUE_ROW = 146, 8, 7
"""Words."""
_ROUNDING = {4: 6e-8, 8: 2e-16}
"""Of a number by the bytes of a word."""
_TITLES = ((114, 146), (82, 114), (50, 82))
"""Words of label, subtitle and title: the first that is there is the label of a response."""


def op2_responses(path: Path) -> Iterator[Response]:
    """Modes and static displacements of the file in its order; other tables, velocities and temperatures are passed over.

    The step is the subcase; where there are two tables of it, along the axes of each node and the basic ones, the first counts.
    A mode's frequency comes from its eigenvalue λ = ω², its modal mass from a table LAMA before it. Load steps of a nonlinear
    subcase count from 1.
    Raises DeckError for a damaged file, other kinds of displacements, and those written node by node (SORT2).
    """
    with opened(path) as file:
        op2 = Op2File(file, path)
        head: _Head | None = None
        masses: dict[tuple[int, float], float] = {}
        counts: Counter[int] = Counter()
        basic: dict[tuple[int, int], bool] = {}
        for record in op2.records(lambda name: name == _EIGENVALUES or _DISPLACEMENTS.fullmatch(name) is not None):
            if record.number % 2 == 1:
                head = _head(op2, record)
                continue
            if record.number == 0 or head is None:
                head = None
            elif record.table == _EIGENVALUES:
                masses |= _modal_masses(op2, record)
            elif head.is_displacement:
                own = _is_basic(record.table)
                if basic.setdefault((head.analysis, head.subcase), own) == own:
                    counts[head.subcase] += head.analysis != _MODE
                    yield _response(op2, record, head, masses, counts[head.subcase])
            head = None


class _Head(NamedTuple):
    """What a table holds: analysis and table by their codes, sort as bits, subcase, mode and its eigenvalue, words of a row."""

    analysis: int
    table: int
    sort: int
    subcase: int
    mode: int
    eigenvalue: float
    row: int
    thermal: int
    label: str

    @property
    def is_displacement(self) -> bool:
        return self.table in (_DISPLACEMENT, _EIGENVECTOR) and self.thermal != 1 and not self.sort & _RANDOM


def _head(op2: Op2File, record: Record) -> _Head:
    words = np.frombuffer(record.content, op2.integer)
    if len(words) != _HEAD:
        raise DeckError(
            f"record {record.number} of {record.table} has {len(words)} words, not {_HEAD}",
            where=record.where,
            remedy=AGAIN,
        )
    sort, table = divmod(int(words[1]), 1000)
    titles = (op2.text(record.content[first * op2.width : last * op2.width]) for first, last in _TITLES)
    return _Head(
        analysis=int(words[0]) // 10,
        table=table,
        sort=sort,
        subcase=int(words[3]),
        mode=int(words[4]),
        eigenvalue=float(np.frombuffer(record.content, op2.real)[5]),
        row=int(words[9]),
        thermal=int(words[22]),
        label=" ".join(next((title for title in titles if title), "").split()),
    )


def _is_basic(table: str) -> bool:
    """Are the motions of a table along the basic axes, and not along those of each node?"""
    name = _DISPLACEMENTS.fullmatch(table)
    return name is not None and any(name.groups())


def _response(
    op2: Op2File, record: Record, head: _Head, masses: dict[tuple[int, float], float], count: int
) -> Response:
    """count: of the static responses of its subcase, with this one."""
    is_mode = head.analysis == _MODE
    where = f"{record.where}, {record.table} of subcase {head.subcase}" + (f", mode {head.mode}" if is_mode else "")
    if head.analysis in _OTHERS or head.sort & _COMPLEX:
        raise unsupported(_OTHERS.get(head.analysis, "complex displacements"), where)
    if head.sort & _BY_NODE:
        raise DeckError(
            "the displacements are written node by node (SORT2)", where=where, remedy="ask for DISPLACEMENT(SORT1)"
        )
    if head.row != _ROW or (not is_mode and head.analysis not in _STATIC) or len(record.content) % (_ROW * op2.width):
        raise DeckError(
            f"{len(record.content)} bytes of rows of {head.row} words, of an analysis of code {head.analysis}",
            where=where,
            remedy=AGAIN,
        )
    row = np.dtype([("point", op2.integer), ("type", op2.integer), ("motion", op2.real, (6,))])
    rows = np.frombuffer(record.content, row)
    nodes = rows["type"] == _NODE
    ids = (rows["point"][nodes] // 10).astype(np.int64)
    motion = rows["motion"][nodes].astype(float)
    check_motion(ids, motion, where)
    frequency = natural_frequency(head.eigenvalue) if is_mode else 0.0
    check_frequency(frequency, where)
    return Response(
        "mode" if is_mode else "static",
        head.subcase,
        head.mode if is_mode else count,
        ids,
        motion,
        frequency,
        head.label,
        masses.get((head.mode, head.eigenvalue)) if is_mode else None,
        along_node_axes=not _is_basic(record.table),
        rounding=_ROUNDING[op2.width],
        scalar_points=int(np.count_nonzero(~nodes)),
        where=where,
    )


def _modal_masses(op2: Op2File, record: Record) -> dict[tuple[int, float], float]:
    """Mode and λ → ΦᵀMΦ of a table LAMA, whose rows are mode, order, λ, ω, f, ΦᵀMΦ and ΦᵀKΦ. λ tells whether it is that of the
    shape: a run may solve for eigenvalues twice."""
    count = len(record.content) // (_EIGENVALUE_ROW * op2.width)
    row = np.dtype([("mode", op2.integer), ("order", op2.integer), ("values", op2.real, (5,))])
    rows = np.frombuffer(record.content, row, count)
    values = rows["values"].astype(float)
    return dict(zip(zip(rows["mode"].tolist(), values[:, 0].tolist(), strict=True), values[:, 3].tolist(), strict=True))

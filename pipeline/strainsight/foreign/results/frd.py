"""Responses in a file of results of CalculiX (.frd): displacements of static and frequency steps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from strainsight.decks.faults import IdTable
from strainsight.decks.frd import (
    DAMAGE,
    FREQUENCY,
    STATIC,
    Block,
    NodeTable,
    blocks,
    no_number,
    node_ids,
    skip_rows,
    table,
)
from strainsight.decks.text import opened
from strainsight.errors import DeckError
from strainsight.foreign.results.response import Response

ROUNDING = {0: 5e-6, 1: 5e-6, 2: 6e-8, 3: 2e-16}
"""Largest relative error of a number by the format of its block: text has six digits."""


def frd_responses(path: Path) -> Iterator[Response]:
    """Every block DISP of the static and frequency steps of the file, in its order.

    Raises DeckError for a file that is cut off or damaged, for numbers that are not finite, and for other kinds of steps that
    have displacements (dynamic, buckling, complex frequencies).
    """
    try:
        yield from _responses(path)
    except DAMAGE:
        raise no_number(str(path)) from None


def _responses(path: Path) -> Iterator[Response]:
    nodes: list[NodeTable] = []
    known: tuple[bytes, np.ndarray, np.ndarray | None] = (b"", np.zeros(0, dtype=np.int64), None)
    with opened(path) as file:
        for block, where in blocks(file, path, nodes):
            if block.name != b"DISP":
                skip_rows(file, block, where)
                continue
            raw, motion = table(file, block, where)
            if raw != known[0]:
                ids = node_ids(raw, block.format)
                known = raw, ids, _positions(nodes, ids)
            yield replace(_response(block, known[1], motion, where), position=known[2])


def _positions(nodes: list[NodeTable], ids: np.ndarray) -> np.ndarray | None:
    """Positions (n, 3) of these nodes; NaN of a node, and None where the file has none."""
    if not nodes:
        return None
    table = IdTable(np.concatenate([own.ids for own in nodes]))
    rows, missing = table.rows(ids)
    return np.where(missing[:, None], np.nan, np.concatenate([own.position for own in nodes])[rows])


def _response(block: Block, ids: np.ndarray, motion: np.ndarray, where: str) -> Response:
    step, rounding = int(block.parameters[b"STEP"][2]), ROUNDING[block.format]
    if motion.shape[1] < 3 or not np.isfinite(motion).all():
        raise DeckError(
            f"the displacements of step {step} are no three finite numbers at every node",
            where=where,
            remedy="look at the output of the run, and write the results again (*NODE FILE, U)",
        )
    if block.analysis == STATIC:
        increment = int(block.parameters[b"STEP"][1])
        return Response("static", step, increment, ids, motion[:, :3], rounding=rounding, where=f"{where}, step {step}")
    if block.analysis != FREQUENCY or b"MODE" not in block.parameters:
        raise DeckError(
            f"step {step} is neither static nor a frequency step",
            where=where,
            remedy="write results of *STATIC and *FREQUENCY steps alone",
        )
    mode = int(block.parameters[b"MODE"][0])
    mass = block.parameters.get(b"GM")
    frequency, stiffness = block.value, block.parameters.get(b"GK")
    if stiffness is not None and float(stiffness[0]) < 0:
        frequency = -abs(frequency)
    return Response(
        "mode",
        step,
        mode,
        ids,
        motion[:, :3],
        frequency,
        modal_mass=float(mass[0]) if mass else None,
        rounding=rounding,
        where=f"{where}, step {step}, mode {mode}",
    )

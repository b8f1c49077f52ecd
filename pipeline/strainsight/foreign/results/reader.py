"""Read modes and static responses from any result file, one after the other; with readers of .frd, universal and VTU files.

A universal file has lines of -1 around every dataset; after its header, each node has two lines: its number, and its
values in columns of 13. Source: the UFF pages of the University of Cincinnati (SDRL)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from strainsight.decks.frd import (
    DAMAGE,
    FREQUENCY,
    STATIC,
    Block,
    NodeTable,
    blocks,
    node_ids,
    skip_rows,
    table,
    unreadable_line,
)
from strainsight.decks.other.load import load_sandboxed
from strainsight.decks.other.mesh import NODE_IDS, numbers_of
from strainsight.decks.text import UNPACKING, check_plain, damage_error, error_at, open_file, parse_integer, parse_real
from strainsight.foreign.results.ansys import ansys_responses
from strainsight.foreign.results.nastran import op2_responses, punch_responses
from strainsight.foreign.results.response import Response, integers, pad_line, reals, unsupported_error
from strainsight.measurements.uff58_file import is_mark
from strainsight.mesh.model import IdTable

ROUNDING = {0: 5e-6, 1: 5e-6, 2: 6e-8, 3: 2e-16}
"""Format of a block → largest relative error of a number: text has six digits."""


def frd_responses(path: Path) -> Iterator[Response]:
    """Every block DISP of the static and frequency steps of the file, in order. Raises DeckError for a file that is truncated or
    damaged, for numbers that are not finite, and for displacements of other steps (dynamic, buckling, complex frequencies)."""
    try:
        yield from _responses(path)
    except DAMAGE:
        raise unreadable_line(str(path)) from None


def _responses(path: Path) -> Iterator[Response]:
    nodes: list[NodeTable] = []
    known: tuple[bytes, np.ndarray, np.ndarray | None] = (b"", np.zeros(0, dtype=np.int64), None)
    with open_file(path) as file:
        for block, where in blocks(file, path, nodes):
            if block.name != b"DISP":
                skip_rows(file, block, where)
                continue
            raw, motion = table(file, block, where)
            if raw != known[0]:
                ids = node_ids(raw, block.format)
                known = raw, ids, _positions(nodes, ids)
            yield _response(block, known[1], motion, where, known[2])


def _positions(nodes: list[NodeTable], ids: np.ndarray) -> np.ndarray | None:
    """Positions (n, 3) of these nodes; NaN for missing nodes, None if the file has no positions."""
    if not nodes:
        return None
    rows, missing = IdTable(np.concatenate([node_table.ids for node_table in nodes])).rows(ids)
    return np.where(missing[:, None], np.nan, np.concatenate([node_table.position for node_table in nodes])[rows])


def _response(block: Block, ids: np.ndarray, motion: np.ndarray, where: str, position: np.ndarray | None) -> Response:
    step, rounding = int(block.parameters[b"STEP"][2]), ROUNDING[block.format]
    if motion.shape[1] < 3 or not np.isfinite(motion).all():
        raise error_at(
            where,
            f"the displacements of step {step} do not have three finite numbers at every node",
            "check the output of the run, and write the results again (*NODE FILE, U)",
        )
    if block.analysis == STATIC:
        increment, where = int(block.parameters[b"STEP"][1]), f"{where}, step {step}"
        return Response(
            "static", step, increment, ids, motion[:, :3], rounding=rounding, where=where, position=position
        )
    if block.analysis != FREQUENCY or b"MODE" not in block.parameters:
        raise error_at(
            where,
            f"step {step} is neither static nor a frequency step",
            "write only results of *STATIC and *FREQUENCY steps",
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
        position=position,
    )


_LONGEST = 4096
"""Longest line [bytes]; text lines have 80."""
_WIDTH, _ID, _NUMBER = 78, 10, 13
"""Columns of a line of values, of a node number, and of a value."""
_UNIVERSAL_ROUNDING = 5e-6
"""Relative rounding error of a number with six digits."""
_OTHERS = {
    3: "complex modes",
    4: "a transient response",
    5: "a frequency response",
    6: "a buckling shape",
    7: "complex modes",
}
_UNIVERSAL_STATIC, _UNIVERSAL_MODE, _NONLINEAR = 1, 2, 9
_REAL = (2, 4)
_VECTORS = {2: 3, 3: 6}
"""Data characteristic → values per node: translations, or with rotations."""
_AT_NODES = 1
_DISPLACEMENT = 8
_SHAPED = (2, 3, 7)
"""Analysis types with real or complex shapes."""
_SHAPES = (0, 1, _DISPLACEMENT, 11, 12, 95, 96)
"""Data types of a mode shape: unknown, general, displacement, velocity, acceleration."""
_NONE = ("", "NONE")


class _Layout(NamedTuple):
    """Lines of a header; positions of its titles, parameters, integers, reals and location (from 0; None: always
    nodes); fields of load case and mode among the integers, of frequency and modal mass among the reals."""

    lines: int
    titles: slice
    parameters: int
    integers: int
    reals: int
    location: int | None
    load_case: int
    mode: int
    frequency: int
    mass: int


_LAYOUTS = {
    "55": _Layout(8, slice(0, 5), 5, 6, 7, None, 2, 3, 0, 1),
    "2414": _Layout(13, slice(3, 8), 8, 9, 11, 2, 4, 5, 1, 3),
}

"""Dataset number → header layout."""


class _Dataset(NamedTuple):
    """A dataset: its lines of _WIDTH columns each, and the number of the first line in the file."""

    layout: _Layout
    lines: bytearray
    number: int


def universal_responses(path: Path) -> Iterator[Response]:
    """Mode shapes and static displacements at nodes, in file order; other datasets are skipped.

    The step is the load case (dataset 55) or the load set (2414), 1 if it is 0; static responses of a step are
    numbered from 1. They are along the basic axes, as the format requires. Raises DeckError with file:line for
    datasets without end, unreadable numbers, and for complex, transient, frequency and buckling results."""
    counts: Counter[int] = Counter()
    for dataset in _datasets(path):
        if (response := _universal_response(dataset, counts, path)) is not None:
            yield response


def _datasets(path: Path) -> Iterator[_Dataset]:
    """Datasets 55 and 2414, one in memory at a time."""
    number = 0
    with open_file(path) as file:
        while line := file.readline(_LONGEST):
            number += 1
            if not line.strip():
                continue
            if not is_mark(line):
                raise error_at(
                    f"{path}:{number}",
                    "expected the start of a dataset",
                    "use a universal file, which has lines of -1 around every dataset, or export it again",
                )
            kind = file.readline(_LONGEST)[:6].strip().decode("latin-1")
            number += 1
            layout, first, lines = _LAYOUTS.get(kind), number + 1, bytearray()
            while not is_mark(line := file.readline(_LONGEST)):
                number += 1
                if not line:
                    raise damage_error(f"the file ends inside dataset {kind}", f"{path}:{number}")
                if layout is not None:
                    lines.extend(pad_line(line, _WIDTH))
            number += 1
            if layout is not None:
                yield _Dataset(layout, lines, first)


def _universal_response(dataset: _Dataset, counts: Counter[int], path: Path) -> Response | None:
    """The response of a dataset; None unless it contains displacement vectors at nodes."""
    layout, lines, where = dataset.layout, dataset.lines, f"{path}:{dataset.number}"
    if (line_count := len(lines) // _WIDTH) < layout.lines:
        raise damage_error(f"the header of the dataset has {line_count} lines instead of {layout.lines}", where)
    head = [lines[row * _WIDTH : (row + 1) * _WIDTH].decode("latin-1") for row in range(layout.lines)]
    _, analysis, characteristic, kind, data, count = _integers(head[layout.parameters], 6, where)
    if layout.location is not None and _integers(head[layout.location], 1, where)[0] != _AT_NODES:
        return None
    if characteristic not in _VECTORS or kind not in (_SHAPES if analysis in _SHAPED else (_DISPLACEMENT,)):
        return None
    if analysis not in (_UNIVERSAL_STATIC, _UNIVERSAL_MODE, _NONLINEAR) or data not in _REAL:
        raise unsupported_error(
            _OTHERS.get(analysis, "complex results" if data > 4 else f"an analysis of type {analysis}"), where
        )
    if count != _VECTORS[characteristic]:
        raise damage_error(f"the vectors at the nodes have {count} values instead of {_VECTORS[characteristic]}", where)
    integers_, reals_ = _integers(head[layout.integers], 8, where), _reals(head[layout.reals], where)
    step = integers_[layout.load_case] or 1
    is_mode = analysis == _UNIVERSAL_MODE
    counts[step] += not is_mode
    frequency = reals_[layout.frequency] if is_mode else 0.0
    ids, motion = _rows(dataset, count, path)
    return Response(
        "mode" if is_mode else "static",
        step,
        integers_[layout.mode] if is_mode else counts[step],
        ids,
        motion,
        frequency,
        next((title for line in head[layout.titles] if (title := line.strip()) not in _NONE), ""),
        (reals_[layout.mass] or None) if is_mode else None,
        rounding=_UNIVERSAL_ROUNDING,
        where=where,
    )


def _integers(line: str, count: int, where: str) -> list[int]:
    """The first `count` integers of a header line, 0 if it is shorter."""
    values = [parse_integer(word) for word in line.split()[:count]]
    if None in values:
        raise damage_error(f"{line.strip()!r} is a header line with an invalid integer", where)
    return [value for value in values if value is not None] + [0] * (count - len(values))


def _reals(line: str, where: str) -> list[float]:
    """Six numbers of a header line, 0 if it is shorter."""
    words = [line[at : at + _NUMBER].strip() for at in range(0, _WIDTH, _NUMBER)]
    values = [parse_real(word or "0") for word in words]
    if None in values:
        raise damage_error(f"{line.strip()!r} is a header line with an invalid number", where)
    return [value for value in values if value is not None]


def _rows(dataset: _Dataset, count: int, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Ids (n,) and values (n, count)."""
    first = dataset.layout.lines
    number = dataset.number + first
    text = np.frombuffer(dataset.lines, np.uint8).reshape(-1, _WIDTH)[first:]
    if len(text) % 2:
        raise damage_error("a node has no values", f"{path}:{number + len(text)}")
    return (
        integers(text[::2, :_ID], lambda row: f"{path}:{number + 2 * row}"),
        reals(text[1::2, : count * _NUMBER], _NUMBER, lambda row: f"{path}:{number + 2 * row + 1}"),
    )


_MODE = re.compile(
    r"(?:(?:u|disp|displacements?)[ _-]+)?(?:eigenvector|(?:eigen)?mode(?:[ _-]?shape)?)[ _-]*(?P<number>\d+)"
    r"(?:[ ,:(@=_-]+(?P<hertz>\d+\.?\d*(?:e[-+]?\d+)?) *Hz\)?)?",
    re.IGNORECASE,
)
"""mode_1, Mode 1 (12.5 Hz), eigenvector3, displacement_mode_2."""
_STATIC = re.compile(r"(?:u|disp|displacements?|static)[ _-]*(?P<number>\d*)", re.IGNORECASE)
"""U, displacement, disp_2, static 3."""
_FREQUENCIES = ("frequencies", "frequency", "eigenfrequencies", "natural_frequencies")
"""Names of field data with the frequencies [Hz] of all modes, in any case."""
_ROUNDING = {4: 6e-8, 8: 2e-16}
"""Bytes of a number → relative rounding error."""


def vtu_responses(path: Path) -> Iterator[Response]:
    """Point data of three or six components with names of modes or displacements, in file order.

    "mode_1" is mode 1 of step 1; its frequency is part of the name, "mode_1 12.5 Hz", or entry 1 of the field data
    "frequencies" [Hz]; "displacement" and "displacement_2" are static steps 1 and 2. Other data are skipped. Node
    numbers are those of a mesh file of these formats. The whole file is read into memory. Raises DeckError for a file
    that cannot be read, and a mode without frequency."""
    with path.open("rb"):
        pass
    raw = load_sandboxed(path).mesh
    ids, _ = numbers_of(raw.point_data, NODE_IDS, len(np.asarray(raw.points)), "node", [])
    for name, values in raw.point_data.items():
        mode = _MODE.fullmatch(name)
        match = mode or _STATIC.fullmatch(name)
        motion = np.asarray(values)
        if match is None or motion.ndim != 2 or motion.shape[1] not in (3, 6) or motion.dtype.kind != "f":
            continue
        where = f"{path}, {name}"
        number = int(match["number"] or 1)
        yield Response(
            "mode" if mode else "static",
            1 if mode else number,
            number if mode else 1,
            ids,
            motion.astype(float),
            _frequency(mode, number, raw.field_data, where) if mode else 0.0,
            name,
            rounding=_ROUNDING.get(motion.dtype.itemsize, 1e-3),
            where=where,
            position=np.asarray(raw.points, dtype=float),
        )


def _frequency(mode: re.Match[str], number: int, field_data: dict[str, Any], where: str) -> float:
    """Frequency of a mode from its name or from the field data."""
    if mode["hertz"]:
        return float(mode["hertz"])
    known = [np.ravel(values) for key, values in field_data.items() if key.lower() in _FREQUENCIES]
    if not known or not 0 < number <= len(known[0]) or known[0].dtype.kind not in "fiu":
        raise error_at(
            where,
            f"mode {number} has no frequency",
            f'name the data array "mode_{number} 12.5 Hz", or write all frequencies [Hz] as field data "frequencies"',
        )
    return float(known[0][number - 1])


Reader = Callable[[Path], Iterator[Response]]
READERS: dict[str, Reader] = {
    ".frd": frd_responses,
    ".op2": op2_responses,
    ".pch": punch_responses,
    ".rst": ansys_responses,
    ".unv": universal_responses,
    ".uff": universal_responses,
    ".vtu": vtu_responses,
    ".vtk": vtu_responses,
}
"""Ending of the name, without .gz → reader."""


def read_responses(path: Path, readers: Mapping[str, Reader] = READERS) -> Iterator[Response]:
    """The modes and static responses of a file in order; only one is in memory, so the file may be larger than the memory.

    The ending of the name, without .gz, selects the reader. Raises DeckError for an unknown ending, a file that is
    missing, damaged or not a plain file, and errors of the reader."""
    path = Path(path)
    endings = (ending.lower() for ending in reversed(path.suffixes))
    reader = readers.get(next((ending for ending in endings if ending != ".gz"), ""))
    if reader is None:
        raise error_at(path, f"{path.name} is not a known result file", f"use one of the endings {', '.join(readers)}")
    try:
        check_plain(path)
        yield from reader(path)
    except FileNotFoundError:
        raise error_at(path, "no such file", "correct the file name or the folder") from None
    except UNPACKING as error:
        raise error_at(path, f"the file cannot be unpacked: {error}", "compress the file again") from None
    except OSError as error:
        raise error_at(path, f"the file cannot be read: {error.strerror}", "check that the file is readable") from None

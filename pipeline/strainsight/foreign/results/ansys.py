"""Modes and static displacements of an Ansys result file (.rst), read by ansys-mapdl-reader in a child process."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from strainsight.child_reader import Message, answer, child_reader, reason
from strainsight.decks.text import damage_error, error_at
from strainsight.errors import DeckError
from strainsight.foreign.results.response import Response, unsupported_error
from strainsight.processes import python

TIME_LIMIT = 20.0
"""Time limit [s] for every response, plus one second for every 5 MB of the file."""
MEMORY_LIMIT = 1 << 30
"""Memory limit [bytes] for reading, plus MEMORY_A_BYTE for every byte of the file."""
MEMORY_A_BYTE = 20
_PLAIN = [field.name for field in fields(Response) if field.name not in ("node_ids", "motion", "position")]
"""Fields of a response that are not arrays."""


def responses_in_child_process(path: Path) -> Iterator[Response]:
    """Read `responses` in a child process, one at a time, from a copy, because the library opens the file for writing. Raises
    the same DeckError, and one if the process fails."""
    limit = TIME_LIMIT + path.stat().st_size / 5e6
    failure = damage_error(f"the package {PACKAGE} crashed or took too long to read the file", str(path))
    with TemporaryDirectory() as folder:
        try:
            copy = copyfile(path, Path(folder) / path.name)
        except OSError as error:
            what = f"the file cannot be copied to the temporary folder {folder}: {error.strerror or error}"
            raise error_at(path, what, "free some space in this folder, or set TMPDIR to another folder") from None
        with child_reader(COMMAND, [str(path), str(copy)], failure) as receive:
            while (message := receive(limit))[0]:
                plain, (ids, motion) = message
                yield Response(node_ids=ids, motion=motion, **plain)


def messages(path: Path, copy: Path) -> Iterator[Message]:
    """In the child process: `responses`, and an empty message after the last one."""
    try:
        for response in responses(path, copy):
            yield {name: getattr(response, name) for name in _PLAIN}, [response.node_ids, response.motion]
    except DeckError:
        raise
    except MemoryError:
        what = f"reading the file with {PACKAGE} requires too much memory for the size of the file"
        raise damage_error(what, str(path)) from None
    except Exception as error:
        raise damage_error(f"{PACKAGE} cannot read the file: {reason(error)}", str(path)) from None
    yield {}, []


MODULE = "ansys.mapdl.reader"
PACKAGE = "ansys-mapdl-reader"
EXTRA = "results"
COMMAND = python("strainsight.foreign.results.ansys")
_STATIC, _MODAL = 0, 2
_OTHERS = {1: "a buckling analysis", 3: "a harmonic analysis", 4: "a transient analysis"}
_TRANSLATIONS, _ROTATIONS = ["UX", "UY", "UZ"], ["ROTX", "ROTY", "ROTZ"]
_DOUBLE = 2e-16
"""Relative rounding error of a displacement, which the file stores in double precision."""


def ansys_responses(path: Path) -> Iterator[Response]:
    """Modes or static displacements of the file, along the global Cartesian axes.

    The step is the load step; the number of a mode or static result is its substep. Raises DeckError if the library
    is not installed, for other analyses, cyclic and complex results, and a damaged file."""
    with path.open("rb"):
        pass
    if not _installed():
        raise error_at(
            path,
            f"Ansys result files require {PACKAGE}, which is not installed",
            f'install it: pip install "strainsight[{EXTRA}]"',
        )
    yield from responses_in_child_process(path)


def _installed() -> bool:
    try:
        return find_spec(MODULE) is not None
    except ModuleNotFoundError:
        return False


def responses(path: Path, copy: Path) -> Iterator[Response]:
    """Read the responses in this process, from a copy of the file; the library may raise any exception."""
    from ansys.mapdl.reader import read_binary

    result = read_binary(copy)
    head: dict[str, Any] = result._resultheader
    analysis = int(head["kan"])
    if result._is_cyclic or head["cpxrst"]:
        raise unsupported_error("a cyclic analysis" if result._is_cyclic else "complex results", str(path))
    if analysis not in (_STATIC, _MODAL):
        raise unsupported_error(_OTHERS.get(analysis, f"an analysis of type {analysis}"), str(path))
    for row in range(int(result.n_results)):
        step, substep = (int(number) for number in head["ls_table"][row][:2])
        yield _response(result, row, analysis == _MODAL, step, substep, path)


def _response(result: Any, row: int, is_mode: bool, step: int, substep: int, path: Path) -> Response:
    where = f"{path}, load step {step}, substep {substep}"
    names = list(result.result_dof(row))
    if missing := [name for name in _TRANSLATIONS if name not in names]:
        raise error_at(
            where,
            f"the result lacks the displacements {', '.join(missing)}",
            "use results of a three-dimensional structure",
        )
    rotations = _ROTATIONS if all(name in names for name in _ROTATIONS) else []
    ids, values = result.nodal_solution(row)
    return Response(
        ("static", "mode")[is_mode],
        step,
        substep,
        np.asarray(ids, dtype=np.int64),
        np.asarray(values, dtype=float)[:, [names.index(name) for name in (*_TRANSLATIONS, *rotations)]],
        float(result.time_values[row]) if is_mode else 0.0,
        str(result._resultheader.get("title", "")).strip(),
        rounding=_DOUBLE,
        where=where,
    )


if __name__ == "__main__":
    answer(
        lambda arguments: messages(*map(Path, arguments)),
        [MODULE],
        lambda arguments: MEMORY_LIMIT + MEMORY_A_BYTE * Path(arguments[0]).stat().st_size,
        lambda arguments: str(Path(arguments[1]).parent),
    )

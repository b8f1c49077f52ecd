"""Modes and static displacements of an Ansys result file (.rst), by ansys-mapdl-reader in a child process."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.errors import DeckError
from strainsight.foreign.results.apart import answer, responses_apart
from strainsight.foreign.results.checks import check_frequency, check_motion, unsupported
from strainsight.foreign.results.response import Response
from strainsight.processes import python

MODULE = "ansys.mapdl.reader"
PACKAGE = "ansys-mapdl-reader"
EXTRA = "results"
COMMAND = python("strainsight.foreign.results.ansys")
_STATIC, _MODAL = 0, 2
_OTHERS = {1: "a buckling analysis", 3: "a harmonic analysis", 4: "a transient analysis"}
_TRANSLATIONS, _ROTATIONS = ["UX", "UY", "UZ"], ["ROTX", "ROTY", "ROTZ"]
_DOUBLE = 2e-16
"""Relative rounding of a displacement, which the file holds in double precision."""


def ansys_responses(path: Path) -> Iterator[Response]:
    """Modes or static displacements of the file, along the global Cartesian axes.

    The step is the load step; a mode's number, and that of a static result, is its substep.
    Raises DeckError where the library is not installed, for other analyses, cyclic and complex results, and a damaged file.
    """
    with path.open("rb"):
        pass
    if not _installed():
        raise DeckError(
            f"an Ansys result file is read by {PACKAGE}, which is not installed",
            where=str(path),
            remedy=f'install it: pip install "strainsight[{EXTRA}]"',
        )
    yield from responses_apart(COMMAND, path, PACKAGE)


def _installed() -> bool:
    try:
        return find_spec(MODULE) is not None
    except ModuleNotFoundError:
        return False


def responses(path: Path, copy: Path) -> Iterator[Response]:
    """The same in this process, from a copy of the file; the library raises whatever it likes."""
    from ansys.mapdl.reader import read_binary

    result = read_binary(copy)
    head: dict[str, Any] = result._resultheader
    analysis = int(head["kan"])
    if result._is_cyclic or head["cpxrst"]:
        raise unsupported("a cyclic analysis" if result._is_cyclic else "complex results", str(path))
    if analysis not in (_STATIC, _MODAL):
        raise unsupported(_OTHERS.get(analysis, f"an analysis of type {analysis}"), str(path))
    for row in range(int(result.n_results)):
        step, substep = (int(number) for number in head["ls_table"][row][:2])
        yield _response(result, row, analysis == _MODAL, step, substep, path)


def _response(result: Any, row: int, is_mode: bool, step: int, substep: int, path: Path) -> Response:
    where = f"{path}, load step {step}, substep {substep}"
    names = list(result.result_dof(row))
    if missing := [name for name in _TRANSLATIONS if name not in names]:
        raise DeckError(
            f"a result without {', '.join(missing)}",
            where=where,
            remedy="give results of a structure in three dimensions",
        )
    rotations = _ROTATIONS if all(name in names for name in _ROTATIONS) else []
    ids, values = result.nodal_solution(row)
    motion = np.asarray(values, dtype=float)[:, [names.index(name) for name in (*_TRANSLATIONS, *rotations)]]
    frequency = float(result.time_values[row]) if is_mode else 0.0
    check_motion(np.asarray(ids, dtype=np.int64), motion, where)
    check_frequency(frequency, where)
    return Response(
        "mode" if is_mode else "static",
        step,
        substep,
        np.asarray(ids, dtype=np.int64),
        motion,
        frequency,
        str(result._resultheader.get("title", "")).strip(),
        rounding=_DOUBLE,
        where=where,
    )


if __name__ == "__main__":
    answer(responses, PACKAGE, MODULE)

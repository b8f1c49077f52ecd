"""Modes and static displacements of an Ansys result file (.rst), by ansys-mapdl-reader in a child process."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import IO, Any

import numpy as np

from strainsight.errors import DeckError
from strainsight.foreign.results.response import AGAIN, Response, check_frequency, check_motion, unsupported
from strainsight.processes import START_LIMIT, asked_of_reader, limit_memory, python, reader

TIME_LIMIT = 20.0
"""[s] for every response, and one more for every 5 MB of the file."""
MEMORY_LIMIT = 1 << 30
"""[bytes] that reading may take, and MEMORY_A_BYTE more for every one of the file."""
MEMORY_A_BYTE = 20
_PLAIN = [field.name for field in fields(Response) if field.name not in ("node_ids", "motion", "position")]
"""What of a response goes into a line of JSON; its arrays follow."""


def responses_apart(command: Sequence[str], path: Path, library: str) -> Iterator[Response]:
    """What `answer` in a child process reads, one at a time, from a copy: the library opens it for writing, too.

    Raises DeckError as it does, and where the process fails.
    """
    limit = TIME_LIMIT + path.stat().st_size / 5e6

    def received(stream: IO[bytes]) -> Response | None:
        return _received(stream, path, library)

    with TemporaryDirectory() as folder:
        try:
            copy = copyfile(path, Path(folder) / path.name)
        except OSError as error:
            what = f"cannot be copied to the temporary folder {folder}: {error.strerror or error}"
            raise DeckError(
                what, where=str(path), remedy="free some space there, or set TMPDIR to another folder"
            ) from None
        with reader(command, [str(path), str(copy)], START_LIMIT) as within:
            while (response := within(limit, received)) is not None:
                yield response


def _received(stream: IO[bytes], path: Path, library: str) -> Response | None:
    """The next response; None where that was the last."""
    line = stream.readline()
    said = json.loads(line) if line.endswith(b"\n") else {}
    if "what" in said:
        raise DeckError(said["what"], where=said["where"], remedy=said["remedy"])
    if said.get("end"):
        return None
    n, k = said.pop("shape", (0, 0))
    ids, motion = stream.read(8 * n), stream.read(8 * n * k)
    if not said or len(motion) < 8 * n * k:
        raise DeckError(f"{library} crashed, or did not come to an end", where=str(path), remedy=AGAIN)
    return Response(
        node_ids=np.frombuffer(ids, np.int64), motion=np.frombuffer(motion, np.float64).reshape(n, k), **said
    )


def answer(read: Callable[[Path, Path], Iterator[Response]], library: str, *modules: str) -> None:
    """In the child process: what `read` gives of a file and its copy, with the modules imported before."""
    path, copy = map(Path, asked_of_reader(*modules, writable=lambda asked: os.path.dirname(asked[1])))
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what a library prints is no answer
    limit_memory(MEMORY_LIMIT + MEMORY_A_BYTE * path.stat().st_size)
    try:
        for response in read(path, copy):
            said = {name: getattr(response, name) for name in _PLAIN}
            out.write(json.dumps(said | {"shape": response.motion.shape}).encode() + b"\n")
            out.write(np.ascontiguousarray(response.node_ids, dtype=np.int64).data)
            out.write(np.ascontiguousarray(response.motion, dtype=np.float64).data)
            out.flush()
        end: dict[str, object] = {"end": True}
    except DeckError as error:
        end = {"what": error.what, "where": error.where, "remedy": error.remedy}
    except MemoryError:
        end = {
            "what": f"reading it with {library} takes more memory than a file of its size may",
            "where": str(path),
            "remedy": AGAIN,
        }
    except Exception as error:  # the libraries have no classes of their own for damaged files
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        end = {"what": f"cannot be read by {library}: {reason}", "where": str(path), "remedy": AGAIN}
    out.write(json.dumps(end).encode() + b"\n")
    out.flush()


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

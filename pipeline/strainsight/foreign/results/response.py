"""Mode shapes and static responses of other programs, and natural frequencies in printed output.

Source: Nastran Quick Reference Guide, tables of real eigenvalues and real eigenvectors. CalculiX manual, *FREQUENCY,
eigenvalue output."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np

from strainsight.decks.faults import find_duplicate
from strainsight.decks.text import damage_error, error_at, open_file, parse_integer, parse_real
from strainsight.errors import DeckError, UserError
from strainsight.mesh.thin import FloatArray, IntArray


@dataclass(frozen=True)
class Response:
    """Motion of nodes in a mode or under a static load, in the units of its file.

    kind; step: number of the step, subcase or data set in the config, from 1; number: of the mode within its step,
    from 1, and 1 for a static response; node_ids (n,) of the file, unique, in any order; motion (n, 3) translations
    [length of the file], or (n, 6) with rotations [rad]; frequency [Hz] of a mode, −√|ω²|/2π if ω² < 0, 0 for a static
    response; label: title of the step or subcase, "" if missing; modal_mass: ΦᵀMΦ [mass of the file, times length² if
    the shape is a length], if the file defines it; along_node_axes: the motion is along the displacement axes of each
    node (CD of a GRID) instead of the basic axes; rounding: largest relative error of a number, 5e-6 for 1.23457E+00,
    6e-8 in single precision, 1e-16 in double; scalar_points: number of scalar and fluid points that are left out;
    where: file and step, or line, for messages; position (n, 3) of the nodes along the basic axes, if available.
    Raises DeckError for a repeated node, and for motions and frequencies that are not finite."""

    kind: Literal["mode", "static"]
    step: int
    number: int
    node_ids: IntArray
    motion: FloatArray
    frequency: float = 0.0
    label: str = ""
    modal_mass: float | None = None
    along_node_axes: bool = False
    rounding: float = 6e-8
    scalar_points: int = 0
    where: str = ""
    position: FloatArray | None = None

    def __post_init__(self) -> None:
        if (pair := find_duplicate(self.node_ids)) is not None:
            raise damage_error(f"the displacements of node {self.node_ids[pair[1]]} occur twice", self.where)
        finite = np.isfinite(self.motion).all(axis=1)
        if not finite.all():
            row = int(np.argmin(finite))
            raise DeckError(
                f"the motion of node {self.node_ids[row]} is not finite: "
                f"{', '.join(f'{value:g}' for value in self.motion[row])}",
                where=self.where,
                remedy="check the analysis that wrote this file for errors, and export the file again",
            )
        if not math.isfinite(self.frequency):
            raise damage_error(f"the frequency of the mode is not finite: {self.frequency:g}", self.where)


def natural_frequency(eigenvalue: float) -> float:
    """f = √λ/2π [Hz] of an eigenvalue λ = ω² [1/s²]; −√|λ|/2π if it is negative."""
    return math.copysign(math.sqrt(abs(eigenvalue)) / math.tau, eigenvalue)


def unsupported_error(what: str, where: str) -> DeckError:
    """Error for an unsupported kind of result."""
    return error_at(
        where,
        f"the file contains {what}, but only real modes and static responses are supported",
        "write real normal modes or static displacements to a separate file",
    )


RIGID = 1e-4
"""Ratio to the highest frequency below which a mode is a rigid-body mode."""
UNIT = 0.02
"""Deviation of ΦᵀMΦ from one that integration or mass lumping of a program may cause."""
OFF = 0.1
"""Difference of ΦᵀMΦ between mesh and file above which they are different models."""


def check_modes(frequency: np.ndarray, where: tuple[str, ...]) -> None:
    """Raise UserError unless every mode (m,) [Hz] has stiffness."""
    if (rigid := np.flatnonzero(~(frequency > RIGID * frequency.max(initial=0.0)))).size:
        raise UserError(
            f"the structure is free or unstable: a mode is at {frequency[rigid[0]]:.4g} Hz, below {RIGID:g} times the highest "
            f"frequency {frequency.max():.4g} Hz (modes below this limit: {rigid.size})",
            where=where[int(rigid[0])],
            remedy="add the supports of the test, or soft springs, to the analysis, and export modes and responses again",
        )


def normalising_mass(file_mass: np.ndarray | None, mesh_mass: np.ndarray | None) -> tuple[np.ndarray, list[str]]:
    """ΦᵀMΦ (m,) [kg m²] that normalises the shapes, and a note on its source. file_mass: from the file or the config; mesh_mass:
    from the mesh. Raises UserError if both are missing or they are inconsistent."""
    if file_mass is None and mesh_mass is None:
        raise UserError(
            "the normalisation of the modes is unknown: the file does not define it, and the mesh has no density",
            key="mesh.results.modal_mass",
            remedy="set `modal_mass: unit` if ΦᵀMΦ = 1 in units of the file (always in CalculiX, with NORM = MASS on EIGRL in "
            "Nastran). Otherwise specify densities in mesh.materials, and write results of all nodes",
        )
    if file_mass is None:
        assert mesh_mass is not None
        return mesh_mass, [
            f"modes are normalised with the densities of the mesh; ΦᵀMΦ of the first mode of the file was {mesh_mass[0]:.4g} kg"
        ]
    if mesh_mass is None:
        return file_mass, []
    ratio = mesh_mass / file_mass
    worst = int(np.argmax(np.abs(np.log(ratio))))
    off = abs(ratio[worst] - 1)
    what = (
        f"the modal mass of mode {worst + 1} from the densities of the mesh is {ratio[worst]:.4g} times the "
        "value in the results"
    )
    if off > OFF:
        raise UserError(
            what,
            key="mesh.results",
            remedy="use the densities, point masses and units of the original analysis, or remove the densities. If "
            "the modes do not have unit mass, set `modal_mass: mesh`",
        )
    return file_mass, [f"{what}; the value in the results is used"] if off > UNIT else []


T = TypeVar("T")


LONGEST = 4096
"""Longest line [bytes]."""


def result_lines(path: Path, what: str, remedy: str) -> Iterator[tuple[int, bytes]]:
    """Number and content of every line of a text file, described by `what`. Raises DeckError for a line that is not text."""
    with open_file(path) as file:
        number = 0
        while line := file.readline(LONGEST):
            number += 1
            if b"\0" in line or len(line) == LONGEST:
                raise error_at(
                    f"{path}:{number}",
                    f"the file is not {what}: the line has a zero byte or at least {LONGEST} bytes",
                    remedy,
                )
            yield number, line


def pad_line(line: bytes, width: int) -> bytes:
    """A line without its end, cut or padded with blanks to `width` columns."""
    return line.rstrip(b"\r\n")[:width].ljust(width)


def reals(text: np.ndarray, width: int, place: Callable[[int], str]) -> FloatArray:
    """(n, k) numbers, also in Fortran's short form 1.0-100, of the characters (n, k width) of n rows; place: row → its place.
    Raises DeckError for a word that is not a number."""
    words = np.ascontiguousarray(text).view(f"S{width}")
    try:
        return words.astype(float)
    except (ValueError, OverflowError):
        rows = [[_parse_word(parse_real, word, place, row) for word in line] for row, line in enumerate(words.tolist())]
        return np.array(rows)


def integers(text: np.ndarray, place: Callable[[int], str]) -> IntArray:
    """(n,) integers of the characters (n, width) of n rows, as `reals`."""
    words = np.ascontiguousarray(text).view(f"S{text.shape[1]}")[:, 0]
    try:
        return words.astype(np.int64)
    except (ValueError, OverflowError):
        return np.array(
            [_parse_word(parse_integer, word, place, row) for row, word in enumerate(words.tolist())], np.int64
        )


def _parse_word(parse: Callable[[str], T | None], word: bytes, place: Callable[[int], str], row: int) -> T:
    if (value := parse(word.decode("latin-1").strip())) is None:
        text = " ".join(word.decode("latin-1").split())
        raise damage_error(f"{text!r} is not a finite number", place(row))
    return value


ROUNDING = 5e-7
"""Relative rounding error of a number with seven digits."""
_VECTOR = re.compile(r"R E A L\s+E I G E N V E C T O R\s+N O ?\.\s*(\d+)")
_TABLE = re.compile(r"R E A L\s+E I G E N V A L U E S")
_SUBCASE = re.compile(r"\bSUBCASE\s+(\d+)")
_OTHER = {
    "complex eigenvalues": re.compile(r"C O M P L E X\s+E I G E N V"),
    "buckling loads": re.compile(r"B U C K L I N G\s|^[\s0]*SOL\s+(105|SEBUCKL)\s*$"),
}
"""Unsupported results. Titles of tables have spaces between their letters, unlike titles of the user or comments.
The executive control line detects buckling if its table has a vibration title."""


@dataclass
class _Step:
    """Mode → eigenvalue [1/s²] with its line; mode → ids and rows of motion."""

    number: int
    eigenvalue: dict[int, tuple[float, int]] = field(default_factory=dict)
    motion: dict[int, dict[int, list[float]]] = field(default_factory=dict)


def printed_modes(path: Path) -> Iterator[Response]:
    """Every mode of the file, step by step; without shapes it has no nodes.

    The step is the subcase of Nastran, or the number of the frequency step of CalculiX. Shapes of an .f06 are along nodal axes
    (CD); scalar points are left out. Raises DeckError with the line for unreadable data, and for a file without modes."""
    is_f06 = ".f06" in (ending.lower() for ending in path.suffixes)
    steps = _of_nastran(path) if is_f06 else _of_calculix(path)
    if not (steps_with_modes := [step for step in steps if step.eigenvalue]):
        what = "R E A L   E I G E N V A L U E S" if is_f06 else "E I G E N V A L U E   O U T P U T"
        raise error_at(
            path,
            f"the file has no table {what}",
            "specify the .f06 of a SOL 103 run, or the .dat of a *FREQUENCY step of CalculiX",
        )
    for step in steps_with_modes:
        for mode, (eigenvalue, line) in sorted(step.eigenvalue.items()):
            rows = step.motion.get(mode, {})
            ids = np.array(list(rows), dtype=np.int64)
            motion = np.array(list(rows.values())).reshape(-1, 6)
            where = f"{path}:{line}, step {step.number}, mode {mode}"
            frequency = natural_frequency(eigenvalue)
            options = {"along_node_axes": is_f06, "rounding": ROUNDING, "where": where}
            yield Response("mode", step.number, mode, ids, motion, frequency, **options)  # type: ignore[arg-type]


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of every line."""
    for number, line in result_lines(path, "printed solver output", "specify the .f06 or .dat file"):
        yield number, line.decode("latin-1")


def _of_nastran(path: Path) -> list[_Step]:
    """Read tables that continue over pages, each with its title; a title of another kind ends a table."""
    steps: dict[int, _Step] = {}
    step, vector, table = _Step(1), 0, False
    for number, text in _lines(path):
        if match := _SUBCASE.search(text):
            step = steps.setdefault(int(match[1]), _Step(int(match[1])))
        if text.startswith("1"):  # a new page, with the title of the user
            vector, table = 0, False
        elif "$" in text:  # a comment of the echoed deck
            continue
        elif match := _VECTOR.search(text):
            vector, table = int(match[1]), False
        elif _TABLE.search(text):
            vector, table = 0, True
        elif other := next((what for what, title in _OTHER.items() if title.search(text)), None):
            raise unsupported_error(other, f"{path}:{number}")
        words = text.split()
        if table and len(words) == 7 and words[0].isdigit() and words[1].isdigit():
            current = steps.setdefault(step.number, step)
            current.eigenvalue.setdefault(int(words[0]), (_real(words[2], path, number), number))
        elif vector and len(words) == 8 and words[0].isdigit() and words[1] == "G":
            current = steps.setdefault(step.number, step)
            current.motion.setdefault(vector, {})[int(words[0])] = [_real(word, path, number) for word in words[2:]]
    return list(steps.values())


def _of_calculix(path: Path) -> list[_Step]:
    steps: list[_Step] = []
    table = False
    for number, text in _lines(path):
        packed = "".join(text.split()).upper()
        if "EIGENVALUEOUTPUT" in packed:
            steps.append(_Step(len(steps) + 1))
            table = True
        elif packed.startswith(("PARTICIPATION", "EFFECTIVE", "TOTAL", "EIGENVALUENUMBER")):
            table = False  # *NODE PRINT and *EL PRINT print the mode number as title
        words = text.split()
        if table and len(words) == 5 and words[0].isdigit():
            if _real(words[4], path, number) != 0 and _real(words[1], path, number) >= 0:
                raise unsupported_error("complex frequencies", f"{path}:{number}")
            steps[-1].eigenvalue[int(words[0])] = (_real(words[1], path, number), number)
    return steps


def _real(word: str, path: Path, line: int) -> float:
    if (value := parse_real(word)) is None:
        raise damage_error(f"{word!r} is not a finite number", f"{path}:{line}")
    return value

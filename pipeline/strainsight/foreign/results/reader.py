"""Any file of results in, its modes and static responses out, one after the other."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.decks.other.mesh import NODE_IDS, numbers_of
from strainsight.decks.other.sandbox import load_sandboxed
from strainsight.decks.text import UNPACKING, check_plain
from strainsight.errors import DeckError
from strainsight.foreign.results.ansys import ansys_responses
from strainsight.foreign.results.frd import frd_responses
from strainsight.foreign.results.op2 import op2_responses
from strainsight.foreign.results.punch import punch_responses
from strainsight.foreign.results.response import Response, check_frequency, check_motion
from strainsight.foreign.results.universal import universal_responses

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
"""By the bytes of a number."""


def vtu_responses(path: Path) -> Iterator[Response]:
    """Point data of three or six components that are named as modes or displacements, in the order of the file.

    "mode_1" is mode 1 of step 1, and its frequency stands in its name, "mode_1 12.5 Hz", or as entry 1 of the field data
    "frequencies" [Hz]; "displacement" and "displacement_2" are static steps 1 and 2. Other data are passed over. Nodes have the
    numbers of a mesh file of these formats. The whole file is in memory.
    Raises DeckError for a file that cannot be read, and a mode without its frequency.
    """
    with path.open("rb"):
        pass
    raw = load_sandboxed(path).mesh
    points = len(np.asarray(raw.points))
    ids, _ = numbers_of(raw.point_data, NODE_IDS, points, "node", [])
    for name, values in raw.point_data.items():
        mode = _MODE.fullmatch(name)
        said = mode or _STATIC.fullmatch(name)
        motion = np.asarray(values)
        if said is None or motion.ndim != 2 or motion.shape[1] not in (3, 6) or motion.dtype.kind != "f":
            continue
        where = f"{path}, {name}"
        number = int(said["number"] or 1)
        frequency = _frequency(mode, number, raw.field_data, where) if mode else 0.0
        check_motion(ids, motion, where)
        yield Response(
            "mode" if mode else "static",
            1 if mode else number,
            number if mode else 1,
            ids,
            motion.astype(float),
            frequency,
            name,
            rounding=_ROUNDING.get(motion.dtype.itemsize, 1e-3),
            where=where,
            position=np.asarray(raw.points, dtype=float),
        )


def _frequency(mode: re.Match[str], number: int, field_data: dict[str, Any], where: str) -> float:
    """Of a mode, by its name, or by the field data."""
    if mode["hertz"]:
        return float(mode["hertz"])
    known = [np.ravel(values) for key, values in field_data.items() if key.lower() in _FREQUENCIES]
    if not known or not 0 < number <= len(known[0]) or known[0].dtype.kind not in "fiu":
        raise DeckError(
            f"mode {number} has no frequency",
            where=where,
            remedy=f'name the data "mode_{number} 12.5 Hz", or write all frequencies [Hz] as field data "frequencies"',
        )
    frequency = float(known[0][number - 1])
    check_frequency(frequency, where)
    return frequency


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
    """The modes and static responses of a file in its order; one at a time is in memory, so that a file may be larger than that.

    The ending of the name chooses the reader; .gz before it is passed over. Raises DeckError for an ending that no reader has, a
    file that is missing, damaged or no plain one, and what its reader refuses.
    """
    path = Path(path)
    reader = readers.get(ending_of(path))
    if reader is None:
        raise DeckError(
            f"no file of results by its name: {path.name}", where=str(path), remedy=f"known: {', '.join(readers)}"
        )
    try:
        check_plain(path)
        yield from reader(path)
    except FileNotFoundError:
        raise DeckError("no such file", where=str(path), remedy="check the name and the folder") from None
    except UNPACKING as error:
        raise DeckError(f"cannot be unpacked: {error}", where=str(path), remedy="pack the file again") from None
    except OSError as error:
        raise DeckError(
            f"cannot be read: {error.strerror}", where=str(path), remedy="check that it is a readable file"
        ) from None


def ending_of(path: Path) -> str:
    """The last ending of a name but .gz, in lower case; "" where it has none."""
    return next((ending.lower() for ending in reversed(path.suffixes) if ending.lower() != ".gz"), "")

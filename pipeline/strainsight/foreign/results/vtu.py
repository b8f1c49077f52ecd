"""Modes and static displacements among the point data of a VTU or VTK file, whose names say what they are."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from strainsight.decks.other.arrays import numbers_of
from strainsight.decks.other.mesh import NODE_IDS
from strainsight.decks.other.sandbox import load_sandboxed
from strainsight.errors import DeckError
from strainsight.foreign.results.checks import check_frequency, check_motion
from strainsight.foreign.results.response import Response

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

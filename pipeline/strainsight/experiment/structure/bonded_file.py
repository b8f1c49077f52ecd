"""Where gauges were bonded, as a file that `place` has written, or one like it, says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.config.checks_gauges import bridge_problem
from strainsight.errors import DeckError
from strainsight.foreign.matrices.files import csv_columns

AXES = ("x", "y", "z")
NEEDED = ("gauge", *(f"{vector}_{axis}" for vector in ("position", "direction") for axis in AXES))
NORMAL = tuple(f"normal_{axis}" for axis in AXES)
STRAIN_KINDS = ("strain gauge", "rosette", "bridge")


@dataclass(frozen=True)
class BondedArm:
    """One arm of a bridge: position [m] and direction (3,); length [m] of its grid, None where the file has none; sign ±1."""

    position: np.ndarray
    direction: np.ndarray
    length: float | None
    sign: int


@dataclass(frozen=True)
class BondedPlace:
    """One gauge: position (3,) [m]; direction (c, 3) of each of its channels; normal (3,) outward, zero where the file has none;
    length [m] of its grid, None where the file has none; kind in words; line of the file where it begins; arms of a bridge, all
    of them, the first of which is the rest of this."""

    position: np.ndarray
    direction: np.ndarray
    normal: np.ndarray
    length: float | None
    kind: str
    line: int
    arms: tuple[BondedArm, ...] = ()

    @property
    def angles(self) -> tuple[float, ...]:
        """Of every grid from the first one [deg], right-handed about the normal: tan α = (d₁ × d)·n / (d₁·d)."""
        first = self.direction[0]
        across = np.cross(first, self.direction) @ self.normal
        return tuple(np.rad2deg(np.arctan2(across, self.direction @ first)).tolist())


def read_bonded(path: Path) -> dict[str, BondedPlace]:
    """Gauges by name, in the order of the file: a line a channel, of a bridge an arm, those of one gauge one behind the other.

    Columns gauge, position_x … z, direction_x … z in metres; kind, normal_x … z and grid_length where they are there, and sign,
    1 or −1, of the arms of a bridge; others are passed over. Raises DeckError for a column that is missing, what is no number, a
    direction without length, a gauge that is there twice, a rosette without a normal, and arms that are no bridge.
    """
    found: dict[str, list[tuple[int, dict[str, str]]]] = {}
    last = ""
    for line, cells in csv_columns(path, NEEDED):
        name = cells["gauge"]
        if not name:
            raise DeckError("a line without the name of a gauge", where=f"{path}:{line}", remedy="name it")
        if name in found and name != last:
            raise DeckError(
                f"gauge {name} is there twice",
                where=f"{path}:{line}",
                remedy="give each its own name; grids of a rosette stand one behind the other",
            )
        last = name
        found.setdefault(name, []).append((line, cells))
    if not found:
        raise DeckError("no gauge in the file", where=str(path), remedy=f"one line a gauge: {','.join(NEEDED)}")
    return {name: _place(path, name, lines) for name, lines in found.items()}


def _place(path: Path, name: str, lines: list[tuple[int, dict[str, str]]]) -> BondedPlace:
    vectors = {
        vector: np.array([[_number(path, line, cells, f"{vector}_{axis}") for axis in AXES] for line, cells in lines])
        for vector in ("position", "direction")
    }
    first, cells = lines[0]
    where = f"{path}:{first}"
    length = np.linalg.norm(vectors["direction"], axis=1)
    if not length.all():
        raise DeckError(f"gauge {name} has a direction of length zero", where=where, remedy="give direction_x, …")
    direction = vectors["direction"] / length[:, None]
    arms = _arms(path, name, lines, vectors["position"], direction)
    if arms:
        lines = lines[:1]
    elif np.ptp(vectors["position"], axis=0).any():
        raise DeckError(f"the grids of {name} are in several places", where=where, remedy="give all the same position")
    there = all(cells.get(column) for column in NORMAL)
    normal = np.array([_number(path, first, cells, column) for column in NORMAL]) if there else np.zeros(3)
    if len(lines) > 1 and not normal.any():
        raise DeckError(
            f"rosette {name} has no normal, which says in which sense its grids turn",
            where=where,
            remedy=f"add the columns {', '.join(NORMAL)}: the outward normal of the surface",
        )
    return BondedPlace(
        position=vectors["position"][0],
        direction=direction[: len(lines)],
        normal=normal,
        length=_length(path, first, cells),
        kind=cells.get("kind") or STRAIN_KINDS[2 if arms else len(lines) > 1],
        line=first,
        arms=arms,
    )


def _arms(
    path: Path, name: str, lines: list[tuple[int, dict[str, str]]], position: np.ndarray, direction: np.ndarray
) -> tuple[BondedArm, ...]:
    """The arms of a bridge, () of what is none: its lines have signs."""
    cells = [own.get("sign", "") for _, own in lines]
    where = f"{path}:{lines[0][0]}"
    if not any(cells):
        if lines[0][1].get("kind") == STRAIN_KINDS[2]:
            raise DeckError(
                f"the arms of the bridge {name} have no sign", where=where, remedy="add the column sign: 1 or -1"
            )
        return ()
    sign = [_number(path, line, own, "sign") for line, own in lines]
    if problem := bridge_problem(sign):
        raise DeckError(f"the bridge {name} has {problem[0]}", where=where, remedy=problem[1])
    return tuple(
        BondedArm(x, d, _length(path, line, own), int(s))
        for x, d, s, (line, own) in zip(position, direction, sign, lines, strict=True)
    )


def _length(path: Path, line: int, cells: dict[str, str]) -> float | None:
    return _number(path, line, cells, "grid_length") if cells.get("grid_length") else None


def _number(path: Path, line: int, cells: dict[str, str], column: str) -> float:
    try:
        value = float(cells[column])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise DeckError(
            f"{cells[column]!r} under {column} is no number", where=f"{path}:{line}", remedy="give one, in metres"
        )
    return value

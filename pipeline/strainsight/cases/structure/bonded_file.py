"""Where gauges were bonded, as a file that `place` has written, or one like it, says."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strainsight.decks.matrices.files import csv_columns
from strainsight.errors import DeckError

AXES = ("x", "y", "z")
NEEDED = ("gauge", *(f"{vector}_{axis}" for vector in ("position", "direction") for axis in AXES))
NORMAL = tuple(f"normal_{axis}" for axis in AXES)
STRAIN_KINDS = ("strain gauge", "rosette")


@dataclass(frozen=True)
class BondedPlace:
    """One gauge: position (3,) [m]; direction (c, 3) of each of its channels; normal (3,) outward, zero where the file has none;
    length [m] of its grid, None where the file has none; kind in words; line of the file where it begins."""

    position: np.ndarray
    direction: np.ndarray
    normal: np.ndarray
    length: float | None
    kind: str
    line: int

    @property
    def angles(self) -> tuple[float, ...]:
        """Of every grid from the first one [deg], right-handed about the normal: tan α = (d₁ × d)·n / (d₁·d)."""
        first = self.direction[0]
        across = np.cross(first, self.direction) @ self.normal
        return tuple(np.rad2deg(np.arctan2(across, self.direction @ first)).tolist())


def read_bonded(path: Path) -> dict[str, BondedPlace]:
    """Gauges by name, in the order of the file: a line a channel, those of one gauge one behind the other.

    Columns gauge, position_x … z, direction_x … z in metres; kind, normal_x … z and grid_length where they are there, others are
    passed over. Raises DeckError for a column that is missing, what is no number, a direction without length, a gauge that is
    there twice, and a rosette without a normal.
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
    if np.ptp(vectors["position"], axis=0).any():
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
        direction=vectors["direction"] / length[:, None],
        normal=normal,
        length=_number(path, first, cells, "grid_length") if cells.get("grid_length") else None,
        kind=cells.get("kind") or STRAIN_KINDS[len(lines) > 1],
        line=first,
    )


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

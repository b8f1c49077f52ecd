"""Bonded gauges from files, and assignment of test channels to gauges by name and bonded position."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import sparse

from strainsight.config.estimate import Estimate
from strainsight.config.gauges import bridge_problem
from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import tolerances_of
from strainsight.errors import ConfigError, DeckError, blame, did_you_mean
from strainsight.experiment.layout.gauge_list import layout_labels
from strainsight.foreign.imported_matrices import row_scale
from strainsight.foreign.matrices.files import csv_columns, csv_lines, read_matrix
from strainsight.mesh.units import LENGTH
from strainsight.records.training import Training
from strainsight.sensors.bonded import ImportedGauges, imported_pool
from strainsight.sensors.candidates import STRAIN, Candidates

AXES = ("x", "y", "z")
NEEDED = ("gauge", *(f"{vector}_{axis}" for vector in ("position", "direction") for axis in AXES))
NORMAL = tuple(f"normal_{axis}" for axis in AXES)
STRAIN_KINDS = ("strain gauge", "rosette", "bridge")
ROUNDED = 1e-6
"""Relative rounding error of positions and directions in a file with nine digits."""
DIGITS = 1e-9
"""Rounding error of coordinates in the unit of the model [unit]."""


@dataclass(frozen=True)
class UnusedCoordinate:
    """Coordinate of a grid in a column that is not used (x_mm …) and differs from the position.

    line: in the file; axis: 0 to 2; value [unit]; metres: one unit."""

    line: int
    grid: int
    axis: int
    unit: str
    value: float
    metres: float

    def differs_in_words(self, name: str, used: float, where: str) -> str:
        """The coordinate of a gauge and the one used [m]; where: the latter is from."""
        column = f"{AXES[self.axis]}_{self.unit}"
        return (
            f"{column} of {name} is {self.value:.6g} {self.unit} in line {self.line} of the file, but "
            f"{used / self.metres + 0.0:.6g} {self.unit} {where}"
        )


@dataclass(frozen=True)
class BondedPlace:
    """One gauge of g grids (the arms of a bridge).

    position [m], direction (g, 3); length [m] of each, None if absent; sign (g,): ±1 of a bridge arm, else 1; normal (3,):
    outward, zero if absent; kind: in words; line: first line in the file; bridge: whether it is a bridge; unused: coordinates
    that differ from the position."""

    position: np.ndarray
    direction: np.ndarray
    length: tuple[float | None, ...]
    sign: np.ndarray
    normal: np.ndarray
    kind: str
    line: int
    bridge: bool
    unused: tuple[UnusedCoordinate, ...] = ()

    @property
    def angles(self) -> tuple[float, ...]:
        """Angle of every grid from the first [deg], right-handed about the normal: tan α = (d₁ × d)·n / (d₁·d)."""
        first = self.direction[0]
        across = np.cross(first, self.direction) @ self.normal
        return tuple(np.rad2deg(np.arctan2(across, self.direction @ first)).tolist())


def read_bonded(path: Path) -> dict[str, BondedPlace]:
    """Gauges by name in the order of the file: one line a channel (a bridge arm), lines of one gauge consecutive.

    Columns gauge, position_x … z, direction_x … z in metres; optional kind, normal_x … z, grid_length, and sign (1 or −1) of
    bridge arms. Others are not used; of them x_mm … are compared with the position. Raises DeckError for a missing column, an
    invalid number, a zero direction, a duplicate gauge, a rosette without a normal, and an invalid bridge."""
    rows: dict[str, list[tuple[int, dict[str, str]]]] = {}
    last = ""
    for line, cells in csv_columns(path, NEEDED):
        name = cells["gauge"]
        if not name:
            raise DeckError(
                "the gauge name is missing", where=f"{path}:{line}", remedy="Enter the name in the column `gauge`."
            )
        if name in rows and name != last:
            raise DeckError(
                f"gauge name {name} is used twice",
                where=f"{path}:{line}",
                remedy="Give each gauge a unique name, and write the measuring grids of a rosette in consecutive lines.",
            )
        last = name
        rows.setdefault(name, []).append((line, cells))
    if not rows:
        raise DeckError(
            "the file contains no gauges",
            where=str(path),
            remedy=f"Write one line per gauge with the columns {','.join(NEEDED)}",
        )
    return {name: _place(path, name, lines) for name, lines in rows.items()}


def _place(path: Path, name: str, lines: list[tuple[int, dict[str, str]]]) -> BondedPlace:
    vectors = {
        vector: np.array([[_number(path, line, cells, f"{vector}_{axis}") for axis in AXES] for line, cells in lines])
        for vector in ("position", "direction")
    }
    first, cells = lines[0]
    where = f"{path}:{first}"
    length = np.linalg.norm(vectors["direction"], axis=1)
    if not length.all():
        raise DeckError(
            f"the direction of gauge {name} has zero length",
            where=where,
            remedy="Correct direction_x, direction_y and direction_z.",
        )
    direction = vectors["direction"] / length[:, None]
    sign = _signs(path, name, lines)
    if sign is None and np.ptp(vectors["position"], axis=0).any():
        raise DeckError(
            f"the measuring grids of gauge {name} have different positions",
            where=where,
            remedy="Enter the same position for all measuring grids of a rosette; for a bridge, add the column `sign`.",
        )
    has_normal = all(cells.get(column) for column in NORMAL)
    normal = np.array([_number(path, first, cells, column) for column in NORMAL]) if has_normal else np.zeros(3)
    if sign is None and len(lines) > 1 and not normal.any():
        raise DeckError(
            f"rosette {name} has no surface normal, so the sense of rotation from one measuring grid to the next is undefined",
            where=where,
            remedy=f"Add the columns {', '.join(NORMAL)} with the outward normal of the surface.",
        )
    return BondedPlace(
        position=vectors["position"],
        direction=direction,
        length=tuple(
            _number(path, line, entry, "grid_length") if entry.get("grid_length") else None for line, entry in lines
        ),
        sign=np.ones(len(lines), dtype=int) if sign is None else sign,
        normal=normal,
        kind=cells.get("kind") or STRAIN_KINDS[len(lines) > 1 if sign is None else 2],
        line=first,
        bridge=sign is not None,
        unused=tuple(_unused_coordinates(vectors["position"], lines)),
    )


def _unused_coordinates(position: np.ndarray, lines: list[tuple[int, dict[str, str]]]) -> Iterator[UnusedCoordinate]:
    """Coordinates in a unit (x_mm …) that differ from the position (g, 3) by more than rounding."""
    rounding = ROUNDED * float(np.abs(position).max())
    for grid, (line, cells) in enumerate(lines):
        for column, cell in cells.items():
            axis, _, unit = column.partition("_")
            if axis not in AXES or unit not in LENGTH:
                continue
            try:
                value = float(cell)
            except ValueError:
                continue
            i, metres = AXES.index(axis), LENGTH[unit]
            if abs(value * metres - position[grid, i]) > rounding + DIGITS * metres:
                yield UnusedCoordinate(line, grid, i, unit, value, metres)


def _signs(path: Path, name: str, lines: list[tuple[int, dict[str, str]]]) -> np.ndarray | None:
    """Sign of each arm of a bridge, None for other gauges."""
    cells = [entry.get("sign", "") for _, entry in lines]
    where = f"{path}:{lines[0][0]}"
    if not any(cells):
        if lines[0][1].get("kind") == STRAIN_KINDS[2]:
            raise DeckError(
                f"the arms of bridge {name} have no sign",
                where=where,
                remedy="Add the column `sign` with 1 or -1 for each arm.",
            )
        return None
    sign = [_number(path, line, entry, "sign") for line, entry in lines]
    if problem := bridge_problem(sign):
        raise DeckError(f"bridge {name}: {problem[0]}", where=where, remedy=problem[1])
    return np.array(sign, dtype=int)


def _number(path: Path, line: int, cells: dict[str, str], column: str) -> float:
    try:
        value = float(cells[column])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise DeckError(
            f"{cells[column]!r} in column {column} is not a number",
            where=f"{path}:{line}",
            remedy="Enter a number; positions are in metres.",
        )
    return value


KEY = "estimate.gauges_file"
USED = "position_x, position_y and position_z"


def bonded_gauges(config: PlacementConfig, training: Training, layout: np.ndarray, file: Path | None) -> dict[str, int]:
    """Numbers of the gauges that the channels of `estimate` refer to, by name.

    layout (k,): numbers of the gauges of the layout; file: `estimate.gauges_file`, None if not set. G1, G2, … refer to the
    current layout: their positions and directions have to agree with the file within one σ (`tolerances`). Raises ConfigError
    for an unknown or moved gauge, and if its bonded position is unknown."""
    assert config.estimate is not None
    named = {name: i for i, name in enumerate(training.name) if name}
    placed = dict(zip(layout_labels(training.name, layout), layout.tolist(), strict=True))
    places = None
    if file is not None:
        _check_kept(file)
        with blame(KEY):
            places = read_bonded(file)
    for key, name in placed_channels(config.estimate, tuple(named), tuple(placed), places):
        if places is not None:
            _check_place(config, key, name, training.candidates, placed[name], places[name])
    return {name: (placed | named)[name] for name in (str(entry.gauge) for entry in config.estimate.channels)}


def placed_channels(
    settings: Estimate, named: Sequence[str], labels: Sequence[str], places: Mapping[str, BondedPlace] | None
) -> Iterator[tuple[str, str]]:
    """Key and name of every channel whose gauge has a layout label (`labels`), not a name of the config (`named`).

    places: those of `estimate.gauges_file`, None if not set or not yet readable. Raises ConfigError for an unknown gauge, and if
        its bonded position is unknown.
    """
    for i, entry in enumerate(settings.channels):
        name, key = str(entry.gauge), f"estimate.channels.{i}.gauge"
        if name in named:
            continue
        if name not in labels:
            if places is not None and name in places:
                was = _xyz(places[name].position[0])
                raise ConfigError(
                    f"gauge '{name}' was bonded at {was} m, but is not in the current layout", key=key, remedy=_KEPT
                )
            existing = list(dict.fromkeys((*labels, *named)))
            listed = f"Known gauges: {', '.join(existing[:12])}{' …' * (len(existing) > 12)}"
            remedy = did_you_mean(name, existing)
            raise ConfigError(f"unknown gauge '{name}'", key=key, remedy=" ".join(filter(None, (remedy, listed))))
        if places is None and settings.gauges_file is None and not settings.as_placed:
            raise ConfigError(
                f"{name} is a gauge of the current layout, but the position where the gauge was bonded is unknown",
                key=KEY,
                remedy="Copy gauges.csv from the results folder to the config folder when the gauges are bonded, and set "
                "estimate.gauges_file: gauges.csv. If the gauges were bonded as in this layout, set estimate.as_placed: true.",
            )
        if places is not None and name not in places:
            remedy, listed = did_you_mean(name, places), f"The file contains the gauges {', '.join(places)}"
            raise ConfigError(
                f"gauge {name} is missing in the file of {KEY}",
                key=key,
                remedy=" ".join(filter(None, (remedy, listed))),
            )
        yield key, name


def _check_kept(file: Path) -> None:
    """Raises ConfigError for gauges.csv in the results folder, which `place` overwrites with every layout."""
    if file.name == "gauges.csv" and (file.parent / "place.h5").is_file():
        raise ConfigError(
            f"{file.name} in the results folder is overwritten with every new layout and does not record bonded positions",
            key=KEY,
            remedy="Copy the file used for bonding to the config folder and set estimate.gauges_file to the copy. Earlier "
            "versions remain in the results folder as gauges-….csv.",
        )


_KEPT = "Set gauges.fixed_file to the file of estimate.gauges_file: bonded gauges then keep positions and names in every layout."


def _check_place(
    config: PlacementConfig, key: str, name: str, candidates: Candidates, number: int, was: BondedPlace
) -> None:
    """Raises ConfigError if the gauge is not where it was bonded."""
    channels = candidates.take(candidates.channels(np.array([number])))
    order = np.argsort(-channels.sign_of_grid, kind="stable")  # the arms of a bridge as those of the file below
    now, sign = channels.grids.take(order), channels.sign_of_grid[order]
    if len(now) != (bonded := len(was.direction)):
        what = "arms" if channels.arms is not None or was.bridge else "channels"
        raise ConfigError(
            f"the number of {what} of {name} is {len(now)} in the current layout, but was {bonded} when bonded",
            key=key,
            remedy=_KEPT,
        )
    of_file = np.argsort(-was.sign, kind="stable")
    position, direction = was.position[of_file], was.direction[of_file]
    if was.bridge and was.sign[of_file].tolist() != sign.tolist():
        raise ConfigError(
            f"in the current layout the arms of {name} have other signs than when bonded",
            key=key,
            remedy=_KEPT,
        )
    allowed, off = tolerances_of(config.tolerances), np.linalg.norm(now.position - position, axis=1)
    limit = max(allowed.position, ROUNDED * float(np.abs(was.position[0]).max()))
    worst = int(np.argmax(off))
    moved = float(off[worst])
    if moved > limit:
        raise ConfigError(
            f"{name} was bonded at {_xyz(position[worst])} m, but its position in the current layout is "
            f"{_xyz(now.position[worst])} m, at a distance of {1e3 * moved:.3g} mm",
            key=key,
            remedy=_KEPT,
        )
    for one in was.unused:
        used = float(now.position[of_file.tolist().index(one.grid), one.axis])
        if abs(one.value * one.metres - used) > limit:
            raise ConfigError(
                f"{one.differs_in_words(name, used, 'in the current layout')}; this column is not used",
                key=KEY,
                remedy=f"Enter the bonded position in {USED} [m], and set gauges.fixed_file to this file instead of {KEY}.",
            )
    along = np.sum(now.direction * direction, axis=1)
    if channels.quantity[0] == STRAIN:
        along = np.abs(along)  # a gauge rotated by 180° reads the same
    turned = float(np.rad2deg(np.arccos(np.clip(along.min(), -1.0, 1.0))))
    if turned > max(allowed.angle, float(np.rad2deg(np.sqrt(2 * ROUNDED)))):
        raise ConfigError(
            f"in the current layout {name} is rotated by {turned:.3g}° from its bonded direction "
            f"{_xyz(direction[int(np.argmin(along))])}",
            key=key,
            remedy=_KEPT,
        )


def _xyz(x: np.ndarray) -> str:
    return f"({', '.join(f'{value:.4g}' for value in x + 0.0)})"


COLUMNS = ("gauge", "x", "y", "z", "dx", "dy", "dz")


def read_given(rows: Path, table: Path, components: np.ndarray, length: float) -> ImportedGauges:
    """Read the strain operator ε = R u [1/L on translations, 1/rad on rotations] and the table gauge,x,y,z,dx,dy,dz [L], L [m].

    components (r,) 0-5 of the rows of the matrices. Raises DeckError for files that cannot be read or do not fit together."""
    number, position, direction = given_table(table)
    R = _rows(rows, components, length)
    if R.shape[0] != len(number):
        raise DeckError(
            f"the strain operator has {R.shape[0]} rows, but {table.name} has {len(number)} gauges",
            where=str(rows),
            remedy="Write one row per gauge, in the order of the lines of the gauge table.",
        )
    return ImportedGauges(imported_pool(number, position * length, direction), R)


def _rows(path: Path, components: np.ndarray, length: float) -> sparse.csr_array:
    """Strain operator (m, r) in SI: R_SI = R s/L,  s = 1 for translations, L for rotations. Errors as `read_given`."""
    R = read_matrix(path)
    if R.shape[1] != len(components):
        raise DeckError(
            f"the strain operator has {R.shape[1]} columns, but the stiffness matrix has {len(components)} rows",
            where=str(path),
            remedy="Write one column for every line of mesh.matrices.numbering.",
        )
    return sparse.csr_array(R @ sparse.diags_array(row_scale(components, length) / length))


def given_table(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Numbers (m,), positions and directions (m, 3) of the table, in its unit. Errors as `read_given`."""
    number: list[int] = []
    position, direction = [], []
    for line, cells in csv_lines(path, COLUMNS):
        try:
            gauge = int(cells[0])
            x = [float(cell) for cell in cells[1:4]]
            d = [float(cell or "0") for cell in cells[4:]]
        except ValueError:
            raise DeckError(
                f"{','.join(cells)[:60]!r} contains a value that is not a number",
                where=f"{path}:{line}",
                remedy="Enter the gauge number as an integer, the position, and optionally the direction.",
            ) from None
        if not (np.isfinite([*x, *d]).all() and abs(gauge) < 2**62):
            raise DeckError(
                f"gauge {gauge} has a value that is not finite",
                where=f"{path}:{line}",
                remedy="Enter finite numbers for the position and the direction.",
            )
        number.append(gauge)
        position.append(x)
        direction.append(d)
    if not number:
        raise DeckError(
            "the table contains no gauges",
            where=str(path),
            remedy=f"Write one line per gauge with the columns {','.join(COLUMNS)}",
        )
    ids, first = np.unique(number, return_index=True)
    if len(ids) < len(number):
        again = next(i for i in range(len(number)) if i not in set(first.tolist()))
        raise DeckError(
            f"gauge number {number[again]} is used twice",
            where=f"{path}:{again + 2}",
            remedy="Give each gauge a unique number.",
        )
    return np.array(number, dtype=np.int64), np.array(position), np.array(direction)

"""Bonded gauges by their coordinates, and candidate bridges by a pattern of arms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError, UserError
from strainsight.mesh.coincident import component_labels
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.access import opposite
from strainsight.sensors.candidates import STEEPEST, Arms, Candidates, concatenate
from strainsight.sensors.strain_operator import fits
from strainsight.sensors.surface import tangent, turned
from strainsight.sensors.surface_paths import Located, Skin, locate, skin_of
from strainsight.sensors.zones import Zone, inside

COINCIDENT = 1e-6
"""Distance of coincident gauges, as a share of the extent of the surface."""


@dataclass(frozen=True)
class BondedEntry:
    """A gauge: position (3,) [m], direction (3,) of any length, length of its grid [m], angles of its grids [deg] from the
    direction, right-handed about the outward normal (several: a rosette); name, may be empty; key of the config, empty: its
    number below the common key; arms: those of a bridge after the first, each of one grid, with the sign 1 or −1 of their
    strain; the sign of the first is 1."""

    position: Sequence[float]
    direction: Sequence[float]
    length: float = 0.0
    angles: Sequence[float] = (0.0,)
    name: str = ""
    key: str = ""
    arms: Sequence[tuple[BondedEntry, int]] = ()


def bonded(
    mesh: Mesh, facets: Facets | Skin, entries: Sequence[BondedEntry], tolerance: float, key: str = "gauges.fixed"
) -> tuple[Candidates, np.ndarray]:
    """The gauges at the nearest points of the surface, and their distance (entries,) [m] from the specified positions, for a
    bridge the largest of its arms:

        d ∥ a − (a·n) n,     rotated by each angle about n

    facets of the whole surface; tolerance [m]; key: config key for errors, to which the number of the entry is added.
    Raises UserError, with the name of the entry or its number from 1, for an entry farther from the surface than the tolerance,
    a direction of zero length or within 10° of the normal, a grid that crosses a sharp edge, and an entry with the position and
    direction of another. The same holds for arms of a bridge, except that only arms of one bridge with opposite signs must not
    coincide."""
    arms = [(i, arm, sign) for i, entry in enumerate(entries) for arm, sign in entry.arms]
    n, owner = len(entries), np.array([i for i, _, _ in arms], dtype=np.int64)
    grids, distance = _grids(mesh, facets, [*entries, *(arm for _, arm, _ in arms)], tolerance, key)
    if not arms:
        return grids, distance
    pool, sign = grids.take(grids.channels(np.arange(n))), np.array([float(sign) for _, _, sign in arms])
    grid = grids.take(grids.channels(n + np.arange(len(arms))))
    moved = distance[:n].copy()
    np.maximum.at(moved, owner, distance[n:])
    return replace(pool, arms=Arms(pool.first[owner], sign, grid)), moved


def _grids(
    mesh: Mesh, facets: Facets | Skin, entries: Sequence[BondedEntry], tolerance: float, key: str
) -> tuple[Candidates, np.ndarray]:
    """The entries without their arms, each a gauge, and the distance (entries,) [m] of each from its position."""
    skin, refuse = (
        facets if isinstance(facets, Skin) else skin_of(mesh.position, facets),
        partial(_error_at, key, entries),
    )
    positions = np.array([entry.position for entry in entries], dtype=float).reshape(-1, 3)
    if not np.isfinite(positions).all():
        i = int(np.argmin(np.isfinite(positions).all(axis=1)))
        raise refuse(i, f"the position {tuple(entries[i].position)} is not finite", "Specify three finite coordinates.")
    if not len(entries):
        return _channels(skin, entries, np.zeros(0, int), np.zeros((0, 2)), positions, positions, positions), np.zeros(
            0
        )
    located = locate(skin, positions)
    if (too_far := located.distance > tolerance * (1 + 1e-9)).any():
        i = int(np.argmax(too_far))
        raise refuse(
            i,
            f"the position is {located.distance[i]:.4g} m from the surface (nearest point: {_xyz(located.point[i])}), "
            f"more than {tolerance:g} m",
            "Correct the position (in metres), or increase snap_tolerance of the gauge.",
        )
    _, normal = skin.frames(located.facet, located.local)
    _check_side(mesh, skin, positions, located, refuse)
    d = np.array([_tangent(entry.direction, normal[i], partial(refuse, i)) for i, entry in enumerate(entries)])
    _check_coincidence(entries, located.point, d, COINCIDENT * float(np.ptp(skin.position, axis=0).max()), refuse)
    pool = _channels(skin, entries, located.facet, located.local, located.point, normal, d)
    complete = fits(mesh.position, pool, skin)
    if not complete.all():
        i = int(pool.gauge[np.argmin(complete)])
        raise refuse(
            i,
            f"the measuring grid of {entries[i].length:.3g} m length crosses a sharp edge",
            "Correct the position, direction or length of the gauge.",
        )
    return pool, located.distance


Refusal = Callable[[int, str, str], UserError]
"""Number of the entry, fault and remedy → error."""


def _check_side(mesh: Mesh, skin: Skin, positions: np.ndarray, located: Located, refuse: Refusal) -> None:
    """Raise an error for a position (entries, 3) [m] in the middle of a shell, as near to its lower face as to its upper one."""
    shell = np.flatnonzero(skin.facets.of(mesh.shells)[located.facet])
    other = locate(skin, 2 * positions[shell] - located.point[shell]) if len(shell) else located
    size = COINCIDENT * float(np.ptp(skin.position, axis=0).max())
    element = skin.facets.element_id
    for i, facet, distance in zip(shell.tolist(), other.facet, other.distance, strict=False):
        if distance < size and facet != located.facet[i] and element[facet] == element[located.facet[i]]:
            raise refuse(
                i,
                f"the position is equally near to the upper and lower face of shell {element[facet]}",
                f"Specify a position on the bonded face, for example {_xyz(located.point[i])}.",
            )


def _channels(
    skin: Skin,
    entries: Sequence[BondedEntry],
    facet: np.ndarray,
    local: np.ndarray,
    point: np.ndarray,
    normal: np.ndarray,
    d: np.ndarray,
) -> Candidates:
    each = np.repeat(np.arange(len(entries)), [len(entry.angles) for entry in entries])
    angle = np.array([angle for entry in entries for angle in entry.angles], dtype=float)
    return Candidates(
        **skin.facets.columns(facet[each]),
        position=point[each],
        normal=normal[each],
        direction=turned(d[each], normal[each], angle),
        angle=angle,
        local=local[each],
        length=np.array([entry.length for entry in entries], dtype=float)[each],
        gauge=each,
        bonded=np.ones(len(each), dtype=bool),
    )


def _tangent(direction: Sequence[float], n: np.ndarray, refuse: Callable[[str, str], UserError]) -> np.ndarray:
    """Unit vector of a direction (3,), projected on the surface with normal n (3,)."""
    a = np.asarray(direction, dtype=float)
    length = np.linalg.norm(a)
    if a.shape != (3,) or not (np.isfinite(length) and length > 0):
        raise refuse(
            f"the direction {tuple(direction)} does not have three finite components, or all are zero",
            "Specify the components of the measuring direction.",
        )
    a = a / length
    t = a - (a @ n) * n
    angle = np.rad2deg(np.arctan2(np.linalg.norm(t), abs(a @ n)))
    if angle < STEEPEST:
        raise refuse(
            f"the direction is at {angle:.3g}° to the surface normal {_xyz(n)}, so its projection on the surface is undefined",
            f"Specify a direction along the surface, at more than {STEEPEST:g}° to the normal.",
        )
    return t / np.linalg.norm(t)


def _check_coincidence(
    entries: Sequence[BondedEntry], point: np.ndarray, d: np.ndarray, near: float, refuse: Refusal
) -> None:
    sign = {id(arm): (id(entry), arm_sign) for entry in entries for arm, arm_sign in entry.arms}
    sign |= {id(entry): (id(entry), 1) for entry in entries if entry.arms}
    for i, j in sorted(cKDTree(point).query_pairs(near)):
        (bridge, first), (other_bridge, second) = (sign.get(id(entries[k]), (0, 0)) for k in (i, j))
        # grids side by side may coincide: arms that add up, or arms of different bridges
        if bridge != other_bridge or (bridge and first == second):
            continue
        if abs(d[i] @ d[j]) > np.cos(np.deg2rad(0.1)):
            other = entries[i].name or f"gauge {i + 1}"
            raise refuse(j, f"{other} has the same position and direction", "Remove one of the two gauges.")


def _error_at(key: str, entries: Sequence[BondedEntry], i: int, what: str, remedy: str) -> UserError:
    entry = entries[i]
    return UserError(f"bonded gauge {entry.name or i + 1}: {what}", key=entry.key or f"{key}.{i}", remedy=remedy)


def _xyz(x: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in x)


@dataclass(frozen=True)
class ImportedGauges:
    """pool (m): element is the number of the gauge in the table, facet 0, nodes −1, normal zero, direction unit or zero if blank
    in the table; rows, CSR (m, r) [1/m, 1/rad]: strain operator, per motion of every row of the matrices."""

    pool: Candidates
    rows: sparse.csr_array


def without(gauges: ImportedGauges, mesh: Mesh, facets: Facets | None, zones: Sequence[Zone]) -> ImportedGauges:
    """The gauges outside all zones. Raises InfeasibleError if no gauge remains."""
    selected = np.ones(len(gauges.pool), dtype=bool)
    for zone in zones:
        selected &= ~inside(zone, mesh, facets, gauges.pool.position, gauges.pool.normal)
    if not selected.any():
        raise InfeasibleError(
            f"no imported gauge lies outside the excluded zones (imported gauges: {len(selected)})",
            remedy="Remove zones from `gauges.exclude`, or make them smaller.",
        )
    index = np.flatnonzero(selected)
    return ImportedGauges(gauges.pool.take(index), gauges.rows[index])


def imported_pool(number: np.ndarray, position: np.ndarray, direction: np.ndarray) -> Candidates:
    """Candidates by their numbers (m,), positions (m, 3) [m] and directions (m, 3) of any length."""
    m = len(number)
    length = np.linalg.norm(direction, axis=1)
    return Candidates(
        element=number,
        facet=np.zeros(m, dtype=np.int64),
        kind=np.full(m, -1),
        nodes=np.full((m, 8), -1),
        position=position,
        normal=np.zeros((m, 3)),
        direction=direction / np.where(length > 0, length, 1.0)[:, None],
        angle=np.zeros(m),
    )


HERE, BEHIND = 0, 1
PATTERNS: Mapping[str, tuple[tuple[int, float, int], ...]] = {
    "half-bending": ((HERE, 0.0, 1), (BEHIND, 0.0, -1)),
    "full-bending": ((HERE, 0.0, 1), (BEHIND, 0.0, -1), (HERE, 0.0, 1), (BEHIND, 0.0, -1)),
    "half-axial": ((HERE, 0.0, 1), (BEHIND, 0.0, 1)),
    "full-torsion": ((HERE, 45.0, 1), (HERE, -45.0, -1), (BEHIND, 45.0, 1), (BEHIND, -45.0, -1)),
}
"""Arms of each pattern: side, angle [deg] from d, right-handed about the outward normal of its side, sign. The sign of the first
arm is 1."""
SAME_DIRECTION = 0.1
"""Largest difference of the directions of one bridge from its two sides [deg]."""


@dataclass(frozen=True)
class StrainGauges:
    """candidates; alone: positions without a bridge, because the facet behind is not admissible for its arms; twice: duplicates
    of a bridge from its other side; left_out: positions where a grid would cross a sharp edge."""

    candidates: Candidates
    alone: int = 0
    twice: int = 0
    left_out: int = 0


def bridges(skin: Skin, pool: Candidates, pattern: str, admitted: np.ndarray) -> StrainGauges:
    """A bridge for every gauge of the pool, with arms at its position p and the opposite one p′, the first exit of the line from
    p along −n:

        half-bending    ε(p) − ε(p′)            full-bending    2 [ε(p) − ε(p′)], of four grids
        half-axial      ε(p) + ε(p′)            full-torsion    ε₊₄₅(p) − ε₋₄₅(p) + ε₊₄₅(p′) − ε₋₄₅(p′)

    along d at p and d′ ∥ d − (d·n′) n′ at p′, ±45° right-handed about the outward normal of each position.
    pool: gauges of one channel; admitted: indices of the facets that may carry gauges. Bridges are left out if p′ is on no such
    facet or d is within 10° of its normal, and if they duplicate an earlier bridge. The result may be empty."""
    exits = opposite(skin, pool.position, pool.normal)
    admissible = np.isin(exits.facet, admitted)
    normal = np.zeros((len(pool), 3))
    _, normal[admissible] = skin.frames(exits.facet[admissible], exits.local[admissible])
    steep = np.abs(np.sum(pool.direction * normal, axis=1)) > np.cos(np.deg2rad(STEEPEST))
    index = np.flatnonzero(admissible & ~steep)
    front, at, n = pool.take(index), exits.facet[index], normal[index]
    behind = replace(
        front,
        **skin.facets.columns(at),
        position=exits.point[index],
        normal=n,
        direction=tangent(front.direction, n),
        angle=-front.angle,
        local=exits.local[index],
    )
    near = COINCIDENT * float(np.ptp(skin.position, axis=0).max())
    unique = _first_of_duplicates(front, behind, near, quarter=any(turn for _, turn, _ in PATTERNS[pattern]))
    sides = front.take(unique), behind.take(unique)
    (_, first, _), *further = PATTERNS[pattern]
    # ordered by bridge, then by arm
    bridge, m = np.repeat(np.arange(len(unique)), len(further)), len(unique)
    arms = [_rotate_side(sides[side], turn) for side, turn, _ in further]
    order = np.arange(len(arms) * m).reshape(len(arms), m).T.ravel()
    grid = replace(concatenate(arms), gauge=np.arange(len(order))).take(order)
    sign = np.tile([float(sign) for _, _, sign in further], m)
    gauges = replace(_rotate_side(sides[HERE], first), arms=Arms(bridge, sign, grid)) if m else sides[HERE]
    return StrainGauges(gauges, len(pool) - len(index), len(index) - len(unique))


def _first_of_duplicates(one: Candidates, other: Candidates, near: float, quarter: bool) -> np.ndarray:
    """Which of bridges (k,) with their two sides do not duplicate an earlier one: the same two positions in any order, and the
    same direction up to sign; quarter: or a perpendicular one, which only exchanges +45° and −45°."""
    if not len(one):
        return np.zeros(0, dtype=np.int64)
    tree = cKDTree(one.position)
    pairs = []
    for positions, reversed_sides in ((other.position, True), (one.position, False)):
        neighbours = tree.query_ball_point(positions, near)
        i = np.repeat(np.arange(len(one)), [len(index) for index in neighbours])
        j = np.array([int(index) for near_ones in neighbours for index in near_ones], dtype=np.int64)
        returns = np.linalg.norm(other.position[j] - (one if reversed_sides else other).position[i], axis=1) <= near
        # directions are compared on the side where both are tangent
        d = (other if reversed_sides else one).direction[i]
        along = np.linalg.norm(np.cross(d, one.direction[j]), axis=1) < np.sin(np.deg2rad(SAME_DIRECTION))
        across = np.abs(np.sum(d * one.direction[j], axis=1)) < np.sin(np.deg2rad(SAME_DIRECTION))
        is_duplicate = returns & (along | (across & quarter)) & (i != j)
        pairs.append(np.column_stack([i[is_duplicate], j[is_duplicate]]))
    i, j = np.concatenate(pairs).T
    return np.sort(np.unique(component_labels(len(one), i, j), return_index=True)[1])


def _rotate_side(side: Candidates, angle: float) -> Candidates:
    if angle == 0:
        return side
    each = np.full(len(side), angle)
    return replace(side, direction=turned(side.direction, side.normal, each), angle=side.angle + angle)
